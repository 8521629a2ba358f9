//! What became better or worse since a table of another build was written.
//!
//! Renders with equal numbers of samples are held against each other, those with the most that both tables have: at least
//! a tenth of the greatest such number, as the others are over so soon that their times say little. The logarithms of
//! 1/(relMSE·s) are a sample of each build, one number per seed, and Welch's interval holds the difference of their means.
//! Intervals are so wide that with the probability asked for (1 − significance) all of them hold at once.

use std::{
    collections::HashSet,
    fmt::Write as _,
    path::{Path, PathBuf},
};

use serde_json::{Map, Value, json};
use wavecast::measure::{statistics::sidak, student::Estimate};

use super::{STATISTICS, measured::Measured};
use crate::cli::{Outcome, console::Console, error::CliError};

/// Least number of samples that is compared, as a share of the greatest that both tables have.
const LEAST: f64 = 0.1;

/// Between 0 and 1.
pub fn probability(text: &str) -> Result<f64, String> {
    let inside = |p: &f64| *p > 0.0 && *p < 1.0;
    text.parse().ok().filter(inside).ok_or_else(|| "expected a number between 0 and 1, such as 0.01".into())
}

/// Such as `5%`, as a share; from 0 to below 100.
pub fn percent(text: &str) -> Result<f64, String> {
    let number = text.strip_suffix('%').and_then(|number| number.trim().parse::<f64>().ok());
    let inside = |p: &f64| (0.0..100.0).contains(p);
    number.filter(inside).map(|p| p / 100.0).ok_or_else(|| "expected a percentage, such as 5%".into())
}

/// What can be said of a change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    Better,
    Worse,
    /// Less than the noise or what is tolerated.
    Same,
    /// Errors that are zero, or drowned in the noise of the reference, have no logarithm.
    Unknown,
}

impl Verdict {
    fn name(self) -> &'static str {
        match self {
            Self::Better => "better",
            Self::Worse => "worse",
            Self::Same => "same",
            Self::Unknown => "unknown",
        }
    }

    /// Of the logarithm of a ratio that is better the greater it is.
    fn of(log: &Estimate, confidence: f64, tolerance: f64) -> Self {
        let ([from, to], least) = (log.interval(confidence), -(1.0 - tolerance).ln());
        match () {
            () if to < -least => Self::Worse,
            () if from > least => Self::Better,
            () if log.value.is_finite() => Self::Same,
            () => Self::Unknown,
        }
    }
}

/// New over old of one scene, by one of [`STATISTICS`].
#[derive(Clone, Debug)]
pub struct Change {
    pub scene: String,
    pub statistic: usize,
    /// Numbers of samples that were compared.
    pub spp: Vec<u32>,
    /// Logarithm of the ratio of 1/(relMSE·s).
    pub efficiency: Estimate,
    /// Of relMSE at equal samples.
    pub error: Estimate,
    /// Of seconds at equal samples.
    pub seconds: Estimate,
    /// Of the intervals.
    pub confidence: f64,
    /// By efficiency; then by error and by time alone.
    pub verdicts: [Verdict; 3],
}

