//! The same rays through Intel's Embree 4, for comparison: a library that is opened at run time.
//!
//! Nothing of it is needed to build the program. What is declared here follows the headers `rtcore_*.h` of version 4;
//! room is left where newer versions of it, or builds with several levels of instances, write more.

mod api;
mod builds;

use std::{
    path::Path,
    ptr,
    sync::{Arc, atomic::Ordering},
};

use wavecast::accel::{Cell, Work};

use self::api::{
    ALL_FEATURES, Arguments, COHERENT, HIGH, INSTANCES, MEDIUM, Mesh, NOTHING, Packet, PacketQuery, ROBUST, RayHit,
    open,
};
pub use self::builds::build_peers;
use super::{
    contender::{Answer, Built, Contender, Question},
    peers::Described,
    rays::{Corners, OneRay},
};
use crate::cli::error::CliError;

/// How far apart, as a part of it, two distances may be that are called the same: other tests round in other ways.
const SAME: f32 = 1e-4;

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
pub fn peers(path: &Path) -> Described<[Corners], Built> {
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
