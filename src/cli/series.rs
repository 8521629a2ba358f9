//! `wavecast series`: the light of a picture, bounce by bounce.

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
    time::Duration,
};

use image::ImageFormat;
use plotters::prelude::*;
use serde_json::{Value, json};
use wavecast::{
    film::{self, LayerData, Picture, Split, WriteOptions},
    measure::student::Estimate,
    render::{LayerKind, PartMean, RenderSettings, Rendered, Renderer},
};

use super::{
    Common, Outcome,
    args::{self, DisplayArgs, Size},
    console::Console,
    error::CliError,
    interrupt,
    label::{Canvas, LINE},
    memory,
    plot::{COLORS, decades, draw},
    progress::Watcher,
    scene::{Opened, SceneArgs, default_size},
    stats,
};

/// Bounces of indirect light after which there is a panel.
const BOUNCES: [usize; 5] = [1, 2, 4, 8, 16];
/// Width of a panel of which only the shape is known.
const PANEL_WIDTH: u32 = 320;
/// Samples per pixel where nothing says when to stop.
const DEFAULT_SPP: u32 = 256;
/// Samples that a marked point gets, at least and by those of the picture.
const POINT_SPP: [u32; 2] = [4096, 16];
/// Between panels, pixels.
const GAP: u32 = 4;

const PAPER: [u8; 3] = [255; 3];
const INK: [u8; 3] = [20; 3];
const MARK: [u8; 3] = [255, 220, 0];

/// Show the light bounce by bounce: E, direct = E + KE, and what 1, 2, 4, 8 and 16 bounces of indirect light add
#[derive(clap::Args)]
#[command(after_help = "Example:
  wavecast series scenes/cornell.gltf -o series.png --point 160,200 --plot energy.svg")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// The strip of pictures, .png
    #[arg(short, long = "output", value_name = "STRIP.png", required = true)]
    output: PathBuf,
    /// Pixels of one picture [default: 320 wide, in the camera's shape]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<Size>,
    /// Stop after N samples per pixel [default: 256, or none with --time or --error]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    spp: Option<u32>,
    /// Stop after a time, such as 30s or 5m
    #[arg(long, value_name = "TIME", value_parser = args::duration)]
    time: Option<Duration>,
    /// Stop when the square root of the picture's relMSE is at most this with a probability of 95 %
    #[arg(long, value_name = "ERROR", value_parser = args::error)]
    error: Option<f64>,
    /// Mark a pixel and say how much light of each number of bounces arrives there; may be given several times
    #[arg(long, value_name = "X,Y", value_parser = pixel)]
    point: Vec<[u32; 2]>,
    /// Energy by bounce as a plot, .svg
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Chooses the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    display: DisplayArgs,
}

fn pixel(text: &str) -> Result<[u32; 2], String> {
    let parse = || {
        let (x, y) = text.split_once(',')?;
        Some([x.trim().parse().ok()?, y.trim().parse().ok()?])
    };
    parse().ok_or_else(|| "expected X,Y in pixels from the upper left corner, such as 160,90".into())
}

/// Renders as told.
pub fn run(args: &Args, common: &Common, console: &mut Console) -> Result<Outcome, CliError> {
    if args.output.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("png")) {
        return Err(CliError::Usage(format!("{}: the strip is a .png", args.output.display())));
    }
    for path in [Some(&args.output), args.plot.as_ref()].into_iter().flatten() {
        film::check_writable(path)?;
    }
    let Opened { renderer, .. } = args.scene.open(console)?;
    let [width, height] = args.size.map_or_else(|| panel_size(&renderer), |size| size.0);
    if let Some([x, y]) = args.point.iter().find(|[x, y]| *x >= width || *y >= height) {
        return Err(CliError::Usage(format!("--point {x},{y} is outside of the picture of {width} × {height} pixels")));
    }
    let says_when = args.time.is_some() || args.error.is_some();
    let settings = RenderSettings {
        width,
        height,
        spp: args.spp.or((!says_when).then_some(DEFAULT_SPP)),
        time: args.time,
        error: args.error,
        seed: args.seed,
        layers: vec![LayerKind::Light(Split::Bounces)],
        threads: common.threads.map_or(0, usize::from),
        ..RenderSettings::default()
    };
    memory::check_parts(&renderer, &settings)?;
    interrupt::keep_from_now_on();
    let watcher = Watcher::new(console.is_quiet());
    let rendered = renderer.render(&settings, &watcher);
    let marked: Vec<Rendered> = args.point.iter().map(|&point| at_point(&renderer, &settings, point)).collect();
    watcher.finish();

    let panels = panels(&rendered.picture);
    let shown = strip(&rendered, &panels, &args.point, &args.display.options(film::Exposure::Auto));
    film::write_file(&args.output, |file| shown.write_to(file, ImageFormat::Png).map_err(std::io::Error::other))?;
    if let Some(path) = &args.plot {
        energy(path, &args.scene.file.display().to_string(), &rendered.stats.parts)?;
    }
    console.result(&text(args, &rendered, &marked), || result(args, &rendered, &marked));
    Ok(if rendered.stats.cancelled { Outcome::Interrupted } else { Outcome::Done })
}

