//! Beer–Lambert: light fades along rays that run inside solids. Runs only in scenes that absorb.

use super::queues::{HitQueue, PathQueue};
use crate::flat::{FlatScene, NONE, flags};

/// The material row of the solid that a ray to a hit has run inside, or `NONE`.
///
/// A path that is not known to be inside a solid but meets one from the back has been in it.
#[inline]
pub fn medium_of(scene: &FlatScene, medium: u32, material: u32, back: bool) -> u32 {
    if medium == NONE && back && scene.materials.flags[material as usize] & flags::SOLID != 0 {
        material
    } else {
        medium
    }
}

/// Multiplies each path's throughput by what its solid lets through up to the hit; returns the number absorbed.
///
/// Rays that leave to the sky are spared: the solid they are in has no other side.
pub fn absorb(scene: &FlatScene, materials: &[u32], hits: &HitQueue, paths: &mut PathQueue) -> u64 {
    let mut absorbed = 0;
    for (i, &material) in materials.iter().enumerate() {
        if hits.instance[i] == NONE {
            continue;
        }
        let medium = medium_of(scene, paths.medium[i], material, hits.back[i] == 1);
        if medium != NONE {
            let keep = scene.materials.absorption[medium as usize].map(|a| (-a * hits.t[i]).exp());
            paths.throughput_r[i] *= keep[0];
            paths.throughput_g[i] *= keep[1];
            paths.throughput_b[i] *= keep[2];
            absorbed += 1;
        }
    }
    absorbed
}
