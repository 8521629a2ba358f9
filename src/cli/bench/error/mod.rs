//! `wavecast bench error`: how far pictures are from the truth after how much time, and whether a change of the program
//! made that better or worse.
//!
//! Each scene is rendered with 1, 4, 16, … samples per pixel, as long as a render stays within the budget, several times
//! with different seeds. Errors are measured against a [reference], whose own noise is taken off. Rounds have one render
//! of every scene and number of samples, so that a machine that gets slower or faster does so to all.

mod compare;
mod explain;
mod measured;
mod plot;
mod reference;
mod report;

use std::{
    fs,
    ops::Range,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use serde_json::{Value, json};
use wavecast::{
    measure::metrics::TRIMMED,
    render::{PixelFilter, RenderSettings, Renderer},
};

use self::{
    compare::{Change, Comparison},
    measured::Measured,
    reference::{Effort, Reference},
    report::{Render, Summary},
};
use super::{
    Args,
    report::{csv, machine},
    subject::{Source, Subject},
};
use crate::cli::{
    Outcome,
    args::{self, SamplerArg, Size},
    console::Console,
    error::CliError,
};

/// Pixels if nothing is said.
const SIZE: Size = Size([400, 400]);
/// How many times more samples the next budget has.
const STEP: u32 = 4;
/// Time that is given to a reference if nothing is said, in budgets: its own relMSE is then a thirtieth of what the
/// longest renders have, or less.
const REFERENCE_BUDGETS: u32 = 30;
/// The two figures of each error, in all tables: over all pixels, and without the worst of them, as fireflies rule the
/// first where there are any.
const STATISTICS: [&str; 2] = ["relmse", "relmse_trimmed"];
/// A reference should have this many times less relMSE than what is measured against it.
const BETTER: f64 = 10.0;

/// What only `bench error` has.
#[derive(clap::Args)]
pub struct ErrorArgs {
    /// error: longest time of a render. All numbers of samples, 1, 4, 16, …, are measured that stay within it
    #[arg(long, value_name = "TIME", value_parser = args::duration, default_value = "2s")]
    budget: Duration,
    /// error: renders of each number of samples, all with different seeds
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(2..))]
    seeds: u32,
    /// error: only these rounds, each of which has one seed: for builds that take turns, and whose tables are then compared
    /// with --measured [default: 0..SEEDS]
    #[arg(long, value_name = "FIRST..END", value_parser = args::samples, conflicts_with = "seeds")]
    rounds: Option<Range<u32>>,
    /// error: most scatterings along a path [default: no limit]
    #[arg(long, value_name = "N")]
    max_depth: Option<u32>,
    /// error: kind of random numbers; references are the same for all
    #[arg(long, value_name = "KIND", value_enum, default_value_t = SamplerArg::Sobol)]
    sampler: SamplerArg,
    /// error: folder of the converged pictures, which are made where they are missing [default: wavecast/references in the
    /// user's cache]
    #[arg(long, value_name = "DIR")]
    references: Option<PathBuf>,
    /// error: render time of a reference; one that has had less is made better [default: 30 budgets]
    #[arg(long, value_name = "TIME", value_parser = args::duration)]
    reference_time: Option<Duration>,
    /// error: samples per pixel of a reference, in place of a time
    #[arg(long, value_name = "N", conflicts_with = "reference_time", value_parser = clap::value_parser!(u32).range(1..))]
    reference_spp: Option<u32>,
    /// error: explain instead what Monte Carlo integration does with a scene: variance by the way in which lights are found,
    /// error by number of samples, and how estimates of a pixel spread [default: --size 120x80 --spp 256]
    #[arg(long, conflicts_with_all = ["compare", "measured"])]
    explain: bool,
    /// error: say what became better or worse since this error.csv of another build, and exit with code 1 if a scene lost
    /// efficiency beyond the noise. How fast the machine was is part of both tables: see --rounds for one that is shared
    #[arg(long, value_name = "OLD.csv", num_args = 1..)]
    compare: Vec<PathBuf>,
    /// error: compare these error.csv, and measure nothing
    #[arg(long, value_name = "NEW.csv", num_args = 1.., requires = "compare", conflicts_with = "scenes")]
    measured: Vec<PathBuf>,
    /// error: probability that --compare calls any scene changed if none has
    #[arg(long, value_name = "P", requires = "compare", value_parser = compare::probability, default_value_t = 0.01)]
    significance: f64,
    /// error: change of a scene's efficiency that --compare calls none however sure it is, as from one day to the next the
    /// same program is faster or slower
    #[arg(long, value_name = "PERCENT", requires = "compare", value_parser = compare::percent, default_value = "3%")]
    tolerance: f64,
}

