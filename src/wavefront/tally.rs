//! Where contributions go: the sums of the worker's tile.

use super::{
    ledger::{Account, Ledger},
    reuse::{FIRST, Reuse, SHARED},
};
use crate::{
    film::{Label, Sums, Tile, Unit},
    sampling::{REPLICAS, replica},
};

/// Adds light to the tile a worker owns, and counts what is not finite.
#[derive(Clone, Debug)]
pub struct Tally {
    /// Step of the sums.
    pub unit: Unit,
    /// Sums by the sample's replica.
    pub replicas: [Sums; REPLICAS],
    /// Contributions that were not finite or out of range.
    pub discarded: u64,
    /// What paths leave for one another.
    pub reuse: Reuse,
    /// What light it is, where that is asked for.
    pub ledger: Option<Ledger>,
}

impl Tally {
    /// Takes over the sums of a tile.
    pub fn of(tile: &mut Tile, unit: Unit, reuse: Reuse, ledger: Ledger) -> Self {
        let parts = std::mem::take(&mut tile.parts);
        let ledger = (!parts.is_empty()).then(|| ledger.with(parts));
        Self { unit, replicas: std::mem::take(&mut tile.replicas), discarded: 0, reuse, ledger }
    }

    /// Gives the sums back to the tile; returns what keeps its memory for the next one.
    pub fn close(self, tile: &mut Tile) -> (Reuse, Ledger) {
        tile.replicas = self.replicas;
        let mut ledger = self.ledger.unwrap_or_default();
        tile.parts = std::mem::take(&mut ledger.parts);
        (self.reuse, ledger)
    }

    /// Adds light to a pixel, or to the far vertex that it was found from; `account` says what light it is.
    #[inline]
    pub fn add<A: Into<Account>>(
        &mut self,
        slot: u32,
        sample: u32,
        light: [f32; 3],
        account: impl FnOnce(&Ledger) -> A,
    ) {
        if light == [0.0; 3] {
            return;
        }
        if slot & SHARED != 0 {
            self.reuse.add(slot, sample, light);
            if let Some(ledger) = &mut self.ledger {
                let account = account(ledger).into();
                ledger.keep(slot & !(SHARED | FIRST), sample, light, slot & FIRST != 0, account);
            }
            return;
        }
        if !self.replicas[replica(sample)].add(self.unit, slot as usize, light) {
            self.discarded += 1;
        } else if let Some(ledger) = &mut self.ledger {
            let account = account(ledger).into();
            ledger.add(self.unit, slot, sample, light, account);
        }
    }

    /// Adds light to a pixel that is the sum of such parts, but for rounding.
    pub fn add_parts(&mut self, slot: u32, sample: u32, light: [f32; 3], parts: &[(Label, [f32; 3])]) {
        if light == [0.0; 3] {
            return;
        }
        if !self.replicas[replica(sample)].add(self.unit, slot as usize, light) {
            self.discarded += 1;
        } else if let Some(ledger) = &mut self.ledger {
            ledger.add_parts(self.unit, slot, sample, light, parts);
        }
    }
}
