//! `measure --brdf`: what a material sends into each direction, beside what its formula says.

use std::{fmt::Write as _, path::Path};

use plotters::prelude::*;
use serde_json::{Value, json};
use wavecast::{
    film,
    measure::{
        brdf::{Reflectance, albedo, brdf, formula},
        meter::{Effort, Reading},
    },
    world::{Material, MaterialSlots, Scene},
};

use super::{Args, entity, reading_json};
use crate::cli::{
    error::CliError,
    plot::{COLORS, draw},
    progress::Watcher,
};

/// Angles of incidence, degrees.
const INCIDENT: [f64; 4] = [0.0, 30.0, 60.0, 80.0];
/// Angles of view: so many steps of so many degrees to both sides.
const STEPS: i32 = 17;
const STEP: f64 = 5.0;
/// Of these every so many are told in words.
const TOLD: usize = 3;
/// Angles under which the albedo is read.
const ALBEDO: [f64; 3] = [0.0, 45.0, 80.0];

/// A material as it was measured.
pub struct Measured {
    name: String,
    material: Material,
    /// By angle of incidence.
    curves: Vec<(f64, Vec<Reflectance>)>,
    albedo: Vec<(f64, Reading)>,
}

/// `ENTITY`, or `ENTITY:SLOT` for one of several materials.
pub fn read(args: &Args, scene: &Scene, name: &str, effort: &Effort, watcher: &Watcher) -> Result<Measured, CliError> {
    let (of, slot) = match name.rsplit_once(':') {
        Some((of, slot)) if scene.find(name).is_none() => (of, slot.parse().ok()),
        _ => (name, Some(0)),
    };
    let key = entity(scene, args, of)?;
    let slots = scene.get::<MaterialSlots>(key);
    let number = slots.as_ref().map_or(0, |slots| slots.0.len());
    let material = slot.and_then(|slot: usize| slots?.0.get(slot).copied());
    let Some(material) = material.and_then(|key| scene.get::<Material>(key)) else {
        let hint = match number {
            0 => "it has no material of its own".to_owned(),
            1 => "it has one material".to_owned(),
            n => format!("it has {n} materials, {of}:0 to {of}:{}", n - 1),
        };
        return Err(CliError::Usage(format!("--brdf {name}: {hint}")));
    };
    if material.unlit {
        return Err(CliError::Usage(format!("--brdf {name}: unlit surfaces scatter nothing")));
    }
    let views: Vec<f64> = (-STEPS..=STEPS).map(|i| f64::from(i) * STEP).collect();
    Ok(Measured {
        name: name.to_owned(),
        curves: INCIDENT.iter().map(|&angle| (angle, brdf(&material, angle, &views, effort, watcher))).collect(),
        albedo: ALBEDO.iter().map(|&angle| (angle, albedo(&material, angle, effort, watcher))).collect(),
        material,
    })
}

impl Measured {
    /// The greatest difference of luminance to the formula, as a share of it, beyond what the 95 % interval leaves open.
    fn worst(&self) -> f64 {
        let off = |point: &Reflectance| {
            let (want, [from, to]) = (point.expected(), point.measured.value.interval(0.95));
            let out = (from - want).max(want - to).max(0.0);
            if want > 0.0 { out / want } else { out }
        };
        self.curves.iter().flat_map(|(_, points)| points).map(off).fold(0.0, f64::max)
    }

    /// What there is to warn of.
    pub fn warning(&self) -> Option<String> {
        let textures = [
            &self.material.base_color_texture,
            &self.material.metallic_roughness_texture,
            &self.material.normal_texture,
            &self.material.specular_texture,
            &self.material.specular_color_texture,
            &self.material.transmission_texture,
        ];
        let has_some = textures.iter().any(|texture| texture.is_some());
        has_some.then(|| format!("--brdf {}: its textures are left out", self.name))
    }

