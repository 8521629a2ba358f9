//! The tables.

use std::fmt::Write as _;

use serde_json::{Map, Value, json};
use wavecast::{measure::student::Estimate, render::SamplerKind};

use super::{super::report::Spread, STATISTICS};

/// Confidence of all intervals but those of comparisons.
const CONFIDENCE: f64 = 0.95;
/// The error that the tables tell the time to.
const TARGET: f64 = 0.01;
/// Kinds of rays.
const RAYS: [&str; 3] = ["camera", "bounce", "shadow"];

/// One picture.
#[derive(Clone, Debug)]
pub struct Render {
    pub scene: String,
    /// Of the reference.
    pub key: String,
    pub size: [u32; 2],
    pub threads: usize,
    pub sampler: SamplerKind,
    pub max_depth: Option<u32>,
    pub spp: u32,
    pub seed: u64,
    /// Of the render alone, without loading and trees.
    pub seconds: f64,
    pub mpaths_per_second: f64,
    /// By kind: camera, bounce, shadow.
    pub mrays_per_second: [f64; 3],
    /// Plain and trimmed; the noise of the reference is taken off.
    pub relmse: [f64; 2],
    pub reference_spp: u64,
    /// Of the reference itself.
    pub reference_relmse: [f64; 2],
}

impl Render {
    /// 1/(relMSE·s), plain and trimmed.
    pub fn efficiency(&self) -> [f64; 2] {
        self.relmse.map(|relmse| 1.0 / (relmse * self.seconds))
    }

    /// All that is known of it, by name.
    pub fn json(&self) -> Map<String, Value> {
        let mut all = Map::new();
        let mut add = |name: &str, value: Value| all.insert(name.to_owned(), value);
        add("scene", json!(self.scene));
        add("key", json!(self.key));
        add("width", json!(self.size[0]));
        add("height", json!(self.size[1]));
        add("threads", json!(self.threads));
        add("sampler", json!(format!("{:?}", self.sampler).to_lowercase()));
        add("max_depth", json!(self.max_depth));
        add("spp", json!(self.spp));
        add("seed", json!(self.seed));
        add("seconds", json!(self.seconds));
        add("mpaths_per_second", json!(self.mpaths_per_second));
        for (kind, speed) in RAYS.iter().zip(self.mrays_per_second) {
            add(&format!("{kind}_mrays_per_second"), json!(speed));
        }
        for (name, (relmse, efficiency)) in STATISTICS.iter().zip(self.relmse.into_iter().zip(self.efficiency())) {
            add(name, json!(relmse));
            add(&name.replace("relmse", "efficiency"), json!(efficiency));
        }
        add("reference_spp", json!(self.reference_spp));
        for (name, relmse) in STATISTICS.iter().zip(self.reference_relmse) {
            add(&format!("reference_{name}"), json!(relmse));
        }
        all
    }
}

/// All renders with one number of samples.
pub struct Budget {
    pub spp: u32,
    pub seconds: Spread,
    pub mpaths_per_second: Spread,
    /// Medians.
    pub mrays_per_second: [f64; 3],
    /// Means over seeds, plain and trimmed.
    pub relmse: [f64; 2],
    /// Mean over seeds of the logarithm of 1/(relMSE·s).
    pub log_efficiency: [Estimate; 2],
}

impl Budget {
    fn new(renders: &[Render]) -> Self {
        let spread = |of: &dyn Fn(&Render) -> f64| Spread::of(renders.iter().map(of).collect());
        let mean = |statistic: usize| renders.iter().map(|it| it.relmse[statistic]).sum::<f64>() / renders.len() as f64;
        Self {
            spp: renders[0].spp,
            seconds: spread(&|render| render.seconds),
            mpaths_per_second: spread(&|render| render.mpaths_per_second),
            mrays_per_second: [0, 1, 2].map(|kind| spread(&|render| render.mrays_per_second[kind]).median),
            relmse: [0, 1].map(mean),
            log_efficiency: [0, 1].map(|it| Estimate::of(renders.iter().map(|render| render.efficiency()[it].ln()))),
        }
    }

    /// 1/(relMSE·s) and the interval that holds it: the middle, from, to.
    fn efficiency(&self, statistic: usize) -> [f64; 3] {
        let estimate = &self.log_efficiency[statistic];
        let [from, to] = estimate.interval(CONFIDENCE);
        [estimate.value, from, to].map(f64::exp)
    }
}

