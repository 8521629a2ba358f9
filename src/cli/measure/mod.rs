//! `wavecast measure`: light meters in a scene.

mod bake;
mod brdf;
mod candela;
mod colours;
mod glare;
mod places;

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
    time::Duration,
};

use image::ImageFormat;
use serde_json::{Value, json};
use wavecast::{
    film,
    glam::DVec3,
    measure::{
        far_field::FarField,
        flux::flux,
        meter::{Effort, Meters, Reading, Readings, read},
    },
    world::{Name, Scene, SceneKey},
};

use self::{
    colours::{Scale, false_colours},
    places::{of_region, on_entity, on_plane},
};
use super::{
    Common, Outcome,
    args::{self, Size},
    console::Console,
    error::CliError,
    interrupt,
    progress::Watcher,
    scene::{Opened, SceneArgs, default_size, light_names},
};

/// Read light meters: illuminance at a point, on a plane or a surface, luminance of what the camera sees, flux of a light
///
/// Every figure comes with the interval that holds the true one with a probability of 95 %. Points and normals are in metres
/// and in the axes of the file, whose up is +Y. Light from a point light, spot or directional light is read as well, but
/// not what comes from these through glass.
#[derive(clap::Args)]
#[command(after_help = "Example:
  wavecast measure scenes/cornell.gltf --lux 0,0,0 0,1,0 --nit 100,100 --lumen light --error 1%")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Illuminance at a point on a plane with this normal, lx
    #[arg(long, num_args = 2, value_names = ["X,Y,Z", "NX,NY,NZ"], value_parser = vector, allow_hyphen_values = true)]
    lux: Vec<DVec3>,
    /// Illuminance on a grid over the parallelogram from a corner along two edges, on the side that U × V points to, lx:
    /// least, mean, greatest, and uniformity
    #[arg(long, num_args = 3, value_names = ["X,Y,Z", "UX,UY,UZ", "VX,VY,VZ"], value_parser = vector,
        allow_hyphen_values = true)]
    lux_plane: Vec<DVec3>,
    /// Points of the grid along U and V [default: as EN 12464-1 spaces them]
    #[arg(long, value_name = "NxM", value_parser = args::size, requires = "lux_plane")]
    grid: Option<Size>,
    /// Illuminance on the front of an entity's surface, lx: least, mean and greatest over points spread evenly over it
    #[arg(long, value_name = "ENTITY")]
    on: Vec<String>,
    /// Texels of a picture over the texture coordinates of --on, each with the illuminance there: in lx (.exr) or false
    /// colours (.png); 1024 samples each, or --spp
    #[arg(long, value_name = "WxH", value_parser = args::size, requires = "on")]
    bake: Option<Size>,
    /// Luminance of a pixel, or of a part of the picture and its mean, nit
    #[arg(long, value_name = "X,Y[,W,H]", value_parser = region)]
    nit: Vec<[u32; 4]>,
    /// Pixels of the picture that --nit counts in [default: 1280 wide, in the camera's shape]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<Size>,
    /// Flux that a light sends off, lm
    #[arg(long, value_name = "ENTITY")]
    lumen: Vec<String>,
    /// Luminous intensity by direction of a luminaire: an entity and what hangs below it, alone in the dark, cd
    #[arg(long, value_name = "ENTITY")]
    candela: Vec<String>,
    /// Degrees from one direction of --candela to the next: of γ, from straight down to straight up, and of C, around
    /// [default: 5,15]
    #[arg(long, value_name = "GAMMA[,C]", value_parser = candela::steps, requires = "candela")]
    step: Option<candela::Steps>,
    /// BRDF of an entity's material, 1/sr, without its textures, beside its formula; ENTITY:SLOT for one of several
    #[arg(long, value_name = "ENTITY[:SLOT]")]
    brdf: Vec<String>,
    /// Glare of lamps at the camera, as Unified Glare Rating (CIE 117)
    #[arg(long)]
    glare: bool,
    /// Read until the 95 % interval is at most this share of the reading to either side [default: 1%, or none with --spp]
    #[arg(long, value_name = "ERROR", value_parser = args::error)]
    error: Option<f64>,
    /// Stop after N samples of a meter
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    spp: Option<u64>,
    /// Stop after a time for each meter, such as 30s or 5m
    #[arg(long, value_name = "TIME", value_parser = args::duration)]
    time: Option<Duration>,
    /// Most scatterings behind the light that is read: 0 is straight from the lamps [default: no limit]
    #[arg(long, value_name = "N")]
    max_depth: Option<u32>,
    /// Chooses the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// The last grid or part of the picture in false colours with a legend (.png), or as a table (.csv); the last
    /// baked surface (.exr, .png); the last
    /// luminaire for lighting programs (.ies); that or the last BRDF as a diagram (.svg) or as a table (.csv); may be
    /// given several times
    #[arg(short, long = "output", value_name = "OUT")]
    output: Vec<PathBuf>,
}

