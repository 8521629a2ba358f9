//! A binary tree of boxes, built by obvhs, and its walk.

use std::time::Duration;

use glam::Vec3A;
use obvhs::{BvhBuildParams, aabb::Aabb, bvh2::builder::build_bvh2};

use super::triangle::Ray;

/// Marks a child reference as a leaf; below it, three bits of count − 1 and 28 bits of first row.
const LEAF: u32 = 1 << 31;
const COUNT_SHIFT: u32 = 28;
const MAX_LEAF: u32 = 8;

/// Relative rounding error of the slab test's far distance: 1 + 2·γ₃ (Ize 2013, "Robust BVH Ray
/// Traversal"), so that no box that holds a hit is passed by.
const FAR_SCALE: f32 = 1.0 + 2.0 * (3.0 * f32::EPSILON / 2.0) / (1.0 - 3.0 * f32::EPSILON / 2.0);

/// Two children to a cache line.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
struct Node {
    /// Per axis: lower bound of left, of right, upper bound of left, of right.
    bounds: [[f32; 4]; 3],
    child: [u32; 2],
}

/// A binary bounding volume hierarchy over rows of something.
#[derive(Clone, Debug, Default)]
pub struct Bvh2 {
    nodes: Vec<Node>,
    root: Option<u32>,
    /// Row of the primitive in each leaf position.
    pub order: Vec<u32>,
}

/// Quality of a build.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// For instances, rebuilt whenever something moves.
    Fast,
    /// For meshes.
    Good,
}

impl Bvh2 {
    /// Over boxes; those that are empty (lower above upper) are left out.
    pub fn build(boxes: &[Aabb], quality: Quality) -> Self {
        let rows: Vec<u32> = (0..boxes.len() as u32).filter(|&row| boxes[row as usize].valid()).collect();
        if rows.is_empty() {
            return Self::default();
        }
        let kept: Vec<Aabb> = rows.iter().map(|&row| boxes[row as usize]).collect();
        let params = match quality {
            Quality::Fast => BvhBuildParams { max_prims_per_leaf: 2, ..BvhBuildParams::very_fast_build() },
            Quality::Good => BvhBuildParams { max_prims_per_leaf: MAX_LEAF, ..BvhBuildParams::medium_build() },
        };
        let built = build_bvh2(&kept, params, &mut Duration::default());
        let order = built.primitive_indices.iter().map(|&i| rows[i as usize]).collect();

        // Inner nodes of obvhs in their order, one of ours each; a leaf lives in its parent's reference.
        let mut place = vec![0; built.nodes.len()];
        let mut inner = 0;
        for (i, node) in built.nodes.iter().enumerate() {
            if node.is_leaf() {
                debug_assert!((1..=MAX_LEAF).contains(&node.prim_count), "leaf of {}", node.prim_count);
                place[i] = LEAF | (node.prim_count - 1) << COUNT_SHIFT | node.first_index;
            } else {
                place[i] = inner;
                inner += 1;
            }
        }
        let nodes = built.nodes.iter().filter(|node| !node.is_leaf()).map(|node| {
            let [left, right] = [node.first_index, node.first_index + 1].map(|i| i as usize);
            let [l, r] = [left, right].map(|i| built.nodes[i].aabb);
            let bounds = std::array::from_fn(|axis| [l.min[axis], r.min[axis], l.max[axis], r.max[axis]]);
            Node { bounds, child: [place[left], place[right]] }
        });
        Self { nodes: nodes.collect(), root: Some(place[0]), order }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>() + self.order.len() * 4
    }

    /// Calls `leaf(first, count, t_max)` for the leaves that the ray may meet before `t_max`, near
    /// ones first; `leaf` may lower `t_max`, and ends the walk by returning true.
    #[inline(always)]
    pub fn walk(
        &self,
        ray: &Ray,
        t_max: &mut f32,
        Stack(stack): &mut Stack,
        mut leaf: impl FnMut(usize, usize, &mut f32) -> bool,
    ) {
        let Some(mut current) = self.root else { return };
        let mut top = 0;
        loop {
            if current & LEAF != 0 {
                let first = current & ((1 << COUNT_SHIFT) - 1);
                let count = (current & !LEAF) >> COUNT_SHIFT;
                if leaf(first as usize, count as usize + 1, t_max) {
                    return;
                }
            } else {
                let node = &self.nodes[current as usize];
                let ([near_l, near_r], [hit_l, hit_r]) = node.meet(ray, *t_max);
                if hit_l && hit_r {
                    let right_first = near_r < near_l;
                    let far = if right_first { (node.child[0], near_l) } else { (node.child[1], near_r) };
                    current = node.child[usize::from(right_first)];
                    stack[top] = far;
                    top += 1;
                    continue;
                }
                if hit_l || hit_r {
                    current = node.child[usize::from(hit_r)];
                    continue;
                }
            }
            loop {
                if top == 0 {
                    return;
                }
                top -= 1;
                let (next, near) = stack[top];
                if near <= *t_max {
                    current = next;
                    break;
                }
            }
        }
    }
}

/// Subtrees put off during a walk, with the distance at which the ray enters each.
///
/// Kept by the caller, because clearing it for each ray costs an eighth of a small scene's traversal.
/// Deeper than the builder's trees, for which obvhs itself uses 96.
#[derive(Clone, Debug)]
pub struct Stack([(u32, f32); 128]);

impl Default for Stack {
    fn default() -> Self {
        Self([(0, 0.0); 128])
    }
}

#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

impl Node {
    /// Distances at which the ray enters both boxes, and whether it meets them within (0, t_max].
    ///
    /// Conservative: rounding never loses a box that holds a hit. A zero direction component gives
    /// infinities, or NaN on a slab's plane, which the order of operands in `min` and `max` drops.
    #[inline(always)]
    fn meet(&self, ray: &Ray, t_max: f32) -> ([f32; 2], [bool; 2]) {
        let mut near = [0.0_f32; 2];
        let mut far = [t_max; 2];
        for axis in 0..3 {
            let (origin, inverse) = (ray.origin[axis], ray.inverse[axis]);
            let bounds = &self.bounds[axis];
            for side in 0..2 {
                let t0 = (bounds[side] - origin) * inverse;
                let t1 = (bounds[side + 2] - origin) * inverse;
                let (lo, hi) = if inverse < 0.0 { (t1, t0) } else { (t0, t1) };
                near[side] = max(lo, near[side]);
                far[side] = min(hi * FAR_SCALE, far[side]);
            }
        }
        (near, [near[0] <= far[0], near[1] <= far[1]])
    }
}

/// The box around points.
pub(super) fn bounds_of(points: impl IntoIterator<Item = [f32; 3]>) -> Aabb {
    let mut bounds = Aabb::empty();
    for point in points {
        bounds.extend(Vec3A::from_array(point));
    }
    bounds
}