/// One scene.
pub struct Summary {
    pub scene: String,
    pub key: String,
    pub reference_spp: u64,
    pub reference_relmse: [f64; 2],
    /// From few samples to many.
    pub budgets: Vec<Budget>,
    /// Of the logarithm of relMSE over that of samples; none of a single budget.
    pub slope: [Option<Estimate>; 2],
    /// Seconds to a relMSE of [`TARGET`]; none beyond what was measured.
    pub seconds_to_target: [Option<f64>; 2],
}

impl Summary {
    /// Of renders in the order of scenes and numbers of samples.
    pub fn all(renders: &[Render]) -> Vec<Self> {
        renders.chunk_by(|a, b| a.scene == b.scene).map(Self::new).collect()
    }

    fn new(renders: &[Render]) -> Self {
        let first = &renders[0];
        let by_budget: Vec<&[Render]> = renders.chunk_by(|a, b| a.spp == b.spp).collect();
        let budgets: Vec<Budget> = by_budget.iter().map(|renders| Budget::new(renders)).collect();
        let seeds = by_budget.iter().map(|renders| renders.len()).min().unwrap_or(0);
        // One slope for each round, so that their spread tells how far it may be off.
        let slope = |statistic: usize| {
            let slopes = (0..seeds).map(|round| {
                let point = |renders: &&[Render]| (f64::from(renders[round].spp), renders[round].relmse[statistic]);
                slope(by_budget.iter().map(point).map(|(x, y)| (x.ln(), y.ln())))
            });
            (by_budget.len() > 1).then(|| Estimate::of(slopes))
        };
        let to_target = |statistic: usize| {
            let points: Vec<_> = budgets.iter().map(|it| (it.seconds.median, it.relmse[statistic])).collect();
            seconds_to(&points, TARGET)
        };
        Self {
            scene: first.scene.clone(),
            key: first.key.clone(),
            reference_spp: first.reference_spp,
            reference_relmse: first.reference_relmse,
            slope: [0, 1].map(slope),
            seconds_to_target: [0, 1].map(to_target),
            budgets,
        }
    }

    /// A row for each number of samples.
    pub fn budgets_json(&self) -> Vec<Map<String, Value>> {
        let row = |budget: &Budget| {
            let mut all = Map::new();
            let mut add = |name: &str, value: Value| all.insert(name.to_owned(), value);
            add("scene", json!(self.scene));
            add("spp", json!(budget.spp));
            for (name, spread) in [("seconds", &budget.seconds), ("mpaths_per_second", &budget.mpaths_per_second)] {
                add(name, json!(spread.median));
                add(&format!("{name}_min"), json!(spread.min));
                add(&format!("{name}_max"), json!(spread.max));
            }
            for (kind, speed) in RAYS.iter().zip(budget.mrays_per_second) {
                add(&format!("{kind}_mrays_per_second"), json!(speed));
            }
            for (statistic, name) in STATISTICS.iter().enumerate() {
                add(name, json!(budget.relmse[statistic]));
                let name = name.replace("relmse", "efficiency");
                let [middle, from, to] = budget.efficiency(statistic);
                add(&name, json!(middle));
                add(&format!("{name}_from"), json!(from));
                add(&format!("{name}_to"), json!(to));
            }
            all
        };
        self.budgets.iter().map(row).collect()
    }

    /// What the longest renders say, and what all say together.
    pub fn json(&self) -> Map<String, Value> {
        let mut all = self.budgets_json().pop().unwrap_or_default();
        let mut add = |name: String, value: Value| all.insert(name, value);
        add("key".into(), json!(self.key));
        for (statistic, name) in STATISTICS.iter().enumerate() {
            let slope = self.slope[statistic];
            let interval = slope.map(|slope| slope.interval(CONFIDENCE));
            add(format!("slope_{name}"), json!(slope.map(|slope| slope.value)));
            add(format!("slope_{name}_from"), json!(interval.map(|[from, _]| from)));
            add(format!("slope_{name}_to"), json!(interval.map(|[_, to]| to)));
            add(format!("seconds_to_{name}_{TARGET}"), json!(self.seconds_to_target[statistic]));
            add(format!("reference_{name}"), json!(self.reference_relmse[statistic]));
        }
        add("reference_spp".into(), json!(self.reference_spp));
        all
    }

    fn slope_text(&self, statistic: usize) -> String {
        self.slope[statistic].map_or("–".to_owned(), |slope| {
            let [from, to] = slope.interval(CONFIDENCE);
            format!("{:.2} ({from:.2} to {to:.2})", slope.value)
        })
    }

    fn seconds_text(&self, statistic: usize) -> String {
        self.seconds_to_target[statistic].map_or("–".to_owned(), |seconds| format!("{seconds:.3}"))
    }

