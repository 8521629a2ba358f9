//! The wavefront against the reference, which shares its tables and this page of agreement, `docs/model.md`, and no code.

mod scenes;

use std::{fs, path::PathBuf, sync::Arc};

use glam::DVec3;
use wavecast::{
    film::{self, Picture, WriteOptions},
    flat::FlatScene,
    load::load_environment,
    measure::{
        statistics::{Moments, normal_two_sided, sidak},
        student::student_two_sided,
    },
    reference::{self, ReferenceSettings},
    render::{PixelFilter, RenderSettings, Renderer, SamplerKind, Sharing},
    wavefront,
    world::{Environment, Material, Scene, SceneKey, Sky},
};

use crate::common::{asset, load_scene, look, root, trials::scaled};

/// What rounding to f32 may change in a pixel, as a share of it.
const ROUNDING: f64 = 1e-4;
/// Significance of a family of pixels.
const ALPHA: f64 = 0.01;
/// Share of pixel channels that may fail nevertheless: all three of one pixel of the smallest pictures.
const MAY_FAIL: f64 = 0.005;
/// Wavefront pictures of different seeds.
const PICTURES: u32 = 16;

/// Means of a picture's channels and the variance of those means, with its degrees of freedom.
struct Estimate {
    mean: Vec<[f64; 3]>,
    variance: Vec<[f64; 3]>,
    freedom: f64,
}

/// The mean of `PICTURES` wavefront pictures.
fn by_wavefront(flat: &FlatScene, settings: &RenderSettings) -> Estimate {
    let pictures: Vec<_> = (0..u64::from(PICTURES))
        .map(|seed| {
            let rendered = wavefront::render(flat, &RenderSettings { seed: 70 + seed, ..settings.clone() }, &());
            assert_eq!(rendered.stats.discarded, []);
            rendered.picture.rgb
        })
        .collect();
    let moments = |pixel: usize| -> [Moments; 3] {
        std::array::from_fn(|channel| pictures.iter().map(|rgb| f64::from(rgb[pixel][channel])).collect())
    };
    let moments: Vec<[Moments; 3]> = (0..pictures[0].len()).map(moments).collect();
    Estimate {
        mean: moments.iter().map(|m| m.map(|m| m.mean)).collect(),
        variance: moments.iter().map(|m| m.map(|m| m.standard_error().powi(2))).collect(),
        freedom: f64::from(PICTURES - 1),
    }
}

fn by_reference(flat: &FlatScene, settings: &RenderSettings, spp: u32) -> Estimate {
    let settings = ReferenceSettings {
        width: settings.width,
        height: settings.height,
        spp,
        seed: 4,
        max_depth: settings.max_depth,
        filter: settings.filter,
        terminator_fix: settings.terminator_fix,
        transparent: settings.transparent,
        ..ReferenceSettings::default()
    };
    let picture = reference::render(flat, &settings);
    let rows = |values: &[DVec3]| values.iter().map(|v| v.to_array()).collect();
    Estimate { mean: rows(&picture.rgb), variance: rows(&picture.variance), freedom: f64::from(spp - 1) }
}

/// Two estimates of one picture, compared.
struct Comparison {
    /// By pixel and channel: probability of a difference like this by chance.
    p: Vec<[f64; 3]>,
    /// Share of pixel channels below the corrected level.
    failing: f64,
    /// Difference of the picture means as a share of their mean, by channel.
    difference: [f64; 3],
    /// Standard deviation of that difference by chance.
    noise: [f64; 3],
    /// Probability of differences of the means like these, the least of the channels, corrected for three.
    p_mean: f64,
}

/// Compares pixel by pixel (Welch 1947, "The Generalization of Student's Problem") and as a whole.
fn compare(got: &Estimate, want: &Estimate) -> Comparison {
    let p_of = |pixel: usize, channel: usize| {
        let [a, b] = [got, want].map(|e| (e.mean[pixel][channel], e.variance[pixel][channel], e.freedom));
        let rounding = (ROUNDING * (a.0 + b.0) / 2.0).powi(2);
        let variance = a.1 + b.1 + rounding;
        if variance == 0.0 {
            return if a.0 == b.0 { 1.0 } else { 0.0 };
        }
        // Rounding is certain and so adds to the variance, but not to the doubt about it.
        let freedom = variance.powi(2) / (a.1.powi(2) / a.2 + b.1.powi(2) / b.2).max(1e-300);
        student_two_sided((a.0 - b.0) / variance.sqrt(), freedom.min(1e6))
    };
    let pixels = got.mean.len();
    let p: Vec<[f64; 3]> = (0..pixels).map(|pixel| std::array::from_fn(|channel| p_of(pixel, channel))).collect();
    let level = sidak(ALPHA, 3 * pixels);
    let failing = p.iter().flatten().filter(|&&p| p < level).count() as f64 / (3 * pixels) as f64;
    let sum = |values: &[[f64; 3]], channel: usize| values.iter().map(|v| v[channel]).sum::<f64>();
    let mean: [f64; 3] = std::array::from_fn(|c| 0.5 * (sum(&got.mean, c) + sum(&want.mean, c)).max(1e-300));
    let difference = std::array::from_fn(|c| (sum(&got.mean, c) - sum(&want.mean, c)) / mean[c]);
    let noise = std::array::from_fn(|c| (sum(&got.variance, c) + sum(&want.variance, c)).sqrt() / mean[c]);
    let least = (0..3).map(|c| normal_two_sided(difference[c] / f64::hypot(noise[c], ROUNDING))).fold(1.0, f64::min);
    Comparison { p, failing, difference, noise, p_mean: 1.0 - (1.0 - least).powi(3) }
}

