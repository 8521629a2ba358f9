//! `wavecast render`: a scene in, pictures out.

use std::{
    ops::Range,
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, Instant},
};

use wavecast::{
    film::{self, Exposure, Format},
    flat::CameraView,
    load::{self, CameraInfo, LoadOptions},
    render::{RenderSettings, Renderer, Sharing, name_lights},
    world::{Camera, Environment, Name, Scene, SceneKey, Sky},
};

use super::{
    Common, Outcome,
    args::{self, Crop, DisplayArgs, EnvArg, FilterArg, LayerArg, SamplerArg, Size},
    console::Console,
    error::CliError,
    interrupt,
    progress::Watcher,
    stats::{self, Report, Seconds},
    structure::AccelArgs,
};

/// Width of a picture of which only the shape is known.
const DEFAULT_WIDTH: u32 = 1280;
/// Shape of a picture where neither the user nor the camera says.
const DEFAULT_ASPECT: f32 = 16.0 / 9.0;
/// Samples per pixel where nothing says when to stop.
const DEFAULT_SPP: u32 = 64;

/// Render a picture of a scene
#[derive(clap::Args)]
#[command(after_help = "Example:
  wavecast render scenes/cornell.gltf -o cornell.png -o cornell.exr --spp 256 --layers albedo,normal")]
pub struct Args {
    /// The scene, .gltf or .glb
    #[arg(value_name = "SCENE")]
    scene_file: PathBuf,
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
    /// Camera by name or index [default: the first one; none: one that frames the scene]
    #[arg(long, value_name = "NAME|INDEX")]
    camera: Option<String>,
    /// Scene by name or index [default: the file's]
    #[arg(long, value_name = "NAME|INDEX")]
    scene: Option<String>,
    /// Environment: a lat-long picture in nit, or R,G,B in nit
    #[arg(long, value_name = "FILE|R,G,B", value_parser = args::env)]
    env: Option<EnvArg>,
    /// Turn the environment about +Y, counter-clockwise seen from above
    #[arg(long, value_name = "DEGREES", value_parser = args::finite, allow_hyphen_values = true, requires = "env")]
    env_rotate: Option<f32>,
    /// Multiply the environment's light
    #[arg(long, value_name = "X", value_parser = args::not_negative, requires = "env")]
    env_scale: Option<f32>,
    /// Most scatterings along a path: 0 is emission, 1 direct light [default: no limit]
    #[arg(long, value_name = "N")]
    max_depth: Option<u32>,
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
    accel: AccelArgs,
    #[command(flatten)]
    display: DisplayArgs,
    /// Further layers of the EXR, such as albedo,error
    #[arg(long, value_name = "LAYER,…", value_enum, value_delimiter = ',')]
    layers: Vec<LayerArg>,
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
    let accel = args.accel.kind()?;
    check_outputs(&args, console)?;

    let options = LoadOptions { scene: args.scene.as_deref().map(Into::into) };
    let mut loaded = load::load(&args.scene_file, &options)?;
    loaded.warnings.iter().for_each(|warning| console.warn(warning));
    let scene = &mut loaded.scene;
    if let Some(env) = &args.env {
        let (rotation, scale) = (args.env_rotate.unwrap_or(0.0), args.env_scale.unwrap_or(1.0));
        set_environment(scene, env, rotation, scale, console)?;
    }
    choose_camera(scene, &loaded.info.cameras, &args, console)?;
    seconds.load = start.elapsed().as_secs_f64();

    let sync_start = Instant::now();
    let mut renderer = Renderer::new();
    renderer.accel = accel;
    let report = renderer.sync(scene);
    report.warnings.iter().for_each(|warning| console.warn(warning));
    if renderer.scene().lights.default_sky {
        console.warn("no light in the scene: using a uniform environment of 1 nit");
    }
    seconds.sync = sync_start.elapsed().as_secs_f64();
    let accel = args.accel.report(renderer.scene(), report.build_time);

    let settings = settings(&args, common, &renderer.scene().camera)?;
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
    name_lights(&mut rendered.picture, scene);
    for path in &args.output {
        film::write(path, &rendered.picture, &args.display.options(Exposure::default()))?;
    }
    seconds.write = write_start.elapsed().as_secs_f64();
    seconds.total = start.elapsed().as_secs_f64();

