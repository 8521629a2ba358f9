//! `wavecast render`: a scene in, pictures out.

use std::{
    ops::Range,
    path::PathBuf,
    time::{Duration, Instant},
};

use wavecast::{
    film::{self, Exposure, Format, PathLayer, Split},
    flat::CameraView,
    render::{Integrator, LayerKind, RenderSettings, Sharing, find_lights, name_lights},
};

use super::{
    Common, Outcome,
    args::{self, Crop, DisplayArgs, FilterArg, IntegratorArg, LayerArg, SamplerArg, Size},
    console::Console,
    error::CliError,
    interrupt, memory,
    progress::Watcher,
    scene::{Opened, SceneArgs, default_size, light_names},
    stats::{self, Report, Seconds},
};

/// Samples per pixel where nothing says when to stop.
const DEFAULT_SPP: u32 = 64;

/// Render a picture of a scene
#[derive(clap::Args)]
#[command(after_help = "Example:
  wavecast render scenes/cornell.gltf -o cornell.png -o cornell.exr --spp 256 --layers albedo,normal")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Where the picture goes: .exr, .png or .hdr; may be given several times
    #[arg(short, long = "output", value_name = "OUT", required = true)]
    output: Vec<PathBuf>,
    /// Pixels [default: 1280 wide, in the camera's shape]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<Size>,
    /// Stop after N samples per pixel [default: 64, or none with --time or --error]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    spp: Option<u32>,
    /// Stop after a time, such as 30s or 5m
    #[arg(long, value_name = "TIME", value_parser = args::duration)]
    time: Option<Duration>,
    /// Stop when the square root of the picture's relMSE is at most this with a probability of 95 %, such as 1% or 0.01;
    /// samples go where the error is
    #[arg(long, value_name = "ERROR", value_parser = args::error, conflicts_with = "samples")]
    error: Option<f64>,
    /// Take samples A up to but not including B of each pixel
    #[arg(long, value_name = "A..B", value_parser = args::samples, conflicts_with = "spp")]
    samples: Option<Range<u32>>,
    /// Most scatterings along a path: 0 is emission, 1 direct light [default: no limit]
    #[arg(long, value_name = "N")]
    max_depth: Option<u32>,
    /// Which light is looked for
    #[arg(long, value_name = "KIND", value_enum, default_value_t = IntegratorArg::Path)]
    integrator: IntegratorArg,
    /// Distance within which --integrator ao looks for what is in the way, m [default: no limit]
    #[arg(long, value_name = "METRES", value_parser = args::not_negative)]
    ao_distance: Option<f32>,
    /// Chooses the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Kind of random numbers
    #[arg(long, value_name = "KIND", value_enum, default_value_t = SamplerArg::Sobol)]
    sampler: SamplerArg,
    /// Pixel filter
    #[arg(long, value_name = "KIND", value_enum, default_value_t = FilterArg::BlackmanHarris)]
    filter: FilterArg,
    /// Render only this part of the picture
    #[arg(long, value_name = "X,Y,W,H", value_parser = args::crop)]
    crop: Option<Crop>,
    /// Alpha 0 where the background shows
    #[arg(long)]
    transparent: bool,
    /// Leave shadows of coarse smooth meshes as their triangles cast them
    #[arg(long)]
    no_terminator_fix: bool,
    /// Let no pixel use the light that the paths of its neighbours found
    #[arg(long)]
    no_reuse: bool,
    #[command(flatten)]
    display: DisplayArgs,
    /// Further layers of the EXR, such as albedo,error
    #[arg(long, value_name = "LAYER,…", value_enum, value_delimiter = ',')]
    layers: Vec<LayerArg>,
    /// A layer of the light whose paths from the camera are as an expression says, with its standard error: D, G, S scattered
    /// diffusely, by rough facets, by a mirror or clear glass, R and T reflected and transmitted, L or B the light;
    /// may be given several times
    #[arg(long, value_name = "NAME=EXPR", value_parser = args::path_layer)]
    lpe: Vec<PathLayer>,
    /// Write times, counts and errors as JSON
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
    /// Paths that a worker keeps in flight
    #[arg(long, value_name = "N", default_value_t = 2048, value_parser = at_least_one)]
    wave_size: usize,
    /// Edge of a tile, pixels; rounded up to a multiple of 8
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..))]
    tile_size: u32,
}

fn at_least_one(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&n| n > 0).ok_or_else(|| "expected a whole number of at least 1".into())
}

