//! How far a picture is from what it would converge to, from the spread of its replicas.
//!
//! Pixels of a block share work, so their errors may have to do with one another; those of different blocks and replicas
//! have not. So blocks are the units here: what is said of a sum over pixels rests on the differences between the
//! replicas' sums over blocks, and on nothing that takes pixels for independent.

use rayon::prelude::*;

use super::{BLOCK, Film, Tile, luminance};
use crate::{
    measure::student::{Estimate, student_factor},
    render::PartMean,
    sampling::REPLICAS,
};

/// Two pairs of replicas: the differences within the pairs have nothing to do with each other.
type Pairing = [[usize; 2]; 2];

/// All there are of four replicas. The first one is of the halves that decide about each other where blocks get samples
/// by their error: only within these are counts the same.
const PAIRINGS: [Pairing; 3] = [[[0, 2], [1, 3]], [[0, 1], [2, 3]], [[0, 3], [1, 2]]];

/// Share in the brightness that an error is relative to of those samples that the error is estimated by.
///
/// Of a lamp that fills the pixel to p and that a replica hits or not, p being anything between 0 and 1, the relative squared
/// error is ∫ (1 − p) p / 4(p + b)² dp, some 0.6 where all else is a hundredth as bright (b); the estimate is
/// 0.05/[`OWN`]² + 0.09. With 0.3 it would be right for these on average; but few pixels may rule a picture, and it is to be
/// too large rather than too small.
const OWN: f64 = 0.15;

/// What a film says about its own error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureError {
    /// Estimated relMSE against the picture that this one would converge to.
    pub relmse: f64,
    /// The relMSE is at most this with a probability of at least 95 %.
    pub upper95: f64,
    /// Means over the picture's pixels, nit, with how well they are known.
    pub mean: [Estimate; 3],
}

/// What is known of one block of pixels.
#[derive(Clone, Copy, Debug, Default)]
struct Block {
    /// Sums over pixels of the relative squared error.
    error: f64,
    /// Estimated variance of the difference between that and the true one.
    variance: f64,
}

impl Film {
    /// The error of the picture; `None` while a replica of some pixel has no sample.
    ///
    /// With means xᵣ of four replicas and t their expectation, the squared error e² of their mean x and the estimate
    /// v = Σ (xᵣ − x)²/12 differ by e² − v = Σ (xᵣ − t)(xₛ − t)/6 over pairs r < s. That has the expectation 0 and the
    /// variance V²/6, where V is that of one replica: fourth moments, which rare bright samples make large, are not in it.
    /// Summed over the pixels of a block with weights w, V² becomes the expectation of (Σ w (xₐ − t)(xᵦ − t))², of which
    /// (Σ w (x₀ − x₂)(x₁ − x₃))²/4 has four times the expectation, whatever the pixels have to do with one another.
    ///
    /// Nor does that know of pixels that a replica sees something bright in or does not. Whether one counts for much or nothing is
    /// then mostly chance, so that the square of what each counts for is added: nothing if all count alike.
    ///
    /// The difference between two replicas is weighed by what the other two say of the pixel: by what these two say, the
    /// pixels with the greatest errors, which are too bright, would count too little. But where the other two have not hit yet
    /// what these two have, such as the edge of a lamp, they would make it out to be dark, and a few such pixels count for more
    /// than all others together. So these two have a share of 0.15 in it, by which it may rise to what the other two say of
    /// the pixels around. Symmetric errors of a mean have nothing to do with the difference, so that this costs nothing else.
    ///
    /// Replicas are independent in pictures that are rendered to an error. In others they are parts of one sequence, which
    /// avoids the places where it has been: there the error is smaller than this says.
    pub fn error(&self) -> Option<PictureError> {
        if self.tiles.iter().any(|tile| tile.samples.contains(&0)) {
            return None;
        }
        let mean = self.mean(None).0;
        let floor = 0.01 * (mean.iter().map(|channel| channel.value).sum::<f64>() / 3.0).powi(2);
        let by_tile: Vec<Vec<Block>> =
            self.tiles.par_iter().enumerate().map(|(row, tile)| self.block_errors(row, tile, floor)).collect();
        let values = f64::from(self.window[2]) * f64::from(self.window[3]) * 3.0;
        let (mut error, mut variance, mut spread) = (0.0, 0.0, 0.0);
        for block in by_tile.iter().flatten() {
            error += block.error;
            variance += block.variance;
            spread += block.variance * block.variance;
        }
        let upper = if variance > 0.0 {
            // Satterthwaite's degrees of freedom, if each block's variance is known as well as one square is.
            let dof = (3.0 * variance * variance / spread - 2.0).max(1.0);
            // Squares have a longer tail above than below: their logarithm is nearer to normal.
            error * (student_factor(0.90, dof) * variance.sqrt() / error).exp()
        } else {
            error
        };
        Some(PictureError { relmse: error / values, upper95: upper / values, mean })
    }