impl Change {
    /// None if there is no number of samples that both have with two renders at least.
    fn new(old: &[&Measured], new: &[&Measured], statistic: usize, confidence: f64, tolerance: f64) -> Option<Self> {
        let with = |all: &[&Measured], spp: u32| -> Vec<Measured> {
            all.iter().filter(|it| it.spp == spp).map(|it| (*it).clone()).collect()
        };
        let mut common: Vec<u32> = new.iter().map(|it| it.spp).collect();
        common.sort_unstable();
        common.dedup();
        common.retain(|&spp| with(old, spp).len() >= 2 && with(new, spp).len() >= 2);
        let most = *common.last()?;
        common.retain(|&spp| f64::from(spp) >= LEAST * f64::from(most));
        let difference = |of: &dyn Fn(&Measured) -> f64| {
            let weight = 1.0 / common.len() as f64;
            Estimate::sum(common.iter().map(|&spp| {
                let [old, new] = [old, new].map(|all| Estimate::of(with(all, spp).iter().map(of)));
                (weight, new.minus(old))
            }))
        };
        let (error, seconds) = (difference(&|it| it.relmse[statistic].ln()), difference(&|it| it.seconds.ln()));
        let efficiency = difference(&|it| -(it.relmse[statistic] * it.seconds).ln());
        let minus = |estimate: &Estimate| Estimate { value: -estimate.value, ..*estimate };
        let verdict = |log: &Estimate| Verdict::of(log, confidence, tolerance);
        let mut verdicts = [verdict(&efficiency), verdict(&minus(&error)), verdict(&minus(&seconds))];
        // A picture that is no longer made of numbers is not a matter of statistics.
        let broken = |all: &[&Measured]| all.iter().any(|it| !it.relmse[statistic].is_finite());
        if broken(new) && !broken(old) {
            verdicts[..2].fill(Verdict::Worse);
        }
        let scene = new[0].scene.clone();
        Some(Self { scene, statistic, spp: common, efficiency, error, seconds, confidence, verdicts })
    }

    fn ratios(&self) -> [(&'static str, [f64; 3]); 3] {
        [("efficiency", &self.efficiency), ("error", &self.error), ("seconds", &self.seconds)].map(|(name, log)| {
            let [from, to] = log.interval(self.confidence);
            (name, [log.value, from, to].map(f64::exp))
        })
    }

    /// All that is known of it, by name.
    pub fn json(&self) -> Map<String, Value> {
        let mut all = Map::new();
        let mut add = |name: &str, value: Value| all.insert(name.to_owned(), value);
        add("scene", json!(self.scene));
        add("statistic", json!(STATISTICS[self.statistic]));
        add("spp_from", json!(self.spp.first()));
        add("spp_to", json!(self.spp.last()));
        for ((name, [ratio, from, to]), verdict) in self.ratios().into_iter().zip(self.verdicts) {
            add(&format!("{name}_ratio"), json!(ratio));
            add(&format!("{name}_ratio_from"), json!(from));
            add(&format!("{name}_ratio_to"), json!(to));
            add(&format!("{name}_verdict"), json!(verdict.name()));
        }
        add("confidence", json!(self.confidence));
        all
    }

    /// The cells of a table: scene, statistic, samples, ratios with verdicts.
    fn cells(&self) -> [String; 6] {
        let cell = |((_, [ratio, from, to]), verdict): ((&str, [f64; 3]), Verdict)| {
            format!("{} {ratio:.3} ({from:.3} to {to:.3})", verdict.name())
        };
        let mut ratios = self.ratios().into_iter().zip(self.verdicts).map(cell);
        let samples: Vec<_> = self.spp.iter().map(u32::to_string).collect();
        let [a, b, c] = std::array::from_fn(|_| ratios.next().unwrap_or_default());
        [self.scene.clone(), STATISTICS[self.statistic].to_owned(), samples.join(", "), a, b, c]
    }
}

/// Names of [`Change::cells`].
const HEADINGS: [&str; 6] =
    ["scene", "of", "samples", "efficiency", "error at equal samples", "seconds at equal samples"];

/// All scenes that both tables have.
#[derive(Debug)]
pub struct Comparison {
    old: PathBuf,
    significance: f64,
    tolerance: f64,
    pub changes: Vec<Change>,
}

impl Comparison {
    /// Of the renders of the table `path` with others; what cannot be compared is told.
    pub fn new(
        path: &Path,
        old: &[Measured],
        new: &[Measured],
        significance: f64,
        tolerance: f64,
        console: &mut Console,
    ) -> Result<Self, CliError> {
        let mut scenes: Vec<(&str, &str)> = new.iter().map(|it| (&*it.scene, &*it.key)).collect();
        let mut seen = HashSet::new();
        scenes.retain(|(_, key)| seen.insert(*key));
        // Of each scene its renders by both builds.
        let mut pairs: Vec<[Vec<&Measured>; 2]> = Vec::new();
        for (scene, key) in scenes {
            let [before, now] = [old, new].map(|all| all.iter().filter(|it| it.key == key).collect::<Vec<_>>());
            if before.is_empty() {
                let why = match old.iter().any(|it| it.scene == scene) {
                    true => "has it with other settings, or the scene is another",
                    false => "does not have it",
                };
                console.warn(format_args!("{scene}: cannot be compared: {} {why}", path.display()));
                continue;
            }
            let threads = [&before, &now].map(|all| all[0].threads);
            if threads[0] != threads[1] {
                let [a, b] = threads;
                console.warn(format_args!("{scene}: threads were {a} and are {b}, which changes the times"));
            }
            pairs.push([before, now]);
        }
        let mut gone: Vec<&str> =
            old.iter().filter(|a| new.iter().all(|b| b.key != a.key)).map(|it| &*it.scene).collect();
        gone.retain(|scene| new.iter().all(|it| it.scene != *scene));
        gone.sort_unstable();
        gone.dedup();
        gone.iter().for_each(|scene| console.warn(format_args!("{scene}: was measured then, and is not now")));
        let confidence = 1.0 - sidak(significance, (pairs.len() * STATISTICS.len()).max(1));
        let mut changes = Vec::new();
        for [before, now] in &pairs {
            for statistic in 0..STATISTICS.len() {
                changes.extend(Change::new(before, now, statistic, confidence, tolerance));
            }
            if changes.last().is_none_or(|change: &Change| change.scene != now[0].scene) {
                console.warn(format_args!("{}: no number of samples was rendered twice by both builds", now[0].scene));
            }
        }
        if changes.is_empty() {
            let reason = "it has none of these scenes with these settings and numbers of samples".to_owned();
            return Err(CliError::Incomparable { with: path.to_owned(), reason });
        }
        for change in changes.iter().filter(|change| change.verdicts[0] == Verdict::Unknown) {
            let name = STATISTICS[change.statistic];
            console.warn(format_args!(
                "{}: nothing can be said of {name}: it is not above zero in every render; a better reference may help",
                change.scene
            ));
        }
        Ok(Self { old: path.to_owned(), significance, tolerance, changes })
    }

