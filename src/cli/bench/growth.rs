//! How speed, build time and memory grow with the number of triangles.

use std::{collections::HashMap, path::Path, time::Instant};

use wavecast::accel::Quality;

use super::{
    Args,
    accel::{Settings, by_threads, in_turn, json, verdict, write_tables},
    contender::{Answer, Built, Choice, Waves},
    plot,
    rays::batches,
    report::{Row, heading, line, same_part},
    subject::{Formula, Source, Subject},
    truth::{Truth, answers_of},
};
use crate::cli::{Outcome, console::Console, error::CliError, progress::Steps};

/// Measures every generated scene in all sizes; a structure whose builds get too slow stops. All that is known is told
/// and written after each structure.
pub fn run(args: &Args, settings: &Settings, console: &mut Console) -> Result<Outcome, CliError> {
    let mut formulas = Vec::new();
    for source in &args.scenes {
        match source {
            Source::Generated(formula, _) => formulas.push(*formula),
            Source::File(_) => {
                return Err(CliError::Usage(format!("{source} cannot grow (--growth); hall and foliage can")));
            }
        }
    }
    if let Some(peers) = &settings.peers_are {
        console.part(peers);
    }
    let mut record = Record {
        rows: Vec::new(),
        stopped: Vec::new(),
        settings,
        folder: args.output.as_deref(),
        steps: Steps::new(console.is_quiet()),
    };
    for formula in formulas {
        record.grow(formula, args, console)?;
    }
    let Record { rows, stopped, .. } = record;
    console.end(|| json(&rows, &stopped, settings));
    verdict(&rows)
}

/// What was measured.
struct Record<'a> {
    rows: Vec<Row>,
    stopped: Vec<String>,
    settings: &'a Settings,
    folder: Option<&'a Path>,
    steps: Steps,
}

/// A scene in one of its sizes.
struct Size<'a> {
    subject: &'a Subject,
    formula: Formula,
    /// The first row of the scene, and that of this size.
    first: [usize; 2],
    truths: Vec<Truth<'a>>,
    /// Answers of ours, by structure and kind of rays.
    heard: Vec<(&'static str, &'static str, Vec<Answer>)>,
}

