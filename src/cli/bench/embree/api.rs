//! What is used of the library: its functions, the types that they take, and a scene of one mesh.

use std::{
    error::Error as _,
    ffi::{CString, c_char, c_int, c_uint, c_void},
    fs,
    path::{Path, PathBuf},
    ptr,
    sync::{
        Arc,
        atomic::{AtomicIsize, Ordering},
    },
    time::Instant,
};

use libloading::Library;

use super::super::rays::Corners;
use crate::cli::error::CliError;

/// `RTC_INVALID_GEOMETRY_ID`.
pub const NOTHING: u32 = u32::MAX;
/// `RTC_SCENE_FLAG_ROBUST`.
pub const ROBUST: c_uint = 1 << 2;
/// `RTC_BUILD_QUALITY_MEDIUM`.
pub const MEDIUM: c_uint = 1;
/// `RTC_BUILD_QUALITY_HIGH`.
pub const HIGH: c_uint = 2;
/// `RTC_BUILD_QUALITY_LOW`.
pub const LOW: c_uint = 0;
/// `RTC_BUILD_QUALITY_REFIT`.
pub const REFIT: c_uint = 3;
/// `RTC_GEOMETRY_TYPE_INSTANCE`.
pub const INSTANCE: c_uint = 121;
/// `RTC_FORMAT_FLOAT3X4_ROW_MAJOR`.
pub const MATRIX: c_uint = 0x9134;
/// `RTC_GEOMETRY_TYPE_TRIANGLE`.
pub const TRIANGLES: c_uint = 0;
/// `RTC_BUFFER_TYPE_INDEX`, `RTC_FORMAT_UINT3`.
pub const INDICES: (c_uint, c_uint) = (0, 0x5003);
/// `RTC_BUFFER_TYPE_VERTEX`, `RTC_FORMAT_FLOAT3`.
pub const VERTICES: (c_uint, c_uint) = (1, 0x9003);
/// `RTC_RAY_QUERY_FLAG_COHERENT`.
pub const COHERENT: c_uint = 1 << 16;
/// `RTC_FEATURE_FLAG_ALL`.
pub const ALL_FEATURES: c_uint = u32::MAX;
/// Rows that a hit may have for instances, of which ours have none.
pub const INSTANCES: usize = 9;
pub type Handle = *mut c_void;

/// `RTCRayHit`.
#[repr(C, align(16))]
#[derive(Clone, Copy)]
pub struct RayHit {
    pub origin: [f32; 3],
    pub near: f32,
    pub direction: [f32; 3],
    pub time: f32,
    pub far: f32,
    pub mask: u32,
    pub id: u32,
    pub flags: u32,
    pub normal: [f32; 3],
    pub u: f32,
    pub v: f32,
    pub triangle: u32,
    pub geometry: u32,
    pub instances: [u32; INSTANCES],
}

/// `RTCRayHit8`, `RTCRayHit16`.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub struct Packet<const N: usize> {
    pub origin: [[f32; N]; 3],
    pub near: [f32; N],
    pub direction: [[f32; N]; 3],
    pub time: [f32; N],
    pub far: [f32; N],
    pub mask: [u32; N],
    pub id: [u32; N],
    pub flags: [u32; N],
    pub normal: [[f32; N]; 3],
    pub u: [f32; N],
    pub v: [f32; N],
    pub triangle: [u32; N],
    pub geometry: [u32; N],
    pub instances: [[u32; N]; INSTANCES],
}

/// `RTCIntersectArguments`.
#[repr(C)]
pub struct Arguments {
    pub flags: c_uint,
    pub features: c_uint,
    pub context: Handle,
    pub filter: Handle,
    pub intersect: Handle,
    /// `minWidthDistanceFactor`, in builds that have it.
    pub min_width: [f32; 2],
}

pub type Query<R> = unsafe extern "C" fn(Handle, *mut R, *mut Arguments);
pub type PacketQuery<const N: usize> = unsafe extern "C" fn(*const c_int, Handle, *mut Packet<N>, *mut Arguments);
pub type Monitor = unsafe extern "C" fn(*mut c_void, isize, bool) -> bool;

/// Functions of the library, which stays open as long as they are there.
pub struct Api {
    pub new_device: unsafe extern "C" fn(*const c_char) -> Handle,
    pub release_device: unsafe extern "C" fn(Handle),
    pub device_property: unsafe extern "C" fn(Handle, c_int) -> isize,
    pub device_error: unsafe extern "C" fn(Handle) -> c_int,
    pub monitor_memory: unsafe extern "C" fn(Handle, Option<Monitor>, *mut c_void),
    pub new_scene: unsafe extern "C" fn(Handle) -> Handle,
    pub release_scene: unsafe extern "C" fn(Handle),
    pub scene_flags: unsafe extern "C" fn(Handle, c_uint),
    pub scene_quality: unsafe extern "C" fn(Handle, c_uint),
    pub commit_scene: unsafe extern "C" fn(Handle),
    pub new_geometry: unsafe extern "C" fn(Handle, c_uint) -> Handle,
    pub release_geometry: unsafe extern "C" fn(Handle),
    pub new_buffer: unsafe extern "C" fn(Handle, c_uint, c_uint, c_uint, usize, usize) -> *mut c_void,
    pub commit_geometry: unsafe extern "C" fn(Handle),
    pub attach_geometry: unsafe extern "C" fn(Handle, Handle) -> c_uint,
    pub geometry_quality: unsafe extern "C" fn(Handle, c_uint),
    pub update_buffer: unsafe extern "C" fn(Handle, c_uint, c_uint),
    pub instanced_scene: unsafe extern "C" fn(Handle, Handle),
    pub transform: unsafe extern "C" fn(Handle, c_uint, c_uint, *const c_void),
    pub intersect: Query<RayHit>,
    pub occluded: Query<RayHit>,
    pub intersect_8: PacketQuery<8>,
    pub intersect_16: PacketQuery<16>,
    pub _library: Library,
}

