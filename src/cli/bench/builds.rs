//! How long trees take to build, to be refitted around what has moved, and to be put over instances.

use std::{
    fmt::Write as _,
    fs,
    sync::Arc,
    time::{Duration, Instant},
};

use serde_json::{Map, Value, json};
use wavecast::accel::{Accel, AccelKind, Blas, InstanceRef, Quality};

use super::{
    Args,
    accel::runs,
    peers::{self, Peers},
    rays::Corners,
    report::{Spread, csv},
    subject::Subject,
};
use crate::cli::{Outcome, console::Console, error::CliError};

/// Instances that a top level is built over.
const PLACED: usize = 10_000;

/// Seconds, and how many of them went into a binary tree, where there is one.
pub type Taken = (f64, Option<f64>);

/// Something whose time can be taken again and again.
pub struct Timed {
    /// One of [`WHAT`].
    pub what: &'static str,
    /// As tables call it.
    pub name: &'static str,
    /// Does it.
    pub run: Box<dyn FnMut() -> Result<Taken, CliError>>,
}

/// What is done, and what ratios are taken to.
pub const WHAT: [(&str, &str); 3] = [("build", "embree-medium"), ("refit", "embree"), ("instances", "embree")];

/// What trees are built over.
#[derive(Clone)]
pub struct Ground {
    /// A mesh.
    pub triangles: Arc<Vec<Corners>>,
    /// The same, with its corners elsewhere.
    pub moved: Arc<Vec<Corners>>,
    /// Where it is placed, as 3×4 matrices by rows: to the world and back.
    pub places: Arc<Vec<[[f32; 12]; 2]>>,
}

impl Ground {
    /// A wave goes through the mesh, a hundredth of its size high; its copies stand in a cube that they fill loosely,
    /// each turned about its upright axis.
    fn new(triangles: Vec<Corners>) -> Self {
        let points = triangles.iter().flatten();
        let bounds = points.fold([[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]], |[lower, upper], point| {
            [std::array::from_fn(|i| lower[i].min(point[i])), std::array::from_fn(|i| upper[i].max(point[i]))]
        });
        let size = (0..3).map(|axis| bounds[1][axis] - bounds[0][axis]).fold(f32::MIN_POSITIVE, f32::max);
        let wave = |[x, y, z]: [f32; 3]| [x, y + 0.01 * size * (10.0 * (x + z) / size).sin(), z];
        let moved = triangles.iter().map(|corners| corners.map(wave)).collect();
        // Multiples of irrational numbers are spread evenly (Roberts 2018, "The Unreasonable Effectiveness of
        // Quasirandom Sequences").
        let side = f64::from(size) * (PLACED as f64).cbrt();
        let place = |i: usize| {
            let at = |step: f64| (0.5 + step * i as f64).fract();
            let [x, y, z] = [0.819_172_513, 0.671_043_607, 0.549_700_478].map(|step| side * at(step));
            let (sin, cos) = (std::f64::consts::TAU * at(0.618_033_989)).sin_cos();
            let there = [cos, 0.0, sin, x, 0.0, 1.0, 0.0, y, -sin, 0.0, cos, z];
            let back = [cos, 0.0, -sin, sin * z - cos * x, 0.0, 1.0, 0.0, -y, sin, 0.0, cos, -sin * x - cos * z];
            [there, back].map(|matrix| matrix.map(|number| number as f32))
        };
        let places = Arc::new((0..PLACED).map(place).collect());
        Self { triangles: Arc::new(triangles), moved: Arc::new(moved), places }
    }
}

/// Ours.
fn own(ground: &Ground) -> Vec<Timed> {
    let build = |name, quality| {
        let triangles = Arc::clone(&ground.triangles);
        let run = move || {
            let start = Instant::now();
            let blas = Blas::build_as(AccelKind::Bvh8(quality), &triangles);
            Ok((start.elapsed().as_secs_f64(), blas.binary_time().as_ref().map(Duration::as_secs_f64)))
        };
        Timed { what: "build", name, run: Box::new(run) }
    };
    let mesh = Arc::new(Blas::build_as(AccelKind::Bvh8(Quality::Fast), &ground.triangles));
    let instances: Vec<InstanceRef> = ground
        .places
        .iter()
        .map(|&[world_from_local, local_from_world]| InstanceRef {
            world_from_local,
            local_from_world,
            identity: false,
            ..InstanceRef::unmoved(Arc::clone(&mesh))
        })
        .collect();
    let top = move || {
        let instances = instances.clone();
        let start = Instant::now();
        let accel = Accel::build(instances);
        let seconds = start.elapsed().as_secs_f64();
        drop(accel);
        Ok((seconds, None))
    };
    let (mut there_and_back, mut tree) = ([Arc::clone(&ground.moved), Arc::clone(&ground.triangles)], (*mesh).clone());
    let refit = move || {
        let start = Instant::now();
        let done = tree.refit(&there_and_back[0]);
        let seconds = start.elapsed().as_secs_f64();
        there_and_back.swap(0, 1);
        match done {
            true => Ok((seconds, None)),
            false => Err(CliError::Usage("a triangle of the scene has no area once it is moved".into())),
        }
    };
    vec![
        build("bvh8-fast", Quality::Fast),
        build("bvh8", Quality::Good),
        build("bvh8-best", Quality::Best),
        Timed { what: "refit", name: "bvh8", run: Box::new(refit) },
        Timed { what: "instances", name: "bvh8", run: Box::new(top) },
    ]
}

