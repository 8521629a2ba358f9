//! How much does the wavefront gain over one path at a time, and which queue size suits it?
//!
//! `cargo bench --bench wavefront` asks both questions of three scenes and writes its tables to
//! `benches/results/`. The same scene goes through the wavefront, through the one-path-at-a-time
//! mode (same tree, same BSDF kernels with one lane) and through the f64 reference. Before any
//! time is taken, the pictures of the first two must agree. The contenders take turns within each
//! repetition; ratios are medians of the repetitions' ratios, and the spread is theirs.
//!
//! Options after `--`: `modes`, `sweep` (default both); `--runs N` (default 7); `--threads N` (default 1).

use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
    sync::Arc,
    time::Instant,
};

use glam::DVec3;
use wavecast::{
    load::{self, LoadOptions},
    reference::{self, ReferenceSettings},
    render::{PixelFilter, RenderSettings, Rendered, Renderer},
    wavefront,
    world::{Camera, Environment, LocalTransform, Sky},
};

struct Subject {
    name: &'static str,
    renderer: Renderer,
    spp: u32,
}

const SIZE: u32 = 256;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// A file as a subject, seen from `eye`, under a sky of the asset pack; `None`, said aloud, where it is missing.
fn subject(
    name: &'static str,
    path: &str,
    view: Option<(DVec3, DVec3)>,
    sky: Option<&str>,
    spp: u32,
) -> Option<Subject> {
    let full = root().join(path);
    if !full.exists() {
        println!("SKIPPED: {name}: {} is not there", full.display());
        return None;
    }
    let mut scene = load::load(&full, &LoadOptions::default()).expect("the bench's scenes are sound").scene;
    if let Some((eye, target)) = view {
        let pose = LocalTransform::looking_at(eye, target, DVec3::Y);
        scene.active_camera = Some(scene.spawn((Camera::perspective(45_f32.to_radians()), pose)));
    }
    if let Some(sky) = sky {
        let (map, _) = load::load_environment(&root().join(sky)).expect("the bench's sky is sound");
        scene.spawn((Environment { sky: Sky::Map(Arc::new(map)), rotation_degrees: 0.0, scale: 1.0 },));
    }
    let mut renderer = Renderer::new();
    renderer.sync(&mut scene);
    Some(Subject { name, renderer, spp })
}

