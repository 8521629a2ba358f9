//! What a render did, for people and for programs.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};
use wavecast::{
    film::PictureError,
    flat::SceneNeeds,
    measure::series::tail,
    render::{PartMean, RenderSettings, RenderStats},
};

use super::structure::AccelReport;

/// Wall time by part.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seconds {
    pub load: f64,
    pub sync: f64,
    pub render: f64,
    pub write: f64,
    pub total: f64,
}

/// All that there is to say.
pub struct Report<'a> {
    pub scene: &'a Path,
    pub outputs: &'a [PathBuf],
    pub settings: &'a RenderSettings,
    pub needs: SceneNeeds,
    pub stats: &'a RenderStats,
    pub accel: &'a AccelReport,
    pub seconds: Seconds,
    pub warnings: &'a [String],
}

/// Millions of rays per second of render time.
fn mrays_per_second(stats: &RenderStats) -> f64 {
    let rays = stats.rays.camera + stats.rays.bounce + stats.rays.shadow;
    if stats.seconds > 0.0 { rays as f64 / stats.seconds * 1e-6 } else { 0.0 }
}

/// `--stats` and `--json`; the keys are a contract.
pub fn json(report: &Report) -> Value {
    let Report { stats, seconds, settings, .. } = report;
    let stages: Vec<_> = stats
        .stages
        .iter()
        .map(|s| json!({ "name": s.name, "seconds": s.seconds, "rows": s.rows, "lane_fill": s.lane_fill }))
        .collect();
    json!({
        "scene": report.scene.display().to_string(),
        "outputs": report.outputs.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
        "size": [settings.width, settings.height],
        "seconds": {
            "load": seconds.load,
            "sync": seconds.sync,
            "render": seconds.render,
            "write": seconds.write,
            "total": seconds.total,
        },
        "accel": report.accel.json(),
        "spp": stats.spp,
        "paths": stats.paths,
        "rays": { "camera": stats.rays.camera, "bounce": stats.rays.bounce, "shadow": stats.rays.shadow },
        "mrays_per_second": mrays_per_second(stats),
        "stages": stages,
        "counters": counts(&stats.counters),
        "peak_rss_bytes": peak_rss_bytes(),
        "error": error(stats.error.as_ref()),
        "light": light(&stats.parts),
        "cut_off": cut_off(stats, settings),
        "needed": report.needs.names(false),
        "skipped": report.needs.names(true),
        "discarded_samples": counts(&stats.discarded),
        "warnings": report.warnings,
        "threads": stats.threads,
        "seed": settings.seed,
        "interrupted": stats.cancelled,
        "version": env!("CARGO_PKG_VERSION"),
    })
}

/// Estimates of the picture's relMSE and of its mean, each with what it is within at 95 %.
fn error(error: Option<&PictureError>) -> Value {
    let interval = |end: usize| error.map(|error| error.mean.map(|channel| channel.interval(0.95)[end]));
    json!({
        "relmse": error.map(|error| error.relmse),
        "upper95": error.map(|error| error.upper95),
        "mean": error.map(|error| error.mean.map(|channel| channel.value)),
        "mean_from": interval(0),
        "mean_to": interval(1),
    })
}

/// Means of the layers of light in parts.
pub fn light(parts: &[PartMean]) -> Vec<Value> {
    let row = |part: &PartMean| {
        let interval = |end: usize| part.mean.map(|channel| channel.interval(0.95)[end]);
        json!({
            "layer": part.layer,
            "mean": part.mean.map(|channel| channel.value),
            "mean_from": interval(0),
            "mean_to": interval(1),
            "luminance": part.luminance.value,
            "luminance_interval": part.luminance.interval(0.95),
        })
    };
    parts.iter().map(row).collect()
}

