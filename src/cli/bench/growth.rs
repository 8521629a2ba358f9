//! How speed, build time and memory grow with the number of triangles.

use std::collections::HashMap;

use super::{
    Args,
    accel::{Settings, measure, report},
    contender::Choice,
    plot,
    report::Row,
    subject::{Source, Subject},
};
use crate::cli::{Outcome, console::Console, error::CliError};

/// Measures every generated scene in all sizes; a structure whose builds get too slow stops.
pub fn run(args: &Args, settings: &Settings, console: &mut Console) -> Result<Outcome, CliError> {
    let (mut rows, mut stopped) = (Vec::new(), Vec::new());
    for source in &args.scenes {
        let Source::Generated(formula, _) = source else {
            return Err(CliError::Usage(format!("{source} cannot grow (--growth); hall and foliage can")));
        };
        let first = rows.len();
        let mut going = settings.chosen.clone();
        let mut last = HashMap::new();
        for &triangles in &args.growth {
            let subject = Subject::new(&Source::Generated(*formula, triangles), args.view, console)?;
            let (goes_on, stops) = divide(going, &last, subject.triangles.len(), args.build_limit);
            stopped.extend(stops.iter().map(|stop| format!("{}: {stop}", formula.name())));
            going = goes_on;
            let found = measure(&subject, &going, settings, console)?;
            last.extend(found.iter().map(|row| (row.accel, (row.triangles, row.build_seconds))));
            rows.extend(found);
        }
        if let Some(folder) = &args.output {
            let threads = settings.scaling[0];
            let lines: Vec<&Row> = rows[first..].iter().filter(|row| row.threads == threads).collect();
            plot::growth(&folder.join(format!("growth-{}.svg", formula.name())), &lines)?;
        }
    }
    report(&rows, "growth", &stopped, args.output.as_deref(), settings, console)
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
