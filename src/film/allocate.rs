//! Which blocks get how many samples.
//!
//! The even replicas of a block decide how many samples its odd ones get, and the other way round. If a block's own
//! light decided, blocks whose rare bright samples have not come yet would look done and stay too dark, while those whose
//! came early would see them diluted: pictures would be too dark on average. For the same reason it is decided once, after
//! all blocks have got as many samples: what one half finds with the samples that the other gave it tells of the other.
//! From then on the proportions stay, and only the number of samples in all depends on the picture's error.

use rayon::prelude::*;

use super::{Film, Tile, estimate::relative};

/// Samples of a half are given in multiples of this: four to each of its two replicas, whose sequences are most even where
/// they have a power of two.
const ROUND: u32 = 8;
/// A block gets at least this share of the mean, however still it looks: its error is only estimated.
const LEAST_SHARE: f64 = 0.125;
/// Halvings of the interval that the scale of all counts is looked for in.
const HALVINGS: usize = 60;

/// How many more samples to take.
#[derive(Clone, Copy, Debug)]
pub struct Growth {
    /// The squared error should fall to this share of what it is.
    pub error: f64,
    /// But paths should be at least so many in all,
    pub least: f64,
    /// and must not be more than this.
    pub most: f64,
}

/// One half of the replicas of one block, as the other half sees it.
#[derive(Clone, Copy, Debug, Default)]
struct Need {
    /// Samples so far.
    now: f64,
    /// Paths to a sample.
    pixels: f64,
    /// Variance of a sample, relative to the square of the pixel, summed over the block; as estimated by the other half.
    variance: f64,
}

impl Film {
    /// In what proportion the tiles' even and odd replicas should get samples, after all tiles have got as many.
    ///
    /// The error of the picture is least for the same number of paths if that of blocks is to the square root of the
    /// variance of their samples.
    pub fn shares(&self) -> Vec<[f64; 2]> {
        let halves = [0, 1].map(|half| {
            let needs = self.needs(half);
            let variances = self.smooth(needs.iter().map(|need| need.variance / need.pixels).collect());
            let mean = variances.iter().map(|variance| variance.sqrt()).sum::<f64>() / variances.len() as f64;
            let share = |variance: f64| if mean > 0.0 { (variance.sqrt() / mean).max(LEAST_SHARE) } else { 1.0 };
            variances.into_iter().map(share).collect::<Vec<_>>()
        });
        halves[0].iter().zip(&halves[1]).map(|(&even, &odd)| [even, odd]).collect()
    }

    /// Samples that the even and the odd replicas of each tile's pixels should have next, by their shares; fewer never than
    /// now.
    pub fn allocate(&self, shares: &[[f64; 2]], growth: &Growth) -> Vec<[u32; 2]> {
        let halves = [0, 1].map(|half| self.allocate_half(half, shares, growth));
        halves[0].iter().zip(&halves[1]).map(|(&even, &odd)| [even, odd]).collect()
    }

    fn allocate_half(&self, half: usize, shares: &[[f64; 2]], growth: &Growth) -> Vec<u32> {
        let needs = self.needs(half);
        let error_now: f64 = needs.iter().map(|need| need.variance / need.now).sum();
        let counts = |scale: f64| {
            needs.iter().zip(shares).map(move |(need, share)| {
                let wanted = (scale * share[half]).min(f64::from(u32::MAX / 8)) as u32;
                (need, f64::from(wanted.next_multiple_of(ROUND)).max(need.now))
            })
        };
        let paths = |scale: f64| counts(scale).map(|(need, count)| need.pixels * count).sum::<f64>();
        // The halves share what is to be done.
        let (least, most) = (0.5 * growth.least, 0.5 * growth.most);
        let enough = |scale: f64| {
            let paths = paths(scale);
            let error: f64 = counts(scale).map(|(need, count)| need.variance / count).sum();
            paths >= most || (paths >= least && error <= growth.error * error_now)
        };
        let (mut low, mut high) = (0.0, 1.0);
        while !enough(high) {
            high *= 2.0;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if enough(middle) { high = middle } else { low = middle }
        }
        let scale = if paths(high) > most { low } else { high };
        counts(scale).map(|(_, count)| count as u32).collect()
    }

    /// Values of tiles, half of each from the tiles around it: what few samples say of a block is uncertain, and what
    /// makes a block difficult seldom ends at its edge.
    fn smooth(&self, values: Vec<f64>) -> Vec<f64> {
        let across = self.tiles.iter().take_while(|tile| tile.y == self.tiles[0].y).count();
        let down = values.len() / across;
        let around = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
        let smoothed = |(i, value): (usize, &f64)| {
            let rows = around(i / across, down);
            let near = rows.flat_map(|y| around(i % across, across).map(move |x| y * across + x));
            let (sum, count) = near.fold((0.0, 0.0), |(sum, count), i| (sum + values[i], count + 1.0));
            0.5 * (value + sum / count)
        };
        values.iter().enumerate().map(smoothed).collect()
    }

