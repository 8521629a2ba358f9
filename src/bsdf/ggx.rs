//! Trowbridge–Reitz microfacets with height-correlated Smith shadowing (glTF 2.0, appendix B.3).

use crate::simd::{Real, V3};

/// The facets as `wo` sees them.
#[derive(Clone, Copy, Debug)]
pub struct Facets<F: Real> {
    /// GGX width, at least [`super::DELTA_ALPHA`].
    pub alpha: F,
    /// α².
    alpha2: F,
    /// 1 − α².
    rest: F,
    /// Cosine of `wo`.
    pub zo: F,
    /// Length of `wo` stretched to (αx, αy, z): √(α² + (1−α²)z²).
    to: F,
    /// Share of the cap of visible directions below the horizon that is drawn; 1 for all of it.
    bound: F,
    /// `1 / 2(bound·zo + to)`: density of the reflected direction over D.
    scale: F,
}

impl<F: Real> Facets<F> {
    /// For transmission or reflection: every facet that `wo` sees is drawn.
    #[inline(always)]
    pub fn new(alpha: F, wo: V3<F>) -> Self {
        Self::with_bound(alpha, wo, |_| F::one())
    }

    /// For reflection alone: facets that could only reflect below the horizon are mostly left out.
    ///
    /// Eto and Tokuyoshi 2023, "Bounded VNDF Sampling for Smith–GGX Reflections", with both widths equal.
    #[inline(always)]
    pub fn bounded(alpha: F, wo: V3<F>) -> Self {
        Self::with_bound(alpha, wo, |alpha2| {
            let s2 = (F::one() + wo.x.mul_add(wo.x, wo.y.sqr()).sqrt()).sqr();
            (F::one() - alpha2) * s2 / alpha2.mul_add(wo.z.sqr(), s2)
        })
    }

    #[inline(always)]
    fn with_bound(alpha: F, wo: V3<F>, bound: impl Fn(F) -> F) -> Self {
        let alpha = alpha.max(F::splat(super::DELTA_ALPHA));
        let alpha2 = alpha.sqr();
        let rest = F::one() - alpha2;
        let zo = wo.z;
        let to = rest.mul_add(zo.sqr(), alpha2).sqrt();
        let bound = bound(alpha2);
        let scale = F::splat(0.5) / bound.mul_add(zo, to);
        Self { alpha, alpha2, rest, zo, to, bound, scale }
    }

    /// D at a half vector of any length: from `h.x² + h.y²` and `|h|²`, which loses nothing for small α.
    #[inline(always)]
    pub fn d(&self, sin2: F, length2: F) -> F {
        let length2 = length2.max(F::splat(1e-20));
        let q = self.alpha * length2 / self.alpha2.mul_add(length2, self.rest * sin2);
        q.sqr() * F::splat(std::f32::consts::FRAC_1_PI)
    }

    /// V·zi, zi ≥ 0 the cosine of `wi`.
    #[inline(always)]
    pub fn v_cos(&self, zi: F) -> F {
        let ti = self.rest.mul_add(zi.sqr(), self.alpha2).sqrt();
        F::splat(0.5) * zi / self.zo.mul_add(ti, zi * self.to).max(F::splat(1e-36))
    }

    /// Density over D of the direction that a facet drawn by [`Facets::sample`] reflects to.
    ///
    /// The density of the facet itself is 4 wo·h as large.
    #[inline(always)]
    pub fn density(&self) -> F {
        self.scale
    }

    /// Draws a facet that `wo` sees, above the surface and of unit length.
    ///
    /// Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps".
    #[inline(always)]
    pub fn sample(&self, wo: V3<F>, (sin_phi, cos_phi): (F, F), u: F) -> V3<F> {
        let one = F::one();
        let inverse = one / self.to;
        let stretched = V3::new(self.alpha * wo.x * inverse, self.alpha * wo.y * inverse, wo.z * inverse);
        let b = self.bound * stretched.z;
        let down = u * (one + b);
        // z = 1 − down; sin² = (1 − z)(1 + z) keeps what 1 − z² would lose at the cap's pole.
        let sin = (down * (one - down + one)).safe_sqrt();
        let x = sin.mul_add(cos_phi, stretched.x);
        let y = sin.mul_add(sin_phi, stretched.y);
        let z = (one - down + stretched.z).max(F::splat(1e-7));
        V3::new(self.alpha * x, self.alpha * y, z).normalize()
    }
}
