//! A tree of boxes that may be turned: that of [`Bvh2`], with oriented boxes where these are much smaller.
//!
//! Thin slanted things fill little of boxes along the axes. A turned box fits them, but for each the ray has to be turned
//! too, which costs as much as testing two boxes. So a node is turned only if that saves much of its surface.
//!
//! Hits stay within a [`Beam`]: turning a ray rounds it by less than 10 units of `ε` (2⁻²³) per distance to the farthest
//! corner, and what was 16 ε along an axis may be √3 times that in a turned frame; the beam is made three times as thick, 48 ε.

use rayon::prelude::*;

use super::{
    Bvh2, Cell, Counters, Nearest, Ray, Shape, Structure, TriangleHit,
    space::{Beam, Bounds, Soup, margin},
    structure::asked_by_walking,
};

/// Part of its surface that a box has to keep at most for being turned. Of 0.3, 0.5, 0.7 and 0.9 the smallest: hair and
/// railings gain about as much from all, and rays among crates and in an interior lose least.
const WORTH: f64 = 0.3;

/// Triangles below a node whose edges and normals are tried as axes.
const TRIED: usize = 4;

/// No turn.
const UPRIGHT: u32 = u32::MAX;

/// A frame with its origin near what it is for.
#[derive(Clone, Copy, Debug)]
struct Turn {
    /// Axes; nearly orthonormal, which nothing relies on.
    rows: [[f32; 3]; 3],
    center: [f32; 3],
}

/// A box in its frame.
#[derive(Clone, Copy, Debug)]
struct Oriented {
    bounds: Bounds,
    /// Its turn, or [`UPRIGHT`].
    turn: u32,
}

/// A binary tree of oriented boxes.
#[derive(Clone, Debug)]
pub struct Obb {
    tree: Bvh2,
    /// By node of the tree.
    boxes: Vec<Oriented>,
    turns: Vec<Turn>,
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Of unit length, if it has a length.
fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    (length > 0.0 && length < f64::INFINITY).then(|| v.map(|x| x / length))
}

/// In proportion to the surface.
fn area(bounds: &Bounds) -> f64 {
    let [x, y, z] = bounds.size();
    x * y + y * z + z * x
}

impl Turn {
    /// With an edge and the normal of a triangle as axes: the smallest box around a solid lies flush with edges of its hull
    /// (O'Rourke 1985, "Finding Minimal Enclosing Boxes").
    fn along(corners: &[[f32; 3]; 3], edge: usize, center: [f32; 3]) -> Option<Self> {
        let corners = corners.map(|corner| corner.map(f64::from));
        let between = |i: usize, j: usize| -> [f64; 3] {
            std::array::from_fn(|axis| corners[j % 3][axis] - corners[i % 3][axis])
        };
        let along = unit(between(edge, edge + 1))?;
        let normal = unit(cross(along, unit(between(edge, edge + 2))?))?;
        Some(Self { rows: [along, cross(normal, along), normal].map(|row| row.map(|x| x as f32)), center })
    }

    /// The box around triangles and where their hits may be, in this frame.
    fn bounds(&self, soup: &Soup, held: &[u32]) -> Bounds {
        let (mut lower, mut upper) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &index in held {
            // A distance in the world is one here, but for the rounding of the rows.
            let blur = 2.0 * soup.blur(index as usize);
            for corner in &soup.triangles[index as usize].1 {
                let p: [f64; 3] = std::array::from_fn(|axis| f64::from(corner[axis]) - f64::from(self.center[axis]));
                for (axis, row) in self.rows.iter().enumerate() {
                    let x = (0..3).map(|i| f64::from(row[i]) * p[i]).sum::<f64>();
                    lower[axis] = lower[axis].min(x - blur);
                    upper[axis] = upper[axis].max(x + blur);
                }
            }
        }
        Bounds { lower: lower.map(|x| (x as f32).next_down()), upper: upper.map(|x| (x as f32).next_up()) }
    }

    /// The corners of a box's faces, in the world, counter-clockwise seen from outside.
    fn faces(&self, bounds: &Bounds) -> Vec<Vec<[f64; 3]>> {
        let corner = |bits: usize| -> [f64; 3] {
            let p: [f32; 3] = std::array::from_fn(|i| [bounds.lower, bounds.upper][bits >> i & 1][i]);
            std::array::from_fn(|i| {
                let turned: f64 = (0..3).map(|row| f64::from(self.rows[row][i]) * f64::from(p[row])).sum();
                f64::from(self.center[i]) + turned
            })
        };
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        faces.map(|face| face.map(corner).to_vec()).to_vec()
    }

    /// The ray in this frame; `margin` is that of the ray in the world.
    #[inline(always)]
    fn beam(&self, ray: &Ray, margin: f32) -> Beam {
        let from: [f32; 3] = std::array::from_fn(|i| ray.origin[i] - self.center[i]);
        let turned = |v: [f32; 3]| self.rows.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
        let (origin, inverse) = (turned(from), turned(ray.direction).map(|d| 1.0 / d));
        let negative = inverse.map(|inverse| usize::from(inverse < 0.0));
        let aside = origin.map(|x| 3.0 * margin + f32::EPSILON * x.abs());
        let of = |sign: f32| -> [f32; 3] {
            std::array::from_fn(|i| {
                if negative[i] == 0 { origin[i] + sign * aside[i] } else { origin[i] - sign * aside[i] }
            })
        };
        Beam::between(of(1.0), of(-1.0), inverse, negative)
    }
}

impl Obb {
    /// Share of the nodes whose box is turned.
    pub fn turned(&self) -> f64 {
        self.turns.len() as f64 / self.boxes.len().max(1) as f64
    }

