//! Turns and cosine-weighted directions.

use crate::simd::{Real, V3};

/// Sine and cosine of 2πu, u in [0, 1], within 3 ulp of one.
///
/// By half the angle in ±π/2, where two short polynomials do; the same bits from every [`Real`].
#[inline(always)]
pub fn sin_cos_turn<F: Real>(u: F) -> (F, F) {
    let x = (u - F::splat(0.5)) * F::splat(std::f32::consts::PI);
    let x2 = x.sqr();
    let poly = |coefficients: &[f32]| {
        let (first, rest) = coefficients.split_first().expect("the tables below are not empty");
        rest.iter().fold(F::splat(*first), |sum, &c| sum.mul_add(x2, F::splat(c)))
    };
    // Taylor's; the first terms left out are below 1e-9 and 1e-8 at π/2.
    let sin = x * poly(&[
        1.0 / 6_227_020_800.0,
        -1.0 / 39_916_800.0,
        1.0 / 362_880.0,
        -1.0 / 5040.0,
        1.0 / 120.0,
        -1.0 / 6.0,
        1.0,
    ]);
    let cos = poly(&[1.0 / 479_001_600.0, -1.0 / 3_628_800.0, 1.0 / 40320.0, -1.0 / 720.0, 1.0 / 24.0, -0.5, 1.0]);
    // Half a turn was taken away, so both signs are turned.
    let twice = sin + sin;
    (-(twice * cos), twice.mul_add(sin, -F::one()))
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