/// One line of the table.
struct Row {
    scene: String,
    triangles: usize,
    what: &'static str,
    name: &'static str,
    seconds: Spread,
    /// Of the binary tree, and of the rest.
    phases: Option<[f64; 2]>,
    /// Seconds over those of the peer, by run.
    over: Option<Spread>,
}

impl Row {
    fn json(&self) -> Map<String, Value> {
        let [binary, collapse] = [0, 1].map(|phase| self.phases.map(|phases| phases[phase]));
        let columns = [
            ("scene", json!(self.scene)),
            ("triangles", json!(self.triangles)),
            ("threads", json!(rayon::current_num_threads())),
            ("what", json!(self.what)),
            ("structure", json!(self.name)),
            ("seconds", json!(self.seconds.median)),
            ("seconds_min", json!(self.seconds.min)),
            ("seconds_max", json!(self.seconds.max)),
            ("binary_seconds", json!(binary)),
            ("collapse_seconds", json!(collapse)),
            ("over_peer", json!(self.over.map(|over| over.median))),
            ("over_peer_min", json!(self.over.map(|over| over.min))),
            ("over_peer_max", json!(self.over.map(|over| over.max))),
        ];
        columns.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
    }

    /// As cells of a table.
    fn cells(&self) -> [String; 6] {
        let millis = |seconds: f64| {
            if seconds < 0.1 { format!("{:.2}", 1e3 * seconds) } else { format!("{:.0}", 1e3 * seconds) }
        };
        let spread = self.seconds;
        let [binary, collapse] = [0, 1].map(|phase| self.phases.map_or("-".into(), |phases| millis(phases[phase])));
        let over = |over: Spread| format!("{:.2} ({:.2}–{:.2})", over.median, over.min, over.max);
        [
            self.what.into(),
            self.name.into(),
            format!("{} ({}–{})", millis(spread.median), millis(spread.min), millis(spread.max)),
            binary,
            collapse,
            self.over.map_or("-".into(), over),
        ]
    }
}

const COLUMNS: [&str; 6] = ["what", "structure", "ms", "binary ms", "collapse ms", "over Embree"];

/// Takes turns, so that whatever else the machine does falls upon all.
fn measure(subject: &Subject, peers: &Peers<Ground, Timed>, runs: u32) -> Result<Vec<Row>, CliError> {
    let ground = Ground::new(subject.triangles.clone());
    let mut all = own(&ground);
    all.extend(peers(&ground)?);
    let mut taken: Vec<Vec<Taken>> = vec![Vec::new(); all.len()];
    for _ in 0..runs {
        for (one, taken) in all.iter_mut().zip(&mut taken) {
            taken.push((one.run)()?);
        }
    }
    let mut rows = Vec::new();
    for (what, peer) in WHAT {
        let of = |name: &str| all.iter().position(|one| one.what == what && one.name == name);
        let peer = of(peer);
        for (place, one) in all.iter().enumerate().filter(|(_, one)| one.what == what) {
            let seconds: Vec<f64> = taken[place].iter().map(|taken| taken.0).collect();
            let binary: Option<Vec<f64>> = taken[place].iter().map(|taken| taken.1).collect();
            let ratios = |peer: usize| taken[peer].iter().zip(&seconds).map(|(peer, one)| one / peer.0).collect();
            let phases = binary.map(|binary| {
                let rest = seconds.iter().zip(&binary).map(|(all, binary)| all - binary).collect();
                [binary, rest].map(|phase| Spread::of(phase).median)
            });
            rows.push(Row {
                scene: subject.name.clone(),
                triangles: subject.triangles.len(),
                what,
                name: one.name,
                phases,
                over: peer.filter(|peer| *peer != place).map(|peer| Spread::of(ratios(peer))),
                seconds: Spread::of(seconds),
            });
        }
    }
    Ok(rows)
}

