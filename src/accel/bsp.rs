//! A binary space partition with planes of any direction: as a kd-tree, but cells that hold few triangles are cut along
//! their faces and edges.
//!
//! After Ize, Wald, Parker 2008, "Ray Tracing with the BSP Tree": planes are chosen by the surface area heuristic, with
//! the areas of the convex polytopes that cells are; candidates are the kd-tree's, the planes of triangles ("auto-
//! partition"), and planes through their edges upright on them; planes across axes are met at the kd-tree's price.
//! Trying all of these takes O(n²) in a cell. To build in the time of the other structures, cells are cut here as in a
//! [`super::KdTree`] until they hold few triangles.

use std::{iter::Copied, slice::Iter};

use super::{
    Cell, Counters, Nearest, Ray, Shape, Structure, TriangleHit,
    kdtree::{DEPTH as KD_DEPTH, EMPTY, MOST_REFERENCES, PARALLEL, Part, VISIT, best_plane, depth_for, divide},
    polytope::{Polytope, cross, dot, length, minus},
    space::{Beam, Bounds, Polygon, Scissors, Soup, cut, margin},
    structure::asked_by_walking,
};

/// Cells of no more triangles are cut by planes of any direction. More than this makes the build slower and not the
/// walk faster.
const FEW: usize = 16;

/// Cost of visiting a plane that is not across an axis, in tests of a triangle.
const VISIT_ASKEW: f64 = 2.0;

/// Planes of any direction above one another at most.
const FEW_DEPTH: usize = 12;

/// Deepest tree.
const DEPTH: usize = KD_DEPTH + FEW_DEPTH;

/// Marks a plane that is not across an axis, where others have their axis.
const ASKEW: u32 = 3;

/// Marks a leaf; higher marks are those of leaves with that many triangles more.
const LEAF: u32 = 4;

/// How much thicker a beam is across a plane askew than across one of an axis: √3 for the diagonal, the rest for the
/// roundings of two dot products over the way through the scene, and for triangles that poke through by the tolerance.
const ASKEW_SLACK: f32 = 4.0;

/// A plane and two children, or a leaf.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// Axis, [`ASKEW`], or [`LEAF`] and the number of triangles.
    kind: u32,
    /// Coordinate's bits, row of the plane, or first reference.
    at: u32,
    /// The upper child. The lower is next to this node.
    above: u32,
}

/// A plane by its unit normal and its distance from the centre of the mesh.
#[derive(Clone, Copy, Debug)]
struct Plane {
    normal: [f32; 3],
    offset: f32,
}

/// A binary space partition.
#[derive(Clone, Debug)]
pub struct Bsp {
    soup: Soup,
    /// Planes are relative to it, because far from zero their distances would be rounded too much.
    center: [f32; 3],
    nodes: Vec<Node>,
    planes: Vec<Plane>,
    references: Vec<u32>,
}

/// Where a cell is cut.
#[derive(Clone, Copy, Debug)]
enum Cut {
    Across(usize, f32),
    Askew(Plane),
}

/// A tree while it is built.
enum Tree {
    Leaf(Vec<u32>),
    Split(Cut, Box<[Tree; 2]>),
}

impl Cut {
    /// Of a point, above zero on the upper side.
    fn distance(&self, center: &[f32; 3], p: &[f64; 3]) -> f64 {
        match self {
            Self::Across(axis, at) => p[*axis] - f64::from(*at),
            Self::Askew(Plane { normal, offset }) => {
                let along = |axis: usize| f64::from(normal[axis]) * (p[axis] - f64::from(center[axis]));
                along(0) + along(1) + along(2) - f64::from(*offset)
            }
        }
    }

    fn cost(&self) -> f64 {
        match self {
            Self::Across(..) => VISIT,
            Self::Askew(_) => VISIT_ASKEW,
        }
    }
}

/// The part of a triangle in a cell.
#[derive(Clone, Debug)]
struct Piece {
    reference: u32,
    blur: f64,
    polygon: Polygon,
}

