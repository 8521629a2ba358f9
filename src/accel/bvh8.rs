//! A tree of boxes, eight children to a node, and its walk: one ray against eight boxes at a time.
//!
//! Built by obvhs as a binary tree and collapsed: a node takes its two children and opens the
//! one of largest area until it has eight.

use std::time::Duration;

use glam::Vec3A;
use obvhs::{
    BvhBuildParams,
    aabb::Aabb,
    bvh2::{Bvh2, builder::build_bvh2},
};
use wide::f32x8;

use super::triangle::Ray;
use crate::simd::LANES;

/// Marks a child reference as a leaf; below it, three bits of count − 1 and 28 bits of first position.
const LEAF: u32 = 1 << 31;
const COUNT_SHIFT: u32 = 28;

/// Relative rounding error of the slab test's far distance: 1 + 2·γ₃ (Ize 2013, "Robust BVH Ray
/// Traversal"), so that no box that holds a hit is passed by.
const FAR_SCALE: f32 = 1.0 + 2.0 * (3.0 * f32::EPSILON / 2.0) / (1.0 - 3.0 * f32::EPSILON / 2.0);

/// Eight boxes by planes, and what is in them.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
struct Node {
    /// Lower x, upper x, lower y, upper y, lower z, upper z. Missing children are boxes that nothing meets.
    planes: [[f32; LANES]; 6],
    child: [u32; LANES],
}

/// A bounding volume hierarchy over rows of something.
#[derive(Clone, Debug, Default)]
pub struct Bvh8 {
    nodes: Vec<Node>,
    root: Option<u32>,
    /// Row of the primitive in each position; leaves are runs of at most eight positions.
    pub order: Vec<u32>,
}

/// Quality of a build.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// For instances, rebuilt whenever something moves; one to a leaf.
    Fast,
    /// For meshes; up to eight to a leaf, which are tested at once.
    Good,
}

/// A subtree put off during a walk, with the distance at which the ray enters it.
#[derive(Clone, Copy, Debug, Default)]
struct Entry {
    near: f32,
    child: u32,
}

/// Subtrees put off during a walk.
///
/// Kept by the caller, because clearing it for each ray costs an eighth of a small scene's traversal. It grows if a tree
/// is deeper than any ordinary one.
#[derive(Clone, Debug)]
pub struct Stack(Vec<Entry>);

impl Default for Stack {
    fn default() -> Self {
        Self(vec![Entry::default(); 256])
    }
}

impl Bvh8 {
    /// Over boxes; those that are empty (lower above upper) are left out.
    pub fn build(boxes: &[Aabb], quality: Quality) -> Self {
        let rows: Vec<u32> = (0..boxes.len() as u32).filter(|&row| boxes[row as usize].valid()).collect();
        if rows.is_empty() {
            return Self::default();
        }
        let kept: Vec<Aabb> = rows.iter().map(|&row| boxes[row as usize]).collect();
        let params = match quality {
            Quality::Fast => BvhBuildParams { max_prims_per_leaf: 1, ..BvhBuildParams::very_fast_build() },
            // A leaf costs the same whether it holds one triangle or eight, so obvhs is told that boxes are dear.
            Quality::Good => BvhBuildParams {
                max_prims_per_leaf: LANES as u32,
                collapse_traversal_cost: 8.0,
                ..BvhBuildParams::medium_build()
            },
        };
        let binary = build_bvh2(&kept, params, &mut Duration::default());
        let mut tree =
            Self { order: binary.primitive_indices.iter().map(|&i| rows[i as usize]).collect(), ..Self::default() };
        tree.root = Some(tree.collapse(&binary));
        tree
    }

