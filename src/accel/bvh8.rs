//! A tree of boxes, eight children to a node.
//!
//! obvhs builds a binary tree; which of its subtrees become the children of a wide node is then chosen so that the
//! expected cost of a ray is least (Ylitie, Karras, Laine 2017, "Efficient Incoherent Ray Traversal on GPUs Through
//! Compressed Wide BVHs", section 3.3), with one difference: a leaf costs the same whether it holds one triangle or
//! eight, as they are tested at once; only its memory differs.

use std::{ops::Range, time::Duration};

use glam::Vec3A;
use obvhs::{
    BvhBuildParams,
    aabb::Aabb,
    bvh2::{Bvh2, builder::build_bvh2, node::Bvh2Node},
};
use rayon::prelude::*;
use wide::f32x8;

use super::{
    arena::{Arena, Granule},
    structure::Counters,
    triangle::{Leaf, QUAD, Ray, Side, TriangleQuad},
};
use crate::simd::LANES;

/// Marks a child reference as a leaf, of which the other bits say which.
pub(super) const LEAF: u32 = 1 << 30;
/// Marks a child reference as an instance, of which the other bits are the row.
pub(super) const INSTANCE: u32 = 1 << 31;
/// What a reference is.
pub(super) const KIND: u32 = LEAF | INSTANCE;

/// How much farther the far sides of boxes count than they are: the rounding of the slab test, 1 + 2·γ₃ (Ize 2013, "Robust
/// BVH Ray Traversal"), so that no box that holds a hit is passed by, and what is needed for [`BEYOND`].
pub(super) const FAR_SCALE: f32 = 1.0 + 8.0 * f32::EPSILON;

/// By how much a box may begin beyond the nearest hit and yet be visited, so that rounding which puts a hit just before its
/// box does not hide it behind an equal one. Less than what shadow rays leave out before a light, whose box they would
/// enter.
pub(super) const BEYOND: f32 = 1.0 + 6.0 * f32::EPSILON;

/// Cost of a leaf in units of that of a node. A step of either takes about as long, whatever the leaf holds, but a leaf of
/// more than four triangles takes twice the memory. Of 0.8, 1 and 1.2 for the first, and 1, 1.2, 1.5 and 2 for the
/// second, these gave the smallest trees, and rays as fast as any.
fn leaf_cost(triangles: u32) -> f32 {
    if triangles as usize > TriangleQuad::MOST { 1.0 } else { 0.8 }
}

/// Eight boxes by planes, and what is in them.
///
/// Its 224 bytes lie in four cache lines, wherever it stands in an arena.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub(super) struct Node([Granule; NODE]);

/// Granules of a node: lower x, upper x, lower y, upper y, lower z, upper z, references of the children. Missing
/// children are boxes that nothing meets.
pub(super) const NODE: usize = 7;

/// Quality of a build.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// For what is rebuilt whenever something moves.
    Fast,
    /// For meshes.
    Good,
    /// Half as long again for a few per cent of traversal, more where triangles overlap.
    Best,
}

impl Quality {
    fn params(self) -> BvhBuildParams {
        let params = match self {
            Self::Fast => BvhBuildParams::very_fast_build(),
            Self::Good => BvhBuildParams::medium_build(),
            Self::Best => BvhBuildParams::slow_build(),
        };
        // Leaves are formed together with the wide nodes.
        BvhBuildParams { max_prims_per_leaf: 1, pre_split: false, ..params }
    }
}

/// A bounding volume hierarchy whose leaves are made by its maker.
#[derive(Clone, Debug, Default)]
pub(super) struct Bvh8 {
    /// Nodes, and leaves beside the node they belong to; a reference is the place of the first granule.
    pub arena: Arena,
    /// Reference of the root, if there is anything.
    pub root: Option<u32>,
    /// The most subtrees that a walk puts off at a time.
    pub stack: usize,
    /// What building the binary tree took.
    pub binary_time: Duration,
}

