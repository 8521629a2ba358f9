//! A kd-tree: space halved again and again by planes across the axes, placed by the surface area heuristic.
//!
//! Built from the root down. Candidates for a plane are the ends of the triangles' extents, each clipped to the cell
//! ("perfect splits"), sorted anew in each cell: Wald, Havran 2006, "On building fast kd-Trees for Ray Tracing, and on
//! doing that in O(N log N)", whose second algorithm it is, O(n log² n). Since counts do not depend on which triangle an
//! extent belongs to, it is enough to sort bare numbers. Only triangles that a plane goes through are clipped anew.

use std::{iter::Copied, slice::Iter};

use rayon::prelude::*;

use super::{
    Cell, Counters, Nearest, Ray, Structure, TriangleHit,
    space::{Beam, Bounds, Scissors, Soup},
    structure::asked_by_walking,
};

/// Cost of visiting a node, in tests of a triangle. Of 0.4, 0.7, 1.5 and 3 this made the fastest walks in a torus and
/// in a soup of 100,000 triangles.
pub(super) const VISIT: f64 = 1.5;

/// What is left of the cost of a plane that cuts off empty space (Wald, Havran 2006).
pub(super) const EMPTY: f64 = 0.8;

/// Most references for each triangle. Meshes have two to five; the bound is for triangles that cross each other all over.
pub(super) const MOST_REFERENCES: usize = 16;

/// Cells of fewer triangles are built without splitting the work.
pub(super) const PARALLEL: usize = 4096;

/// Deepest tree.
pub(super) const DEPTH: usize = 56;

/// Marks a leaf where others have their axis.
const LEAF: u32 = 3;

/// A plane with two children, or a leaf (Pharr, Jakob, Humphreys 2016, "Physically Based Rendering", section 4.4.1).
#[derive(Clone, Copy, Debug)]
struct Node {
    /// Where the plane is; of a leaf the bits of its first reference.
    at: f32,
    /// Axis in the lower two bits; above them the index of the upper child (the lower is next to this node), or the
    /// leaf's count.
    word: u32,
}

/// A kd-tree.
#[derive(Clone, Debug)]
pub struct KdTree {
    soup: Soup,
    nodes: Vec<Node>,
    references: Vec<u32>,
}

/// A triangle in a cell: the box around the part of it that is in there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    pub reference: u32,
    pub bounds: Bounds,
}

impl Part {
    /// All of every triangle.
    pub fn all(soup: &Soup) -> Vec<Self> {
        let part = |index| Self { reference: index as u32, bounds: soup.bounds_of(index) };
        (0..soup.triangles.len()).into_par_iter().map(part).collect()
    }
}

/// A tree while it is built.
enum Tree {
    Leaf(Vec<u32>),
    Split(usize, f32, Box<[Tree; 2]>),
}

/// A plane and what it costs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub axis: usize,
    pub at: f32,
    cost: f64,
    /// True if triangles in the plane go below.
    below: bool,
}

/// Depth worth allowing for so many triangles (Pharr, Jakob, Humphreys 2016, section 4.4.2).
pub(super) fn depth_for(count: usize) -> usize {
    (8.0 + 1.3 * (count as f64).log2()).round().min(DEPTH as f64) as usize
}

/// The best plane across any axis, if it costs less than a leaf.
pub(super) fn best_plane(parts: &[Part], cell: &Bounds) -> Option<Candidate> {
    let best = |axis| best_across(parts, cell, axis, parts.len() as f64);
    let planes: [_; 3] = if parts.len() < PARALLEL {
        [0, 1, 2].map(best)
    } else {
        let (x, (y, z)) = rayon::join(|| best(0), || rayon::join(|| best(1), || best(2)));
        [x, y, z]
    };
    planes.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost))
}

