//! An oct-tree: cubes cut into eight where triangles are many (Glassner 1984, "Space Subdivision for Fast Ray Tracing").
//!
//! Unlike a kd-tree it cannot choose its planes, only where to stop. The walk goes from the root down and puts off the
//! children that come later, each with the part of the ray within it, as Revelles, Ureña, Lastra 2000, "An Efficient
//! Parametric Algorithm for Octree Traversal", do by recursion; but by the early and late distances of a [`Beam`], which
//! rounding does not break.

use std::{iter::Copied, slice::Iter};

use rayon::prelude::*;

use super::{
    Cell, Counters, Nearest, Ray, Structure, TriangleHit,
    space::{Beam, Bounds, Soup, overlaps},
    structure::asked_by_walking,
};

/// Cells of no more triangles are leaves.
const FEW: usize = 8;

/// Cost of visiting a node, in tests of a triangle.
const VISIT: usize = 4;

/// Deepest tree. Cells are then hardly larger than a beam is thick.
const DEPTH: usize = 18;

/// Most references for each triangle.
const MOST_REFERENCES: usize = 16;

/// Cells of fewer triangles are built without splitting the work.
const PARALLEL: usize = 4096;

/// Of each depth at most seven children are put off and an eighth is gone into.
const STACK: usize = 7 * DEPTH + 1;

/// A cell that is cut, or a leaf.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// Where it is cut across each axis.
    center: [f32; 3],
    /// Of a leaf its number, else the first of the children, which are side by side.
    first: u32,
    /// A bit for each child that holds something; others are not there. Bit 0 of a child's place is set for those of
    /// higher x, bit 1 for y, bit 2 for z. Zero for a leaf.
    filled: u8,
}

/// An oct-tree.
#[derive(Clone, Debug)]
pub struct Octree {
    soup: Soup,
    nodes: Vec<Node>,
    /// Where each leaf's references begin; one more than there are leaves.
    offsets: Vec<u32>,
    references: Vec<u32>,
}

/// A tree while it is built.
enum Tree {
    Leaf(Vec<u32>),
    Split([f32; 3], Vec<Tree>),
}

/// A cube around a box.
fn cube_around(bounds: &Bounds) -> Bounds {
    let [x, y, z] = bounds.size();
    let edge = x.max(y).max(z);
    let upper = |axis: usize| ((f64::from(bounds.lower[axis]) + edge) as f32).max(bounds.upper[axis]);
    Bounds { lower: bounds.lower, upper: std::array::from_fn(upper) }
}

/// Where a cell is cut.
fn center_of(cell: &Bounds) -> [f32; 3] {
    std::array::from_fn(|axis| 0.5 * cell.lower[axis] + 0.5 * cell.upper[axis])
}

/// The part of a cell at a place.
fn part_of(cell: &Bounds, center: [f32; 3], place: usize) -> Bounds {
    let above = |axis: usize| place >> axis & 1 == 1;
    Bounds {
        lower: std::array::from_fn(|axis| if above(axis) { center[axis] } else { cell.lower[axis] }),
        upper: std::array::from_fn(|axis| if above(axis) { cell.upper[axis] } else { center[axis] }),
    }
}

/// Which of the references are in each of the eight parts of a cell.
fn divide(soup: &Soup, references: &[u32], cell: &Bounds, center: [f32; 3]) -> [Vec<u32>; 8] {
    let boxes: [([f64; 3], [f64; 3]); 8] = std::array::from_fn(|place| {
        let part = part_of(cell, center, place);
        let half = part.size().map(|size| 0.5 * size);
        (std::array::from_fn(|axis| f64::from(part.lower[axis]) + half[axis]), half)
    });
    let mut parts: [Vec<u32>; 8] = Default::default();
    for &reference in references {
        let index = reference as usize;
        let bounds = soup.bounds_of(index);
        // Triangles that end at a plane are not beyond it, and those in it are below it.
        let above: [bool; 3] = std::array::from_fn(|axis| bounds.upper[axis] > center[axis]);
        let below: [bool; 3] = std::array::from_fn(|axis| bounds.lower[axis] < center[axis] || !above[axis]);
        let may_be = |place: &usize| (0..3).all(|axis| if place >> axis & 1 == 1 { above[axis] } else { below[axis] });
        let only = (0..3).all(|axis| above[axis] != below[axis]);
        for place in (0..8).filter(may_be) {
            let (center, half) = boxes[place];
            let pad = soup.blur(index);
            if only || overlaps(&soup.triangles[index].1, center, half.map(|half| half + pad)) {
                parts[place].push(reference);
            }
        }
    }
    parts
}

