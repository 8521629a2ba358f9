//! Everything, glass included.

use super::fresnel::{Interface, Meeting, schlick_weight};
use super::ggx::Facets;
use super::hemisphere::{cosine_density, cosine_direction, sin_cos_turn};
use super::opaque::Mix;
use super::{Bsdf, DELTA_ALPHA, Params, Sampled, diffuse_probability, ratio, share};
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
    /// The facets are a mirror: reflection is a delta.
    mirror: F::Mask,
    /// Transmission is a delta: of a mirror, or spread over so small an angle that single precision
    /// cannot tell from the directions which facet did it. Such light is drawn like that of other
    /// facets, only nobody is told its density, and it is not shadowed on its way out.
    clear: F::Mask,
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

/// The facet that sends light from `wi` to `wo`, or the other way.
#[derive(Clone, Copy, Debug)]
struct Facet<F: Real> {
    /// `h.x² + h.y²` of the half vector h, of any length.
    sin2: F,
    /// |h|².
    length2: F,
    /// wo·h / |h|.
    cos: F,
    /// Factor of f against reflection.
    f_scale: F,
    /// Factor of the density of directions against reflection.
    pdf_scale: F,
    /// `wo` and `wi` lie on the sides of the facet that they must.
    sides: F::Mask,
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

    /// The facet between two directions (Walter et al. 2007, "Microfacet Models for Refraction through Rough Surfaces", eq. 13, 16).
    ///
    /// A thin wall transmits as if it reflected and `wi` were seen in a mirror.
    #[inline(always)]
    fn facet(&self, wi: V3<F>) -> Facet<F> {
        let (zero, one) = (F::zero(), F::one());
        let down = wi.z.lt(zero);
        let refract = down & self.solid;
        let eta = F::select(refract, self.interface.eta, one);
        let far = V3::new(eta * wi.x, eta * wi.y, F::select(refract, eta * wi.z, wi.z.abs()));
        let h = self.wo + far;
        let sin2 = h.x.mul_add(h.x, h.y.sqr());
        let length2 = h.z.mul_add(h.z, sin2).max(F::splat(1e-20));
        let length = length2.sqrt();
        let mut facet = Facet {
            sin2,
            length2,
            cos: length * F::splat(0.5),
            f_scale: one,
            pdf_scale: one,
            sides: down | wi.z.gt(zero),
        };
        if refract.any() {
            let inverse = one.copysign(h.z) / length;
            let o = self.wo.dot(h) * inverse;
            let i = -(wi.dot(h) * inverse);
            facet.cos = F::select(refract, o.saturate(), facet.cos);
            facet.sides = facet.sides & (o.gt(zero) & i.gt(zero) | !refract);
            facet.refract(refract, i, length2, eta);
        }
        facet
    }

    /// f·|cos θi| and density.
    #[inline(always)]
    fn value(&self, wi: V3<F>, facet: &Facet<F>, share: &Share<F>) -> (Rgb<F>, F) {
        let (zero, one) = (F::zero(), F::one());
        let zi = wi.z.abs();
        let up = wi.z.gt(zero);
        let down = wi.z.lt(zero);
        let p = F::select(down, share.p_transmit, one - share.p_transmit);
        let delta = (down & self.clear) | (up & self.mirror);
        let d = self.facets.d(facet.sin2, facet.length2).masked(facet.sides & !delta);
        let color = V3::select(down, share.transmitted, share.reflected);
        let specular = color * (d * self.facets.v_cos(zi) * facet.f_scale);
        let cosine = cosine_density(zi).masked(up);
        let f = self.mix.diffuse.scale_add(self.mix.kd(schlick_weight(facet.cos)) * cosine, specular);
        let drawn = self.p_specular * self.facets.density() * facet.pdf_scale * p;
        (f, drawn.mul_add(d, self.p_diffuse * cosine))
    }
}

