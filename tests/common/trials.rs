//! Estimates against the numbers that a formula gives them, judged as one family.

use std::{fmt::Write, ops::Range};

use rayon::prelude::*;
use wavecast::{
    measure::{
        statistics::{Moments, sidak},
        student::student_two_sided,
    },
    render::{RenderSettings, Renderer},
    world::Scene,
};

/// How far a mean may be from the truth at most, as a share of it.
pub const TOLERANCE: f64 = 1e-3;

/// What rounding in f32 along a path may cost, as a share of the truth. It matters where there is no noise to hide it.
const ROUNDING: f64 = 1e-5;

/// A number that a formula gives, and independent estimates of it.
#[derive(Clone, Debug)]
pub struct Trial {
    /// What is measured.
    pub name: String,
    /// What the formula gives; not zero.
    pub truth: f64,
    /// What the pictures of different seeds give.
    pub got: Moments,
}

impl Trial {
    /// (mean − truth) / truth.
    pub fn relative_error(&self) -> f64 {
        self.got.mean / self.truth - 1.0
    }

    /// Standard error of the mean as a share of the truth.
    pub fn relative_noise(&self) -> f64 {
        self.got.standard_error() / self.truth
    }

    /// Distance from the truth in standard errors.
    pub fn t(&self) -> f64 {
        self.relative_error() / self.relative_noise().hypot(ROUNDING)
    }

    /// Probability of a distance like this if the truth is the expectation.
    pub fn p(&self) -> f64 {
        student_two_sided(self.t(), (self.got.count - 1) as f64)
    }
}

/// Judges all trials together: with probability 1 − `alpha` a family without error passes.
///
/// # Errors
/// The table of all trials with those that failed marked: mean off by more than [`TOLERANCE`], or by more than chance.
pub fn check_family(trials: &[Trial], alpha: f64) -> Result<String, String> {
    let level = sidak(alpha, trials.len());
    let mut table =
        format!("{:60} {:>12} {:>12} {:>9} {:>9} {:>6} {:>8}\n", "", "truth", "mean", "error", "noise", "t", "p");
    let mut failed = 0;
    for trial in trials {
        let sound = trial.relative_error().abs() <= TOLERANCE && trial.p() >= level;
        failed += usize::from(!sound);
        let [truth, mean, error, noise] =
            [trial.truth, trial.got.mean, 100.0 * trial.relative_error(), 100.0 * trial.relative_noise()];
        let (t, p, mark) = (trial.t(), trial.p(), if sound { "" } else { " FAILED" });
        writeln!(table, "{:60} {truth:12.6} {mean:12.6} {error:8.4}% {noise:8.4}% {t:6.2} {p:8.5}{mark}", trial.name)
            .expect("a string takes it");
    }
    writeln!(table, "{failed} of {} failed, level of each {level:.2e}", trials.len()).expect("a string takes it");
    if failed == 0 { Ok(table) } else { Err(table) }
}

/// Samples times `EVIDENCE_SCALE` of the environment, for a longer look.
pub fn scaled(spp: u32) -> u32 {
    spp * std::env::var("EVIDENCE_SCALE").ok().and_then(|scale| scale.parse().ok()).unwrap_or(1)
}

/// The mean over all pixels of a picture for each seed, by channel.
///
/// # Panics
/// If the scene is not sound, or a sample was discarded.
#[track_caller]
pub fn means(scene: &mut Scene, settings: &RenderSettings, seeds: Range<u64>) -> Vec<[f64; 3]> {
    let mut renderer = Renderer::new();
    let report = renderer.sync(scene);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let mean_of = |seed| {
        // Small pictures have too few tiles for several threads, so each has one.
        let rendered = renderer.render(&RenderSettings { seed, threads: 1, ..settings.clone() }, &());
        assert_eq!(rendered.stats.discarded, []);
        super::mean(&rendered)
    };
    seeds.into_par_iter().map(mean_of).collect()
}
