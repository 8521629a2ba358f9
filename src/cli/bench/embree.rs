//! The same rays through Intel's Embree 4, for comparison: a library that is opened at run time.
//!
//! Nothing of it is needed to build the program. What is declared here follows the headers `rtcore_*.h` of version 4;
//! room is left where newer versions of it, or builds with several levels of instances, write more.

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
use wavecast::accel::{Cell, Work};

use super::{
    accel::Peers,
    contender::{Answer, Built, Contender, Question},
    rays::{Corners, OneRay},
};
use crate::cli::error::CliError;

/// `RTC_INVALID_GEOMETRY_ID`.
const NOTHING: u32 = u32::MAX;
/// `RTC_SCENE_FLAG_ROBUST`.
const ROBUST: c_uint = 1 << 2;
/// `RTC_BUILD_QUALITY_MEDIUM`.
const MEDIUM: c_uint = 1;
/// `RTC_BUILD_QUALITY_HIGH`.
const HIGH: c_uint = 2;
/// `RTC_GEOMETRY_TYPE_TRIANGLE`.
const TRIANGLES: c_uint = 0;
/// `RTC_BUFFER_TYPE_INDEX`, `RTC_FORMAT_UINT3`.
const INDICES: (c_uint, c_uint) = (0, 0x5003);
/// `RTC_BUFFER_TYPE_VERTEX`, `RTC_FORMAT_FLOAT3`.
const VERTICES: (c_uint, c_uint) = (1, 0x9003);
/// `RTC_RAY_QUERY_FLAG_COHERENT`.
const COHERENT: c_uint = 1 << 16;
/// `RTC_FEATURE_FLAG_ALL`.
const ALL_FEATURES: c_uint = u32::MAX;
/// Rows that a hit may have for instances, of which ours have none.
const INSTANCES: usize = 9;
/// How far apart, as a part of it, two distances may be that are called the same: other tests round in other ways.
const SAME: f32 = 1e-4;

type Handle = *mut c_void;

/// `RTCRayHit`.
#[repr(C, align(16))]
#[derive(Clone, Copy)]
struct RayHit {
    origin: [f32; 3],
    near: f32,
    direction: [f32; 3],
    time: f32,
    far: f32,
    mask: u32,
    id: u32,
    flags: u32,
    normal: [f32; 3],
    u: f32,
    v: f32,
    triangle: u32,
    geometry: u32,
    instances: [u32; INSTANCES],
}

/// `RTCRayHit8`, `RTCRayHit16`.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
struct Packet<const N: usize> {
    origin: [[f32; N]; 3],
    near: [f32; N],
    direction: [[f32; N]; 3],
    time: [f32; N],
    far: [f32; N],
    mask: [u32; N],
    id: [u32; N],
    flags: [u32; N],
    normal: [[f32; N]; 3],
    u: [f32; N],
    v: [f32; N],
    triangle: [u32; N],
    geometry: [u32; N],
    instances: [[u32; N]; INSTANCES],
}

/// `RTCIntersectArguments`.
#[repr(C)]
struct Arguments {
    flags: c_uint,
    features: c_uint,
    context: Handle,
    filter: Handle,
    intersect: Handle,
    /// `minWidthDistanceFactor`, in builds that have it.
    min_width: [f32; 2],
}

type Query<R> = unsafe extern "C" fn(Handle, *mut R, *mut Arguments);
type PacketQuery<const N: usize> = unsafe extern "C" fn(*const c_int, Handle, *mut Packet<N>, *mut Arguments);
type Monitor = unsafe extern "C" fn(*mut c_void, isize, bool) -> bool;

