//! Meshes placed in the world: a tree over instances, each with the tree of its mesh.

use std::sync::Arc;

use super::{
    Blas, Coverage, Rays,
    bvh8::{Bvh8, INSTANCE, Stack},
    collapse::References,
    leaf::{Block, BlockHit, QUAD},
    merge::Merged,
    mesh::Other,
    opacity::Opacity,
    open::{SHARE, Seen, open},
    packet, queue, slot,
    structure::{Counters, Nearest},
    triangle::{Ray, TriangleHit},
    way::Way,
};
use crate::{flat::NONE, simd::LANES};

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
}

impl InstanceRef {
    /// A mesh where it was made.
    pub fn unmoved(blas: Arc<Blas>) -> Self {
        let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        Self { blas, world_from_local: identity, local_from_world: identity, identity: true }
    }
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
    /// The placed meshes, and after them the merged one, if there is any.
    pub(super) instances: Vec<InstanceRef>,
    /// Into each of those.
    pub(super) ways: Vec<Way>,
    /// Placed meshes.
    placed: usize,
    pub(super) merged: Merged,
    /// What the top level leads to.
    pub(super) parts: Vec<Part>,
    /// The top level leads to one part, whose tree rays go into at once.
    pub(super) alone: bool,
    /// Rows of instances that are in no box, and are tested before all others.
    pub(super) unbounded: Vec<u32>,
    bounds: Option<([f32; 3], [f32; 3])>,
    /// The trees are deeper than a queue's slots, so that rays go one by one.
    pub(super) deep: bool,
    /// Some mesh is in another structure than the eight-wide tree, and rays go one by one for that.
    pub(super) others: bool,
}

impl Accel {
    /// Over placed meshes, in the order of their rows.
    pub fn build(instances: Vec<InstanceRef>) -> Self {
        // Threads are woken once, and only if it takes longer than that.
        if instances.len() > SHARE {
            rayon::scope(|_| Self::build_here(instances))
        } else {
            Self::build_here(instances)
        }
    }

    fn build_here(mut instances: Vec<InstanceRef>) -> Self {
        let placed = instances.len();
        let mut seen = Seen::of(&instances);
        let (merged, together) = if seen.unmoved > 1 { Merged::of(&instances).unzip() } else { (None, None) };
        let merged = merged.unwrap_or_default();
        let all = seen.all;
        if let Some(together) = together {
            seen.add(placed as u32, &together);
            instances.push(together);
        }
        let unbounded = std::mem::take(&mut seen.unbounded);
        let Seen { deepest, shapes, others, .. } = seen;
        let (parts, boxes) = open(&instances, &merged, seen, all.half_area());
        let is_shape = |part: u32| shapes && instances[parts[part as usize].instance as usize].blas.is_shape();
        let reference = |part: u32| part | if is_shape(part) { SHAPE } else { INSTANCE };
        let tree = Bvh8::top(&boxes, &References(reference));
        let alone = parts.len() == 1 && !is_shape(0);
        let bounds = all.valid().then(|| (all.min.to_array(), all.max.to_array()));
        let deep = tree.stack + deepest + 1 > slot::STACK;
        let ways = Way::into_all(&instances);
        Self { tree, instances, ways, placed, merged, parts, alone, unbounded, bounds, deep, others }
    }

    /// Lowest and highest corner of everything, if there is anything.
    pub fn bounds(&self) -> Option<([f32; 3], [f32; 3])> {
        self.bounds
    }

    /// Placed meshes.
    pub fn instances(&self) -> &[InstanceRef] {
        &self.instances[..self.placed]
    }

    /// Bytes of the top level, what is merged into it included; meshes are counted by [`Blas::bytes`].
    pub fn bytes(&self) -> usize {
        let merged: usize = self.instances[self.placed..].iter().map(|one| one.blas.bytes()).sum();
        let rows =
            self.instances.len() * (size_of::<InstanceRef>() + size_of::<Way>()) + self.parts.len() * size_of::<Part>();
        self.tree.bytes() + rows + merged + self.merged.bytes()
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
        if !ray.is_finite() {
            return best;
        }
        if !self.unbounded.is_empty() {
            self.meet_unbounded(&ray, &mut t_max, &mut best, ray_id, coverage);
        }
        self.tree.walk::<true>(self.tree.root, &ray, &mut t_max, top, &mut (), |row, t_max| {
            let part = self.parts[(row & !QUAD) as usize];
            let instance = &self.instances[part.instance as usize];
            nearest_in(self, instance, part, &ray, t_max, &mut best, ray_id, coverage, mesh);
            false
        });
        best
    }

    /// [`Accel::nearest`] of all `rays`; `done` gets the index and the hit of each, in no particular order.
    pub fn nearest_of<C: Coverage>(&self, rays: &impl Rays, coverage: &C, done: impl FnMut(usize, &Hit)) {
        self.nearest_counted(rays, coverage, &mut (), done);
    }

