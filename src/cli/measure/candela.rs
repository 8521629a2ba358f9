//! `measure --candela`: the far field of a luminaire, as a file for lighting programs and as a polar diagram.

use std::{f64::consts::PI, path::Path};

use plotters::prelude::*;
use serde_json::{Value, json};
use wavecast::{
    film,
    measure::{
        far_field::{FarField, far_field},
        flux::flux,
        meter::{Effort, Readings},
    },
    world::SceneKey,
};

use super::{Answer, Args, light_names};
use crate::cli::{
    error::CliError,
    plot::{COLORS, draw},
    progress::Watcher,
};

/// Steps of γ and C, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps {
    gamma: f64,
    c: f64,
}

impl Default for Steps {
    fn default() -> Self {
        Self { gamma: 5.0, c: 15.0 }
    }
}

/// Directions at most.
const MOST: f64 = 1e6;

/// `5` or `5,15`.
pub fn steps(text: &str) -> Result<Steps, String> {
    let expected = "expected GAMMA or GAMMA,C, such as 2.5,15: degrees of which 180 and 360 are whole multiples";
    let parts: Vec<f64> = text.split(',').filter_map(|part| part.trim().parse().ok()).collect();
    let steps = match parts[..] {
        [gamma] => Steps { gamma, c: Steps::default().c },
        [gamma, c] => Steps { gamma, c },
        _ => return Err(expected.into()),
    };
    let divides = |step: f64, all: f64| step > 0.0 && (all / step - (all / step).round()).abs() < 1e-6;
    let right = text.split(',').count() == parts.len() && divides(steps.gamma, 180.0) && divides(steps.c, 360.0);
    if !right || steps.gamma > 90.0 {
        return Err(expected.into());
    }
    if 180.0 / steps.gamma * 360.0 / steps.c > MOST {
        return Err(format!("these are more than {MOST} directions"));
    }
    Ok(steps)
}

/// Reads a luminaire: an entity and what hangs below it, alone in the dark.
pub fn read(args: &Args, name: &str, key: SceneKey, effort: &Effort, watcher: &Watcher) -> Result<Answer, CliError> {
    let (scene, renderer) = args.scene.alone(key)?;
    let flat = renderer.scene();
    let keys = wavecast::flat::LightGroups::new(flat).keys;
    if flat.lights.default_sky || !keys.iter().any(|&key| key != u64::MAX && flux(flat, key).is_some()) {
        let (_, whole) = args.scene.open_silently()?;
        return Err(CliError::NoLight {
            scene: args.scene.file.clone(),
            wanted: name.into(),
            available: light_names(&scene, whole.scene()),
        });
    }
    let Steps { gamma, c } = args.step.unwrap_or_default();
    let field = far_field(flat, (180.0 / gamma).round() as u32, (360.0 / c).round() as u32, effort, watcher)
        .map_err(|error| CliError::Usage(format!("--candela {name}: {error}")))?;
    let readings = Readings {
        each: Vec::new(),
        mean: field.mean,
        samples: field.samples,
        seconds: field.seconds,
        reached: field.reached,
        discarded: field.discarded,
    };
    let mut answer = Answer::new("candela", name.to_owned(), "cd", readings);
    let (_, [gamma, c]) = field.peak();
    let least = field.intensity.iter().map(|reading| reading.value.value).fold(f64::INFINITY, f64::min);
    let at_least = field.intensity.iter().position(|reading| reading.value.value == least).unwrap_or(0);
    let of = |row: usize| {
        let (c, gamma) = (row / field.gamma_degrees.len(), row % field.gamma_degrees.len());
        format!("γ {}° C {}°", field.gamma_degrees[gamma], field.c_degrees[c])
    };
    answer.extremes = Some([(least, of(at_least)), (field.peak().0.value.value, format!("γ {gamma}° C {c}°"))]);
    answer.grid = Some(([field.gamma_degrees.len() as u32, field.c_degrees.len() as u32], field.intensity.clone()));
    answer.field = Some(field);
    Ok(answer)
}

/// As text: flux and the widths of the beam.
pub fn text(field: &FarField) -> String {
    let flux = field.flux();
    let [from, to] = flux.interval(0.95);
    format!("  flux {:.6} lm   95 %: {from:.6} .. {to:.6}   (4π times the mean)\n", flux.value)
}

/// As JSON, beside what all answers have.
pub fn json(field: &FarField, value: &mut Value) {
    let flux = field.flux();
    value["flux"] = json!({ "value": flux.value, "interval": flux.interval(0.95), "unit": "lm" });
    value["gamma"] = json!(field.gamma_degrees);
    value["c"] = json!(field.c_degrees);
}

