//! `bench error --explain`: what Monte Carlo integration does with a scene. How much estimates vary by the way in which lights are
//! found, how error falls with the number of samples, and how estimates of one pixel spread, with their intervals.

use std::{fmt::Write as _, fs, path::Path};

use image::ImageFormat;
use plotters::prelude::*;
use serde_json::{Value, json};
use wavecast::{
    film::{self, Exposure, LayerData, Picture, WriteOptions, luminance},
    flat::FlatScene,
    glam::DVec3,
    measure::student::{Estimate, student_factor},
    reference::{self, ReferencePicture, ReferenceSettings, Technique},
    render::{LayerKind, PixelFilter, RenderSettings, Renderer, SamplerKind, Sharing},
    wavefront::{Aim, render_aimed},
    world::{Name, Scene, SceneKey},
};

use super::super::{
    Args,
    plot::{COLORS, decades, draw},
    subject::{Source, Subject},
};
use crate::cli::{
    Outcome,
    args::Size,
    console::Console,
    error::CliError,
    label::{Canvas, LINE},
};

/// Pixels, and samples of each with each technique, where nothing is said.
const SIZE: [u32; 2] = [120, 80];
const SPP: u32 = 256;
/// Pictures by technique are so many times as wide, to be looked at.
const WIDER: u32 = 2;
/// Samples of each pixel in the plot of error, and pictures of each.
const RISING: [u32; 9] = [1, 2, 4, 8, 16, 32, 64, 128, 256];
const SEEDS: u64 = 3;
/// So many times the most of these has what they are compared with.
const CONVERGED: u32 = 16;
/// Estimates of a pixel, by rows, and samples of each.
const ESTIMATES: [u32; 2] = [64, 64];
const EACH: u32 = 16;
/// Bars of the histogram.
const BARS: usize = 48;

const TECHNIQUES: [(Technique, &str); 3] = [
    (Technique::Lights, "light sampling"),
    (Technique::Bsdf, "BSDF sampling"),
    (Technique::Both, "both, weighted (MIS)"),
];

/// A picture by each technique, with what each is worth.
struct Techniques {
    pictures: Vec<ReferencePicture>,
    /// What the camera sees, pixels that show it, and the variance of a sample by technique, nit².
    rows: Vec<(String, usize, [f64; 3])>,
}

/// Errors by number of samples.
struct Slope {
    name: &'static str,
    points: Vec<(u32, f64)>,
    /// Of the logarithm of the error over that of the number, with its standard error.
    slope: Estimate,
}

/// Estimates of a pixel.
struct Spread {
    pixel: [u32; 2],
    values: Vec<f64>,
    truth: Estimate,
    /// Share of the estimates whose 95 % interval holds the truth.
    coverage: f64,
    /// Half of that interval, of the first estimate.
    half: f64,
}

/// Explains each scene.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    if args.scenes.is_empty() {
        return Err(CliError::Usage("bench error --explain needs a SCENE".into()));
    }
    let mut all = Vec::new();
    let mut words = String::new();
    for source in &args.scenes {
        let (text, value) = explain(source, args, console)?;
        words += &text;
        all.push(value);
    }
    console.result(&words, || json!({ "explained": all }));
    Ok(Outcome::Done)
}

fn explain(source: &Source, args: &Args, console: &mut Console) -> Result<(String, Value), CliError> {
    let (scene, renderer) = args.open(source, console)?;
    let size = args.size.map_or(SIZE, |Size(size)| size);
    let name = source.to_string();
    console.note(format!("{name}: variance by technique"));
    let shown = size.map(|length| length * WIDER);
    let techniques = by_technique(&scene, &renderer, shown, args.spp.unwrap_or(SPP));
    console.note(format!("{name}: error by number of samples"));
    let slopes = slopes(&renderer, size);
    console.note(format!("{name}: estimates of a pixel"));
    let spread = spread(renderer.scene(), &techniques.pictures[2], shown);
    let text = markdown(&name, &techniques, &slopes, &spread);
    if let Some(folder) = &args.output {
        fs::create_dir_all(folder).map_err(|source| CliError::Output { path: folder.clone(), source })?;
        let file = |kind: &str, extension: &str| {
            folder.join(format!("explain-{}{kind}.{extension}", Subject::file_name(&name)))
        };
        let strip = strip(&techniques);
        film::write_file(&file("-techniques", "png"), |file| {
            strip.write_to(file, ImageFormat::Png).map_err(std::io::Error::other)
        })?;
        plot_slopes(&file("-slopes", "svg"), &name, &slopes)?;
        plot_spread(&file("-pixel", "svg"), &name, &spread)?;
        let path = file("", "md");
        fs::write(&path, &text).map_err(|source| CliError::Output { path, source })?;
    }
    Ok((text, json_of(&name, &techniques, &slopes, &spread)))
}

