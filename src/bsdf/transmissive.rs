//! Everything, glass included.

use super::fresnel::{Interface, Meeting, schlick_weight};
use super::ggx::Facets;
use super::hemisphere::{cosine_density, cosine_direction, sin_cos_turn};
use super::opaque::Mix;
use super::{Bsdf, DELTA_ALPHA, Params, Sampled, diffuse_probability, ratio};
use crate::simd::{Mask, Real, Rgb, V3};

/// glTF's metallic-roughness surface with transmission, as a thin wall or as the boundary of a solid.
///
/// One draw of a facet serves metal, coat and glass; the facet then reflects or transmits with
/// probabilities in the proportion of what it reflects and transmits.
#[derive(Clone, Copy, Debug)]
pub struct Transmissive;

/// See [`Bsdf::Prepared`].
#[derive(Clone, Copy, Debug)]
pub struct Prepared<F: Real> {
    wo: V3<F>,
    mix: Mix<F>,
    facets: Facets<F>,
    p_diffuse: F,
    p_specular: F,
    interface: Interface<F>,
    /// s·specular_color.
    tint: Rgb<F>,
    /// (1−m)t.
    glass: F,
    /// (1−m)t·c, 0 where nothing can pass.
    through: Rgb<F>,
    infinite: F::Mask,
    solid: F::Mask,
    /// Reflection is a delta.
    mirror: F::Mask,
    /// Transmission is a delta.
    clear: F::Mask,
    /// What the surface as a whole does: the deltas' values.
    flat: Share<F>,
}

/// What facets met at one cosine do with light.
#[derive(Clone, Copy, Debug)]
struct Share<F: Real> {
    reflected: Rgb<F>,
    transmitted: Rgb<F>,
    /// Probability that sampling transmits.
    p_transmit: F,
    /// See [`Meeting::sum`].
    sum: F,
}

impl<F: Real> Prepared<F> {
    #[inline(always)]
    fn share(&self, cos: F) -> Share<F> {
        let one = F::one();
        let Meeting { reflectance, sum, total } = self.interface.meet(cos);
        let reflectance = F::select(self.infinite, one, reflectance);
        let r = V3::select(total, V3::splat(1.0), self.tint.map(|tint| (tint * reflectance).min(one)));
        let reflected = r.scale_add(self.glass, self.mix.reflectance(schlick_weight(cos)));
        let transmitted = self.through * (one - r.max_element());
        let (back, on) = (reflected.max_element(), transmitted.max_element());
        let p_transmit = on / (back + on).max(F::splat(1e-30));
        Share { reflected, transmitted, p_transmit, sum }
    }
}

impl Bsdf for Transmissive {
    type Prepared<F: Real> = Prepared<F>;

    #[inline(always)]
    fn prepare<F: Real>(params: &Params<F>, wo: V3<F>) -> Prepared<F> {
        let (zero, one) = (F::zero(), F::one());
        let Params { metallic, alpha, specular, transmission, solid, .. } = *params;
        let mix = Mix::new(params, one - transmission);
        let infinite = params.ior.le(zero);
        let ior = F::select(infinite, one, params.ior);
        let glass = (one - metallic) * transmission;
        let mirror = alpha.lt(F::splat(DELTA_ALPHA));
        let narrow = (alpha * (params.ior - one).abs()).lt(F::splat(DELTA_ALPHA));
        let mut prepared = Prepared {
            wo,
            mix,
            facets: Facets::new(alpha, wo),
            p_diffuse: zero,
            p_specular: one,
            interface: Interface::new(ior, solid & params.inside),
            tint: params.specular_color * specular,
            glass,
            through: (params.base_color * glass).masked(!(infinite & solid)),
            infinite,
            solid,
            mirror,
            clear: mirror | solid & narrow,
            flat: Share { reflected: V3::splat(0.0), transmitted: V3::splat(0.0), p_transmit: zero, sum: one },
        };
        prepared.flat = prepared.share(wo.z);

        let (diffuse, has_diffuse) = mix.diffuse_estimate();
        let has_specular = specular.max(metallic).max(glass).gt(zero);
        let Share { transmitted, reflected, .. } = prepared.flat;
        let estimate = mix.specular_estimate(wo.z, alpha) + transmitted.max_element() + glass * reflected.max_element();
        prepared.p_diffuse = diffuse_probability(diffuse, estimate, has_diffuse, has_specular);
        prepared.p_specular = one - prepared.p_diffuse;
        prepared
    }

