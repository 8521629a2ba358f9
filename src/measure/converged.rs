//! References that are renders themselves: so good that their noise hardly matters, and so honest that it is known.
//!
//! A reference is the mean of pictures of different seeds. Their spread says how noisy the mean still is, and that noise,
//! which adds to every error that is measured against it, can be taken off again.

use super::metrics::{floor, kept};

/// Pictures of one scene with different seeds, added up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Replicas {
    /// How many.
    pub count: u32,
    mean: Vec<[f64; 3]>,
    /// Sums of squared deviations from the mean.
    squares: Vec<[f64; 3]>,
}

impl Replicas {
    /// Takes in one more picture, which has as many pixels as those before (Welford 1962).
    pub fn push(&mut self, picture: &[[f32; 3]]) {
        if self.count == 0 {
            self.mean = vec![[0.0; 3]; picture.len()];
            self.squares = self.mean.clone();
        }
        debug_assert_eq!(self.mean.len(), picture.len(), "pictures of one size");
        self.count += 1;
        let n = f64::from(self.count);
        for ((mean, squares), rgb) in self.mean.iter_mut().zip(&mut self.squares).zip(picture) {
            for c in 0..3 {
                let x = f64::from(rgb[c]);
                let off = x - mean[c];
                mean[c] += off / n;
                squares[c] += off * (x - mean[c]);
            }
        }
    }

    /// What [`Converged`] was made of, but for rounding; it can grow further.
    pub fn resume(converged: &Converged, count: u32) -> Self {
        let n = f64::from(count);
        let wide = |rgb: &[f32; 3]| rgb.map(f64::from);
        Self {
            count,
            mean: converged.mean.iter().map(wide).collect(),
            squares: converged.standard_error.iter().map(|e| wide(e).map(|e| e * e * n * (n - 1.0))).collect(),
        }
    }

    /// The mean and its standard error; of fewer than two pictures that is not known, and not a number.
    pub fn converged(&self) -> Converged {
        let n = f64::from(self.count);
        Converged {
            mean: self.mean.iter().map(|rgb| rgb.map(|c| c as f32)).collect(),
            standard_error: self.squares.iter().map(|s| s.map(|s| (s / (n * (n - 1.0))).sqrt() as f32)).collect(),
        }
    }
}

/// A reference with the noise that is left in it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Converged {
    /// The picture.
    pub mean: Vec<[f32; 3]>,
    /// Estimated standard error of its values.
    pub standard_error: Vec<[f32; 3]>,
}

impl Converged {
    /// Expected relMSE of the reference itself, without the worst `share` of its pixels.
    pub fn noise(&self, share: f64) -> f64 {
        let mut noise: Vec<f64> = self.pixels(&self.mean).map(|[_, noise]| noise).collect();
        let kept = kept(noise.len(), share);
        noise.sort_unstable_by(f64::total_cmp);
        noise[..kept].iter().sum::<f64>() / kept as f64
    }

    /// [`rel_mse_trimmed`](super::metrics::rel_mse_trimmed) of a picture against the truth, of which the reference is an
    /// estimate: what it would measure, less what the noise of the reference adds to that.
    ///
    /// The picture must have other seeds than the reference: then E (x − r)² = E (x − t)² + E (r − t)². An estimate of a
    /// small error may be below zero. What is left is that relative errors are relative to a noisy number, which matters
    /// less than the noise of the reference does before it is taken off, by a factor of the error itself.
    pub fn rel_mse(&self, picture: &[[f32; 3]], share: f64) -> f64 {
        let mut pixels: Vec<[f64; 2]> = self.pixels(picture).collect();
        let kept = kept(pixels.len(), share);
        if kept < pixels.len() {
            pixels.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
        }
        pixels[..kept].iter().map(|[error, noise]| error - noise).sum::<f64>() / kept as f64
    }

    /// Each pixel's relative error against the reference, and that of the reference: means over channels.
    fn pixels<'a>(&'a self, picture: &'a [[f32; 3]]) -> impl Iterator<Item = [f64; 2]> + 'a {
        debug_assert_eq!(self.mean.len(), picture.len(), "pictures of one size");
        let floor = floor(&self.mean);
        let relative = move |squared: f64, r: f64| if squared == 0.0 { 0.0 } else { squared / (r * r + floor) };
        picture.iter().zip(&self.mean).zip(&self.standard_error).map(move |((x, r), e)| {
            let mut sums = [0.0; 2];
            for c in 0..3 {
                let (x, r, e) = (f64::from(x[c]), f64::from(r[c]), f64::from(e[c]));
                sums[0] += relative((x - r) * (x - r), r) / 3.0;
                sums[1] += relative(e * e, r) / 3.0;
            }
            sums
        })
    }
}

#[cfg(test)]
mod tests {
    use std::{f32::consts::TAU, num::Wrapping};

    use super::*;
    use crate::{
        measure::{
            metrics::{TRIMMED, rel_mse, rel_mse_trimmed},
            student::Estimate,
        },
        render::SamplerKind,
        sampling::Sampler,
    };

    const PIXELS: u32 = 20_000;

    /// From dark to bright, in three colours.
    fn truth() -> Vec<[f32; 3]> {
        (0..PIXELS).map(|i| [0.02, 0.2, 1.0].map(|c| c * (1.0 + (i % 100) as f32))).collect()
    }

