//! Keeps account of what light it is that paths bring, for layers of light in parts. Runs only where such a layer is asked for.
//!
//! A contribution is the term of one number of scatterings and of one light, so it goes to one layer of each split, in the same
//! integer steps as to the picture itself: the layers add up to it exactly. What pixels share is added to a picture as one
//! number for all that a pixel gets of its group; its parts are worked out beside it, and what their rounding leaves over
//! goes to the greatest of them.

use std::sync::Arc;

use crate::{
    film::{Label, Splits, Sums, Unit},
    flat::{FlatScene, LightGroups, NONE, Source},
    sampling::{REPLICAS, replica},
};

/// How the light of a picture is split.
#[derive(Clone, Debug, Default)]
pub struct Accounts {
    /// Its layers.
    pub splits: Splits,
    /// Whose light it may be; empty if no split tells.
    pub groups: LightGroups,
}

/// Light that a far vertex sends to its near one.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    /// What it is, seen from the near vertex's side.
    pub label: Label,
    /// nit.
    pub light: [f32; 3],
    /// By the light sample of the far vertex itself.
    pub first: bool,
    /// Row of the one before, or `NONE`.
    before: u32,
}

/// The accounts of a tile, for some samples of each pixel.
#[derive(Clone, Debug, Default)]
pub struct Ledger {
    /// None before the first tile.
    accounts: Option<Arc<Accounts>>,
    /// By layer, the sums of the tile.
    pub parts: Vec<[Sums; REPLICAS]>,
    first_sample: u32,
    step: u32,
    pixels: u32,
    /// By path, what its light sample brings if it arrives.
    pending: Vec<Label>,
    /// By path, the last row of `found` that is its own.
    last: Vec<u32>,
    found: Vec<Found>,
}

impl Ledger {
    /// With the sums of a tile.
    pub fn with(mut self, parts: Vec<[Sums; REPLICAS]>) -> Self {
        self.parts = parts;
        self
    }

    /// Opens the accounts of a tile of so many pixels, for every `step`-th of samples `from..to`.
    pub fn begin(&mut self, accounts: &Arc<Accounts>, pixels: usize, from: u32, to: u32, step: u32) {
        self.accounts = Some(Arc::clone(accounts));
        (self.first_sample, self.step, self.pixels) = (from, step, pixels as u32);
        let rows = pixels * (to - from).div_ceil(step) as usize;
        self.pending.clear();
        self.pending.resize(rows, Label::default());
        self.last.clear();
        self.last.resize(rows, NONE);
        self.found.clear();
    }

    #[inline]
    fn row(&self, pixel: u32, sample: u32) -> usize {
        ((sample - self.first_sample) / self.step * self.pixels + pixel) as usize
    }

    /// What light it is that was sent off by `source`, and scattered so often.
    #[inline]
    pub fn label(&self, scene: &FlatScene, scatterings: u32, source: Source) -> Label {
        let groups = self.accounts.as_ref().map(|accounts| &accounts.groups).filter(|groups| !groups.keys.is_empty());
        Label { scatterings, light: groups.map_or(0, |groups| groups.of(scene, source)) }
    }

    /// Notes what the light sample of a path brings if nothing is in its way.
    #[inline]
    pub fn expect(&mut self, pixel: u32, sample: u32, label: Label) {
        let row = self.row(pixel, sample);
        self.pending[row] = label;
    }

    /// That note.
    #[inline]
    pub fn expected(&self, pixel: u32, sample: u32) -> Label {
        self.pending[self.row(pixel, sample)]
    }

    /// Adds light that the picture gets.
    #[inline]
    pub fn add(&mut self, unit: Unit, pixel: u32, sample: u32, light: [f32; 3], label: Label) {
        let Self { accounts, parts, .. } = self;
        for part in accounts.iter().flat_map(|accounts| accounts.splits.of(label)) {
            parts[part][replica(sample)].add(unit, pixel as usize, light);
        }
    }

