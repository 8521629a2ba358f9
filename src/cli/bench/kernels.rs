//! `wavecast bench kernels`: what a ray-triangle test costs, and whether rays slip through between triangles.

use std::{fmt::Write as _, fs, hint::black_box, sync::Arc, time::Instant};

use rayon::prelude::*;
use serde_json::{Value, json};
use wavecast::accel::{
    Accel, AccelKind, Blas, Brute, Bsp, Bvh2, Grid, InstanceRef, KdTree, Leaf, Obb, Octree, Ray, Structure,
    TriangleBlock,
    textbook::{
        Counted, Operations, Sheared, counted, moller_trumbore, moller_trumbore_corners, plane_and_inside, vector,
        watertight,
    },
    watertight::{Closed, OFFSETS, TESTS, Target, misses, misses_of_test, misses_of_waves},
};

use super::{Args, boxes};
use crate::cli::{Outcome, console::Console, error::CliError};

/// Rays at a time: enough to share out, few enough to hold.
const BLOCK: usize = 1 << 16;
/// Rays for the tests alone, at most: each asks all triangles.
const MOST: usize = 1_000_000;
/// Rays and triangles of which all pairs are timed: they fit the first-level cache.
const TIMED: [usize; 2] = [512, 256];

type Corners = [[f32; 3]; 3];

/// A test's cost.
struct Cost {
    test: &'static str,
    ns: f64,
    operations: Operations,
}

/// How many rays of so many slipped through.
struct Leak {
    subject: String,
    offset: [f64; 3],
    target: &'static str,
    trials: usize,
    misses: usize,
}

impl Leak {
    /// What the share of misses is below at a confidence of 95 %, if there was none: the rule of three.
    fn bound(&self) -> Option<f64> {
        (self.misses == 0).then(|| 3.0 / self.trials.max(1) as f64)
    }

    fn per_million(&self) -> f64 {
        1e6 * self.misses as f64 / self.trials.max(1) as f64
    }

    fn offset(&self) -> String {
        let [x, y, z] = self.offset;
        format!("{x} {y} {z}")
    }

    fn json(&self) -> Value {
        json!({
            "subject": self.subject,
            "offset": self.offset,
            "target": self.target,
            "trials": self.trials,
            "misses": self.misses,
            "bound": self.bound(),
        })
    }
}

impl Cost {
    fn json(&self) -> Value {
        let Operations { divisions, multiplications, additions, comparisons } = self.operations;
        json!({
            "test": self.test,
            "ns": self.ns,
            "divisions": divisions,
            "multiplications": multiplications,
            "additions": additions,
            "comparisons": comparisons,
        })
    }
}

/// A closed mesh's rays, asked of something; returns the misses.
type Ask = Box<dyn Fn(&Closed) -> Box<dyn Fn(&wavecast::accel::RayList) -> usize + Sync> + Sync>;

fn single<S: Structure + 'static>() -> (&'static str, Ask) {
    let ask = |mesh: &Closed| -> Box<dyn Fn(&wavecast::accel::RayList) -> usize + Sync> {
        let structure = S::build(&mesh.triangles);
        Box::new(move |rays| misses(&structure, rays))
    };
    (S::NAME, Box::new(ask))
}

/// The renderer's way: waves through the eight-wide tree.
fn waves(mesh: &Closed) -> Box<dyn Fn(&wavecast::accel::RayList) -> usize + Sync> {
    let only = InstanceRef::unmoved(Arc::new(Blas::build(&mesh.triangles)));
    let accel = Accel::build(vec![only]);
    Box::new(move |rays| misses_of_waves(&accel, rays))
}

