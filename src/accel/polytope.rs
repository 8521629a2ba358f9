//! Convex cells, by their faces, and the little vector algebra that they need. In f64, so that what is cut off again and
//! again stays whole.

use super::space::{Bounds, Polygon, cut};

pub(super) fn minus(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

pub(super) fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| {
        let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
        a[j] * b[k] - a[k] * b[j]
    })
}

/// Normal of a polygon, as long as twice its area.
pub(super) fn area_vector(polygon: &[[f64; 3]]) -> [f64; 3] {
    let Some((first, rest)) = polygon.split_first() else { return [0.0; 3] };
    rest.windows(2).fold([0.0; 3], |sum, pair| {
        let part = cross(&minus(&pair[0], first), &minus(&pair[1], first));
        std::array::from_fn(|axis| sum[axis] + part[axis])
    })
}

pub(super) fn length(v: &[f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

/// A convex cell, by its faces, whose corners run counterclockwise seen from outside.
#[derive(Clone, Debug)]
pub(super) struct Polytope(pub Vec<Polygon>);

impl Polytope {
    /// A box.
    pub fn of_box(cell: &Bounds) -> Self {
        let corner = |bits: usize| -> [f64; 3] {
            std::array::from_fn(|axis| f64::from([cell.lower, cell.upper][bits >> axis & 1][axis]))
        };
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Self(faces.iter().map(|face| face.map(corner).to_vec()).collect())
    }

    /// Twice the area of the surface.
    pub fn area(&self) -> f64 {
        self.0.iter().map(|face| length(&area_vector(face))).sum()
    }

    /// Twice the areas of the two parts that a cut would make.
    ///
    /// The area vectors of a closed surface add up to zero, and so the new face's is that of what is open.
    pub fn areas(&self, spare: &mut Polygon, distance: impl Fn(&[f64; 3]) -> f64) -> [f64; 2] {
        let mut areas = [0.0; 2];
        let mut open = [0.0; 3];
        for face in &self.0 {
            cut(face, spare, |p| -distance(p));
            let below = area_vector(spare);
            areas[0] += length(&below);
            open = std::array::from_fn(|axis| open[axis] + below[axis]);
            cut(face, spare, &distance);
            areas[1] += length(&area_vector(spare));
        }
        areas.map(|area| area + length(&open))
    }

    /// The two parts.
    pub fn split(&self, distance: impl Fn(&[f64; 3]) -> f64) -> [Self; 2] {
        let mut parts = [Vec::new(), Vec::new()];
        let mut rim: Polygon = Vec::new();
        let mut open = [0.0; 3];
        for face in &self.0 {
            let [mut below, mut above] = [Vec::new(), Vec::new()];
            cut(face, &mut below, |p| -distance(p));
            cut(face, &mut above, &distance);
            if !below.is_empty() && !above.is_empty() {
                // Points of both parts are on the plane.
                rim.extend(below.iter().filter(|p| above.contains(p)));
            }
            let area = area_vector(&below);
            open = std::array::from_fn(|axis| open[axis] - area[axis]);
            [below, above].into_iter().zip(&mut parts).for_each(|(face, part)| {
                if face.len() > 2 {
                    part.push(face);
                }
            });
        }
        if rim.len() > 2 && length(&open) > 0.0 {
            // Around their middle, counterclockwise seen from above the plane.
            let count = rim.len() as f64;
            let middle = rim.iter().fold([0.0; 3], |sum: [f64; 3], p| std::array::from_fn(|i| sum[i] + p[i] / count));
            let right = minus(&rim[0], &middle);
            let up = cross(&open.map(|x| x / length(&open)), &right);
            let angle = |p: &[f64; 3]| {
                let p = minus(p, &middle);
                dot(&p, &up).atan2(dot(&p, &right))
            };
            rim.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
            parts[1].push(rim.iter().rev().copied().collect());
            parts[0].push(rim);
        }
        parts.map(Self)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Volume by the divergence theorem: pyramids from a point to the faces.
    pub(in crate::accel) fn volume(cell: &Polytope) -> f64 {
        let Some(apex) = cell.0.iter().flatten().next() else { return 0.0 };
        cell.0.iter().map(|face| dot(&area_vector(face), &minus(&face[0], apex)) / 6.0).sum()
    }

    /// A unit cube cut through the middle of its edges, askew: two halves, with the areas foretold.
    #[test]
    fn a_cube_cut_askew_has_two_halves_of_the_areas_foretold() {
        let cube = Polytope::of_box(&Bounds { lower: [0.0; 3], upper: [1.0; 3] });
        assert_eq!((cube.area(), volume(&cube)), (12.0, 1.0));
        let hexagonal = |p: &[f64; 3]| (p[0] + p[1] + p[2] - 1.5) / 3.0_f64.sqrt();
        let areas = cube.areas(&mut Vec::new(), hexagonal);
        // A regular hexagon with edges of √½.
        let hexagon = 1.5 * 3.0_f64.sqrt() * 0.5;
        for (part, area) in cube.split(hexagonal).iter().zip(areas) {
            assert_eq!(part.0.len(), 7);
            assert!((volume(part) - 0.5).abs() < 1e-12);
            assert!((area - (6.0 + 2.0 * hexagon)).abs() < 1e-12 && (part.area() - area).abs() < 1e-12);
        }
    }
}