/// Expected cost of a subtree when it is given up to 1, 2, … 8 places in a wide node.
type Costs = [f32; LANES];

/// The binary tree by levels, with the costs of its subtrees.
struct Levels<'a> {
    binary: &'a Bvh2,
    /// Nodes of the binary tree, level by level; the two children of a node are neighbours.
    node: Vec<u32>,
    /// Position of the first child of each; unused for leaves.
    child: Vec<u32>,
    /// Primitives below each.
    count: Vec<u32>,
    /// Around the primitives below each.
    bounds: Vec<Aabb>,
    cost: Vec<Costs>,
}

impl<'a> Levels<'a> {
    fn new(binary: &'a Bvh2, boxes: &[Aabb], most_in_leaf: u32) -> Self {
        let (mut node, mut child, mut levels) = (vec![0_u32], Vec::new(), Vec::new());
        let mut next = 0..1;
        while !next.is_empty() {
            levels.push(next.clone());
            for position in next.clone() {
                let one = &binary.nodes[node[position] as usize];
                child.push(node.len() as u32);
                if !one.is_leaf() {
                    node.extend([one.first_index, one.first_index + 1]);
                }
            }
            next = next.end..node.len();
        }
        let nodes = node.len();
        let mut this = Self {
            binary,
            node,
            child,
            count: vec![0; nodes],
            bounds: vec![Aabb::empty(); nodes],
            cost: vec![[0.0; LANES]; nodes],
        };
        for level in levels.into_iter().rev() {
            this.solve(level, boxes, most_in_leaf);
        }
        this
    }

    /// Costs of a level from those of the one below.
    fn solve(&mut self, level: Range<usize>, boxes: &[Aabb], most_in_leaf: u32) {
        let below = level.end;
        let (costs, costs_below) = self.cost.split_at_mut(below);
        let (counts, counts_below) = self.count.split_at_mut(below);
        let (bounds, bounds_below) = self.bounds.split_at_mut(below);
        let (binary, node, child) = (self.binary, &self.node, &self.child);
        let here = costs[level.clone()].par_iter_mut().zip(&mut counts[level.clone()]).zip(&mut bounds[level.clone()]);
        here.zip(level).with_min_len(1024).for_each(|(((cost, count), bounds), position)| {
            let one = &binary.nodes[node[position] as usize];
            if one.is_leaf() {
                let own = one.first_index as usize..(one.first_index + one.prim_count) as usize;
                let rows = binary.primitive_indices[own].iter();
                *bounds = rows.fold(Aabb::empty(), |all, &row| all.union(&boxes[row as usize]));
                *count = one.prim_count;
                *cost = [leaf_cost(1) * bounds.half_area(); LANES];
                return;
            }
            let at = child[position] as usize - below;
            let (left, right) = (&costs_below[at], &costs_below[at + 1]);
            *bounds = bounds_below[at].union(&bounds_below[at + 1]);
            *count = counts_below[at] + counts_below[at + 1];
            let area = bounds.half_area();
            let leaf = if *count <= most_in_leaf { leaf_cost(*count) * area } else { f32::INFINITY };
            cost[0] = leaf.min(area + split(left, right, LANES).0);
            for places in 2..=LANES {
                cost[places - 1] = cost[places - 2].min(split(left, right, places).0);
            }
        });
    }

    fn binary_node(&self, position: usize) -> &Bvh2Node {
        &self.binary.nodes[self.node[position] as usize]
    }

    /// Positions of the children of a node.
    fn children(&self, position: usize) -> (usize, usize) {
        let child = self.child[position] as usize;
        (child, child + 1)
    }

    fn split(&self, position: usize, places: usize) -> (f32, usize) {
        let (left, right) = self.children(position);
        split(&self.cost[left], &self.cost[right], places)
    }