/// Functions of the library, which stays open as long as they are there.
struct Api {
    new_device: unsafe extern "C" fn(*const c_char) -> Handle,
    release_device: unsafe extern "C" fn(Handle),
    device_property: unsafe extern "C" fn(Handle, c_int) -> isize,
    device_error: unsafe extern "C" fn(Handle) -> c_int,
    monitor_memory: unsafe extern "C" fn(Handle, Option<Monitor>, *mut c_void),
    new_scene: unsafe extern "C" fn(Handle) -> Handle,
    release_scene: unsafe extern "C" fn(Handle),
    scene_flags: unsafe extern "C" fn(Handle, c_uint),
    scene_quality: unsafe extern "C" fn(Handle, c_uint),
    commit_scene: unsafe extern "C" fn(Handle),
    new_geometry: unsafe extern "C" fn(Handle, c_uint) -> Handle,
    release_geometry: unsafe extern "C" fn(Handle),
    new_buffer: unsafe extern "C" fn(Handle, c_uint, c_uint, c_uint, usize, usize) -> *mut c_void,
    commit_geometry: unsafe extern "C" fn(Handle),
    attach_geometry: unsafe extern "C" fn(Handle, Handle) -> c_uint,
    intersect: Query<RayHit>,
    occluded: Query<RayHit>,
    intersect_8: PacketQuery<8>,
    intersect_16: PacketQuery<16>,
    _library: Library,
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
fn open(path: &Path) -> Result<Api, CliError> {
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
struct Mesh {
    api: Arc<Api>,
    device: Handle,
    scene: Handle,
    bytes: Box<AtomicIsize>,
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
    fn build(api: &Arc<Api>, triangles: &[Corners], flags: c_uint, quality: c_uint) -> Result<(Self, f64), String> {
        // As many threads as the other structures are built by.
        let config = format!("threads={}", rayon::current_num_threads());
        let config = CString::new(config).map_err(|error| error.to_string())?;
        let bytes = Box::new(AtomicIsize::new(0));
        // SAFETY: the functions are called as the manual has it; buffers are written within their size, which is that of
        // the triangles, and before the geometry is committed.
        unsafe {
            let device = (api.new_device)(config.as_ptr());
            if device.is_null() {
                return Err(format!("no device: error {}", (api.device_error)(ptr::null_mut())));
            }
            (api.monitor_memory)(device, Some(count_bytes), ptr::from_ref(&*bytes).cast_mut().cast());
            let scene = (api.new_scene)(device);
            let mesh = Self { api: api.clone(), device, scene, bytes };
            (api.scene_flags)(scene, flags);
            (api.scene_quality)(scene, quality);
            let geometry = (api.new_geometry)(device, TRIANGLES);
            if !triangles.is_empty() {
                let vertices = (api.new_buffer)(geometry, VERTICES.0, 0, VERTICES.1, 12, 3 * triangles.len());
                let indices = (api.new_buffer)(geometry, INDICES.0, 0, INDICES.1, 12, triangles.len());
                if vertices.is_null() || indices.is_null() {
                    return Err(format!("no buffers: error {}", (api.device_error)(device)));
                }
                ptr::copy_nonoverlapping(triangles.as_ptr(), vertices.cast(), triangles.len());
                (0..3 * triangles.len()).for_each(|at| indices.cast::<u32>().add(at).write(at as u32));
            }
            // As for the other structures, the clock starts when the triangles are there.
            let start = Instant::now();
            (api.commit_geometry)(geometry);
            (api.attach_geometry)(scene, geometry);
            (api.release_geometry)(geometry);
            (api.commit_scene)(scene);
            let seconds = start.elapsed().as_secs_f64();
            match (api.device_error)(device) {
                0 => Ok((mesh, seconds)),
                error => Err(format!("the build failed: error {error}")),
            }
        }
    }

    #[allow(unsafe_code)]
    fn property(&self, property: c_int) -> isize {
        // SAFETY: the device is there as long as this is.
        unsafe { (self.api.device_property)(self.device, property) }
    }

    /// Version and instruction set.
    fn describe(&self) -> String {
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

/// A way to ask a scene.
#[derive(Clone, Copy, PartialEq)]
enum Mode {
    Single,
    Packet8,
    Packet16,
}

struct Embree {
    mesh: Arc<Mesh>,
    mode: Mode,
}

impl Embree {
    #[allow(unsafe_code)]
    fn single(&self, rays: &[OneRay], any: bool, into: &mut [Answer]) {
        let Mesh { api, scene, .. } = &*self.mesh;
        let query = if any { api.occluded } else { api.intersect };
        let mut ray = RayHit {
            origin: [0.0; 3],
            near: 0.0,
            direction: [0.0; 3],
            time: 0.0,
            far: 0.0,
            mask: u32::MAX,
            id: 0,
            flags: 0,
            normal: [0.0; 3],
            u: 0.0,
            v: 0.0,
            triangle: NOTHING,
            geometry: NOTHING,
            instances: [NOTHING; INSTANCES],
        };
        for (&(origin, direction, far), answer) in rays.iter().zip(into) {
            (ray.origin, ray.direction, ray.far, ray.geometry) = (origin, direction, far, NOTHING);
            // SAFETY: the scene is committed, the ray aligned and as large as any that Embree writes.
            unsafe { query(*scene, &mut ray, ptr::null_mut()) };
            *answer = if any {
                (ray.far == f32::NEG_INFINITY).then_some((0, 0.0))
            } else {
                (ray.geometry != NOTHING).then_some((ray.triangle, ray.far))
            };
        }
    }

    #[allow(unsafe_code)]
    fn packets<const N: usize>(&self, query: PacketQuery<N>, rays: &[OneRay], into: &mut [Answer]) {
        let mut arguments = Arguments {
            flags: COHERENT,
            features: ALL_FEATURES,
            context: ptr::null_mut(),
            filter: ptr::null_mut(),
            intersect: ptr::null_mut(),
            min_width: [0.0; 2],
        };
        let mut packet = Packet {
            origin: [[0.0; N]; 3],
            near: [0.0; N],
            direction: [[0.0; N]; 3],
            time: [0.0; N],
            far: [0.0; N],
            mask: [u32::MAX; N],
            id: [0; N],
            flags: [0; N],
            normal: [[0.0; N]; 3],
            u: [0.0; N],
            v: [0.0; N],
            triangle: [NOTHING; N],
            geometry: [NOTHING; N],
            instances: [[NOTHING; N]; INSTANCES],
        };
        for (rays, into) in rays.chunks(N).zip(into.chunks_mut(N)) {
            let mut valid = [0; N];
            for (lane, &(origin, direction, far)) in rays.iter().enumerate() {
                for axis in 0..3 {
                    (packet.origin[axis][lane], packet.direction[axis][lane]) = (origin[axis], direction[axis]);
                }
                (packet.far[lane], valid[lane]) = (far, -1);
            }
            packet.geometry = [NOTHING; N];
            // SAFETY: as for single rays; there is a word of the mask for each ray of the packet.
            unsafe { query(valid.as_ptr(), self.mesh.scene, &mut packet, &mut arguments) };
            for (lane, answer) in into.iter_mut().enumerate() {
                *answer = (packet.geometry[lane] != NOTHING).then_some((packet.triangle[lane], packet.far[lane]));
            }
        }
    }
}

impl Contender for Embree {
    /// Of the tree and of the mesh that it refers to.
    fn bytes(&self) -> usize {
        self.mesh.bytes.load(Ordering::Relaxed).max(0) as usize
    }

    fn references(&self) -> Option<usize> {
        None
    }

    fn answers(&self, rays: &[OneRay], question: Question, into: &mut [Answer]) {
        match self.mode {
            Mode::Single => self.single(rays, question == Question::Any, into),
            Mode::Packet8 => self.packets(self.mesh.api.intersect_8, rays, into),
            Mode::Packet16 => self.packets(self.mesh.api.intersect_16, rays, into),
        }
    }

    fn work(&self, _: &[OneRay], _: Question) -> Option<Work> {
        None
    }

    fn cells(&self, _: &mut dyn FnMut(Cell)) {}

    fn is_ours(&self) -> bool {
        false
    }

    /// Packets lose on all but camera rays.
    fn takes(&self, kind: &str) -> bool {
        self.mode == Mode::Single || kind == "primary"
    }

    fn agrees(&self, truth: &Answer, answer: &Answer) -> bool {
        match (truth, answer) {
            (Some((triangle, t)), Some((other, u))) => triangle == other || (t - u).abs() <= SAME * t,
            (None, None) => true,
            _ => false,
        }
    }
}

/// Opens the library and says what it is.
pub fn peers(path: &Path) -> Result<(Peers, Option<String>), CliError> {
    let api = Arc::new(open(path)?);
    let path = path.to_owned();
    let failed = move |problem| CliError::Library { path: path.clone(), problem };
    let (nothing, _) = Mesh::build(&api, &[], 0, HIGH).map_err(&failed)?;
    let described = nothing.describe();
    let build = move |triangles: &[Corners]| {
        let built = |flags, quality| Mesh::build(&api, triangles, flags, quality).map_err(&failed);
        let of = |name, mode, (mesh, seconds): &(Arc<Mesh>, f64)| {
            let structure = Box::new(Embree { mesh: mesh.clone(), mode });
            Built { name, structure, seconds: *seconds }
        };
        let shared = |(mesh, seconds): (Mesh, f64)| (Arc::new(mesh), seconds);
        let fast = built(0, HIGH).map(shared)?;
        let robust = built(ROBUST, HIGH).map(shared)?;
        let medium = built(0, MEDIUM).map(shared)?;
        Ok(vec![
            of("embree", Mode::Single, &fast),
            of("embree-robust", Mode::Single, &robust),
            of("embree-medium", Mode::Single, &medium),
            of("embree-packet8", Mode::Packet8, &fast),
            of("embree-packet16", Mode::Packet16, &fast),
        ])
    };
    Ok((Box::new(build), Some(described)))
}
