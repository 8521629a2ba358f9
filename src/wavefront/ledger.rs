//! Keeps account of what light it is that paths bring, for layers of light in parts. Runs only where such a layer is asked for.
//!
//! A contribution is the term of one number of scatterings and of one light, so it goes to one layer of each split, in the same
//! integer steps as to the picture itself: the layers add up to it exactly. What pixels share is added to a picture as one
//! number for all that a pixel gets of its group; its parts are worked out beside it, and what their rounding leaves over
//! goes to the greatest of them.
//!
//! What happened to a path is kept as the state of an automaton that reads it from the camera on. Where a surface reflects a light
//! sample by two lobes, the light is divided between them. A path that goes on is one of either lobe, drawn anew, channel by
//! channel, in proportion to what they send into its direction: then its light goes to one layer, and the layers are right in
//! the mean. Of what pixels share, every near vertex weighs its lobes by itself, and so does every far one for each of them.

use std::sync::Arc;

use crate::{
    film::{Automaton, Event, Label, Splits, Sums, Unit, of_channels},
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

/// A state of the automaton for each channel.
pub type Ways = [u16; 3];

/// How a surface divides light between its lobes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scattered {
    /// Share of the diffuse one, by channel.
    pub diffuse: [f32; 3],
    /// What the rest does; nothing is known of the surface if that is none.
    pub other: Option<Event>,
}

/// What a piece of light is, and what the surface that sends it on has done to it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Account {
    /// What it is, but for the way of it.
    pub label: Label,
    /// By the last surface, if that is not in the way of its path yet.
    scattered: Scattered,
    /// Before it.
    ways: [Ways; 4],
}

impl From<Label> for Account {
    fn from(label: Label) -> Self {
        Self { label, ..Self::default() }
    }
}

/// What happened to a path.
#[derive(Clone, Copy, Debug, Default)]
struct Way {
    /// After all of it, in the first; of light that is found from a far vertex, after that what the near and the far one may have
    /// done: see [`JOINTS`].
    states: [Ways; 4],
    /// It is past its far vertex.
    is_shared: bool,
    /// Share of the diffuse lobe of the near vertex, in the direction of the light sample and in that of the path.
    lit: [f32; 3],
    near: [f32; 3],
    /// And of the far one.
    far: [f32; 3],
}

/// What near and far vertices may do, being opaque and not too smooth.
pub const JOINTS: [[Event; 2]; 4] = {
    use Event::{DiffuseReflection as D, GlossyReflection as G};
    [[D, D], [D, G], [G, D], [G, G]]
};

/// Of two lobes, the share of one.
#[inline]
pub fn of_lobe(diffuse: [f32; 3], lobe: Event) -> [f32; 3] {
    if lobe == Event::DiffuseReflection { diffuse } else { diffuse.map(|share| 1.0 - share) }
}

#[inline]
fn times(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| a[c] * b[c])
}