/// What is needed all through the build.
struct Builder<'a> {
    soup: &'a Soup,
    center: [f32; 3],
    /// Triangles that poke through a plane by less are not on its other side.
    tolerance: f64,
}

impl Builder<'_> {
    /// The plane through a point with a normal, if that is not zero.
    fn plane(&self, p: &[f64; 3], normal: &[f64; 3]) -> Option<Cut> {
        let scale = 1.0 / length(normal);
        let normal = normal.map(|x| (x * scale) as f32);
        let offset = dot(&normal.map(f64::from), &minus(p, &self.center.map(f64::from))) as f32;
        let finite = normal.iter().chain([&offset]).all(|x| x.is_finite());
        finite.then_some(Cut::Askew(Plane { normal, offset }))
    }

    /// Planes that may cut a cell well.
    fn candidates(&self, pieces: &[Piece]) -> Vec<Cut> {
        let mut cuts = Vec::new();
        for piece in pieces {
            for axis in 0..3 {
                let ends = piece.polygon.iter().map(|p| p[axis]);
                let (lower, upper) = ends.fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(x), b.max(x)));
                cuts.extend([Cut::Across(axis, lower as f32), Cut::Across(axis, upper as f32)]);
            }
            let corners = self.soup.triangles[piece.reference as usize].1.map(|corner| corner.map(f64::from));
            let [a, b, c] = &corners;
            let normal = cross(&minus(b, a), &minus(c, a));
            cuts.extend(self.plane(a, &normal));
            for (from, to) in [(a, b), (b, c), (c, a)] {
                cuts.extend(self.plane(from, &cross(&minus(to, from), &normal)));
            }
        }
        cuts
    }

    /// Whether a piece is below a cut and whether it is above.
    fn sides(&self, piece: &Piece, cut: &Cut) -> [bool; 2] {
        let (mut least, mut most) = (f64::MAX, f64::MIN);
        for p in &piece.polygon {
            let distance = cut.distance(&self.center, p);
            (least, most) = (least.min(distance), most.max(distance));
        }
        let above = most + piece.blur > self.tolerance;
        // What lies in the plane is below.
        [least - piece.blur < -self.tolerance || !above, above]
    }

    /// Cuts a cell of few triangles by planes of any direction.
    fn carve(&self, pieces: Vec<Piece>, cell: &Polytope, depth: usize, budget: usize) -> Tree {
        let leaf = |pieces: &[Piece]| Tree::Leaf(pieces.iter().map(|piece| piece.reference).collect());
        if depth == 0 || pieces.len() < 2 {
            return leaf(&pieces);
        }
        let area = cell.area();
        let mut spare = Vec::new();
        let mut best = (pieces.len() as f64, None);
        for candidate in self.candidates(&pieces) {
            let mut counts = [0; 2];
            for piece in &pieces {
                self.sides(piece, &candidate).into_iter().zip(&mut counts).for_each(|(is, n)| *n += usize::from(is));
            }
            let [below, above] = counts.map(|count| count as f64);
            let bonus = if below == 0.0 || above == 0.0 { EMPTY } else { 1.0 };
            // The parts have a larger surface than the whole; most candidates need no look at how large.
            if bonus * (candidate.cost() + below.min(above)) >= best.0 || counts[0] + counts[1] > budget {
                continue;
            }
            let areas = cell.areas(&mut spare, |p| candidate.distance(&self.center, p));
            // A cut that leaves one part empty of space, too, is none.
            if areas.iter().any(|part| *part < 1e-6 * area || *part > (1.0 - 1e-6) * area) {
                continue;
            }
            let cost = bonus * (candidate.cost() + (areas[0] * below + areas[1] * above) / area);
            if cost < best.0 {
                best = (cost, Some(candidate));
            }
        }
        let Some(best) = best.1 else { return leaf(&pieces) };
        let cells = cell.split(|p| best.distance(&self.center, p));
        let mut parts = [Vec::new(), Vec::new()];
        for piece in pieces {
            for side in (0..2).filter(|&side| self.sides(&piece, &best)[side]) {
                let mut polygon = Vec::new();
                let sign = if side == 0 { -1.0 } else { 1.0 };
                let reach = piece.blur + self.tolerance;
                cut(&piece.polygon, &mut polygon, |p| sign * best.distance(&self.center, p) + reach);
                parts[side].push(Piece { polygon, ..piece });
            }
        }
        let total = (parts[0].len() + parts[1].len()).max(1);
        let [below, above] = parts;
        let share = |part: &[Piece]| budget * part.len() / total;
        let (budget_below, budget_above) = (share(&below), share(&above));
        let children = [
            self.carve(below, &cells[0], depth - 1, budget_below),
            self.carve(above, &cells[1], depth - 1, budget_above),
        ];
        Tree::Split(best, Box::new(children))
    }

    /// Cuts a cell by planes across axes, until few triangles are left.
    fn grow(&self, parts: Vec<Part>, cell: &Bounds, depth: usize, budget: usize) -> Tree {
        let count = parts.len();
        if count <= FEW {
            let mut scissors = Scissors::default();
            let pieces = parts.iter().map(|part| {
                let blur = self.soup.blur(part.reference as usize);
                let corners = &self.soup.triangles[part.reference as usize].1;
                let polygon = scissors.clip(corners, &cell.padded(blur + self.tolerance)).to_vec();
                Piece { reference: part.reference, blur, polygon }
            });
            return self.carve(pieces.collect(), &Polytope::of_box(cell), FEW_DEPTH, budget);
        }
        let references = || Tree::Leaf(parts.iter().map(|part| part.reference).collect());
        let plane = if depth == 0 { None } else { best_plane(&parts, cell) };
        let Some(plane) = plane else { return references() };
        let [below, above] = divide(self.soup, parts.clone(), cell, &plane);
        let total = below.len() + above.len();
        if total > budget {
            return references();
        }
        drop(parts);
        let share = |count: usize| (budget as f64 * count as f64 / total.max(1) as f64) as usize;
        let budgets = [share(below.len()), share(above.len())];
        let cells = cell.split(plane.axis, plane.at);
        let below = || self.grow(below, &cells[0], depth - 1, budgets[0]);
        let above = || self.grow(above, &cells[1], depth - 1, budgets[1]);
        let (below, above) = if count < PARALLEL { (below(), above()) } else { rayon::join(below, above) };
        Tree::Split(Cut::Across(plane.axis, plane.at), Box::new([below, above]))
    }
}

