//! Adds the light of shadow rays that nothing is in the way of.

use super::{queues::ShadowQueue, tally::Tally};
use crate::accel::{Accel, Coverage, Stacks};

/// Traces the queue and adds what arrives to the tile sums.
pub fn connect<C: Coverage>(
    accel: &Accel,
    shadows: &ShadowQueue,
    coverage: &C,
    stacks: &mut Stacks,
    tally: &mut Tally,
) {
    for i in 0..shadows.len() {
        let (origin, direction) = (shadows.origin[i], shadows.direction[i]);
        if !accel.occluded(origin, direction, shadows.t_max[i], shadows.ray_id[i], coverage, stacks) {
            tally.add(shadows.slot[i], shadows.sample[i], shadows.light[i]);
        }
    }
}
