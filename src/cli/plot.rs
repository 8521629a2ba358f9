//! What all plots have in common.

use std::{io::Write as _, path::Path};

use plotters::{coord::Shift, prelude::*};
use wavecast::film::write_file;

use super::error::CliError;

/// Colours that all eyes tell apart (Okabe, Ito 2008, "Color Universal Design", and one of the same kind).
pub const COLORS: [RGBColor; 8] = [
    RGBColor(213, 94, 0),
    RGBColor(0, 114, 178),
    RGBColor(0, 158, 115),
    RGBColor(230, 159, 0),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(120, 80, 40),
    RGBColor(200, 190, 30),
];

/// Where plots are drawn.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// What can go wrong while drawing.
pub type Problem = Box<dyn std::error::Error>;

/// Draws into a file, which appears whole or not at all.
pub fn draw(path: &Path, size: (u32, u32), paint: impl FnOnce(&Area) -> Result<(), Problem>) -> Result<(), CliError> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
    let painted = area.fill(&WHITE).map_err(Problem::from).and_then(|()| paint(&area));
    let painted = painted.and_then(|()| area.present().map_err(Problem::from));
    painted.map_err(|problem| CliError::Drawing { path: path.to_owned(), problem: problem.to_string() })?;
    drop(area);
    Ok(write_file(path, |file| file.write_all(svg.as_bytes()))?)
}

/// Around two numbers, from a power of ten to a power of ten; a little more, or the first of them has no label.
pub fn decades(least: f64, most: f64) -> std::ops::Range<f64> {
    let (from, to) = (least.log10().floor(), most.log10().ceil());
    10_f64.powf(from) * (1.0 - 1e-6)..10_f64.powf(to.max(from + 1.0)) * (1.0 + 1e-6)
}
