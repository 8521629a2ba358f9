//! `bench accel --draw`: where structures hold triangles, cut by a plane.

use std::path::Path;

use plotters::prelude::*;
use serde_json::json;
use wavecast::accel::{Cell, Shape};

use super::{
    Args,
    accel::Settings,
    contender::Contender,
    plot::{self, Problem},
    rays::Corners,
    subject::Subject,
};
use crate::cli::{Outcome, console::Console, error::CliError};

/// Pixels of the longer side.
const SIZE: f64 = 900.0;
/// Part of the picture around what is drawn.
const MARGIN: f64 = 0.02;
/// Leaves of as many triangles get the full colour.
const FULL: f64 = 16.0;

/// A plane across an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slice {
    axis: usize,
    /// Coordinate, m; in the middle of the scene if nothing is said.
    at: Option<f32>,
}

/// Such as `y` or `y=1.5`.
pub fn slice(text: &str) -> Result<Slice, String> {
    let (axis, at) = text.split_once('=').map_or((text, None), |(axis, at)| (axis, Some(at)));
    let axis = ["x", "y", "z"].iter().position(|name| *name == axis).ok_or("expected x, y or z, or such as y=1.5")?;
    Ok(Slice { axis, at: at.map(crate::cli::args::finite).transpose()? })
}

/// Draws every structure over every scene.
pub fn run(folder: &Path, args: &Args, settings: &Settings, console: &mut Console) -> Result<Outcome, CliError> {
    let mut written = Vec::new();
    for source in &args.scenes {
        let subject = Subject::new(source, args.view, console)?;
        let plane = Plane::new(args.slice.unwrap_or(Slice { axis: 2, at: None }), &subject.triangles);
        for (name, build) in &settings.chosen {
            let path = folder.join(format!("{}-{name}.svg", Subject::file_name(&subject.name)));
            plane.draw(&path, &*build(&subject.triangles), &subject.triangles)?;
            written.push(path.display().to_string());
        }
    }
    console.result(&written.join("\n"), || json!({ "pictures": written }));
    Ok(Outcome::Done)
}

type Flat = [f64; 2];

/// A plane through a scene and its picture.
struct Plane {
    axis: usize,
    at: f64,
    /// Axes of the picture: to the right, and upwards.
    shown: [usize; 2],
    /// Left and lower end.
    from: Flat,
    pixels_per_metre: f64,
    size: (u32, u32),
}

