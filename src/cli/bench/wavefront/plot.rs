//! The tables as pictures.

use std::path::Path;

use plotters::{
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};
use wavecast::wavefront::STAGES;

use super::{
    super::{
        Part,
        plot::{COLORS, draw},
    },
    report::{Row, StageRow},
};
use crate::cli::error::CliError;

/// The part of a scene's name that tells it from others.
fn short(scene: &str) -> &str {
    scene.rsplit(['/', '\\']).next().unwrap_or(scene)
}

/// Paths per second over paths in a wave: a line for each scene, over its best, as scenes differ by more than waves do.
pub fn wave_sizes(path: &Path, rows: &[Row]) -> Result<(), CliError> {
    let rows: Vec<&Row> = rows.iter().filter(|row| row.part == Part::WaveSize).collect();
    let sizes = rows.iter().map(|row| row.wave_size as f64);
    let (least, most) = sizes.fold((f64::MAX, 0.0), |(a, b), x| (x.min(a), f64::max(x, b)));
    if rows.is_empty() {
        return Ok(());
    }
    draw(path, (760, 420), |area| {
        let mut chart = ChartBuilder::on(area)
            .caption("paths per second, of the scene's best median", ("sans-serif", 16))
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(48)
            .build_cartesian_2d((0.8 * least..1.25 * most).log_scale().base(2.0), 0.0..1.1)?;
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(TRANSPARENT).x_labels(16).x_label_formatter(&|x| format!("{x:.0}"));
        mesh.x_desc("paths in a wave").draw()?;
        for (place, rows) in rows.chunk_by(|a, b| a.scene == b.scene).enumerate() {
            let color = COLORS[place % COLORS.len()];
            let best = rows.iter().map(|row| row.mpaths_per_second.median).fold(0.0, f64::max);
            let mut rows = rows.to_vec();
            rows.sort_by_key(|row| row.wave_size);
            let at = |row: &Row, value: f64| (row.wave_size as f64, value / best);
            let points: Vec<_> = rows.iter().map(|row| at(row, row.mpaths_per_second.median)).collect();
            chart.draw_series(points.iter().map(|&point| Circle::new(point, 3, color.filled())))?;
            // The spread, as far as there is room.
            chart.draw_series(rows.iter().map(|row| {
                let speed = row.mpaths_per_second;
                PathElement::new([at(row, speed.min), at(row, speed.max.min(1.1 * best))], color.mix(0.5))
            }))?;
            chart
                .draw_series(LineSeries::new(points, color.stroke_width(2)))?
                .label(format!("{}: {best:.3} million", short(&rows[0].scene)))
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 14, y)], color.stroke_width(2)));
        }
        let mut labels = chart.configure_series_labels();
        labels.position(SeriesLabelPosition::LowerRight).background_style(WHITE.mix(0.8));
        labels.border_style(BLACK.mix(0.3)).draw()?;
        Ok(())
    })
}

/// Shares of the stages in the time of all: a bar for each scene.
pub fn stages(path: &Path, stages: &[StageRow]) -> Result<(), CliError> {
    let ran = |name: &&&str| stages.iter().any(|stage| stage.stage == **name);
    let names: Vec<&str> = STAGES.iter().filter(ran).copied().collect();
    let scenes: Vec<&[StageRow]> = stages.chunk_by(|a, b| a.scene == b.scene).collect();
    if scenes.is_empty() {
        return Ok(());
    }
    draw(path, (240 + 150 * scenes.len() as u32, 460), |area| {
        let (area, legend) = area.split_horizontally(90 + 150 * scenes.len() as i32);
        let mut chart = ChartBuilder::on(&area)
            .caption("time by stage", ("sans-serif", 16))
            .margin(10)
            .x_label_area_size(26)
            .y_label_area_size(48)
            .build_cartesian_2d(0.0..scenes.len() as f64, 0.0..1.0)?;
        let mut mesh = chart.configure_mesh();
        mesh.disable_x_mesh().disable_x_axis().light_line_style(TRANSPARENT);
        mesh.y_label_formatter(&|y| format!("{:.0} %", 100.0 * y)).draw()?;
        let inside = ("sans-serif", 12).into_text_style(&area).pos(Pos::new(HPos::Center, VPos::Center));
        let below = ("sans-serif", 13).into_text_style(&area).pos(Pos::new(HPos::Center, VPos::Top));
        for (place, scene) in scenes.iter().enumerate() {
            let (left, right, mut bottom) = (place as f64 + 0.15, place as f64 + 0.85, 0.0);
            for stage in *scene {
                let (color, top) = (color_of(stage.stage), bottom + stage.share);
                chart.draw_series([Rectangle::new([(left, bottom), (right, top)], color.filled())])?;
                // Where there is room.
                if stage.share > 0.04 {
                    let middle = chart.backend_coord(&(place as f64 + 0.5, 0.5 * (bottom + top)));
                    let fill = stage.lane_fill.map_or(String::new(), |fill| format!(", lanes {:.1} %", 100.0 * fill));
                    area.draw_text(&format!("{:.0} %{fill}", 100.0 * stage.share), &inside, local(&area, middle))?;
                }
                bottom = top;
            }
            let foot = chart.backend_coord(&(place as f64 + 0.5, 0.0));
            let (x, y) = local(&area, foot);
            area.draw_text(short(&scene[0].scene), &below, (x, y + 6))?;
        }
        // From the top as the bars are.
        for (line, name) in names.iter().rev().enumerate() {
            let y = 50 + 20 * line as i32;
            legend.draw(&Rectangle::new([(6, y), (18, y + 12)], color_of(name).filled()))?;
            legend.draw_text(name, &("sans-serif", 13).into_text_style(&legend), (24, y))?;
        }
        Ok(())
    })
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

/// A place in the picture as one in its area.
fn local(area: &Area, (x, y): (i32, i32)) -> (i32, i32) {
    let (left, top) = area.get_base_pixel();
    (x - left, y - top)
}

/// Colours that stages keep whatever else ran; lighter the second time around.
fn color_of(name: &str) -> RGBAColor {
    let place = STAGES.iter().position(|other| *other == name).unwrap_or(0);
    COLORS[place % COLORS.len()].mix(if place < COLORS.len() { 0.8 } else { 0.4 })
}