impl Record<'_> {
    /// Measures a scene in all sizes.
    fn grow(&mut self, formula: Formula, args: &Args, console: &mut Console) -> Result<(), CliError> {
        let settings = self.settings;
        let (first, mut going, mut last) = (self.rows.len(), settings.chosen.clone(), HashMap::new());
        for &triangles in &args.growth {
            self.steps.begin(format!("{}: making {triangles} triangles", formula.name()), 0);
            let subject = Subject::new(&Source::Generated(formula, triangles), args.view, console)?;
            let (goes_on, stops) = divide(going, &last, subject.triangles.len(), args.build_limit);
            for stop in stops {
                let stop = format!("{}: {stop}", formula.name());
                self.steps.above(|| console.part(&stop));
                self.stopped.push(stop);
            }
            going = goes_on;
            if going.is_empty() && settings.peers_are.is_none() {
                break;
            }
            self.measure(&subject, formula, first, &going, console)?;
            last.extend(self.rows[first..].iter().map(|row| (row.accel, (row.triangles, row.build_seconds))));
        }
        Ok(())
    }

    /// Measures each structure alone: all of them together would not fit into memory.
    fn measure(
        &mut self,
        subject: &Subject,
        formula: Formula,
        first: usize,
        going: &[Choice],
        console: &Console,
    ) -> Result<(), CliError> {
        let Subject { name, triangles, view } = subject;
        let count = triangles.len();
        self.steps.begin(format!("{name}: rays, and what they meet of {count} triangles by brute force"), 0);
        let batches = batches(view, triangles, &Waves::build(triangles, Quality::Good).accel, self.settings.rays);
        let truths = batches.iter().filter(|batch| !batch.rays.is_empty()).map(|batch| Truth::ask(triangles, batch));
        let first = [first, self.rows.len()];
        let mut size = Size { subject, formula, first, truths: truths.collect(), heard: Vec::new() };
        for (accel, build) in going {
            self.steps.begin(format!("{name}: building {accel} over {count} triangles"), 0);
            let start = Instant::now();
            let structure = build(triangles);
            let one = Built { name: accel, structure, seconds: start.elapsed().as_secs_f64() };
            self.examine(one, &mut size, console)?;
        }
        for one in (self.settings.peers)(triangles)? {
            self.examine(one, &mut size, console)?;
        }
        Ok(())
    }

    /// Measures one and lets go of it.
    fn examine(&mut self, one: Built, size: &mut Size, console: &Console) -> Result<(), CliError> {
        let Size { subject, truths, heard, .. } = size;
        for truth in truths.iter_mut().filter(|truth| one.structure.takes(truth.batch.kind)) {
            let batch = truth.batch;
            self.steps.begin(format!("{}: {} rays through {}", subject.name, batch.kind, one.name), 0);
            let answers = [answers_of(&*one.structure, batch)];
            if one.structure.is_ours() {
                truth.hear(&answers[0]);
            }
            let rows = in_turn(subject, batch, truth, &[&one], &answers, self.settings)?;
            self.tell(&rows, size.first[1], console);
            self.rows.extend(rows);
            if one.structure.is_ours() {
                let [answers] = answers;
                heard.push((one.name, batch.kind, answers));
            }
        }
        drop(one);
        judge(&mut self.rows[size.first[1]..], size);
        by_threads(&mut self.rows[size.first[1]..], self.settings);
        self.write(size)
    }

    /// Prints rows below what there is.
    fn tell(&self, rows: &[Row], first: usize, console: &Console) {
        let mut last = self.rows[first..].last();
        self.steps.above(|| {
            for row in rows {
                if !last.is_some_and(|last| same_part(last, row)) {
                    console.part(&heading(row));
                }
                console.part(&line(row));
                last = Some(row);
            }
        });
    }

    /// Writes all tables and the scene's plot.
    fn write(&self, size: &Size) -> Result<(), CliError> {
        let Some(folder) = self.folder else { return Ok(()) };
        write_tables(&self.rows, &folder.join("growth"), self.settings)?;
        let threads = self.settings.scaling[0];
        let lines: Vec<&Row> = self.rows[size.first[0]..].iter().filter(|row| row.threads == threads).collect();
        plot::growth(&folder.join(format!("growth-{}.svg", size.formula.name())), &lines)
    }
}

/// Holds all answers against what is known by now: those that come later may show that an earlier one is wrong.
fn judge(rows: &mut [Row], size: &Size) {
    for row in rows.iter_mut().filter(|row| row.ours) {
        let truth = size.truths.iter().find(|truth| truth.batch.kind == row.rays);
        let heard = size.heard.iter().find(|(accel, kind, _)| (*accel, *kind) == (row.accel, row.rays));
        if let (Some(truth), Some((_, _, answers))) = (truth, heard) {
            row.checked = truth.known();
            row.mismatches = truth.mismatches(answers, |truth, answer| truth == answer);
        }
    }
}

/// Those that are to be built over so many triangles, and a word on those that are not. No build takes less than in
/// proportion to the triangles.
fn divide(
    going: Vec<Choice>,
    last: &HashMap<&str, (usize, f64)>,
    triangles: usize,
    limit: f64,
) -> (Vec<Choice>, Vec<String>) {
    let mut stops = Vec::new();
    let goes_on = |(name, _): &Choice| {
        let Some((before, seconds)) = last.get(name) else { return true };
        let expected = seconds * triangles as f64 / *before as f64;
        if expected > limit {
            stops.push(format!(
                "{name} stops at {before} triangles, built in {seconds:.1} s: {triangles} would take {expected:.0} s or more"
            ));
        }
        expected <= limit
    };
    let kept = going.into_iter().filter(goes_on).collect();
    (kept, stops)
}

#[cfg(test)]
mod tests {
    use super::{super::contender::structures, *};

    #[test]
    fn a_structure_stops_once_its_build_would_exceed_the_limit() {
        let last = HashMap::from([("bvh8", (1000, 0.1)), ("bsp", (1000, 20.0)), ("grid", (1000, 12.0))]);
        let (kept, stops) = divide(structures().to_vec(), &last, 10_000, 120.0);
        let names: Vec<_> = kept.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, ["bvh8", "bvh2", "obb", "kdtree", "octree", "grid", "brute"]);
        assert_eq!(stops, ["bsp stops at 1000 triangles, built in 20.0 s: 10000 would take 200 s or more"]);
    }
}
