//! Finds what each path's ray meets.

use super::{
    dimensions::ray_id,
    queues::{HitQueue, HitRow, PathQueue},
};
use crate::accel::{Accel, Coverage, Stacks};

/// Fills `hits` with the nearest hit of each row of `paths`; where something `blends`, rays are named.
pub fn intersect<C: Coverage>(
    accel: &Accel,
    paths: &PathQueue,
    blends: bool,
    coverage: &C,
    stacks: &mut Stacks,
    hits: &mut HitQueue,
) {
    hits.clear();
    for i in 0..paths.len() {
        let origin = [paths.ox[i], paths.oy[i], paths.oz[i]];
        let direction = [paths.dx[i], paths.dy[i], paths.dz[i]];
        let id = if !blends { 0 } else { ray_id(paths.pixel_hash[i], paths.sample[i], paths.depth[i], 0) };
        let hit = accel.nearest(origin, direction, paths.t_max[i], id, coverage, stacks);
        hits.push(HitRow {
            t: hit.t,
            b1: hit.b1,
            b2: hit.b2,
            instance: hit.instance,
            triangle: hit.triangle,
            back: u32::from(hit.back),
        });
    }
}