/// Finds a file by the start of its name in a folder or in those in it, as packages have them.
fn find(folder: &Path, start: &str) -> Option<PathBuf> {
    let list = |folder: &Path| -> Vec<PathBuf> {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        let mut all: Vec<_> = entries.map(|entry| entry.path()).collect();
        all.sort();
        all
    };
    let named = |path: &PathBuf| {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        name.trim_start_matches("lib").starts_with(start) && [".so", ".dylib", ".dll"].iter().any(|e| name.contains(e))
    };
    let here = list(folder);
    let below = here.iter().filter(|path| path.is_dir()).flat_map(|path| list(path));
    here.iter().cloned().chain(below).find(named)
}

/// Opens a library for those that are opened later to find.
#[cfg(unix)]
#[allow(unsafe_code)]
fn open_for_all(path: &Path) -> Result<(), libloading::Error> {
    use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_NOW};
    // SAFETY: running the initialisers of the library named by the user is what was asked for.
    let library = unsafe { Library::open(Some(path), RTLD_NOW | RTLD_GLOBAL) }?;
    std::mem::forget(library);
    Ok(())
}

#[cfg(not(unix))]
fn open_for_all(_: &Path) -> Result<(), libloading::Error> {
    Ok(())
}

#[allow(unsafe_code)]
pub fn open(path: &Path) -> Result<Api, CliError> {
    let problem = |problem: String| CliError::Library { path: path.to_owned(), problem };
    let file = if path.is_dir() {
        find(path, "embree4").ok_or_else(|| problem("there is no libembree4 in this folder".into()))?
    } else {
        path.to_owned()
    };
    let failed = |error: libloading::Error| {
        let cause = error.source().map_or_else(|| error.to_string(), ToString::to_string);
        problem(format!("cannot be opened as Embree 4: {cause}"))
    };
    // Wheels bring the library that it needs under a name that the system does not know.
    if let Some(threads) = file.parent().and_then(|folder| find(folder, "tbb")) {
        open_for_all(&threads).map_err(failed)?;
    }
    // SAFETY: as above.
    let library = unsafe { Library::new(&file) }.map_err(failed)?;
    macro_rules! function {
        ($name:literal) => {
            // SAFETY: the types of the fields are those of Embree 4's headers.
            *unsafe { library.get($name) }.map_err(failed)?
        };
    }
    Ok(Api {
        new_device: function!(b"rtcNewDevice"),
        release_device: function!(b"rtcReleaseDevice"),
        device_property: function!(b"rtcGetDeviceProperty"),
        device_error: function!(b"rtcGetDeviceError"),
        monitor_memory: function!(b"rtcSetDeviceMemoryMonitorFunction"),
        new_scene: function!(b"rtcNewScene"),
        release_scene: function!(b"rtcReleaseScene"),
        scene_flags: function!(b"rtcSetSceneFlags"),
        scene_quality: function!(b"rtcSetSceneBuildQuality"),
        commit_scene: function!(b"rtcCommitScene"),
        new_geometry: function!(b"rtcNewGeometry"),
        release_geometry: function!(b"rtcReleaseGeometry"),
        new_buffer: function!(b"rtcSetNewGeometryBuffer"),
        commit_geometry: function!(b"rtcCommitGeometry"),
        attach_geometry: function!(b"rtcAttachGeometry"),
        geometry_quality: function!(b"rtcSetGeometryBuildQuality"),
        update_buffer: function!(b"rtcUpdateGeometryBuffer"),
        instanced_scene: function!(b"rtcSetGeometryInstancedScene"),
        transform: function!(b"rtcSetGeometryTransform"),
        intersect: function!(b"rtcIntersect1"),
        occluded: function!(b"rtcOccluded1"),
        intersect_8: function!(b"rtcIntersect8"),
        intersect_16: function!(b"rtcIntersect16"),
        _library: library,
    })
}

/// Adds up what the library holds.
#[allow(unsafe_code)]
unsafe extern "C" fn count_bytes(sum: *mut c_void, bytes: isize, _: bool) -> bool {
    // SAFETY: the pointer given with this function is to an atomic that lives longer than the device.
    unsafe { &*sum.cast::<AtomicIsize>() }.fetch_add(bytes, Ordering::Relaxed);
    true
}

