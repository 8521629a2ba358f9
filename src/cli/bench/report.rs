//! The tables.

use std::fmt::Write as _;

use serde_json::{Map, Value, json};

/// A median with the least and the greatest.
#[derive(Clone, Copy, Debug)]
pub struct Spread {
    /// Half of the values are below.
    pub median: f64,
    /// Least.
    pub min: f64,
    /// Greatest.
    pub max: f64,
}

impl Spread {
    /// Of at least one value.
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_unstable_by(f64::total_cmp);
        let (min, max) = (values[0], values[values.len() - 1]);
        Self { median: values[values.len() / 2], min, max }
    }
}

/// What ratios are taken to, in the order of [`Row::over`]; of the packets, those that are faster.
pub const PEERS: [&str; 3] = ["embree", "embree_robust", "embree_packet"];

/// One line of the table.
pub struct Row {
    pub scene: String,
    pub triangles: usize,
    pub threads: usize,
    pub accel: &'static str,
    pub ours: bool,
    pub rays: &'static str,
    pub count: usize,
    pub mrays_per_second: Spread,
    pub build_seconds: f64,
    pub bytes: usize,
    pub references: Option<usize>,
    pub nodes_per_ray: Option<f64>,
    pub triangles_per_ray: Option<f64>,
    /// Part of the lanes of tests of eight at once that had a box, triangle or ray to test.
    pub lane_fill: Option<f64>,
    /// Rays that brute force was asked about, whatever the structures say.
    pub by_brute_force: usize,
    /// Rays whose true answer is known: those, and those that all structures agree on.
    pub checked: usize,
    pub mismatches: usize,
    /// Rays per second over those of [`PEERS`], by run.
    pub over: [Option<Spread>; 3],
}

impl Row {
    /// All that is known of it, by name.
    pub fn json(&self) -> Map<String, Value> {
        let speed = self.mrays_per_second;
        let columns = [
            ("scene", json!(self.scene)),
            ("triangles", json!(self.triangles)),
            ("accel", json!(self.accel)),
            ("rays", json!(self.rays)),
            ("threads", json!(self.threads)),
            ("count", json!(self.count)),
            ("mrays_per_second", json!(speed.median)),
            ("mrays_per_second_min", json!(speed.min)),
            ("mrays_per_second_max", json!(speed.max)),
            ("build_seconds", json!(self.build_seconds)),
            ("bytes", json!(self.bytes)),
            ("references", json!(self.references)),
            ("nodes_per_ray", json!(self.nodes_per_ray)),
            ("triangles_per_ray", json!(self.triangles_per_ray)),
            ("lane_fill", json!(self.lane_fill)),
            ("by_brute_force", json!(self.by_brute_force)),
            ("checked", json!(self.checked)),
            ("mismatches", json!(self.mismatches)),
        ];
        let mut all: Map<_, _> = columns.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        for (peer, over) in PEERS.iter().zip(&self.over) {
            all.insert(format!("over_{peer}"), json!(over.map(|over| over.median)));
            all.insert(format!("over_{peer}_min"), json!(over.map(|over| over.min)));
            all.insert(format!("over_{peer}_max"), json!(over.map(|over| over.max)));
        }
        all
    }
}

/// What the figures were taken on.
pub fn machine() -> String {
    let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpu.lines().find(|line| line.starts_with("model name")).and_then(|line| line.split(": ").nth(1));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let features = if cfg!(target_feature = "avx2") { "x86-64-v3 or better" } else { "baseline" };
    format!("{} ({cores} threads there), built for {features}", model.unwrap_or("unknown CPU"))
}

/// For programs that draw and calculate.
pub fn csv(rows: impl Iterator<Item = Map<String, Value>>) -> String {
    let mut text = String::new();
    for (line, row) in rows.enumerate() {
        if line == 0 {
            text += &(row.keys().map(String::as_str).collect::<Vec<_>>().join(",") + "\n");
        }
        let values = row.values().map(|value| match value {
            Value::Null => String::new(),
            Value::String(text) if text.contains([',', '"', '\n']) => format!("\"{}\"", text.replace('"', "\"\"")),
            Value::String(text) => text.clone(),
            other => other.to_string(),
        });
        text += &(values.collect::<Vec<_>>().join(",") + "\n");
    }
    text
}

/// True if two rows belong to the same part of a table.
pub fn same_part(a: &Row, b: &Row) -> bool {
    (&a.scene, a.triangles, a.threads) == (&b.scene, b.triangles, b.threads)
}

/// For people.
pub fn table(rows: &[Row]) -> String {
    let mut text = String::new();
    for part in rows.chunk_by(same_part) {
        let _ = writeln!(text, "{}", heading(&part[0]));
        part.iter().for_each(|row| {
            let _ = writeln!(text, "{}", line(row));
        });
    }
    text
}

/// True if a row has ratios, or is that of something else to compare with.
fn compared(row: &Row) -> bool {
    row.over.iter().any(Option::is_some) || !row.ours
}

