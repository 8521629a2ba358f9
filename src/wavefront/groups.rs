//! Which pixels share, and the random numbers that are theirs together.

use crate::{film::BLOCK, sampling::Sampler};

/// Edge of the squares of pixels that are cut into groups.
pub const SQUARE: u32 = BLOCK;
/// Paths of a group at most.
pub const MOST: usize = (SQUARE * SQUARE) as usize;
/// Samples after which groups are cut as they were.
const WAYS: u32 = 6;

/// The bits of a place in a square that say its group, for groups of so many: of x the lower three, of y the upper.
///
/// The high ones, the low ones or those between by turns, so that what the members share does not show as squares.
fn of_group(sample: u32, size: usize) -> u32 {
    let bit = |i: u32| {
        let bit = [2, 0, 1][((sample % 3 + i / 2) % 3) as usize];
        if (sample / 3 + i).is_multiple_of(2) { bit } else { bit + 3 }
    };
    (0..6 - size.trailing_zeros()).fold(0, |bits, i| bits | 1 << bit(i))
}

/// Spreads the bits of a number over the places of those that are set.
fn spread(number: u32, over: u32) -> u32 {
    let (mut spread, mut from) = (0, number);
    for bit in (0..6).filter(|bit| over >> bit & 1 == 1) {
        spread |= (from & 1) << bit;
        from >>= 1;
    }
    spread
}

/// The inverse of [`spread`].
fn gathered(spread: u32, over: u32) -> u32 {
    let (mut number, mut to) = (0, 0);
    for bit in (0..6).filter(|bit| over >> bit & 1 == 1) {
        number |= (spread >> bit & 1) << to;
        to += 1;
    }
    number
}

/// The pixel in a square of a member of one of the groups of so many paths.
pub fn pixel_of(sample: u32, size: usize, group: u32, member: u32) -> (u32, u32) {
    let bits = of_group(sample, size);
    let place = spread(group, bits) | spread(member, !bits);
    (place % SQUARE, place / SQUARE)
}

/// For a pixel and a sample, what stands for all who share in the sampler, and the path's place in their sequence.
///
/// A group's paths follow one another in it: those of a sample are as evenly spread as those of a pixel would be.
pub fn key(sampler: &Sampler, size: usize, [x, y]: [u32; 2], sample: u32) -> (u32, u32) {
    let bits = of_group(sample, size);
    let place = (x % SQUARE) | (y % SQUARE * SQUARE);
    let (group, member) = (gathered(place, bits), gathered(place, !bits));
    // Groups of one square are all the same; others come back when they are cut as they were.
    let (way, ways) = if size == MOST { (0, 1) } else { (sample % WAYS, WAYS) };
    let hash = sampler.group_hash(x / SQUARE, y / SQUARE, way * SQUARE * SQUARE + group);
    (hash, sampler.shared(sample, ways, size as u32, member))
}

#[cfg(test)]
mod tests {
    use std::num::Wrapping;

    use super::*;
    use crate::render::SamplerKind;

    /// For every size and way of cutting, each pixel of a square is one member of one group, and its key says which.
    #[test]
    fn groups_cut_squares_into_equal_parts() {
        for sampler in [Sampler::new(SamplerKind::Sobol, 3), Sampler::new(SamplerKind::Sobol, 3).in_replicas()] {
            for size in [8, 16, 32, 64] {
                let mut keys = Vec::new();
                for sample in 0..48 {
                    let mut met = [false; MOST];
                    for group in 0..(MOST / size) as u32 {
                        let mut hashes = Vec::new();
                        for member in 0..size as u32 {
                            let (x, y) = pixel_of(sample, size, group, member);
                            let met = &mut met[(y * SQUARE + x) as usize];
                            assert!(!*met, "{size} {sample} {group} {member}");
                            *met = true;
                            let key = key(&sampler, size, [x + 16, y + 40], sample);
                            hashes.push(key.0);
                            keys.push(key);
                        }
                        hashes.dedup();
                        assert_eq!(hashes.len(), 1, "one sequence for a group");
                    }
                }
                keys.sort_unstable();
                let all = keys.len();
                keys.dedup();
                assert_eq!(keys.len(), all, "no number is used twice");
            }
        }
    }

    /// What the members of a group draw for one sample is as even as what a pixel draws for as many: one number in each of so
    /// many parts of the interval.
    #[test]
    fn members_draw_an_aligned_run_of_one_sequence() {
        for sampler in [Sampler::new(SamplerKind::Sobol, 4), Sampler::new(SamplerKind::Sobol, 4).in_replicas()] {
            for size in [8, 16, 32, 64] {
                for (sample, dimension) in (0..48).zip(0..) {
                    for group in 0..(MOST / size) as u32 {
                        let mut drawn = vec![0; size];
                        for member in 0..size as u32 {
                            let (x, y) = pixel_of(sample, size, group, member);
                            let (hash, index) = key(&sampler, size, [x + 8, y + 56], sample);
                            let u: f32 = sampler.one::<f32>(Wrapping(hash), Wrapping(index), Wrapping(dimension));
                            drawn[(u * size as f32) as usize] += 1;
                        }
                        assert!(drawn.iter().all(|&count| count == 1), "{size} {sample} {group}: {drawn:?}");
                    }
                }
            }
        }
    }
}
