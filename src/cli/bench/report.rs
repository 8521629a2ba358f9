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

/// For programs that draw and calculate.
pub fn csv(rows: &[Row]) -> String {
    let mut text = String::new();
    for (line, row) in rows.iter().enumerate() {
        let row = row.json();
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

/// For people.
pub fn table(rows: &[Row]) -> String {
    let mut text = String::new();
    let mut part = None;
    for row in rows {
        let compared = row.over.iter().any(Option::is_some) || !row.ours;
        if part != Some((&row.scene, row.triangles, row.threads)) {
            part = Some((&row.scene, row.triangles, row.threads));
            let threads = if row.threads == 1 { "one thread".to_owned() } else { format!("{} threads", row.threads) };
            let _ = writeln!(text, "{}: {} triangles, {threads}", row.scene, row.triangles);
            let _ = write!(
                text,
                "{:8} {:15} {:>9} {:>8} {:>9} {:>9} {:>9} {:>9} {:>10}",
                "rays", "accel", "Mrays/s", "build s", "bytes/tri", "refs/tri", "nodes/ray", "tris/ray", "mismatches"
            );
            if compared {
                let _ = write!(text, " {:>18} {:>18} {:>18}", "over Embree fast", "over robust", "over packets");
            }
            text.push('\n');
        }
        let per_triangle = |x: usize| x as f64 / row.triangles.max(1) as f64;
        let known = |x: Option<f64>, digits: usize| x.map_or("-".to_owned(), |x| format!("{x:.digits$}"));
        let _ = write!(
            text,
            "{:8} {:15} {:9.3} {:8.3} {:9.1} {:>9} {:>9} {:>9} {:>10}",
            row.rays,
            row.accel,
            row.mrays_per_second.median,
            row.build_seconds,
            per_triangle(row.bytes),
            known(row.references.map(per_triangle), 2),
            known(row.nodes_per_ray, 1),
            known(row.triangles_per_ray, 1),
            format!("{}/{}", row.mismatches, row.checked)
        );
        if compared {
            for over in &row.over {
                let ratio = |over: &Spread| format!("{:.2} ({:.2}–{:.2})", over.median, over.min, over.max);
                let _ = write!(text, " {:>18}", over.as_ref().map_or("-".to_owned(), ratio));
            }
        }
        text.push('\n');
    }
    text
}