/// Samples of a meter if nothing says when to stop but a number of samples cannot reach the error.
const DEFAULT_ERROR: f64 = 0.01;
/// Coordinates that are read, m.
const FARTHEST: f64 = 1e12;

/// Such as `0,0.8,-1`, m.
fn vector(text: &str) -> Result<DVec3, String> {
    let parts: Vec<f64> = text.split(',').filter_map(|part| part.trim().parse().ok()).collect();
    match parts[..] {
        [x, y, z] if parts.iter().all(|c| c.abs() <= FARTHEST) && text.split(',').count() == 3 => {
            Ok(DVec3::new(x, y, z))
        }
        _ => Err("expected X,Y,Z, such as 0,0.8,-1".into()),
    }
}

/// `X,Y` or `X,Y,W,H`.
fn region(text: &str) -> Result<[u32; 4], String> {
    let parts: Result<Vec<u32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match parts.ok().as_deref() {
        Some(&[x, y]) => Ok([x, y, 1, 1]),
        Some(&[x, y, w, h]) if w > 0 && h > 0 => Ok([x, y, w, h]),
        _ => Err("expected X,Y or X,Y,WIDTH,HEIGHT in pixels, such as 160,90".into()),
    }
}

/// One line of the answer, or several that belong together.
struct Answer {
    /// What was read, as the option that asked for it.
    kind: &'static str,
    /// Where.
    at: String,
    unit: &'static str,
    /// The mean, where there are several.
    mean: Reading,
    /// Least and greatest, and where.
    extremes: Option<[(f64, String); 2]>,
    samples: u64,
    seconds: f64,
    reached: bool,
    /// Contributions that were not finite.
    discarded: u64,
    /// Points along two directions, and their readings.
    grid: Option<([u32; 2], Vec<Reading>)>,
    /// The same as directions.
    field: Option<FarField>,
    /// The same by texels.
    baked: Option<bake::Baked>,
}

impl Answer {
    fn new(kind: &'static str, at: String, unit: &'static str, readings: Readings) -> Self {
        let Readings { each, mean, samples, seconds, reached, discarded } = readings;
        Self {
            kind,
            at,
            unit,
            mean,
            extremes: None,
            samples,
            seconds,
            reached,
            discarded,
            grid: Some(([each.len() as u32, 1], each)),
            field: None,
            baked: None,
        }
    }

    /// With what is least and greatest among its points, which `name` tells.
    fn over(mut self, size: [u32; 2], name: impl Fn(usize) -> String) -> Self {
        if let Some((shape, each)) = &mut self.grid {
            *shape = size;
            let by = |a: &usize, b: &usize| each[*a].value.value.total_cmp(&each[*b].value.value);
            let least = (0..each.len()).min_by(by);
            let most = (0..each.len()).max_by(by);
            if let (Some(least), Some(most)) = (least, most) {
                self.extremes = Some([least, most].map(|at| (each[at].value.value, name(at))));
            }
        }
        self
    }
}