impl Bsp {
    /// Appends a tree, a node before its lower child.
    fn append(&mut self, tree: Tree) {
        match tree {
            Tree::Leaf(references) => {
                let first = self.references.len() as u32;
                self.nodes.push(Node { kind: LEAF + references.len() as u32, at: first, above: 0 });
                self.references.extend(references);
            }
            Tree::Split(cut, children) => {
                let [below, above] = *children;
                let here = self.nodes.len();
                let (kind, at) = match cut {
                    Cut::Across(axis, at) => (axis as u32, at.to_bits()),
                    Cut::Askew(plane) => {
                        self.planes.push(plane);
                        (ASKEW, self.planes.len() as u32 - 1)
                    }
                };
                self.nodes.push(Node { kind, at, above: 0 });
                self.append(below);
                self.nodes[here].above = self.nodes.len() as u32;
                self.append(above);
            }
        }
    }

    /// Calls `leaf` with the references of the leaves that the ray goes through before `t_end`, in order; `leaf` returns
    /// the new `t_end`, below zero to end the walk.
    #[inline(always)]
    fn walk<C: Counters>(
        &self,
        ray: &Ray,
        mut t_end: f32,
        counters: &mut C,
        mut leaf: impl FnMut(Copied<Iter<u32>>, &mut C) -> f32,
    ) {
        let beam = Beam::new(ray, &self.soup.bounds);
        let (mut from, mut to) = beam.within(&self.soup.bounds, t_end);
        if self.nodes.is_empty() || from > to {
            return;
        }
        let thick = ASKEW_SLACK * margin(ray, &self.soup.bounds);
        let origin: [f32; 3] = std::array::from_fn(|axis| ray.origin[axis] - self.center[axis]);
        let mut stack = [(0_u32, 0.0, 0.0); DEPTH];
        let mut top = 0;
        let mut index = 0_u32;
        loop {
            counters.node();
            let node = self.nodes[index as usize];
            if node.kind < LEAF {
                let (early, late, negative) = if node.kind == ASKEW {
                    let Plane { normal: [x, y, z], offset } = self.planes[node.at as usize];
                    let apart = offset - (x * origin[0] + y * origin[1] + z * origin[2]);
                    let inverse = 1.0 / (x * ray.direction[0] + y * ray.direction[1] + z * ray.direction[2]);
                    let ahead = thick.copysign(inverse);
                    ((apart - ahead) * inverse, (apart + ahead) * inverse, usize::from(inverse < 0.0))
                } else {
                    let (axis, at) = (node.kind as usize, f32::from_bits(node.at));
                    (beam.early(axis, at), beam.late(axis, at), beam.negative(axis))
                };
                let children = [index + 1, node.above];
                let (near, far) = (children[negative], children[1 - negative]);
                if early > to {
                    index = near;
                } else if late < from {
                    index = far;
                } else {
                    // The beam may go through both; NaN (it runs in the plane) ends up here and changes nothing.
                    stack[top] = (far, if early > from { early } else { from }, to);
                    top += 1;
                    to = if late < to { late } else { to };
                    index = near;
                }
                continue;
            }
            let first = node.at as usize;
            let references = &self.references[first..first + (node.kind - LEAF) as usize];
            if !references.is_empty() {
                t_end = leaf(references.iter().copied(), counters);
            }
            loop {
                if top == 0 || t_end < 0.0 {
                    return;
                }
                top -= 1;
                (index, from, to) = stack[top];
                if from <= t_end {
                    to = if t_end < to { t_end } else { to };
                    break;
                }
            }
        }
    }
}