    fn head(&self) -> String {
        let mut text = format!(
            "new over {}: if nothing has changed, all is called the same with a probability of {} % (each interval: {:.3} \
             %)",
            self.old.display(),
            100.0 * (1.0 - self.significance),
            100.0 * self.changes.first().map_or(0.0, |change| change.confidence)
        );
        if self.tolerance > 0.0 {
            let _ = write!(text, "; changes up to {} % are called none", 100.0 * self.tolerance);
        }
        text
    }

    /// For people.
    pub fn text(&self) -> String {
        let rows: Vec<[String; 6]> =
            std::iter::once(HEADINGS.map(str::to_owned)).chain(self.changes.iter().map(Change::cells)).collect();
        let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
        let widths: [usize; 6] = std::array::from_fn(width);
        let mut text = self.head() + "\n";
        for row in &rows {
            let padded = row.iter().zip(widths).map(|(cell, width)| format!("{cell:width$}"));
            text += padded.collect::<Vec<_>>().join("  ").trim_end();
            text.push('\n');
        }
        text
    }

    /// For documents.
    pub fn markdown(&self) -> String {
        let line = |cells: [String; 6]| format!("| {} |\n", cells.join(" | "));
        let mut text = format!("\n## Comparison\n\n{}\n\n{}", self.head(), line(HEADINGS.map(str::to_owned)));
        text += "|---|---|---|---|---|---|\n";
        text.extend(self.changes.iter().map(|change| line(change.cells())));
        text
    }

    /// An error if a scene lost efficiency, by either statistic.
    pub fn verdict(&self) -> Result<Outcome, CliError> {
        let mut scenes: Vec<String> = Vec::new();
        for change in self.changes.iter().filter(|change| change.verdicts[0] == Verdict::Worse) {
            if !scenes.contains(&change.scene) {
                scenes.push(change.scene.clone());
            }
        }
        if scenes.is_empty() { Ok(Outcome::Done) } else { Err(CliError::Lost { than: self.old.clone(), scenes }) }
    }
}

#[cfg(test)]
mod tests;