/// Light that a far vertex sends to its near one.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    /// What it is, seen from the near vertex's side.
    pub label: Label,
    /// Its way, whatever the near and the far vertex may have done.
    pub ways: [Ways; 4],
    /// Share of the far vertex's diffuse lobe where the path itself is met.
    pub far: [f32; 3],
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
    pending: Vec<Account>,
    /// By path, what happened to it, where layers tell.
    ways: Vec<Way>,
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
        self.pending.resize(rows, Account::default());
        self.ways.clear();
        self.ways.resize(if accounts.splits.automaton.is_some() { rows } else { 0 }, Way::default());
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
        Label { scatterings, light: groups.map_or(0, |groups| groups.of(scene, source)), ..Label::default() }
    }

    fn automaton(&self) -> Option<&Automaton> {
        self.accounts.as_ref().and_then(|accounts| accounts.splits.automaton.as_deref())
    }

    /// Whether layers tell what happened to paths.
    #[inline]
    pub fn follows_paths(&self) -> bool {
        self.automaton().is_some()
    }

    /// Notes what the light sample of a path brings if nothing is in its way, and how the surface divides it. Before the path
    /// [goes on](Self::go_on).
    #[inline]
    pub fn expect(&mut self, pixel: u32, sample: u32, label: Label, scattered: Scattered) {
        let row = self.row(pixel, sample);
        let ways = self.ways.get(row).map_or_else(Default::default, |way| way.states);
        self.pending[row] = Account { label, scattered, ways };
    }

    /// That note.
    #[inline]
    pub fn expected(&self, pixel: u32, sample: u32) -> Account {
        self.pending[self.row(pixel, sample)]
    }

    /// Notes how the near vertex of a path divides its light sample.
    #[inline]
    pub fn lit(&mut self, pixel: u32, sample: u32, scattered: Scattered) {
        let row = self.row(pixel, sample);
        self.ways[row].lit = scattered.diffuse;
    }

    /// Notes that a path is scattered by one of two lobes, which `u` chooses.
    pub fn go_on(&mut self, pixel: u32, sample: u32, scattered: Scattered, u: f32) {
        let row = self.row(pixel, sample);
        let (Some(automaton), Some(other)) = (self.automaton(), scattered.other) else { return };
        let Way { mut states, is_shared, .. } = self.ways[row];
        for ways in states.iter_mut().take(if is_shared { 4 } else { 1 }) {
            for (c, state) in ways.iter_mut().enumerate() {
                let event = if u < scattered.diffuse[c] { Event::DiffuseReflection } else { other };
                *state = automaton.after(*state, event);
            }
        }
        self.ways[row].states = states;
        if !is_shared {
            self.ways[row].near = scattered.diffuse;
        }
    }

    /// Notes that a path is at its far vertex, and how that divides its light.
    pub fn go_far(&mut self, pixel: u32, sample: u32, scattered: Scattered) {
        let row = self.row(pixel, sample);
        let Some(automaton) = self.automaton() else { return };
        let states = JOINTS.map(|joint| {
            let state = joint.into_iter().fold(Automaton::START, |state, event| automaton.after(state, event));
            [state; 3]
        });
        let way = &mut self.ways[row];
        (way.states, way.is_shared, way.far) = (states, true, scattered.diffuse);
    }

    /// What light of a near vertex without a far one may be, by lobe, with the shares of the path itself.
    pub fn near(&self, pixel: u32, sample: u32, lit: bool, label: Label) -> [(Event, Label, [f32; 3]); 2] {
        let way = self.ways.get(self.row(pixel, sample)).copied().unwrap_or_default();
        [Event::DiffuseReflection, Event::GlossyReflection].map(|lobe| {
            let state = self.automaton().map_or(0, |automaton| automaton.after(Automaton::START, lobe));
            let share = of_lobe(if lit { way.lit } else { way.near }, lobe);
            (lobe, Label { way: [state; 3], ..label }, share)
        })
    }

    /// Share of the near vertex's diffuse lobe, where its path went.
    pub fn near_share(&self, pixel: u32, sample: u32) -> [f32; 3] {
        self.ways.get(self.row(pixel, sample)).map_or([1.0; 3], |way| way.near)
    }

    /// The two parts of light that a surface sends on.
    fn divided(&self, light: [f32; 3], account: &Account) -> Option<[([f32; 3], Event); 2]> {
        let Scattered { diffuse, other } = account.scattered;
        self.automaton()?;
        Some([(times(light, diffuse), Event::DiffuseReflection), (times(light, of_lobe(diffuse, other?)), other?)])
    }

    #[inline]
    fn put(&mut self, unit: Unit, pixel: u32, sample: u32, light: [f32; 3], label: Label) {
        let Self { accounts, parts, .. } = self;
        let Some(accounts) = accounts else { return };
        accounts.splits.each(label, |part, channels| {
            parts[part][replica(sample)].add(unit, pixel as usize, of_channels(light, channels));
        });
    }

    /// Adds light that the picture gets.
    #[inline]
    pub fn add(&mut self, unit: Unit, pixel: u32, sample: u32, light: [f32; 3], account: Account) {
        let Account { label, ways, .. } = account;
        if let Some(parts) = self.divided(light, &account) {
            let parts = parts.map(|(light, event)| {
                let way = ways[0].map(|state| self.automaton().map_or(0, |automaton| automaton.after(state, event)));
                (Label { way, ..label }, light)
            });
            return self.add_parts(unit, pixel, sample, light, &parts);
        }
        let way = self.ways.get(self.row(pixel, sample)).map_or([0; 3], |way| way.states[0]);
        self.put(unit, pixel, sample, light, Label { way, ..label });
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
            let Some(accounts) = &self.accounts else { return };
            accounts.splits.each(label, |part, channels| {
                let sum = &mut self.parts[part][replica(sample)].0[pixel as usize];
                (0..3).filter(|c| channels >> c & 1 == 1).for_each(|c| sum[c] += steps[c]);
            });
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
    pub fn keep(&mut self, pixel: u32, sample: u32, light: [f32; 3], first: bool, account: Account) {
        let row = self.row(pixel, sample);
        let Account { label, scattered, ways } = account;
        let way = self.ways.get(row).copied().unwrap_or_default();
        let mut push = |ways: [Ways; 4], far: [f32; 3], light: [f32; 3]| {
            let before = std::mem::replace(&mut self.last[row], self.found.len() as u32);
            self.found.push(Found { label, ways, far, light, first, before });
        };
        let accounts = self.accounts.as_ref();
        match accounts.and_then(|accounts| accounts.splits.automaton.as_deref()).zip(scattered.other) {
            // The far vertex itself has divided it.
            Some(_) if first => push(way.states, scattered.diffuse, light),
            Some((automaton, other)) => {
                for event in [Event::DiffuseReflection, other] {
                    let ways = ways.map(|ways| ways.map(|state| automaton.after(state, event)));
                    let light = times(light, of_lobe(scattered.diffuse, event));
                    if light != [0.0; 3] {
                        push(ways, way.far, light);
                    }
                }
            }
            None => push(way.states, way.far, light),
        }
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

    fn label(scatterings: u32) -> Label {
        Label { scatterings, ..Label::default() }
    }

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
                (0..5).map(|n| (label(n), [part(n), 1e-9 * part(n + 7), -part(n)])).collect();
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
            ledger.keep(pixel, sample, [n as f32; 3], n == 0, label(n as u32).into());
            ledger.expect(pixel, sample, label(n as u32), Scattered::default());
        }
        let found: Vec<u32> = ledger.found(0, 2).map(|found| found.label.scatterings).collect();
        assert_eq!(found, [4, 2, 0]);
        assert_eq!(ledger.found(2, 6).count(), 1);
        assert_eq!(ledger.found(2, 4).count(), 0);
        assert_eq!(ledger.expected(0, 2).label.scatterings, 4);
    }
}