impl<F: Real> Facet<F> {
    /// Sets the scales for refraction; `i` is the cosine of `wi`, `length2` = |wo + η wi|².
    #[inline(always)]
    fn refract(&mut self, where_: F::Mask, i: F, length2: F, eta: F) {
        let scale = F::splat(4.0) * self.cos * i / length2;
        self.f_scale = F::select(where_, scale, self.f_scale);
        self.pdf_scale = F::select(where_, scale * eta.sqr(), self.pdf_scale);
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
        let through = (params.base_color * glass).masked(!(infinite & solid));

        let (diffuse, has_diffuse) = mix.diffuse_estimate();
        let has_specular = specular.max(metallic).max(glass).gt(zero);
        let specular_estimate = mix.specular_estimate(wo.z, alpha) + through.max_element();
        let p_diffuse = diffuse_probability(diffuse, specular_estimate, has_diffuse, has_specular);
        Prepared {
            wo,
            mix,
            facets: Facets::new(alpha, wo),
            p_diffuse,
            p_specular: one - p_diffuse,
            interface: Interface::new(ior, solid & params.inside),
            tint: params.specular_color * specular,
            glass,
            through,
            infinite,
            solid,
            mirror,
            clear: mirror | solid & narrow,
        }
    }

    #[inline(always)]
    fn eval<F: Real>(prepared: &Prepared<F>, wi: V3<F>) -> (Rgb<F>, F) {
        let facet = prepared.facet(wi);
        prepared.value(wi, &facet, &prepared.share(facet.cos))
    }

    #[inline(always)]
    fn sample<F: Real>(prepared: &Prepared<F>, u_lobe: F, u: (F, F)) -> Sampled<F> {
        let Prepared { wo, facets, p_diffuse, p_specular, interface, solid, mirror, clear, .. } = prepared;
        let (zero, one) = (F::zero(), F::one());
        let n = V3::new(zero, zero, one);
        let diffuse = u_lobe.lt(*p_diffuse);
        let turn = sin_cos_turn(u.0);

        let h = V3::select(*mirror, n, facets.sample(*wo, turn, u.1));
        let cos = wo.dot(h);
        let mut share = prepared.share(cos);
        // What choosing the lobe left of its number chooses again.
        let u_again = (u_lobe - *p_diffuse) / (*p_specular).max(F::splat(1e-30));
        // Rounding must not reach 1, where what has no probability would be chosen.
        let u_again = u_again.min(F::splat(1.0 - f32::EPSILON));
        let transmit = u_again.lt(share.p_transmit) & !diffuse;
        // Where rounding has turned the facet away, which it can do at the rim of what is visible, nothing is drawn.
        let seen = diffuse | cos.gt(zero);
        let refract = transmit & *solid & seen;

        let reflected = h.scale_add(cos + cos, -*wo);
        let straight = V3::new(reflected.x, reflected.y, -reflected.z);
        let mut wi = V3::select(transmit, straight, reflected);
        let mut facet = Facet {
            sin2: h.x.mul_add(h.x, h.y.sqr()),
            length2: one,
            cos: cos.saturate(),
            f_scale: one,
            pdf_scale: one,
            sides: seen,
        };
        if refract.any() {
            // wo + η wi = −bend·h.
            let bend = interface.excess / share.sum;
            let inverse = one / interface.eta;
            wi = V3::select(refract, (h * -bend - *wo) * inverse, wi);
            facet.refract(refract, (share.sum - cos) * inverse, bend.sqr().max(F::splat(1e-20)), interface.eta);
        }
        if diffuse.any() {
            let scattered = cosine_direction(turn, u.1);
            let between = prepared.facet(scattered);
            let theirs = prepared.share(between.cos);
            wi = V3::select(diffuse, scattered, wi);
            share = Share::select(diffuse, &theirs, &share);
            facet = Facet::select(diffuse, &between, &facet);
        }

        let (f, pdf) = prepared.value(wi, &facet, &share);
        let right_side = F::select(transmit, -wi.z, wi.z).gt(zero) & seen;
        let (weight, valid) = ratio(f, pdf);
        let (mut weight, mut valid) = (weight.masked(right_side), valid & right_side);
        let mut pdf = pdf.masked(right_side);
        let eta_scale = F::select(refract, interface.eta.sqr(), one);

        let delta = (transmit & *clear) | (!transmit & *mirror & !diffuse);
        if delta.any() {
            let p = *p_specular * F::select(transmit, share.p_transmit, one - share.p_transmit);
            let value = V3::select(transmit, share.transmitted, share.reflected);
            let value = value * (one / (p * eta_scale).max(F::splat(1e-30)));
            weight = V3::select(delta, value.masked(right_side), weight);
            pdf = pdf.masked(!delta);
            valid = (valid & !delta) | (delta & right_side);
        }
        Sampled { wi, weight, pdf, delta, transmitted: transmit, valid, eta_scale }
    }

