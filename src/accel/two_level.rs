//! Meshes placed in the world: a tree over instances, each with the tree of its mesh.

use std::sync::Arc;

use obvhs::aabb::Aabb;
use rayon::prelude::*;

use super::{
    Coverage, Rays,
    bvh8::{Bvh8, INSTANCE, KIND, LEAF, Node, Quality, Stack, bounds_of},
    queue,
    space::{Bounds, blurred, covered},
    structure::{Cell, Counters, Nearest, Shape, Structure},
    triangle::{BlockHit, Ray, TriangleBlock, TriangleHit, has_area},
};
use crate::{flat::NONE, simd::LANES};

/// Rays against the triangles of one mesh, in its local space.
#[derive(Clone, Debug)]
pub struct Blas {
    pub(super) tree: Bvh8,
    bounds: Aabb,
    /// Triangles in it.
    references: usize,
}

impl Default for Blas {
    fn default() -> Self {
        Self { tree: Bvh8::default(), bounds: Aabb::empty(), references: 0 }
    }
}

impl Blas {
    /// Over triangles given by their corners, which must be finite. Those without area are left out.
    pub fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        let whole = triangles.iter().flatten().fold(Bounds::EMPTY, |all, &corner| all.union(&Bounds::of(&[corner])));
        let covered = covered(&whole);
        let bounds_of = |corners: &[[f32; 3]; 3]| {
            let Bounds { lower, upper } = if has_area(corners) { blurred(corners, covered) } else { Bounds::EMPTY };
            Aabb::new(lower.into(), upper.into())
        };
        let boxes: Vec<Aabb> = triangles.par_iter().map(bounds_of).collect();
        let bounds = boxes.iter().fold(Aabb::empty(), |all, one| all.union(one));
        let tree = Bvh8::build(&boxes, Quality::Good, LANES, |rows, arena| {
            // In order of rows, so that the block does not depend on how the tree came to it.
            rows.sort_unstable();
            LEAF | TriangleBlock::new(rows.iter().map(|&row| (row, triangles[row as usize]))).store(arena)
        });
        let references = boxes.iter().filter(|one| one.valid()).count();
        Self { tree, bounds, references }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.tree.bytes()
    }

    /// Lowest and highest corner; lowest above highest if there is no triangle.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        (self.bounds.min.to_array(), self.bounds.max.to_array())
    }
}

impl Structure for Blas {
    const NAME: &'static str = "bvh8";

    fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        Self::build(triangles)
    }

    fn bytes(&self) -> usize {
        self.bytes()
    }

    fn references(&self) -> usize {
        self.references
    }

    fn cells(&self, visit: &mut dyn FnMut(Cell)) {
        let root = self.tree.root.map(|root| (root, self.bounds, 0));
        let mut pending: Vec<_> = root.into_iter().collect();
        while let Some((reference, bounds, depth)) = pending.pop() {
            let arena = self.tree.arena.granules();
            let leaf = reference & KIND == LEAF;
            let rows = || TriangleBlock::at(arena, reference & !KIND);
            let held = leaf.then(|| (0..LANES).filter(|&lane| rows().row(lane) != NONE).count());
            let (lower, upper) = (bounds.min.to_array(), bounds.max.to_array());
            visit(Cell { depth, held, shape: Shape::Box { lower, upper } });
            if !leaf {
                let children = Node::at(arena, reference).boxes();
                pending.extend(children.map(|(bounds, child)| (child, bounds, depth + 1)));
            }
        }
    }

    /// One ray alone, for comparison; waves go through [`Accel::nearest_of`].
    fn nearest(
        &self,
        ray: &Ray,
        best: &mut Nearest,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    ) {
        let arena = self.tree.arena.granules();
        let (mut t_max, mut tested) = (best.t, 0);
        self.tree.walk::<true>(self.tree.root, ray, &mut t_max, &mut Stack::default(), counters, |block, t_max| {
            let block = TriangleBlock::at(arena, block);
            tested += LANES;
            let met = block.intersect(ray, *t_max);
            for lane in (0..LANES).filter(|lane| met.hits >> lane & 1 == 1) {
                best.offer(block.row(lane), &met.hit(lane), &accept);
            }
            *t_max = best.t;
            false
        });
        counters.triangles(tested);
    }

    fn occluded(
        &self,
        ray: &Ray,
        t_max: f32,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    ) -> bool {
        let arena = self.tree.arena.granules();
        let (mut t_max, mut tested, mut found) = (t_max, 0, false);
        self.tree.walk::<false>(self.tree.root, ray, &mut t_max, &mut Stack::default(), counters, |block, t_max| {
            let block = TriangleBlock::at(arena, block);
            tested += LANES;
            let met = block.intersect(ray, *t_max);
            found = (0..LANES).any(|lane| met.hits >> lane & 1 == 1 && accept(block.row(lane), &met.hit(lane)));
            found
        });
        counters.triangles(tested);
        found
    }
}

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Along the ray; infinite for none.
    pub t: f32,
    /// Row of the instance, or `NONE`.
    pub instance: u32,
    /// Row of the triangle in its mesh.
    pub triangle: u32,
    /// Barycentric of the second corner.
    pub b1: f32,
    /// Barycentric of the third corner.
    pub b2: f32,
    /// True if the back is met.
    pub back: bool,
}

