//! The perfectly diffuse surface.

use super::hemisphere::{cosine_density, cosine_direction, sin_cos_turn};
use super::{Bsdf, Params, Sampled};
use crate::simd::{Mask, Real, Rgb, V3};

/// c/π exactly: of all parameters only the base colour counts.
#[derive(Clone, Copy, Debug)]
pub struct Lambert;

impl Bsdf for Lambert {
    type Prepared<F: Real> = Rgb<F>;

    const CHOOSES: bool = false;

    #[inline(always)]
    fn prepare<F: Real>(params: &Params<F>, _: V3<F>) -> Rgb<F> {
        params.base_color
    }

    #[inline(always)]
    fn eval<F: Real>(albedo: &Rgb<F>, wi: V3<F>) -> (Rgb<F>, F) {
        let density = cosine_density(wi.z.max(F::zero()));
        (*albedo * density, density)
    }

    #[inline(always)]
    fn sample<F: Real>(albedo: &Rgb<F>, _: F, u: (F, F)) -> Sampled<F> {
        let wi = cosine_direction(sin_cos_turn(u.0), u.1);
        let no = F::Mask::splat(false);
        Sampled {
            wi,
            weight: *albedo,
            pdf: cosine_density(wi.z),
            delta: no,
            transmitted: no,
            valid: F::Mask::splat(true),
            eta_scale: F::one(),
        }
    }

    #[inline(always)]
    fn diffuse_share<F: Real>(_: &Rgb<F>, _: V3<F>) -> Rgb<F> {
        V3::splat(1.0)
    }

    #[inline(always)]
    fn scatters<F: Real>(_: &Rgb<F>) -> F::Mask {
        F::Mask::splat(true)
    }
}