impl Plane {
    fn new(Slice { axis, at }: Slice, triangles: &[Corners]) -> Self {
        let ends = |axis: usize| {
            let all = triangles.iter().flatten().map(|corner| f64::from(corner[axis]));
            all.fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x), high.max(x)))
        };
        let shown = [[2, 1], [0, 2], [0, 1]][axis];
        let [width, height] = shown.map(|axis| (ends(axis).1 - ends(axis).0).max(1e-6));
        let margin = MARGIN * width.max(height);
        let pixels_per_metre = SIZE / (width.max(height) + 2.0 * margin);
        let pixels = |length: f64| ((length + 2.0 * margin) * pixels_per_metre).ceil() as u32;
        let (low, high) = ends(axis);
        Self {
            axis,
            at: at.map_or(0.5 * (low + high), f64::from),
            shown,
            from: shown.map(|axis| ends(axis).0 - margin),
            pixels_per_metre,
            size: (pixels(width), pixels(height)),
        }
    }

    /// Pixel of a point.
    fn pixel(&self, [right, up]: Flat) -> (i32, i32) {
        let x = (right - self.from[0]) * self.pixels_per_metre;
        let y = f64::from(self.size.1) - (up - self.from[1]) * self.pixels_per_metre;
        (x.round() as i32, y.round() as i32)
    }

    /// Where the edges of a polygon go through the plane.
    fn crossings(&self, polygon: &[[f64; 3]], into: &mut Vec<Flat>) {
        let next = polygon.iter().cycle().skip(1);
        for (p, q) in polygon.iter().zip(next) {
            let (a, b) = (p[self.axis] - self.at, q[self.axis] - self.at);
            if (a < 0.0) != (b < 0.0) {
                let share = a / (a - b);
                into.push(self.shown.map(|axis| p[axis] + share * (q[axis] - p[axis])));
            }
        }
    }

    /// The part of a cell in the plane, a convex polygon; nothing if it has none.
    fn section(&self, shape: Shape) -> Vec<Flat> {
        match shape {
            Shape::Box { lower, upper } => {
                let within = f64::from(lower[self.axis])..=f64::from(upper[self.axis]);
                if !within.contains(&self.at) {
                    return Vec::new();
                }
                let [(x0, x1), (y0, y1)] = self.shown.map(|axis| (f64::from(lower[axis]), f64::from(upper[axis])));
                vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
            }
            Shape::Convex(faces) => {
                let mut corners = Vec::new();
                faces.iter().for_each(|face| self.crossings(face, &mut corners));
                let count = corners.len() as f64;
                let [x, y] = corners.iter().fold([0.0; 2], |[x, y], p| [x + p[0] / count, y + p[1] / count]);
                let angle = |p: &Flat| (p[1] - y).atan2(p[0] - x);
                corners.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
                corners
            }
        }
    }

    /// What is divided further is drawn by its outline, thicker the fewer it is in; leaves over it by colour too,
    /// stronger the more triangles they refer to; triangles on top.
    fn draw(&self, path: &Path, structure: &dyn Contender, triangles: &[Corners]) -> Result<(), CliError> {
        let (mut outlines, mut leaves) = (Vec::new(), Vec::new());
        structure.cells(&mut |Cell { depth, held, shape }| {
            let section: Vec<_> = self.section(shape).into_iter().map(|point| self.pixel(point)).collect();
            if section.len() > 2 {
                match held {
                    None => outlines.push((depth, section)),
                    Some(count) => leaves.push((count, section)),
                }
            }
        });
        outlines.sort_by_key(|(depth, _)| std::cmp::Reverse(*depth));
        plot::draw(path, self.size, |area| {
            let closed = |section: &[(i32, i32)]| section.iter().chain(&section[..1]).copied().collect::<Vec<_>>();
            for (depth, section) in &outlines {
                let width = 4_u32.saturating_sub(*depth as u32).max(1);
                area.draw(&PathElement::new(closed(section), RGBColor(230, 159, 0).stroke_width(width)))?;
            }
            for (count, section) in leaves.iter().filter(|(count, _)| *count > 0) {
                let strength = 0.12 + 0.5 * (*count as f64 / FULL).min(1.0);
                area.draw(&Polygon::new(section.as_slice(), RGBColor(0, 114, 178).mix(strength)))?;
            }
            for (_, section) in &leaves {
                area.draw(&PathElement::new(closed(section), RGBColor(0, 90, 150).mix(0.6)))?;
            }
            for corners in triangles {
                let mut ends = Vec::new();
                self.crossings(&corners.map(|corner| corner.map(f64::from)), &mut ends);
                if ends.len() == 2 {
                    let ends: Vec<_> = ends.into_iter().map(|end| self.pixel(end)).collect();
                    area.draw(&PathElement::new(ends, RGBColor(150, 0, 0).stroke_width(2)))?;
                }
            }
            Ok::<(), Problem>(())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_read_as_the_help_writes_them() {
        assert_eq!(slice("x"), Ok(Slice { axis: 0, at: None }));
        assert_eq!(slice("y=1.5"), Ok(Slice { axis: 1, at: Some(1.5) }));
        for text in ["", "w", "y=", "y=high", "1.5"] {
            assert!(slice(text).is_err(), "{text}");
        }
    }

    /// A box cut across an axis, as a box and by its faces, is the same rectangle; beside it there is nothing.
    #[test]
    fn sections_of_a_box_do_not_depend_on_how_it_is_told() {
        let corner =
            |bits: usize| -> [f64; 3] { std::array::from_fn(|axis| [0.0, 1.0 + axis as f64][bits >> axis & 1]) };
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces: Vec<Vec<[f64; 3]>> = faces.iter().map(|face| face.map(corner).to_vec()).collect();
        let triangle = [[0.0; 3], [1.0, 2.0, 3.0], [1.0, 0.0, 0.0]];
        for (axis, area) in [(0, 6.0), (1, 3.0), (2, 2.0)] {
            let plane = Plane::new(Slice { axis, at: Some(0.5) }, &[triangle]);
            let of_box = plane.section(Shape::Box { lower: [0.0; 3], upper: [1.0, 2.0, 3.0] });
            let of_faces = plane.section(Shape::Convex(&faces));
            for section in [of_box, of_faces] {
                let next = section.iter().cycle().skip(1);
                let twice: f64 = section.iter().zip(next).map(|(p, q)| p[0] * q[1] - p[1] * q[0]).sum();
                assert!((twice / 2.0 - area).abs() < 1e-12, "{section:?}");
            }
            let beside = Plane { at: 4.0, ..plane };
            assert!(beside.section(Shape::Convex(&faces)).is_empty());
            assert!(beside.section(Shape::Box { lower: [0.0; 3], upper: [1.0, 2.0, 3.0] }).is_empty());
        }
    }
}