/// Reads as told.
pub fn run(args: &Args, common: &Common, console: &mut Console) -> Result<Outcome, CliError> {
    check(args)?;
    let Opened { scene, renderer, .. } = args.scene.open(console)?;
    let flat = renderer.scene();
    let size = args.size.map_or_else(|| default_size(&flat.camera), |size| size.0);
    let error = args.error.or((args.spp.is_none()).then_some(DEFAULT_ERROR));
    let threads = common.threads.map_or(0, usize::from);
    let effort =
        Effort { error, samples: args.spp, time: args.time, seed: args.seed, threads, max_depth: args.max_depth };
    interrupt::keep_from_now_on();
    let watcher = Watcher::new(console.is_quiet());
    let mut answers: Vec<Answer> = Vec::new();
    for pair in args.lux.chunks_exact(2) {
        let readings = read(flat, &Meters::Planes(vec![(pair[0], pair[1])]), &effort, &watcher);
        answers.push(Answer::new("lux", format!("{} facing {}", text_of(pair[0]), text_of(pair[1])), "lx", readings));
    }
    for plane in args.lux_plane.chunks_exact(3) {
        answers.push(on_plane(flat, [plane[0], plane[1], plane[2]], args.grid, &effort, &watcher)?);
    }
    for name in &args.on {
        answers.push(on_entity(&scene, flat, args, name, &effort, &watcher)?);
    }
    for &part in &args.nit {
        answers.push(of_region(&renderer, part, size, &effort, &watcher)?);
    }
    for name in &args.candela {
        let key = node(&scene, args, name)?;
        answers.push(candela::read(args, name, key, &effort, &watcher)?);
    }
    let mut brdfs = Vec::new();
    for name in &args.brdf {
        brdfs.push(brdf::read(args, &scene, name, &effort, &watcher)?);
    }
    let rated = args.glare.then(|| glare::read(&scene, &renderer, &effort, &watcher));
    watcher.finish();
    for name in &args.lumen {
        let key = entity(&scene, args, name)?;
        let mean = flux(flat, key.0).ok_or_else(|| CliError::NoLight {
            scene: args.scene.file.clone(),
            wanted: name.clone(),
            available: light_names(&scene, flat),
        })?;
        let at = name.clone();
        let (unit, kind) = ("lm", "lumen");
        answers.push(Answer {
            kind,
            at,
            unit,
            mean,
            extremes: None,
            samples: 0,
            seconds: 0.0,
            reached: true,
            discarded: 0,
            grid: None,
            field: None,
            baked: None,
        });
    }
    for path in &args.output {
        match (extension(path).as_str(), brdfs.last()) {
            ("svg", Some(brdf)) => brdf.plot(path)?,
            ("csv", Some(brdf)) if answers.iter().all(|answer| answer.extremes.is_none()) => brdf.write_table(path)?,
            _ => write(path, args, &answers)?,
        }
    }
    for answer in answers.iter().filter(|answer| answer.discarded > 0) {
        console.warn(format_args!("{} {}: {} samples were left out", answer.kind, answer.at, answer.discarded));
    }
    for answer in answers.iter().filter(|answer| !answer.reached) {
        console.warn(format_args!("{} {}: stopped before the error that was asked for", answer.kind, answer.at));
    }
    let baked = answers.iter().filter_map(|answer| answer.baked.as_ref());
    baked.flat_map(|baked| baked.warnings()).for_each(|warning| console.warn(warning));
    brdfs.iter().filter_map(|brdf| brdf.warning()).for_each(|warning| console.warn(warning));
    rated.iter().flat_map(|rated| rated.warnings()).for_each(|warning| console.warn(warning));
    let mut words = brdfs.iter().fold(text(&answers), |text, brdf| text + &brdf.text());
    rated.iter().for_each(|rated| words.push_str(&rated.text()));
    let more = || brdfs.iter().map(|brdf| brdf.json()).chain(rated.iter().map(|rated| rated.json()));
    let all = || answers.iter().map(as_json).chain(more()).collect::<Vec<_>>();
    console.result(&words, || json!({ "meters": all() }));
    Ok(if interrupt::asked() { Outcome::Interrupted } else { Outcome::Done })
}

fn check(args: &Args) -> Result<(), CliError> {
    let Args { lux, lux_plane, on, nit, lumen, candela, brdf, .. } = args;
    let none = lux.is_empty() && lux_plane.is_empty() && on.is_empty() && nit.is_empty();
    if none && lumen.is_empty() && candela.is_empty() && brdf.is_empty() && !args.glare {
        return Err(CliError::Usage(
            "nothing to read: give --lux, --lux-plane, --on, --nit, --lumen, --candela, --brdf or --glare".into(),
        ));
    }
    let of = |wanted: &str| args.output.iter().any(|path| extension(path) == wanted);
    if of("svg") && !candela.is_empty() && !brdf.is_empty() {
        return Err(CliError::Usage("an .svg is of --candela or of --brdf; give one of the two at a time".into()));
    }
    if let Some(pair) = lux.chunks_exact(2).find(|pair| pair[1].length() == 0.0) {
        return Err(CliError::Usage(format!("--lux {}: the normal has no length", text_of(pair[0]))));
    }
    if let Some(plane) = lux_plane.chunks_exact(3).find(|plane| plane[1].cross(plane[2]).length() == 0.0) {
        return Err(CliError::Usage(format!("--lux-plane {}: its edges span no plane", text_of(plane[0]))));
    }
    for path in &args.output {
        let extension = extension(path);
        if !["png", "csv", "ies", "svg", "exr"].contains(&extension.as_str()) {
            return Err(CliError::Usage(format!(
                "{}: readings are written as .png or .csv, luminaires as .ies, .svg or .csv",
                path.display()
            )));
        }
        let has_grid = !(lux_plane.is_empty() && nit.is_empty() && on.is_empty());
        match extension.as_str() {
            "ies" if candela.is_empty() => {
                return Err(CliError::Usage(format!("{}: nothing to write; that is for --candela", path.display())));
            }
            "exr" if args.bake.is_none() => {
                return Err(CliError::Usage(format!("{}: nothing to write; that is for --bake", path.display())));
            }
            "svg" if candela.is_empty() && brdf.is_empty() => {
                return Err(CliError::Usage(format!(
                    "{}: nothing to write; that is for --candela and --brdf",
                    path.display()
                )));
            }
            "png" | "csv" if !has_grid && (extension == "png" || candela.is_empty() && brdf.is_empty()) => {
                return Err(CliError::Usage(format!(
                    "{}: nothing to write; only --lux-plane, --on and --nit have a grid",
                    path.display()
                )));
            }
            _ => {}
        }
        film::check_writable(path)?;
    }
    Ok(())
}

fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase()
}

/// The entity that is called so, or has that key, whatever it is.
fn node(scene: &Scene, args: &Args, name: &str) -> Result<SceneKey, CliError> {
    // One with light or surface goes before its parents of the same name.
    let by_name =
        || scene.find(name).or_else(|| name.parse().ok().map(SceneKey).filter(|&k| scene.entity(k).is_some()));
    entity(scene, args, name).or_else(|error| by_name().ok_or(error))
}

/// The entity that is called so, or has that key, and has a light or a surface.
fn entity(scene: &Scene, args: &Args, name: &str) -> Result<SceneKey, CliError> {
    let with_light_or_surface = |key: &SceneKey| {
        scene.get::<wavecast::world::Geometry>(*key).is_some()
            || scene.get::<wavecast::world::Shape>(*key).is_some()
            || scene.get::<wavecast::world::PointLight>(*key).is_some()
            || scene.get::<wavecast::world::SpotLight>(*key).is_some()
            || scene.get::<wavecast::world::DirectionalLight>(*key).is_some()
    };
    let named = scene.keys_with::<Name>().into_iter();
    let found = named.filter(|key| scene.get::<Name>(*key).is_some_and(|n| *n.0 == *name)).find(with_light_or_surface);
    let by_key =
        || name.parse().ok().map(SceneKey).filter(|key| scene.entity(*key).is_some() && with_light_or_surface(key));
    found.or_else(by_key).ok_or_else(|| {
        let names = scene.keys_with::<Name>().into_iter().filter(with_light_or_surface);
        let names = names.filter_map(|key| scene.get::<Name>(key)).map(|name| format!("{:?}", name.0)).take(20);
        let list = names.collect::<Vec<_>>().join(", ");
        let available = if list.is_empty() { "none with a name".into() } else { list };
        CliError::NoEntity { scene: args.scene.file.clone(), wanted: name.into(), available }
    })
}