/// The plain estimators of textbooks: one path after another, in f64, by independent numbers.
fn by_technique(scene: &Scene, renderer: &Renderer, [width, height]: [u32; 2], spp: u32) -> Techniques {
    let flat = renderer.scene();
    let picture = |(technique, _): (Technique, &str)| {
        let settings = ReferenceSettings {
            width,
            height,
            spp,
            technique,
            filter: PixelFilter::Box,
            ..ReferenceSettings::default()
        };
        reference::render(flat, &settings)
    };
    let pictures: Vec<ReferencePicture> = TECHNIQUES.into_iter().map(picture).collect();
    let seen = seen(renderer, [width, height]);
    let mut rows: Vec<(String, usize, [f64; 3])> = Vec::new();
    for (pixel, &row) in seen.iter().enumerate() {
        let name = match row {
            0 => "the background".to_owned(),
            row => {
                let key = SceneKey(flat.instances.key[row as usize - 1]);
                scene.get::<Name>(key).map_or_else(|| key.0.to_string(), |name| name.0.to_string())
            }
        };
        let at = rows.iter().position(|(other, ..)| *other == name).unwrap_or_else(|| {
            rows.push((name, 0, [0.0; 3]));
            rows.len() - 1
        });
        rows[at].1 += 1;
        for (sum, picture) in rows[at].2.iter_mut().zip(&pictures) {
            // Of a sample, not of the mean of all.
            *sum += mean_of(picture.variance[pixel]) * f64::from(spp);
        }
    }
    for (_, pixels, sums) in &mut rows {
        sums.iter_mut().for_each(|sum| *sum /= *pixels as f64);
    }
    rows.sort_by(|a, b| a.0.cmp(&b.0));
    Techniques { pictures, rows }
}

fn mean_of(rgb: DVec3) -> f64 {
    rgb.element_sum() / 3.0
}

/// By pixel, the row of the instance that its middle shows, and one more; 0 for none.
fn seen(renderer: &Renderer, [width, height]: [u32; 2]) -> Vec<u32> {
    let layers = vec![LayerKind::EntityId];
    let settings =
        RenderSettings { width, height, spp: Some(1), layers, filter: PixelFilter::Box, ..RenderSettings::default() };
    match renderer.render(&settings, &()).picture.layers.into_iter().next().map(|layer| layer.data) {
        Some(LayerData::Id(rows)) => rows,
        _ => vec![0; width as usize * height as usize],
    }
}

/// Root mean square of the error over the mean, of pictures of rising numbers of samples.
fn slopes(renderer: &Renderer, [width, height]: [u32; 2]) -> Vec<Slope> {
    let most = RISING[RISING.len() - 1];
    let picture = |sampler: SamplerKind, spp: u32, seed: u64| {
        let settings = RenderSettings {
            width,
            height,
            spp: Some(spp),
            seed,
            sampler,
            filter: PixelFilter::Box,
            sharing: Sharing::Off,
            ..RenderSettings::default()
        };
        renderer.render(&settings, &()).picture.rgb
    };
    let truth = picture(SamplerKind::Sobol, most * CONVERGED, 1 << 40);
    let value = |rgb: &[f32; 3]| luminance(rgb.map(f64::from));
    let mean = truth.iter().map(value).sum::<f64>() / truth.len() as f64;
    let error = |rgb: &[[f32; 3]]| {
        let squares: f64 = rgb.iter().zip(&truth).map(|(a, b)| (value(a) - value(b)).powi(2)).sum();
        (squares / truth.len() as f64).sqrt() / mean.max(f64::MIN_POSITIVE)
    };
    [(SamplerKind::Independent, "independent numbers"), (SamplerKind::Sobol, "Sobol, scrambled")]
        .into_iter()
        .map(|(sampler, name)| {
            let errors: Vec<Vec<f64>> = (0..SEEDS)
                .map(|seed| RISING.iter().map(|&spp| error(&picture(sampler, spp, seed))).collect())
                .collect();
            let of_seed = |errors: &Vec<f64>| fitted(&RISING.map(f64::from), errors);
            let points = (0..RISING.len()).map(|i| {
                let squares: f64 = errors.iter().map(|errors| errors[i].powi(2)).sum();
                (RISING[i], (squares / SEEDS as f64).sqrt())
            });
            Slope { name, points: points.collect(), slope: Estimate::of(errors.iter().map(of_seed)) }
        })
        .collect()
}