    /// By tile, which is a block.
    fn needs(&self, half: usize) -> Vec<Need> {
        // What decides about a half comes from the other.
        let pair = [1 - half, 3 - half];
        let mean = |tile: &Tile, pixel: usize| pair.map(|replica| self.replica_mean(tile, None, pixel, replica));
        let total: f64 = self
            .tiles
            .par_iter()
            .map(|tile| self.pixels_of(tile).map(|(pixel, _)| mean(tile, pixel).iter().flatten().sum::<f64>()).sum())
            .collect::<Vec<f64>>()
            .iter()
            .sum();
        let floor = 0.01 * (total / (6.0 * f64::from(self.window[2]) * f64::from(self.window[3]))).powi(2);
        let need = |tile: &Tile| {
            let mut squares = 0.0;
            for (pixel, _) in self.pixels_of(tile) {
                let [a, b] = mean(tile, pixel);
                for c in 0..3 {
                    let difference = a[c] - b[c];
                    if difference != 0.0 {
                        squares += difference * difference * relative([a[c], b[c]], floor);
                    }
                }
            }
            let of = |half: usize| f64::from(tile.samples[half] + tile.samples[half + 2]);
            Need { now: of(half), pixels: tile.pixels() as f64, variance: 0.25 * squares * of(1 - half) }
        };
        self.tiles.par_iter().map(need).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::num::Wrapping;

    use super::*;
    use crate::{
        film::Unit,
        measure::statistics::Moments,
        render::{RenderSettings, SamplerKind},
        sampling::{Sampler, replica},
        world::units::Nit,
    };

    const BLOCKS: u32 = 16;

    fn row_of_blocks() -> Film {
        let (width, error) = (8 * BLOCKS, Some(0.1));
        let settings = RenderSettings { width, height: 1, error, ..RenderSettings::default() };
        Film::new(&settings, Unit::for_emission(Nit(100.0)))
    }

    /// Adds samples to the pixels of a block, which all get the same light.
    fn add(film: &mut Film, block: usize, samples: impl Iterator<Item = u32>, light: impl Fn(u32) -> f32) {
        let tile = &mut film.tiles[block];
        for sample in samples {
            let light = light(sample);
            (0..8).for_each(|pixel| assert!(tile.replicas[replica(sample)].add(film.unit, pixel, [light; 3])));
            tile.samples[replica(sample)] += 1;
        }
    }

    /// Light that comes to one sample in fifty, so that sixteen samples often see none. The number of paths is the same
    /// each time, only how they are dealt to the blocks is not; the mean is 1. Significance 1e-4.
    ///
    /// If the halves decided about themselves, half of the light would be lost; if they decided about each other again in
    /// the second round, a quarter.
    #[test]
    fn samples_dealt_by_error_leave_the_mean_as_it_is() {
        let means: Moments = (0..2000)
            .map(|seed| {
                let sampler = Sampler::new(SamplerKind::Independent, seed);
                let light = |block: usize| {
                    move |sample: u32| {
                        let hash = Wrapping(sampler.pixel_hash(block as u32, 1));
                        if sampler.one::<f32>(hash, Wrapping(sample), Wrapping(0)) < 0.02 { 50.0 } else { 0.0 }
                    }
                };
                let mut film = row_of_blocks();
                (0..film.tiles.len()).for_each(|block| add(&mut film, block, 0..16, light(block)));
                let shares = film.shares();
                for _ in 0..2 {
                    let now = film.spp() * f64::from(8 * BLOCKS);
                    let counts = film.allocate(&shares, &Growth { error: 0.0, least: 0.0, most: 3.0 * now });
                    for (block, counts) in counts.iter().enumerate() {
                        for (half, &end) in (0..).zip(counts) {
                            let tile = &film.tiles[block];
                            let next = tile.samples[half] + tile.samples[half + 2];
                            let samples = (next..end).map(|i| 2 * i + half as u32);
                            add(&mut film, block, samples, light(block));
                        }
                    }
                }
                let picture = film.resolve();
                picture.rgb.iter().map(|rgb| f64::from(rgb[0])).sum::<f64>() / picture.rgb.len() as f64
            })
            .collect();
        assert!(means.p_value(1.0) > 1e-4, "{means:?}");
        assert!(means.standard_error() < 0.01, "{means:?} says nothing");
    }

    /// Blocks with 16 times the variance get 4 times the samples, still ones at least an eighth of the mean; the total
    /// is what was asked for, and nothing is taken back.
    #[test]
    fn samples_go_where_the_error_is() {
        let mut film = row_of_blocks();
        for block in 0..film.tiles.len() {
            // Between 1 − a and 1 + a, in turn in each replica's samples; the replicas differ by a.
            let swing = if block < 8 { 0.01 } else { 0.04 };
            add(&mut film, block, 0..64, |sample| 1.0 + swing * [1.0, 1.0, -1.0, -1.0][replica(sample)]);
        }
        let now = 64.0 * f64::from(8 * BLOCKS);
        let shares = film.shares();
        let counts = film.allocate(&shares, &Growth { error: 0.0, least: 0.0, most: 10.0 * now });
        let of = |block: usize| counts[block].map(f64::from);
        for half in 0..2 {
            assert!((of(13)[half] / of(2)[half] - 4.0).abs() < 0.1, "{counts:?}");
        }
        let paths: f64 = (0..16).map(|block| 8.0 * of(block).iter().sum::<f64>()).sum();
        assert!(paths <= 10.0 * now && paths > 9.8 * now, "{paths} of {now}");
        let few = film.allocate(&shares, &Growth { error: 0.5, least: 1.2 * now, most: 4.0 * now });
        assert!(few.iter().all(|counts| counts.iter().all(|&count| count >= 32)), "{few:?}");
        let paths: u32 = few.iter().map(|counts| 8 * counts.iter().sum::<u32>()).sum();
        assert!((1.2..2.0).contains(&(f64::from(paths) / now)), "half the error takes less than twice the samples");
    }
}
