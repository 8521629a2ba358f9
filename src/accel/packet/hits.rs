//! What eight rays that run side by side have hit.

use wide::{f32x8, u32x8};

use super::super::{
    leaf::Met,
    two_level::{Hit, NO_HIT},
};
use crate::{flat::NONE, simd::LANES};

/// End of a ray that has hit something, where it does not matter what: before its start, so that it meets no more.
pub const STOPPED: f32 = -1.0;

/// What eight rays have hit, and where they end: at the hit if there is one.
#[derive(Clone, Copy, Debug)]
pub struct Hits {
    pub t_max: f32x8,
    b1: f32x8,
    b2: f32x8,
    back: f32x8,
    instance: u32x8,
    triangle: u32x8,
}

impl Hits {
    /// Of rays that end there.
    pub fn none(t_max: f32x8) -> Self {
        let (zero, none) = (f32x8::ZERO, u32x8::splat(NONE));
        Self { t_max, b1: zero, b2: zero, back: zero, instance: none, triangle: none }
    }

    /// Of rays that end there, with what each has hit.
    pub fn of(t_max: [f32; LANES], hits: &[Hit; LANES]) -> Self {
        let column = |f: fn(&Hit) -> f32| f32x8::new(hits.each_ref().map(f));
        let row = |f: fn(&Hit) -> u32| u32x8::new(hits.each_ref().map(f));
        Self {
            t_max: f32x8::new(t_max),
            b1: column(|hit| hit.b1),
            b2: column(|hit| hit.b2),
            back: column(|hit| if hit.back { f32::from_bits(u32::MAX) } else { 0.0 }),
            instance: row(|hit| hit.instance),
            triangle: row(|hit| hit.triangle),
        }
    }

    /// Takes what rays have met of a triangle, given the rows of instance and triangle that it goes by outside. True if there
    /// is any.
    #[inline(always)]
    pub fn take(&mut self, met: &Met, (instance, triangle): (u32, u32)) -> bool {
        let mut hits = met.hits;
        let ties = (hits & met.t.simd_eq(self.t_max)).to_bitmask() & 255;
        if ties != 0 {
            hits = self.unless_behind(hits, ties, instance, triangle);
        }
        let bits: u32x8 = bytemuck::cast(hits);
        self.t_max = hits.bitselect(met.t, self.t_max);
        self.b1 = hits.bitselect(met.b1, self.b1);
        self.b2 = hits.bitselect(met.b2, self.b2);
        self.back = hits.bitselect(met.back, self.back);
        self.instance = bits.bitselect(u32x8::splat(instance), self.instance);
        self.triangle = bits.bitselect(u32x8::splat(triangle), self.triangle);
        hits.to_bitmask() & 255 != 0
    }

    /// Ends the rays that have met a triangle. True if there is any.
    #[inline(always)]
    pub fn stop(&mut self, met: &Met, (instance, _): (u32, u32)) -> bool {
        let bits: u32x8 = bytemuck::cast(met.hits);
        self.t_max = met.hits.bitselect(f32x8::splat(STOPPED), self.t_max);
        self.instance = bits.bitselect(u32x8::splat(instance), self.instance);
        met.hits.to_bitmask() & 255 != 0
    }

    /// Takes out of `hits` those of `ties` whose ray has hit a smaller (instance, triangle) at the same distance.
    #[cold]
    fn unless_behind(&self, hits: f32x8, ties: u32, instance: u32, triangle: u32) -> f32x8 {
        let mut hits = hits.to_array();
        let best = self.instance.to_array().into_iter().zip(self.triangle.to_array());
        for (lane, best) in best.enumerate() {
            if ties >> lane & 1 == 1 && best <= (instance, triangle) {
                hits[lane] = 0.0;
            }
        }
        f32x8::new(hits)
    }

    /// What each ray has hit.
    #[inline(always)]
    pub fn each(&self) -> [Hit; LANES] {
        let [t, b1, b2] = [self.t_max, self.b1, self.b2].map(f32x8::to_array);
        let [instance, triangle] = [self.instance, self.triangle].map(u32x8::to_array);
        let back = self.back.to_bitmask();
        std::array::from_fn(|lane| Hit {
            // The end of a ray that has hit nothing is no distance.
            t: if instance[lane] == NONE { NO_HIT.t } else { t[lane] },
            instance: instance[lane],
            triangle: triangle[lane],
            b1: b1[lane],
            b2: b2[lane],
            back: back >> lane & 1 == 1,
        })
    }
}
