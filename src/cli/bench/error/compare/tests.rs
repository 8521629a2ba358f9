//! Comparisons of tables that are made up: what is called changed if nothing has, and what is found if something has.

use std::num::Wrapping;

use wavecast::{render::SamplerKind, sampling::Sampler};

use super::*;

/// How much renders differ from seed to seed.
#[derive(Clone, Copy)]
struct Noise {
    /// Standard deviation of the logarithm of the time.
    seconds: f64,
    /// Of relMSE, for the pixels that are left without the worst.
    trimmed: f64,
    /// Of what the worst pixels add to it: the distribution has a heavy tail.
    fireflies: f64,
}

/// A machine that others use as well, and a scene with a few fireflies.
const ORDINARY: Noise = Noise { seconds: 0.05, trimmed: 0.02, fireflies: 0.2 };

/// Tables of one build with `seeds` renders of 16, 64 and 256 samples, `slower` and `noisier` by these factors.
fn table(experiment: u64, scenes: u32, seeds: u32, noise: Noise, slower: f64, noisier: f64) -> Vec<Measured> {
    let sampler = Sampler::new(SamplerKind::Independent, experiment);
    let mut all = Vec::new();
    for scene in 0..scenes {
        for (place, spp) in [16_u32, 64, 256].into_iter().enumerate() {
            for seed in 0..seeds {
                let pair = |i: u32| {
                    sampler.pair::<f32>(Wrapping(sampler.pixel_hash(scene, seed)), Wrapping(place as u32), Wrapping(i))
                };
                let normal = |i: u32| {
                    let (u, v) = pair(i);
                    (-2.0 * (1.0 - f64::from(u)).ln()).sqrt() * (std::f64::consts::TAU * f64::from(v)).cos()
                };
                let trimmed = noisier * 2.0 / f64::from(spp) * (noise.trimmed * normal(0)).exp();
                // Pareto with exponent 2: the variance is infinite, as that of fireflies may be.
                let fireflies = noise.fireflies / (1.0 - f64::from(pair(1).0)).sqrt();
                all.push(Measured {
                    scene: format!("scene {scene}"),
                    key: scene.to_string(),
                    threads: 1,
                    spp,
                    seconds: slower * 0.01 * f64::from(spp) * (noise.seconds * normal(2)).exp(),
                    relmse: [trimmed * (1.0 + fireflies), trimmed],
                });
            }
        }
    }
    all
}

fn compare(old: &[Measured], new: &[Measured], significance: f64, tolerance: f64) -> Comparison {
    let console = &mut Console::new(true, false);
    Comparison::new(Path::new("old.csv"), old, new, significance, tolerance, console).unwrap()
}

/// How many of `trials` comparisons fail.
fn losses(trials: u64, seeds: u32, significance: f64, slower: f64, noisier: f64) -> u64 {
    let lost = |trial: &u64| {
        let old = table(2 * trial, 7, seeds, ORDINARY, 1.0, 1.0);
        let new = table(2 * trial + 1, 7, seeds, ORDINARY, slower, noisier);
        compare(&old, &new, significance, 0.0).verdict().is_err()
    };
    (0..trials).filter(lost).count() as u64
}

/// Seven scenes, both statistics, nothing has changed. Of the comparisons at most 5 % may call any of it changed, so
/// that at most 2.5 % may fail; with 1000 trials the 99.9 % quantile of the binomial distribution is 41.
#[test]
fn equal_builds_are_seldom_told_apart() {
    for seeds in [3, 5] {
        let failed = losses(1000, seeds, 0.05, 1.0, 1.0);
        assert!(failed <= 41, "{seeds} seeds: {failed} of 1000");
        // Nor is the test so careful that it sees nothing, or the tables all the same.
        assert!(failed >= 1, "{seeds} seeds: none of 1000");
    }
}

/// With five seeds and the default significance, comparisons fail if all scenes take 15 % longer or are 15 % noisier (of
/// 10 % they notice 19 in 20), and do not if twice the speed pays for half as much noise again.
#[test]
fn slower_and_noisier_builds_are_caught() {
    assert!(losses(100, 5, 0.01, 1.15, 1.0) >= 99);
    assert!(losses(100, 5, 0.01, 1.0, 1.15) >= 99);
    assert_eq!(losses(100, 5, 0.01, 0.5, 1.5), 0, "noisier, but so fast that it pays");
}