    /// Makes our nodes of obvhs's, from the root down without recursion; returns the root's reference.
    fn collapse(&mut self, binary: &Bvh2) -> u32 {
        let leaf = |index: u32| {
            let node = &binary.nodes[index as usize];
            node.is_leaf().then(|| LEAF | (node.prim_count - 1) << COUNT_SHIFT | node.first_index)
        };
        if let Some(root) = leaf(0) {
            return root;
        }
        let mut pending = vec![(0_u32, None::<(usize, usize)>)];
        while let Some((index, place)) = pending.pop() {
            let first = binary.nodes[index as usize].first_index;
            let mut children = vec![first, first + 1];
            while children.len() < LANES {
                let area = |&&child: &&u32| binary.nodes[child as usize].aabb.half_area();
                let inner = children.iter().filter(|&&child| leaf(child).is_none());
                let Some(&largest) = inner.max_by(|a, b| area(a).total_cmp(&area(b))) else { break };
                let opened = binary.nodes[largest as usize].first_index;
                let at = children.iter().position(|&child| child == largest).expect("it was found among them");
                children[at] = opened;
                children.push(opened + 1);
            }
            let row = self.nodes.len();
            let mut node = Node {
                planes: [[f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]].repeat(3).try_into().expect("three pairs"),
                child: [0; LANES],
            };
            for (lane, &child) in children.iter().enumerate() {
                let bounds = &binary.nodes[child as usize].aabb;
                for axis in 0..3 {
                    node.planes[2 * axis][lane] = bounds.min[axis];
                    node.planes[2 * axis + 1][lane] = bounds.max[axis];
                }
                match leaf(child) {
                    Some(reference) => node.child[lane] = reference,
                    None => pending.push((child, Some((row, lane)))),
                }
            }
            self.nodes.push(node);
            if let Some((parent, lane)) = place {
                self.nodes[parent].child[lane] = row as u32;
            }
        }
        0
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>() + self.order.len() * 4
    }

    /// Makes one thing of each leaf's positions, and has the leaf refer to its index among them.
    pub fn number_leaves<T>(&mut self, mut make: impl FnMut(std::ops::Range<usize>) -> T) -> Vec<T> {
        let mut made = Vec::new();
        let children = self.nodes.iter_mut().flat_map(|node| {
            let real = |lane: &usize| node.planes[0][*lane] <= node.planes[1][*lane];
            let real: Vec<usize> = (0..LANES).filter(real).collect();
            node.child.iter_mut().enumerate().filter(move |(lane, _)| real.contains(lane)).map(|(_, child)| child)
        });
        for child in children.chain(self.root.as_mut()).filter(|child| **child & LEAF != 0) {
            let (first, count) = leaf_range(*child);
            *child = LEAF | made.len() as u32;
            made.push(make(first..first + count));
        }
        made
    }

    /// First position and count of every leaf.
    #[cfg(test)]
    fn leaves(&self) -> Vec<(usize, usize)> {
        let children = self.nodes.iter().flat_map(|node| {
            let real = (0..LANES).filter(|&lane| node.planes[0][lane] <= node.planes[1][lane]);
            real.map(|lane| node.child[lane])
        });
        children.chain(self.root).filter(|child| child & LEAF != 0).map(leaf_range).collect()
    }

    /// Calls `leaf(first, count, t_max)` for the leaves that the ray may meet before `t_max`, near ones first if
    /// `SORTED`; `leaf` may lower `t_max`, and ends the walk by returning true.
    #[inline(always)]
    pub fn walk<const SORTED: bool>(
        &self,
        ray: &Ray,
        t_max: &mut f32,
        Stack(stack): &mut Stack,
        mut leaf: impl FnMut(usize, usize, &mut f32) -> bool,
    ) {
        let Some(mut current) = self.root else { return };
        let negative = ray.inverse.map(|inverse| usize::from(inverse < 0.0));
        let origin = ray.origin.map(f32x8::splat);
        let inverse = ray.inverse.map(f32x8::splat);
        let mut top = 0;
        loop {
            if current & LEAF != 0 {
                let (first, count) = leaf_range(current);
                if leaf(first, count, t_max) {
                    return;
                }
            } else {
                let node = &self.nodes[current as usize];
                let (near, hits) = node.meet(&origin, &inverse, negative, *t_max);
                let near = near.to_array();
                if top + LANES > stack.len() {
                    stack.resize(2 * stack.len(), Entry::default());
                }
                let bottom = top;
                let mut hits = hits;
                while hits != 0 {
                    let lane = hits.trailing_zeros() as usize & (LANES - 1);
                    hits &= hits - 1;
                    let entry = Entry { near: near[lane], child: node.child[lane] };
                    let mut at = top;
                    if SORTED {
                        while at > bottom && stack[at - 1].near < entry.near {
                            stack[at] = stack[at - 1];
                            at -= 1;
                        }
                    }
                    stack[at] = entry;
                    top += 1;
                }
            }
            loop {
                if top == 0 {
                    return;
                }
                top -= 1;
                let entry = stack[top];
                if entry.near <= *t_max {
                    current = entry.child;
                    break;
                }
            }
        }
    }
}

