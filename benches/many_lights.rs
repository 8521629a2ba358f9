//! What do more lights cost?
//!
//! `cargo bench --bench many_lights` answers twice, and writes `benches/results/many-lights.md`:
//!
//! - *Time.* The hilly ceiling of a room, one mesh of a million triangles, of which ten emit, or all. The same seeds take
//!   turns; what counts is the time of a path. The issue that asked for a light tree allows a factor of two.
//! - *Error.* A room under a ceiling with ten square lamps, or with ten thousand of a thousandth of their area each and the same
//!   radiance, spread over the same part of the ceiling. What counts is relMSE at as many samples, from the spread of
//!   pictures of different seeds; it may be twice as much.
//!
//! Pixels share nothing here: how many share would be chosen by what it pays in each scene, and hide what lights cost.
//!
//! It fails where more is needed than that; time is of the machine, so it should have nothing else to do.

use std::{fmt::Write as _, fs, path::Path, process::ExitCode};

use glam::{DVec3, Vec3};
use wavecast::{
    measure::converged::Replicas,
    render::{PixelFilter, RenderSettings, Renderer, Sharing},
    world::{Camera, Geometry, LocalTransform, Material, MaterialSlots, Scene, TriMesh},
};

/// Edge of the room, m.
const EDGE: f32 = 6.0;
/// Height of the room, m.
const HEIGHT: f32 = 3.0;
/// Pictures of each.
const SEEDS: u64 = 5;
/// The factor allowed.
const MOST: f64 = 2.0;

/// Part of a mesh by triangles, with the rest: in glTF these would be the primitives of one mesh.
fn show(scene: &mut Scene, mesh: TriMesh, material: Material) {
    let material = scene.spawn((material,));
    scene.spawn((Geometry(mesh.into()), MaterialSlots::from(material)));
}

fn lamp(radiance: f32) -> Material {
    Material { emissive: Vec3::splat(radiance), ..Material::lambert(Vec3::splat(0.5)) }
}

/// A room of which the ceiling is open, with boxes that throw shadows.
fn room() -> Scene {
    let mut scene = Scene::new();
    let half = 0.5 * EDGE;
    let white = Material { double_sided: true, ..Material::lambert(Vec3::splat(0.6)) };
    let (x, y, z) = (Vec3::X * EDGE, Vec3::Y * HEIGHT, Vec3::Z * EDGE);
    let corner = Vec3::new(-half, 0.0, -half);
    for (at, u, v) in [(corner, z, x), (corner, x, y), (corner, y, z), (corner + x, z, y)] {
        show(&mut scene, TriMesh::quad(at, u, v), white.clone());
    }
    for i in 0..5 {
        let at = Vec3::new(-2.2 + i as f32, 0.0, -1.5 + 0.7 * (i * 3 % 5) as f32);
        show(&mut scene, TriMesh::cuboid(at, at + Vec3::new(0.5, 0.4 + 0.3 * i as f32, 0.5)), white.clone());
    }
    let eye = DVec3::new(0.0, 1.6, f64::from(half) - 0.1);
    scene.spawn((Camera::perspective(1.2), LocalTransform::looking_at(eye, DVec3::new(0.0, 0.9, 0.0), DVec3::Y)));
    scene
}

/// The room under a ceiling of hills, `across`² quads, of which only every so-manieth triangle emits.
fn hills(across: u32, every: usize) -> Scene {
    let mut scene = room();
    let at = |i: u32, j: u32| {
        let [u, v] = [i, j].map(|k| EDGE * (k as f32 / across as f32 - 0.5));
        Vec3::new(u, HEIGHT + 0.1 * (4.0 * u).sin() * (5.0 * v).cos(), v)
    };
    let positions: Vec<Vec3> = (0..=across).flat_map(|j| (0..=across).map(move |i| at(i, j))).collect();
    let row = across + 1;
    let triangles: Vec<[u32; 3]> = (0..across)
        .flat_map(|j| (0..across).map(move |i| j * row + i))
        .flat_map(|a| [[a, a + 1, a + row], [a + 1, a + row + 1, a + row]])
        .collect();
    let (mut emitting, mut others) = (Vec::new(), Vec::new());
    for (i, triangle) in triangles.into_iter().enumerate() {
        if i % every == every / 2 { emitting.push(triangle) } else { others.push(triangle) }
    }
    // As much light in all.
    let radiance = 2.0 * (emitting.len() + others.len()) as f32 / emitting.len() as f32;
    if !others.is_empty() {
        show(&mut scene, TriMesh::new(positions.clone(), others), Material::lambert(Vec3::splat(0.5)));
    }
    show(&mut scene, TriMesh::new(positions, emitting), lamp(radiance));
    scene
}