/// Renders as told.
pub fn run(args: Args, common: &Common, console: &mut Console) -> Result<Outcome, CliError> {
    let start = Instant::now();
    let mut seconds = Seconds::default();
    check_outputs(&args, console)?;
    let Opened { scene, renderer, load_time, sync_time, build_time } = args.scene.open(console)?;
    (seconds.load, seconds.sync) = (load_time.as_secs_f64(), sync_time.as_secs_f64());
    let accel = args.scene.accel.report(renderer.scene(), build_time);

    let mut settings = settings(&args, common, &renderer.scene().camera)?;
    find_lights(&mut settings, &scene).map_err(|name| CliError::NoNamedLight {
        scene: args.scene.file.clone(),
        wanted: name,
        available: light_names(&scene, renderer.scene()),
    })?;
    memory::check_parts(&renderer, &settings)?;
    interrupt::keep_from_now_on();
    let watcher = Watcher::new(console.is_quiet());
    let mut rendered = renderer.render(&settings, &watcher);
    watcher.finish();
    seconds.render = rendered.stats.seconds;
    for (reason, count) in &rendered.stats.discarded {
        console.warn(format_args!("{count} samples were left out: {reason}"));
    }

    let write_start = Instant::now();
    rendered.picture.metadata = metadata(&args, &settings, rendered.stats.spp);
    name_lights(&mut rendered, &scene);
    for path in &args.output {
        film::write(path, &rendered.picture, &args.display.options(Exposure::default()))?;
    }
    seconds.write = write_start.elapsed().as_secs_f64();
    seconds.total = start.elapsed().as_secs_f64();

    let report = Report {
        scene: &args.scene.file,
        outputs: &args.output,
        settings: &settings,
        needs: renderer.scene().needs,
        stats: &rendered.stats,
        accel: &accel,
        seconds,
        warnings: console.warnings(),
    };
    if let Some(path) = &args.stats {
        film::write_file(path, |file| {
            use std::io::Write;
            writeln!(file, "{:#}", stats::json(&report))
        })?;
    }
    if console.is_json() || !console.is_quiet() {
        console.result(&stats::summary(&report), || stats::json(&report));
    }
    Ok(if rendered.stats.cancelled { Outcome::Interrupted } else { Outcome::Done })
}

/// All that can be known of the outputs before anything is loaded.
fn check_outputs(args: &Args, console: &mut Console) -> Result<(), CliError> {
    let mut formats = Vec::new();
    for path in &args.output {
        formats.push(Format::of(path)?);
        film::check_writable(path)?;
    }
    if let Some(path) = &args.stats {
        film::check_writable(path)?;
    }
    let has = |format| formats.contains(&format);
    let asks_for_layers = !args.layers.is_empty() || !args.lpe.is_empty();
    if asks_for_layers && !has(Format::Exr) {
        console.warn("--layers and --lpe have no effect: only EXR files hold layers");
    }
    if args.display.is_given() && !has(Format::Png) {
        console.warn("--exposure, --ev100 and --tonemap have no effect: only PNG files are exposed");
    }
    if args.transparent && has(Format::Hdr) {
        console.warn("Radiance files have no alpha: the background is black there");
    }
    Ok(())
}

fn settings(args: &Args, common: &Common, camera: &CameraView) -> Result<RenderSettings, CliError> {
    let [width, height] = args.size.map_or_else(|| default_size(camera), |size| size.0);
    if let Some(Crop([x, y, w, h])) = args.crop {
        let inside = |first: u32, length: u32, all: u32| first.checked_add(length).is_some_and(|end| end <= all);
        if !inside(x, w, width) || !inside(y, h, height) {
            return Err(CliError::Usage(format!(
                "--crop {x},{y},{w},{h} reaches beyond the picture of {width} × {height} pixels"
            )));
        }
    }
    if args.error.is_some() && args.sampler == SamplerArg::BlueNoise {
        return Err(CliError::Usage(
            "--sampler blue-noise makes the errors of pixels depend on one another, so that --error could not tell them; \
             leave out one of the two"
                .into(),
        ));
    }
    if args.ao_distance.is_some() && args.integrator != IntegratorArg::Ao {
        return Err(CliError::Usage("--ao-distance is for --integrator ao".into()));
    }
    let mut layers = Vec::new();
    for layer in args.layers.iter().map(|&layer| layer.into()) {
        if !layers.contains(&layer) {
            layers.push(layer);
        }
    }
    if !args.lpe.is_empty() {
        layers.push(LayerKind::Light(Split::Paths));
    }
    if matches!(args.integrator, IntegratorArg::Whitted | IntegratorArg::Ao)
        && layers.iter().any(|layer| layer.split().is_some_and(Split::by_path))
    {
        return Err(CliError::Usage(format!(
            "--integrator {} does not tell what happened to paths; leave out --lpe and lobes among the --layers",
            args::value_name(args.integrator)
        )));
    }
    for (row, path) in args.lpe.iter().enumerate() {
        if args.lpe[..row].iter().any(|other| other.name == path.name) {
            return Err(CliError::Usage(format!("--lpe: there are two layers {}", path.name)));
        }
    }
    let says_when = args.time.is_some() || args.error.is_some() || args.samples.is_some();
    Ok(RenderSettings {
        width,
        height,
        crop: args.crop.map(|crop| crop.0),
        spp: args.spp.or((!says_when).then_some(DEFAULT_SPP)),
        time: args.time,
        error: args.error,
        samples: args.samples.clone(),
        max_depth: args.max_depth,
        integrator: match args.integrator {
            IntegratorArg::Path => Integrator::Path,
            IntegratorArg::Direct => Integrator::Direct,
            IntegratorArg::Whitted => Integrator::Whitted,
            IntegratorArg::Ao => Integrator::Ambient { distance: args.ao_distance.unwrap_or(f32::INFINITY) },
        },
        seed: args.seed,
        sampler: args.sampler.into(),
        filter: args.filter.into(),
        caustics: true,
        terminator_fix: !args.no_terminator_fix,
        sharing: if args.no_reuse { Sharing::Off } else { Sharing::WherePays },
        transparent: args.transparent,
        layers,
        paths: args.lpe.clone(),
        wave_size: args.wave_size,
        sort: true,
        tile_size: args.tile_size,
        threads: common.threads.map_or(0, usize::from),
    })
}