/// Slope of the line through logarithms, by least squares.
fn fitted(x: &[f64], y: &[f64]) -> f64 {
    let points: Vec<(f64, f64)> = x.iter().zip(y).filter(|(_, y)| **y > 0.0).map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = points.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|point| point.0), mean(|point| point.1));
    let both: f64 = points.iter().map(|point| (point.0 - x) * (point.1 - y)).sum();
    both / points.iter().map(|point| (point.0 - x).powi(2)).sum::<f64>()
}

/// Many estimates of a pixel of more than usual noise, whose numbers have nothing to do with one another.
fn spread(scene: &FlatScene, picture: &ReferencePicture, size: [u32; 2]) -> Spread {
    let noise = |&pixel: &usize| {
        let mean = mean_of(picture.rgb[pixel]);
        if mean > 0.0 { mean_of(picture.variance[pixel]) / (mean * mean) } else { 0.0 }
    };
    let mut pixels: Vec<usize> = (0..picture.rgb.len()).collect();
    pixels.sort_by(|a, b| noise(a).total_cmp(&noise(b)));
    let pixel = pixels[pixels.len() * 3 / 4] as u32;
    let pixel = [pixel % size[0], pixel / size[0]];
    let settings = RenderSettings {
        width: ESTIMATES[0],
        height: ESTIMATES[1],
        spp: Some(EACH),
        filter: PixelFilter::Box,
        sharing: Sharing::Off,
        layers: vec![LayerKind::Error],
        ..RenderSettings::default()
    };
    let rendered = render_aimed(scene, &settings, Aim::Pixels(size, vec![pixel]), &());
    let green = |rgb: &[f32; 3]| f64::from(rgb[1]);
    let values: Vec<f64> = rendered.picture.rgb.iter().map(green).collect();
    let errors: Vec<f64> = match rendered.picture.layers.first().map(|layer| &layer.data) {
        Some(LayerData::Rgb(errors)) => errors.iter().map(green).collect(),
        _ => Vec::new(),
    };
    let truth = Estimate::of(values.iter().copied());
    // Three degrees of freedom: four replicas of the sequence.
    let factor = student_factor(0.95, 3.0);
    let holds = |(value, error): (&f64, &f64)| (value - truth.value).abs() <= factor * error;
    let held = values.iter().zip(&errors).filter(|pair| holds(*pair)).count();
    let half = factor * errors.first().copied().unwrap_or(0.0);
    Spread { pixel, coverage: held as f64 / values.len() as f64, values, truth, half }
}

/// Pictures side by side, exposed alike.
fn strip(techniques: &Techniques) -> image::RgbImage {
    const GAP: u32 = 6;
    let first = &techniques.pictures[2];
    let rgb = |picture: &ReferencePicture| picture.rgb.iter().map(|rgb| rgb.as_vec3().to_array()).collect::<Vec<_>>();
    let (width, height) = (first.width, first.height);
    let exposed = Picture { width: width as usize, height: height as usize, rgb: rgb(first), ..Picture::default() };
    let options = WriteOptions::default();
    let factor = Exposure::Auto.factor(&exposed);
    let words = TECHNIQUES.iter().map(|(_, name)| Canvas::width_of(name)).max().unwrap_or(0);
    let column = width.max(words) + GAP;
    let mut canvas = Canvas::new([3 * column + GAP, height + LINE + 3 * GAP], [255; 3]);
    for (i, (picture, (_, name))) in (0..).zip(techniques.pictures.iter().zip(TECHNIQUES)) {
        let byte = |light: f32| (light * 255.0).round() as u8;
        let pixels: Vec<[u8; 3]> =
            rgb(picture).iter().map(|rgb| options.tone_map.encode(rgb.map(|c| c * factor)).map(byte)).collect();
        canvas.paste([GAP + i * column, GAP], width, &pixels);
        canvas.write([GAP + i * column, height + 2 * GAP], name, [20; 3]);
    }
    canvas.into_image()
}