/// What is said of efficiency, error and time when one of seven scenes gets slower, or noisier.
#[test]
fn changes_are_told_by_what_they_are() {
    let old = table(1, 7, 5, ORDINARY, 1.0, 1.0);
    let change = |of: fn(&mut Measured)| {
        let mut new = table(2, 7, 5, ORDINARY, 1.0, 1.0);
        new.iter_mut().filter(|it| it.key == "3").for_each(of);
        compare(&old, &new, 0.01, 0.0)
    };
    let (same, better, worse) = (Verdict::Same, Verdict::Better, Verdict::Worse);
    for (comparison, want) in [
        (change(|it| it.seconds *= 1.5), [worse, same, worse]),
        (change(|it| it.seconds *= 0.5), [better, same, better]),
        (change(|it| it.relmse[1] *= 1.5), [worse, worse, same]),
        (change(|it| it.relmse[1] /= 2.0), [better, better, same]),
        (change(|it| (it.seconds, it.relmse[1]) = (0.5 * it.seconds, 2.0 * it.relmse[1])), [same, worse, better]),
    ] {
        for change in &comparison.changes {
            let want = if change.scene == "scene 3" && change.statistic == 1 { want } else { [same; 3] };
            let fits = |i: usize| change.verdicts[i] == want[i] || change.statistic == 0 && change.scene == "scene 3";
            assert!((0..3).all(fits), "{change:?}");
            assert_eq!(change.spp, [64, 256], "16 is less than a tenth of what both have");
        }
        let lost = comparison.verdict().is_err();
        assert_eq!(lost, comparison.changes.iter().any(|change| change.verdicts[0] == worse));
    }
    let error = change(|it| it.seconds *= 1.5).verdict().unwrap_err();
    assert_eq!(error.to_string(), "less efficient than old.csv, beyond the noise: scene 3");
    assert_eq!(error.exit_code(), 1);
}

/// Fireflies that only the plain figure shows are a loss.
#[test]
fn fireflies_are_a_loss_though_the_trimmed_figure_is_as_it_was() {
    let old = table(5, 1, 5, ORDINARY, 1.0, 1.0);
    let new = table(6, 1, 5, Noise { fireflies: 3.0, ..ORDINARY }, 1.0, 1.0);
    let comparison = compare(&old, &new, 0.01, 0.0);
    let verdicts: Vec<_> = comparison.changes.iter().map(|change| change.verdicts[0]).collect();
    assert_eq!(verdicts, [Verdict::Worse, Verdict::Same]);
}

#[test]
fn what_is_tolerated_is_no_change() {
    let still = Noise { seconds: 1e-4, trimmed: 1e-4, fireflies: 0.0 };
    let (old, new) = (table(1, 1, 5, still, 1.0, 1.0), table(2, 1, 5, still, 1.04, 1.0));
    assert!(compare(&old, &new, 0.01, 0.0).verdict().is_err());
    assert!(compare(&old, &new, 0.01, 0.05).verdict().is_ok());
    assert!(compare(&old, &new, 0.01, 0.03).verdict().is_err());
}

/// Pictures that are no longer numbers are worse, whatever statistics say; those that never were, or errors below what the
/// reference can tell, are neither.
#[test]
fn what_is_not_a_number_is_not_overlooked() {
    let old = table(1, 1, 5, ORDINARY, 1.0, 1.0);
    let mut new = table(2, 1, 5, ORDINARY, 1.0, 1.0);
    let last = new.len() - 1;
    new[last].relmse[0] = f64::NAN;
    let verdicts = |old: &[Measured], new: &[Measured]| -> Vec<Verdict> {
        compare(old, new, 0.01, 0.0).changes.iter().map(|change| change.verdicts[0]).collect()
    };
    assert_eq!(verdicts(&old, &new), [Verdict::Worse, Verdict::Same]);
    assert_eq!(verdicts(&new, &new), [Verdict::Unknown, Verdict::Same]);
    new[last].relmse[0] = -1e-9;
    assert_eq!(verdicts(&old, &new), [Verdict::Unknown, Verdict::Same]);
}

/// Only equal scenes with equal settings, and numbers of samples that both have.
#[test]
fn only_what_both_have_is_compared() {
    let old = table(1, 2, 5, ORDINARY, 1.0, 1.0);
    let mut new = table(2, 3, 5, ORDINARY, 1.0, 1.0);
    new.iter_mut().filter(|it| it.scene == "scene 1").for_each(|it| it.key = "other settings".into());
    new.retain(|it| it.spp < 256);
    let console = &mut Console::new(true, false);
    let comparison = Comparison::new(Path::new("old.csv"), &old, &new, 0.01, 0.0, console).unwrap();
    assert_eq!(comparison.changes.len(), 2);
    assert!(comparison.changes.iter().all(|change| change.scene == "scene 0" && change.spp == [16, 64]));
    // Two intervals hold together with 99 %.
    assert!((comparison.changes[0].confidence.powi(2) - 0.99).abs() < 1e-12);
    let said = console.warnings().join("\n");
    assert!(said.contains("scene 1: cannot be compared: old.csv has it with other settings"), "{said}");
    assert!(said.contains("scene 2: cannot be compared: old.csv does not have it"), "{said}");
    let none = Comparison::new(Path::new("old.csv"), &old, &new[new.len() - 5..], 0.01, 0.0, console);
    assert!(none.unwrap_err().to_string().starts_with("nothing to compare with old.csv"));
}

#[test]
fn probabilities_and_percentages_are_read_as_the_help_writes_them() {
    assert_eq!((probability("0.01"), percent("5%"), percent("0 %")), (Ok(0.01), Ok(0.05), Ok(0.0)));
    for text in ["", "0", "1", "2", "nan", "x"] {
        assert!(probability(text).is_err(), "{text}");
    }
    for text in ["", "5", "-1%", "100%", "nan%"] {
        assert!(percent(text).is_err(), "{text}");
    }
}