    /// Means over the pixels of all light or of a part of it, each with the variance that the blocks' replicas show; and that of
    /// their luminance.
    pub fn mean(&self, part: Option<usize>) -> ([Estimate; 3], Estimate) {
        let sums: Vec<Vec<[Estimate; 4]>> = self
            .tiles
            .par_iter()
            .enumerate()
            .map(|(row, tile)| {
                let means = self.means_of(row, tile, part);
                let block = |pixels: &Vec<usize>| {
                    let sums: [[f64; 3]; REPLICAS] = std::array::from_fn(|replica| {
                        pixels.iter().fold([0.0; 3], |sum, &pixel| {
                            let x = means(pixel, replica);
                            std::array::from_fn(|c| sum[c] + x[c])
                        })
                    });
                    let channel = |c: usize| self.estimate(tile, sums.map(|sum| sum[c]));
                    [channel(0), channel(1), channel(2), self.estimate(tile, sums.map(luminance))]
                };
                self.blocks_of(tile).iter().map(block).collect()
            })
            .collect();
        let share = 1.0 / (f64::from(self.window[2]) * f64::from(self.window[3]));
        let all = |c: usize| Estimate::sum(sums.iter().flatten().map(|block| (share, block[c])));
        ([all(0), all(1), all(2)], all(3))
    }

    /// The means of all layers of light in parts, in their order.
    pub fn part_means(&self) -> Vec<PartMean> {
        let names = self.layers.iter().filter_map(|kind| kind.split());
        let names = names.flat_map(|split| {
            let first = self.splits.first_of(split);
            self.splits.names(split, &self.lights).into_iter().enumerate().map(move |(i, name)| (first + i, name))
        });
        let mean = |(part, layer)| {
            let (mean, luminance) = self.mean(Some(part));
            PartMean { layer, mean, luminance }
        };
        names.map(mean).collect()
    }

    /// What replicas say together.
    fn estimate(&self, tile: &Tile, means: [f64; REPLICAS]) -> Estimate {
        if self.adaptive {
            let half = |[a, b]: [usize; 2]| Estimate::of([means[a], means[b]]);
            return Estimate::sum(PAIRINGS[0].map(|pair| (0.5, half(pair))));
        }
        let weights = tile.weights(false);
        let value = (0..REPLICAS).map(|r| means[r] * weights[r] * f64::from(tile.samples[r])).sum();
        Estimate { value, ..Estimate::of(means) }
    }