impl Structure for Bsp {
    const NAME: &'static str = "bsp";

    fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        let soup = Soup::new(triangles);
        let bounds = soup.bounds;
        let center = std::array::from_fn(|axis| 0.5 * bounds.lower[axis] + 0.5 * bounds.upper[axis]);
        let mut tree = Self { soup, center, nodes: Vec::new(), planes: Vec::new(), references: Vec::new() };
        let count = tree.soup.triangles.len();
        if count > 0 {
            let [x, y, z] = bounds.size();
            let tolerance = 1e-7 * x.max(y).max(z);
            let builder = Builder { soup: &tree.soup, center, tolerance };
            let grown = builder.grow(Part::all(&tree.soup), &bounds, depth_for(count), MOST_REFERENCES * count);
            tree.append(grown);
        }
        tree
    }

    fn bytes(&self) -> usize {
        self.soup.bytes()
            + size_of_val(self.nodes.as_slice())
            + size_of_val(self.planes.as_slice())
            + size_of_val(self.references.as_slice())
    }

    fn references(&self) -> usize {
        self.references.len()
    }

    fn cells(&self, visit: &mut dyn FnMut(Cell)) {
        let root = (!self.nodes.is_empty()).then(|| (0, Polytope::of_box(&self.soup.bounds), 0));
        let mut pending: Vec<_> = root.into_iter().collect();
        while let Some((index, cell, depth)) = pending.pop() {
            let Node { kind, at, above }: Node = self.nodes[index as usize];
            let held = (kind >= LEAF).then(|| (kind - LEAF) as usize);
            visit(Cell { depth, held, shape: Shape::Convex(&cell.0) });
            if held.is_none() {
                let cut = match kind {
                    ASKEW => Cut::Askew(self.planes[at as usize]),
                    axis => Cut::Across(axis as usize, f32::from_bits(at)),
                };
                let [lower, upper] = cell.split(|p| cut.distance(&self.center, p));
                pending.extend([(index + 1, lower, depth + 1), (above, upper, depth + 1)]);
            }
        }
    }

    asked_by_walking!();
}

#[cfg(test)]
mod tests;
