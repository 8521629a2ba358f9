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

#[cfg(test)]
mod tests {
    use wide::f32x8;

    use super::*;

    #[test]
    fn weights_of_two_sources_add_up_to_one() {
        let densities = [f32::MIN_POSITIVE, 1e-30, 1e-12, 0.3, 1.0, 7.5, 1e12, 1e30, f32::MAX];
        for a in densities {
            for b in densities {
                let (first, second) = (power(a, b), power(b, a));
                assert!((first + second - 1.0).abs() < 3e-7, "{a} {b}: {first} + {second}");
                let ratio = f64::from(b) / f64::from(a);
                assert!((f64::from(first) - 1.0 / (1.0 + ratio * ratio)).abs() < 3e-7, "{a} {b}: {first}");
            }
        }
    }

    #[test]
    fn weights_at_the_ends_are_finite() {
        let infinity = f32::INFINITY;
        let cases = [
            (0.0, 0.0, 0.0),
            (0.0, 1.0, 0.0),
            (1.0, 0.0, 1.0),
            (infinity, 1.0, 1.0),
            (1.0, infinity, 0.0),
            (infinity, infinity, 0.5),
            (0.0, infinity, 0.0),
            (infinity, 0.0, 1.0),
        ];
        for (a, b, want) in cases {
            assert_eq!(power(a, b), want, "{a} {b}");
        }
        let lanes = power(f32x8::new(cases.map(|c| c.0)), f32x8::new(cases.map(|c| c.1)));
        assert_eq!(lanes.to_array(), cases.map(|c| c.2));
    }
}
