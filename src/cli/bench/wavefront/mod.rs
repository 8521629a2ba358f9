//! `wavecast bench wavefront`: what the render loop does in a second, where its time goes, and what it gains over one
//! path at a time.
//!
//! Everything that is measured has made the picture of everything else before a time is taken, to the last bit; the f64
//! reference, which draws other numbers, is held against it by the tests. In each run all take their turn, and ratios
//! are of the same run.

mod plot;
mod report;

use std::{fs, time::Instant};

use rayon::{ThreadPool, ThreadPoolBuilder};
use serde_json::json;
use wavecast::{
    flat::FlatScene,
    reference::{self, ReferenceSettings, Tracer},
    render::{PixelFilter, RenderSettings, RenderStats, Rendered},
    wavefront,
};

use self::report::{Row, StageRow};
use super::{
    Args, Part,
    report::{Spread, csv, machine},
    subject::Source,
};
use crate::cli::{Outcome, args::Size, console::Console, error::CliError};

/// Times each figure is taken if nothing is said.
const RUNS: u32 = 7;
/// Pixels if nothing is said.
const SIZE: Size = Size([256, 256]);
/// Samples per pixel if nothing is said.
const SPP: u32 = 8;
/// Paths in a wave: from a block to more than fits into any cache of one core.
const WAVE_SIZES: std::ops::RangeInclusive<u32> = 3..=17;
/// Edge of a tile where the number of paths in a wave is what is measured, pixels: else the tile is what ends a wave.
const LARGE_TILE: u32 = 128;
/// Samples per pixel of the reference, which is slow.
const REFERENCE_SPP: u32 = 2;

/// A way to make the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Wavefront,
    OnePath,
    Reference,
}

impl Mode {
    fn name(self) -> &'static str {
        match self {
            Self::Wavefront => "wavefront",
            Self::OnePath => "one-path",
            Self::Reference => "reference",
        }
    }
}

/// One line of the table, before it is measured.
#[derive(Clone, Debug)]
struct Variant {
    part: Part,
    mode: Mode,
    settings: RenderSettings,
}

impl Variant {
    fn name(&self) -> String {
        let RenderSettings { wave_size, sort, threads, .. } = self.settings;
        let sorted = if sort { "sorted" } else { "unsorted" };
        format!("{}, {wave_size} paths in a wave, {sorted}, threads: {threads}", self.mode.name())
    }
}

/// What one run of one variant gave.
struct Timed {
    seconds: f64,
    paths: f64,
    /// None for the reference, which does not count.
    rays: Option<f64>,
}

/// All variants of the parts; the first of each part is what the others of the part are compared with.
fn variants(args: &Args) -> Vec<Variant> {
    let cores = rayon::current_num_threads();
    let scaling: Vec<usize> = match &args.scaling[..] {
        [] => (0..).map(|log| 1 << log).take_while(|&n| n < cores).chain([cores]).collect(),
        given => given.iter().map(|n| n.get()).collect(),
    };
    let Size([width, height]) = args.size.unwrap_or(SIZE);
    let settings = RenderSettings {
        width,
        height,
        spp: Some(args.spp.unwrap_or(SPP)),
        filter: PixelFilter::Box,
        threads: scaling[0],
        ..RenderSettings::default()
    };
    let wave = |part, settings: RenderSettings| Variant { part, mode: Mode::Wavefront, settings };
    let mut all = Vec::new();
    let parts = [Part::Modes, Part::Sort, Part::Threads, Part::WaveSize];
    for part in parts.into_iter().filter(|part| args.parts.is_empty() || args.parts.contains(part)) {
        match part {
            Part::Modes => {
                let modes = [Mode::Wavefront, Mode::OnePath, Mode::Reference];
                all.extend(modes.map(|mode| Variant { part, mode, settings: settings.clone() }));
            }
            Part::Sort => {
                all.extend([true, false].map(|sort| wave(part, RenderSettings { sort, ..settings.clone() })));
            }
            Part::Threads => {
                all.extend(scaling.iter().map(|&threads| wave(part, RenderSettings { threads, ..settings.clone() })));
            }
            Part::WaveSize => {
                // The size that renders comes first.
                let sizes = WAVE_SIZES.map(|log| 1 << log).filter(|&size| size != settings.wave_size);
                all.extend([settings.wave_size].into_iter().chain(sizes).map(|wave_size| {
                    wave(part, RenderSettings { wave_size, tile_size: LARGE_TILE, ..settings.clone() })
                }));
            }
        }
    }
    all
}

