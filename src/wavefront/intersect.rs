//! Finds what each path's ray meets.

use super::{
    dimensions::ray_id,
    queues::{HitQueue, HitRow, PathQueue},
};
use crate::accel::{Accel, Coverage, Hit, Rays};

/// Fills `hits` with the nearest hit of each row of `paths`; where something `blends`, rays are named. From row
/// `camera` on they come from the camera: eight neighbours in the picture one after another, of these so many samples.
pub fn intersect<C: Coverage>(
    accel: &Accel,
    paths: &PathQueue,
    (camera, samples): (usize, usize),
    blends: bool,
    coverage: &C,
    hits: &mut HitQueue,
) {
    hits.resize(paths.len());
    accel.nearest_of(&PathRays { paths, camera, samples, blends }, coverage, |row, hit| {
        let Hit { t, b1, b2, instance, triangle, back } = *hit;
        hits.set(row, HitRow { t, b1, b2, instance, triangle, back: u32::from(back) });
    });
}

/// The rays of a path queue.
struct PathRays<'a> {
    paths: &'a PathQueue,
    camera: usize,
    samples: usize,
    blends: bool,
}

impl Rays for PathRays<'_> {
    fn count(&self) -> usize {
        self.paths.len()
    }

    #[inline(always)]
    fn ray(&self, i: usize) -> ([f32; 3], [f32; 3], f32) {
        let paths = self.paths;
        ([paths.ox[i], paths.oy[i], paths.oz[i]], [paths.dx[i], paths.dy[i], paths.dz[i]], paths.t_max[i])
    }

    #[inline(always)]
    fn id(&self, i: usize) -> u32 {
        let paths = self.paths;
        if self.blends { ray_id(paths.pixel_hash[i], paths.index[i], paths.depth[i], 0) } else { 0 }
    }

    fn coherent_from(&self) -> usize {
        self.camera
    }

    fn samples(&self) -> usize {
        self.samples
    }
}
