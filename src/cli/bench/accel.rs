//! `wavecast bench accel`: every structure over the same triangles and the same rays.

use std::{fmt::Write as _, fs, path::Path, sync::Arc, time::Instant};

use serde_json::{Value, json};
use wavecast::{
    accel::{
        Accel, AccelKind, Blas, Brute, Bsp, Bvh2, Grid, InstanceRef, KdTree, Nearest, Obb, Octree, Ray, RayList, Rays,
        Solid, Structure, Work,
    },
    load::{self, LoadOptions},
    render::Renderer,
};

use super::{
    Args,
    rays::{Batch, Corners, batches, world_triangles},
};
use crate::cli::{Outcome, console::Console, error::CliError};

/// Rays that a wave of the renderer has at hand.
const WAVE: usize = 2048;
/// Triangles times rays that brute force is asked about, for the others to be checked against.
const CHECKED: usize = 1_000_000_000;

/// What the ray meets: row of the triangle and distance; for rays that are only asked whether, 0 and 0.
type Answer = Option<(u32, f32)>;

/// A structure over a scene's triangles, behind a pointer: its loops over rays are compiled for each kind.
trait Contender {
    fn bytes(&self) -> usize;
    fn references(&self) -> usize;
    fn answers(&self, batch: &Batch, into: &mut Vec<Answer>);
    fn work(&self, batch: &Batch) -> Work;
}

/// Of those that are asked by one ray at a time.
struct Single<S>(S);

impl<S: Structure> Single<S> {
    #[inline(always)]
    fn ask(&self, batch: &Batch, counters: &mut impl wavecast::accel::Counters, mut done: impl FnMut(Answer)) {
        for &(origin, direction, t_max) in &batch.rays.0 {
            let ray = Ray::new(origin, direction);
            if batch.any {
                done(self.0.occluded(&ray, t_max, |_, _| true, counters).then_some((0, 0.0)));
            } else {
                let mut best = Nearest::none(t_max);
                self.0.nearest(&ray, &mut best, |_, _| true, counters);
                done((best.triangle != u32::MAX).then_some((best.triangle, best.t)));
            }
        }
    }
}

impl<S: Structure> Contender for Single<S> {
    fn bytes(&self) -> usize {
        self.0.bytes()
    }

    fn references(&self) -> usize {
        self.0.references()
    }

    fn answers(&self, batch: &Batch, into: &mut Vec<Answer>) {
        into.clear();
        self.ask(batch, &mut (), |answer| into.push(answer));
    }

    fn work(&self, batch: &Batch) -> Work {
        let mut work = Work::default();
        self.ask(batch, &mut work, |_| ());
        work
    }
}

/// The renderer's way: waves of rays through the eight-wide tree.
struct Waves {
    accel: Accel,
    references: usize,
}

impl Waves {
    fn build(triangles: &[Corners]) -> Self {
        let blas = Blas::build(triangles);
        let references = blas.references();
        let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let only = InstanceRef {
            blas: Arc::new(blas),
            world_from_local: identity,
            local_from_world: identity,
            identity: true,
            check: false,
        };
        Self { accel: Accel::build(vec![only]), references }
    }

    fn ask(&self, batch: &Batch, counters: &mut impl wavecast::accel::Counters, into: &mut [Answer]) {
        for (rays, into) in batch.rays.0.chunks(WAVE).zip(into.chunks_mut(WAVE)) {
            let wave = Wave(rays);
            if batch.any {
                let done = |index: usize, occluded: bool| into[index] = occluded.then_some((0, 0.0));
                self.accel.occluded_counted(&wave, &Solid, counters, done);
            } else {
                self.accel.nearest_counted(&wave, &Solid, counters, |index, hit| {
                    into[index] = (hit.triangle != u32::MAX).then_some((hit.triangle, hit.t));
                });
            }
        }
    }
}

/// Part of a batch.
struct Wave<'a>(&'a [([f32; 3], [f32; 3], f32)]);

impl Rays for Wave<'_> {
    fn count(&self) -> usize {
        self.0.len()
    }

    #[inline(always)]
    fn ray(&self, index: usize) -> ([f32; 3], [f32; 3], f32) {
        self.0[index]
    }

    #[inline(always)]
    fn id(&self, _: usize) -> u32 {
        0
    }
}