fn panel_size(renderer: &Renderer) -> [u32; 2] {
    let [width, height] = default_size(&renderer.scene().camera);
    [PANEL_WIDTH, (height * PANEL_WIDTH / width).max(1)]
}

/// The terms at one pixel, from many more samples.
fn at_point(renderer: &Renderer, settings: &RenderSettings, [x, y]: [u32; 2]) -> Rendered {
    let [least, times] = POINT_SPP;
    let spp = settings.spp.map_or(least, |spp| spp.saturating_mul(times).max(least));
    let settings =
        RenderSettings { crop: Some([x, y, 1, 1]), spp: Some(spp), time: None, error: None, ..settings.clone() };
    renderer.render(&settings, &())
}

/// A picture of the light so far.
struct Panel {
    title: String,
    terms: String,
    rgb: Vec<[f32; 3]>,
    mean: f64,
}

/// Scatterings of the light in each panel at most, with its title.
fn cuts() -> impl Iterator<Item = (usize, String)> {
    let bounces = |&n: &usize| (n + 1, format!("{n} bounce{}", if n == 1 { "" } else { "s" }));
    [(0, "emission".to_owned()), (1, "direct light".to_owned())].into_iter().chain(BOUNCES.iter().map(bounces))
}

/// E + KE + … as text, in Latin-1 where there is a sign for the power.
fn sum_of_terms(last: usize) -> String {
    let power = |n: usize| match n {
        0 => "E".to_owned(),
        1 => "KE".into(),
        2 => "K²E".into(),
        3 => "K³E".into(),
        _ => format!("K^{n} E"),
    };
    match last {
        0..=2 => (0..=last).map(power).collect::<Vec<_>>().join(" + "),
        _ => format!("E + KE + ... + {}", power(last)),
    }
}

fn panels(picture: &Picture) -> Vec<Panel> {
    let term = |n: usize| {
        let name = format!("bounce{n:02}");
        picture.layers.iter().find(|layer| layer.name == name).and_then(|layer| match &layer.data {
            LayerData::Rgb(values) => Some(values),
            _ => None,
        })
    };
    let mut sums = vec![[0.0_f64; 3]; picture.rgb.len()];
    let mut next = 0;
    let panel = |(last, title): (usize, String)| {
        while next <= last {
            for (sum, light) in sums.iter_mut().zip(term(next).into_iter().flatten()) {
                (0..3).for_each(|c| sum[c] += f64::from(light[c]));
            }
            next += 1;
        }
        let mean = sums.iter().map(|&rgb| film::luminance(rgb)).sum::<f64>() / sums.len() as f64;
        let rgb = sums.iter().map(|sum| sum.map(|c| c as f32)).collect();
        Panel { title, terms: sum_of_terms(last), rgb, mean }
    };
    cuts().map(panel).collect()
}

/// All panels side by side, exposed alike.
fn strip(rendered: &Rendered, panels: &[Panel], points: &[[u32; 2]], options: &WriteOptions) -> image::RgbImage {
    let picture = &rendered.picture;
    let (width, height) = (picture.width as u32, picture.height as u32);
    let factor = options.exposure.factor(picture);
    let words = |panel: &Panel| [panel.title.clone(), panel.terms.clone(), format!("{:.4} nit", panel.mean)];
    let wide = panels.iter().flat_map(words).map(|line| Canvas::width_of(&line) + 2 * GAP).max().unwrap_or(0);
    let column = width.max(wide) + GAP;
    let mut canvas = Canvas::new([column * panels.len() as u32 + GAP, height + 3 * LINE + 3 * GAP], PAPER);
    for (i, panel) in panels.iter().enumerate() {
        let left = GAP + i as u32 * column;
        let byte = |light: f32| (light * 255.0).round() as u8;
        let pixels: Vec<[u8; 3]> =
            panel.rgb.iter().map(|rgb| options.tone_map.encode(rgb.map(|c| c * factor)).map(byte)).collect();
        canvas.paste([left, GAP], width, &pixels);
        for point in points {
            canvas.mark([(left + point[0]) as i32, (GAP + point[1]) as i32], MARK);
        }
        for (line, text) in (0..).zip(words(panel)) {
            canvas.write([left, height + 2 * GAP + line * LINE], &text, INK);
        }
    }
    canvas.into_image()
}

