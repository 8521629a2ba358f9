//! `wavecast bench accel`: every structure over the same triangles and the same rays.

use std::{fs, io::Write as _, path::Path, time::Instant};

use rayon::{ThreadPoolBuilder, prelude::*};
use serde_json::{Value, json};

use wavecast::{accel::Quality, film::write_file};

use super::{
    Args, builds,
    contender::{Answer, Built, Choice, Contender, WAVE, Waves, chosen},
    draw, glb, growth,
    peers::{self, Peers},
    plot,
    rays::{Batch, Corners, batches},
    report::{PEERS, Row, Spread, csv, markdown, table},
    subject::Subject,
    truth::{Truth, answers_of},
};
use crate::cli::{Outcome, console::Console, error::CliError};

/// How to measure.
pub struct Settings {
    /// Structures.
    pub chosen: Vec<Choice>,
    /// What they are compared with.
    pub peers: Peers<[Corners], Built>,
    /// What that is, in one line.
    pub peers_are: Option<String>,
    /// Times each figure is taken.
    pub runs: u32,
    /// Rays of each kind.
    pub rays: u32,
    /// Numbers of threads.
    pub scaling: Vec<usize>,
}

/// Times each figure is taken if nothing is said.
const RUNS: u32 = 5;
/// As above, where ratios with other programs are to be trusted.
const RUNS_WITH_PEERS: u32 = 9;

/// Times each figure is taken.
pub fn runs(args: &Args, with_peers: bool) -> u32 {
    args.runs.unwrap_or(if with_peers { RUNS_WITH_PEERS } else { RUNS })
}

impl Settings {
    fn new(args: &Args) -> Result<Self, CliError> {
        let (peers, peers_are) = peers::to_ask(args)?;
        let runs = runs(args, peers_are.is_some());
        let scaling = if args.scaling.is_empty() { vec![1] } else { args.scaling.iter().map(|n| n.get()).collect() };
        Ok(Self {
            chosen: chosen(&args.accel, args.build_quality.unwrap_or_default().into())?,
            peers,
            peers_are,
            runs,
            rays: args.rays,
            scaling,
        })
    }
}

/// Measures each scene and reports; or draws.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    for folder in args.output.iter().chain(&args.draw) {
        fs::create_dir_all(folder).map_err(|source| CliError::Output { path: folder.clone(), source })?;
    }
    if let Some(folder) = &args.write_scenes {
        return glb::run(folder, args, console);
    }
    if args.builds {
        return builds::run(args, console);
    }
    let settings = Settings::new(args)?;
    if let Some(folder) = &args.draw {
        return draw::run(folder, args, &settings, console);
    }
    if !args.growth.is_empty() {
        return growth::run(args, &settings, console);
    }
    let mut rows = Vec::new();
    for source in &args.scenes {
        let subject = Subject::new(source, args.view, console)?;
        let first = rows.len();
        rows.extend(measure(&subject, &settings.chosen, &settings, console)?);
        if let Some(folder) = &args.output {
            let threads = settings.scaling[0];
            let bars: Vec<&Row> = rows[first..].iter().filter(|row| row.threads == threads).collect();
            plot::bars(&folder.join(format!("accel-{}.svg", Subject::file_name(&subject.name))), &bars)?;
        }
    }
    report(&rows, args.output.as_deref(), &settings, console)
}

/// Writes the tables, and fails if a structure of ours was wrong.
fn report(rows: &[Row], folder: Option<&Path>, settings: &Settings, console: &Console) -> Result<Outcome, CliError> {
    if let Some(folder) = folder {
        write_tables(rows, &folder.join("accel"), settings)?;
    }
    let lines: Vec<String> = settings.peers_are.iter().cloned().chain([table(rows)]).collect();
    console.result(&lines.join("\n"), || json(rows, &[], settings));
    verdict(rows)
}

/// Writes the tables, each whole or not at all.
pub fn write_tables(rows: &[Row], path: &Path, settings: &Settings) -> Result<(), CliError> {
    let tables = [("csv", csv(rows.iter().map(Row::json))), ("md", markdown(rows, settings.peers_are.as_deref()))];
    for (ending, text) in tables {
        write_file(&path.with_extension(ending), |file| file.write_all(text.as_bytes()))?;
    }
    Ok(())
}

/// For programs.
pub fn json(rows: &[Row], stopped: &[String], settings: &Settings) -> Value {
    let rows: Vec<Value> = rows.iter().map(|row| row.json().into()).collect();
    json!({ "rows": rows, "compared_with": settings.peers_are, "stopped": stopped })
}

