//! Metal, and diffuse under a dielectric coat.

use super::fresnel::{dielectric_f0, schlick_weight};
use super::ggx::Facets;
use super::hemisphere::{cosine_density, cosine_direction, sin_cos_turn};
use super::{Bsdf, DELTA_ALPHA, Params, Sampled, diffuse_probability, ratio, share};
use crate::simd::{Mask, Real, Rgb, V3};

/// glTF's metallic-roughness surface without transmission.
#[derive(Clone, Copy, Debug)]
pub struct Opaque;

/// The diffuse part and the Schlick reflectance, both linear in w = (1 − |wo·h|)⁵.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mix<F: Real> {
    /// (1−m)(1−t)c.
    pub diffuse: Rgb<F>,
    /// kd at w = 0.
    kd: F,
    /// Fall of kd with w.
    kd_fall: F,
    /// Reflectance at w = 0.
    f0: Rgb<F>,
    /// Rise of reflectance with w.
    rise: Rgb<F>,
}

impl<F: Real> Mix<F> {
    /// `opaque` is the share 1−t of the dielectric that is not glass.
    #[inline(always)]
    pub fn new(params: &Params<F>, opaque: F) -> Self {
        let one = F::one();
        let (m, s, c) = (params.metallic, params.specular, params.base_color);
        let f0d = dielectric_f0(params.ior, params.specular_color);
        let f0_max = f0d.max_element();
        let dielectric = (one - m) * opaque;
        let coat = dielectric * s;
        Self {
            diffuse: c * dielectric,
            kd: (-s).mul_add(f0_max, one),
            kd_fall: s * (one - f0_max),
            f0: f0d.zip(c, |f, c| coat.mul_add(f, m * c)),
            rise: f0d.zip(c, |f, c| coat.mul_add(one - f, m * (one - c))),
        }
    }

    /// Of the diffuse part, what the coat lets through.
    #[inline(always)]
    pub fn kd(&self, w: F) -> F {
        (-self.kd_fall).mul_add(w, self.kd).max(F::zero())
    }

    /// Reflectance of facets.
    #[inline(always)]
    pub fn reflectance(&self, w: F) -> Rgb<F> {
        self.rise.scale_add(w, self.f0)
    }

    /// What the diffuse lobe is expected to reflect, and whether it exists.
    #[inline(always)]
    pub fn diffuse_estimate(&self) -> (F, F::Mask) {
        let color = self.diffuse.max_element();
        (color * self.kd, color.gt(F::zero()))
    }

    /// What facets seen at cosine `zo` are expected to reflect.
    ///
    /// Rough ones are met at steeper angles than the surface is, so Schlick's rise counts less. 0.8 is near the least variance of
    /// weights over roughness and angle; nearer to 1 gains a little and doubles the largest weight.
    #[inline(always)]
    pub fn specular_estimate(&self, zo: F, alpha: F) -> F {
        let w = schlick_weight(zo) * F::splat(-0.8).mul_add(alpha, F::one());
        self.reflectance(w).max_element()
    }
}

/// See [`Bsdf::Prepared`].
#[derive(Clone, Copy, Debug)]
pub struct Prepared<F: Real> {
    wo: V3<F>,
    mix: Mix<F>,
    facets: Facets<F>,
    p_diffuse: F,
    p_specular: F,
    /// The facets are a mirror.
    mirror: F::Mask,
}

impl Bsdf for Opaque {
    type Prepared<F: Real> = Prepared<F>;

    #[inline(always)]
    fn prepare<F: Real>(params: &Params<F>, wo: V3<F>) -> Prepared<F> {
        let mix = Mix::new(params, F::one());
        let (diffuse, has_diffuse) = mix.diffuse_estimate();
        let has_specular = params.specular.max(params.metallic).gt(F::zero());
        let specular = mix.specular_estimate(wo.z, params.alpha);
        let p_diffuse = diffuse_probability(diffuse, specular, has_diffuse, has_specular);
        Prepared {
            wo,
            mix,
            facets: Facets::bounded(params.alpha, wo),
            p_diffuse,
            p_specular: F::one() - p_diffuse,
            mirror: params.alpha.lt(F::splat(DELTA_ALPHA)),
        }
    }

    #[inline(always)]
    fn eval<F: Real>(prepared: &Prepared<F>, wi: V3<F>) -> (Rgb<F>, F) {
        let Prepared { wo, mix, facets, p_diffuse, p_specular, mirror } = prepared;
        let up = wi.z.gt(F::zero());
        let zi = wi.z.max(F::zero());
        let h = *wo + wi;
        let sin2 = h.x.mul_add(h.x, h.y.sqr());
        let length2 = h.z.mul_add(h.z, sin2);
        // |wo + wi| = 2 wo·h.
        let w = schlick_weight(length2.sqrt() * F::splat(0.5));

        let cosine = cosine_density(zi);
        let d = facets.d(sin2, length2).masked(up & !*mirror);
        let specular = mix.reflectance(w) * (d * facets.v_cos(zi));
        let f = mix.diffuse.scale_add(mix.kd(w) * cosine, specular);
        let pdf = (*p_specular * facets.density()).mul_add(d, *p_diffuse * cosine);
        (f, pdf)
    }

    #[inline(always)]
    fn sample<F: Real>(prepared: &Prepared<F>, u_lobe: F, u: (F, F)) -> Sampled<F> {
        let Prepared { wo, mix, facets, p_diffuse, p_specular, mirror } = prepared;
        let diffuse = u_lobe.lt(*p_diffuse);
        let turn = sin_cos_turn(u.0);
        let mut wi = cosine_direction(turn, u.1);
        if !diffuse.all() {
            let h = facets.sample(*wo, turn, u.1);
            let twice = wo.dot(h);
            let reflected = h.scale_add(twice + twice, -*wo);
            let mirrored = V3::new(-wo.x, -wo.y, wo.z);
            wi = V3::select(diffuse, wi, V3::select(*mirror, mirrored, reflected));
        }
        let (f, pdf) = Self::eval(prepared, wi);
        let (mut weight, mut valid) = ratio(f, pdf);

        let delta = *mirror & !diffuse;
        let mut pdf = pdf;
        if delta.any() {
            // Drawn only where p_specular > 0; elsewhere the quotient is not used.
            let value = mix.reflectance(schlick_weight(wo.z)) / *p_specular;
            weight = V3::select(delta, value, weight);
            pdf = pdf.masked(!delta);
            valid = valid | delta;
        }
        let no = F::Mask::splat(false);
        Sampled { wi, weight, pdf, delta, transmitted: no, valid, eta_scale: F::one() }
    }

    #[inline(always)]
    fn diffuse_share<F: Real>(prepared: &Prepared<F>, wi: V3<F>) -> Rgb<F> {
        let Prepared { wo, mix, .. } = prepared;
        let w = schlick_weight((*wo + wi).length_squared().sqrt() * F::splat(0.5));
        let diffuse = mix.diffuse * (mix.kd(w) * cosine_density(wi.z.max(F::zero())));
        share(diffuse, Self::eval(prepared, wi).0)
    }

    #[inline(always)]
    fn scatters<F: Real>(prepared: &Prepared<F>) -> F::Mask {
        !prepared.mirror | prepared.p_diffuse.gt(F::zero())
    }
}