/// The mean luminance of each term with its interval, on a logarithmic scale.
fn energy(path: &Path, scene: &str, parts: &[PartMean]) -> Result<(), CliError> {
    let terms: Vec<(f64, Estimate)> = parts
        .iter()
        .filter(|part| !part.layer.ends_with("-on"))
        .enumerate()
        .map(|(n, part)| (n as f64, part.luminance))
        .filter(|(_, term)| term.value > 0.0)
        .collect();
    let range = terms.iter().fold((f64::MAX, 0.0), |(a, b): (f64, f64), (_, y)| (a.min(y.value), b.max(y.value)));
    if terms.is_empty() {
        return Ok(());
    }
    draw(path, (720, 420), |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(format!("Mean luminance by bounce: {scene}"), ("sans-serif", 16))
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(64)
            .build_cartesian_2d(-0.5..terms.len() as f64 - 0.5, decades(range.0, range.1).log_scale())?;
        let whole = |x: &f64| if x.fract() == 0.0 { format!("{x}") } else { String::new() };
        let power = |y: &f64| if (1e-3..1e4).contains(y) { format!("{y}") } else { format!("{y:e}") };
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(TRANSPARENT).x_labels(terms.len()).x_label_formatter(&whole);
        mesh.y_label_formatter(&power).x_desc("scatterings n of the term Kⁿ E").y_desc("nit").draw()?;
        let (line, dot) = (COLORS[1], COLORS[0]);
        chart.draw_series(LineSeries::new(terms.iter().map(|(n, y)| (*n, y.value)), line.stroke_width(2)))?;
        for (n, term) in &terms {
            let [from, to] = term.interval(0.95).map(|y| y.max(range.0 / 10.0));
            chart.draw_series([PathElement::new([(*n, from), (*n, to)], dot.stroke_width(2))])?;
            chart.draw_series([Circle::new((*n, term.value), 3, dot.filled())])?;
        }
        Ok(())
    })
}

/// A term with what it is called.
fn rows(parts: &[PartMean]) -> impl Iterator<Item = (String, &PartMean)> {
    parts.iter().map(|part| {
        let name = match part.layer.strip_prefix("bounce").unwrap_or(&part.layer) {
            "00" => "E".to_owned(),
            "01" => "KE".into(),
            n => match n.strip_suffix("-on") {
                Some(n) => format!("K^{n} E and on"),
                None => format!("K^{} E", n.trim_start_matches('0')),
            },
        };
        (name, part)
    })
}

fn table(heading: &str, parts: &[PartMean]) -> String {
    let total: f64 = parts.iter().map(|part| part.luminance.value).sum();
    let mut text = format!("{heading}\n{:<14} {:>12} {:>25} {:>9}\n", "", "nit", "95 % interval", "so far");
    let mut sum = 0.0;
    for (name, part) in rows(parts) {
        let [from, to] = part.luminance.interval(0.95);
        sum += part.luminance.value;
        let share = 100.0 * sum / total.max(f64::MIN_POSITIVE);
        let interval = format!("{from:.4e} .. {to:.4e}");
        writeln!(text, "{name:<14} {:>12.4e} {interval:>25} {share:>8.3}%", part.luminance.value)
            .expect("a string takes it");
    }
    writeln!(text, "{:<14} {total:>12.4e}", "all").expect("a string takes it");
    text
}

fn text(args: &Args, rendered: &Rendered, marked: &[Rendered]) -> String {
    let stats = &rendered.stats;
    let mut text =
        format!("{}: {:.1} samples per pixel in {:.2} s\n\n", args.output.display(), stats.spp, stats.seconds);
    text.push_str(&table("Luminance by bounce, mean over the picture", &stats.parts));
    for ([x, y], point) in args.point.iter().zip(marked) {
        let heading = format!("Luminance by bounce at pixel {x},{y}: {:.0} samples", point.stats.spp);
        write!(text, "\n{}", table(&heading, &point.stats.parts)).expect("a string takes it");
    }
    text
}

fn result(args: &Args, rendered: &Rendered, marked: &[Rendered]) -> Value {
    let point = |([x, y], point): (&[u32; 2], &Rendered)| json!({ "pixel": [x, y], "spp": point.stats.spp, "light": stats::light(&point.stats.parts) });
    json!({
        "output": args.output.display().to_string(),
        "size": [rendered.picture.width, rendered.picture.height],
        "spp": rendered.stats.spp,
        "seconds": rendered.stats.seconds,
        "light": stats::light(&rendered.stats.parts),
        "points": args.point.iter().zip(marked).map(point).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_written_as_the_field_writes_them() {
        let sums: Vec<String> = cuts().map(|(last, _)| sum_of_terms(last)).collect();
        assert_eq!(sums[..4], ["E", "E + KE", "E + KE + K²E", "E + KE + ... + K³E"]);
        assert_eq!(sums[6], "E + KE + ... + K^17 E");
        assert_eq!(pixel("3, 4"), Ok([3, 4]));
        assert!(pixel("3").is_err() && pixel("-1,2").is_err());
    }
}