    let report = Report {
        scene: &args.scene_file,
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
    if !args.layers.is_empty() && !has(Format::Exr) {
        console.warn("--layers has no effect: only EXR files hold layers");
    }
    if args.display.is_given() && !has(Format::Png) {
        console.warn("--exposure, --ev100 and --tonemap have no effect: only PNG files are exposed");
    }
    if args.transparent && has(Format::Hdr) {
        console.warn("Radiance files have no alpha: the background is black there");
    }
    Ok(())
}

/// Puts the environment asked for in the place of the scene's own.
pub fn set_environment(
    scene: &mut Scene,
    env: &EnvArg,
    rotation_degrees: f32,
    scale: f32,
    console: &mut Console,
) -> Result<(), CliError> {
    let sky = match env {
        EnvArg::Constant(radiance) => Sky::Constant((*radiance).into()),
        EnvArg::File(path) => {
            let (map, warnings) = load::load_environment(path)?;
            warnings.iter().for_each(|warning| console.warn(warning));
            Sky::Map(Arc::new(map))
        }
    };
    let environment = Environment { sky, rotation_degrees, scale };
    let existing = scene.keys_with::<Environment>();
    if existing.is_empty() {
        scene.spawn((environment,));
    } else {
        for key in existing {
            scene.insert(key, environment.clone());
        }
    }
    Ok(())
}

/// Finds the camera by the name of its node, else by its own, else by its place among the scene's.
fn choose_camera(scene: &mut Scene, in_file: &[CameraInfo], args: &Args, console: &Console) -> Result<(), CliError> {
    let cameras = scene.keys_with::<Camera>();
    let Some(wanted) = &args.camera else {
        if cameras.is_empty() {
            console.note("no camera in the scene: using one that frames it");
        }
        return Ok(());
    };
    let node = |key: &SceneKey| scene.get::<Name>(*key).is_some_and(|name| *name.0 == **wanted);
    let own = |key: &SceneKey| in_file.iter().any(|camera| camera.name == *wanted && camera.keys.contains(key));
    let index = wanted.parse().ok().and_then(|index: usize| cameras.get(index));
    let found = cameras.iter().find(|key| node(key)).or_else(|| cameras.iter().find(|key| own(key))).or(index);
    if found.is_none() {
        let names = camera_names(scene, in_file);
        let list: Vec<_> = names.iter().enumerate().map(|(i, name)| format!("{i} {name:?}")).collect();
        let available = if list.is_empty() { "none in the scene".into() } else { list.join(", ") };
        return Err(CliError::NoCamera { scene: args.scene_file.clone(), wanted: wanted.clone(), available });
    }
    scene.active_camera = found.copied();
    Ok(())
}

/// Names of the scene's cameras in the order of their indices: the node's, else their own.
pub fn camera_names(scene: &Scene, in_file: &[CameraInfo]) -> Vec<String> {
    let own = |key| in_file.iter().find(|camera| camera.keys.contains(&key)).map(|camera| camera.name.clone());
    let name = |key| scene.get::<Name>(key).map(|name| name.0.to_string()).or_else(|| own(key)).unwrap_or_default();
    scene.keys_with::<Camera>().into_iter().map(name).collect()
}

/// 1280 pixels wide in the shape that the camera asks for.
fn default_size(camera: &CameraView) -> [u32; 2] {
    let aspect = camera.aspect.filter(|a| a.is_finite() && *a > 0.0).unwrap_or(DEFAULT_ASPECT);
    let height = (DEFAULT_WIDTH as f32 / aspect).round().clamp(1.0, 65_536.0);
    [DEFAULT_WIDTH, height as u32]
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
    let mut layers = Vec::new();
    for layer in args.layers.iter().map(|&layer| layer.into()) {
        if !layers.contains(&layer) {
            layers.push(layer);
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
        seed: args.seed,
        sampler: args.sampler.into(),
        filter: args.filter.into(),
        caustics: true,
        terminator_fix: !args.no_terminator_fix,
        sharing: if args.no_reuse { Sharing::Off } else { Sharing::WherePays },
        transparent: args.transparent,
        layers,
        wave_size: args.wave_size,
        sort: true,
        tile_size: args.tile_size,
        threads: common.threads.map_or(0, usize::from),
    })
}

/// What decides the pixels, as text for the files.
fn metadata(args: &Args, settings: &RenderSettings, spp: f64) -> Vec<(String, String)> {
    let name = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let mut pairs = vec![
        ("scene".to_owned(), name(&args.scene_file)),
        ("size".into(), format!("{}x{}", settings.width, settings.height)),
        ("spp".into(), spp.to_string()),
        ("seed".into(), settings.seed.to_string()),
        ("sampler".into(), args::value_name(args.sampler)),
        ("filter".into(), args::value_name(args.filter)),
        ("max-depth".into(), settings.max_depth.map_or("none".into(), |depth| depth.to_string())),
        ("terminator-fix".into(), settings.terminator_fix.to_string()),
        ("transparent".into(), settings.transparent.to_string()),
        ("reuse".into(), (settings.sharing != Sharing::Off).to_string()),
    ];
    let mut add = |key: &str, value: Option<String>| pairs.extend(value.map(|value| (key.to_owned(), value)));
    add("scene-name", args.scene.clone());
    add("camera", args.camera.clone());
    add("crop", settings.crop.map(|[x, y, w, h]| format!("{x},{y},{w},{h}")));
    add("error", settings.error.map(|error| error.to_string()));
    add("samples", settings.samples.as_ref().map(|range| format!("{}..{}", range.start, range.end)));
    add(
        "env",
        args.env.as_ref().map(|env| match env {
            EnvArg::Constant([r, g, b]) => format!("{r},{g},{b}"),
            EnvArg::File(path) => name(path),
        }),
    );
    add("env-rotate", args.env_rotate.map(|degrees| degrees.to_string()));
    add("env-scale", args.env_scale.map(|scale| scale.to_string()));
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
    fn a_picture_is_1280_wide_in_the_shape_of_its_camera() {
        let camera = |aspect| CameraView { aspect, ..CameraView::default() };
        assert_eq!(default_size(&camera(None)), [1280, 720]);
        assert_eq!(default_size(&camera(Some(2.0))), [1280, 640]);
        assert_eq!(default_size(&camera(Some(f32::NAN))), [1280, 720]);
        assert_eq!(default_size(&camera(Some(1e9))), [1280, 1]);
    }

    #[test]
    fn a_crop_beyond_the_picture_is_bad_usage() {
        let (args, common) = parse("--size 64x48 --crop 60,0,5,5");
        let error = settings(&args, &common, &CameraView::default()).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        assert!(error.to_string().contains("64 × 48"), "{error}");
    }

    #[test]
    fn cameras_are_found_by_name_then_by_index() {
        let mut scene = Scene::new();
        let spawn = |scene: &mut Scene, name: &str| scene.spawn((Name(name.into()), Camera::perspective(1.0)));
        let keys = [spawn(&mut scene, "left"), spawn(&mut scene, "0"), spawn(&mut scene, "right")];
        let console = Console::new(true, false);
        let in_file = [CameraInfo { name: "wide".into(), keys: vec![keys[2]] }];
        let mut choose = |line: &str| {
            let (args, _) = parse(line);
            choose_camera(&mut scene, &in_file, &args, &console).map(|()| scene.active_camera)
        };
        assert_eq!(choose("").unwrap(), None);
        assert_eq!(choose("--camera right").unwrap(), Some(keys[2]));
        assert_eq!(choose("--camera wide").unwrap(), Some(keys[2]), "the camera's own name");
        assert_eq!(choose("--camera 2").unwrap(), Some(keys[2]));
        assert_eq!(choose("--camera 0").unwrap(), Some(keys[1]), "a name comes before an index");
        let error = choose("--camera top").unwrap_err();
        assert!(error.to_string().contains("0 \"left\", 1 \"0\", 2 \"right\""), "{error}");
        assert_eq!(error.exit_code(), 1);
    }

    #[test]
    fn the_environment_asked_for_replaces_the_scenes_own() {
        let mut scene = Scene::new();
        let own = scene.spawn((Environment::constant(glam::Vec3::ONE),));
        let (args, _) = parse("--env 1,2,3 --env-rotate -90 --env-scale 2");
        let (rotation, scale) = (args.env_rotate.unwrap(), args.env_scale.unwrap());
        let console = &mut Console::new(true, false);
        set_environment(&mut scene, args.env.as_ref().unwrap(), rotation, scale, console).unwrap();
        assert_eq!(scene.keys_with::<Environment>(), [own]);
        let want =
            Environment { sky: Sky::Constant(glam::Vec3::new(1.0, 2.0, 3.0)), rotation_degrees: -90.0, scale: 2.0 };
        assert_eq!(scene.get::<Environment>(own), Some(want));
    }
}