/// An error if a structure of ours gave a wrong answer: then its times mean nothing.
pub fn verdict(rows: &[Row]) -> Result<Outcome, CliError> {
    match rows.iter().find(|row| row.ours && row.mismatches > 0) {
        None => Ok(Outcome::Done),
        Some(row) => Err(CliError::WrongHits {
            scene: row.scene.clone(),
            accel: row.accel,
            rays: row.rays,
            mismatches: row.mismatches,
            checked: row.checked,
        }),
    }
}

/// Builds all structures over one scene, holds their answers against the truth, and takes the time.
pub fn measure(
    subject: &Subject,
    chosen: &[Choice],
    settings: &Settings,
    console: &Console,
) -> Result<Vec<Row>, CliError> {
    let triangles = &subject.triangles;
    let batches = batches(&subject.view, triangles, &Waves::build(triangles, Quality::Good).accel, settings.rays);
    let mut built = Vec::new();
    for (name, build) in chosen {
        console.note(format!("{}: building {name} over {} triangles", subject.name, triangles.len()));
        let start = Instant::now();
        let structure = build(triangles);
        built.push(Built { name, structure, seconds: start.elapsed().as_secs_f64() });
    }
    built.extend((settings.peers)(triangles)?);
    let mut rows = Vec::new();
    for batch in batches.iter().filter(|batch| !batch.rays.is_empty()) {
        let takers: Vec<&Built> = built.iter().filter(|one| one.structure.takes(batch.kind)).collect();
        let answers: Vec<_> = takers.iter().map(|one| answers_of(&*one.structure, batch)).collect();
        let mut truth = Truth::ask(triangles, batch);
        let ours = takers.iter().zip(&answers).filter(|(one, _)| one.structure.is_ours());
        ours.for_each(|(_, answers)| truth.hear(answers));
        rows.extend(in_turn(subject, batch, &truth, &takers, &answers, settings)?);
    }
    by_threads(&mut rows, settings);
    Ok(rows)
}

/// Puts rows of the same number of threads together.
pub fn by_threads(rows: &mut [Row], settings: &Settings) {
    rows.sort_by_key(|row| settings.scaling.iter().position(|&threads| threads == row.threads));
}

/// The rows of those that take a batch, who have given their answers.
pub fn in_turn(
    subject: &Subject,
    batch: &Batch,
    truth: &Truth,
    takers: &[&Built],
    answers: &[Vec<Answer>],
    settings: &Settings,
) -> Result<Vec<Row>, CliError> {
    let triangles = subject.triangles.len();
    let mut rows = Vec::new();
    for &threads in &settings.scaling {
        let seconds = times(takers, batch, threads, settings.runs)?;
        for (place, one) in takers.iter().enumerate() {
            let count = batch.rays.len();
            let work = one.structure.work(&batch.rays, batch.question);
            let agrees = |truth: &_, answer: &_| one.structure.agrees(truth, answer);
            rows.push(Row {
                scene: subject.name.clone(),
                triangles,
                threads,
                accel: one.name,
                ours: one.structure.is_ours(),
                rays: batch.kind,
                count,
                mrays_per_second: Spread::of(seconds[place].iter().map(|s| count as f64 / s / 1e6).collect()),
                build_seconds: one.seconds,
                bytes: one.structure.bytes(),
                references: one.structure.references(),
                lane_fill: work.filter(|work| work.lanes > 0).map(|work| work.used_lanes as f64 / work.lanes as f64),
                nodes_per_ray: work.map(|work| work.nodes as f64 / count as f64),
                triangles_per_ray: work.map(|work| work.triangles as f64 / count as f64),
                by_brute_force: truth.asked(),
                checked: truth.known(),
                mismatches: truth.mismatches(&answers[place], agrees),
                over: over(takers, &seconds, place),
            });
        }
    }
    Ok(rows)
}

/// Seconds that each took in each run. They take turns, so that whatever else the machine does falls upon all.
fn times(takers: &[&Built], batch: &Batch, threads: usize, runs: u32) -> Result<Vec<Vec<f64>>, CliError> {
    let mut answers = vec![None; batch.rays.len()];
    let mut seconds = vec![Vec::new(); takers.len()];
    let mut run_all = || {
        for _ in 0..runs {
            for (one, seconds) in takers.iter().zip(&mut seconds) {
                let start = Instant::now();
                ask(&*one.structure, batch, threads, &mut answers);
                seconds.push(start.elapsed().as_secs_f64());
            }
        }
    };
    if threads == 1 {
        // Here, on the core that it has been given.
        run_all();
    } else {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|error| CliError::Usage(format!("cannot start {threads} threads: {error}")))?;
        // By one of them, as it would otherwise have to be woken for each run.
        pool.install(run_all);
    }
    Ok(seconds)
}