    /// By pixel, how far the mean of all light or of a part of it is from what it would converge to, as a standard deviation, nit; infinite while a replica
    /// has no sample.
    pub(super) fn standard_errors<'a>(
        &'a self,
        row: usize,
        tile: &'a Tile,
        part: Option<usize>,
    ) -> impl Fn(usize) -> [f32; 3] + 'a {
        let means = self.means_of(row, tile, part);
        move |pixel| {
            if tile.samples.contains(&0) {
                return [f32::INFINITY; 3];
            }
            let x: [_; REPLICAS] = std::array::from_fn(|replica| means(pixel, replica));
            std::array::from_fn(|c| self.estimate(tile, x.map(|mean| mean[c])).variance.sqrt() as f32)
        }
    }

    /// By pixel and replica, means of all light or of a part of it, splats included.
    fn means_of<'a>(
        &'a self,
        row: usize,
        tile: &'a Tile,
        part: Option<usize>,
    ) -> impl Fn(usize, usize) -> [f64; 3] + 'a {
        let splatted = self.splatted(row, part);
        move |pixel, replica| {
            let mean = self.replica_mean(tile, part, pixel, replica);
            std::array::from_fn(|c| mean[c] + splatted(pixel, c)[replica])
        }
    }

    /// The mean of a pixel over the samples of one replica, but for splats.
    pub(super) fn replica_mean(&self, tile: &Tile, part: Option<usize>, pixel: usize, replica: usize) -> [f64; 3] {
        let scale = self.unit.value(1) / f64::from(tile.samples[replica]);
        tile.sums(part)[replica].0[pixel].map(|sum| sum as f64 * scale)
    }

    /// The pixels of each block that were asked for.
    fn blocks_of(&self, tile: &Tile) -> Vec<Vec<usize>> {
        let across = tile.width.div_ceil(BLOCK) as usize;
        let mut blocks = vec![Vec::new(); across * tile.height.div_ceil(BLOCK) as usize];
        for (pixel, _) in self.pixels_of(tile) {
            let (x, y) = (pixel % tile.width as usize, pixel / tile.width as usize);
            blocks[y / BLOCK as usize * across + x / BLOCK as usize].push(pixel);
        }
        blocks.retain(|pixels| !pixels.is_empty());
        blocks
    }

    fn block_errors(&self, row: usize, tile: &Tile, floor: f64) -> Vec<Block> {
        let means = self.means_of(row, tile, None);
        let pairings = if self.adaptive { &PAIRINGS[..1] } else { &PAIRINGS[..] };
        let weights = tile.weights(self.adaptive);
        let all: Vec<[[f64; 3]; REPLICAS]> =
            (0..tile.pixels()).map(|pixel| std::array::from_fn(|replica| means(pixel, replica))).collect();
        let around = Surroundings::of(tile, &all);
        // Share of a replica's mean in the pixel's.
        let share = |replica: usize| weights[replica] * f64::from(tile.samples[replica]);
        let of_block = |pixels: &Vec<usize>| {
            let (mut error, mut rare) = (0.0, 0.0);
            let mut products = [0.0; PAIRINGS.len()];
            for &pixel in pixels {
                let before = error;
                for c in 0..3 {
                    let (x, near) = (all[pixel].map(|mean| mean[c]), around.0[pixel].map(|mean| mean[c]));
                    for (pairing, product) in pairings.iter().zip(&mut products) {
                        let difference = pairing.map(|[a, b]| x[a] - x[b]);
                        let weight = pairing.map(|[a, b]| {
                            let other = (x[a] + x[b]) / 2.0;
                            let own = x.iter().sum::<f64>() / 2.0 - other;
                            let most = other.max((near[a] + near[b]) / 2.0);
                            let variance = (OWN * OWN + (1.0 - OWN) * (1.0 - OWN)) * (x[a] - x[b]).powi(2) / 4.0;
                            weight((OWN * own + (1.0 - OWN) * other).min(most), variance, floor)
                        });
                        for (i, [a, b]) in pairing.iter().enumerate() {
                            if difference[i] != 0.0 {
                                let shares = share(*a).powi(2) + share(*b).powi(2);
                                error += 0.5 * difference[i] * difference[i] * weight[1 - i] * shares;
                            }
                        }
                        if difference[0] != 0.0 && difference[1] != 0.0 {
                            *product += difference[0] * difference[1] * (weight[0] * weight[1]).sqrt();
                        }
                    }
                }
                rare += (error - before) * (error - before);
            }
            let count = pairings.len() as f64;
            rare /= count * count;
            // The squared variance of one replica.
            let squared = products.iter().map(|g| 0.25 * g * g).sum::<f64>() / count;
            let variance = if self.adaptive {
                // e² − v is here the sum of d₀d₂/4 and d₁d₃/4 within the halves and of four products across them, each an
                // eighth, d = x − t; variances fall as counts rise.
                let ratio = f64::from(tile.samples[0]) / f64::from(tile.samples[1]);
                squared * (ratio + 1.0 / ratio + 1.0) / 16.0
            } else {
                squared / 6.0
            };
            Block { error: error / count, variance: variance + rare }
        };
        self.blocks_of(tile).iter().map(of_block).collect()
    }
}

