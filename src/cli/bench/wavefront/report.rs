//! The tables.

use std::fmt::Write as _;

use serde_json::{Map, Value, json};
use wavecast::{
    render::{RenderStats, StageStats},
    wavefront::BYTES_PER_PATH,
};

use super::super::{Part, report::Spread};
use crate::cli::args::value_name;

/// One variant over one scene.
pub struct Row {
    pub scene: String,
    pub part: Part,
    pub mode: &'static str,
    pub wave_size: usize,
    pub sorted: bool,
    pub threads: usize,
    pub mpaths_per_second: Spread,
    /// The reference does not count rays.
    pub mrays_per_second: Option<Spread>,
    /// Paths per second of the first of the part over those of this one, by run.
    pub first_over: Spread,
}

impl Row {
    /// All that is known of it, by name.
    pub fn json(&self) -> Map<String, Value> {
        let mut all = Map::new();
        for (name, value) in [
            ("scene", json!(self.scene)),
            ("part", json!(value_name(self.part))),
            ("mode", json!(self.mode)),
            ("wave_size", json!(self.wave_size)),
            ("queue_bytes", json!(self.wave_size * BYTES_PER_PATH)),
            ("sorted", json!(self.sorted)),
            ("threads", json!(self.threads)),
        ] {
            all.insert(name.into(), value);
        }
        let spreads = [
            ("mpaths_per_second", Some(self.mpaths_per_second)),
            ("mrays_per_second", self.mrays_per_second),
            ("first_over", Some(self.first_over)),
        ];
        for (name, spread) in spreads {
            all.insert(name.into(), json!(spread.map(|spread| spread.median)));
            all.insert(format!("{name}_min"), json!(spread.map(|spread| spread.min)));
            all.insert(format!("{name}_max"), json!(spread.map(|spread| spread.max)));
        }
        all
    }

    /// What sets it apart from the others of its part.
    fn what(&self) -> String {
        match self.part {
            Part::Modes => self.mode.to_owned(),
            Part::Sort => if self.sorted { "sorted" } else { "unsorted" }.to_owned(),
            Part::Threads => format!("threads: {}", self.threads),
            Part::WaveSize => format!("{} in a wave", self.wave_size),
        }
    }
}

/// One stage over one scene, all threads together.
pub struct StageRow {
    pub scene: String,
    pub stage: &'static str,
    /// Median over the runs.
    pub seconds: f64,
    /// Of the seconds of all stages.
    pub share: f64,
    pub rows: u64,
    /// None for stages that take rows one at a time, or a ray by eight boxes.
    pub lane_fill: Option<f64>,
    /// As above where waves are not sorted, if that was measured.
    pub lane_fill_unsorted: Option<f64>,
    pub blocks: u64,
}

impl StageRow {
    /// From what several renders did.
    pub fn of(scene: &str, stats: &[RenderStats], unsorted: Option<&RenderStats>) -> Vec<Self> {
        let Some(first) = stats.first() else { return Vec::new() };
        let fill = |stage: &StageStats| (stage.blocks > 0).then_some(stage.lane_fill);
        let fill_unsorted =
            |name| unsorted.and_then(|stats| stats.stages.iter().find(|other| other.name == name)).and_then(fill);
        let of_stage = |stage: &StageStats| {
            let all = stats.iter().flat_map(|stats| stats.stages.iter().find(|other| other.name == stage.name));
            Self {
                scene: scene.to_owned(),
                stage: stage.name,
                seconds: Spread::of(all.map(|stage| stage.seconds).collect()).median,
                share: 0.0,
                rows: stage.rows,
                lane_fill: fill(stage),
                lane_fill_unsorted: fill_unsorted(stage.name),
                blocks: stage.blocks,
            }
        };
        let mut stages: Vec<Self> = first.stages.iter().map(of_stage).collect();
        let total: f64 = stages.iter().map(|stage| stage.seconds).sum();
        stages.iter_mut().for_each(|stage| stage.share = stage.seconds / total.max(f64::MIN_POSITIVE));
        stages
    }

    fn mrows_per_second(&self) -> f64 {
        self.rows as f64 / self.seconds.max(f64::MIN_POSITIVE) / 1e6
    }

