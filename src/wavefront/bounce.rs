//! Ends dim paths at random and carries the others over.

use wide::f32x8;

use super::{dimensions, queues::PathQueue, stats::Blocks};
use crate::{
    sampling::Sampler,
    simd::{Bits, LANES, Mask, Real},
};

/// Scatterings before roulette begins: the first few paths carry most of the light.
pub const ROULETTE_FROM: u32 = 3;

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
/// q = min(limit, max(throughput) · η²-scale), which leaves the expected radiance as it was when the
/// survivors are weighted by 1/q (Arvo and Kirk 1990, "Particle Transport and Image Synthesis").
#[inline(always)]
pub fn survival<F: Real>(most: F, eta_scale: F, limit: F) -> F {
    (most * eta_scale).min(limit)
}

/// Moves the paths of `from` that survive to the end of `to`.
///
/// `to` holds no padding. `alive` is scratch.
pub fn bounce(sampler: &Sampler, from: &mut PathQueue, alive: &mut Vec<u32>, to: &mut PathQueue) -> Blocks {
    alive.clear();
    let rows = from.len();
    from.pad();
    for first in (0..rows).step_by(LANES) {
        let at = first..first + LANES;
        let [r, g, b, eta] = [&from.throughput_r, &from.throughput_g, &from.throughput_b, &from.eta_scale]
            .map(|column| <f32x8 as Real>::load(&column[at.clone()]));
        let depths = &from.depth[at.clone()];
        let mut lanes: u32 = if rows - first < LANES { (1_u32 << (rows - first)) - 1 } else { 0xff };
        let mut plays = 0;
        for (lane, &depth) in depths.iter().enumerate() {
            plays |= u32::from(depth >= ROULETTE_FROM) << lane;
        }
        plays &= lanes;
        if plays != 0 {
            let bits = |column: &[u32]| <f32x8 as Real>::Bits::from_fn(|lane| column[first + lane]);
            let dimension = dimensions::at::<f32x8>(
                bits(&from.depth) + <f32x8 as Real>::Bits::splat(u32::MAX),
                dimensions::ROULETTE,
            );
            let u: f32x8 = sampler.one(bits(&from.pixel_hash), bits(&from.sample), dimension);
            let limit = f32x8::from_fn(|lane| most_survivors(depths[lane]));
            let q = survival(Real::max(Real::max(r, g), b), eta, limit);
            let player = <f32x8 as Real>::Mask::from_bits(plays);
            let survives = Real::lt(u, q);
            let weight = Real::select(player & survives, f32x8::ONE / q, f32x8::ONE);
            (r * weight).store(&mut from.throughput_r[at.clone()]);
            (g * weight).store(&mut from.throughput_g[at.clone()]);
            (b * weight).store(&mut from.throughput_b[at]);
            lanes &= (survives | !player).bits();
        }
        while lanes != 0 {
            alive.push(first as u32 + lanes.trailing_zeros());
            lanes &= lanes - 1;
        }
    }
    to.append(from, alive);
    from.clear();
    Blocks::of(rows)
}