    fn reference_text(&self) -> String {
        let [plain, trimmed] = self.reference_relmse;
        format!("reference: {} samples per pixel, own relMSE {plain:.1e}, trimmed {trimmed:.1e}", self.reference_spp)
    }
}

/// Of the straight line through points that leaves the least squares.
fn slope(points: impl Iterator<Item = (f64, f64)>) -> f64 {
    let points: Vec<_> = points.collect();
    let n = points.len() as f64;
    let (mx, my) = points.iter().fold((0.0, 0.0), |(mx, my), (x, y)| (mx + x / n, my + y / n));
    let (xy, xx) = points.iter().fold((0.0, 0.0), |(xy, xx), (x, y)| (xy + (x - mx) * (y - my), xx + (x - mx).powi(2)));
    xy / xx
}

/// Where the error falls to `target`: on straight lines between points (seconds, relMSE) on logarithmic scales.
fn seconds_to(points: &[(f64, f64)], target: f64) -> Option<f64> {
    let pair = points.windows(2).find(|pair| pair[0].1 >= target && pair[1].1 <= target && pair[1].1 > 0.0)?;
    let [(t0, e0), (t1, e1)] = [pair[0], pair[1]].map(|(t, e)| (t.ln(), e.ln()));
    let share = if e0 == e1 { 0.0 } else { (target.ln() - e0) / (e1 - e0) };
    Some((t0 + share * (t1 - t0)).exp())
}

/// For people.
pub fn text(summaries: &[Summary]) -> String {
    let mut text = String::new();
    for summary in summaries {
        let _ = writeln!(text, "{}; {}", summary.scene, summary.reference_text());
        let _ = writeln!(
            text,
            "{:>8} {:>9} {:>9} {:>23} {:>10} {:>10}   {:28} {:28}",
            "samples",
            "seconds",
            "Mpaths/s",
            "Mrays/s by kind",
            "relMSE",
            "trimmed",
            "1/(relMSE·s), 95 %",
            "1/(trimmed·s), 95 %"
        );
        for budget in &summary.budgets {
            let [camera, bounce, shadow] = budget.mrays_per_second.map(|speed| format!("{speed:.2}"));
            let [plain, trimmed] = [0, 1].map(|statistic| efficiency(&budget.efficiency(statistic)));
            let _ = writeln!(
                text,
                "{:8} {:9.4} {:9.3} {camera:>7} {bounce:>7} {shadow:>7} {:10.3e} {:10.3e}   {plain:28} {trimmed:28}",
                budget.spp, budget.seconds.median, budget.mpaths_per_second.median, budget.relmse[0], budget.relmse[1],
            );
        }
        for (statistic, name) in ["relMSE", "trimmed relMSE"].iter().enumerate() {
            let (slope, seconds) = (summary.slope_text(statistic), summary.seconds_text(statistic));
            let _ = writeln!(text, "slope of log {name} over log samples: {slope}; seconds to {TARGET}: {seconds}");
        }
        text.push('\n');
    }
    text
}

/// Four significant digits: scenes differ by orders of magnitude.
fn digits(x: f64) -> String {
    let before = x.abs().log10().floor().clamp(-4.0, 3.0);
    format!("{x:.0$}", (3.0 - before) as usize)
}

fn efficiency(&[middle, from, to]: &[f64; 3]) -> String {
    format!("{} ({} to {})", digits(middle), digits(from), digits(to))
}