/// A scene of one mesh, on a device of its own.
pub struct Mesh {
    pub api: Arc<Api>,
    pub device: Handle,
    pub scene: Handle,
    pub bytes: Box<AtomicIsize>,
}

// SAFETY: Embree's objects may be used by any thread; a committed scene is only read.
#[allow(unsafe_code)]
unsafe impl Send for Mesh {}
// SAFETY: queries of one scene by several threads at a time are what Embree is made for.
#[allow(unsafe_code)]
unsafe impl Sync for Mesh {}

impl Mesh {
    /// Over triangles, and how long it took.
    #[allow(unsafe_code)]
    pub fn build(api: &Arc<Api>, triangles: &[Corners], flags: c_uint, quality: c_uint) -> Result<(Self, f64), String> {
        let mesh = Self::empty(api, flags, quality)?;
        let (geometry, _) = mesh.geometry(triangles)?;
        // As for the other structures, the clock starts when the triangles are there.
        let start = Instant::now();
        // SAFETY: the functions are called as the manual has it, the geometry is not used any more once it is released.
        unsafe {
            (api.commit_geometry)(geometry);
            (api.attach_geometry)(mesh.scene, geometry);
            (api.release_geometry)(geometry);
            (api.commit_scene)(mesh.scene);
        }
        let seconds = start.elapsed().as_secs_f64();
        mesh.checked()?;
        Ok((mesh, seconds))
    }

    /// A scene without anything, on a device of as many threads as other structures are built by.
    #[allow(unsafe_code)]
    pub fn empty(api: &Arc<Api>, flags: c_uint, quality: c_uint) -> Result<Self, String> {
        let config = format!("threads={}", rayon::current_num_threads());
        let config = CString::new(config).map_err(|error| error.to_string())?;
        let bytes = Box::new(AtomicIsize::new(0));
        // SAFETY: as above.
        unsafe {
            let device = (api.new_device)(config.as_ptr());
            if device.is_null() {
                return Err(format!("no device: error {}", (api.device_error)(ptr::null_mut())));
            }
            (api.monitor_memory)(device, Some(count_bytes), ptr::from_ref(&*bytes).cast_mut().cast());
            let scene = (api.new_scene)(device);
            (api.scene_flags)(scene, flags);
            (api.scene_quality)(scene, quality);
            Ok(Self { api: api.clone(), device, scene, bytes })
        }
    }

    /// A geometry of triangles, not committed yet, and the memory that its corners are in, which is there as long as it.
    #[allow(unsafe_code)]
    pub fn geometry(&self, triangles: &[Corners]) -> Result<(Handle, *mut Corners), String> {
        let api = &self.api;
        // SAFETY: buffers are written within their size, which is that of the triangles, and before the geometry is
        // committed.
        unsafe {
            let geometry = (api.new_geometry)(self.device, TRIANGLES);
            if triangles.is_empty() {
                return Ok((geometry, ptr::null_mut()));
            }
            let vertices = (api.new_buffer)(geometry, VERTICES.0, 0, VERTICES.1, 12, 3 * triangles.len());
            let indices = (api.new_buffer)(geometry, INDICES.0, 0, INDICES.1, 12, triangles.len());
            if vertices.is_null() || indices.is_null() {
                return Err(format!("no buffers: error {}", (api.device_error)(self.device)));
            }
            ptr::copy_nonoverlapping(triangles.as_ptr(), vertices.cast(), triangles.len());
            (0..3 * triangles.len()).for_each(|at| indices.cast::<u32>().add(at).write(at as u32));
            Ok((geometry, vertices.cast()))
        }
    }

    /// An error if something went wrong on the device.
    #[allow(unsafe_code)]
    pub fn checked(&self) -> Result<(), String> {
        // SAFETY: the device is there as long as this is.
        match unsafe { (self.api.device_error)(self.device) } {
            0 => Ok(()),
            error => Err(format!("the build failed: error {error}")),
        }
    }

    #[allow(unsafe_code)]
    fn property(&self, property: c_int) -> isize {
        // SAFETY: the device is there as long as this is.
        unsafe { (self.api.device_property)(self.device, property) }
    }

    /// Version and instruction set.
    pub fn describe(&self) -> String {
        // RTC_DEVICE_PROPERTY_VERSION_MAJOR, _MINOR, _PATCH; _NATIVE_RAY8_SUPPORTED, which it is from AVX on, and
        // _NATIVE_RAY16_SUPPORTED, which it is with AVX-512.
        let [major, minor, patch, eight, sixteen] = [1, 2, 3, 33, 34].map(|property| self.property(property));
        let chosen = match (eight, sixteen) {
            (0, 0) => "SSE",
            (_, 0) => "AVX or AVX2",
            _ => "AVX-512",
        };
        format!("Embree {major}.{minor}.{patch}, which chose {chosen}")
    }
}

impl Drop for Mesh {
    #[allow(unsafe_code)]
    fn drop(&mut self) {
        // SAFETY: both are released once, the scene before its device; the count of bytes is dropped after them.
        unsafe {
            (self.api.release_scene)(self.scene);
            (self.api.release_device)(self.device);
        }
    }
}