/// What a limit of scatterings took away, where layers by bounces tell.
fn cut_off(stats: &RenderStats, settings: &RenderSettings) -> Option<[f64; 3]> {
    let depth = settings.max_depth?;
    let last = |n: u32| stats.parts.iter().find(|part| part.layer == format!("bounce{n:02}"));
    let terms = (depth.saturating_sub(2)..=depth).map(|n| last(n).map(|part| part.mean));
    tail(&terms.collect::<Option<Vec<_>>>()?)
}

fn counts(pairs: &[(&'static str, u64)]) -> Map<String, Value> {
    pairs.iter().map(|&(name, count)| (name.to_owned(), count.into())).collect()
}

/// A line or two on what was done.
pub fn summary(report: &Report) -> String {
    let Report { stats, seconds, .. } = report;
    let outputs: Vec<_> = report.outputs.iter().map(|path| path.display().to_string()).collect();
    let mut text = format!(
        "{}: {:.4} samples per pixel in {:.2} s, {:.2} Mrays/s",
        outputs.join(", "),
        stats.spp,
        seconds.render,
        mrays_per_second(stats),
    );
    if let Some(PictureError { relmse, upper95, .. }) = stats.error {
        let [about, most] = [relmse, upper95].map(|squared| 100.0 * squared.sqrt());
        text.push_str(&format!(", relMSE about {relmse:.2e}, error about {about:.2} %, at most {most:.2} % (95 %)"));
    }
    if stats.cancelled {
        text.push_str(" (interrupted)");
    }
    text
}

/// Most memory that the process has held; `None` where the system does not say.
fn peak_rss_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use wavecast::flat::FlatScene;

    use super::*;
    use crate::cli::structure::AccelArgs;

    /// The keys that `--stats` promises; scripts rely on them.
    #[test]
    fn stats_have_every_promised_key() {
        let stats = RenderStats {
            seconds: 2.0,
            spp: 4.0,
            paths: 400,
            rays: wavecast::render::RayCounts { camera: 400, bounce: 500, shadow: 1_999_100 },
            stages: vec![wavecast::render::StageStats {
                name: "shade",
                seconds: 0.5,
                rows: 9,
                blocks: 2,
                lane_fill: 0.9,
            }],
            discarded: vec![("not finite", 3)],
            threads: 2,
            ..RenderStats::default()
        };
        let accel = AccelArgs::default().report(&FlatScene::default(), Duration::from_millis(500));
        let report = Report {
            scene: Path::new("a.glb"),
            outputs: &["a.exr".into()],
            settings: &RenderSettings::default(),
            needs: SceneNeeds::ALPHA,
            stats: &stats,
            accel: &accel,
            seconds: Seconds { total: 3.0, ..Seconds::default() },
            warnings: &["odd".into()],
        };
        let got = json(&report);
        for key in ["load", "sync", "render", "write", "total"] {
            assert!(got["seconds"][key].is_f64(), "seconds.{key}");
        }
        assert_eq!(got["mrays_per_second"], 1.0, "two million rays in two seconds");
        assert_eq!(got["rays"], json!({ "camera": 400, "bounce": 500, "shadow": 1_999_100 }));
        assert_eq!(got["stages"][0], json!({ "name": "shade", "seconds": 0.5, "rows": 9, "lane_fill": 0.9 }));
        let unknown = json!({ "relmse": null, "upper95": null, "mean": null, "mean_from": null, "mean_to": null });
        assert_eq!(got["error"], unknown);
        assert_eq!(got["discarded_samples"], json!({ "not finite": 3 }));
        assert_eq!(got["warnings"], json!(["odd"]));
        assert_eq!(got["accel"]["name"], "bvh8");
        assert_eq!(got["accel"]["build_seconds"], 0.5);
        assert!(!got["skipped"].as_array().unwrap().contains(&"alpha".into()));
        assert!(got["skipped"].as_array().unwrap().contains(&"textures".into()));
        for key in ["spp", "paths", "threads", "seed", "version"] {
            assert!(!got[key].is_null(), "{key}");
        }
        assert!(got["peak_rss_bytes"].as_u64().is_none_or(|bytes| bytes > 100_000));
    }
}