/// What a squared error counts where two replicas have these means: an estimate of w = 1 / (t² + floor).
///
/// At the mean x of the two it is too great on average, by w''/2 times the variance of x, of which their difference tells.
pub(super) fn relative([a, b]: [f64; 2], floor: f64) -> f64 {
    weight(0.5 * (a + b), 0.25 * (a - b) * (a - b), floor)
}

/// The same for an estimate of t with an estimated variance.
fn weight(t: f64, variance: f64, floor: f64) -> f64 {
    let squared = t * t;
    let weight = 1.0 / (squared + floor);
    weight / (1.0 + (3.0 * squared - floor).max(0.0) * weight * weight * variance)
}

/// By pixel of a tile and replica, the mean over the pixel and those of the tile that touch it.
struct Surroundings(Vec<[[f64; 3]; REPLICAS]>);

impl Surroundings {
    fn of(tile: &Tile, means: &[[[f64; 3]; REPLICAS]]) -> Self {
        let (width, height) = (tile.width as usize, tile.height as usize);
        let around = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
        let mean = |at: usize| {
            let (x, y) = (at % width, at / width);
            let mut sums = [[0.0; 3]; REPLICAS];
            let mut count = 0.0;
            for near in around(y, height).flat_map(|row| around(x, width).map(move |column| row * width + column)) {
                for (sum, mean) in sums.iter_mut().flatten().zip(means[near].iter().flatten()) {
                    *sum += mean;
                }
                count += 1.0;
            }
            sums.map(|sum| sum.map(|channel| channel / count))
        };
        Self((0..means.len()).map(mean).collect())
    }
}

#[cfg(test)]
mod tests {
    use std::{f64::consts::TAU, num::Wrapping};

    use super::*;
    use crate::{
        film::Unit,
        measure::statistics::{Moments, binomial_cdf},
        render::{RenderSettings, SamplerKind},
        sampling::Sampler,
        world::units::Nit,
    };

    const SIDE: u32 = 32;
    const TRIALS: u64 = 400;

    /// How pixels of a block err.
    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Errors {
        /// Each by itself, normally.
        Apart,
        /// All alike, normally.
        Together,
        /// All alike, and seldom but much.
        Rarely,
    }

