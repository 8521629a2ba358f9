//! A tree of boxes, eight children to a node.
//!
//! A binary tree is built first ([`super::binary`]), whose subtrees then become the children of wide nodes
//! ([`super::collapse`]).

use std::time::{Duration, Instant};

use glam::Vec3A;
use obvhs::aabb::Aabb;
use wide::f32x8;

use super::{
    arena::{Arena, Granule},
    binary::pair,
    cluster::cluster,
    collapse::{Collapsed, Leaves, collapse, leaf_cost, write},
    structure::Counters,
    triangle::{Ray, Side},
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

/// A bounding volume hierarchy whose leaves are made by its maker.
#[derive(Clone, Debug, Default)]
pub(super) struct Bvh8 {
    /// Nodes, and leaves beside the node they belong to; a reference is the place of the first granule.
    pub arena: Arena,
    /// Reference of the root, if there is anything.
    pub root: Option<u32>,
    /// The most subtrees that a walk puts off at a time.
    pub stack: usize,
    /// Expected cost of a ray in steps, times half the area of the box around everything.
    pub cost: f32,
    /// What building the binary tree took.
    pub binary_time: Duration,
}

impl Bvh8 {
    /// Over boxes; those that are empty (lower above upper) are left out.
    pub fn build<L: Leaves>(boxes: &[Aabb], quality: Quality, leaves: &L) -> Self {
        Self::over(boxes, leaves, |rows| {
            let start = Instant::now();
            let binary = pair(boxes, rows, quality);
            let binary_time = start.elapsed();
            (collapse(&binary, boxes, leaves), binary_time)
        })
    }

    /// As [`Bvh8::build`], in as little time as there can be.
    pub fn top<L: Leaves>(boxes: &[Aabb], leaves: &L) -> Self {
        Self::over(boxes, leaves, |rows| {
            let (inners, root) = cluster::<L>(boxes, rows);
            (write(&inners, &root, boxes, leaves), Duration::ZERO)
        })
    }

    /// A tree over all boxes that are not empty, of which there are two at least where `make` is called.
    fn over<L: Leaves>(boxes: &[Aabb], leaves: &L, make: impl FnOnce(&[u32]) -> (Collapsed, Duration)) -> Self {
        let mut rows: Vec<u32> = (0..boxes.len() as u32).filter(|&row| boxes[row as usize].valid()).collect();
        if rows.len() < 2 {
            let mut arena = Arena::zeroed(L::granules(1) * rows.len());
            let root = (!rows.is_empty()).then(|| leaves.write(&mut rows, 0, arena.granules_mut()));
            let cost = rows.first().map_or(0.0, |&row| leaf_cost(1) * boxes[row as usize].half_area());
            return Self { root, arena, cost, ..Self::default() };
        }
        let (Collapsed { arena, root, stack, cost }, binary_time) = make(&rows);
        Self { arena, root: Some(root), stack, cost, binary_time }
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
    pub fn children(&self) -> &[u32; LANES] {
        &self.0[NODE - 1].0
    }

    /// Reference of a child.
    #[inline(always)]
    pub fn child(&self, lane: usize) -> u32 {
        self.children()[lane % LANES]
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
#[cfg(test)]
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

    /// Leaves of their rows' numbers.
    struct Rows<const MOST: usize>;

    impl<const MOST: usize> Leaves for Rows<MOST> {
        const MOST: usize = MOST;

        /// One row to a granule, so that sizes differ as much as they can.
        fn granules(count: usize) -> usize {
            count
        }

        fn write(&self, rows: &mut [u32], place: u32, into: &mut [Granule]) -> u32 {
            assert_eq!(into.len(), Self::granules(rows.len()));
            rows.sort_unstable();
            for (granule, &row) in into.iter_mut().zip(&*rows) {
                granule.0 = [row, rows.len() as u32, 0, 0, 0, 0, 0, 0];
            }
            LEAF | place
        }
    }

    fn boxes(count: u32) -> Vec<Aabb> {
        let number = |i: u32| (i.wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0;
        let boxed = |i: u32| {
            let corner = [number(3 * i), number(3 * i + 1), number(3 * i + 2)];
            bounds_of([corner, corner.map(|x| x + 0.01)])
        };
        (0..count).map(boxed).collect()
    }

    const QUALITIES: [Quality; 3] = [Quality::Fast, Quality::Good, Quality::Best];

    /// Over up to 9,000 boxes each row is in exactly one leaf, what a node says of a child holds all below it, and no
    /// memory is left over.
    #[test]
    fn leaves_partition_the_rows_and_boxes_enclose_their_subtrees() {
        for quality in QUALITIES {
            for count in [0, 1, 2, 3, 9, 100, 9000] {
                check::<1>(&boxes(count), quality);
                check::<8>(&boxes(count), quality);
            }
        }
        // Those that are empty are not there.
        let mut some = boxes(5000);
        some.iter_mut().step_by(3).for_each(|one| *one = Aabb::empty());
        check::<8>(&some, Quality::Good);
        check::<8>(&vec![Aabb::empty(); 10], Quality::Good);
    }

    /// The same for what is built in a hurry, of whatever boxes: in one place, each within the next, in steps that grow,
    /// without a size, infinite, too large for their area to be a number.
    #[test]
    fn top_levels_hold_whatever_there_is() {
        let around = |i: u32, size: f32| bounds_of([[-size, -size, i as f32], [size, size, i as f32 + size]]);
        let every = |box_of: &dyn Fn(u32) -> Aabb| -> Vec<Aabb> { (0..3000).map(box_of).collect() };
        let point = |at: [f32; 3]| bounds_of([at]);
        let mut mixed = boxes(5000);
        mixed.iter_mut().step_by(3).for_each(|one| *one = Aabb::empty());
        mixed[7] = Aabb::INFINITY;
        mixed[8] = Aabb::LARGEST;
        mixed[10] = point([f32::INFINITY; 3]);
        mixed[11] = point([f32::MAX, f32::MIN, 0.0]);
        mixed[13] = Aabb::new(Vec3A::splat(f32::NAN), Vec3A::ONE);
        let scenes = [
            every(&|_| around(0, 1.0)),
            every(&|i| around(0, 1.0 + 1e-4 * i as f32)),
            every(&|i| around(0, 2.0 - 1e-4 * i as f32)),
            every(&|i| around(i * i, i as f32)),
            every(&|i| point([0.0, i as f32, 0.0])),
            every(&|i| point([1e-40 * i as f32, 0.0, 0.0])),
            every(&|_| point([0.0; 3])),
            every(&|_| Aabb::LARGEST),
            every(&|_| Aabb::INFINITY),
            every(&|i| around(i, 1e30)),
            every(&|i| point([if i % 3 == 0 { f32::MAX } else { f32::MIN }; 3])),
            every(&|i| point([if i % 3 == 0 { f32::MAX } else { f32::MIN }, 0.0, 0.0])),
            every(&|i| point([1e30 * i as f32; 3])),
            mixed,
        ];
        for (scene, boxes) in scenes.iter().enumerate() {
            let tree = Bvh8::top(boxes, &Rows::<1>);
            check_tree::<1>(&tree, boxes);
            // Far fewer levels than boxes: a walk puts off up to seven a level.
            assert!(tree.stack < 200, "{scene}: {}", tree.stack);
        }
        for count in (0..20).chain([1023, 1024, 1025, 3000, 20_000]) {
            check_tree::<1>(&Bvh8::top(&boxes(count), &Rows::<1>), &boxes(count));
        }
    }

    /// They are as good as what takes several times as long.
    #[test]
    fn top_levels_cost_no_more_than_fast_builds() {
        for count in [10, 100, 1000, 10_000, 50_000] {
            let boxes = boxes(count);
            let [top, fast] = [Bvh8::top(&boxes, &Rows::<1>), Bvh8::build(&boxes, Quality::Fast, &Rows::<1>)];
            assert!(top.cost < 1.05 * fast.cost, "{count}: {} {}", top.cost, fast.cost);
        }
    }

    fn check<const MOST: usize>(boxes: &[Aabb], quality: Quality) {
        check_tree::<MOST>(&Bvh8::build(boxes, quality, &Rows::<MOST>), boxes);
    }

    #[track_caller]
    fn check_tree<const MOST: usize>(tree: &Bvh8, boxes: &[Aabb]) {
        let (mut seen, mut used) = (vec![0; boxes.len()], 0);
        let put_off = tree.root.map_or(0, |root| {
            check_below::<MOST>(tree, boxes, root, &Aabb::INFINITY, &mut |granules, rows| {
                used += granules;
                rows.iter().for_each(|&row| seen[row as usize] += 1);
            })
        });
        assert!(seen.iter().zip(boxes).all(|(&count, one)| count == u32::from(one.valid())));
        assert_eq!((put_off, used), (tree.stack, tree.arena.granules().len()));
    }

    /// Checks a subtree and returns the most that a walk through it puts off.
    fn check_below<const MOST: usize>(
        tree: &Bvh8,
        boxes: &[Aabb],
        child: u32,
        within: &Aabb,
        visit: &mut impl FnMut(usize, &[u32]),
    ) -> usize {
        let holds = |inner: &Aabb| {
            (0..3).all(|axis| within.min[axis] <= inner.min[axis] && inner.max[axis] <= within.max[axis])
        };
        let arena = tree.arena.granules();
        if child & LEAF != 0 {
            let held = &arena[(child & !LEAF) as usize..];
            let rows: Vec<u32> = held[..held[0].0[1] as usize].iter().map(|granule| granule.0[0]).collect();
            assert!((1..=MOST).contains(&rows.len()) && rows.iter().all(|&row| holds(&boxes[row as usize])));
            visit(rows.len(), &rows);
            return 0;
        }
        let node = Node::at(arena, child);
        let plane = |plane: usize, lane: usize| node.0[plane].values()[lane];
        let real: Vec<usize> = (0..LANES).filter(|&lane| plane(0, lane) <= plane(1, lane)).collect();
        let mut most = real.len();
        visit(NODE, &[]);
        for &lane in &real {
            let [lo, hi] =
                [0, 1].map(|side| Vec3A::from_array(std::array::from_fn(|axis| plane(2 * axis + side, lane))));
            let bounds = Aabb::new(lo, hi);
            assert!(holds(&bounds));
            most = most.max(real.len() - 1 + check_below::<MOST>(tree, boxes, node.children()[lane], &bounds, visit));
        }
        most
    }

    /// Whoever builds which part of it: pieces are solved and written by any thread.
    #[test]
    fn the_tree_does_not_depend_on_the_number_of_threads() {
        let boxes = boxes(40_000);
        for quality in QUALITIES {
            let built = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| Bvh8::build(&boxes, quality, &Rows::<8>))
            };
            let alone = built(1);
            for threads in [2, 5] {
                let tree = built(threads);
                assert!(tree.arena.granules() == alone.arena.granules(), "{threads} threads");
                assert_eq!((tree.root, tree.stack), (alone.root, alone.stack));
            }
        }
        let built = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Bvh8::top(&boxes, &Rows::<1>))
        };
        let alone = built(1);
        for tree in [2, 5].map(built) {
            assert!(tree.arena.granules() == alone.arena.granules());
            assert_eq!((tree.root, tree.stack, tree.cost), (alone.root, alone.stack, alone.cost));
        }
    }
}