    /// The truth with normal noise of so much of each value: picture `seed` of a renderer.
    fn noisy(truth: &[[f32; 3]], seed: u64, amount: f32) -> Vec<[f32; 3]> {
        let sampler = Sampler::new(SamplerKind::Independent, seed);
        let normal = |pixel: u32, c: u32| {
            let (u, v) = sampler.pair::<f32>(Wrapping(sampler.pixel_hash(pixel, 0)), Wrapping(0), Wrapping(c));
            (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
        };
        let pixel = |(i, rgb): (usize, &[f32; 3])| {
            std::array::from_fn(|c| rgb[c] * (1.0 + amount * normal(i as u32, c as u32)))
        };
        truth.iter().enumerate().map(pixel).collect()
    }

    fn reference(truth: &[[f32; 3]], count: u32, first_seed: u64, amount: f32) -> Converged {
        let mut replicas = Replicas::default();
        (0..count).for_each(|i| replicas.push(&noisy(truth, first_seed + u64::from(i), amount)));
        replicas.converged()
    }

    /// Runs with noise σ against references with noise up to σ: with the noise taken off, the mean error over seeds is
    /// that against the truth, and without it is not. The significance is 1e-4 each.
    #[test]
    fn what_a_reference_adds_to_errors_is_taken_off_again() {
        let truth = truth();
        for (replicas, amount) in [(2, 0.05), (4, 0.1), (8, 0.2)] {
            for share in [0.0, TRIMMED] {
                let mut plain = Vec::new();
                let differences = (0..12).map(|seed| {
                    let reference = reference(&truth, replicas, 1_000_000 + 100 * seed, amount);
                    let run = noisy(&truth, seed, 0.1);
                    let want = rel_mse_trimmed(&run, &truth, share);
                    plain.push(rel_mse_trimmed(&run, &reference.mean, share) / want);
                    reference.rel_mse(&run, share) / want - 1.0
                });
                let off = Estimate::of(differences);
                // The weights 1/r² are noisy too. With variances s² of the run and v of the reference, in units of the
                // truth, E ((s − e)² − v)/(1 + e)² = s² (1 + 3v) + 6v² to the order of v². Which pixels are left out is
                // chosen a little differently as well.
                let (s2, v) = (0.01, f64::from(amount * amount) / f64::from(replicas));
                let [from, to] = off.interval(1.0 - 1e-4);
                let weights = 3.0 * v + 6.0 * v * v / s2;
                assert!(from < weights + 0.005 && to > -0.005, "{replicas} {share}: {off:?}");
                assert!(to - from < 0.08, "{off:?} says nothing");
                let want = v / s2;
                let added = Estimate::of(plain).value - 1.0;
                assert!((added / want - 1.0).abs() < 0.15, "{replicas} {share}: {added} for {want}");
            }
        }
    }

    /// The noise that a reference says it has is its relMSE against the truth.
    #[test]
    fn a_reference_knows_its_own_noise() {
        let truth = truth();
        for (replicas, share) in [(2, 0.0), (8, 0.0), (8, TRIMMED)] {
            let ratios = (0..8).map(|i| {
                let reference = reference(&truth, replicas, 500 + 20 * i, 0.05);
                reference.noise(share) / rel_mse_trimmed(&reference.mean, &truth, share)
            });
            let ratio = Estimate::of(ratios);
            // Trimming takes the greatest errors from one and the greatest estimates from the other.
            assert!((ratio.value - 1.0).abs() < if share > 0.0 { 0.03 } else { 0.02 }, "{replicas} {share}: {ratio:?}");
        }
    }

    #[test]
    fn without_noise_nothing_is_taken_off() {
        let truth = truth();
        let exact = reference(&truth, 2, 1, 0.0);
        let run = noisy(&truth, 7, 0.3);
        assert_eq!((exact.noise(0.0), exact.rel_mse(&truth, 0.0)), (0.0, 0.0));
        assert!((exact.rel_mse(&run, 0.0) / rel_mse(&run, &truth) - 1.0).abs() < 1e-12);
        let trimmed = exact.rel_mse(&run, TRIMMED) / rel_mse_trimmed(&run, &truth, TRIMMED);
        assert!((trimmed - 1.0).abs() < 1e-12);
        assert!(exact.rel_mse(&vec![[f32::NAN; 3]; PIXELS as usize], 0.0).is_nan(), "nothing is hidden");
    }

    #[test]
    fn a_reference_goes_on_where_it_was_left() {
        let truth = truth();
        let mut first = Replicas::default();
        (0..3).for_each(|seed| first.push(&noisy(&truth, seed, 0.1)));
        let mut resumed = Replicas::resume(&first.converged(), first.count);
        for replicas in [&mut first, &mut resumed] {
            (3..5).for_each(|seed| replicas.push(&noisy(&truth, seed, 0.1)));
        }
        let [a, b] = [&first, &resumed].map(Replicas::converged);
        assert_eq!(first.count, resumed.count);
        assert!(rel_mse(&a.mean, &b.mean) < 1e-13 && rel_mse(&a.standard_error, &b.standard_error) < 1e-12);
    }
}