/// The ray met nothing.
pub const NO_HIT: Hit = Hit { t: f32::INFINITY, instance: NONE, triangle: NONE, b1: 0.0, b2: 0.0, back: false };

/// One placed mesh. Matrices are 3×4 by rows.
#[derive(Clone, Debug)]
pub struct InstanceRef {
    /// Its mesh.
    pub blas: Arc<Blas>,
    /// World from local space.
    pub world_from_local: [f32; 12],
    /// Local from world space.
    pub local_from_world: [f32; 12],
    /// True if the transform changes nothing.
    pub identity: bool,
    /// True if hits must be confirmed by a [`Coverage`].
    pub check: bool,
}

/// Scratch of a traversal: a stack for the top level and one for meshes.
#[derive(Clone, Debug, Default)]
pub struct Stacks {
    top: Stack,
    mesh: Stack,
}

/// A subtree of an instance's mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    /// Row of the instance.
    pub instance: u32,
    /// The subtree, in the arena of the mesh.
    pub root: u32,
}

/// Rays against the whole scene.
#[derive(Clone, Debug, Default)]
pub struct Accel {
    pub(super) tree: Bvh8,
    pub(super) instances: Vec<InstanceRef>,
    /// What the top level leads to.
    pub(super) parts: Vec<Part>,
    bounds: Option<([f32; 3], [f32; 3])>,
    /// The trees are deeper than a queue's slots, so that rays go one by one.
    pub(super) deep: bool,
}

/// A 3×4 matrix, by rows, times a point.
#[inline(always)]
pub(crate) fn transform_point(m: &[f32; 12], p: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|row| {
        let m = &m[row * 4..row * 4 + 4];
        m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3]
    })
}

/// The linear part of a 3×4 matrix, by rows, times a vector.
#[inline(always)]
pub(crate) fn transform_vector(m: &[f32; 12], v: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|row| {
        let m = &m[row * 4..row * 4 + 4];
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2]
    })
}

impl Accel {
    /// Over placed meshes, in the order of their rows.
    pub fn build(instances: Vec<InstanceRef>) -> Self {
        let boxes: Vec<Aabb> = instances.par_iter().map(|one| world_bounds(one, &one.blas.bounds)).collect();
        let all = boxes.iter().filter(|one| one.valid()).fold(Aabb::empty(), |all, one| all.union(one));
        let (parts, boxes) = open(&instances, boxes, all.half_area());
        let tree = Bvh8::build(&boxes, Quality::Fast, 1, |rows, _| INSTANCE | rows[0]);
        let bounds = all.valid().then(|| (all.min.to_array(), all.max.to_array()));
        let deepest = instances.iter().map(|one| one.blas.tree.stack).max().unwrap_or(0);
        let deep = tree.stack + deepest + 1 > queue::STACK;
        Self { tree, instances, parts, bounds, deep }
    }

    /// Says again which instances need their hits confirmed.
    pub fn set_checks(&mut self, mut check: impl FnMut(usize) -> bool) {
        for (row, instance) in self.instances.iter_mut().enumerate() {
            instance.check = check(row);
        }
    }

    /// Lowest and highest corner of everything, if there is anything.
    pub fn bounds(&self) -> Option<([f32; 3], [f32; 3])> {
        self.bounds
    }

    /// Placed meshes.
    pub fn instances(&self) -> &[InstanceRef] {
        &self.instances
    }

    /// Bytes of the top level; meshes are counted by [`Blas::bytes`].
    pub fn bytes(&self) -> usize {
        self.tree.bytes() + self.instances.len() * size_of::<InstanceRef>() + self.parts.len() * size_of::<Part>()
    }

    /// The nearest hit with 0 < t ≤ `t_max`; at equal t that of the smaller (instance, triangle).
    #[inline]
    pub fn nearest<C: Coverage>(
        &self,
        origin: [f32; 3],
        direction: [f32; 3],
        t_max: f32,
        ray_id: u32,
        coverage: &C,
        Stacks { top, mesh }: &mut Stacks,
    ) -> Hit {
        let mut best = NO_HIT;
        let ray = Ray::new(origin, direction);
        let mut t_max = t_max;
        self.tree.walk::<true>(self.tree.root, &ray, &mut t_max, top, &mut (), |row, t_max| {
            let part = self.parts[row as usize];
            let instance = &self.instances[part.instance as usize];
            nearest_in(instance, part, &ray, t_max, &mut best, ray_id, coverage, mesh);
            false
        });
        best
    }