impl Comparison {
    /// # Errors
    /// What differs by more than chance.
    fn verdict(&self, resolution: f64) -> Result<String, String> {
        let percent = |values: [f64; 3]| values.map(|v| format!("{:.3}%", 100.0 * v)).join(" ");
        let summary = format!(
            "mean off by {}, noise {}, p {:.4}; {:.2}% of pixels fail",
            percent(self.difference),
            percent(self.noise),
            self.p_mean,
            100.0 * self.failing
        );
        if self.failing > MAY_FAIL {
            return Err(format!("pixels differ: {summary}"));
        }
        if self.p_mean < sidak(ALPHA, SCENES) {
            return Err(format!("means differ: {summary}"));
        }
        if self.noise.iter().any(|noise| *noise > resolution) {
            return Err(format!("too much noise to tell: {summary}"));
        }
        Ok(summary)
    }
}

/// Comparisons in this file, whose means are tested as one family.
const SCENES: usize = 28;

/// Writes the pictures of a failed comparison and says where.
fn write_failure(name: &str, size: (u32, u32), got: &Estimate, want: &Estimate, comparison: &Comparison) -> String {
    let folder = root().join("target/failures");
    fs::create_dir_all(&folder).expect("the target folder can be written to");
    let write = |kind: &str, values: &[[f64; 3]]| -> PathBuf {
        let path = folder.join(format!("twin-{name}-{kind}.exr"));
        let rgb = values.iter().map(|v| v.map(|x| x as f32)).collect();
        let picture = Picture { width: size.0 as usize, height: size.1 as usize, rgb, ..Picture::default() };
        film::write(&path, &picture, &WriteOptions::default()).expect("the failures folder can be written to");
        path
    };
    let paths = [write("got", &got.mean), write("want", &want.mean), write("p", &comparison.p)];
    paths.map(|path| path.display().to_string()).join("\n")
}

fn flatten(scene: &mut Scene) -> Renderer {
    let mut renderer = Renderer::new();
    let report = renderer.sync(scene);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    renderer
}

/// Compares both renderers; `spp` are samples of the reference, of which the wavefront takes twice as many.
#[track_caller]
fn check_twins(name: &str, scene: &mut Scene, settings: &RenderSettings, spp: u32, resolution: f64) {
    let start = std::time::Instant::now();
    let renderer = flatten(scene);
    let spp = scaled(spp);
    let settings = RenderSettings { spp: Some((2 * spp / PICTURES).max(1)), ..settings.clone() };
    let got = by_wavefront(renderer.scene(), &settings);
    let want = by_reference(renderer.scene(), &settings, spp);
    let comparison = compare(&got, &want);
    match comparison.verdict(resolution) {
        Ok(summary) => println!("{name}: {summary}; {:.1} s", start.elapsed().as_secs_f64()),
        Err(summary) => {
            let paths = write_failure(name, (settings.width, settings.height), &got, &want, &comparison);
            panic!("{name}: {summary}; {:.1} s\n{paths}", start.elapsed().as_secs_f64());
        }
    }
}

fn file(name: &str) -> Scene {
    load_scene(&root().join("scenes").join(name))
}

/// One percent: what noise may hide of a picture's mean, as a standard deviation.
const RESOLUTION: f64 = 0.01;

#[test]
fn twins_agree_on_cornell() {
    check_twins("cornell", &mut file("cornell.gltf"), &scenes::settings(), 1024, 2.0 * RESOLUTION);
}

/// Where each pixel has its own paths alone.
#[test]
fn twins_agree_without_sharing() {
    let alone = RenderSettings { sharing: Sharing::Off, ..scenes::settings() };
    check_twins("cornell-alone", &mut file("cornell.gltf"), &alone, 1024, 4.0 * RESOLUTION);
    check_twins("textures-alone", &mut scenes::textures(), &alone, 1024, RESOLUTION);
    check_twins("sky-alone", &mut scenes::sky(), &alone, 1024, RESOLUTION);
}