/// Structures by name.
fn structures() -> [(&'static str, Ask); 8] {
    [
        (AccelKind::default().name(), Box::new(waves)),
        single::<Bvh2>(),
        single::<Obb>(),
        single::<KdTree>(),
        single::<Octree>(),
        single::<Bsp>(),
        single::<Grid>(),
        single::<Brute>(),
    ]
}

/// Those asked for; without a wish all but brute force.
fn chosen(names: &[String]) -> Result<Vec<(&'static str, Ask)>, CliError> {
    let known = structures().map(|(name, _)| name);
    if let Some(wrong) = names.iter().find(|wanted| !known.contains(&wanted.as_str())) {
        return Err(CliError::Usage(format!("there is no structure {wrong:?}; there is {}", known.join(", "))));
    }
    let wanted = |name: &str| if names.is_empty() { name != Brute::NAME } else { names.iter().any(|n| n == name) };
    Ok(structures().into_iter().filter(|(name, _)| wanted(name)).collect())
}

/// Measures and reports.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    let chosen = chosen(&args.accel)?;
    if let Some(folder) = &args.output {
        fs::create_dir_all(folder).map_err(|source| CliError::Output { path: folder.clone(), source })?;
    }
    let costs = costs(args.runs.unwrap_or(5));
    let rays = args.rays as usize;
    let mut leaks = Vec::new();
    for (test, ask) in TESTS {
        for offset in &OFFSETS[..2] {
            let mesh = Closed::small(*offset);
            let ask = |rays: &_| misses_of_test(ask, &mesh.triangles, rays);
            leaks.extend(leaks_of(&format!("{test} test"), *offset, &[(&mesh, &ask)], rays.min(MOST)));
        }
    }
    for (name, ask) in chosen {
        for offset in OFFSETS {
            console.note(format!("{name} at {offset:?}"));
            let meshes = Closed::all(offset);
            let asks: Vec<_> = meshes.iter().map(|mesh| (mesh, ask(mesh))).collect();
            let asks: Vec<_> = asks.iter().map(|(mesh, ask)| (*mesh, &**ask)).collect();
            leaks.extend(leaks_of(name, offset, &asks, rays));
        }
    }
    console.note("upright and turned boxes");
    let fits = boxes::measure(args);
    if let Some(folder) = &args.output {
        let files = [
            ("kernels.csv", costs_csv(&costs)),
            ("watertight.csv", leaks_csv(&leaks)),
            ("boxes.csv", boxes::csv(&fits)),
        ];
        for (name, text) in files {
            let path = folder.join(name);
            fs::write(&path, text).map_err(|source| CliError::Output { path, source })?;
        }
    }
    console.result(&(table(&costs, &leaks) + &boxes::table(&fits)), || {
        json!({
            "tests": costs.iter().map(Cost::json).collect::<Vec<_>>(),
            "watertight": leaks.iter().map(Leak::json).collect::<Vec<_>>(),
            "boxes": fits.iter().map(boxes::Fit::json).collect::<Vec<_>>(),
        })
    });
    Ok(Outcome::Done)
}

/// A mesh and who is asked about it.
type Asked<'a> = (&'a Closed, &'a (dyn Fn(&wavecast::accel::RayList) -> usize + Sync));

/// Rays at vertices and at edges, so many each, shared out among meshes.
fn leaks_of(subject: &str, offset: [f64; 3], asked: &[Asked], rays: usize) -> Vec<Leak> {
    let of = |(target, kind): (&'static str, Target)| {
        let blocks = rays.div_ceil(asked.len()).div_ceil(BLOCK);
        let counts: Vec<(usize, usize)> = (0..blocks * asked.len())
            .into_par_iter()
            .map(|block| {
                let (mesh, ask) = asked[block % asked.len()];
                let rays = mesh.rays(kind, BLOCK.min(rays.div_ceil(asked.len())), block as u64);
                (rays.0.len(), ask(&rays))
            })
            .collect();
        let (trials, misses) = counts.into_iter().fold((0, 0), |(n, m), (trials, misses)| (n + trials, m + misses));
        Leak { subject: subject.to_owned(), offset, target, trials, misses }
    };
    Target::ALL.map(of).into()
}