    /// Adds light that the picture gets as one number, by its parts.
    pub fn add_parts(&mut self, unit: Unit, pixel: u32, sample: u32, light: [f32; 3], parts: &[(Label, [f32; 3])]) {
        let Some(most) = (0..parts.len()).max_by(|&a, &b| {
            let sum = |row: usize| parts[row].1.iter().sum::<f32>();
            sum(a).total_cmp(&sum(b))
        }) else {
            return;
        };
        let mut rest = light.map(|c| unit.quantise(c).0);
        let mut put = |label: Label, steps: [i128; 3]| {
            for part in self.accounts.iter().flat_map(|accounts| accounts.splits.of(label)) {
                let sum = &mut self.parts[part][replica(sample)].0[pixel as usize];
                (0..3).for_each(|c| sum[c] += steps[c]);
            }
        };
        for (row, (label, light)) in parts.iter().enumerate() {
            let steps = light.map(|c| match unit.quantise(c) {
                (steps, true) => steps,
                _ => 0,
            });
            if row != most {
                put(*label, steps);
                (0..3).for_each(|c| rest[c] -= steps[c]);
            }
        }
        put(parts[most].0, rest);
    }

    /// Notes light that a path's far vertex sends to its near one.
    pub fn keep(&mut self, pixel: u32, sample: u32, light: [f32; 3], first: bool, label: Label) {
        let row = self.row(pixel, sample);
        let before = std::mem::replace(&mut self.last[row], self.found.len() as u32);
        self.found.push(Found { label, light, first, before });
    }

    /// All that a path's far vertex sends to its near one.
    pub fn found(&self, pixel: u32, sample: u32) -> impl Iterator<Item = &Found> {
        let found = |row: u32| self.found.get(row as usize);
        std::iter::successors(found(self.last[self.row(pixel, sample)]), move |last| found(last.before))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{film::Split, world::units::Nit};

    fn ledger(pixels: usize) -> Ledger {
        let splits = Splits::new([Split::Bounces, Split::Direct], Some(4), 0);
        let accounts = Arc::new(Accounts { splits, groups: LightGroups::default() });
        let black = || std::array::from_fn(|_| Sums::new(pixels));
        let mut ledger =
            Ledger { parts: (0..accounts.splits.layers()).map(|_| black()).collect(), ..Ledger::default() };
        ledger.begin(&accounts, pixels, 0, 8, 2);
        ledger
    }

    /// Parts that are rounded in other ways than their sum, negative and broken ones among them.
    #[test]
    fn parts_add_up_to_the_sum_in_all_bits() {
        let unit = Unit::for_emission(Nit(3.0));
        let mut ledger = ledger(1);
        let mut sums = Sums::new(1);
        for i in 0..1000_u32 {
            let part = |n: u32| ((i * 7919 + n * 104_729) % 1000) as f32 * 1.7e-3;
            let mut parts: Vec<(Label, [f32; 3])> =
                (0..5).map(|n| (Label { scatterings: n, light: 0 }, [part(n), 1e-9 * part(n + 7), -part(n)])).collect();
            let light = std::array::from_fn(|c| parts.iter().rev().map(|(_, light)| light[c]).sum());
            if i % 10 == 0 {
                parts[3].1[0] = f32::NAN;
            }
            assert!(sums.add(unit, 0, light));
            ledger.add_parts(unit, 0, 2 * (i % 4), light, &parts);
        }
        let total = |layers: std::ops::Range<usize>| -> [i128; 3] {
            std::array::from_fn(|c| ledger.parts[layers.clone()].iter().flatten().map(|sums| sums.0[0][c]).sum())
        };
        assert_eq!(total(0..5), sums.0[0]);
        assert_eq!(total(5..7), sums.0[0]);
    }

    #[test]
    fn what_far_vertices_found_comes_back_path_by_path() {
        let mut ledger = ledger(3);
        for (n, (pixel, sample)) in [(0, 2), (2, 6), (0, 2), (1, 0), (0, 2)].into_iter().enumerate() {
            let label = Label { scatterings: n as u32, light: 0 };
            ledger.keep(pixel, sample, [n as f32; 3], n == 0, label);
            ledger.expect(pixel, sample, label);
        }
        let found: Vec<u32> = ledger.found(0, 2).map(|found| found.label.scatterings).collect();
        assert_eq!(found, [4, 2, 0]);
        assert_eq!(ledger.found(2, 6).count(), 1);
        assert_eq!(ledger.found(2, 4).count(), 0);
        assert_eq!(ledger.expected(0, 2).scatterings, 4);
    }
}