/// What variants are asked of.
struct Bench<'a> {
    scene: &'a FlatScene,
    reference: ReferenceSettings,
    tracer: Tracer<'a>,
    pool: ThreadPool,
}

impl Bench<'_> {
    fn render(&self, variant: &Variant) -> Rendered {
        match variant.mode {
            Mode::OnePath => wavefront::render_one_path(self.scene, &variant.settings, &()),
            _ => wavefront::render(self.scene, &variant.settings, &()),
        }
    }

    fn timed(&self, variant: &Variant) -> (Timed, Option<RenderStats>) {
        let start = Instant::now();
        if variant.mode == Mode::Reference {
            let picture = self.pool.install(|| reference::render_with(&self.tracer, self.scene, &self.reference));
            let paths = picture.rgb.len() as f64 * f64::from(picture.samples);
            return (Timed { seconds: start.elapsed().as_secs_f64(), paths, rays: None }, None);
        }
        let stats = self.render(variant).stats;
        let rays = (stats.rays.camera + stats.rays.bounce + stats.rays.shadow) as f64;
        let timed = Timed { seconds: start.elapsed().as_secs_f64(), paths: stats.paths as f64, rays: Some(rays) };
        (timed, Some(stats))
    }

    /// An error if a variant makes another picture than the first.
    fn check(&self, name: &str, variants: &[Variant]) -> Result<(), CliError> {
        let mut pictures = variants.iter().filter(|variant| variant.mode != Mode::Reference);
        let Some(first) = pictures.next() else { return Ok(()) };
        let expected = self.render(first).picture.rgb;
        for variant in pictures {
            same_picture(name, variant, &expected, &self.render(variant).picture.rgb)?;
        }
        Ok(())
    }
}

fn same_picture(scene: &str, variant: &Variant, expected: &[[f32; 3]], got: &[[f32; 3]]) -> Result<(), CliError> {
    let differ = |(a, b): &(&[f32; 3], &[f32; 3])| a.map(f32::to_bits) != b.map(f32::to_bits);
    match expected.iter().zip(got).filter(differ).count() {
        0 => Ok(()),
        pixels => Err(CliError::WrongPicture { scene: scene.to_owned(), variant: variant.name(), pixels }),
    }
}

/// Measures each scene and reports.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    if let Some(folder) = &args.output {
        fs::create_dir_all(folder).map_err(|source| CliError::Output { path: folder.clone(), source })?;
    }
    let variants = variants(args);
    let (mut rows, mut stages) = (Vec::new(), Vec::new());
    for source in &args.scenes {
        let (more, its_stages) = measure(source, args, &variants, console)?;
        rows.extend(more);
        stages.extend(its_stages);
    }
    if let Some(folder) = &args.output {
        let Size([width, height]) = args.size.unwrap_or(SIZE);
        let runs = args.runs.unwrap_or(RUNS);
        let head = format!(
            "{}, {width}×{height} pixels, {} samples each, {runs} runs in turn.",
            machine(),
            args.spp.unwrap_or(SPP)
        );
        let files = [
            ("wavefront.csv", csv(rows.iter().map(Row::json))),
            ("wavefront-stages.csv", csv(stages.iter().map(StageRow::json))),
            ("wavefront.md", report::markdown(&head, &rows, &stages)),
        ];
        for (name, text) in files {
            let path = folder.join(name);
            fs::write(&path, text).map_err(|source| CliError::Output { path, source })?;
        }
        plot::wave_sizes(&folder.join("wave-size.svg"), &rows)?;
        plot::stages(&folder.join("stages.svg"), &stages)?;
    }
    console.result(&report::text(&rows, &stages), || {
        json!({
            "rows": rows.iter().map(Row::json).collect::<Vec<_>>(),
            "stages": stages.iter().map(StageRow::json).collect::<Vec<_>>(),
        })
    });
    Ok(Outcome::Done)
}