impl Contender for Waves {
    fn bytes(&self) -> usize {
        self.accel.instances()[0].blas.bytes()
    }

    fn references(&self) -> usize {
        self.references
    }

    fn answers(&self, batch: &Batch, into: &mut Vec<Answer>) {
        into.clear();
        into.resize(batch.rays.0.len(), None);
        self.ask(batch, &mut (), into);
    }

    fn work(&self, batch: &Batch) -> Work {
        let mut work = Work::default();
        self.ask(batch, &mut work, &mut vec![None; batch.rays.0.len()]);
        work
    }
}

type Build = fn(&[Corners]) -> Box<dyn Contender>;

fn single<S: Structure + 'static>() -> (&'static str, Build) {
    (S::NAME, |triangles| Box::new(Single(S::build(triangles))))
}

/// All structures by name, the default first.
fn structures() -> [(&'static str, Build); 8] {
    [
        // Waves through the eight-wide tree, which is what renders unless another is asked for.
        (AccelKind::default().name(), |triangles| Box::new(Waves::build(triangles))),
        single::<Bvh2>(),
        single::<Obb>(),
        single::<KdTree>(),
        single::<Octree>(),
        single::<Bsp>(),
        single::<Grid>(),
        single::<Brute>(),
    ]
}

/// Those asked for.
fn chosen(names: &[String]) -> Result<Vec<(&'static str, Build)>, CliError> {
    let all = structures();
    if names.is_empty() {
        return Ok(all.into_iter().filter(|(name, _)| *name != Brute::NAME).collect());
    }
    let find = |wanted: &String| {
        all.iter().find(|(name, _)| name == wanted).copied().ok_or_else(|| {
            let known = all.map(|(name, _)| name).join(", ");
            CliError::Usage(format!("there is no structure {wanted:?}; there is {known}"))
        })
    };
    names.iter().map(find).collect()
}

/// A built structure and what building it took.
struct Built {
    name: &'static str,
    structure: Box<dyn Contender>,
    seconds: f64,
}

/// One line of the table.
struct Row {
    scene: String,
    triangles: usize,
    accel: &'static str,
    rays: &'static str,
    count: usize,
    mrays_per_second: f64,
    build_seconds: f64,
    bytes: usize,
    references: usize,
    nodes_per_ray: f64,
    triangles_per_ray: f64,
    checked: usize,
    mismatches: usize,
}

const COLUMNS: [&str; 13] = [
    "scene",
    "triangles",
    "accel",
    "rays",
    "count",
    "mrays_per_second",
    "build_seconds",
    "bytes",
    "references",
    "nodes_per_ray",
    "triangles_per_ray",
    "checked",
    "mismatches",
];

impl Row {
    fn values(&self) -> [Value; 13] {
        [
            json!(self.scene),
            json!(self.triangles),
            json!(self.accel),
            json!(self.rays),
            json!(self.count),
            json!(self.mrays_per_second),
            json!(self.build_seconds),
            json!(self.bytes),
            json!(self.references),
            json!(self.nodes_per_ray),
            json!(self.triangles_per_ray),
            json!(self.checked),
            json!(self.mismatches),
        ]
    }

    fn json(&self) -> Value {
        COLUMNS.iter().map(|name| (*name).to_owned()).zip(self.values()).collect::<serde_json::Map<_, _>>().into()
    }
}

/// Measures each scene and reports.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    let chosen = chosen(&args.accel)?;
    if let Some(folder) = &args.output {
        fs::create_dir_all(folder).map_err(|source| CliError::Output { path: folder.clone(), source })?;
    }
    let mut rows = Vec::new();
    for path in &args.scenes {
        measure(path, args, &chosen, console, &mut rows)?;
    }
    if let Some(folder) = &args.output {
        let path = folder.join("accel.csv");
        fs::write(&path, csv(&rows)).map_err(|source| CliError::Output { path, source })?;
    }
    console.result(&table(&rows), || json!({ "rows": rows.iter().map(Row::json).collect::<Vec<_>>() }));
    Ok(Outcome::Done)
}

