//! A bounding volume hierarchy in its textbook form: a binary tree of boxes, walked by one ray with a stack.
//!
//! The tree is built by obvhs: locally-ordered clustering (Meister, Bittner 2018, "Parallel Locally-Ordered
//! Clustering for Bounding Volume Hierarchy Construction"), then subtrees are put elsewhere where that lowers the surface
//! area heuristic, and small ones become leaves by the same measure.

use std::time::Duration;

use glam::Vec3A;
use obvhs::{
    BvhBuildParams,
    aabb::Aabb,
    bvh2::{builder::build_bvh2, node::Bvh2Node},
};
use rayon::prelude::*;

use super::{
    Cell, Counters, Nearest, Ray, Structure, TriangleHit,
    space::{Beam, Bounds, Soup},
    structure::asked_by_walking,
};

/// Triangles in a leaf at most. The builder makes fewer where its cost says so.
const LEAF: u32 = 4;

/// Cost of two boxes in tests of a triangle, for the builder. Of 1.5, 3 and 6 it made the fastest walks in a soup of
/// 100,000 triangles; in a torus they were alike.
const VISIT: f32 = 1.5;

/// Deepest tree whose stack is kept on the machine's; deeper ones, which no ordinary mesh has, are given one per walk.
const DEPTH: usize = 64;

/// By what part of their size boxes are made uneven for the builder. It pairs neighbours, and where all are equally near
/// it takes n² time and n levels: 87 s for 100,000 equal triangles in a row.
const UNEVEN: f32 = 1e-3;