    /// See [`Bvh2::walk_within`].
    #[inline(always)]
    fn walk<C: Counters>(
        &self,
        ray: &Ray,
        t_end: f32,
        counters: &mut C,
        leaf: impl FnMut(std::ops::Range<u32>, &mut C) -> f32,
    ) {
        let upright = Beam::new(ray, &self.tree.soup.bounds);
        let margin = margin(ray, &self.tree.soup.bounds);
        let within = |node: u32, t_end: f32| {
            let Oriented { bounds, turn } = &self.boxes[node as usize];
            match self.turns.get(*turn as usize) {
                None => upright.within(bounds, t_end),
                Some(turn) => turn.beam(ray, margin).within(bounds, t_end),
            }
        };
        self.tree.walk_within(within, t_end, counters, leaf);
    }
}

impl Structure for Obb {
    const NAME: &'static str = "obb";

    fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        let tree = Bvh2::build(triangles);
        let fit = |node: usize| {
            let upright = tree.nodes[node].bounds;
            let held = tree.held(node as u32);
            let center: [f32; 3] = std::array::from_fn(|i| 0.5 * upright.lower[i] + 0.5 * upright.upper[i]);
            let tried = (0..TRIED.min(held.len())).map(|i| held[i * held.len() / TRIED.min(held.len())]);
            let frames = tried.flat_map(|index| (0..3).map(move |edge| (index, edge)));
            frames
                .filter_map(|(index, edge)| Turn::along(&tree.soup.triangles[index as usize].1, edge, center))
                .map(|turn| (turn, turn.bounds(&tree.soup, &held)))
                .filter(|(_, bounds)| area(bounds) <= WORTH * area(&upright))
                .min_by(|(_, a), (_, b)| area(a).total_cmp(&area(b)))
        };
        let fitted: Vec<_> = (0..tree.nodes.len()).into_par_iter().map(fit).collect();
        let (mut boxes, mut turns) = (Vec::with_capacity(tree.nodes.len()), Vec::new());
        for (node, fitted) in tree.nodes.iter().zip(fitted) {
            boxes.push(match fitted {
                None => Oriented { bounds: node.bounds, turn: UPRIGHT },
                Some((turn, bounds)) => {
                    turns.push(turn);
                    Oriented { bounds, turn: turns.len() as u32 - 1 }
                }
            });
        }
        Self { tree, boxes, turns }
    }

    fn cells(&self, visit: &mut dyn FnMut(Cell)) {
        let root = (!self.boxes.is_empty()).then_some((0, 0));
        let mut pending: Vec<_> = root.into_iter().collect();
        while let Some((index, depth)) = pending.pop() {
            let (node, Oriented { bounds, turn }) = (&self.tree.nodes[index], self.boxes[index]);
            let held = (node.count > 0).then_some(node.count as usize);
            match self.turns.get(turn as usize) {
                None => visit(bounds.cell(depth, held)),
                Some(turn) => visit(Cell { depth, held, shape: Shape::Convex(&turn.faces(&bounds)) }),
            }
            if held.is_none() {
                let first = node.first as usize;
                pending.extend([(first, depth + 1), (first + 1, depth + 1)]);
            }
        }
    }

    fn bytes(&self) -> usize {
        self.tree.bytes() + size_of_val(self.boxes.as_slice()) + size_of_val(self.turns.as_slice())
    }

    fn references(&self) -> usize {
        self.tree.references()
    }

    asked_by_walking!(tree.soup);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{Work, family::torus, slanted};

    /// Nodes, triangles for 2,000 rays.
    fn work<S: Structure>(triangles: &[[[f32; 3]; 3]]) -> Work {
        let (structure, mut work) = (S::build(triangles), Work::default());
        for (origin, direction, t_max) in slanted::rays(triangles, 2000, 1).0 {
            let ray = Ray::new(origin, direction);
            structure.nearest(&ray, &mut Nearest::none(t_max), |_, _| true, &mut work);
        }
        work
    }

    /// Around slanted bars most boxes are turned, and rays that pass by test fewer triangles; around things along the axes
    /// none is.
    #[test]
    fn slanted_things_get_turned_boxes_and_upright_ones_do_not() {
        for triangles in [slanted::hair(300), slanted::railing(100)] {
            assert!(Obb::build(&triangles).turned() > 0.3);
            let (upright, turned) = (work::<Bvh2>(&triangles), work::<Obb>(&triangles));
            assert!(2 * turned.triangles < upright.triangles, "{turned:?} {upright:?}");
        }
        let upright: Vec<_> =
            (0..100).flat_map(|i| slanted::bar([i as f64, 0.0, 0.0], [i as f64, 1.0, 0.0], [0.1, 0.1])).collect();
        assert_eq!(Obb::build(&upright).turned(), 0.0);
    }

    /// In its frame each box holds the corners of all triangles below it.
    #[test]
    fn boxes_enclose_their_subtrees() {
        for triangles in [slanted::hair(100), torus(20, 10), slanted::crates(50)] {
            let obb = Obb::build(&triangles);
            for (node, one) in obb.boxes.iter().enumerate() {
                for index in obb.tree.held(node as u32) {
                    for corner in obb.tree.soup.triangles[index as usize].1 {
                        let place = obb.turns.get(one.turn as usize).map_or(corner.map(f64::from), |turn| {
                            turn.rows.map(|row| {
                                (0..3)
                                    .map(|i| f64::from(row[i]) * (f64::from(corner[i]) - f64::from(turn.center[i])))
                                    .sum()
                            })
                        });
                        let Bounds { lower, upper } = one.bounds;
                        let holds = |axis: usize| (lower[axis].into()..=upper[axis].into()).contains(&place[axis]);
                        assert!((0..3).all(holds), "{node} {place:?}");
                    }
                }
            }
        }
    }
}
