//! Whether rays slip through between triangles: rays aimed at the vertices and edges of closed meshes.

use std::{fmt::Write as _, path::Path, sync::Arc};

use rayon::prelude::*;
use serde_json::{Value, json};
use wavecast::{
    accel::{
        Accel, AccelKind, Blas, Brute, Bsp, Bvh2, Grid, InstanceRef, KdTree, Obb, Octree, RayList, Structure,
        watertight::{Closed, OFFSETS, TESTS, Target, misses, misses_of_test, misses_of_waves},
    },
    film::write_file,
};

use super::contender::pick;
use crate::cli::{console::Console, error::CliError, progress::Steps};

/// Rays at a time: enough to share out, few enough to hold.
const BLOCK: usize = 1 << 16;
/// Rays for the tests alone, at most: each asks all triangles.
const MOST: usize = 1_000_000;

/// How many rays of so many slipped through.
#[derive(Clone, Copy)]
struct Count {
    trials: usize,
    misses: usize,
}

impl Count {
    /// What the share of misses is below at a confidence of 95 %, if there was none: the rule of three.
    fn bound(self) -> Option<f64> {
        (self.misses == 0).then(|| 3.0 / self.trials.max(1) as f64)
    }

    fn per_million(self) -> f64 {
        1e6 * self.misses as f64 / self.trials.max(1) as f64
    }
}

/// The rays of one kind at one place.
struct Row {
    subject: String,
    offset: [f64; 3],
    target: &'static str,
    count: Count,
}

/// All rays that a test or structure was asked about.
struct Total {
    subject: String,
    /// False for textbook tests, which are known to lose rays.
    tight: bool,
    count: Count,
}

/// What was found.
#[derive(Default)]
pub struct Leaks {
    rows: Vec<Row>,
    totals: Vec<Total>,
}

impl Row {
    fn offset(&self) -> String {
        let [x, y, z] = self.offset;
        format!("{x} {y} {z}")
    }

    fn json(&self) -> Value {
        let Self { subject, offset, target, count } = self;
        json!({
            "subject": subject,
            "offset": offset,
            "target": target,
            "trials": count.trials,
            "misses": count.misses,
            "bound": count.bound(),
        })
    }

    /// For people.
    fn line(&self) -> String {
        let Self { subject, target, count, .. } = self;
        let Count { trials, misses } = count;
        let share = match count.bound() {
            Some(bound) => format!("< {:.4}", 1e6 * bound),
            None => format!("{:.4}", count.per_million()),
        };
        format!("{subject:20} {:20} {target:8} {trials:10} {misses:8} {share:>12}", self.offset())
    }
}

impl Total {
    fn json(&self) -> Value {
        let Count { trials, misses } = self.count;
        json!({ "subject": self.subject, "trials": trials, "misses": misses, "bound": self.count.bound() })
    }

    /// For people.
    fn line(&self) -> String {
        let Self { subject, tight, count } = self;
        let Count { trials, misses } = count;
        match (count.bound(), tight) {
            (Some(bound), _) => {
                format!("{subject}: none of {trials} rays missed, below {:.4} per million at 95 %", 1e6 * bound)
            }
            (None, true) => format!("{subject}: LEAKS: {misses} of {trials} rays missed"),
            (None, false) => format!("{subject}: {misses} of {trials} rays missed"),
        }
    }
}

/// Misses among a mesh's rays.
type Asker = Box<dyn Fn(&RayList) -> usize + Sync>;

/// Makes a mesh's [`Asker`].
type Ask = Box<dyn Fn(&Closed) -> Asker + Sync>;

fn single<S: Structure + 'static>() -> (&'static str, Ask) {
    let ask = |mesh: &Closed| -> Asker {
        let structure = S::build(&mesh.triangles);
        Box::new(move |rays| misses(&structure, rays))
    };
    (S::NAME, Box::new(ask))
}