/// What stands above a part of the table.
pub fn heading(row: &Row) -> String {
    let threads = if row.threads == 1 { "one thread".to_owned() } else { format!("{} threads", row.threads) };
    let mut text = format!(
        "{}: {} triangles, {threads}; mismatches of rays whose hit is known, {} of each kind by brute force\n",
        row.scene, row.triangles, row.by_brute_force
    );
    let _ = write!(
        text,
        "{:8} {:15} {:>9} {:>8} {:>9} {:>9} {:>9} {:>9} {:>6} {:>10}",
        "rays", "accel", "Mrays/s", "build s", "bytes/tri", "refs/tri", "nodes/ray", "tris/ray", "lanes", "mismatches"
    );
    if compared(row) {
        let _ = write!(text, " {:>18} {:>18} {:>18}", "over Embree fast", "over robust", "over packets");
    }
    text
}

/// What stands below.
pub fn line(row: &Row) -> String {
    let per_triangle = |x: usize| x as f64 / row.triangles.max(1) as f64;
    let known = |x: Option<f64>, digits: usize| x.map_or("-".to_owned(), |x| format!("{x:.digits$}"));
    let mut text = format!(
        "{:8} {:15} {:9.3} {:8.3} {:9.1} {:>9} {:>9} {:>9} {:>6} {:>10}",
        row.rays,
        row.accel,
        row.mrays_per_second.median,
        row.build_seconds,
        per_triangle(row.bytes),
        known(row.references.map(per_triangle), 2),
        known(row.nodes_per_ray, 1),
        known(row.triangles_per_ray, 1),
        row.lane_fill.map_or("-".to_owned(), |fill| format!("{:.0} %", 100.0 * fill)),
        format!("{}/{}", row.mismatches, row.checked)
    );
    if compared(row) {
        for over in &row.over {
            let ratio = |over: &Spread| format!("{:.2} ({:.2}–{:.2})", over.median, over.min, over.max);
            let _ = write!(text, " {:>18}", over.as_ref().map_or("-".to_owned(), ratio));
        }
    }
    text
}

/// For documents: by scene and number of threads a table of the structures and one of the ratios.
pub fn markdown(rows: &[Row], compared_with: Option<&str>) -> String {
    let mut text = compared_with.map(|peers| format!("Compared with {peers}.\n\n")).unwrap_or_default();
    for part in rows.chunk_by(same_part) {
        let first = &part[0];
        let kinds: Vec<&str> = part.iter().filter(|row| row.accel == first.accel).map(|row| row.rays).collect();
        let _ = writeln!(text, "{}: {} triangles, threads: {}\n", first.scene, first.triangles, first.threads);
        let _ = writeln!(
            text,
            "| structure | {} | build s | bytes/tri | refs/tri | nodes/ray | tris/ray | lanes | mismatches |\n|---|{}",
            kinds.join(" | "),
            "---|".repeat(kinds.len() + 7)
        );
        for row in part.iter().filter(|row| row.rays == kinds[0]) {
            let all: Vec<&Row> = part.iter().filter(|other| other.accel == row.accel).collect();
            let of_kind = |kind: &&str| all.iter().find(|other| other.rays == *kind);
            let speed =
                |kind: &str| of_kind(&kind).map_or("–".into(), |row| format!("{:.2}", row.mrays_per_second.median));
            let speeds: Vec<String> = kinds.iter().map(|kind| speed(kind)).collect();
            let per_triangle = |x: usize| x as f64 / row.triangles.max(1) as f64;
            // Over all kinds, each as much as it has rays.
            let count: usize = all.iter().map(|row| row.count).sum();
            let mean = |of: fn(&Row) -> Option<f64>| -> String {
                let sum: Option<f64> = all.iter().map(|row| Some(of(row)? * row.count as f64)).sum();
                sum.map_or("–".into(), |sum| format!("{:.1}", sum / count as f64))
            };
            let percent = |all: &[&Row]| -> String {
                let sum: Option<f64> = all.iter().map(|row| Some(row.lane_fill? * row.count as f64)).sum();
                sum.map_or("–".into(), |sum| format!("{:.0} %", 100.0 * sum / count as f64))
            };
            let _ = writeln!(
                text,
                "| {} | {} | {:.2} | {:.0} | {} | {} | {} | {} | {} |",
                row.accel,
                speeds.join(" | "),
                row.build_seconds,
                per_triangle(row.bytes),
                row.references.map_or("–".into(), |references| format!("{:.2}", per_triangle(references))),
                mean(|row| row.nodes_per_ray),
                mean(|row| row.triangles_per_ray),
                percent(&all),
                all.iter().map(|row| row.mismatches).sum::<usize>()
            );
        }
        let ratios: Vec<&Row> = part.iter().filter(|row| row.accel == first.accel && row.over[0].is_some()).collect();
        if !ratios.is_empty() {
            let _ = writeln!(
                text,
                "\n| {} | over Embree fast | over robust | over packets |\n|---|---|---|---|",
                first.accel
            );
            for row in ratios {
                let ratio = |over: &Option<Spread>| {
                    over.map_or("–".into(), |over| format!("{:.2} ({:.2}–{:.2})", over.median, over.min, over.max))
                };
                let _ = writeln!(text, "| {} | {} |", row.rays, row.over.each_ref().map(ratio).join(" | "));
            }
        }
        text.push('\n');
    }
    text
}