/// Cuts a cell until that is not worth it, or more than `budget` references would be needed.
fn grow(soup: &Soup, references: Vec<u32>, cell: &Bounds, depth: usize, budget: usize) -> Tree {
    let center = center_of(cell);
    let cut = (0..3).all(|axis| cell.lower[axis] < center[axis] && center[axis] < cell.upper[axis]);
    if depth == 0 || references.len() <= FEW || !cut {
        return Tree::Leaf(references);
    }
    let parts = divide(soup, &references, cell, center);
    let count = references.len();
    let total: usize = parts.iter().map(Vec::len).sum();
    // A ray that meets the cell meets a part, of a quarter of its area, with the probability of a quarter.
    if VISIT + total / 4 >= count || total > budget {
        return Tree::Leaf(references);
    }
    drop(references);
    let grow_part = |(place, part): (usize, Vec<u32>)| {
        let budget = (budget as f64 * part.len() as f64 / total as f64) as usize;
        let cell = part_of(cell, center, place);
        if part.is_empty() { Tree::Leaf(part) } else { grow(soup, part, &cell, depth - 1, budget) }
    };
    let children = if count < PARALLEL {
        parts.into_iter().enumerate().map(grow_part).collect()
    } else {
        parts.into_par_iter().enumerate().map(grow_part).collect()
    };
    Tree::Split(center, children)
}

impl Octree {
    /// Fills in the node `at` from a tree.
    fn put(&mut self, at: usize, tree: Tree) {
        match tree {
            Tree::Leaf(references) => {
                self.nodes[at] = Node { center: [0.0; 3], first: self.offsets.len() as u32 - 1, filled: 0 };
                self.references.extend(references);
                self.offsets.push(self.references.len() as u32);
            }
            Tree::Split(center, mut children) => {
                let full = |tree: &Tree| !matches!(tree, Tree::Leaf(references) if references.is_empty());
                let filled = (0..8).filter(|&place| full(&children[place])).fold(0, |bits, place| bits | 1 << place);
                children.retain(full);
                let first = self.nodes.len();
                self.nodes[at] = Node { center, first: first as u32, filled };
                self.nodes.resize(first + children.len(), Node { center: [0.0; 3], first: 0, filled: 0 });
                children.into_iter().enumerate().for_each(|(child, tree)| self.put(first + child, tree));
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
        let (from, to) = beam.within(&self.soup.bounds, t_end);
        if self.nodes.is_empty() || from > to {
            return;
        }
        // Of the children that a ray goes through, one that is further along an axis comes later. Counted from the
        // corner where the ray comes from, that is the order of their numbers.
        let corner = ray.negative(0) | ray.negative(1) << 1 | ray.negative(2) << 2;
        let mut stack = [(0_u32, 0.0, 0.0); STACK];
        stack[0] = (0, from, to);
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (index, from, to) = stack[top];
            if from > t_end {
                continue;
            }
            counters.node();
            let node = &self.nodes[index as usize];
            if node.filled == 0 {
                let range = self.offsets[node.first as usize] as usize..self.offsets[node.first as usize + 1] as usize;
                t_end = leaf(self.references[range].iter().copied(), counters);
                if t_end < 0.0 {
                    return;
                }
                continue;
            }
            let to = if t_end < to { t_end } else { to };
            // Of the halves across each axis, the near one is left late, the far one is entered early. NaN (the ray runs
            // in the plane) changes nothing.
            let early = [0, 1, 2].map(|axis| beam.early(axis, node.center[axis]));
            let late = [0, 1, 2].map(|axis| beam.late(axis, node.center[axis]));
            for number in (0..8_usize).rev() {
                let place = number ^ corner;
                if node.filled >> place & 1 == 0 {
                    continue;
                }
                let (mut from, mut to) = (from, to);
                for axis in 0..3 {
                    if number >> axis & 1 == 1 {
                        from = if early[axis] > from { early[axis] } else { from };
                    } else {
                        to = if late[axis] < to { late[axis] } else { to };
                    }
                }
                if from <= to {
                    let before = (node.filled & ((1 << place) - 1)).count_ones();
                    stack[top] = (node.first + before, from, to);
                    top += 1;
                }
            }
        }
    }
}

impl Structure for Octree {
    const NAME: &'static str = "octree";

    fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        let soup = Soup::new(triangles);
        let mut tree = Self { soup, nodes: Vec::new(), offsets: vec![0], references: Vec::new() };
        let count = tree.soup.triangles.len();
        if count > 0 {
            let cell = cube_around(&tree.soup.bounds);
            let grown = grow(&tree.soup, (0..count as u32).collect(), &cell, DEPTH, MOST_REFERENCES * count);
            tree.nodes.push(Node { center: [0.0; 3], first: 0, filled: 0 });
            tree.put(0, grown);
        }
        tree
    }

    fn bytes(&self) -> usize {
        self.soup.bytes()
            + size_of_val(self.nodes.as_slice())
            + size_of_val(self.offsets.as_slice())
            + size_of_val(self.references.as_slice())
    }