/// Measures each scene and reports.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    let (peers, peers_are) = peers::to_build(args)?;
    let runs = runs(args, peers_are.is_some());
    let mut rows = Vec::new();
    for source in &args.scenes {
        let subject = Subject::new(source, args.view, console)?;
        console.note(format!("{}: {runs} builds of {} triangles", subject.name, subject.triangles.len()));
        rows.extend(measure(&subject, &peers, runs)?);
    }
    if let Some(folder) = &args.output {
        let about = peers_are.as_ref().map(|peers| format!("Compared with {peers}.\n\n")).unwrap_or_default();
        for (ending, text) in [("csv", csv(rows.iter().map(Row::json))), ("md", about + &tables(&rows, true))] {
            let path = folder.join("accel-builds").with_extension(ending);
            fs::write(&path, text).map_err(|source| CliError::Output { path, source })?;
        }
    }
    let lines: Vec<String> = peers_are.iter().cloned().chain([tables(&rows, false)]).collect();
    console.result(&lines.join("\n"), || {
        let rows: Vec<Value> = rows.iter().map(|row| row.json().into()).collect();
        json!({ "builds": rows, "compared_with": peers_are })
    });
    Ok(Outcome::Done)
}

/// By scene, for people or in Markdown.
fn tables(rows: &[Row], markdown: bool) -> String {
    let mut text = String::new();
    for part in rows.chunk_by(|a, b| a.scene == b.scene) {
        let threads = rayon::current_num_threads();
        let _ = writeln!(
            text,
            "{}: {} triangles, {PLACED} instances, threads: {threads}{}",
            part[0].scene,
            part[0].triangles,
            if markdown { "\n" } else { "" }
        );
        let line = |cells: [String; 6]| match markdown {
            true => format!("| {} |\n", cells.join(" | ")),
            false => {
                let [what, name, ms, binary, collapse, over] = cells;
                format!("{what:10} {name:14} {ms:>22} {binary:>10} {collapse:>12} {over:>18}\n")
            }
        };
        text += &line(COLUMNS.map(str::to_owned));
        text += if markdown { "|---|---|---|---|---|---|\n" } else { "" };
        part.iter().for_each(|row| text += &line(row.cells()));
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use wavecast::accel::{Solid, Stacks};

    use super::*;
    use crate::cli::bench::subject::{Formula, Source};

    /// Ratios are those of the same run, and each kind has a line.
    #[test]
    fn builds_refits_and_top_levels_are_measured() {
        let mut console = Console::new(true, false);
        let subject = Subject::new(&Source::Generated(Formula::Hall, 2000), None, &mut console).unwrap();
        let peers: Peers<_, _> = Box::new(|_| {
            let peer = |(what, name)| Timed { what, name, run: Box::new(|| Ok((1e6, None))) };
            Ok(WHAT.map(peer).into())
        });
        let rows = measure(&subject, &peers, 3).unwrap();
        let lines: Vec<_> = rows.iter().map(|row| (row.what, row.name)).collect();
        let [build, refit, instances] = WHAT;
        let ours = [("build", "bvh8-fast"), ("build", "bvh8"), ("build", "bvh8-best"), build, ("refit", "bvh8")];
        assert_eq!(lines, [&ours[..], &[refit, ("instances", "bvh8"), instances]].concat());
        for row in &rows {
            let own = row.name.starts_with("bvh8");
            assert_eq!(row.over.map(|over| over.median), own.then_some(row.seconds.median / 1e6));
            assert_eq!(row.phases.is_some(), own && row.what == "build");
            assert!(row.phases.is_none_or(|[binary, rest]| binary > 0.0 && rest > 0.0));
        }
    }

    /// What is at the origin of an instance is where it has been placed, and a ray that comes from above meets it.
    #[test]
    fn places_lead_there_and_back() {
        let ground = Ground::new(vec![[[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 0.0, 1.0]]]);
        let mesh = Arc::new(Blas::build(&ground.triangles));
        for &[world_from_local, local_from_world] in ground.places.iter().step_by(997) {
            let one = InstanceRef {
                world_from_local,
                local_from_world,
                identity: false,
                ..InstanceRef::unmoved(Arc::clone(&mesh))
            };
            let [x, y, z] = [3, 7, 11].map(|at| world_from_local[at]);
            let accel = Accel::build(vec![one]);
            let down = [0.0, -1.0, 0.0];
            let hit = accel.nearest([x, y + 2.0, z], down, f32::INFINITY, 0, &Solid, &mut Stacks::default());
            assert!((hit.t - 2.0).abs() < 1e-4, "{hit:?}");
        }
    }
}