fn subjects() -> Vec<Subject> {
    const SKY: &str = "../shared/assets/_hdr/venice_sunset_1k.hdr";
    let assets = |path: &str| format!("../shared/assets/{path}");
    let helmet = (DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO);
    let hall = (DVec3::new(0.0, 1.0, 0.0), DVec3::new(1.0, 1.0, 0.0));
    [
        subject("Cornell box", "scenes/cornell.gltf", None, None, 16),
        subject("DamagedHelmet", &assets("DamagedHelmet/glTF-Binary/DamagedHelmet.glb"), Some(helmet), Some(SKY), 16),
        subject("Sponza", &assets("Sponza/Sponza.glb"), Some(hall), Some(SKY), 8),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn settings(subject: &Subject, threads: usize) -> RenderSettings {
    RenderSettings {
        width: SIZE,
        height: SIZE,
        spp: Some(subject.spp),
        filter: PixelFilter::Box,
        threads,
        ..RenderSettings::default()
    }
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Paths per second of one render.
fn timed(render: impl FnOnce() -> Rendered) -> f64 {
    let start = Instant::now();
    let rendered = render();
    rendered.stats.paths as f64 / start.elapsed().as_secs_f64()
}

/// The answer before the clock: both modes make the same picture, up to the rounding of sines and exponentials.
fn check_same_picture(subject: &Subject, settings: &RenderSettings) {
    let scene = subject.renderer.scene();
    let mean = |rendered: &Rendered| {
        let sum: f64 = rendered.picture.rgb.iter().flatten().map(|&v| f64::from(v)).sum();
        sum / rendered.picture.rgb.len() as f64
    };
    let wave = mean(&wavefront::render(scene, settings, &()));
    let single = mean(&wavefront::render_one_path(scene, settings, &()));
    let difference = (wave - single).abs() / wave;
    assert!(difference < 2e-3, "{}: the modes disagree by {difference}: {wave} and {single}", subject.name);
}

fn modes(subjects: &[Subject], runs: usize, threads: usize) -> String {
    let mut out = String::from(
        "| scene | wavefront, Mpaths/s | one path at a time | ratio: median (spread) | f64 reference, Mpaths/s | ratio |\n|---|---|---|---|---|---|\n",
    );
    for subject in subjects {
        let settings = settings(subject, threads);
        check_same_picture(subject, &settings);
        let scene = subject.renderer.scene();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads for the reference");
        let reference_settings = ReferenceSettings {
            width: SIZE / 2,
            height: SIZE / 2,
            spp: 2,
            filter: PixelFilter::Box,
            ..ReferenceSettings::default()
        };
        let tracer = reference::Tracer::new(scene, &reference_settings);
        let (mut wave, mut single, mut slow) = (Vec::new(), Vec::new(), Vec::new());
        let (mut gain, mut over_reference) = (Vec::new(), Vec::new());
        for _ in 0..runs {
            let w = timed(|| wavefront::render(scene, &settings, &()));
            let s = timed(|| wavefront::render_one_path(scene, &settings, &()));
            let start = Instant::now();
            let picture = pool.install(|| reference::render_with(&tracer, scene, &reference_settings));
            let paths = picture.rgb.len() as f64 * f64::from(picture.samples);
            let r = paths / start.elapsed().as_secs_f64();
            wave.push(w);
            single.push(s);
            slow.push(r);
            gain.push(w / s);
            over_reference.push(w / r);
        }
        let ratio = median(&mut gain);
        let (low, high) = (gain[0], gain[gain.len() - 1]);
        let line = format!(
            "| {} | {:.3} | {:.3} | {ratio:.2} ({low:.2}–{high:.2}) | {:.4} | {:.1} |",
            subject.name,
            median(&mut wave) / 1e6,
            median(&mut single) / 1e6,
            median(&mut slow) / 1e6,
            median(&mut over_reference)
        );
        println!("{line}");
        let _ = writeln!(out, "{line}");
    }
    out
}

fn sweep(subjects: &[Subject], runs: usize, threads: usize) -> (String, String) {
    let sizes: Vec<usize> = (4..=17).map(|log| 1 << log).collect();
    let mut csv = String::from("scene,wave_size,bytes,mpaths_per_second,low,high\n");
    let mut table = format!(
        "| paths in a wave | queues, KiB |{}\n|---|---|{}\n",
        subjects.iter().map(|s| format!(" {} |", s.name)).collect::<String>(),
        "---|".repeat(subjects.len())
    );
    let mut speeds = vec![vec![Vec::new(); sizes.len()]; subjects.len()];
    for run in 0..runs {
        for (subject, speeds) in subjects.iter().zip(&mut speeds) {
            for (&wave_size, speeds) in sizes.iter().zip(speeds.iter_mut()) {
                // Tiles large enough that the wave, not the tile, is what ends; the same for all sizes.
                let settings = RenderSettings { wave_size, tile_size: 128, ..settings(subject, threads) };
                speeds.push(timed(|| wavefront::render(subject.renderer.scene(), &settings, &())) / 1e6);
            }
        }
        println!("sweep: run {} of {runs}", run + 1);
    }
    for (i, &wave_size) in sizes.iter().enumerate() {
        let bytes = wave_size * wavefront::BYTES_PER_PATH;
        let _ = write!(table, "| {wave_size} | {} |", bytes / 1024);
        for (subject, speeds) in subjects.iter().zip(&mut speeds) {
            let middle = median(&mut speeds[i]);
            let (low, high) = (speeds[i][0], speeds[i][speeds[i].len() - 1]);
            let _ = write!(table, " {middle:.3} |");
            let _ = writeln!(csv, "{},{wave_size},{bytes},{middle:.4},{low:.4},{high:.4}", subject.name);
        }
        table.push('\n');
    }
    println!("{table}");
    (table, csv)
}

fn machine() -> String {
    let cpu = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpu.lines().find(|line| line.starts_with("model name")).and_then(|line| line.split(": ").nth(1));
    let features = if cfg!(target_feature = "avx2") { "x86-64-v3 or better" } else { "baseline" };
    format!(
        "{} ({} threads there), built for {features}",
        model.unwrap_or("unknown CPU"),
        rayon::max_num_threads().min(std::thread::available_parallelism().map_or(1, usize::from))
    )
}

fn write(path: &Path, text: &str) {
    fs::write(path, text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    println!("wrote {}", path.display());
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let number = |name: &str, default: usize| {
        let at = arguments.iter().position(|a| a == name);
        at.and_then(|at| arguments.get(at + 1)).map_or(default, |n| n.parse().expect("a number"))
    };
    let (runs, threads) = (number("--runs", 7), number("--threads", 1));
    let asked = |what: &str| arguments.iter().any(|a| a == what);
    let both = !asked("modes") && !asked("sweep");
    let subjects = subjects();
    let results = root().join("benches/results");
    let header = format!(
        "{}, {threads} thread(s) used, {SIZE}×{SIZE} pixels, box filter, no depth limit, {runs} interleaved runs.\n\n",
        machine()
    );
    if both || asked("modes") {
        let table = modes(&subjects, runs, threads);
        write(
            &results.join("wavefront-modes.md"),
            &format!(
                "# The wavefront against one path at a time\n\n`cargo bench --bench wavefront -- modes`: {header}{table}"
            ),
        );
    }
    if both || asked("sweep") {
        let (table, csv) = sweep(&subjects, runs, threads);
        let text = format!(
            "# Throughput by queue size, Mpaths/s\n\n`cargo bench --bench wavefront -- sweep`: {header}{table}"
        );
        write(&results.join("wavefront-sweep.md"), &text);
        write(&results.join("wavefront-sweep.csv"), &csv);
    }
}