    fn is_leaf(&self, position: usize, most_in_leaf: u32) -> bool {
        let area = self.bounds[position].half_area();
        self.binary_node(position).is_leaf()
            || self.count[position] <= most_in_leaf
                && leaf_cost(self.count[position]) * area <= area + self.split(position, LANES).0
    }

    /// Adds the subtrees that a subtree is opened into when it gets so many places.
    fn open(&self, position: usize, places: usize, into: &mut Vec<usize>) {
        let mut places = places;
        while places > 1 && self.cost[position][places - 1] == self.cost[position][places - 2] {
            places -= 1;
        }
        if places == 1 || self.binary_node(position).is_leaf() {
            into.push(position);
        } else {
            let (left, right) = self.children(position);
            let (_, to_left) = self.split(position, places);
            self.open(left, to_left, into);
            self.open(right, places - to_left, into);
        }
    }

    /// Rows of the primitives below a node.
    fn rows(&self, position: usize, into: &mut Vec<u32>) {
        let mut pending = vec![position];
        while let Some(position) = pending.pop() {
            let one = self.binary_node(position);
            if one.is_leaf() {
                let range = one.first_index as usize..(one.first_index + one.prim_count) as usize;
                into.extend_from_slice(&self.binary.primitive_indices[range]);
            } else {
                let (left, right) = self.children(position);
                pending.extend([right, left]);
            }
        }
    }
}

