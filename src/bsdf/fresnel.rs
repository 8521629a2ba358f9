//! Reflectances.

use crate::simd::{Real, Rgb};

/// Reflectance of the dielectric at normal incidence, before `specular`: `min(((ior−1)/(ior+1))²·color, 1)`.
///
/// An `ior` of 0 gives what an infinite one would.
#[inline(always)]
pub fn dielectric_f0<F: Real>(ior: F, specular_color: Rgb<F>) -> Rgb<F> {
    let r = ((ior - F::one()) / (ior + F::one())).sqr();
    specular_color.map(|c| (r * c).min(F::one()))
}

/// (1 − cos)⁵ (Schlick 1994).
#[inline(always)]
pub fn schlick_weight<F: Real>(cos: F) -> F {
    let x = (F::one() - cos).max(F::zero());
    let x2 = x.sqr();
    x2.sqr() * x
}

/// How an interface of relative index η bends light.
#[derive(Clone, Copy, Debug)]
pub struct Interface<F: Real> {
    /// Index on the far side over index on the side of `wo`.
    pub eta: F,
    /// η² − 1, free of cancellation.
    pub excess: F,
}

/// What happens to light that meets a facet at some cosine.
#[derive(Clone, Copy, Debug)]
pub struct Meeting<F: Real> {
    /// Unpolarised reflectance; 1 under total reflection.
    pub reflectance: F,
    /// `cos θo + η cos θt`: what the direction of refraction divides by.
    pub sum: F,
    /// Total internal reflection.
    pub total: F::Mask,
}

impl<F: Real> Interface<F> {
    /// Between vacuum and a solid of the given index; `leaving` from inside it.
    #[inline(always)]
    pub fn new(ior: F, leaving: F::Mask) -> Self {
        let one = F::one();
        let inverse = one / ior;
        let excess = (ior - one) * (ior + one);
        Self { eta: F::select(leaving, inverse, ior), excess: F::select(leaving, -excess * inverse.sqr(), excess) }
    }

    /// Exact unpolarised Fresnel reflection at `cos` ≥ 0.
    ///
    /// With g = η cos θt = √(η²−1+cos²) the amplitudes are `−(η²−1)/(cos+g)²` and
    /// `(η²−1)((η²+1)cos²−1)/(η²cos+g)²`. The textbook's differences of nearly equal numbers are
    /// gone, so the result has full precision for η as near to 1 as can be told from it, and is 0 at 1.
    #[inline(always)]
    pub fn meet(&self, cos: F) -> Meeting<F> {
        let one = F::one();
        let tiny = F::splat(1e-15);
        let cos2 = cos.sqr();
        let g2 = self.excess + cos2;
        let total = g2.lt(F::zero());
        let g = g2.safe_sqrt();
        let eta2 = self.excess + one;
        let sum = (cos + g).max(tiny);
        let across = self.excess / sum.sqr();
        let along = self.excess * (eta2 + one).mul_add(cos2, -one) / eta2.mul_add(cos, g).max(tiny).sqr();
        let reflectance = (across.sqr() + along.sqr()) * F::splat(0.5);
        Meeting { reflectance: F::select(total, one, reflectance.min(one)), sum, total }
    }
}