/// The renderer's way: waves through the eight-wide tree.
fn waves(mesh: &Closed) -> Asker {
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

/// Tests and structures, each to be tried with so many rays at vertices and as many at edges, at each place.
pub struct Plan {
    structures: Vec<(&'static str, Ask)>,
    rays: usize,
}

impl Plan {
    /// Structures by their names; without a wish all but brute force.
    pub fn new(names: &[String], rays: u32) -> Result<Self, CliError> {
        Ok(Self { structures: pick(structures(), names)?, rays: rays as usize })
    }

    /// Tries all, and tells each figure as soon as it is known.
    pub fn run(self, folder: Option<&Path>, console: &Console) -> Result<Leaks, CliError> {
        console.part(&format!(
            "\n{:20} {:20} {:8} {:>10} {:>8} {:>12}   rays from inside closed meshes; bound at 95 %",
            "misses", "offset", "target", "trials", "misses", "per million"
        ));
        let steps = Steps::new(console.is_quiet());
        let mut teller = Teller { steps: &steps, folder, console, leaks: Leaks::default() };
        for (test, ask) in TESTS {
            for offset in &OFFSETS[..2] {
                let mesh = Closed::small(*offset);
                let ask = |rays: &_| misses_of_test(ask, &mesh.triangles, rays);
                teller.ask(&format!("{test} test"), *offset, &[(&mesh, &ask)], self.rays.min(MOST))?;
            }
            teller.total(test == "watertight");
        }
        for (name, ask) in &self.structures {
            for offset in OFFSETS {
                let meshes = Closed::all(offset);
                let asks: Vec<_> = meshes.iter().map(|mesh| (mesh, ask(mesh))).collect();
                let asks: Vec<_> = asks.iter().map(|(mesh, ask)| (*mesh, &**ask)).collect();
                teller.ask(name, offset, &asks, self.rays)?;
            }
            teller.total(true);
        }
        Ok(teller.leaks)
    }
}

/// A mesh and who is asked about it.
type Asked<'a> = (&'a Closed, &'a (dyn Fn(&RayList) -> usize + Sync));

/// Says what has been found, and where things stand.
struct Teller<'a> {
    steps: &'a Steps,
    folder: Option<&'a Path>,
    console: &'a Console,
    leaks: Leaks,
}

impl Teller<'_> {
    /// Rays at vertices and at edges, so many each, shared out among meshes.
    fn ask(&mut self, subject: &str, offset: [f64; 3], asked: &[Asked], rays: usize) -> Result<(), CliError> {
        for (target, kind) in Target::ALL {
            let each = rays.div_ceil(asked.len());
            let blocks = each.div_ceil(BLOCK) * asked.len();
            self.steps.begin(format!("{subject}, {target} at {offset:?}"), (blocks * BLOCK.min(each)) as u64);
            let counts: Vec<(usize, usize)> = (0..blocks)
                .into_par_iter()
                .map(|block| {
                    let (mesh, ask) = asked[block % asked.len()];
                    let rays = mesh.rays(kind, BLOCK.min(each), block as u64);
                    let misses = ask(&rays);
                    self.steps.advance(rays.0.len() as u64);
                    (rays.0.len(), misses)
                })
                .collect();
            let (trials, misses) = counts.into_iter().fold((0, 0), |(n, m), (trials, misses)| (n + trials, m + misses));
            let row = Row { subject: subject.to_owned(), offset, target, count: Count { trials, misses } };
            self.steps.above(|| self.console.part(&row.line()));
            self.leaks.rows.push(row);
            if let Some(folder) = self.folder {
                write_file(&folder.join("watertight.csv"), |file| self.leaks.write_csv(file))?;
            }
        }
        Ok(())
    }

    /// Sums up the subject of the last rows.
    fn total(&mut self, tight: bool) {
        let Some(subject) = self.leaks.rows.last().map(|row| row.subject.clone()) else { return };
        let of_subject = self.leaks.rows.iter().filter(|row| row.subject == subject);
        let add = |sum: Count, row: &Row| Count {
            trials: sum.trials + row.count.trials,
            misses: sum.misses + row.count.misses,
        };
        let count = of_subject.fold(Count { trials: 0, misses: 0 }, add);
        let total = Total { subject, tight, count };
        self.steps.above(|| self.console.part(&total.line()));
        self.leaks.totals.push(total);
    }
}

impl Leaks {
    /// By the names of the columns.
    pub fn json(&self) -> Vec<Value> {
        self.rows.iter().map(Row::json).collect()
    }

    /// As above, for each test and structure.
    pub fn totals_json(&self) -> Vec<Value> {
        self.totals.iter().map(Total::json).collect()
    }

    /// An error if rays slip through what is meant to be tight.
    pub fn verdict(&self) -> Result<(), CliError> {
        let Some(Total { subject, count, .. }) = self.totals.iter().find(|total| total.tight && total.count.misses > 0)
        else {
            return Ok(());
        };
        Err(CliError::Leaks { subject: subject.clone(), misses: count.misses, trials: count.trials })
    }

    fn write_csv(&self, file: &mut impl std::io::Write) -> std::io::Result<()> {
        let mut text = "subject,offset,target,trials,misses,bound\n".to_owned();
        for row in &self.rows {
            let Row { subject, target, count, .. } = row;
            let bound = count.bound().map_or_else(String::new, |bound| bound.to_string());
            let _ = writeln!(text, "{subject},{},{target},{},{},{bound}", row.offset(), count.trials, count.misses);
        }
        file.write_all(text.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn teller<'a>(steps: &'a Steps, console: &'a Console) -> Teller<'a> {
        Teller { steps, folder: None, console, leaks: Leaks::default() }
    }

    /// Of 1000 rays at vertices and 1000 at edges, one that asks loses every second.
    #[test]
    fn what_loses_rays_is_told_from_what_does_not() {
        let (steps, console) = (Steps::new(true), Console::new(true, true));
        let mut teller = teller(&steps, &console);
        let mesh = Closed::small([0.0; 3]);
        let (none, half) = (|_: &RayList| 0, |rays: &RayList| rays.0.len() / 2);
        teller.ask("sound", [0.0; 3], &[(&mesh, &none)], 1000).unwrap();
        teller.total(true);
        teller.ask("known", [0.0; 3], &[(&mesh, &half)], 1000).unwrap();
        teller.total(false);
        assert!(teller.leaks.verdict().is_ok());
        teller.ask("broken", [0.0; 3], &[(&mesh, &none), (&mesh, &half)], 1000).unwrap();
        teller.total(true);
        let lines: Vec<String> = teller.leaks.totals.iter().map(Total::line).collect();
        assert_eq!(
            lines,
            [
                "sound: none of 2000 rays missed, below 1500.0000 per million at 95 %",
                "known: 1000 of 2000 rays missed",
                "broken: LEAKS: 500 of 2000 rays missed",
            ]
        );
        let verdict = teller.leaks.verdict();
        assert!(matches!(&verdict, Err(CliError::Leaks { subject, misses: 500, .. }) if subject == "broken"));
    }
}