    #[inline(always)]
    fn diffuse_share<F: Real>(prepared: &Prepared<F>, wi: V3<F>) -> Rgb<F> {
        let Prepared { mix, .. } = prepared;
        let facet = prepared.facet(wi);
        let cosine = cosine_density(wi.z.abs()).masked(wi.z.gt(F::zero()));
        let diffuse = mix.diffuse * (mix.kd(schlick_weight(facet.cos)) * cosine);
        share(diffuse, prepared.value(wi, &facet, &prepared.share(facet.cos)).0)
    }

    #[inline(always)]
    fn scatters<F: Real>(prepared: &Prepared<F>) -> F::Mask {
        !prepared.mirror | prepared.p_diffuse.gt(F::zero())
    }
}

impl Transmissive {
    /// The lobes without width, mirror and clear glass, each whole: the weight is its value alone, as nothing has been drawn.
    #[inline(always)]
    pub fn deltas<F: Real>(prepared: &Prepared<F>) -> [Sampled<F>; 2] {
        let Prepared { wo, interface, solid, mirror, .. } = prepared;
        let (zero, one, cos) = (F::zero(), F::one(), prepared.wo.z);
        let share = prepared.share(cos);
        let refract = *solid;
        let inverse = one / interface.eta;
        // As a facet along the normal: wo + η wi = −bend·n.
        let bend = interface.excess / share.sum;
        let n = V3::new(zero, zero, one);
        let straight = -*wo;
        let wi = V3::select(refract, (n * -bend - *wo) * inverse, straight);
        let eta_scale = F::select(refract, interface.eta.sqr(), one);
        let lobe = |wi, weight: Rgb<F>, transmitted, valid: F::Mask, eta_scale| Sampled {
            wi,
            weight: weight.masked(valid),
            pdf: zero,
            delta: valid,
            transmitted: F::Mask::splat(transmitted),
            valid,
            eta_scale,
        };
        let reflects = *mirror & share.reflected.max_element().gt(zero);
        let transmits = *mirror & share.transmitted.max_element().gt(zero) & wi.z.lt(zero);
        let through = share.transmitted * (one / eta_scale);
        [
            lobe(V3::new(-wo.x, -wo.y, wo.z), share.reflected, false, reflects, one),
            lobe(wi, through, true, transmits, eta_scale),
        ]
    }
}

impl<F: Real> Share<F> {
    /// `yes` where `mask` holds, `no` elsewhere.
    #[inline(always)]
    fn select(mask: F::Mask, yes: &Self, no: &Self) -> Self {
        Self {
            reflected: V3::select(mask, yes.reflected, no.reflected),
            transmitted: V3::select(mask, yes.transmitted, no.transmitted),
            p_transmit: F::select(mask, yes.p_transmit, no.p_transmit),
            sum: F::select(mask, yes.sum, no.sum),
        }
    }
}

impl<F: Real> Facet<F> {
    /// The facet of a diffuse draw, which reflects, where `mask` holds; `no` elsewhere.
    #[inline(always)]
    fn select(mask: F::Mask, yes: &Self, no: &Self) -> Self {
        let one = F::one();
        Self {
            sin2: F::select(mask, yes.sin2, no.sin2),
            length2: F::select(mask, yes.length2, no.length2),
            cos: F::select(mask, yes.cos, no.cos),
            f_scale: F::select(mask, one, no.f_scale),
            pdf_scale: F::select(mask, one, no.pdf_scale),
            sides: (mask & yes.sides) | (!mask & no.sides),
        }
    }
}