fn plot_slopes(path: &Path, scene: &str, slopes: &[Slope]) -> Result<(), CliError> {
    let errors = || slopes.iter().flat_map(|slope| &slope.points).map(|(_, error)| *error).filter(|&e| e > 0.0);
    let (least, most) = errors().fold((f64::MAX, 0.0_f64), |(a, b), e| (a.min(e), b.max(e)));
    if most == 0.0 {
        return Ok(());
    }
    let last = f64::from(RISING[RISING.len() - 1]);
    draw(path, (640, 420), |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(format!("Error by number of samples: {scene}"), ("sans-serif", 16))
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(60)
            .build_cartesian_2d((0.9..last * 1.1).log_scale(), decades(least, most).log_scale())?;
        let plain = |x: &f64| format!("{x}");
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(TRANSPARENT).x_label_formatter(&plain).y_label_formatter(&plain);
        mesh.x_desc("samples per pixel").y_desc("RMSE over the mean").draw()?;
        for (slope, color) in slopes.iter().zip(COLORS) {
            let points = slope.points.iter().map(|&(spp, error)| (f64::from(spp), error));
            chart.draw_series(points.clone().map(|point| Circle::new(point, 3, color.filled())))?;
            chart
                .draw_series(LineSeries::new(points, color.stroke_width(2)))?
                .label(format!("{}: slope {:.2}", slope.name, slope.slope.value))
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 14, y)], color.stroke_width(2)));
        }
        let mut labels = chart.configure_series_labels();
        labels.position(SeriesLabelPosition::LowerLeft).background_style(WHITE.mix(0.8));
        labels.border_style(BLACK.mix(0.3)).draw()?;
        Ok(())
    })
}

fn plot_spread(path: &Path, scene: &str, spread: &Spread) -> Result<(), CliError> {
    let mut sorted = spread.values.clone();
    sorted.sort_by(f64::total_cmp);
    let (from, to) = (sorted[0], sorted[sorted.len() * 999 / 1000]);
    if from >= to {
        return Ok(());
    }
    let width = (to - from) / BARS as f64;
    let mut bars = [0.0_f64; BARS];
    for value in &sorted {
        bars[(((value - from) / width) as usize).min(BARS - 1)] += 1.0;
    }
    let most = bars.iter().copied().fold(0.0, f64::max);
    let [x, y] = spread.pixel;
    draw(path, (640, 420), |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(format!("{} estimates of pixel {x},{y}: {scene}", spread.values.len()), ("sans-serif", 16))
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(48)
            .build_cartesian_2d(from..to, 0.0..1.5 * most)?;
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(TRANSPARENT).x_label_formatter(&|x| format!("{x:.4}"));
        mesh.x_desc(format!("nit (green), of {EACH} samples each")).y_desc("estimates").draw()?;
        let bar = COLORS[5].mix(0.7).filled();
        chart.draw_series(bars.iter().enumerate().map(|(i, &count)| {
            let left = from + i as f64 * width;
            Rectangle::new([(left, 0.0), (left + width, count)], bar)
        }))?;
        let truth = spread.truth.value;
        chart
            .draw_series(LineSeries::new([(truth, 0.0), (truth, 1.2 * most)], COLORS[0].stroke_width(2)))?
            .label("mean of all")
            .legend(|(x, y)| PathElement::new([(x, y), (x + 14, y)], COLORS[0].stroke_width(2)));
        let (one, half, height) = (spread.values[0], spread.half, 1.12 * most);
        let ends = [(one - half).max(from), (one + half).min(to)].map(|x| (x, height));
        chart
            .draw_series([PathElement::new(ends, COLORS[1].stroke_width(3))])?
            .label("one of them, with its 95 % interval")
            .legend(|(x, y)| PathElement::new([(x, y), (x + 14, y)], COLORS[1].stroke_width(3)));
        chart.draw_series([Circle::new((one, height), 4, COLORS[1].filled())])?;
        let mut labels = chart.configure_series_labels();
        labels.position(SeriesLabelPosition::UpperRight).background_style(WHITE.mix(0.8));
        labels.border_style(BLACK.mix(0.3)).draw()?;
        Ok(())
    })
}