/// The best plane across one axis, if it costs less than `cost`.
fn best_across(parts: &[Part], cell: &Bounds, axis: usize, cost: f64) -> Option<Candidate> {
    let (mut lower, mut upper) = (Vec::with_capacity(parts.len()), Vec::with_capacity(parts.len()));
    // Where the triangles lie that are in a plane across the axis.
    let mut flat = Vec::new();
    for Part { bounds, .. } in parts {
        if bounds.lower[axis] == bounds.upper[axis] {
            flat.push(bounds.lower[axis]);
        } else {
            lower.push(bounds.lower[axis]);
            upper.push(bounds.upper[axis]);
        }
    }
    for ends in [&mut lower, &mut upper, &mut flat] {
        ends.sort_unstable_by(f32::total_cmp);
    }
    let [x, y, z] = [axis, (axis + 1) % 3, (axis + 2) % 3].map(|axis| cell.size()[axis]);
    let (across, around) = (y * z, y + z);
    let area = across + x * around;
    let mut best: Option<Candidate> = None;
    // So many of each have been passed.
    let (mut i, mut j, mut k) = (0, 0, 0);
    loop {
        let next = |ends: &[f32], at: usize| ends.get(at).copied().unwrap_or(f32::INFINITY);
        let at = next(&lower, i).min(next(&upper, j)).min(next(&flat, k));
        if at >= cell.upper[axis] {
            return best;
        }
        while j < upper.len() && upper[j] <= at {
            j += 1;
        }
        let flats_below = k;
        while k < flat.len() && flat[k] <= at {
            k += 1;
        }
        // Those that begin here are above, those that end here are below.
        let (below, above) = (i + flats_below, upper.len() - j + flat.len() - k);
        let flats = k - flats_below;
        while i < lower.len() && lower[i] <= at {
            i += 1;
        }
        if at <= cell.lower[axis] {
            continue;
        }
        let area_below = across + (f64::from(at) - f64::from(cell.lower[axis])) * around;
        let area_above = across + (f64::from(cell.upper[axis]) - f64::from(at)) * around;
        for flats_go_below in [true, false] {
            let (below, above) = if flats_go_below { (below + flats, above) } else { (below, above + flats) };
            let tests = (area_below * below as f64 + area_above * above as f64) / area;
            let bonus = if below == 0 || above == 0 { EMPTY } else { 1.0 };
            let found = bonus * (VISIT + tests);
            if found < best.map_or(cost, |best| best.cost) {
                best = Some(Candidate { axis, at, cost: found, below: flats_go_below });
            }
        }
    }
}

/// What is in the cell below the plane and in the one above it.
pub(super) fn divide(soup: &Soup, parts: Vec<Part>, cell: &Bounds, plane: &Candidate) -> [Vec<Part>; 2] {
    let Candidate { axis, at, .. } = *plane;
    let cells = cell.split(axis, at);
    let mut scissors = Scissors::default();
    let mut sides = [Vec::new(), Vec::new()];
    for part in parts {
        let (lower, upper) = (part.bounds.lower[axis], part.bounds.upper[axis]);
        if lower == at && upper == at {
            sides[usize::from(!plane.below)].push(part);
        } else if upper <= at {
            sides[0].push(part);
        } else if lower >= at {
            sides[1].push(part);
        } else {
            let corners = &soup.triangles[part.reference as usize].1;
            let blur = soup.blur(part.reference as usize);
            for (side, cell) in cells.iter().enumerate() {
                if let Some(bounds) = scissors.clipped_bounds(corners, blur, cell) {
                    let bounds = bounds.intersection(&part.bounds);
                    if bounds.valid() {
                        sides[side].push(Part { bounds, ..part });
                    }
                }
            }
        }
    }
    sides
}

/// Divides a cell until that is not worth it, or more than `budget` references would be needed.
fn grow(soup: &Soup, parts: Vec<Part>, cell: &Bounds, depth: usize, budget: usize) -> Tree {
    let leaf = |parts: Vec<Part>| Tree::Leaf(parts.iter().map(|part| part.reference).collect());
    if depth == 0 {
        return leaf(parts);
    }
    let Some(plane) = best_plane(&parts, cell) else {
        return leaf(parts);
    };
    let count = parts.len();
    let references: Vec<u32> =
        if count > budget / 2 { parts.iter().map(|part| part.reference).collect() } else { Vec::new() };
    let [below, above] = divide(soup, parts, cell, &plane);
    let total = below.len() + above.len();
    if total > budget {
        return Tree::Leaf(references);
    }
    let share = |count: usize| (budget as f64 * count as f64 / total.max(1) as f64) as usize;
    let budgets = [share(below.len()), share(above.len())];
    let cells = cell.split(plane.axis, plane.at);
    let below = || grow(soup, below, &cells[0], depth - 1, budgets[0]);
    let above = || grow(soup, above, &cells[1], depth - 1, budgets[1]);
    let (below, above) = if count < PARALLEL { (below(), above()) } else { rayon::join(below, above) };
    Tree::Split(plane.axis, plane.at, Box::new([below, above]))
}

