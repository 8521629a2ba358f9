//! What pictures say of their own error is true as often as they say.

use rayon::prelude::*;
use wavecast::{
    film::PictureError,
    measure::{
        converged::{Converged, Replicas},
        statistics::binomial_cdf,
    },
    render::{RenderSettings, RenderStats, Rendered, Renderer},
};

use crate::common::{load_scene, root, trials::scaled};

/// A right renderer fails a check with a smaller probability than this.
const FALSE_ALARM: f64 = 1e-3;

/// Pictures of one scene.
struct Case {
    renderer: Renderer,
    settings: RenderSettings,
}

impl Case {
    fn new(scene: &str) -> Self {
        let mut renderer = Renderer::new();
        renderer.sync(&mut load_scene(&root().join("scenes").join(scene)));
        // Each has one thread: pictures are many, and small.
        let settings = RenderSettings { width: 32, height: 32, spp: None, threads: 1, ..RenderSettings::default() };
        Self { renderer, settings }
    }

    fn render(&self, settings: &RenderSettings) -> Rendered {
        let rendered = self.renderer.render(settings, &());
        assert_eq!(rendered.stats.discarded, []);
        rendered
    }

    /// Evenly sampled, with seeds that no trial has.
    fn reference(&self, pictures: u64, spp: u32) -> Converged {
        let settings = |i| RenderSettings { seed: 1_000_000 + i, spp: Some(spp), ..self.settings.clone() };
        let all: Vec<_> = (0..pictures).into_par_iter().map(|i| self.render(&settings(i)).picture.rgb).collect();
        let mut replicas = Replicas::default();
        all.iter().for_each(|picture| replicas.push(picture));
        replicas.converged()
    }

    /// Rendered to an error with seeds from 1 on.
    fn trials(&self, error: f64, count: u32) -> Vec<Rendered> {
        let settings = |seed| RenderSettings { seed, error: Some(error), ..self.settings.clone() };
        (1..=u64::from(count)).into_par_iter().map(|seed| self.render(&settings(seed))).collect()
    }
}

fn error_of(stats: &RenderStats) -> PictureError {
    stats.error.expect("there are samples enough")
}

/// Renders `trials` pictures to an error. That of at least 95 % of them must be as small as was asked for, and the
/// intervals for the mean hold it in 93 % to 97 % of the cases; both as far as chance lets one say.
#[track_caller]
fn check_confidence(scene: &str, target: f64, trials: u32, reference: (u64, u32)) {
    let case = Case::new(scene);
    let trials = scaled(trials);
    let truth = case.reference(reference.0, reference.1);
    let rendered = case.trials(target, trials);
    let pixels = truth.mean.len() as f64;
    let true_mean: [f64; 3] =
        std::array::from_fn(|c| truth.mean.iter().map(|rgb| f64::from(rgb[c])).sum::<f64>() / pixels);
    let mean_error: [f64; 3] = std::array::from_fn(|c| {
        truth.standard_error.iter().map(|rgb| f64::from(rgb[c]).powi(2)).sum::<f64>().sqrt() / pixels
    });

    let (mut met, mut covered, mut bounded) = (0, [0; 3], 0);
    let (mut spp, mut estimated, mut actual, mut off) = (0.0, 0.0, 0.0, [0.0; 3]);
    let count = f64::from(trials);
    for Rendered { picture, stats } in &rendered {
        let error = error_of(stats);
        let relmse = truth.rel_mse(&picture.rgb, 0.0);
        met += u64::from(relmse <= target * target);
        bounded += u64::from(relmse <= error.upper95);
        for c in 0..3 {
            // The reference is not known exactly either.
            let estimate = wavecast::measure::student::Estimate {
                variance: error.mean[c].variance + mean_error[c].powi(2),
                ..error.mean[c]
            };
            let [from, to] = estimate.interval(0.95);
            covered[c] += u64::from((from..=to).contains(&true_mean[c]));
            off[c] += (error.mean[c].value / true_mean[c] - 1.0) / count;
        }
        spp += stats.spp / count;
        estimated += error.relmse / count;
        actual += relmse / count;
    }
    println!(
        "{scene} to {target}: {met} of {trials} met it, {bounded} below the bound, mean covered {covered:?}, off by {off:?}; \
         {spp:.1} spp, relMSE {estimated:.3e} estimated, {actual:.3e} true, {:.1e} of the reference",
        truth.noise(0.0)
    );
    let trials = u64::from(trials);
    assert!(binomial_cdf(met, trials, 0.95) > FALSE_ALARM, "{scene}: {met} of {trials} met {target}");
    for covered in covered {
        assert!(
            binomial_cdf(covered, trials, 0.93) > FALSE_ALARM / 6.0,
            "{scene}: {covered} of {trials} hold the mean"
        );
        let outside = trials - covered;
        assert!(
            binomial_cdf(outside, trials, 0.03) > FALSE_ALARM / 6.0,
            "{scene}: {covered} of {trials} hold the mean"
        );
    }
}

#[test]
fn the_error_asked_for_is_met_and_intervals_hold_the_mean() {
    check_confidence("cornell.gltf", 0.05, 100, (8, 1024));
}

#[test]
fn coarse_pictures_are_as_honest_as_fine_ones() {
    check_confidence("cornell.gltf", 0.2, 100, (8, 512));
}