/// The room under a flat ceiling with so many lamps, square, in rows, of a thirtieth of the ceiling in all.
fn lamps(columns: u32, rows: u32) -> Scene {
    let mut scene = room();
    let half = 0.5 * EDGE;
    let corner = Vec3::new(-half, HEIGHT, -half);
    show(&mut scene, TriMesh::quad(corner, Vec3::X * EDGE, Vec3::Z * EDGE), Material::lambert(Vec3::splat(0.6)));
    let edge = EDGE / (30.0 * (columns * rows) as f32).sqrt();
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (i, j) in (0..columns).flat_map(|i| (0..rows).map(move |j| (i, j))) {
        let middle = |k: u32, count: u32| 0.8 * EDGE * ((k as f32 + 0.5) / count as f32 - 0.5);
        let at = Vec3::new(middle(i, columns) - 0.5 * edge, HEIGHT - 0.01, middle(j, rows) - 0.5 * edge);
        let first = positions.len() as u32;
        positions.extend([at, at + Vec3::X * edge, at + Vec3::Z * edge, at + Vec3::new(edge, 0.0, edge)]);
        triangles.extend([[first, first + 1, first + 2], [first + 1, first + 3, first + 2]]);
    }
    show(&mut scene, TriMesh::new(positions, triangles), lamp(60.0));
    scene
}

/// What rendering a scene took and left.
#[derive(Default)]
struct Measured {
    sync: f64,
    /// Seconds for each path.
    path: Vec<f64>,
    pictures: Replicas,
}

impl Measured {
    fn median(&self) -> f64 {
        let mut path = self.path.clone();
        path.sort_unstable_by(f64::total_cmp);
        path[path.len() / 2]
    }

    /// Expected relMSE of one picture.
    fn error(&self) -> f64 {
        f64::from(self.pictures.count) * self.pictures.converged().noise(0.0)
    }
}

/// Renders the scenes in turn.
fn measure<const N: usize>(scenes: [Scene; N], spp: u32) -> [Measured; N] {
    let mut measured: [Measured; N] = std::array::from_fn(|_| Measured::default());
    let renderers = scenes.map(|mut scene| {
        let mut renderer = Renderer::new();
        let start = std::time::Instant::now();
        renderer.sync(&mut scene);
        (renderer, start.elapsed().as_secs_f64())
    });
    for seed in 0..SEEDS {
        for ((renderer, sync), measured) in renderers.iter().zip(&mut measured) {
            let (width, height, filter) = (320, 240, PixelFilter::Box);
            let settings = RenderSettings {
                width,
                height,
                spp: Some(spp),
                seed,
                filter,
                sharing: Sharing::Off,
                ..RenderSettings::default()
            };
            let rendered = renderer.render(&settings, &());
            measured.sync = *sync;
            measured.path.push(rendered.stats.seconds / (f64::from(width * height) * rendered.stats.spp));
            measured.pictures.push(&rendered.picture.rgb);
        }
    }
    measured
}

fn main() -> ExitCode {
    let mut table =
        String::from("| room with | tables and trees, s | µs a path | relMSE × samples |\n|---|---|---|---|\n");
    let mut add = |name: &str, measured: &Measured, spp: u32| {
        let Measured { sync, .. } = measured;
        let (path, error) = (1e6 * measured.median(), measured.error() * f64::from(spp));
        writeln!(table, "| {name} | {sync:.2} | {path:.3} | {error:.3} |").expect("a string takes it");
    };
    let spp = 16;
    let [ten, all] = measure([hills(708, 100_250), hills(708, 1)], spp);
    add("10 emitting triangles of 1,002,528", &ten, spp);
    add("all of them emitting", &all, spp);
    let time = all.median() / ten.median();
    let [few, many] = measure([lamps(5, 2), lamps(100, 100)], spp);
    add("10 lamps", &few, spp);
    add("10,000 lamps", &many, spp);
    let error = many.error() / few.error();
    let says = format!(
        "Time of a path, all emitting over ten: {time:.2}. relMSE at {spp} samples, 10,000 lamps over 10: {error:.2}.\n"
    );
    print!("{table}\n{says}");
    let text = format!(
        "# What more lights cost\n\n`cargo bench --bench many_lights`, {SEEDS} seeds in turn, 320×240, {spp} samples; medians; relMSE from the \
         spread.\n\n{table}\n{says}"
    );
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/results/many-lights.md");
    if let Err(error) = fs::write(&path, text) {
        eprintln!("error: {}: {error}", path.display());
        return ExitCode::FAILURE;
    }
    if time > MOST || error > MOST { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}