fn measure(
    path: &Path,
    args: &Args,
    chosen: &[(&'static str, Build)],
    console: &mut Console,
    rows: &mut Vec<Row>,
) -> Result<(), CliError> {
    let mut loaded = load::load(path, &LoadOptions::default())?;
    loaded.warnings.iter().for_each(|warning| console.warn(warning));
    let mut renderer = Renderer::new();
    renderer.sync(&mut loaded.scene).warnings.iter().for_each(|warning| console.warn(warning));
    let triangles = world_triangles(renderer.scene());
    let view = renderer.scene().camera;
    let waves = Waves::build(&triangles);
    let batches = batches(&view, &triangles, &waves.accel, args.rays);
    let built: Vec<Built> = chosen
        .iter()
        .map(|(name, build)| {
            console.note(format!("{}: building {name} over {} triangles", path.display(), triangles.len()));
            let start = Instant::now();
            let structure = build(&triangles);
            Built { name, structure, seconds: start.elapsed().as_secs_f64() }
        })
        .collect();
    let brute = Single(Brute::build(&triangles));
    for batch in batches.iter().filter(|batch| !batch.rays.0.is_empty()) {
        let count = batch.rays.0.len();
        let sample = spread(batch, (CHECKED / triangles.len().max(1)).max(16));
        let mut truth = Vec::new();
        brute.answers(&sample, &mut truth);
        let mut seconds = vec![Vec::new(); built.len()];
        let mut answers = Vec::new();
        // In turn, so that whatever else the machine does falls upon all.
        for _ in 0..args.runs {
            for (one, seconds) in built.iter().zip(&mut seconds) {
                let start = Instant::now();
                one.structure.answers(batch, &mut answers);
                seconds.push(start.elapsed().as_secs_f64());
            }
        }
        for (one, seconds) in built.iter().zip(&mut seconds) {
            seconds.sort_unstable_by(f64::total_cmp);
            one.structure.answers(&sample, &mut answers);
            let work = one.structure.work(batch);
            rows.push(Row {
                scene: path.display().to_string(),
                triangles: triangles.len(),
                accel: one.name,
                rays: batch.kind,
                count,
                mrays_per_second: count as f64 / seconds[seconds.len() / 2] / 1e6,
                build_seconds: one.seconds,
                bytes: one.structure.bytes(),
                references: one.structure.references(),
                nodes_per_ray: work.nodes as f64 / count as f64,
                triangles_per_ray: work.triangles as f64 / count as f64,
                checked: truth.len(),
                mismatches: truth.iter().zip(&answers).filter(|(want, got)| want != got).count(),
            });
        }
    }
    Ok(())
}

/// So many rays of a batch, from all over it.
fn spread(batch: &Batch, most: usize) -> Batch {
    let step = batch.rays.0.len().div_ceil(most).max(1);
    Batch { kind: batch.kind, any: batch.any, rays: RayList(batch.rays.0.iter().copied().step_by(step).collect()) }
}

fn csv(rows: &[Row]) -> String {
    let mut text = COLUMNS.join(",") + "\n";
    for row in rows {
        let values = row.values().map(|value| match value {
            Value::String(text) if text.contains([',', '"', '\n']) => format!("\"{}\"", text.replace('"', "\"\"")),
            Value::String(text) => text,
            other => other.to_string(),
        });
        text += &(values.join(",") + "\n");
    }
    text
}

fn table(rows: &[Row]) -> String {
    let mut text = String::new();
    let mut scene = "";
    for row in rows {
        if row.scene != scene {
            scene = &row.scene;
            let _ = writeln!(text, "{scene}: {} triangles, one thread", row.triangles);
            let _ = writeln!(
                text,
                "{:8} {:8} {:>9} {:>8} {:>9} {:>9} {:>9} {:>9} {:>10}",
                "rays", "accel", "Mrays/s", "build s", "bytes/tri", "refs/tri", "nodes/ray", "tris/ray", "mismatches"
            );
        }
        let per_triangle = |x: usize| x as f64 / row.triangles.max(1) as f64;
        let _ = writeln!(
            text,
            "{:8} {:8} {:9.3} {:8.3} {:9.1} {:9.2} {:9.1} {:9.1} {:>10}",
            row.rays,
            row.accel,
            row.mrays_per_second,
            row.build_seconds,
            per_triangle(row.bytes),
            per_triangle(row.references),
            row.nodes_per_ray,
            row.triangles_per_ray,
            format!("{}/{}", row.mismatches, row.checked)
        );
    }
    text
}