#[inline(always)]
fn leaf_range(reference: u32) -> (usize, usize) {
    let first = reference & ((1 << COUNT_SHIFT) - 1);
    (first as usize, ((reference & !LEAF) >> COUNT_SHIFT) as usize + 1)
}

impl Node {
    /// Distances at which the ray enters the boxes, and which of them it meets within (0, t_max], a bit each.
    ///
    /// Conservative: rounding never loses a box that holds a hit. A zero direction component gives
    /// infinities, or NaN on a slab's plane, which the order of operands in `fast_min` and `fast_max` drops.
    #[inline(always)]
    fn meet(&self, origin: &[f32x8; 3], inverse: &[f32x8; 3], negative: [usize; 3], t_max: f32) -> (f32x8, u32) {
        let mut near = f32x8::ZERO;
        let mut far = f32x8::splat(t_max);
        let scale = f32x8::splat(FAR_SCALE);
        for axis in 0..3 {
            let enter = f32x8::new(self.planes[2 * axis + negative[axis]]);
            let leave = f32x8::new(self.planes[2 * axis + 1 - negative[axis]]);
            near = ((enter - origin[axis]) * inverse[axis]).fast_max(near);
            far = ((leave - origin[axis]) * inverse[axis] * scale).fast_min(far);
        }
        (near, near.simd_le(far).to_bitmask())
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Over 5,000 boxes each row is in exactly one leaf, and what a node says of a child holds all below it.
    #[test]
    fn leaves_partition_the_rows_and_boxes_enclose_their_subtrees() {
        let number = |i: u32| (i.wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0;
        let boxes: Vec<Aabb> = (0..5000_u32)
            .map(|i| {
                let corner = [number(3 * i), number(3 * i + 1), number(3 * i + 2)];
                bounds_of([corner, corner.map(|x| x + 0.01)])
            })
            .collect();
        for quality in [Quality::Fast, Quality::Good] {
            let tree = Bvh8::build(&boxes, quality);
            let mut seen = vec![0; boxes.len()];
            for (first, count) in tree.leaves() {
                tree.order[first..first + count].iter().for_each(|&row| seen[row as usize] += 1);
            }
            assert!(seen.iter().all(|&count| count == 1));
            check_enclosed(&tree, &boxes, tree.root.unwrap(), &Aabb::LARGEST);
        }
    }

    fn check_enclosed(tree: &Bvh8, boxes: &[Aabb], child: u32, within: &Aabb) {
        let holds = |inner: &Aabb| {
            (0..3).all(|axis| within.min[axis] <= inner.min[axis] && inner.max[axis] <= within.max[axis])
        };
        if child & LEAF != 0 {
            let (first, count) = leaf_range(child);
            assert!(tree.order[first..first + count].iter().all(|&row| holds(&boxes[row as usize])));
            return;
        }
        let node = &tree.nodes[child as usize];
        for lane in (0..LANES).filter(|&lane| node.planes[0][lane] <= node.planes[1][lane]) {
            let [lo, hi] =
                [0, 1].map(|side| Vec3A::from_array(std::array::from_fn(|axis| node.planes[2 * axis + side][lane])));
            let bounds = Aabb::new(lo, hi);
            assert!(holds(&bounds));
            check_enclosed(tree, boxes, node.child[lane], &bounds);
        }
    }
}
