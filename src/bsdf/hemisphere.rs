//! Turns and cosine-weighted directions.

use crate::{
    sampling::warp::sin_cos_twice,
    simd::{Real, V3},
};

/// Sine and cosine of 2πu, u in [0, 1], within 3 ulp of one.
///
/// The same bits from every [`Real`].
#[inline(always)]
pub fn sin_cos_turn<F: Real>(u: F) -> (F, F) {
    // Half a turn is taken away, so both signs are turned.
    let (sin, cos) = sin_cos_twice((u - F::splat(0.5)) * F::splat(std::f32::consts::PI));
    (-sin, -cos)
}

/// A direction above the surface with density cos θ/π.
#[inline(always)]
pub fn cosine_direction<F: Real>((sin_phi, cos_phi): (F, F), u: F) -> V3<F> {
    let r = u.sqrt();
    // 1 − u is exact and at least 2⁻²⁴.
    V3::new(r * cos_phi, r * sin_phi, (F::one() - u).safe_sqrt())
}

/// Density of [`cosine_direction`] at cosine `z` ≥ 0.
#[inline(always)]
pub fn cosine_density<F: Real>(z: F) -> F {
    z * F::splat(std::f32::consts::FRAC_1_PI)
}