fn text_of(v: DVec3) -> String {
    let number = |x: f64| {
        let text = format!("{x:.4}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    };
    format!("{},{},{}", number(v.x), number(v.y), number(v.z))
}

fn text(answers: &[Answer]) -> String {
    let mut text = String::new();
    for answer in answers {
        let Answer { kind, at, unit, mean, extremes, samples, seconds, grid, .. } = answer;
        let [from, to] = mean.value.interval(0.95);
        let several = if extremes.is_some() { "mean " } else { "" };
        let about = match samples {
            0 => String::new(),
            _ => format!("   {samples} samples, {seconds:.2} s"),
        };
        writeln!(text, "{kind} {at}\n  {several}{:.6} {unit}   95 %: {from:.6} .. {to:.6}{about}", mean.value.value)
            .expect("a string takes it");
        if let Some([(least, least_at), (most, most_at)]) = extremes {
            let count = grid.as_ref().map_or(0, |(_, each)| each.len());
            writeln!(
                text,
                "  min  {least:.6} {unit} at {least_at}\n  max  {most:.6} {unit} at {most_at}   ({count} points)"
            )
            .expect("a string takes it");
            let uniformity = least / mean.value.value;
            if *unit == "lx" && mean.value.value > 0.0 {
                writeln!(text, "  uniformity min/mean {uniformity:.4}, min/max {:.4}", least / most)
                    .expect("a string takes it");
            }
        }
        if let Some(field) = &answer.field {
            text.push_str(&candela::text(field));
        }
        if let Some(bake::Baked { covered, error, samples, seconds, .. }) = &answer.baked {
            let share = 100.0 * error;
            writeln!(
                text,
                "  baked: {covered} texels, {samples} samples each, ± {share:.2} % of the mean, {seconds:.2} s"
            )
            .expect("a string takes it");
        }
    }
    text
}

fn reading_json(reading: &Reading) -> Value {
    let interval = reading.value.interval(0.95);
    json!({ "value": reading.value.value, "interval": interval, "rgb": reading.rgb.map(|channel| channel.value) })
}

fn as_json(answer: &Answer) -> Value {
    let Answer { kind, at, unit, mean, extremes, samples, seconds, reached, grid, .. } = answer;
    let mut value = json!({
        "kind": kind,
        "at": at,
        "unit": unit,
        "value": mean.value.value,
        "interval": mean.value.interval(0.95),
        "rgb": mean.rgb.map(|channel| channel.value),
        "samples": samples,
        "seconds": seconds,
        "reached": reached,
    });
    if let (Some([least, most]), Some((size, each))) = (extremes, grid) {
        value["min"] = json!({ "value": least.0, "at": least.1 });
        value["max"] = json!({ "value": most.0, "at": most.1 });
        if *unit == "lx" {
            value["uniformity"] = json!(least.0 / mean.value.value);
        }
        value["grid"] = json!(size);
        value["points"] = each.iter().map(reading_json).collect();
    }
    if let Some(field) = &answer.field {
        candela::json(field, &mut value);
    }
    if let Some(bake::Baked { covered, error, samples, seconds, .. }) = &answer.baked {
        value["baked"] = json!({ "texels": covered, "samples": samples, "error": error, "seconds": seconds });
    }
    value
}

/// The last grid as a table or as a picture.
fn write(path: &Path, args: &Args, answers: &[Answer]) -> Result<(), CliError> {
    let fields = |answer: &'_ Answer| answer.field.is_some();
    let luminaire = answers.iter().rev().find(|answer| fields(answer));
    if let Some((answer, field)) = luminaire.and_then(|answer| Some((answer, answer.field.as_ref()?))) {
        match extension(path).as_str() {
            "ies" => return candela::write_ies(path, &args.scene.file, &answer.at, field),
            "svg" => return candela::plot(path, &answer.at, field),
            "csv" if answers.iter().all(|answer| fields(answer) || answer.extremes.is_none()) => {
                let table = candela::table(field);
                return Ok(film::write_file(path, |file| {
                    use std::io::Write;
                    file.write_all(table.as_bytes())
                })?);
            }
            _ => {}
        }
    }
    let baked = answers.iter().rev().find_map(|answer| Some((answer, answer.baked.as_ref()?)));
    if let Some((answer, baked)) = baked.filter(|_| ["exr", "png"].contains(&extension(path).as_str())) {
        return baked.write(path, &answer.at);
    }
    let with_grid = |answer: &&Answer| answer.extremes.is_some() && answer.field.is_none();
    let Some((answer, (size, each))) =
        answers.iter().rev().find(with_grid).and_then(|answer| Some((answer, answer.grid.as_ref()?)))
    else {
        return Err(CliError::Usage(format!("{}: there is no grid of readings to write", path.display())));
    };
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv")) {
        let mut table = format!("column,row,{},from,to\n", answer.unit);
        for (i, reading) in each.iter().enumerate() {
            let (x, y, [from, to]) = (i as u32 % size[0], i as u32 / size[0], reading.value.interval(0.95));
            writeln!(table, "{x},{y},{},{from},{to}", reading.value.value).expect("a string takes it");
        }
        return Ok(film::write_file(path, |file| {
            use std::io::Write;
            file.write_all(table.as_bytes())
        })?);
    }
    let values: Vec<f64> = each.iter().map(|reading| reading.value.value).collect();
    let scale = if answer.unit == "nit" { Scale::log(&values) } else { Scale::linear(&values) };
    let picture = false_colours(*size, &values, answer.unit, scale);
    Ok(film::write_file(path, |file| picture.write_to(file, ImageFormat::Png).map_err(std::io::Error::other))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_and_parts_are_read_as_the_help_writes_them() {
        assert_eq!(vector("0, 0.8,-1"), Ok(DVec3::new(0.0, 0.8, -1.0)));
        for bad in ["", "1,2", "1,2,3,4", "1,2,x", "1,2,inf"] {
            assert!(vector(bad).is_err(), "{bad}");
        }
        assert_eq!([region("3,4"), region("3,4,5,6")], [Ok([3, 4, 1, 1]), Ok([3, 4, 5, 6])]);
        assert!(region("3,4,0,6").is_err());
    }
}