    /// In words.
    pub fn text(&self) -> String {
        let mut text = format!("brdf {}, 1/sr: measured, and by its formula\n  view  ", self.name);
        for (angle, _) in &self.curves {
            write!(text, "{:>24}", format!("light at {angle}°")).expect(TAKES);
        }
        text.push('\n');
        for row in (0..self.curves[0].1.len()).skip(STEPS as usize % TOLD).step_by(TOLD) {
            write!(text, "  {:>4}° ", self.curves[0].1[row].view_degrees).expect(TAKES);
            for (_, points) in &self.curves {
                let (got, want) = (points[row].measured.value.value, points[row].expected());
                write!(text, "{:>24}", format!("{got:.6}  {want:.6}")).expect(TAKES);
            }
            text.push('\n');
        }
        writeln!(text, "  beyond its 95 % interval no reading is off by more than {:.1e} of the formula", self.worst())
            .expect(TAKES);
        for (angle, reading) in &self.albedo {
            let [from, to] = reading.value.interval(0.95);
            writeln!(text, "  albedo at {angle}°: {:.6}   95 %: {from:.6} .. {to:.6}", reading.value.value)
                .expect(TAKES);
        }
        text
    }

    /// As JSON.
    pub fn json(&self) -> Value {
        let point = |point: &Reflectance| json!({ "view": point.view_degrees, "measured": reading_json(&point.measured), "formula": point.formula });
        let curve = |(angle, points): &(f64, Vec<Reflectance>)| json!({ "incident": angle, "points": points.iter().map(point).collect::<Vec<_>>() });
        let albedo = |(angle, reading): &(f64, Reading)| json!({ "view": angle, "albedo": reading_json(reading) });
        json!({
            "kind": "brdf",
            "at": self.name,
            "unit": "1/sr",
            "worst": self.worst(),
            "curves": self.curves.iter().map(curve).collect::<Vec<_>>(),
            "albedo": self.albedo.iter().map(albedo).collect::<Vec<_>>(),
        })
    }

    /// As a table.
    pub fn write_table(&self, path: &Path) -> Result<(), CliError> {
        let mut table = String::from("incident,view,measured,from,to,formula\n");
        for (angle, points) in &self.curves {
            for point in points {
                let (value, [from, to]) = (point.measured.value.value, point.measured.value.interval(0.95));
                writeln!(table, "{angle},{},{value},{from},{to},{}", point.view_degrees, point.expected())
                    .expect(TAKES);
            }
        }
        Ok(film::write_file(path, |file| {
            use std::io::Write;
            file.write_all(table.as_bytes())
        })?)
    }

    /// As curves over the angle of view.
    pub fn plot(&self, path: &Path) -> Result<(), CliError> {
        let all = || self.curves.iter().flat_map(|(_, points)| points).map(Reflectance::expected).filter(|&f| f > 0.0);
        let (least, most) = all().fold((f64::MAX, 0.0_f64), |(a, b), f| (a.min(f), b.max(f)));
        // Lobes are many times as high as what is around them; matt surfaces are not.
        let as_decades = most > 20.0 * least;
        let place = |f: f64| if as_decades { f.max(least / 10.0).log10() } else { f };
        let (from, to) =
            if as_decades { (place(least).floor(), place(most).ceil()) } else { (0.0, 1.2 * most.max(1e-6)) };
        draw(path, (760, 460), |area| {
            let mut chart = ChartBuilder::on(area)
                .caption(format!("BRDF of {}: measured, over its formula", self.name), ("sans-serif", 16))
                .margin(12)
                .x_label_area_size(38)
                .y_label_area_size(64)
                .build_cartesian_2d(-90.0..90.0, from..to)?;
            let label = |y: &f64| if as_decades { format!("{}", 10_f64.powf(*y)) } else { format!("{y:.3}") };
            let mut mesh = chart.configure_mesh();
            mesh.light_line_style(TRANSPARENT).x_labels(13).y_label_formatter(&label);
            if as_decades {
                mesh.y_labels((to - from) as usize + 1);
            }
            mesh.x_desc("angle of view, degrees; positive towards the mirror direction").y_desc("1/sr").draw()?;
            for ((angle, points), color) in self.curves.iter().zip(COLORS) {
                let line = (-178..=178).map(|half| {
                    let view = 0.5 * f64::from(half);
                    (view, place(formula(&self.material, *angle, view)).min(to))
                });
                chart
                    .draw_series(LineSeries::new(line, color.stroke_width(1)))?
                    .label(format!("light at {angle}°"))
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], color.stroke_width(2)));
                let dots = points
                    .iter()
                    .map(|p| Circle::new((p.view_degrees, place(p.measured.value.value)), 3, color.filled()));
                chart.draw_series(dots)?;
            }
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperLeft)
                .border_style(BLACK.mix(0.3))
                .draw()?;
            Ok(())
        })
    }
}

const TAKES: &str = "a string takes it";
