//! Which pair of the sampler each decision along a path uses.

use crate::simd::{Bits, Real};

/// Position within the pixel's filter.
pub const FILTER: u32 = 0;
/// Which of the directions that a pixel looks in, if there are several.
pub const LENS: u32 = 1;
/// First pair of the first surface.
const FIRST: u32 = 2;
/// Pairs for each surface.
const STRIDE: u32 = 4;

/// Which light (first number); which lobe (second).
pub const CHOICE: u32 = 0;
/// Position on the light.
pub const LIGHT: u32 = 1;
/// Direction of the next ray.
pub const DIRECTION: u32 = 2;
/// Whether the path goes on.
pub const ROULETTE: u32 = 3;

/// The pair for a decision at the surface behind `depth` scatterings.
#[inline(always)]
pub fn at<F: Real>(depth: F::Bits, decision: u32) -> F::Bits {
    depth * F::Bits::splat(STRIDE) + F::Bits::splat(FIRST + decision)
}

/// Stands for a ray where surfaces that cover in part are decided: a hash of the path's place among the sampler's numbers and
/// of its depth.
///
/// `kind` tells apart the rays that leave one vertex.
#[inline(always)]
pub fn ray_id(pixel_hash: u32, index: u32, depth: u32, kind: u32) -> u32 {
    mix(pixel_hash ^ mix(index ^ mix(depth * 2 + kind)))
}

/// A bijection in which every input bit moves half the output bits (Wellons' lowbias32).
#[inline(always)]
pub fn mix(mut x: u32) -> u32 {
    x = (x ^ x >> 16).wrapping_mul(0x7feb_352d);
    x = (x ^ x >> 15).wrapping_mul(0x846c_a68b);
    x ^ x >> 16
}
