//! Where contributions go: the sums of the worker's tile.

use super::reuse::{Reuse, SHARED};
use crate::{
    film::{Sums, Unit},
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
}

impl Tally {
    /// Adds light to a pixel, or to the far vertex that it was found from.
    #[inline]
    pub fn add(&mut self, slot: u32, sample: u32, light: [f32; 3]) {
        if light == [0.0; 3] {
            return;
        }
        if slot & SHARED != 0 {
            self.reuse.add(slot, sample, light);
            return;
        }
        if !self.replicas[replica(sample)].add(self.unit, slot as usize, light) {
            self.discarded += 1;
        }
    }
}
