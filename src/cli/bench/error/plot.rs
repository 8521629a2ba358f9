//! The table as a picture.

use std::path::Path;

use plotters::prelude::*;

use super::{
    super::plot::{COLORS, decades, draw},
    report::{Render, Summary},
};
use crate::cli::error::CliError;

/// relMSE over seconds on logarithmic scales: a dot for each render, lines through the means, and how error falls that is
/// one over time.
pub fn error_over_time(path: &Path, summary: &Summary, renders: &[&Render]) -> Result<(), CliError> {
    let points = |statistic: usize| renders.iter().map(move |render| (render.seconds, render.relmse[statistic]));
    // Neither zero nor what is below it has a place on such a scale.
    let shown: Vec<(f64, f64)> = [0, 1].into_iter().flat_map(points).filter(is_shown).collect();
    let range = |of: fn(&(f64, f64)) -> f64| {
        shown.iter().map(of).fold((f64::MAX, 0.0), |(least, most), x| (x.min(least), f64::max(x, most)))
    };
    let ((first, last), (least, most)) = (range(|point| point.0), range(|point| point.1));
    if shown.is_empty() {
        return Ok(());
    }
    draw(path, (720, 480), |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(format!("relMSE over seconds: {}", summary.scene), ("sans-serif", 16))
            .margin(10)
            .x_label_area_size(36)
            .y_label_area_size(56)
            .build_cartesian_2d(decades(first, last).log_scale(), decades(least, most).log_scale())?;
        let power = |x: &f64| if (1e-3..1e4).contains(x) { format!("{x}") } else { format!("{x:e}") };
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(TRANSPARENT).x_labels(8).y_labels(8);
        mesh.x_label_formatter(&power).y_label_formatter(&power).x_desc("seconds").draw()?;
        for (statistic, name) in ["all pixels", "without the worst 0.1 %"].into_iter().enumerate() {
            let color = COLORS[statistic];
            let dots = points(statistic).filter(is_shown);
            chart.draw_series(dots.map(|point| Circle::new(point, 2, color.mix(0.5).filled())))?;
            let slope = summary.slope[statistic].map_or(String::new(), |slope| format!(", slope {:.2}", slope.value));
            let means = summary.budgets.iter().map(|it| (it.seconds.median, it.relmse[statistic])).filter(is_shown);
            chart
                .draw_series(LineSeries::new(means, color.stroke_width(2)))?
                .label(format!("{name}{slope}"))
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 14, y)], color.stroke_width(2)));
        }
        // From the first budget on, as far as the picture reaches.
        let grey = RGBColor(150, 150, 150);
        if let Some(start) = summary.budgets.iter().map(|it| (it.seconds.median, it.relmse[0])).find(is_shown) {
            let end = last.min(start.0 * start.1 / least);
            chart
                .draw_series(DashedLineSeries::new([start, (end, start.0 * start.1 / end)], 4, 4, grey.into()))?
                .label("one over time")
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 14, y)], grey));
        }
        let mut labels = chart.configure_series_labels();
        labels.position(SeriesLabelPosition::UpperRight).background_style(WHITE.mix(0.8));
        labels.border_style(BLACK.mix(0.3)).draw()?;
        Ok(())
    })
}

fn is_shown(point: &(f64, f64)) -> bool {
    point.0 > 0.0 && point.1 > 0.0 && point.1.is_finite()
}
