//! Adds the light of shadow rays that nothing is in the way of.

use super::{
    queues::ShadowQueue,
    reuse::{FIRST, SHARED},
    tally::Tally,
};
use crate::accel::{Accel, Coverage, Rays};

/// Traces the queue and adds what arrives to the tile sums.
pub fn connect<C: Coverage>(accel: &Accel, shadows: &ShadowQueue, coverage: &C, tally: &mut Tally) {
    accel.occluded_of(shadows, coverage, |row, occluded| {
        if !occluded {
            let light = [shadows.light_r[row], shadows.light_g[row], shadows.light_b[row]];
            let (slot, sample) = (shadows.slot[row], shadows.sample[row]);
            tally.add(slot, sample, light, |ledger| ledger.expected(slot & !(SHARED | FIRST), sample));
        }
    });
}

impl Rays for ShadowQueue {
    fn count(&self) -> usize {
        self.len()
    }

    #[inline(always)]
    fn ray(&self, i: usize) -> ([f32; 3], [f32; 3], f32) {
        ([self.ox[i], self.oy[i], self.oz[i]], [self.dx[i], self.dy[i], self.dz[i]], self.t_max[i])
    }

    #[inline(always)]
    fn id(&self, i: usize) -> u32 {
        self.ray_id[i]
    }
}