fn ask(structure: &dyn Contender, batch: &Batch, threads: usize, answers: &mut [Answer]) {
    if threads == 1 {
        return structure.answers(&batch.rays, batch.question, answers);
    }
    let pieces = batch.rays.par_chunks(WAVE).zip(answers.par_chunks_mut(WAVE));
    pieces.for_each(|(rays, into)| structure.answers(rays, batch.question, into));
}

/// How much faster one is than each of [`PEERS`], by run.
fn over(takers: &[&Built], seconds: &[Vec<f64>], place: usize) -> [Option<Spread>; 3] {
    PEERS.map(|peer| {
        let median = |place: &usize| Spread::of(seconds[*place].clone()).median;
        let is_peer = |name: &str| match peer {
            "embree_packet" => name.starts_with("embree-packet"),
            _ => name.replace('-', "_") == peer,
        };
        let all = (0..takers.len()).filter(|&other| !takers[other].structure.is_ours() && is_peer(takers[other].name));
        let best = all.min_by(|a, b| median(a).total_cmp(&median(b)))?;
        let ratios = seconds[best].iter().zip(&seconds[place]).map(|(peer, one)| peer / one);
        (best != place).then(|| Spread::of(ratios.collect()))
    })
}

#[cfg(test)]
mod tests {
    use wavecast::accel::{Bvh2, Structure};

    use super::*;
    use crate::cli::bench::{
        contender::{Question, structures, tests::broken},
        subject::{Formula, Source},
    };

    fn measured(chosen: Vec<Choice>) -> Vec<Row> {
        let mut console = Console::new(true, false);
        let subject = Subject::new(&Source::Generated(Formula::Hall, 2000), None, &mut console).unwrap();
        let peers: Peers<_, _> = Box::new(|_| Ok(Vec::new()));
        let settings = Settings { chosen, peers, peers_are: None, runs: 1, rays: 2048, scaling: vec![1, 2] };
        measure(&subject, &settings.chosen, &settings, &console).unwrap()
    }

    /// A structure that has lost triangles is found out, in all kinds of rays, whether there are others to compare it
    /// with or not, and the others are not blamed.
    #[test]
    fn a_broken_structure_is_reported() {
        for others in [0, 1, 6] {
            let chosen = structures().into_iter().take(others).chain([broken::<Bvh2>()]).collect();
            let rows = measured(chosen);
            assert_eq!(rows.len(), (others + 1) * 4 * 2);
            for row in &rows {
                let wrong = row.accel == "lossy";
                assert_eq!(row.mismatches > 0, wrong, "{} {}: {}", row.accel, row.rays, row.mismatches);
                assert!(row.checked > 1000, "{}", row.checked);
            }
            assert!(matches!(verdict(&rows), Err(CliError::WrongHits { accel: "lossy", .. })));
        }
        assert!(verdict(&measured(structures().to_vec())).is_ok());
    }

    /// Over itself nothing is known, over the faster of the packets and over others by run.
    #[test]
    fn ratios_are_those_of_the_same_run() {
        struct Peer(bool);
        impl Contender for Peer {
            fn bytes(&self) -> usize {
                0
            }
            fn references(&self) -> Option<usize> {
                None
            }
            fn answers(&self, _: &[super::super::rays::OneRay], _: Question, _: &mut [Answer]) {}
            fn work(&self, _: &[super::super::rays::OneRay], _: Question) -> Option<wavecast::accel::Work> {
                None
            }
            fn cells(&self, _: &mut dyn FnMut(wavecast::accel::Cell)) {}
            fn is_ours(&self) -> bool {
                self.0
            }
        }
        let names = [Bvh2::NAME, "embree", "embree-packet8", "embree-packet16"];
        let built = names.map(|name| Built { name, structure: Box::new(Peer(name == Bvh2::NAME)), seconds: 0.0 });
        let takers: Vec<&Built> = built.iter().collect();
        let seconds = [vec![1.0, 2.0, 4.0], vec![2.0, 2.0, 2.0], vec![9.0; 3], vec![3.0; 3]];
        let [fast, robust, packet] = over(&takers, &seconds, 0).map(|o| o.map(|o| (o.min, o.median, o.max)));
        assert_eq!(fast, Some((0.5, 1.0, 2.0)));
        assert_eq!(robust, None);
        assert_eq!(packet, Some((0.75, 1.5, 3.0)));
        assert!(over(&takers, &seconds, 1)[0].is_none());
    }
}