    /// [`Accel::nearest_of`], counting its work, but only where rays go in waves: in eight-wide trees that are not too deep.
    ///
    /// A node counts for each eight tests of a box, whether of a node's boxes by a ray or by the bounds of a packet, or of
    /// one box by eight rays; triangles count for each ray that is tested, idle lanes with them.
    pub fn nearest_counted<C: Coverage>(
        &self,
        rays: &impl Rays,
        coverage: &C,
        counters: &mut impl Counters,
        done: impl FnMut(usize, &Hit),
    ) {
        if self.deep || self.others {
            let mut stacks = Stacks::default();
            let mut done = done;
            for index in 0..rays.count() {
                let (origin, direction, t_max) = rays.ray(index);
                done(index, &self.nearest(origin, direction, t_max, rays.id(index), coverage, &mut stacks));
            }
        } else if rays.coherent_from() < rays.count() {
            packet::trace::<false, C>(self, rays, coverage, counters, done);
        } else {
            queue::trace::<false, C>(self, rays, coverage, counters, done);
        }
    }

    /// [`Accel::occluded`] of all `rays`; `done` gets the index and the answer for each, in no particular order.
    pub fn occluded_of<C: Coverage>(&self, rays: &impl Rays, coverage: &C, done: impl FnMut(usize, bool)) {
        self.occluded_counted(rays, coverage, &mut (), done);
    }

    /// [`Accel::occluded_of`], counting its work, but only where rays go in waves: in eight-wide trees that are not too deep.
    pub fn occluded_counted<C: Coverage>(
        &self,
        rays: &impl Rays,
        coverage: &C,
        counters: &mut impl Counters,
        mut done: impl FnMut(usize, bool),
    ) {
        if self.deep || self.others {
            let mut stacks = Stacks::default();
            for index in 0..rays.count() {
                let (origin, direction, t_max) = rays.ray(index);
                done(index, self.occluded(origin, direction, t_max, rays.id(index), coverage, &mut stacks));
            }
            return;
        }
        let done = |index: usize, hit: &Hit| done(index, hit.instance != NONE);
        if rays.coherent_from() < rays.count() {
            packet::trace::<true, C>(self, rays, coverage, counters, done);
        } else {
            queue::trace::<true, C>(self, rays, coverage, counters, done);
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
        if !ray.is_finite() {
            return false;
        }
        if !self.unbounded.is_empty() {
            let mut best = NO_HIT;
            self.meet_unbounded(&ray, &mut t_max, &mut best, ray_id, coverage);
            if best != NO_HIT {
                return true;
            }
        }
        let mut found = false;
        self.tree.walk::<false>(self.tree.root, &ray, &mut t_max, top, &mut (), |row, t_max| {
            let part = self.parts[(row & !QUAD) as usize];
            let instance = &self.instances[part.instance as usize];
            found = occluded_in(self, instance, part, &ray, *t_max, ray_id, coverage, mesh);
            found
        });
        found
    }
}

impl Accel {
    /// Tests an instance that is a shape. Kept out of line: it is no part of the walk through a tree.
    #[inline(never)]
    pub(super) fn meet_shape<C: Coverage>(
        &self,
        row: u32,
        ray: &Ray,
        t_max: &mut f32,
        best: &mut Hit,
        ray_id: u32,
        coverage: &C,
    ) {
        let instance = &self.instances[row as usize];
        let (Some(shape), part) = (&instance.blas.other, Part { instance: row, root: 0 }) else { return };
        in_local(self, row, ray, |local| nearest_in_other(shape, instance, part, local, t_max, best, ray_id, coverage));
    }

    /// [`Accel::meet_shape`] of all that are in no box.
    #[inline(never)]
    pub(super) fn meet_unbounded<C: Coverage>(
        &self,
        ray: &Ray,
        t_max: &mut f32,
        best: &mut Hit,
        ray_id: u32,
        coverage: &C,
    ) {
        for &row in &self.unbounded {
            self.meet_shape(row, ray, t_max, best, ray_id, coverage);
        }
    }
}

/// Marks a child reference of the top level as an instance that is a shape, of which the other bits are the part.
pub(super) const SHAPE: u32 = INSTANCE | QUAD;

/// Calls `look` with the ray as the instance's mesh sees it, if it can be seen from there.
#[inline(always)]
fn in_local<T: Default>(accel: &Accel, row: u32, ray: &Ray, look: impl FnOnce(&Ray) -> T) -> T {
    if accel.instances[row as usize].identity {
        return look(ray);
    }
    let local = accel.ways[row as usize].lead(ray.origin, ray.direction);
    if local.is_finite() { look(&local) } else { T::default() }
}

#[inline(always)]
pub(super) fn nearest_in<C: Coverage>(
    accel: &Accel,
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
    if let Some(other) = &blas.other {
        in_local(accel, part.instance, ray, |local| {
            nearest_in_other(other, instance, part, local, t_max, best, ray_id, coverage)
        });
        return;
    }
    let arena = blas.tree.arena.granules();
    in_local(accel, part.instance, ray, |local| {
        blas.tree.walk::<true>(Some(part.root), local, t_max, stack, &mut (), |block, t_max| {
            let block = Block::at(arena, block);
            let met = block.intersect(local, *t_max);
            let mut lanes = met.hits;
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize & (LANES - 1);
                lanes &= lanes - 1;
                let found = accel.merged.named(hit_of(&met, block.row(lane), part.instance, lane));
                let nearer = found.t < best.t
                    || found.t == best.t && (found.instance, found.triangle) < (best.instance, best.triangle);
                if nearer && is_there(block.opacity(lane), ray_id, &found, coverage) {
                    *best = found;
                    *t_max = found.t;
                }
            }
            false
        })
    });
}