    /// A film whose replicas have some samples each, and what it converges to: blocks of 16 brightnesses, errors of
    /// about 5 %.
    fn film(seed: u64, errors: Errors, samples: [u32; REPLICAS], adaptive: bool) -> (Film, Vec<[f32; 3]>) {
        let settings = RenderSettings {
            width: SIDE,
            height: SIDE,
            tile_size: if adaptive { BLOCK } else { SIDE },
            ..RenderSettings::default()
        };
        let unit = Unit::for_emission(Nit(10.0));
        let mut film = Film { adaptive, ..Film::new(&settings, unit) };
        let mut truth = vec![[0.0; 3]; (SIDE * SIDE) as usize];
        let sampler = Sampler::new(SamplerKind::Independent, seed);
        let places: Vec<Vec<(usize, usize)>> = film.tiles.iter().map(|tile| film.pixels_of(tile).collect()).collect();
        for (tile, places) in film.tiles.iter_mut().zip(places) {
            tile.samples = samples;
            for (pixel, at) in places {
                let (x, y) = (at as u32 % SIDE, at as u32 / SIDE);
                let block = y / BLOCK * (SIDE / BLOCK) + x / BLOCK;
                let t = 0.2 * (1.0 + f64::from(block)).sqrt();
                truth[at] = [t as f32; 3];
                for (replica, sums) in tile.replicas.iter_mut().enumerate() {
                    let who = if errors == Errors::Apart { 1000 + at as u32 } else { block };
                    let hash = Wrapping(sampler.pixel_hash(who, replica as u32));
                    let n = f64::from(samples[replica]);
                    let (u, v) = sampler.pair::<f32>(hash, Wrapping(0), Wrapping(0));
                    let (u, v) = (f64::from(u), f64::from(v));
                    let normal = (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos();
                    // Poisson with the mean 4: variance and third moment are 4 as well.
                    let mut rest = u - (-4f64).exp();
                    let mut term = (-4f64).exp();
                    let mut count = 0.0;
                    while rest > 0.0 && count < 40.0 {
                        count += 1.0;
                        term *= 4.0 / count;
                        rest -= term;
                    }
                    let off = if errors == Errors::Rarely { 0.5 * (count - 4.0) } else { normal };
                    let light = (t * (n + n.sqrt() * off)) as f32;
                    assert!(sums.add(unit, pixel, [light; 3]));
                }
            }
        }
        (film, truth)
    }

    /// The estimate is right on average, the bound above the truth and the mean in its interval in 95 % of the cases;
    /// all significances are 1e-4.
    #[track_caller]
    fn check(errors: Errors, samples: [u32; REPLICAS], adaptive: bool) {
        let (mut ratios, mut bounded, mut covered) = (Moments::default(), 0, 0);
        for seed in 0..TRIALS {
            let (film, truth) = film(seed, errors, samples, adaptive);
            let picture = film.resolve();
            let error = film.error().unwrap();
            // A pixel's error against its expectation, with weights that are exact.
            let relmse = crate::measure::metrics::rel_mse(&picture.rgb, &truth);
            let shares = film.tiles[0].weights(adaptive);
            let want: f64 = shares.iter().zip(samples).map(|(w, n)| w * w * f64::from(n)).sum();
            let mean = truth.iter().map(|rgb| f64::from(rgb[0])).sum::<f64>() / truth.len() as f64;
            let weights: f64 = truth
                .iter()
                .map(|rgb| f64::from(rgb[0]).powi(2) / (f64::from(rgb[0]).powi(2) + 0.01 * mean * mean))
                .sum::<f64>()
                / truth.len() as f64;
            ratios.push(error.relmse / (want * weights));
            bounded += u64::from(relmse <= error.upper95);
            let [from, to] = error.mean[1].interval(0.95);
            covered += u64::from((from..=to).contains(&mean));
        }
        println!("{errors:?} {samples:?} {adaptive}: {ratios:?} {bounded} {covered}");
        // The weights are estimated as well: their error is a few squared errors.
        let off = (ratios.mean - 1.0).abs();
        assert!(off < 4.0 * ratios.standard_error() + 0.02, "{errors:?} {adaptive}: {ratios:?}");
        assert!(binomial_cdf(bounded, TRIALS, 0.94) > 1e-4, "{errors:?} {adaptive}: {bounded}");
        assert!(binomial_cdf(covered, TRIALS, 0.94) > 1e-4, "{errors:?} {adaptive}: {covered}");
        assert!(binomial_cdf(TRIALS - covered, TRIALS, 0.04) > 1e-4, "{errors:?} {adaptive}: {covered}");
    }

    #[test]
    fn pictures_know_their_error_whatever_pixels_of_a_block_share() {
        for errors in [Errors::Apart, Errors::Together, Errors::Rarely] {
            check(errors, [100; REPLICAS], false);
            check(errors, [100; REPLICAS], true);
            check(errors, [150, 50, 150, 50], true);
        }
    }

    #[test]
    fn errors_are_not_known_before_each_replica_has_a_sample() {
        let (mut film, _) = film(0, Errors::Apart, [1; REPLICAS], false);
        assert!(film.error().is_some());
        film.tiles[0].samples[3] = 0;
        assert_eq!(film.error(), None);
    }
}