    /// [`Accel::nearest`] of all `rays`; `done` gets the index and the hit of each, in no particular order.
    pub fn nearest_of<C: Coverage>(&self, rays: &impl Rays, coverage: &C, done: impl FnMut(usize, &Hit)) {
        self.nearest_counted(rays, coverage, &mut (), done);
    }

    /// [`Accel::nearest_of`], counting its work; that of scenes too deep for waves is not counted.
    pub fn nearest_counted<C: Coverage>(
        &self,
        rays: &impl Rays,
        coverage: &C,
        counters: &mut impl Counters,
        done: impl FnMut(usize, &Hit),
    ) {
        if self.deep {
            let mut stacks = Stacks::default();
            let mut done = done;
            for index in 0..rays.count() {
                let (origin, direction, t_max) = rays.ray(index);
                done(index, &self.nearest(origin, direction, t_max, rays.id(index), coverage, &mut stacks));
            }
        } else {
            queue::trace::<false, C>(self, rays, coverage, counters, done);
        }
    }

    /// [`Accel::occluded`] of all `rays`; `done` gets the index and the answer for each, in no particular order.
    pub fn occluded_of<C: Coverage>(&self, rays: &impl Rays, coverage: &C, done: impl FnMut(usize, bool)) {
        self.occluded_counted(rays, coverage, &mut (), done);
    }

    /// [`Accel::occluded_of`], counting its work; that of scenes too deep for waves is not counted.
    pub fn occluded_counted<C: Coverage>(
        &self,
        rays: &impl Rays,
        coverage: &C,
        counters: &mut impl Counters,
        mut done: impl FnMut(usize, bool),
    ) {
        if self.deep {
            let mut stacks = Stacks::default();
            for index in 0..rays.count() {
                let (origin, direction, t_max) = rays.ray(index);
                done(index, self.occluded(origin, direction, t_max, rays.id(index), coverage, &mut stacks));
            }
        } else {
            queue::trace::<true, C>(self, rays, coverage, counters, |index, hit| done(index, hit.instance != NONE));
        }
    }

    /// True if anything is hit with 0 < t ≤ `t_max`.
    #[inline]
    pub fn occluded<C: Coverage>(
        &self,
        origin: [f32; 3],
        direction: [f32; 3],
        t_max: f32,
        ray_id: u32,
        coverage: &C,
        Stacks { top, mesh }: &mut Stacks,
    ) -> bool {
        let ray = Ray::new(origin, direction);
        let mut t_max = t_max;
        let mut found = false;
        self.tree.walk::<false>(self.tree.root, &ray, &mut t_max, top, &mut (), |row, t_max| {
            let part = self.parts[row as usize];
            let instance = &self.instances[part.instance as usize];
            found = occluded_in(instance, part, &ray, *t_max, ray_id, coverage, mesh);
            found
        });
        found
    }
}

/// A ray as the instance's mesh sees it.
#[inline(always)]
pub(super) fn to_local(instance: &InstanceRef, origin: [f32; 3], direction: [f32; 3]) -> Ray {
    let m = &instance.local_from_world;
    Ray::new(transform_point(m, origin), transform_vector(m, direction))
}

/// Calls `look` with the ray as the instance's mesh sees it.
#[inline(always)]
fn in_local<T>(instance: &InstanceRef, ray: &Ray, look: impl FnOnce(&Ray) -> T) -> T {
    let local;
    look(if instance.identity {
        ray
    } else {
        local = to_local(instance, ray.origin, ray.direction);
        &local
    })
}

#[inline(always)]
fn nearest_in<C: Coverage>(
    instance: &InstanceRef,
    part: Part,
    ray: &Ray,
    t_max: &mut f32,
    best: &mut Hit,
    ray_id: u32,
    coverage: &C,
    stack: &mut Stack,
) {
    let blas = &*instance.blas;
    let arena = blas.tree.arena.granules();
    in_local(instance, ray, |local| {
        blas.tree.walk::<true>(Some(part.root), local, t_max, stack, &mut (), |block, t_max| {
            let block = TriangleBlock::at(arena, block);
            let met = block.intersect(local, *t_max);
            let mut lanes = met.hits;
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize & (LANES - 1);
                lanes &= lanes - 1;
                let found = hit_of(&met, block, part.instance, lane);
                let nearer = found.t < best.t
                    || found.t == best.t && (part.instance, found.triangle) < (best.instance, best.triangle);
                if nearer && (C::TRIVIAL || !instance.check || coverage.covers(ray_id, &found)) {
                    *best = found;
                    *t_max = found.t;
                }
            }
            false
        })
    });
}

