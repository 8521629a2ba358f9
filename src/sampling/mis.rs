//! Multiple importance sampling.

use crate::simd::Real;

/// Weight of a sample from the first of two sources, a²/(a² + b²), by the densities of both.
///
/// 0 if the first is 0; 1 if it is infinite and the second is not; no other density overflows. (Veach and Guibas 1995,
/// "Optimally Combining Sampling Techniques for Monte Carlo Rendering", the power heuristic with β = 2.)
#[inline(always)]
pub fn power<F: Real>(a: F, b: F) -> F {
    let most = F::splat(f32::MAX);
    let ratio = b.min(most) / a.min(most);
    (F::one() / ratio.mul_add(ratio, F::one())).masked(a.gt(F::zero()))
}