impl ErrorArgs {
    fn rounds(&self) -> Range<u32> {
        self.rounds.clone().unwrap_or(0..self.seeds)
    }
}

/// A scene that is ready to be measured.
struct Prepared {
    name: String,
    key: String,
    renderer: Renderer,
    reference: Reference,
    /// How many numbers of samples there are; the first round finds out.
    budgets: u32,
}

/// Measures, or reads what was measured, compares, and reports.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    let error = &args.error;
    if error.explain {
        return explain::run(args, console);
    }
    if args.scenes.is_empty() && error.measured.is_empty() {
        return Err(CliError::Usage("bench error needs a SCENE, or --measured with --compare".into()));
    }
    if let Some((_, twice)) = args.scenes.iter().enumerate().find(|(place, it)| args.scenes[..*place].contains(it)) {
        return Err(CliError::Usage(format!("{twice} is named twice")));
    }
    // Before hours are spent.
    let old = measured::read_all(&error.compare)?;
    if let Some(folder) = &args.output {
        fs::create_dir_all(folder).map_err(|source| CliError::Output { path: folder.clone(), source })?;
    }
    let renders = if error.measured.is_empty() { measure_all(args, console)? } else { Vec::new() };
    let summaries = Summary::all(&renders);
    summaries.iter().filter_map(reference_is_poor).for_each(|warning| console.warn(warning));
    let comparison = match error.compare.first() {
        None => None,
        Some(path) => {
            let mut new: Vec<Measured> = renders.iter().map(Measured::from).collect();
            new.extend(measured::read_all(&error.measured)?);
            Some(Comparison::new(path, &old, &new, error.significance, error.tolerance, console)?)
        }
    };
    if let Some(folder) = args.output.as_deref().filter(|_| error.measured.is_empty()) {
        write(folder, &renders, &summaries, comparison.as_ref(), args)?;
    }
    let mut text = report::text(&summaries);
    text += &comparison.as_ref().map(Comparison::text).unwrap_or_default();
    console.result(&text, || {
        let changes = |comparison: &Comparison| comparison.changes.iter().map(Change::json).collect::<Vec<_>>();
        json!({
            "renders": renders.iter().map(Render::json).collect::<Vec<_>>(),
            "budgets": summaries.iter().flat_map(Summary::budgets_json).collect::<Vec<_>>(),
            "scenes": summaries.iter().map(Summary::json).collect::<Vec<_>>(),
            "comparison": comparison.as_ref().map_or(Value::Null, |comparison| json!(changes(comparison))),
        })
    });
    match comparison {
        Some(comparison) => comparison.verdict(),
        None => Ok(Outcome::Done),
    }
}

/// Tables and plots.
fn write(
    folder: &Path,
    renders: &[Render],
    summaries: &[Summary],
    comparison: Option<&Comparison>,
    args: &Args,
) -> Result<(), CliError> {
    let Size([width, height]) = args.size.unwrap_or(SIZE);
    let head = format!(
        "{}, {width}×{height} pixels, {} threads, box filter, {} seeds in turn.",
        machine(),
        rayon::current_num_threads(),
        args.error.rounds().len()
    );
    let markdown = report::markdown(&head, summaries) + &comparison.map(Comparison::markdown).unwrap_or_default();
    let mut files = vec![
        ("error.csv", csv(renders.iter().map(Render::json))),
        ("error-budgets.csv", csv(summaries.iter().flat_map(Summary::budgets_json))),
        ("error-scenes.csv", csv(summaries.iter().map(Summary::json))),
        ("error.md", markdown),
    ];
    files.extend(comparison.map(|it| ("error-comparison.csv", csv(it.changes.iter().map(Change::json)))));
    for (name, text) in files {
        let path = folder.join(name);
        fs::write(&path, text).map_err(|source| CliError::Output { path, source })?;
    }
    for summary in summaries {
        let of_scene: Vec<&Render> = renders.iter().filter(|render| render.scene == summary.scene).collect();
        let path = folder.join(format!("error-{}.svg", Subject::file_name(&summary.scene)));
        plot::error_over_time(&path, summary, &of_scene)?;
    }
    Ok(())
}

/// What to do if the noise of the reference is too much of what was measured.
fn reference_is_poor(summary: &Summary) -> Option<String> {
    let least = |statistic: usize| summary.budgets.iter().map(|it| it.relmse[statistic]).fold(f64::INFINITY, f64::min);
    let times = |statistic: usize| least(statistic) / summary.reference_relmse[statistic];
    // What is 0 throughout needs no reference.
    let worst = if times(0) > times(1) { 1 } else { 0 };
    let (least, noise) = (least(worst), summary.reference_relmse[worst]);
    (least < BETTER * noise).then(|| {
        format!(
            "{}: the least {} measured, {least:.2e}, is not {BETTER} times that of the reference, {noise:.2e}: what is said \
             of errors depends on its noise; give it more with --reference-time or --reference-spp",
            summary.scene, STATISTICS[worst]
        )
    })
}