#[test]
fn twins_agree_on_the_gallery() {
    check_twins("gallery", &mut file("gallery.glb"), &scenes::settings(), 512, RESOLUTION);
}

#[test]
fn twins_agree_on_the_window() {
    check_twins("window", &mut file("window.gltf"), &scenes::settings(), 512, 2.0 * RESOLUTION);
}

/// One sample in thousands finds how a lamp shines off a ball onto the wall beside it: fewer would not know of a fifth of the light of
/// two pixels, nor of their doubt.
#[test]
fn twins_agree_on_punctual_lights() {
    check_twins("punctual", &mut file("punctual.gltf"), &scenes::settings(), 16_384, RESOLUTION);
}

#[test]
fn twins_agree_on_emitters() {
    check_twins("emitters", &mut file("emitters.gltf"), &scenes::settings(), 1024, 4.0 * RESOLUTION);
}

#[test]
fn twins_agree_on_alpha() {
    check_twins("alpha", &mut file("alpha.gltf"), &scenes::settings(), 512, RESOLUTION);
}

#[test]
fn twins_agree_on_instances() {
    check_twins("instances", &mut file("instances.glb"), &scenes::settings(), 128, 2.0 * RESOLUTION);
}

#[test]
fn twins_agree_on_mirrored_stretched_and_sheared_instances() {
    check_twins("transforms", &mut scenes::transforms(), &scenes::settings(), 1024, RESOLUTION);
}

#[test]
fn twins_agree_on_rough_solids_that_absorb() {
    check_twins("solids", &mut scenes::solids(), &scenes::settings(), 1024, 5.0 * RESOLUTION);
}

#[test]
fn twins_agree_on_clear_solids_that_absorb() {
    check_twins("clear-solids", &mut scenes::clear_solids(), &scenes::settings(), 1024, RESOLUTION);
}

#[test]
fn twins_agree_on_shapes() {
    check_twins("shapes", &mut crate::shapes::varied(), &scenes::settings(), 1024, 3.0 * RESOLUTION);
}

#[test]
fn twins_agree_on_thin_walls() {
    check_twins("thin-walls", &mut scenes::thin_walls(), &scenes::settings(), 1024, RESOLUTION);
}

#[test]
fn twins_agree_on_textures() {
    check_twins("textures", &mut scenes::textures(), &scenes::settings(), 1024, RESOLUTION);
}

#[test]
fn twins_agree_under_a_sky() {
    check_twins("sky", &mut scenes::sky(), &scenes::settings(), 1024, RESOLUTION);
    let transparent = RenderSettings { transparent: true, filter: PixelFilter::Gaussian, ..scenes::settings() };
    check_twins("sky-transparent", &mut scenes::sky(), &transparent, 1024, RESOLUTION);
}

#[test]
fn twins_agree_in_parallel_rays() {
    let settings = RenderSettings { filter: PixelFilter::Box, ..scenes::settings() };
    check_twins("parallel", &mut scenes::parallel(), &settings, 1024, RESOLUTION);
}

#[test]
fn twins_agree_up_to_each_depth() {
    for depth in [0, 1, 2] {
        let settings = RenderSettings { max_depth: Some(depth), ..scenes::settings() };
        check_twins(&format!("depth-{depth}"), &mut scenes::thin_walls(), &settings, 512, RESOLUTION);
    }
}

#[test]
fn twins_agree_on_the_shadow_terminator() {
    for fix in [true, false] {
        let settings = RenderSettings { terminator_fix: fix, ..scenes::settings() };
        check_twins(&format!("terminator-{fix}"), &mut scenes::coarse(), &settings, 1024, RESOLUTION);
    }
}

/// A file of the asset pack, seen from `eye`, under a sky of the pack.
fn asset_under_sky(path: &str, eye: DVec3, target: DVec3) -> Option<Scene> {
    let mut scene = load_scene(&asset(path)?);
    let (map, _) = load_environment(&asset("_hdr/venice_sunset_1k.hdr")?).expect("the pack's sky is sound");
    scene.spawn((Environment { sky: Sky::Map(Arc::new(map)), rotation_degrees: 0.0, scale: 1.0 },));
    scene.active_camera = Some(look(&mut scene, eye, target, 45.0));
    Some(scene)
}

/// Its lamp hangs just below the ceiling and shines upwards too: the few paths that get into the gap are bright dots,
/// which the reference must find as often.
#[test]
fn twins_agree_on_the_pack_s_cornell_box() {
    let Some(path) = asset("CornellBox/CornellBox.glb") else { return };
    check_twins("pack-cornell", &mut load_scene(&path), &scenes::settings(), 1024, 4.0 * RESOLUTION);
}