/// A box made a little larger, each in its own way.
///
/// obvhs pairs neighbours, and where all are equally near it takes n² time and n levels; the trees of regular meshes are
/// better for it too.
fn uneven(row: usize, one: &Aabb) -> Aabb {
    let mixed = (row as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let number = ((mixed ^ mixed >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f32 / 16_777_216.0;
    let more = one.diagonal() * (UNEVEN * number);
    Aabb::new(one.min - more, one.max + more)
}

/// By what part of their size boxes are made uneven for obvhs. Of 0, 1e-5, 1e-4 and 1e-3 this made rays among tori 15 %
/// faster than none, and those in an interior no slower, as ten times as much does.
const UNEVEN: f32 = 1e-4;

/// The best share of `places` between two subtrees: its cost, and how many the left one gets.
#[inline(always)]
fn split(left: &Costs, right: &Costs, places: usize) -> (f32, usize) {
    let mut best = (f32::INFINITY, 1);
    for to_left in 1..places {
        let cost = left[to_left - 1] + right[places - to_left - 1];
        if cost < best.0 {
            best = (cost, to_left);
        }
    }
    best
}

impl Bvh8 {
    /// Over boxes; those that are empty (lower above upper) are left out.
    ///
    /// `make` gives a reference for each leaf of at most `most_in_leaf` rows, and may add to the arena what the leaf needs.
    pub fn build(
        boxes: &[Aabb],
        quality: Quality,
        most_in_leaf: usize,
        mut make: impl FnMut(&mut [u32], &mut Vec<Granule>) -> u32,
    ) -> Self {
        let mut rows: Vec<u32> = (0..boxes.len() as u32).filter(|&row| boxes[row as usize].valid()).collect();
        let mut arena = Vec::new();
        let most = most_in_leaf as u32;
        if rows.len() < 2 {
            let root = (!rows.is_empty()).then(|| make(&mut rows, &mut arena));
            return Self { root, arena: Arena::new(arena), ..Self::default() };
        }
        let kept: Vec<Aabb> = rows.iter().map(|&row| boxes[row as usize]).collect();
        let uneven: Vec<Aabb> = kept.iter().enumerate().map(|(row, one)| uneven(row, one)).collect();
        let mut binary_time = Duration::default();
        let binary = build_bvh2(&uneven, quality.params(), &mut binary_time);
        let levels = Levels::new(&binary, &kept, most);
        let mut own = Vec::with_capacity(LANES);
        let mut make_leaf = |position: usize, arena: &mut Vec<Granule>| {
            own.clear();
            levels.rows(position, &mut own);
            own.iter_mut().for_each(|row| *row = rows[*row as usize]);
            make(&mut own, arena)
        };
        if levels.is_leaf(0, most) {
            let root = Some(make_leaf(0, &mut arena));
            return Self { root, arena: Arena::new(arena), stack: 0, binary_time };
        }
        let mut stack = 0;
        // A node to make, the granule and lane of its reference, and what a walk has put off before it gets there.
        let mut pending = vec![(0_usize, None::<(usize, usize)>, 0_usize)];
        let mut opened = Vec::with_capacity(LANES);
        while let Some((position, place, put_off)) = pending.pop() {
            let first = arena.len();
            if let Some((granule, lane)) = place {
                arena[granule].0[lane] = first as u32;
            }
            arena.resize(first + NODE, Granule::default());
            opened.clear();
            let (left, right) = levels.children(position);
            let (_, to_left) = levels.split(position, LANES);
            levels.open(left, to_left, &mut opened);
            levels.open(right, LANES - to_left, &mut opened);
            let put_off = put_off + opened.len();
            stack = stack.max(put_off);
            for axis in 0..3 {
                let (mut lower, mut upper) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
                for (lane, &child) in opened.iter().enumerate() {
                    let bounds = &levels.bounds[child];
                    (lower[lane], upper[lane]) = (bounds.min[axis], bounds.max[axis]);
                }
                arena[first + 2 * axis] = Granule::of(lower);
                arena[first + 2 * axis + 1] = Granule::of(upper);
            }
            for (lane, &child) in opened.iter().enumerate() {
                if levels.is_leaf(child, most) {
                    arena[first + NODE - 1].0[lane] = make_leaf(child, &mut arena);
                } else {
                    pending.push((child, Some((first + NODE - 1, lane)), put_off - 1));
                }
            }
        }
        assert!(arena.len() < QUAD as usize, "16 GiB of one mesh");
        Self { root: Some(0), arena: Arena::new(arena), stack, binary_time }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.arena.bytes()
    }

    /// Calls `leaf(reference, t_max)` for the leaves below `root` that the ray may meet before `t_max`, near ones first if
    /// `SORTED`; `leaf` may lower `t_max`, and ends the walk by returning true.
    #[inline(always)]
    pub fn walk<const SORTED: bool>(
        &self,
        root: Option<u32>,
        ray: &Ray,
        t_max: &mut f32,
        Stack(stack): &mut Stack,
        counters: &mut impl Counters,
        mut leaf: impl FnMut(u32, &mut f32) -> bool,
    ) {
        let Some(mut current) = root else { return };
        if current & KIND != 0 {
            // A mesh of a few triangles has no node to set up for.
            leaf(current & !KIND, t_max);
            return;
        }
        let arena = self.arena.granules();
        let mut top = 0;
        loop {
            if current & KIND != 0 {
                if leaf(current & !KIND, t_max) {
                    return;
                }
            } else {
                counters.node();
                let node = Node::at(arena, current);
                let (near, far) = node.distances(ray, *t_max * (BEYOND / FAR_SCALE));
                let (near, hits) = (near.to_array(), near.simd_le(far).to_bitmask());
                if top + LANES > stack.len() {
                    stack.resize(2 * stack.len(), Entry::default());
                }
                let bottom = top;
                let mut hits = hits;
                while hits != 0 {
                    let lane = hits.trailing_zeros() as usize & (LANES - 1);
                    hits &= hits - 1;
                    let entry = Entry { near: near[lane], child: node.children()[lane] };
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
                if entry.near <= *t_max * BEYOND {
                    current = entry.child;
                    break;
                }
            }
        }
    }
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

impl Node {
    /// The node that a reference means.
    #[inline(always)]
    pub fn at(arena: &[Granule], reference: u32) -> &Self {
        let place = reference as usize;
        bytemuck::cast_ref(arena[place..place + NODE].as_array::<NODE>().expect("a node's length"))
    }

    /// Boxes of the children, with their references.
    pub fn boxes(&self) -> impl Iterator<Item = (Aabb, u32)> {
        let corner = move |side: usize, lane: usize| {
            Vec3A::from_array(std::array::from_fn(|axis| self.0[2 * axis + side].values()[lane]))
        };
        let all = (0..LANES).map(move |lane| (Aabb::new(corner(0, lane), corner(1, lane)), self.children()[lane]));
        all.filter(|(bounds, _)| bounds.valid())
    }

    /// References of the children.
    #[inline(always)]
    pub fn children(&self) -> [u32; LANES] {
        self.0[NODE - 1].0
    }

    /// Planes of the boxes by axis, lower ones before upper ones.
    #[inline(always)]
    pub fn planes(&self) -> &[[f32; 2 * LANES]] {
        bytemuck::cast_slice::<_, f32>(&self.0).as_chunks().0
    }

    /// Distances from and up to which the ray is in the boxes, the latter at most a little more than `t_max`; first above
    /// second where it misses.
    ///
    /// A zero direction component gives
    /// infinities, or NaN on a slab's plane, which the order of operands in `fast_min` and `fast_max` drops.
    #[inline(always)]
    pub fn distances(&self, ray: &Ray, t_max: f32) -> (f32x8, f32x8) {
        let mut near = f32x8::ZERO;
        let mut far = f32x8::splat(t_max);
        for (axis, planes) in self.planes().iter().enumerate() {
            let at = |side: Side| f32x8::new(*planes[side as usize..].first_chunk().expect("a side"));
            let against = f32x8::splat(ray.against[axis]);
            let origin = f32x8::splat(ray.origin[axis]);
            // Turned round twice, so that the planes can be read by the subtraction itself.
            near = ((origin - at(ray.first[axis])) * against).fast_max(near);
            far = ((origin - at(ray.last[axis])) * against).fast_min(far);
        }
        (near, far * f32x8::splat(FAR_SCALE))
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
        for quality in [Quality::Fast, Quality::Good, Quality::Best] {
            for most in [1, 8] {
                let mut leaves = Vec::new();
                let tree = Bvh8::build(&boxes, quality, most, |rows, _| {
                    leaves.push(rows.to_vec());
                    LEAF | (leaves.len() as u32 - 1)
                });
                let mut seen = vec![0; boxes.len()];
                leaves.iter().flatten().for_each(|&row| seen[row as usize] += 1);
                assert!(seen.iter().all(|&count| count == 1));
                assert!(leaves.iter().all(|rows| (1..=most).contains(&rows.len())));
                let put_off = check(&tree, &leaves, &boxes, tree.root.unwrap(), &Aabb::LARGEST);
                assert_eq!(put_off, tree.stack);
            }
        }
    }

    /// Checks a subtree and returns the most that a walk through it puts off.
    fn check(tree: &Bvh8, leaves: &[Vec<u32>], boxes: &[Aabb], child: u32, within: &Aabb) -> usize {
        let holds = |inner: &Aabb| {
            (0..3).all(|axis| within.min[axis] <= inner.min[axis] && inner.max[axis] <= within.max[axis])
        };
        if child & LEAF != 0 {
            assert!(leaves[(child & !LEAF) as usize].iter().all(|&row| holds(&boxes[row as usize])));
            return 0;
        }
        let node = Node::at(tree.arena.granules(), child);
        let plane = |plane: usize, lane: usize| node.0[plane].values()[lane];
        let real: Vec<usize> = (0..LANES).filter(|&lane| plane(0, lane) <= plane(1, lane)).collect();
        let mut most = real.len();
        for &lane in &real {
            let [lo, hi] =
                [0, 1].map(|side| Vec3A::from_array(std::array::from_fn(|axis| plane(2 * axis + side, lane))));
            let bounds = Aabb::new(lo, hi);
            assert!(holds(&bounds));
            most = most.max(real.len() - 1 + check(tree, leaves, boxes, node.children()[lane], &bounds));
        }
        most
    }
}