    fn references(&self) -> usize {
        self.references.len()
    }

    fn cells(&self, visit: &mut dyn FnMut(Cell)) {
        let root = (!self.nodes.is_empty()).then(|| (0, cube_around(&self.soup.bounds), 0));
        let mut pending: Vec<_> = root.into_iter().collect();
        while let Some((index, cell, depth)) = pending.pop() {
            let node: Node = self.nodes[index];
            if node.filled == 0 {
                let held = self.offsets[node.first as usize + 1] - self.offsets[node.first as usize];
                visit(cell.cell(depth, Some(held as usize)));
                continue;
            }
            visit(cell.cell(depth, None));
            let mut child = node.first as usize;
            for place in 0..8 {
                let part = part_of(&cell, node.center, place);
                if node.filled >> place & 1 == 1 {
                    pending.push((child, part, depth + 1));
                    child += 1;
                } else {
                    visit(part.cell(depth + 1, Some(0)));
                }
            }
        }
    }

    asked_by_walking!();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::family::{check_leaves, numbers, scenes, soup, torus};

    /// Cells of the leaves with their references, those that hold nothing too; and the depth of the deepest.
    fn leaves(tree: &Octree) -> (Vec<(Bounds, Vec<u32>)>, usize) {
        let (mut leaves, mut deepest) = (Vec::new(), 0);
        let mut pending = vec![(0, cube_around(&tree.soup.bounds), 0)];
        while let Some((index, cell, depth)) = pending.pop() {
            deepest = deepest.max(depth);
            let node: Node = tree.nodes[index];
            if node.filled == 0 {
                let range = tree.offsets[node.first as usize] as usize..tree.offsets[node.first as usize + 1] as usize;
                leaves.push((cell, tree.references[range].to_vec()));
                continue;
            }
            assert_eq!(node.center, center_of(&cell));
            let mut child = node.first as usize;
            for place in 0..8 {
                let part = part_of(&cell, node.center, place);
                if node.filled >> place & 1 == 1 {
                    pending.push((child, part, depth + 1));
                    child += 1;
                } else {
                    leaves.push((part, Vec::new()));
                }
            }
        }
        (leaves, deepest)
    }

    #[test]
    fn leaves_divide_space_and_refer_to_what_is_in_them() {
        for (name, triangles) in scenes() {
            let tree = Octree::build(&triangles);
            if !tree.nodes.is_empty() {
                let (leaves, deepest) = leaves(&tree);
                assert!(deepest <= DEPTH);
                assert_eq!(leaves.iter().map(|(_, references)| references.len()).sum::<usize>(), tree.references());
                check_leaves(name, &tree.soup, &leaves);
            }
        }
    }

    /// The parts of the ray within the leaves that it comes to begin one after the other.
    #[test]
    fn leaves_are_visited_in_order() {
        let tree = Octree::build(&torus(40, 30));
        let mut cells = std::collections::HashMap::<Vec<u32>, Vec<Bounds>>::new();
        for (cell, references) in leaves(&tree).0 {
            cells.entry(references).or_default().push(cell);
        }
        let mut u = numbers(9);
        let mut visited = 0;
        for _ in 0..500 {
            let ray = Ray::new([u() - 0.5, u() - 0.5, 2.0], [u() - 0.5, u() - 0.5, -1.0]);
            let beam = Beam::new(&ray, &tree.soup.bounds);
            let mut entered = 0.0;
            tree.walk(&ray, f32::INFINITY, &mut (), |references, ()| {
                let references: Vec<u32> = references.collect();
                // Neighbours overlap by the thickness of the beam.
                let within = cells[&references].iter().map(|cell| beam.within(cell, f32::INFINITY));
                let from = within.filter(|(from, to)| from <= to && *from >= entered - 1e-4).map(|(from, _)| from);
                entered = from.min_by(f32::total_cmp).expect("a cell with these references, not before the last");
                visited += 1;
                f32::INFINITY
            });
        }
        assert!(visited > 500, "{visited}");
    }

    /// Many triangles in one place, or through all of space, are not cut up for ever.
    #[test]
    fn hard_meshes_have_bounded_memory() {
        let tree = Octree::build(&soup(2000, 1.0, 8));
        assert!(tree.references() <= MOST_REFERENCES * 2000, "{}", tree.references());
        let tree = Octree::build(&vec![soup(1, 1.0, 8)[0]; 5000]);
        assert!(tree.references() <= MOST_REFERENCES * 5000, "{}", tree.references());
        let small = [[0.7, 0.7, 0.7], [0.700_001, 0.7, 0.7], [0.7, 0.700_001, 0.7]];
        let tree = Octree::build(&[vec![small; 1000], vec![[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]]].concat());
        assert!(tree.nodes.len() <= 8 * 8 * DEPTH, "{}", tree.nodes.len());
    }
}