#[test]
fn twins_agree_on_the_helmet() {
    let path = "DamagedHelmet/glTF-Binary/DamagedHelmet.glb";
    let Some(mut scene) = asset_under_sky(path, DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO) else { return };
    check_twins("helmet", &mut scene, &scenes::settings(), 512, RESOLUTION);
}

#[test]
fn twins_agree_on_sponza() {
    let (eye, target) = (DVec3::new(0.0, 1.0, 0.0), DVec3::new(1.0, 1.0, 0.0));
    let Some(mut scene) = asset_under_sky("Sponza/Sponza.glb", eye, target) else { return };
    check_twins("sponza", &mut scene, &scenes::settings(), 256, 3.0 * RESOLUTION);
}

/// Negative control: the check of the twins finds albedos off by a tenth, and a second bounce that is missing.
#[test]
fn the_check_of_twins_finds_small_errors() {
    let settings = RenderSettings { spp: Some(256), max_depth: Some(2), ..scenes::settings() };
    let truth = settings.clone();
    let verdict = |edit: &dyn Fn(&mut Scene), settings: &RenderSettings| {
        let mut scene = file("cornell.gltf");
        let want = by_reference(flatten(&mut scene).scene(), &truth, 2048);
        edit(&mut scene);
        compare(&by_wavefront(flatten(&mut scene).scene(), settings), &want).verdict(2.0 * RESOLUTION)
    };
    let nothing = |_: &mut Scene| {};
    let paler = |scene: &mut Scene| {
        for key in scene.keys_with::<Material>() {
            edit_material(scene, key, |material| material.base_color *= 0.9);
        }
    };
    assert!(verdict(&nothing, &settings).is_ok(), "{:?}", verdict(&nothing, &settings));
    assert!(verdict(&paler, &settings).is_err(), "albedo");
    assert!(verdict(&nothing, &RenderSettings { max_depth: Some(1), ..settings.clone() }).is_err(), "bounce");
    let sampler = RenderSettings { sampler: SamplerKind::Independent, ..settings.clone() };
    assert!(verdict(&nothing, &sampler).is_ok(), "{:?}", verdict(&nothing, &sampler));
}

fn edit_material(scene: &mut Scene, key: SceneKey, edit: impl Fn(&mut Material)) {
    let mut material = scene.get::<Material>(key).expect("the key has one");
    edit(&mut material);
    scene.insert(key, material);
}

/// The mode that follows one path at a time draws the same numbers and rounds the same way: pixels agree to the last bit,
/// whoever else was in a block. So do waves that are not sorted. Smooth and flat meshes, moved and unmoved instances in
/// one block once did not.
#[test]
fn one_path_at_a_time_makes_the_picture_of_the_wavefront() {
    let scenes = [
        ("cornell", file("cornell.gltf")),
        ("alpha", file("alpha.gltf")),
        ("instances", file("instances.glb")),
        ("gallery", file("gallery.glb")),
        ("window", file("window.gltf")),
        ("transforms", scenes::transforms()),
        ("solids", scenes::solids()),
        ("thin walls", scenes::thin_walls()),
        ("textures", scenes::textures()),
        ("sky", scenes::sky()),
        ("parallel", scenes::parallel()),
        ("coarse", scenes::coarse()),
    ];
    for (name, mut scene) in scenes {
        let renderer = flatten(&mut scene);
        let settings = RenderSettings { spp: Some(8), ..scenes::settings() };
        let waves = renderer.render(&settings, &()).picture.rgb;
        let paths = wavefront::render_one_path(renderer.scene(), &settings, &()).picture.rgb;
        let unsorted = RenderSettings { sort: false, ..settings };
        let unsorted = renderer.render(&unsorted, &()).picture.rgb;
        for (mode, got) in [("one path", paths), ("unsorted", unsorted)] {
            let differs = |(a, b): &(&[f32; 3], &[f32; 3])| a.map(f32::to_bits) != b.map(f32::to_bits);
            let differing = waves.iter().zip(&got).filter(differs).count();
            assert_eq!(differing, 0, "{name}, {mode}: of {} pixels so many differ", waves.len());
        }
    }
}

/// A lamp that lies between the plane of the shading normal through the point and that through the lifted point is in
/// reach of no scattered ray; counted as a light sample it lit the rim of coarse spheres a few per cent too much.
#[test]
fn twins_agree_on_a_lamp_at_the_shadow_terminator() {
    let mut scene = scenes::rim();
    check_twins("rim", &mut scene, &RenderSettings { max_depth: Some(1), ..scenes::settings() }, 2048, RESOLUTION);
}
