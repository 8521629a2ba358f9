//! Chooses among several light samples the one that is worth a shadow ray.
//!
//! Lights are chosen and drawn from without the BSDF. Where that is narrow, most samples bring next to nothing; so at the surface that
//! the camera sees several are drawn, and one is kept with a probability by what it would bring, weighted with their mean over its own
//! (Talbot, Cline, Egbert 2005, "Importance Resampling for Global Illumination"). Weights against BSDF sampling are part of what
//! samples bring, so any that sum to one will do: these take a candidate for a sample.

use super::{
    Settings, dimensions,
    direct::{self, LightSample},
    surface::Surface,
};
use crate::{
    bsdf::Bsdf,
    flat::FlatScene,
    sampling::{Sampler, mis},
    simd::{Bits, Mask, Real, Rgb, V3},
};

/// Candidates for a shadow ray at glossy surfaces.
const CANDIDATES: u32 = 4;

/// A light sample with what the surface makes of it.
#[derive(Clone, Copy, Debug)]
pub struct Candidate<F: Real> {
    /// The sample.
    pub light: LightSample<F>,
    /// f·cos towards it.
    pub f: Rgb<F>,
    /// Density with which the BSDF draws it, 1/sr.
    pub pdf: F,
    /// What it brings to the pixel if nothing is in the way, nit.
    pub carried: Rgb<F>,
    /// It is below the surface.
    pub below: F::Mask,
    /// It can be reached from there.
    pub reached: F::Mask,
}

/// What candidates are drawn for.
pub struct Place<'a, F: Real, B: Bsdf> {
    /// The scene.
    pub scene: &'a FlatScene,
    /// Its settings.
    pub settings: &'a Settings,
    /// Source of numbers.
    pub sampler: &'a Sampler,
    /// The surfaces.
    pub surface: &'a Surface<F>,
    /// Their scattering.
    pub prepared: &'a B::Prepared<F>,
    /// Share of what they scatter that reaches the pixel.
    pub throughput: Rgb<F>,
    /// Light passes some of them.
    pub transmissive: bool,
    /// As in the path queue.
    pub pixel_hash: F::Bits,
    /// As in the path queue.
    pub index: F::Bits,
    /// As in the path queue.
    pub depth: F::Bits,
}

impl<F: Real, B: Bsdf> Place<'_, F, B> {
    /// The candidate of the lanes `lit`, with what was drawn to choose it.
    #[inline(always)]
    pub fn candidate(&self, lit: F::Mask, u_choice: F, u: (F, F), lookups: &mut [u64; 2]) -> Candidate<F> {
        let &Self { scene, settings, surface, transmissive, .. } = self;
        let light = direct::sample(scene, settings, surface, lit.bits(), transmissive, u_choice, u, lookups);
        let wi = surface.frame.to_local(light.wi);
        let (above, below) = surface.sides(light.wi, wi);
        let sides = if transmissive { (above & light.up) | (below & !light.up) } else { above };
        let reached = lit & light.valid & sides;
        if !reached.any() {
            let none = V3::splat(0.0);
            return Candidate { light, f: none, pdf: F::zero(), carried: none, below, reached };
        }
        let (f, pdf) = B::eval(self.prepared, wi);
        let weight = F::select(light.pdf.gt(F::zero()), mis::power(light.pdf, pdf), F::one());
        let carried = (self.throughput * f * light.light * weight).masked(reached);
        Candidate { light, f, pdf, carried, below, reached }
    }

    /// One of [`CANDIDATES`] in the lanes `many`, and one that stands alone in the others of `lit`.
    #[inline(always)]
    pub fn best(&self, lit: F::Mask, many: F::Mask, lookups: &mut [u64; 2]) -> Candidate<F> {
        let pair =
            |index, decision| self.sampler.pair::<F>(self.pixel_hash, index, dimensions::at::<F>(self.depth, decision));
        let drawn = |index| (pair(index, dimensions::CHOICE).0, pair(index, dimensions::LIGHT));
        // Together as evenly spread as so many samples.
        let part = |number| {
            let part = self.sampler.part(self.index, CANDIDATES, number);
            let many = many.bits();
            F::Bits::from_fn(|lane| if many >> lane & 1 == 1 { part.lane(lane) } else { self.index.lane(lane) })
        };
        let (u_choice, u) = drawn(part(0));
        let mut chosen = self.candidate(lit, u_choice, u, lookups);
        let mut u_keep: F = pair(self.index, dimensions::ROULETTE).1;
        let mut worth = chosen.carried.max_element();
        let mut sum = worth;
        for number in 1..CANDIDATES {
            let (u_choice, u) = drawn(part(number));
            let other = self.candidate(many, u_choice, u, lookups);
            let others = other.carried.max_element().masked(many);
            sum = sum + others;
            let share = others / F::select(sum.gt(F::zero()), sum, F::one());
            let takes = u_keep.lt(share) & others.gt(F::zero());
            // What chose once is as good as new on its side of the share.
            let rest = F::select(takes, share, F::one() - share).max(F::splat(f32::MIN_POSITIVE));
            u_keep = (F::select(takes, u_keep, u_keep - share) / rest)
                .max(F::zero())
                .min(F::splat(1.0 - f32::EPSILON / 2.0));
            worth = F::select(takes, others, worth);
            chosen = Candidate::select(takes, &other, &chosen);
        }
        let scale = sum / (worth.max(F::splat(f32::MIN_POSITIVE)) * F::splat(CANDIDATES as f32));
        chosen.carried = V3::select(many & worth.gt(F::zero()), chosen.carried * scale, chosen.carried);
        chosen
    }
}

impl<F: Real> Candidate<F> {
    #[inline(always)]
    fn select(first: F::Mask, a: &Self, b: &Self) -> Self {
        let number = |a: F, b: F| F::select(first, a, b);
        let vector = |a: V3<F>, b: V3<F>| V3::select(first, a, b);
        let mask = |a: F::Mask, b: F::Mask| (a & first) | (b & !first);
        let (l, m) = (&a.light, &b.light);
        Self {
            light: LightSample {
                origin: vector(l.origin, m.origin),
                up: mask(l.up, m.up),
                wi: vector(l.wi, m.wi),
                target: vector(l.target, m.target),
                near: mask(l.near, m.near),
                light: vector(l.light, m.light),
                pdf: number(l.pdf, m.pdf),
                valid: mask(l.valid, m.valid),
                sky: l.sky & first.bits() | m.sky & !first.bits(),
                rows: std::array::from_fn(
                    |lane| if first.bits() >> lane & 1 == 1 { l.rows[lane] } else { m.rows[lane] },
                ),
            },
            f: vector(a.f, b.f),
            pdf: number(a.pdf, b.pdf),
            carried: vector(a.carried, b.carried),
            below: mask(a.below, b.below),
            reached: mask(a.reached, b.reached),
        }
    }
}
