//! Tables as pictures.

use std::path::Path;

use plotters::{
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use super::{contender::structures, report::Row};
use crate::cli::error::CliError;
pub use crate::cli::plot::{COLORS, Problem, decades, draw};

/// From dark to light, for what ours are compared with.
fn grey(place: usize) -> RGBColor {
    let light = 40 + 36 * place.min(5) as u8;
    RGBColor(light, light, light)
}

/// Structures with their colours, which do not depend on what else is shown.
fn colored(rows: &[&Row]) -> Vec<(&'static str, RGBColor)> {
    let known = structures();
    let mut peers = 0;
    let color = |name: &'static str| {
        let place = known.iter().position(|(other, _)| *other == name);
        peers += usize::from(place.is_none());
        (name, place.map_or_else(|| grey(peers - 1), |place| COLORS[place % COLORS.len()]))
    };
    distinct(rows, |row| row.accel).into_iter().map(color).collect()
}

/// The different values of a column, in the order of their first appearance.
fn distinct<'a>(rows: &[&'a Row], column: impl Fn(&'a Row) -> &'static str) -> Vec<&'static str> {
    let mut all = Vec::new();
    for row in rows {
        if !all.contains(&column(row)) {
            all.push(column(row));
        }
    }
    all
}

/// A bar for each structure and kind of rays: millions of rays per second.
pub fn bars(path: &Path, rows: &[&Row]) -> Result<(), CliError> {
    let Some(first) = rows.first() else { return Ok(()) };
    let (accels, kinds) = (colored(rows), distinct(rows, |row| row.rays));
    let most = rows.iter().map(|row| row.mrays_per_second.max).fold(0.0, f64::max);
    // A group has a place for each structure and one to keep away from the next.
    let group = accels.len() + 1;
    let caption = format!("{}, {} triangles, threads: {}", first.scene, first.triangles, first.threads);
    draw(path, (900, 420), |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(caption, ("sans-serif", 16))
            .margin(10)
            .x_label_area_size(26)
            .y_label_area_size(48)
            .build_cartesian_2d(0.0..(kinds.len() * group) as f64, 0.0..1.05 * most)?;
        let mut mesh = chart.configure_mesh();
        mesh.disable_x_mesh().disable_x_axis().light_line_style(TRANSPARENT);
        mesh.y_desc("millions of rays per second").draw()?;
        for (place, (accel, color)) in accels.into_iter().enumerate() {
            let of_accel = rows.iter().filter(|row| row.accel == accel);
            let bars = of_accel.map(|row| {
                let kind = kinds.iter().position(|kind| *kind == row.rays).unwrap_or(0);
                let left = (kind * group + place) as f64 + 0.5;
                Rectangle::new([(left + 0.05, 0.0), (left + 0.95, row.mrays_per_second.median)], color.filled())
            });
            chart
                .draw_series(bars)?
                .label(accel)
                .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 10, y + 5)], color.filled()));
        }
        let label = ("sans-serif", 14).into_text_style(area).pos(Pos::new(HPos::Center, VPos::Top));
        for (place, kind) in kinds.iter().enumerate() {
            let middle = (place as f64 + 0.5) * group as f64;
            let (x, y) = chart.backend_coord(&(middle, 0.0));
            area.draw_text(kind, &label, (x, y + 6))?;
        }
        let mut labels = chart.configure_series_labels();
        labels.position(SeriesLabelPosition::UpperRight).background_style(WHITE.mix(0.8));
        labels.border_style(BLACK.mix(0.3)).draw()?;
        Ok(())
    })
}

/// Over triangles: rays per second of each kind, build time, memory.
pub fn growth(path: &Path, rows: &[&Row]) -> Result<(), CliError> {
    let (accels, kinds) = (colored(rows), distinct(rows, |row| row.rays));
    type Value = fn(&Row) -> f64;
    let speed: Value = |row| row.mrays_per_second.median;
    let mut panels: Vec<(String, &str, Value)> =
        kinds.iter().map(|kind| (format!("{kind}: million rays per second"), *kind, speed)).collect();
    // These are the same for all kinds, of which the first is always there.
    if let Some(kind) = kinds.first() {
        panels.push(("build: seconds".into(), kind, |row| row.build_seconds));
        panels.push(("memory: bytes per triangle".into(), kind, |row| row.bytes as f64 / row.triangles.max(1) as f64));
    }
    draw(path, (1080, 640), |area| {
        let areas = area.split_evenly((2, panels.len().div_ceil(2)));
        for ((title, kind, value), area) in panels.iter().zip(&areas) {
            let of_kind = || rows.iter().filter(|row| row.rays == *kind && value(row) > 0.0);
            let (least, most) = of_kind().map(|row| value(row)).fold((f64::MAX, 0.0), |(a, b), x| (x.min(a), x.max(b)));
            let sizes = of_kind().map(|row| row.triangles as f64);
            let (few, many) = sizes.fold((f64::MAX, 0.0), |(a, b), x| (x.min(a), f64::max(x, b)));
            if least > most {
                continue;
            }
            let mut chart = ChartBuilder::on(area)
                .caption(title, ("sans-serif", 14))
                .margin(8)
                .x_label_area_size(30)
                .y_label_area_size(52)
                .build_cartesian_2d((0.8 * few..1.25 * many).log_scale(), decades(least, most).log_scale())?;
            let power = |x: &f64| format!("{x:e}");
            let plain = |x: &f64| if (1e-3..1e4).contains(x) { format!("{x}") } else { power(x) };
            let mut mesh = chart.configure_mesh();
            mesh.light_line_style(TRANSPARENT).x_labels(6).y_labels(6).x_label_formatter(&power);
            mesh.y_label_formatter(&plain).x_desc("triangles").draw()?;
            for &(accel, color) in &accels {
                let of_accel = of_kind().filter(|row| row.accel == accel);
                let points: Vec<_> = of_accel.map(|row| (row.triangles as f64, value(row))).collect();
                chart.draw_series(points.iter().map(|&point| Circle::new(point, 3, color.filled())))?;
                chart
                    .draw_series(LineSeries::new(points, color.stroke_width(2)))?
                    .label(accel)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 14, y)], color.stroke_width(2)));
            }
            // Where lines rise to the right and leave room.
            if title.starts_with("build") {
                let mut labels = chart.configure_series_labels();
                labels.position(SeriesLabelPosition::LowerRight).background_style(WHITE.mix(0.8));
                labels.border_style(BLACK.mix(0.3)).draw()?;
            }
        }
        Ok(())
    })
}