    #[inline(always)]
    fn eval<F: Real>(prepared: &Prepared<F>, wi: V3<F>) -> (Rgb<F>, F) {
        let Prepared { wo, mix, facets, p_diffuse, p_specular, interface, .. } = prepared;
        let (zero, one) = (F::zero(), F::one());
        let zi = wi.z.abs();
        let up = wi.z.gt(zero);
        let down = wi.z.lt(zero);
        let refract = down & prepared.solid;

        // Reflection, and the thin wall, where transmission is reflection seen in a mirror.
        let eta = F::select(refract, interface.eta, one);
        let far = V3::new(eta * wi.x, eta * wi.y, F::select(refract, eta * wi.z, zi));
        let h = *wo + far;
        let sin2 = h.x.mul_add(h.x, h.y.sqr());
        let length2 = h.z.mul_add(h.z, sin2).max(F::splat(1e-20));
        let length = length2.sqrt();
        let mut cos = length * F::splat(0.5);
        // How f and the density of a drawn facet carry over to directions, against reflection.
        let (mut f_scale, mut pdf_scale) = (one, one);
        let mut sides = up | down;
        if refract.any() {
            let inverse = one.copysign(h.z) / length;
            let o = wo.dot(h) * inverse;
            let i = -(wi.dot(h) * inverse);
            let facing = o.gt(zero) & i.gt(zero);
            let scale = F::splat(4.0) * o * i / length2;
            cos = F::select(refract, o.saturate(), cos);
            f_scale = F::select(refract, scale, one);
            pdf_scale = F::select(refract, scale * eta.sqr(), one);
            sides = sides & (facing | !refract);
        }

        let Share { reflected, transmitted, p_transmit, .. } = prepared.share(cos);
        let p_transmit = F::select(prepared.clear, prepared.flat.p_transmit, p_transmit);
        let p = F::select(down, p_transmit, one - p_transmit);
        let delta = (down & prepared.clear) | (up & prepared.mirror);
        let d = facets.d(sin2, length2).masked(sides & !delta);
        let specular = V3::select(down, transmitted, reflected) * (d * facets.v_cos(zi) * f_scale);
        let cosine = cosine_density(zi).masked(up);
        let f = mix.diffuse.scale_add(mix.kd(schlick_weight(cos)) * cosine, specular);
        let pdf = (*p_specular * facets.density() * pdf_scale * p).mul_add(d, *p_diffuse * cosine);
        (f, pdf)
    }

    #[inline(always)]
    fn sample<F: Real>(prepared: &Prepared<F>, u_lobe: F, u: (F, F)) -> Sampled<F> {
        let Prepared { wo, facets, p_diffuse, p_specular, interface, solid, mirror, clear, flat, .. } = prepared;
        let (zero, one) = (F::zero(), F::one());
        let n = V3::new(zero, zero, one);
        let diffuse = u_lobe.lt(*p_diffuse);
        let turn = sin_cos_turn(u.0);
        let scattered = cosine_direction(turn, u.1);

        let h = V3::select(*mirror, n, facets.sample(*wo, turn, u.1));
        let cos = wo.dot(h);
        let share = prepared.share(cos);
        let p_transmit = F::select(*clear, flat.p_transmit, share.p_transmit);
        // What choosing the lobe left of its number chooses again.
        let u_again = (u_lobe - *p_diffuse) / (*p_specular).max(F::splat(1e-30));
        // Rounding must not reach 1, where what has no probability would be chosen.
        let u_again = u_again.min(F::splat(1.0 - f32::EPSILON));
        let transmit = u_again.lt(p_transmit) & !diffuse;

        let reflected = h.scale_add(cos + cos, -*wo);
        let straight = V3::new(reflected.x, reflected.y, -reflected.z);
        let mut wi = V3::select(transmit, straight, reflected);
        let refract = transmit & *solid;
        if refract.any() {
            let h = V3::select(*clear, n, h);
            let sum = F::select(*clear, flat.sum, share.sum);
            let refracted = (h * (-interface.excess / sum) - *wo) * (one / interface.eta);
            wi = V3::select(refract, refracted, wi);
        }
        wi = V3::select(diffuse, scattered, wi);

        let (f, pdf) = Self::eval(prepared, wi);
        let right_side = F::select(transmit, -wi.z, wi.z).gt(zero);
        let (weight, valid) = ratio(f, pdf);
        let (mut weight, mut valid) = (weight.masked(right_side), valid & right_side);
        let eta_scale = F::select(refract, interface.eta.sqr(), one);

        let delta = (transmit & *clear) | (!transmit & *mirror & !diffuse);
        let mut pdf = pdf;
        if delta.any() {
            let p = *p_specular * F::select(transmit, flat.p_transmit, one - flat.p_transmit);
            let value = V3::select(transmit, flat.transmitted, flat.reflected);
            let value = value * (one / (p * eta_scale).max(F::splat(1e-30)));
            weight = V3::select(delta, value.masked(right_side), weight);
            pdf = pdf.masked(!delta);
            valid = (valid & !delta) | (delta & right_side);
        }
        Sampled { wi, weight, pdf, delta, transmitted: transmit, valid, eta_scale }
    }

    #[inline(always)]
    fn scatters<F: Real>(prepared: &Prepared<F>) -> F::Mask {
        let passes = prepared.flat.p_transmit.gt(F::zero());
        !prepared.mirror | (!prepared.clear & passes) | prepared.p_diffuse.gt(F::zero())
    }
}