/// For documents.
pub fn markdown(head: &str, summaries: &[Summary]) -> String {
    let mut text = format!(
        "{head} Times are of renders alone, medians; errors are means over seeds, with the noise of the reference taken off; \
         trimmed is without the worst 0.1 % of pixels; intervals are of 95 %.\n\n\
         | scene | samples | seconds | Mpaths/s | relMSE | trimmed | 1/(relMSE·s) | 1/(trimmed·s) | slope, trimmed | seconds \
         to {TARGET}, trimmed |\n|---|---|---|---|---|---|---|---|---|---|\n"
    );
    let cells = |budget: &Budget| {
        let [plain, trimmed] = [0, 1].map(|statistic| efficiency(&budget.efficiency(statistic)));
        let [relmse, relmse_trimmed] = budget.relmse;
        format!(
            "{} | {:.4} | {:.3} | {relmse:.3e} | {relmse_trimmed:.3e} | {plain} | {trimmed}",
            budget.spp, budget.seconds.median, budget.mpaths_per_second.median
        )
    };
    for summary in summaries {
        if let Some(budget) = summary.budgets.last() {
            let (scene, slope, seconds) = (&summary.scene, summary.slope_text(1), summary.seconds_text(1));
            let _ = writeln!(text, "| {scene} | {} | {slope} | {seconds} |", cells(budget));
        }
    }
    for summary in summaries {
        let _ = writeln!(text, "\n## {}\n\nThe {}.\n", summary.scene, summary.reference_text());
        let _ = writeln!(
            text,
            "| samples | seconds | Mpaths/s | relMSE | trimmed | 1/(relMSE·s) | 1/(trimmed·s) | Mrays/s: camera, bounce, \
             shadow |\n|---|---|---|---|---|---|---|---|"
        );
        for budget in &summary.budgets {
            let [camera, bounce, shadow] = budget.mrays_per_second;
            let _ = writeln!(text, "| {} | {camera:.2}, {bounce:.2}, {shadow:.2} |", cells(budget));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A renderer that takes 2 ms for each sample and has an error of 0.8 over the samples to the power of 1.25.
    fn renders(seeds: u64) -> Vec<Render> {
        let of = |place: u32, round: u64| {
            let spp = 4_u32.pow(place);
            let seconds = 2e-3 * f64::from(spp);
            let off = 1.0 + 0.1 * (round as f64 - 1.0);
            let relmse = 0.8 * f64::from(spp).powf(-1.25) * off;
            Render {
                scene: "box".into(),
                key: "0".into(),
                size: [8, 8],
                threads: 1,
                sampler: SamplerKind::Sobol,
                max_depth: None,
                spp,
                seed: round,
                seconds,
                mpaths_per_second: 64e-6 * f64::from(spp) / seconds,
                mrays_per_second: [1.0, 2.0, 3.0],
                relmse: [relmse, 0.5 * relmse],
                reference_spp: 4096,
                reference_relmse: [1e-6, 1e-7],
            }
        };
        (0..5).flat_map(|place| (0..seeds).map(move |round| of(place, round))).collect()
    }

    /// Slope −1.25 in every round; 0.8·x^−1.25 = 0.01 at 33.3 samples, 66.6 ms; the geometric mean of 0.9, 1, 1.1.
    #[test]
    fn summaries_have_the_figures_of_the_formula() {
        let renders = renders(3);
        let all = Summary::all(&renders);
        let [summary] = &all[..] else { panic!("one scene") };
        assert_eq!(summary.budgets.iter().map(|it| it.spp).collect::<Vec<_>>(), [1, 4, 16, 64, 256]);
        for slope in summary.slope {
            let slope = slope.unwrap();
            assert!((slope.value + 1.25).abs() < 1e-9 && slope.variance < 1e-20, "{slope:?}");
        }
        let [plain, trimmed] = summary.seconds_to_target.map(Option::unwrap);
        let seconds = |factor: f64| 2e-3 * (factor / 0.01_f64).powf(0.8);
        assert!((plain / seconds(0.8) - 1.0).abs() < 1e-9 && (trimmed / seconds(0.4) - 1.0).abs() < 1e-9);
        let last = &summary.budgets[4];
        let want = 1.0 / (0.8 * 256_f64.powf(-1.25) * 0.99_f64.cbrt() * 0.512);
        let [middle, from, to] = last.efficiency(0);
        assert!((middle / want - 1.0).abs() < 1e-9 && from < middle && middle < to, "{middle} {want}");
        assert!((last.efficiency(1)[0] / want - 2.0).abs() < 1e-9);
        let json = summary.json();
        assert_eq!((json["spp"].as_u64(), json["reference_spp"].as_u64()), (Some(256), Some(4096)));
        assert!(json["slope_relmse_trimmed"].is_number() && json["seconds_to_relmse_0.01"].is_number());
        assert!(text(&all).contains("slope of log trimmed relMSE over log samples: -1.25"), "{}", text(&all));
        let markdown = markdown("A machine.", &all);
        assert!(markdown.lines().filter(|line| line.starts_with("| ")).all(|line| line.ends_with(" |")), "{markdown}");
    }

    /// Only between what was measured: nothing is made up beyond it.
    #[test]
    fn the_time_to_an_error_is_not_extrapolated() {
        let points = [(1.0, 0.1), (10.0, 0.001)];
        assert!((seconds_to(&points, 0.01).unwrap() - 10_f64.sqrt()).abs() < 1e-12);
        assert_eq!((seconds_to(&points, 0.2), seconds_to(&points, 1e-4)), (None, None));
        assert_eq!(seconds_to(&[(1.0, 0.1), (2.0, -1e-9)], 0.01), None, "less than the reference can tell");
        assert_eq!(seconds_to(&[(1.0, f64::NAN), (2.0, 0.1)], 0.2), None);
    }
}