/// The cost of each test, and of the eight-wide one that renders.
fn costs(runs: u32) -> Vec<Cost> {
    let mesh = Closed::small([0.0; 3]);
    let rays = mesh.rays(Target::Edge, TIMED[0], 1).0;
    let triangles: Vec<Corners> = mesh.triangles.iter().copied().cycle().take(TIMED[1]).collect();
    let blocks: Vec<TriangleBlock> =
        triangles.chunks(8).map(|eight| TriangleBlock::new((0..).zip(eight.iter().copied()))).collect();
    let with_edges: Vec<Corners> = triangles
        .iter()
        .map(|&[a, b, c]| {
            let edge = |to: [f32; 3]| std::array::from_fn(|axis| to[axis] - a[axis]);
            [a, edge(b), edge(c)]
        })
        .collect();
    let far = f32::INFINITY;
    // Each triangle is put into a black box, or the compiler tests eight at a time after all.
    let plane = || {
        let test = |&(o, d, _): &([f32; 3], [f32; 3], f32)| {
            triangles.iter().filter(|corners| plane_and_inside(o, d, black_box(corners), far).is_some()).count()
        };
        rays.iter().map(test).sum()
    };
    let stored = || {
        let test = |&(o, d, _): &([f32; 3], [f32; 3], f32)| {
            let one = |corners: &&Corners| {
                let [corner, e1, e2] = *black_box(*corners);
                moller_trumbore(o, d, corner, e1, e2, far).is_some()
            };
            with_edges.iter().filter(one).count()
        };
        rays.iter().map(test).sum()
    };
    let moller = || {
        let test = |&(o, d, _): &([f32; 3], [f32; 3], f32)| {
            triangles.iter().filter(|corners| moller_trumbore_corners(o, d, black_box(corners), far).is_some()).count()
        };
        rays.iter().map(test).sum()
    };
    let woop = || {
        let test = |&(o, d, _): &([f32; 3], [f32; 3], f32)| {
            let ray = Sheared::new(o, d);
            triangles.iter().filter(|corners| watertight(&ray, black_box(corners), far).is_some()).count()
        };
        rays.iter().map(test).sum()
    };
    let eight = || {
        let test = |&(o, d, _): &([f32; 3], [f32; 3], f32)| -> usize {
            let ray = Ray::new(o, d);
            blocks.iter().map(|block| black_box(block).intersect(&ray, far).hits.count_ones() as usize).sum()
        };
        rays.iter().map(test).sum()
    };
    let timed: [(&'static str, &dyn Fn() -> usize); 5] = [
        ("plane", &plane),
        ("moller-trumbore, edges stored", &stored),
        ("moller-trumbore", &moller),
        ("watertight", &woop),
        ("watertight, eight at a time", &eight),
    ];
    let mut ns = vec![Vec::new(); timed.len()];
    // In turn, so that whatever else the machine does falls upon all.
    for _ in 0..runs {
        for ((_, test), ns) in timed.iter().zip(&mut ns) {
            const REPEATS: usize = 8;
            let start = Instant::now();
            (0..REPEATS).for_each(|_| {
                black_box(test());
            });
            ns.push(start.elapsed().as_secs_f64() * 1e9 / (REPEATS * TIMED[0] * TIMED[1]) as f64);
        }
    }
    let cost = |((test, _), mut ns): ((&'static str, &dyn Fn() -> usize), Vec<f64>)| {
        ns.sort_unstable_by(f64::total_cmp);
        Cost { test, ns: ns[ns.len() / 2], operations: operations(test) }
    };
    timed.into_iter().zip(ns).map(cost).collect()
}

/// Operations of a test that ends in a hit, without what is done once for a ray.
fn operations(test: &str) -> Operations {
    let [o, d] = [[0.25, 0.5, 2.0], [0.0, 0.0, -1.0]].map(vector::<Counted>);
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(vector::<Counted>);
    let far = Counted(f32::INFINITY);
    let (_, operations) = match test {
        "plane" => counted(|| plane_and_inside(o, d, &corners, far).is_some()),
        "moller-trumbore" => counted(|| moller_trumbore_corners(o, d, &corners, far).is_some()),
        "moller-trumbore, edges stored" => {
            counted(|| moller_trumbore(o, d, corners[0], corners[1], corners[2], far).is_some())
        }
        _ => {
            let ray = Sheared::new(o, d);
            counted(|| watertight(&ray, &corners, far).is_some())
        }
    };
    operations
}

fn costs_csv(costs: &[Cost]) -> String {
    let mut text = "test,ns,divisions,multiplications,additions,comparisons\n".to_owned();
    for Cost { test, ns, operations } in costs {
        let Operations { divisions, multiplications, additions, comparisons } = operations;
        let _ = writeln!(text, "\"{test}\",{ns},{divisions},{multiplications},{additions},{comparisons}");
    }
    text
}

fn leaks_csv(leaks: &[Leak]) -> String {
    let mut text = "subject,offset,target,trials,misses,bound\n".to_owned();
    for leak in leaks {
        let Leak { subject, target, trials, misses, .. } = leak;
        let bound = leak.bound().map_or_else(String::new, |bound| bound.to_string());
        let _ = writeln!(text, "{subject},{},{target},{trials},{misses},{bound}", leak.offset());
    }
    text
}

fn table(costs: &[Cost], leaks: &[Leak]) -> String {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{:30} {:>8} {:>5} {:>5} {:>5} {:>5}   f32, one thread; operations of a hit",
        "test", "ns", "div", "mul", "add", "cmp"
    );
    for Cost { test, ns, operations } in costs {
        let Operations { divisions, multiplications, additions, comparisons } = operations;
        let _ = writeln!(text, "{test:30} {ns:8.2} {divisions:5} {multiplications:5} {additions:5} {comparisons:5}");
    }
    let _ = writeln!(
        text,
        "\n{:20} {:20} {:8} {:>10} {:>8} {:>12}   rays from inside closed meshes; bound at 95 %",
        "misses", "offset", "target", "trials", "misses", "per million"
    );
    for leak in leaks {
        let share = match leak.bound() {
            Some(bound) => format!("< {:.4}", 1e6 * bound),
            None => format!("{:.1}", leak.per_million()),
        };
        let Leak { subject, target, trials, misses, .. } = leak;
        let _ = writeln!(text, "{subject:20} {:20} {target:8} {trials:10} {misses:8} {share:>12}", leak.offset());
    }
    text
}