    /// All that is known of it, by name.
    pub fn json(&self) -> Map<String, Value> {
        let columns = [
            ("scene", json!(self.scene)),
            ("stage", json!(self.stage)),
            ("seconds", json!(self.seconds)),
            ("share", json!(self.share)),
            ("rows", json!(self.rows)),
            ("mrows_per_second", json!(self.mrows_per_second())),
            ("blocks", json!(self.blocks)),
            ("lane_fill", json!(self.lane_fill)),
            ("lane_fill_unsorted", json!(self.lane_fill_unsorted)),
        ];
        columns.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
    }

    /// Lane fill of sorted and unsorted waves.
    fn fill(&self) -> [String; 2] {
        [self.lane_fill, self.lane_fill_unsorted]
            .map(|fill| fill.map_or("–".to_owned(), |fill| format!("{:.1} %", 100.0 * fill)))
    }
}

fn spread(spread: &Spread, digits: usize) -> String {
    format!("{:.digits$} ({:.digits$}–{:.digits$})", spread.median, spread.min, spread.max)
}

fn rays(row: &Row) -> String {
    row.mrays_per_second.as_ref().map_or("–".to_owned(), |rays| spread(rays, 2))
}

/// For people.
pub fn text(rows: &[Row], stages: &[StageRow]) -> String {
    let mut text = String::new();
    for rows in rows.chunk_by(|a, b| a.scene == b.scene) {
        let scene = &rows[0].scene;
        let _ = writeln!(text, "{scene}");
        let _ = writeln!(text, "{:10} {:17} {:>20} {:>22} {:>22}", "part", "", "Mpaths/s", "Mrays/s", "first over it");
        for row in rows {
            let speed = spread(&row.mpaths_per_second, 3);
            let (part, ratio) = (value_name(row.part), spread(&row.first_over, 2));
            let _ = writeln!(text, "{part:10} {:17} {speed:>20} {:>22} {ratio:>22}", row.what(), rays(row));
        }
        let _ = writeln!(
            text,
            "{:10} {:>9} {:>8} {:>12} {:>9} {:>10} {:>10}",
            "stage", "seconds", "share", "rows", "Mrows/s", "lane fill", "unsorted"
        );
        for stage in stages.iter().filter(|stage| stage.scene == *scene) {
            let (share, speed) = (100.0 * stage.share, stage.mrows_per_second());
            let StageRow { stage: name, seconds, rows, .. } = stage;
            let [fill, unsorted] = stage.fill();
            let _ =
                writeln!(text, "{name:10} {seconds:9.4} {share:6.1} % {rows:12} {speed:9.2} {fill:>10} {unsorted:>10}");
        }
        text.push('\n');
    }
    text
}

/// For documents.
pub fn markdown(head: &str, rows: &[Row], stages: &[StageRow]) -> String {
    let mut text = format!(
        "{head} Medians with the least and the greatest; ratios are of the same run. Where a stage has no lane fill, it takes rows one at a time, or a ray by eight boxes or triangles.\n"
    );
    for rows in rows.chunk_by(|a, b| a.scene == b.scene) {
        let _ = writeln!(text, "\n## {}", rows[0].scene);
        for rows in rows.chunk_by(|a, b| a.part == b.part) {
            let (part, first) = (value_name(rows[0].part), rows[0].what());
            let _ = writeln!(text, "\n| {part} | Mpaths/s | Mrays/s | {first} over it |\n|---|---|---|---|");
            for row in rows {
                let (speed, ratio) = (spread(&row.mpaths_per_second, 3), spread(&row.first_over, 2));
                let _ = writeln!(text, "| {} | {speed} | {} | {ratio} |", row.what(), rays(row));
            }
        }
        let _ = writeln!(
            text,
            "\n| stage | seconds | share | rows | Mrows/s | lane fill | unsorted |\n|---|---|---|---|---|---|---|"
        );
        for stage in stages.iter().filter(|stage| stage.scene == rows[0].scene) {
            let (share, speed) = (100.0 * stage.share, stage.mrows_per_second());
            let StageRow { stage: name, seconds, rows, .. } = stage;
            let [fill, unsorted] = stage.fill();
            let _ =
                writeln!(text, "| {name} | {seconds:.4} | {share:.1} % | {rows} | {speed:.2} | {fill} | {unsorted} |");
        }
    }
    text
}
