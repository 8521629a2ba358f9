//! `wavecast bench kernels`: what a ray-triangle test costs, and whether rays slip through between triangles.

use std::{fmt::Write as _, fs, hint::black_box, io::Write as _, time::Instant};

use serde_json::{Value, json};
use wavecast::{
    accel::{
        Leaf, Ray, TriangleBlock,
        textbook::{
            Counted, Operations, Sheared, counted, moller_trumbore, moller_trumbore_corners, plane_and_inside, vector,
            watertight,
        },
        watertight::{Closed, Target},
    },
    film::write_file,
};

use super::{Args, boxes, leaks::Plan};
use crate::cli::{Outcome, console::Console, error::CliError};

/// Rays and triangles of which all pairs are timed: they fit the first-level cache.
const TIMED: [usize; 2] = [512, 256];

type Corners = [[f32; 3]; 3];

/// A test's cost.
struct Cost {
    test: &'static str,
    ns: f64,
    operations: Operations,
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

/// Measures, tells each figure as soon as it is known, and reports.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    let plan = Plan::new(&args.accel, args.rays)?;
    let folder = args.output.as_deref();
    if let Some(folder) = folder {
        fs::create_dir_all(folder).map_err(|source| CliError::Output { path: folder.into(), source })?;
    }
    let costs = costs(args.runs.unwrap_or(5));
    console.part(&table(&costs));
    if let Some(folder) = folder {
        write_file(&folder.join("kernels.csv"), |file| file.write_all(costs_csv(&costs).as_bytes()))?;
    }
    let leaks = plan.run(folder, console)?;
    let fits = boxes::measure(args, console)?;
    console.end(|| {
        json!({
            "tests": costs.iter().map(Cost::json).collect::<Vec<_>>(),
            "watertight": leaks.json(),
            "watertight_totals": leaks.totals_json(),
            "boxes": fits.iter().map(boxes::Fit::json).collect::<Vec<_>>(),
        })
    });
    leaks.verdict().map(|()| Outcome::Done)
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

fn table(costs: &[Cost]) -> String {
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
    text
}