/// What decides the pixels, as text for the files.
fn metadata(args: &Args, settings: &RenderSettings, spp: f64) -> Vec<(String, String)> {
    let mut pairs = args.scene.metadata();
    pairs.extend([
        ("size".into(), format!("{}x{}", settings.width, settings.height)),
        ("spp".into(), spp.to_string()),
        ("seed".into(), settings.seed.to_string()),
        ("sampler".into(), args::value_name(args.sampler)),
        ("filter".into(), args::value_name(args.filter)),
        ("integrator".into(), args::value_name(args.integrator)),
        ("max-depth".into(), settings.max_depth.map_or("none".into(), |depth| depth.to_string())),
        ("terminator-fix".into(), settings.terminator_fix.to_string()),
        ("transparent".into(), settings.transparent.to_string()),
        ("reuse".into(), (settings.sharing != Sharing::Off).to_string()),
    ]);
    let mut add = |key: &str, value: Option<String>| pairs.extend(value.map(|value| (key.to_owned(), value)));
    add("ao-distance", args.ao_distance.map(|distance| distance.to_string()));
    add("crop", settings.crop.map(|[x, y, w, h]| format!("{x},{y},{w},{h}")));
    add("error", settings.error.map(|error| error.to_string()));
    for path in &settings.paths {
        add(&format!("lpe.{}", path.name), Some(path.expression.to_string()));
    }
    add("samples", settings.samples.as_ref().map(|range| format!("{}..{}", range.start, range.end)));
    pairs
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::cli::{Cli, Command};

    fn parse(line: &str) -> (Args, Common) {
        let words = ["wavecast", "render", "a.glb", "-o", "a.exr"].into_iter().chain(line.split_whitespace());
        let cli = Cli::try_parse_from(words).unwrap_or_else(|error| panic!("{line}: {error}"));
        match cli.command {
            Command::Render(args) => (*args, cli.common),
            _ => unreachable!("the line says render"),
        }
    }

    fn settings_of(line: &str) -> RenderSettings {
        let (args, common) = parse(line);
        settings(&args, &common, &CameraView::default()).unwrap()
    }

    #[test]
    fn defaults_are_those_of_the_library() {
        assert_eq!(settings_of(""), RenderSettings::default());
    }

    #[test]
    fn sixty_four_samples_are_taken_only_where_nothing_says_when_to_stop() {
        assert_eq!(settings_of("--time 30s").spp, None);
        assert_eq!(settings_of("--time 30s --spp 9").spp, Some(9));
        let to_error = settings_of("--error 1%");
        assert_eq!((to_error.spp, to_error.time, to_error.error), (None, None, Some(0.01)));
        assert_eq!(settings_of("--error 0.01 --spp 9 --time 1s").spp, Some(9));
        let partial = settings_of("--samples 16..32");
        assert_eq!((partial.spp, partial.samples), (None, Some(16..32)));
    }

    #[test]
    fn options_arrive_where_they_belong() {
        let line = "--size 64x48 --max-depth 3 --seed 7 --sampler independent --filter box --crop 1,2,30,40 \
                    --transparent --no-terminator-fix --layers depth,uv,depth --wave-size 512 --tile-size 16 \
                    --threads 3";
        let got = settings_of(line);
        assert_eq!((got.width, got.height, got.crop), (64, 48, Some([1, 2, 30, 40])));
        assert_eq!((got.max_depth, got.seed, got.threads), (Some(3), 7, 3));
        assert_eq!((got.wave_size, got.tile_size), (512, 16));
        assert_eq!(got.sampler, wavecast::render::SamplerKind::Independent);
        assert_eq!(got.filter, wavecast::render::PixelFilter::Box);
        assert!(got.transparent && !got.terminator_fix);
        use wavecast::render::LayerKind::{Depth, Uv};
        assert_eq!(got.layers, [Depth, Uv], "once each, in the order asked for");
    }

    #[test]
    fn a_crop_beyond_the_picture_is_bad_usage() {
        let (args, common) = parse("--size 64x48 --crop 60,0,5,5");
        let error = settings(&args, &common, &CameraView::default()).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        assert!(error.to_string().contains("64 × 48"), "{error}");
    }
}