#[inline(always)]
pub(super) fn hit_of(met: &BlockHit, block: &TriangleBlock, instance: u32, lane: usize) -> Hit {
    Hit {
        t: met.t[lane],
        instance,
        triangle: block.row(lane),
        b1: met.b1[lane],
        b2: met.b2[lane],
        back: met.back >> lane & 1 == 1,
    }
}

#[inline(always)]
fn occluded_in<C: Coverage>(
    instance: &InstanceRef,
    part: Part,
    ray: &Ray,
    t_max: f32,
    ray_id: u32,
    coverage: &C,
    stack: &mut Stack,
) -> bool {
    let blas = &*instance.blas;
    let arena = blas.tree.arena.granules();
    let mut found = false;
    let mut t_end = t_max;
    in_local(instance, ray, |local| {
        blas.tree.walk::<false>(Some(part.root), local, &mut t_end, stack, &mut (), |block, t_end| {
            let block = TriangleBlock::at(arena, block);
            let met = block.intersect(local, *t_end);
            found = met.hits != 0
                && (C::TRIVIAL
                    || !instance.check
                    || (0..LANES).any(|lane| {
                        met.hits >> lane & 1 == 1 && coverage.covers(ray_id, &hit_of(&met, block, part.instance, lane))
                    }));
            found
        })
    });
    found
}

/// What the top level leads to, with boxes in the world: whole meshes, but of large ones the subtrees.
///
/// Meshes overlap, and the box of a large one says little of where its triangles are; opened, the top level can lead a
/// ray past what it would have had to enter (Benthin et al. 2017, "Improved Two-Level BVHs using Partial
/// Re-Braiding"). A part that has a transform of its own costs more to enter, so fewer of those are made.
fn open(instances: &[InstanceRef], boxes: Vec<Aabb>, scene_area: f32) -> (Vec<Part>, Vec<Aabb>) {
    let most = 4 * instances.len() + 2048;
    let (mut parts, mut bounds) = (Vec::new(), Vec::new());
    for (row, (instance, whole)) in instances.iter().zip(boxes).enumerate() {
        let Some(root) = instance.blas.tree.root else { continue };
        parts.push(Part { instance: row as u32, root });
        bounds.push(whole);
    }
    if parts.len() == 1 {
        return (parts, bounds);
    }
    // Breadth first, so that the largest come before the budget is spent.
    let mut next = 0;
    while next < parts.len() && parts.len() + LANES <= most {
        let Part { instance: row, root } = parts[next];
        let instance = &instances[row as usize];
        let least = scene_area * if instance.identity { OPEN_IDENTITY } else { OPEN_PLACED };
        if root & KIND != 0 || bounds[next].half_area() <= least {
            next += 1;
            continue;
        }
        let mut children = Node::at(instance.blas.tree.arena.granules(), root).boxes();
        let (first, child) = children.next().expect("a node has children");
        parts[next] = Part { instance: row, root: child };
        bounds[next] = world_bounds(instance, &first);
        for (local, root) in children {
            parts.push(Part { instance: row, root });
            bounds.push(world_bounds(instance, &local));
        }
        // The first child is looked at again in its turn: now.
    }
    (parts, bounds)
}

/// Parts larger than this share of the scene's area are opened, if their mesh stands where it was made …
const OPEN_IDENTITY: f32 = 1.0 / 1024.0;
/// … and if it has been placed.
const OPEN_PLACED: f32 = 1.0 / 16.0;

/// A box in the world that holds a box of an instance, grown by the rounding of its transform.
fn world_bounds(instance: &InstanceRef, local: &Aabb) -> Aabb {
    if !local.valid() {
        return Aabb::empty();
    }
    if instance.identity {
        return *local;
    }
    let (lo, hi) = (local.min.to_array(), local.max.to_array());
    let m = &instance.world_from_local;
    let corner =
        |i: u32| -> [f32; 3] { std::array::from_fn(|axis| if i >> axis & 1 == 0 { lo[axis] } else { hi[axis] }) };
    let mut bounds = bounds_of((0..8).map(|i| transform_point(m, corner(i))));
    for row in 0..3 {
        let size = |axis: usize| lo[axis].abs().max(hi[axis].abs());
        let scale = (0..3).map(|axis| m[row * 4 + axis].abs() * size(axis)).sum::<f32>() + m[row * 4 + 3].abs();
        // The transform there and the ray's way back round a few times each.
        let grow = 16.0 * f32::EPSILON * scale;
        bounds.min[row] -= grow;
        bounds.max[row] += grow;
    }
    bounds
}
