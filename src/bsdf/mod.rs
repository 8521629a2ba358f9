//! Scattering at a surface, for eight lanes or one.
//!
//! In flows what the textures said ([`Params`]) and the direction the path came from; out flow
//! values of the BSDF, its sampling density and new directions. `docs/model.md`, section Scattering,
//! is the specification. Everything happens in the local frame of the shading normal, z up, flipped
//! by the caller to the side of `wo`, so `wo.z > 0` always. Whether a pair of directions is on the
//! right sides of the *geometric* normal is for the caller to check: only it knows that normal.
//!
//! There are three versions, [`Lambert`], [`Opaque`] and [`Transmissive`], each able to do all that
//! the one before it does. A caller is generic over [`Bsdf`] and so compiled once for each.
//!
//! Sampling is a mixture of two lobes: cosine-weighted diffuse, and microfacets visible from `wo`,
//! which then reflect or transmit. All lobes are evaluated together, with the density of the
//! mixture, so no draw weighs much, whichever lobe made it.
//!
//! A lane's bits depend on nothing in the other lanes: branches on [`Mask::any`] skip work, they do
//! not choose between ways of doing it.

mod fresnel;
mod ggx;
mod hemisphere;
mod lambert;
mod opaque;
mod transmissive;

#[cfg(test)]
mod tests;

use crate::simd::{Mask, Real, Rgb, V3};

pub use self::lambert::Lambert;
pub use self::opaque::Opaque;
pub use self::transmissive::Transmissive;

/// GGX widths below this are exactly specular.
pub const DELTA_ALPHA: f32 = 1e-4;

/// What a material and its textures say about one hit.
#[derive(Clone, Copy, Debug)]
pub struct Params<F: Real> {
    /// Albedo of the dielectric, reflectance of the metal at normal incidence; 0 to 1.
    pub base_color: Rgb<F>,
    /// 0 dielectric, 1 metal.
    pub metallic: F,
    /// GGX width, roughness²; 0 to 1. Below [`DELTA_ALPHA`] it is a mirror.
    pub alpha: F,
    /// Strength of dielectric reflection; 0 to 1.
    pub specular: F,
    /// Tint of dielectric reflection at normal incidence; may exceed 1.
    pub specular_color: Rgb<F>,
    /// Index of refraction, at least 1; 0 stands for infinite.
    pub ior: F,
    /// Share of the diffuse part that is let through; 0 to 1.
    pub transmission: F,
    /// The surface bounds a solid; a thin wall otherwise.
    pub solid: F::Mask,
    /// `wo` lies inside the solid: transmitted light leaves it.
    pub inside: F::Mask,
}

impl<F: Real> Params<F> {
    /// Lambertian, whatever the version it is given to.
    #[inline(always)]
    pub fn lambert(base_color: Rgb<F>) -> Self {
        Self {
            base_color,
            metallic: F::zero(),
            alpha: F::one(),
            specular: F::zero(),
            specular_color: V3::splat(1.0),
            ior: F::splat(1.5),
            transmission: F::zero(),
            solid: F::Mask::splat(false),
            inside: F::Mask::splat(false),
        }
    }

    /// Share of light along the normal that is not absorbed: the albedo layer of a picture.
    #[inline(always)]
    pub fn albedo(&self) -> Rgb<F> {
        let one = F::one();
        let f0 = fresnel::dielectric_f0(self.ior, self.specular_color) * self.specular;
        let through = self.base_color * (one - f0.max_element());
        (f0 + through)
            .zip(self.base_color, |dielectric, metal| self.metallic.mul_add(metal - dielectric, dielectric).saturate())
    }
}

/// A direction drawn by [`Bsdf::sample`].
#[derive(Clone, Copy, Debug)]
pub struct Sampled<F: Real> {
    /// The direction, in the local frame; `z < 0` for transmission. Of unit length in every lane.
    pub wi: V3<F>,
    /// f·|cos θi| / pdf over all lobes; for a delta its value over the probability that it was
    /// chosen. 0 where not valid.
    pub weight: Rgb<F>,
    /// Density of the mixture of non-delta lobes at `wi`, per sr; as [`Bsdf::eval`] gives it. 0 for a delta.
    pub pdf: F,
    /// `wi` was drawn from a delta: no light sample competes with it.
    pub delta: F::Mask,
    /// `wi` is on the other side of the surface.
    pub transmitted: F::Mask,
    /// The path can go on.
    pub valid: F::Mask,
    /// η², where light was refracted into or out of a solid; 1 elsewhere. The weight holds 1/η²,
    /// which is no loss: roulette should look at throughput · `eta_scale`.
    pub eta_scale: F,
}

/// A scattering function that can be evaluated and sampled.
pub trait Bsdf: Copy + 'static {
    /// What depends on the parameters and `wo` alone.
    type Prepared<F: Real>: Copy;

    /// [`Bsdf::sample`] reads the number that chooses a lobe.
    const CHOOSES: bool = true;

    /// Does once what [`Bsdf::eval`] and [`Bsdf::sample`] both need. `wo` is of unit length, `wo.z > 0`.
    fn prepare<F: Real>(params: &Params<F>, wo: V3<F>) -> Self::Prepared<F>;

    /// f·|cos θi| and the density per sr with which [`Bsdf::sample`] draws `wi`, deltas left out.
    ///
    /// `wi` is of unit length; `wi.z < 0` asks for transmission.
    fn eval<F: Real>(prepared: &Self::Prepared<F>, wi: V3<F>) -> (Rgb<F>, F);

    /// Draws a direction with three numbers in [0, 1).
    fn sample<F: Real>(prepared: &Self::Prepared<F>, u_lobe: F, u: (F, F)) -> Sampled<F>;

    /// Of [`Bsdf::eval`], the share of the diffuse lobe, channel by channel; 1 where there is nothing to share.
    fn diffuse_share<F: Real>(prepared: &Self::Prepared<F>, wi: V3<F>) -> Rgb<F>;

    /// True where a part is not a delta, so that samples of lights are worth taking.
    fn scatters<F: Real>(prepared: &Self::Prepared<F>) -> F::Mask;
}

/// Probability of the diffuse lobe, from estimates of what each lobe reflects.
///
/// A lobe that exists is never starved, however small its estimate; one that does not is never drawn.
#[inline(always)]
fn diffuse_probability<F: Real>(diffuse: F, specular: F, has_diffuse: F::Mask, has_specular: F::Mask) -> F {
    let sum = (diffuse + specular).max(F::splat(1e-20));
    let both = (diffuse / sum).max(F::splat(0.05)).min(F::splat(0.95));
    let one = F::one().masked(has_diffuse | !has_specular);
    F::select(has_diffuse & has_specular, both, one)
}

/// A part of f over all of it.
#[inline(always)]
fn share<F: Real>(part: Rgb<F>, all: Rgb<F>) -> Rgb<F> {
    part.zip(all, |part, all| {
        let any = all.gt(F::zero());
        F::select(any, (part / F::select(any, all, F::one())).min(F::one()), F::one())
    })
}

/// f·cos over pdf, 0 where nothing was drawn.
#[inline(always)]
fn ratio<F: Real>(f: Rgb<F>, pdf: F) -> (Rgb<F>, F::Mask) {
    let valid = pdf.gt(F::splat(1e-30));
    let scale = (F::one() / F::select(valid, pdf, F::one())).masked(valid);
    (f * scale, valid)
}