/// As a file that lighting programs read.
pub fn write_ies(path: &Path, scene: &Path, name: &str, field: &FarField) -> Result<(), CliError> {
    let file_name = scene.file_name().unwrap_or(scene.as_os_str()).to_string_lossy();
    let flux = field.flux();
    let [from, to] = flux.interval(0.95);
    let remarks = [
        format!("scene {file_name}"),
        format!("flux {:.6} lm, 95 % interval {from:.6} to {to:.6}", flux.value),
        "C 0 is +X and C 90 is -Z of the scene, gamma 0 is -Y".to_owned(),
    ];
    let text = field.to_ies(name, &remarks);
    Ok(film::write_file(path, |file| {
        use std::io::Write;
        file.write_all(text.as_bytes())
    })?)
}

/// As a table.
pub fn table(field: &FarField) -> String {
    let mut table = String::from("gamma,c,cd,from,to\n");
    let gammas = field.gamma_degrees.len();
    for (row, reading) in field.intensity.iter().enumerate() {
        let (gamma, c) = (field.gamma_degrees[row % gammas], field.c_degrees[row / gammas]);
        let [from, to] = reading.value.interval(0.95);
        table.push_str(&format!("{gamma},{c},{},{from},{to}\n", reading.value.value));
    }
    table
}

/// Edge of the diagram, pixels.
const EDGE: u32 = 560;
/// More of it above, for the legend.
const ABOVE: u32 = 68;

/// As a polar diagram: half planes C 0 and C 180 as one curve, C 90 and C 270 as another.
pub fn plot(path: &Path, name: &str, field: &FarField) -> Result<(), CliError> {
    let most = field.peak().0.value.value.max(f64::MIN_POSITIVE);
    // The outermost circle is a round number.
    let power = 10_f64.powf(most.log10().floor());
    let outer = [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 8.0, 10.0].map(|m| m * power).into_iter().find(|&r| r >= most);
    let outer = outer.unwrap_or(most);
    let place = |gamma: f64, radius: f64| {
        let (sin, cos) = gamma.to_radians().sin_cos();
        (radius / outer * sin, -radius / outer * cos)
    };
    let gammas = field.gamma_degrees.len();
    let half = |c: f64| {
        let near = |a: f64| ((a - c + 540.0).rem_euclid(360.0) - 180.0).abs();
        let row =
            (0..field.c_degrees.len()).min_by(|&a, &b| near(field.c_degrees[a]).total_cmp(&near(field.c_degrees[b])));
        let first = row.unwrap_or(0) * gammas;
        field.gamma_degrees.iter().copied().zip(field.intensity[first..first + gammas].iter().map(|r| r.value.value))
    };
    let curve = |c: f64| -> Vec<(f64, f64)> {
        let right: Vec<_> = half(c).map(|(gamma, cd)| place(gamma, cd)).collect();
        let left = half(c + 180.0).map(|(gamma, cd)| place(-gamma, cd));
        left.collect::<Vec<_>>().into_iter().rev().chain(right).collect()
    };
    draw(path, (EDGE, EDGE + ABOVE), |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(format!("Luminous intensity of {name}, cd"), ("sans-serif", 16))
            .margin(16)
            .build_cartesian_2d(-1.12..1.12, -1.12..1.30)?;
        let gray = RGBColor(200, 200, 200);
        let words = ("sans-serif", 12).into_font().color(&RGBColor(90, 90, 90));
        for ring in 1..=4 {
            let radius = f64::from(ring) / 4.0;
            let circle = (0..=120).map(|i| {
                let (sin, cos) = (f64::from(i) / 60.0 * PI).sin_cos();
                (radius * sin, radius * cos)
            });
            chart.draw_series(LineSeries::new(circle, gray.stroke_width(1)))?;
            let label = format!("{}", (outer * radius * 1e6).round() / 1e6);
            chart.draw_series([Text::new(label, (0.02, radius + 0.035), words.clone())])?;
        }
        for ray in 0..12 {
            let gamma = f64::from(ray) * 30.0;
            chart.draw_series(LineSeries::new([(0.0, 0.0), place(gamma, outer)], gray.stroke_width(1)))?;
            let (x, y) = place(gamma, 1.06 * outer);
            let told = if gamma > 180.0 { 360.0 - gamma } else { gamma };
            chart.draw_series([Text::new(format!("{told}°"), (x - 0.03, y + 0.02), words.clone())])?;
        }
        for (color, c) in [(COLORS[0], 0.0), (COLORS[1], 90.0)] {
            chart
                .draw_series(LineSeries::new(curve(c), color.stroke_width(2)))?
                .label(format!("C {c}° to C {}°", c + 180.0))
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], color.stroke_width(2)));
        }
        chart.configure_series_labels().position(SeriesLabelPosition::UpperRight).border_style(gray).draw()?;
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_divide_the_circle() {
        assert_eq!(steps("2.5"), Ok(Steps { gamma: 2.5, c: 15.0 }));
        assert_eq!(steps("10, 90"), Ok(Steps { gamma: 10.0, c: 90.0 }));
        for text in ["", "0", "7", "5,0", "5,7", "-5", "nan", "1,1,1", "180", "0.001,0.01"] {
            assert!(steps(text).is_err(), "{text}");
        }
    }
}
