//! Ends dim paths at random and carries the others over.

use wide::f32x8;

use super::{dimensions, queues::PathQueue, stats::Blocks};
use crate::{
    sampling::Sampler,
    simd::{Bits, LANES, Mask, Real},
};

/// Scatterings before roulette begins: what pixels share of a path's first ray, they share as if it were sure to go on.
pub const ROULETTE_FROM: u32 = 2;

/// Share of the light at their far end below which paths play roulette.
///
/// What ends a path early makes those that go on count for more, and that noise costs more than the path would have: in the
/// Cornell box more than half of the variance was of roulette by the throughput alone, from the third scattering on. relMSE × seconds
/// over that, at 16 samples of 200×200 pixels: cornell 0.81, door 0.52, lights 0.83, million 0.86, outdoor 0.94, plates 1.05. With a
/// half, from the third scattering on, cornell 0.78, door 0.66, lights 0.81; with a tenth 0.85, 0.49, 0.93.
const PLAYS_BELOW: f32 = 0.25;

/// Scatterings from which on no path is sure to go on. Total internal reflection dims nothing, and shading normals
/// can turn a way into a solid that no way out mirrors: such a path would never end.
pub const ROULETTE_FOR_ALL: u32 = 64;

/// The most that roulette lets go on of paths with `depth` scatterings behind them.
#[inline(always)]
pub fn most_survivors(depth: u32) -> f32 {
    if depth >= ROULETTE_FOR_ALL { 0.95 } else { 1.0 }
}

/// Share of paths that go on, by what they could still bring to the pixel.
///
/// q = min(limit, max(throughput) · η²-scale / [`PLAYS_BELOW`]), which leaves the expected radiance as it was when the
/// survivors are weighted by 1/q (Arvo and Kirk 1990, "Particle Transport and Image Synthesis").
#[inline(always)]
pub fn survival<F: Real>(most: F, eta_scale: F, limit: F) -> F {
    (most * eta_scale.abs() * F::splat(1.0 / PLAYS_BELOW)).min(limit)
}

/// Moves the paths of `from` that survive to the end of `to`, which has room for them.
pub fn bounce(sampler: &Sampler, from: &mut PathQueue, to: &mut PathQueue) -> Blocks {
    let rows = from.len();
    for first in (0..rows).step_by(LANES) {
        let mut block = from.block(first);
        let mut lanes: u32 = if rows - first < LANES { (1_u32 << (rows - first)) - 1 } else { 0xff };
        let [r, g, b, eta] =
            [block.throughput_r, block.throughput_g, block.throughput_b, block.eta_scale].map(f32x8::new);
        let limit = f32x8::from_fn(|lane| most_survivors(block.depth[lane]));
        let q = survival(Real::max(Real::max(r, g), b), eta, limit);
        let late = (0..LANES).fold(0, |bits, lane| bits | u32::from(block.depth[lane] >= ROULETTE_FROM) << lane);
        let plays = Real::lt(q, f32x8::ONE) & Mask::from_bits(late);
        if plays.bits() & lanes != 0 {
            let bits = |column: [u32; LANES]| <f32x8 as Real>::Bits::from_fn(|lane| column[lane]);
            let dimension = dimensions::at::<f32x8>(
                bits(block.depth) + <f32x8 as Real>::Bits::splat(u32::MAX),
                dimensions::ROULETTE,
            );
            let u: f32x8 = sampler.one(bits(block.pixel_hash), bits(block.index), dimension);
            let survives = Real::lt(u, q);
            let weight = Real::select(plays & survives, f32x8::ONE / q, f32x8::ONE);
            (block.throughput_r, block.throughput_g, block.throughput_b) =
                ((r * weight).to_array(), (g * weight).to_array(), (b * weight).to_array());
            lanes &= (survives | !plays).bits();
        }
        to.put(&block, lanes);
    }
    from.rewind();
    Blocks::of(rows)
}