fn markdown(name: &str, techniques: &Techniques, slopes: &[Slope], spread: &Spread) -> String {
    let mut text = format!("# What Monte Carlo integration does with {name}\n\n## Variance of a sample, nit²\n\n");
    text.push_str("By what the camera sees, and by how lights are found; one path at a time, independent numbers.\n\n");
    text.push_str("| | pixels | light sampling | BSDF sampling | both (MIS) |\n|---|---|---|---|---|\n");
    for (name, pixels, [lights, bsdf, both]) in &techniques.rows {
        writeln!(text, "| {name} | {pixels} | {lights:.3e} | {bsdf:.3e} | {both:.3e} |").expect(TAKES);
    }
    let mean = |picture: &ReferencePicture| {
        let count = picture.rgb.len() as f64;
        let variance = picture.variance.iter().map(|&v| mean_of(v)).sum::<f64>() / (count * count);
        (picture.rgb.iter().map(|&rgb| mean_of(rgb)).sum::<f64>() / count, variance.sqrt())
    };
    let means: Vec<_> = techniques.pictures.iter().map(mean).map(|(m, e)| format!("{m:.5} ± {e:.5}")).collect();
    writeln!(text, "\nAll have the same mean: {} nit (± one standard error).\n", means.join(", ")).expect(TAKES);
    text.push_str(
        "## Error by number of samples\n\nRoot mean square of the error over the mean of the picture.\n\n| samples |",
    );
    slopes.iter().for_each(|slope| write!(text, " {} |", slope.name).expect(TAKES));
    text.push_str("\n|---|---|---|\n");
    for (i, spp) in RISING.iter().enumerate() {
        write!(text, "| {spp} |").expect(TAKES);
        slopes.iter().for_each(|slope| write!(text, " {:.3e} |", slope.points[i].1).expect(TAKES));
        text.push('\n');
    }
    text.push_str("| slope |");
    for Slope { slope, .. } in slopes {
        write!(text, " {:.3} ± {:.3} |", slope.value, slope.variance.sqrt()).expect(TAKES);
    }
    let Spread { pixel: [x, y], values, truth, coverage, .. } = spread;
    let deviation = truth.variance.sqrt() * (values.len() as f64).sqrt();
    writeln!(
        text,
        "\n\n## Estimates of pixel {x},{y}\n\n{} estimates of {EACH} samples each: mean {:.6} nit, standard deviation {deviation:.6} nit. Of their 95 % intervals {:.1} % hold the mean of all.\n",
        values.len(),
        truth.value,
        100.0 * coverage
    )
    .expect(TAKES);
    text
}

fn json_of(name: &str, techniques: &Techniques, slopes: &[Slope], spread: &Spread) -> Value {
    let row = |(name, pixels, [lights, bsdf, both]): &(String, usize, [f64; 3])| json!({ "seen": name, "pixels": pixels, "lights": lights, "bsdf": bsdf, "both": both });
    let slope = |slope: &Slope| json!({ "numbers": slope.name, "points": slope.points, "slope": slope.slope.value, "standard_error": slope.slope.variance.sqrt() });
    json!({
        "scene": name,
        "variance": techniques.rows.iter().map(row).collect::<Vec<_>>(),
        "error": slopes.iter().map(slope).collect::<Vec<_>>(),
        "pixel": { "at": spread.pixel, "mean": spread.truth.value, "estimates": spread.values.len(), "coverage": spread.coverage },
    })
}

const TAKES: &str = "a string takes it";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_through_logarithms_have_the_slope_of_the_power() {
        let x = RISING.map(f64::from);
        for power in [-0.5, -0.84, 1.0] {
            assert!((fitted(&x, &x.map(|x| 3.0 * x.powf(power))) - power).abs() < 1e-12);
        }
        // What has no error has no place on such a scale.
        assert!((fitted(&[1.0, 2.0, 4.0], &[8.0, 4.0, 0.0]) + 1.0).abs() < 1e-12);
    }
}