/// A number in [0, 1) for a row: the golden ratio's multiples (Knuth 1998, "Sorting and Searching", section 6.4).
fn scattered(row: usize) -> f32 {
    let mixed = (row as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((mixed ^ mixed >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f32 / 16_777_216.0
}

/// A box and what is in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    pub bounds: Bounds,
    /// Of a leaf its first triangle, else the first of two children side by side.
    pub(super) first: u32,
    /// Triangles in a leaf; zero for others.
    pub(super) count: u32,
}

/// A binary tree of boxes.
#[derive(Clone, Debug)]
pub struct Bvh2 {
    pub(super) nodes: Vec<Node>,
    /// Leaf after leaf.
    pub(super) soup: Soup,
    depth: usize,
}

impl Bvh2 {
    /// [`Bvh2::walk_within`] the boxes of the tree.
    #[inline(always)]
    fn walk<C: Counters>(
        &self,
        ray: &Ray,
        t_end: f32,
        counters: &mut C,
        leaf: impl FnMut(std::ops::Range<u32>, &mut C) -> f32,
    ) {
        let beam = Beam::new(ray, &self.soup.bounds);
        let within = |node: u32, t_end| beam.within(&self.nodes[node as usize].bounds, t_end);
        self.walk_within(within, t_end, counters, leaf);
    }

    /// Indices of the triangles below a node.
    pub(super) fn held(&self, node: u32) -> Vec<u32> {
        let (mut held, mut pending) = (Vec::new(), vec![node]);
        while let Some(index) = pending.pop() {
            let Node { first, count, .. } = self.nodes[index as usize];
            match count {
                0 => pending.extend([first + 1, first]),
                _ => held.extend(first..first + count),
            }
        }
        held
    }

    /// Calls `leaf(positions)` for the leaves that the ray may meet before `t_end`, near children first; `leaf` returns the
    /// new `t_end`, below zero to end the walk. `within` gives the distances from and up to which the ray is in a node's
    /// box, within 0 to `t_end`.
    #[inline(always)]
    pub(super) fn walk_within<C: Counters>(
        &self,
        within: impl Fn(u32, f32) -> (f32, f32),
        mut t_end: f32,
        counters: &mut C,
        mut leaf: impl FnMut(std::ops::Range<u32>, &mut C) -> f32,
    ) {
        let mut ordinary = [(0.0, 0); DEPTH];
        let mut deep = Vec::new();
        let stack = if self.depth <= DEPTH {
            &mut ordinary[..]
        } else {
            deep.resize(self.depth, (0.0, 0));
            &mut deep
        };
        let mut top = 0;
        let Some(mut node) = self.nodes.first() else { return };
        counters.node();
        let (from, to) = within(0, t_end);
        if from > to {
            return;
        }
        loop {
            if node.count == 0 {
                let children = &self.nodes[node.first as usize..][..2];
                let [(from_0, to_0), (from_1, to_1)] = [0, 1].map(|child| {
                    counters.node();
                    within(node.first + child as u32, t_end)
                });
                match (from_0 <= to_0, from_1 <= to_1) {
                    (true, true) => {
                        let second = usize::from(from_0 <= from_1);
                        stack[top] = (from_0.max(from_1), node.first + second as u32);
                        top += 1;
                        node = &children[1 - second];
                        continue;
                    }
                    (true, false) => {
                        node = &children[0];
                        continue;
                    }
                    (false, true) => {
                        node = &children[1];
                        continue;
                    }
                    (false, false) => {}
                }
            } else {
                t_end = leaf(node.first..node.first + node.count, counters);
                if t_end < 0.0 {
                    return;
                }
            }
            loop {
                if top == 0 {
                    return;
                }
                top -= 1;
                let (from, put_off) = stack[top];
                if from <= t_end {
                    node = &self.nodes[put_off as usize];
                    break;
                }
            }
        }
    }
}

impl Structure for Bvh2 {
    const NAME: &'static str = "bvh2";

    fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        let mut soup = Soup::new(triangles);
        if soup.triangles.is_empty() {
            return Self { nodes: Vec::new(), soup, depth: 0 };
        }
        let center: [f32; 3] = std::array::from_fn(|i| 0.5 * soup.bounds.lower[i] + 0.5 * soup.bounds.upper[i]);
        let boxes: Vec<Aabb> = (0..soup.triangles.len())
            .into_par_iter()
            .map(|index| {
                let bounds = soup.bounds_of(index);
                let lower: [f32; 3] = std::array::from_fn(|axis| bounds.lower[axis] - center[axis]);
                let upper = std::array::from_fn(|axis| {
                    let size = bounds.upper[axis] - bounds.lower[axis];
                    lower[axis] + size * (1.0 + UNEVEN * scattered(3 * index + axis))
                });
                Aabb::new(Vec3A::from_array(lower), Vec3A::from_array(upper))
            })
            .collect();
        let params = BvhBuildParams {
            max_prims_per_leaf: LEAF,
            collapse_traversal_cost: VISIT,
            ..BvhBuildParams::medium_build()
        };
        let built = build_bvh2(&boxes, params, &mut Duration::default());
        soup.triangles = built.primitive_indices.iter().map(|&index| soup.triangles[index as usize]).collect();
        let node = |node: &Bvh2Node| Node { bounds: Bounds::EMPTY, first: node.first_index, count: node.prim_count };
        let mut nodes: Vec<Node> = built.nodes.iter().map(node).collect();
        // Parents before children, then boxes the other way.
        let (mut order, mut depth) = (Vec::with_capacity(nodes.len()), 0);
        let mut pending = vec![(0, 0)];
        while let Some((index, above)) = pending.pop() {
            order.push(index as usize);
            depth = depth.max(above);
            let node = &nodes[index as usize];
            if node.count == 0 {
                pending.extend([(node.first, above + 1), (node.first + 1, above + 1)]);
            }
        }
        for index in order.into_iter().rev() {
            let Node { first, count, .. } = nodes[index];
            let first = first as usize;
            nodes[index].bounds = if count == 0 {
                nodes[first].bounds.union(&nodes[first + 1].bounds)
            } else {
                let held = first..first + count as usize;
                held.fold(Bounds::EMPTY, |all, triangle| all.union(&soup.bounds_of(triangle)))
            };
        }
        Self { nodes, soup, depth }
    }

    fn bytes(&self) -> usize {
        self.soup.bytes() + size_of_val(self.nodes.as_slice())
    }

    fn references(&self) -> usize {
        self.soup.triangles.len()
    }

    fn cells(&self, visit: &mut dyn FnMut(Cell)) {
        let mut pending: Vec<_> = (!self.nodes.is_empty()).then_some((0, 0)).into_iter().collect();
        while let Some((index, depth)) = pending.pop() {
            let Node { bounds, first, count } = self.nodes[index as usize];
            visit(bounds.cell(depth, (count > 0).then_some(count as usize)));
            if count == 0 {
                pending.extend([(first, depth + 1), (first + 1, depth + 1)]);
            }
        }
    }

    asked_by_walking!();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::family::{numbers, soup, torus};

    /// Every position is in one leaf of at most four, and every node's box holds what is below it.
    #[test]
    fn leaves_partition_the_triangles_and_boxes_enclose_their_subtrees() {
        for triangles in [soup(3000, 0.1, 1), torus(40, 30), vec![torus(4, 4)[0]; 100_000]] {
            let tree = Bvh2::build(&triangles);
            let mut seen = vec![0; tree.soup.triangles.len()];
            let mut pending = vec![(0, tree.soup.bounds)];
            while let Some((index, around)) = pending.pop() {
                let node = &tree.nodes[index as usize];
                assert_eq!(around.union(&node.bounds), around);
                if node.count == 0 {
                    pending.extend([(node.first, node.bounds), (node.first + 1, node.bounds)]);
                    continue;
                }
                let range = node.first as usize..(node.first + node.count) as usize;
                assert!(node.count <= LEAF);
                seen[range.clone()].iter_mut().for_each(|count| *count += 1);
                for (_, corners) in &tree.soup.triangles[range] {
                    assert_eq!(node.bounds.union(&Bounds::of(corners)), node.bounds);
                }
            }
            assert!(seen.iter().all(|&count| count == 1));
            let mut rows: Vec<u32> = tree.soup.triangles.iter().map(|(row, _)| *row).collect();
            rows.sort_unstable();
            assert_eq!(rows, (0..triangles.len() as u32).collect::<Vec<_>>());
            assert_eq!(tree.references(), triangles.len());
        }
    }

    /// Equal triangles in a row or in one place: all neighbours are equally near, and the tree is not a chain of
    /// 20,000 for it.
    #[test]
    fn equal_neighbours_do_not_make_a_chain() {
        let triangle = |x: f32| [[x, 0.0, 0.0], [x + 1.0, 1.0, 0.0], [x, 0.0, 1.0]];
        for triangles in [(0..20_000).map(|i| triangle(i as f32)).collect(), vec![triangle(0.0); 20_000]] {
            let tree = Bvh2::build(&triangles);
            assert!(tree.depth < 300, "{}", tree.depth);
        }
    }

    /// A tree that is said to be deeper than the usual stack is walked with another.
    #[test]
    fn deep_trees_are_walked_alike() {
        let tree = Bvh2::build(&soup(500, 0.2, 2));
        let deep = Bvh2 { depth: DEPTH + 1, ..tree.clone() };
        let mut u = numbers(3);
        for _ in 0..500 {
            let ray = Ray::new([u(), u(), -1.0], [u() - 0.5, u() - 0.5, 1.0]);
            let [a, b] = [&tree, &deep].map(|tree| {
                let mut best = Nearest::none(f32::INFINITY);
                tree.nearest(&ray, &mut best, |_, _| true, &mut ());
                best
            });
            assert_eq!(a, b);
        }
    }
}