/// Rounds over all scenes.
fn measure_all(args: &Args, console: &mut Console) -> Result<Vec<Render>, CliError> {
    let size = args.size.unwrap_or(SIZE);
    let settings = RenderSettings {
        width: size.0[0],
        height: size.0[1],
        filter: PixelFilter::Box,
        max_depth: args.error.max_depth,
        sampler: args.error.sampler.into(),
        threads: rayon::current_num_threads(),
        ..RenderSettings::default()
    };
    let mut scenes = Vec::new();
    for source in &args.scenes {
        scenes.push(prepare(source, args, size, &settings, console)?);
    }
    let mut renders = Vec::new();
    for round in args.error.rounds() {
        console.note(format_args!("round {round} of {:?}", args.error.rounds()));
        for scene in &mut scenes {
            let more = one_round(scene, round, args, &settings, console);
            renders.extend(more);
        }
    }
    // Scene by scene, budget by budget, as people read.
    renders.sort_by_key(|render| (scenes.iter().position(|scene| scene.name == render.scene), render.spp, render.seed));
    Ok(renders)
}

fn prepare(
    source: &Source,
    args: &Args,
    size: Size,
    settings: &RenderSettings,
    console: &mut Console,
) -> Result<Prepared, CliError> {
    let (name, key) = (source.to_string(), reference::key(source, args, size)?);
    let (_, renderer) = args.open(source, console)?;
    let error = &args.error;
    let effort = match (error.reference_spp, error.reference_time) {
        (Some(spp), _) => Effort::Samples(spp),
        (None, time) => Effort::Time(time.unwrap_or(error.budget * REFERENCE_BUDGETS)),
    };
    let folder = match &error.references {
        Some(folder) => folder.clone(),
        None => dirs::cache_dir()
            .ok_or_else(|| {
                CliError::Usage("there is no cache folder for references; name one with --references".into())
            })?
            .join("wavecast/references"),
    };
    let reference = reference::obtain(&renderer, settings, [&name, &key], &folder, effort, console)?;
    Ok(Prepared { name, key, renderer, reference, budgets: 0 })
}

/// One render of each number of samples; the first round finds out how many fit into the budget.
fn one_round(
    scene: &mut Prepared,
    round: u32,
    args: &Args,
    settings: &RenderSettings,
    console: &mut Console,
) -> Vec<Render> {
    if scene.budgets > 0 {
        return (0..scene.budgets).map(|place| render(scene, place, round, settings, console)).collect();
    }
    // Memory that is touched for the first time is not what is measured.
    scene.renderer.render(&RenderSettings { spp: Some(1), ..settings.clone() }, &());
    let (budget, most) = (args.error.budget.as_secs_f64(), args.spp.unwrap_or(u32::MAX));
    let mut renders: Vec<Render> = Vec::new();
    let fits = |last: Option<&Render>| last.is_none_or(|last| last.seconds * f64::from(STEP) <= budget);
    while fits(renders.last()) && STEP.checked_pow(scene.budgets).is_some_and(|spp| spp <= most) {
        renders.push(render(scene, scene.budgets, round, settings, console));
        scene.budgets += 1;
    }
    renders
}

/// Renders with `STEP` to the power of `place` samples.
fn render(scene: &Prepared, place: u32, round: u32, settings: &RenderSettings, console: &mut Console) -> Render {
    let spp = STEP.pow(place);
    // Another for each budget as well, so that errors are independent.
    let seed = u64::from(place) << 32 | u64::from(round);
    let settings = RenderSettings { spp: Some(spp), seed, ..settings.clone() };
    let start = Instant::now();
    let rendered = scene.renderer.render(&settings, &());
    let seconds = start.elapsed().as_secs_f64();
    for (reason, count) in &rendered.stats.discarded {
        console.warn(format_args!("{}: {count} samples were left out: {reason}", scene.name));
    }
    let rays = &rendered.stats.rays;
    let per_second = |count: u64| count as f64 / seconds / 1e6;
    Render {
        scene: scene.name.clone(),
        key: scene.key.clone(),
        size: [settings.width, settings.height],
        threads: settings.threads,
        sampler: settings.sampler,
        max_depth: settings.max_depth,
        spp,
        seed,
        seconds,
        mpaths_per_second: per_second(rendered.stats.paths),
        mrays_per_second: [rays.camera, rays.bounce, rays.shadow].map(per_second),
        relmse: [0.0, TRIMMED].map(|share| scene.reference.converged.rel_mse(&rendered.picture.rgb, share)),
        reference_spp: scene.reference.spp(),
        reference_relmse: scene.reference.noise,
    }
}