/// Checks the pictures of one scene, then takes the time.
fn measure(
    source: &Source,
    args: &Args,
    variants: &[Variant],
    console: &mut Console,
) -> Result<(Vec<Row>, Vec<StageRow>), CliError> {
    let (_, renderer) = args.open(source, console)?;
    let (name, scene) = (source.to_string(), renderer.scene());
    let threads = variants.first().map_or(1, |first| first.settings.threads);
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|error| CliError::Usage(format!("cannot start {threads} threads: {error}")))?;
    let Size([width, height]) = args.size.unwrap_or(SIZE);
    let reference = ReferenceSettings {
        width: width.div_ceil(2),
        height: height.div_ceil(2),
        spp: REFERENCE_SPP,
        filter: PixelFilter::Box,
        ..ReferenceSettings::default()
    };
    let bench = Bench { scene, tracer: Tracer::new(scene, &reference), reference, pool };
    console.note(format!("{name}: do all make the same picture?"));
    bench.check(&name, variants)?;
    let runs = args.runs.unwrap_or(RUNS);
    let mut timed: Vec<Vec<Timed>> = variants.iter().map(|_| Vec::new()).collect();
    let (mut stats, mut unsorted) = (Vec::new(), None);
    // Stages are those of waves as they render, from whichever part is measured.
    let ordinary = variants.iter().position(|variant| variant.mode == Mode::Wavefront && variant.settings.sort);
    for run in 0..runs {
        console.note(format!("{name}: run {} of {runs}", run + 1));
        for (place, variant) in variants.iter().enumerate() {
            let (time, counts) = bench.timed(variant);
            timed[place].push(time);
            if Some(place) == ordinary {
                stats.extend(counts);
            } else if !variant.settings.sort {
                unsorted = counts;
            }
        }
    }
    let of_part = |part: Part| variants.iter().position(|variant| variant.part == part).unwrap_or(0);
    let row = |(place, variant): (usize, &Variant)| {
        let (mine, first) = (&timed[place], &timed[of_part(variant.part)]);
        let speed = |of: fn(&Timed) -> Option<f64>| {
            let all: Option<Vec<f64>> = mine.iter().map(|one| Some(of(one)? / one.seconds / 1e6)).collect();
            all.map(Spread::of)
        };
        let ratio = |(first, mine): (&Timed, &Timed)| (first.paths / first.seconds) / (mine.paths / mine.seconds);
        Row {
            scene: name.clone(),
            part: variant.part,
            mode: variant.mode.name(),
            wave_size: variant.settings.wave_size,
            sorted: variant.settings.sort,
            threads: variant.settings.threads,
            mpaths_per_second: Spread::of(mine.iter().map(|one| one.paths / one.seconds / 1e6).collect()),
            mrays_per_second: speed(|one| one.rays),
            first_over: Spread::of(first.iter().zip(mine).map(ratio).collect()),
        }
    };
    let rows = variants.iter().enumerate().map(row).collect();
    Ok((rows, StageRow::of(&name, &stats, unsorted.as_ref())))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture that differs by one bit is another picture, and the sentence says whose.
    #[test]
    fn a_bit_that_differs_is_found() {
        let settings = RenderSettings { sort: false, threads: 2, ..RenderSettings::default() };
        let variant = Variant { part: Part::Sort, mode: Mode::Wavefront, settings };
        let expected = [[0.5; 3], [1.0, 0.0, 2.0]];
        assert!(same_picture("room", &variant, &expected, &expected).is_ok());
        let mut got = expected;
        got[1][2] = f32::from_bits(got[1][2].to_bits() + 1);
        let error = same_picture("room", &variant, &expected, &got).unwrap_err().to_string();
        assert!(error.starts_with("room: wavefront, 2048 paths in a wave, unsorted, threads: 2 makes"), "{error}");
        assert!(error.contains("1 pixels differ"), "{error}");
    }
}