/// As [`nearest_in`], where the triangles are not in an eight-wide tree. Kept out of line, because the stacks of all
/// structures would lie on that of every ray.
#[inline(never)]
fn nearest_in_other<C: Coverage>(
    other: &Other,
    instance: &InstanceRef,
    part: Part,
    local: &Ray,
    t_max: &mut f32,
    best: &mut Hit,
    ray_id: u32,
    coverage: &C,
) {
    let before = *best;
    let mut found = Nearest::none(*t_max);
    other.nearest(local, &mut found, |triangle, hit| {
        // An instance is entered once: of its own triangles the structure takes the smaller at equal t.
        (hit.t < before.t || part.instance < before.instance)
            && (C::TRIVIAL || !instance.blas.asks || coverage.covers(ray_id, &placed(part.instance, triangle, hit)))
    });
    if found.triangle != NONE {
        let Nearest { t, triangle, b1, b2, back } = found;
        *best = Hit { t, instance: part.instance, triangle, b1, b2, back };
        *t_max = t;
    }
}

/// As [`occluded_in`], where the triangles are not in an eight-wide tree.
#[inline(never)]
fn occluded_in_other<C: Coverage>(
    other: &Other,
    instance: &InstanceRef,
    part: Part,
    local: &Ray,
    t_max: f32,
    ray_id: u32,
    coverage: &C,
) -> bool {
    other.occluded(local, t_max, |triangle, hit| {
        C::TRIVIAL || !instance.blas.asks || coverage.covers(ray_id, &placed(part.instance, triangle, hit))
    })
}

/// False if a hit is of something that is not there for the ray.
#[inline(always)]
pub(super) fn is_there<C: Coverage>(opacity: Opacity, ray_id: u32, hit: &Hit, coverage: &C) -> bool {
    C::TRIVIAL
        || match opacity {
            Opacity::Solid => true,
            Opacity::FrontOnly => C::BACKS || !hit.back,
            Opacity::Asked => coverage.covers(ray_id, hit),
        }
}

/// A hit of a mesh as one of an instance.
#[inline(always)]
fn placed(instance: u32, triangle: u32, &TriangleHit { t, b1, b2, back }: &TriangleHit) -> Hit {
    Hit { t, instance, triangle, b1, b2, back }
}

#[inline(always)]
pub(super) fn hit_of(met: &BlockHit, triangle: u32, instance: u32, lane: usize) -> Hit {
    Hit { t: met.t[lane], instance, triangle, b1: met.b1[lane], b2: met.b2[lane], back: met.back >> lane & 1 == 1 }
}

#[inline(always)]
fn occluded_in<C: Coverage>(
    accel: &Accel,
    instance: &InstanceRef,
    part: Part,
    ray: &Ray,
    t_max: f32,
    ray_id: u32,
    coverage: &C,
    stack: &mut Stack,
) -> bool {
    let blas = &*instance.blas;
    if let Some(other) = &blas.other {
        return in_local(accel, part.instance, ray, |local| {
            occluded_in_other(other, instance, part, local, t_max, ray_id, coverage)
        });
    }
    let arena = blas.tree.arena.granules();
    let mut found = false;
    let mut t_end = t_max;
    in_local(accel, part.instance, ray, |local| {
        blas.tree.walk::<false>(Some(part.root), local, &mut t_end, stack, &mut (), |block, t_end| {
            let block = Block::at(arena, block);
            let met = block.intersect(local, *t_end);
            let mut hits = (0..LANES).filter(|lane| met.hits >> lane & 1 == 1);
            found = hits.any(|lane| {
                let hit = accel.merged.named(hit_of(&met, block.row(lane), part.instance, lane));
                is_there(block.opacity(lane), ray_id, &hit, coverage)
            });
            found
        })
    });
    found
}
