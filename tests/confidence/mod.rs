//! What pictures say of their own error is true as often as they say.

use rayon::prelude::*;
use wavecast::{
    film::{LayerData, PictureError},
    load::load_environment,
    measure::student::student_factor,
    measure::{
        converged::{Converged, Replicas},
        statistics::binomial_cdf,
    },
    render::{LayerKind, RenderSettings, RenderStats, Rendered, Renderer},
    world::{Environment, Sky},
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
        let folder = root().join("scenes");
        let mut world = load_scene(&folder.join(scene));
        if scene == "outdoor.gltf" {
            let (sky, _) = load_environment(&folder.join("sky.hdr")).expect("the sky is sound");
            world.spawn((Environment { sky: Sky::Map(sky.into()), rotation_degrees: 0.0, scale: 1.0 },));
        }
        renderer.sync(&mut world);
        // Each has one thread: pictures are many, and small.
        let layers = vec![LayerKind::Error];
        let settings =
            RenderSettings { width: 32, height: 32, spp: None, threads: 1, layers, ..RenderSettings::default() };
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
/// intervals for the mean hold it in 93 % to 97 % of the cases; both as far as chance lets one say. Of diffuse scenes' pixels, of
/// which there are a hundred thousand, as many are in their intervals.
#[track_caller]
fn check_confidence(scene: &str, target: f64, trials: u32, reference: (u64, u32)) {
    // Where light is smooth: rare bright samples make pixels look surer than they are.
    let pixels_too = ["cornell.gltf", "million.glb", "door.gltf"].contains(&scene);
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

    let (mut met, mut covered, mut bounded, mut pixels_covered) = (0, [0; 3], 0, 0.0);
    let factor = student_factor(0.95, 2.0);
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
        let LayerData::Rgb(errors) = &picture.layers[0].data else { panic!("an error for each channel") };
        let off = |pixel: usize, c: usize| f64::from(picture.rgb[pixel][c] - truth.mean[pixel][c]).abs();
        // But for rounding.
        let known = |pixel: usize, c: usize| {
            f64::from(errors[pixel][c].hypot(truth.standard_error[pixel][c]).max(1e-6 * picture.rgb[pixel][c]))
        };
        let values = (0..picture.rgb.len()).flat_map(|pixel| (0..3).map(move |c| (pixel, c)));
        let inside = values.filter(|&(pixel, c)| off(pixel, c) <= factor * known(pixel, c)).count();
        pixels_covered += inside as f64 / (3.0 * pixels * count);
        spp += stats.spp / count;
        estimated += error.relmse / count;
        actual += relmse / count;
    }
    println!(
        "{scene} to {target}: {met} of {trials} met it, {bounded} below the bound, mean covered {covered:?}, off by {off:?}; \
         {:.2} % of pixels covered; {spp:.1} spp, relMSE {estimated:.3e} estimated, {actual:.3e} true, {:.1e} of the reference",
        100.0 * pixels_covered,
        truth.noise(0.0)
    );
    if pixels_too {
        assert!((0.93..0.97).contains(&pixels_covered), "{scene}: {pixels_covered} of the pixels in their intervals");
    }
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

/// One scene of each class of light there is, small and coarse: there, few pixels rule what the error is.
#[test]
fn every_class_of_scene_is_honest() {
    for (scene, target, trials) in [
        ("plates.gltf", 0.4, 30),
        ("caustic.glb", 0.2, 50),
        ("lights.glb", 0.4, 30),
        ("outdoor.gltf", 0.1, 100),
        ("door.gltf", 0.3, 50),
        ("million.glb", 0.15, 50),
    ] {
        check_confidence(scene, target, trials, (8, 512));
    }
}