impl KdTree {
    /// Appends a tree, a node before its lower child.
    fn append(&mut self, tree: Tree) {
        match tree {
            Tree::Leaf(references) => {
                let first = f32::from_bits(self.references.len() as u32);
                self.nodes.push(Node { at: first, word: LEAF | (references.len() as u32) << 2 });
                self.references.extend(references);
            }
            Tree::Split(axis, at, children) => {
                let [below, above] = *children;
                let here = self.nodes.len();
                self.nodes.push(Node { at, word: 0 });
                self.append(below);
                self.nodes[here].word = axis as u32 | (self.nodes.len() as u32) << 2;
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
        let mut stack = [(0_u32, 0.0, 0.0); DEPTH];
        let mut top = 0;
        let mut index = 0_u32;
        loop {
            counters.node();
            let node = self.nodes[index as usize];
            let axis = (node.word & 3) as usize;
            if node.word & 3 != LEAF {
                let (early, late) = (beam.early(axis, node.at), beam.late(axis, node.at));
                let children = [index + 1, node.word >> 2];
                let (near, far) = (children[beam.negative(axis)], children[1 - beam.negative(axis)]);
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
            let first = node.at.to_bits() as usize;
            let references = &self.references[first..first + (node.word >> 2) as usize];
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

impl Structure for KdTree {
    const NAME: &'static str = "kdtree";

    fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        let soup = Soup::new(triangles);
        let mut tree = Self { soup, nodes: Vec::new(), references: Vec::new() };
        if tree.soup.triangles.is_empty() {
            return tree;
        }
        let parts = Part::all(&tree.soup);
        let count = parts.len();
        let grown = grow(&tree.soup, parts, &tree.soup.bounds, depth_for(count), MOST_REFERENCES * count);
        tree.append(grown);
        tree
    }

    fn bytes(&self) -> usize {
        self.soup.bytes() + size_of_val(self.nodes.as_slice()) + size_of_val(self.references.as_slice())
    }

    fn references(&self) -> usize {
        self.references.len()
    }

    fn cells(&self, visit: &mut dyn FnMut(Cell)) {
        let root = (!self.nodes.is_empty()).then_some((0, self.soup.bounds, 0));
        let mut pending: Vec<_> = root.into_iter().collect();
        while let Some((index, cell, depth)) = pending.pop() {
            let node: Node = self.nodes[index as usize];
            let kind = node.word & 3;
            visit(cell.cell(depth, (kind == LEAF).then_some((node.word >> 2) as usize)));
            if kind != LEAF {
                let [below, above] = cell.split(kind as usize, node.at);
                pending.extend([(index + 1, below, depth + 1), (node.word >> 2, above, depth + 1)]);
            }
        }
    }

    asked_by_walking!();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::family::{check_leaves, scenes, soup};

    /// Cells of the leaves with their references, and the depth of the deepest.
    fn leaves(tree: &KdTree) -> (Vec<(Bounds, Vec<u32>)>, usize) {
        let (mut leaves, mut deepest) = (Vec::new(), 0);
        let mut pending = vec![(0, tree.soup.bounds, 0)];
        while let Some((index, cell, depth)) = pending.pop() {
            deepest = deepest.max(depth);
            let node = tree.nodes[index as usize];
            if node.word & 3 == LEAF {
                let first = node.at.to_bits() as usize;
                leaves.push((cell, tree.references[first..first + (node.word >> 2) as usize].to_vec()));
            } else {
                let [below, above] = cell.split((node.word & 3) as usize, node.at);
                pending.extend([(index + 1, below, depth + 1), (node.word >> 2, above, depth + 1)]);
            }
        }
        (leaves, deepest)
    }

    #[test]
    fn leaves_divide_space_and_refer_to_what_is_in_them() {
        for (name, triangles) in scenes() {
            let tree = KdTree::build(&triangles);
            if !tree.nodes.is_empty() {
                let (leaves, deepest) = leaves(&tree);
                assert!(deepest <= DEPTH);
                assert_eq!(leaves.iter().map(|(_, references)| references.len()).sum::<usize>(), tree.references());
                check_leaves(name, &tree.soup, &leaves);
            }
        }
    }

    /// 2,000 triangles as large as the whole: no more references than allowed.
    #[test]
    fn triangles_that_cross_each_other_all_over_have_bounded_memory() {
        let tree = KdTree::build(&soup(2000, 1.0, 8));
        assert!(tree.references() <= MOST_REFERENCES * 2000, "{}", tree.references());
        let tree = KdTree::build(&vec![soup(1, 1.0, 8)[0]; 5000]);
        assert!(tree.references() <= 2 * 5000, "{}", tree.references());
    }

    /// Triangles at both ends of a long box: the middle is cut out.
    #[test]
    fn empty_space_is_cut_off() {
        let near = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]];
        let far = near.map(|[x, y, z]| [x + 9.0, y, z]);
        let (leaves, _) = leaves(&KdTree::build(&[near, near, near, near, far, far, far, far]));
        let empty = leaves.iter().find(|(_, references)| references.is_empty()).expect("a leaf without triangles");
        assert_eq!((empty.0.lower[0], empty.0.upper[0]), (1.0, 9.0));
    }
}
