//! Rays that run side by side, as those of a camera do, through the eight-wide trees together.
//!
//! A packet goes down the tree as one: a node's boxes are tested once, against the intervals that its rays' starts,
//! directions and ends lie in. What that lets pass is looked at again when its turn comes, eight rays at a time, and
//! left if none of them meets it; a leaf's triangles are tested one by one, each by eight rays at a time. What is hit is
//! what the queue would find, bit for bit: the arithmetic is the same.
//!
//! The interval test lets everything pass that a ray's own test would. For rays of the same signs that test is made of
//! operations that only grow, or only shrink, with each operand, rounding included, so that put together from the
//! extremes of the operands it gives bounds of what it gives for each ray, and no allowance is needed.
//!
//! Wald et al. 2001, "Interactive Rendering with Coherent Ray Tracing"; Boulos et al. 2006, "Geometric and Arithmetic
//! Culling Methods for Entire Ray Packets"; Overbeck et al. 2008, "Large Ray Packets for Real-time Whitted Ray Tracing".

mod gather;
mod hits;

use std::cell::Cell;

use wide::{f32x8, u16x8, u32x8};

use self::{
    gather::{Members, greatest},
    hits::Hits,
};
use super::{
    Coverage, Rays,
    arena::Granule,
    bvh8::{self, BEYOND, FAR_SCALE, KIND, Node},
    leaf::{Leaf, Met, NO_ROW, QUAD, Sheared, TriangleBlock, TriangleQuad},
    opacity::Opacity,
    queue,
    slot::{COMPRESS, CULL, LANE, OWN, STACK, sort4, sort8},
    structure::Counters,
    triangle::{Axis, Ray, Side},
    two_level::{Accel, Hit, Part, SHAPE, nearest_in},
};
use crate::{
    flat::NONE,
    simd::{LANES, prefetch},
};

/// Vectors of rays in a packet from the camera. Of 1, 2, 4 and 8, the last two are equally fast and a fifth faster than the
/// first; the smaller of them leaves fewer rays to the queue where directions change their signs.
const FROM_CAMERA: usize = 4;
/// Vectors of rays in a packet of which it only matters whether anything is in their way: those come sixteen together.
const IN_THE_WAY: usize = 2;
/// Fewer rays than this go alone through an instance that is not where its mesh is: making a packet of its own for it
/// costs about as much as that.
const FEW: u32 = 4;

/// A bit pattern for each ray of a packet: all ones or all zeros.
type Mask<const V: usize> = [f32x8; V];

/// Eight of a packet's rays.
#[derive(Clone, Copy, Debug)]
struct Eight {
    origin: [f32x8; 3],
    direction: [f32x8; 3],
    against: [f32x8; 3],
    sheared: Sheared,
    hits: Hits,
    /// Names of the rays, where some surface asks for them.
    ids: [u32; LANES],
}

/// What packets go through.
struct World<'a, C> {
    accel: &'a Accel,
    coverage: &'a C,
}

/// The extremes of a packet's rays by axis.
#[derive(Clone, Copy, Debug)]
struct Extremes {
    /// The start that is nearest to what lies ahead, and the slowest way there.
    ahead: f32,
    slow: f32,
    /// The start that is farthest from it, and the fastest way.
    behind: f32,
    fast: f32,
}

/// So many times eight rays.
#[derive(Clone, Debug)]
struct Packet<const V: usize> {
    eights: [Eight; V],
    extremes: [Extremes; 3],
    first: [Side; 3],
    last: [Side; 3],
    /// What [`Slot`](queue) has for one ray, of the farthest.
    reach: f32,
    limit: f32,
}

/// Subtrees put off.
#[derive(Debug)]
struct Stack {
    near: Vec<f32>,
    child: Vec<u32>,
    /// The node that each is a child of.
    parent: Vec<u32>,
}

impl Stack {
    fn new() -> Self {
        let of = || vec![0; STACK + LANES];
        Self { near: vec![0.0; STACK + LANES], child: of(), parent: of() }
    }
}

/// What a wave needs, kept for the next.
#[derive(Debug)]
struct Scratch {
    /// A packet from the camera, and as the mesh of an instance sees it.
    from_camera: [Packet<FROM_CAMERA>; 2],
    /// The same of rays of which it only matters whether anything is in their way.
    in_the_way: [Packet<IN_THE_WAY>; 2],
    top: Stack,
    mesh: Stack,
    /// For rays that go alone.
    alone: bvh8::Stack,
    /// Rays that run beside no others.
    after: Vec<u32>,
}

impl Scratch {
    fn new() -> Box<Self> {
        Box::new(Self {
            from_camera: [Packet::empty(), Packet::empty()],
            in_the_way: [Packet::empty(), Packet::empty()],
            top: Stack::new(),
            mesh: Stack::new(),
            alone: bvh8::Stack::default(),
            after: Vec::new(),
        })
    }
}

thread_local! {
    /// Some 20 KiB, which take as long to make as a few packets to trace.
    static SCRATCH: Cell<Option<Box<Scratch>>> = const { Cell::new(None) };
}

impl<const V: usize> Packet<V> {
    /// Nothing counts from now on beyond where all rays end.
    #[inline(always)]
    fn shorten(&mut self) {
        let t_max = greatest::<V>(std::array::from_fn(|vector| self.eights[vector].hits.t_max));
        self.reach = t_max * (BEYOND / FAR_SCALE);
        self.limit = f32::mul_add(t_max, CULL, f32::MIN_POSITIVE);
    }

    /// [`Node::distances`], of all rays: the least from which and the greatest up to which one may be in a box.
    #[inline(always)]
    fn distances(&self, node: &Node) -> (f32x8, f32x8) {
        let mut near = f32x8::ZERO;
        let mut far = f32x8::splat(self.reach);
        for (axis, planes) in node.planes().iter().enumerate() {
            let at = |side: Side| f32x8::new(*planes[side as usize..].first_chunk().expect("a side"));
            let Extremes { ahead, slow, behind, fast } = self.extremes[axis];
            // Below zero the other way would be the least; but then it is less than zero either way.
            near = ((f32x8::splat(ahead) - at(self.first[axis])) * f32x8::splat(slow)).fast_max(near);
            far = ((f32x8::splat(behind) - at(self.last[axis])) * f32x8::splat(fast)).fast_min(far);
        }
        (near, far * f32x8::splat(FAR_SCALE))
    }

    /// [`Node::distances`] of one box, for each ray: whether it meets it.
    #[inline(always)]
    fn meets(&self, node: &Node, lane: usize) -> impl Iterator<Item = f32x8> {
        let planes = node.planes();
        let at = |axis: usize, side: Side| f32x8::splat(planes[axis][side as usize + lane % LANES]);
        let near: [f32x8; 3] = std::array::from_fn(|axis| at(axis, self.first[axis]));
        let far: [f32x8; 3] = std::array::from_fn(|axis| at(axis, self.last[axis]));
        self.eights.iter().map(move |eight| {
            let (mut from, mut to) = (f32x8::ZERO, eight.hits.t_max * f32x8::splat(BEYOND / FAR_SCALE));
            for axis in 0..3 {
                from = ((eight.origin[axis] - near[axis]) * eight.against[axis]).fast_max(from);
                to = ((eight.origin[axis] - far[axis]) * eight.against[axis]).fast_min(to);
            }
            from.simd_le(to * f32x8::splat(FAR_SCALE))
        })
    }

    /// Calls `leaf` for the leaves below `root` that rays meet, and with those rays.
    #[inline(always)]
    fn walk<C: Counters>(
        &mut self,
        arena: &[Granule],
        root: u32,
        stack: &mut Stack,
        counters: &mut C,
        mut leaf: impl FnMut(&mut Self, u32, &Mask<V>, &mut C),
    ) {
        if root & KIND != 0 {
            leaf(self, root, &[f32x8::splat(f32::from_bits(u32::MAX)); V], counters);
            return;
        }
        let mut top = 0;
        let mut current = root;
        loop {
            counters.node();
            let node = Node::at(arena, current);
            counters.lanes(|| node.boxes().count());
            let (near, far) = self.distances(node);
            let met = near.simd_le(far);
            let mask = met.to_bitmask() as usize & 255;
            let count = mask.count_ones();
            let lanes = u32x8::from(u16x8::new(COMPRESS[mask]));
            let keys = (bytemuck::cast::<_, u32x8>(near) & u32x8::splat(OWN) | u32x8::new(LANE))
                & bytemuck::cast::<_, u32x8>(met);
            let keys = bytemuck::cast(keys.shuffle_wrapping(lanes));
            let keys = if count <= 4 { sort4(keys) } else { sort8(keys) };
            let children = u32x8::new(*node.children()).shuffle_wrapping(bytemuck::cast(keys)).to_array();
            stack.near[top..top + LANES].copy_from_slice(&keys.to_array());
            stack.child[top..top + LANES].copy_from_slice(&children);
            stack.parent[top..top + LANES].copy_from_slice(&[current; LANES]);
            top += count as usize;
            loop {
                if top == 0 {
                    return;
                }
                top -= 1;
                let near = stack.near[top];
                if near > self.limit {
                    continue;
                }
                let (child, parent) = (stack.child[top], stack.parent[top]);
                prefetch::<6, Granule>(arena, (child & !(KIND | QUAD)) as usize);
                let mut met = self.meets(Node::at(arena, parent), near.to_bits() as usize % LANES);
                if child & KIND == 0 {
                    if met.any(|eight| {
                        counters.node();
                        eight.to_bitmask() & 255 != 0
                    }) {
                        current = child;
                        break;
                    }
                    continue;
                }
                let mut active = [f32x8::ZERO; V];
                for (active, eight) in active.iter_mut().zip(met) {
                    counters.node();
                    *active = eight;
                }
                leaf(self, child, &active, counters);
            }
        }
    }

    /// Tests the triangles of a leaf.
    #[inline(always)]
    fn test<const ANY: bool, C: Coverage, L: Leaf>(
        &mut self,
        block: &L,
        &World { accel, coverage }: &World<C>,
        instance: u32,
        active: &Mask<V>,
        counters: &mut impl Counters,
    ) {
        let mut any = false;
        for (eight, &active) in self.eights.iter_mut().zip(active) {
            if active.to_bitmask() & 255 == 0 {
                continue;
            }
            for lane in 0..L::MOST {
                let triangle = block.row(lane);
                if triangle == NO_ROW {
                    break;
                }
                counters.triangles(LANES);
                counters.lanes(|| (active.to_bitmask() & 255).count_ones() as usize);
                let at = |corner: usize, axis: Axis| f32x8::splat(block.coordinate(corner, axis.number(), lane));
                let edges = eight.sheared.edges(at);
                if (edges.inside & active).to_bitmask() & 255 == 0 {
                    continue;
                }
                let mut met = eight.sheared.meet(edges, eight.hits.t_max);
                met.hits &= active;
                let name = accel.merged.name(instance, triangle);
                if !C::TRIVIAL {
                    match block.opacity(lane) {
                        Opacity::Solid => {}
                        Opacity::FrontOnly if C::BACKS => {}
                        Opacity::FrontOnly => met.hits &= !met.back,
                        Opacity::Asked => met.hits = ask(&met, &eight.ids, name, coverage),
                    }
                }
                any |= if ANY { eight.hits.stop(&met, name) } else { eight.hits.take(&met, name) };
            }
        }
        if any {
            self.shorten();
        }
    }

    /// Finds the nearest hits, or with `ANY` some hit for each ray that has one.
    fn trace<const ANY: bool, C: Coverage>(
        &mut self,
        world: &World<C>,
        local: &mut Self,
        (top, mesh): (&mut Stack, &mut Stack),
        alone: &mut bvh8::Stack,
        counters: &mut impl Counters,
    ) {
        let accel = world.accel;
        if !accel.unbounded.is_empty() {
            for eight in &mut self.eights {
                eight.one_by_one::<ANY>(255, |ray, t_max, best, id| {
                    accel.meet_unbounded(ray, t_max, best, id, world.coverage);
                });
            }
            self.shorten();
        }
        let Some(root) = accel.tree.root else { return };
        self.walk(accel.tree.arena.granules(), root, top, counters, |this, reference, active, counters| {
            let part = accel.parts[(reference & !SHAPE) as usize];
            let instance = &accel.instances[part.instance as usize];
            if instance.identity && !instance.blas.is_shape() {
                this.enter::<ANY, C>(world, part, active, mesh, counters);
                return;
            }
            let rays: u32 = active.iter().map(|eight| (eight.to_bitmask() & 255).count_ones()).sum();
            if rays >= FEW && !instance.blas.is_shape() && this.to_local(&instance.local_from_world, local) {
                local.enter::<ANY, C>(world, part, active, mesh, counters);
                for (eight, local) in this.eights.iter_mut().zip(&local.eights) {
                    eight.hits = local.hits;
                }
            } else {
                for (eight, &active) in this.eights.iter_mut().zip(active) {
                    eight.one_by_one::<ANY>(active.to_bitmask() & 255, |ray, t_max, best, id| {
                        nearest_in(accel, instance, part, ray, t_max, best, id, world.coverage, alone);
                    });
                }
            }
            this.shorten();
        });
    }

    /// Goes through a part of an instance, with rays as its mesh sees them.
    #[inline(never)]
    fn enter<const ANY: bool, C: Coverage>(
        &mut self,
        world: &World<C>,
        part: Part,
        among: &Mask<V>,
        stack: &mut Stack,
        counters: &mut impl Counters,
    ) {
        let arena = world.accel.instances[part.instance as usize].blas.tree.arena.granules();
        self.walk(arena, part.root, stack, counters, |this, reference, active, counters| {
            let active = std::array::from_fn(|vector| active[vector] & among[vector]);
            let place = reference & !(KIND | QUAD);
            if reference & QUAD == 0 {
                this.test::<ANY, C, _>(TriangleBlock::at(arena, place), world, part.instance, &active, counters);
            } else {
                this.test::<ANY, C, _>(TriangleQuad::at(arena, place), world, part.instance, &active, counters);
            }
        });
    }

    /// What each lane's ray hit.
    fn report(&self, mut done: impl FnMut(usize, &Hit)) {
        for (vector, eight) in self.eights.iter().enumerate() {
            eight.hits.each().iter().enumerate().for_each(|(lane, hit)| done(vector * LANES + lane, hit));
        }
    }
}

impl Eight {
    /// Calls `meet` for the rays in `lanes`, one by one, with where each ends, what it has hit, and its name.
    #[cold]
    fn one_by_one<const ANY: bool>(&mut self, mut lanes: u32, mut meet: impl FnMut(&Ray, &mut f32, &mut Hit, u32)) {
        let [origin, direction] = [self.origin, self.direction].map(|of| of.map(f32x8::to_array));
        let mut hits = self.hits.each();
        let mut t_max = self.hits.t_max.to_array();
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize % LANES;
            lanes &= lanes - 1;
            let ray = Ray::new(origin.map(|of| of[lane]), direction.map(|of| of[lane]));
            meet(&ray, &mut t_max[lane], &mut hits[lane], self.ids[lane]);
        }
        if ANY {
            t_max
                .iter_mut()
                .zip(&hits)
                .filter(|(_, hit)| hit.instance != NONE)
                .for_each(|(end, _)| *end = hits::STOPPED);
        }
        self.hits = Hits::of(t_max, &hits);
    }
}

/// Of the rays that meet a triangle, those that stop there.
#[cold]
fn ask<C: Coverage>(met: &Met, ids: &[u32; LANES], (instance, triangle): (u32, u32), coverage: &C) -> f32x8 {
    let [t, b1, b2] = [met.t, met.b1, met.b2].map(f32x8::to_array);
    let (hits, back) = (met.hits.to_bitmask(), met.back.to_bitmask());
    f32x8::new(std::array::from_fn(|lane| {
        let hit = Hit { t: t[lane], instance, triangle, b1: b1[lane], b2: b2[lane], back: back >> lane & 1 == 1 };
        let stops = hits >> lane & 1 == 1 && coverage.covers(ids[lane], &hit);
        if stops { f32::from_bits(u32::MAX) } else { 0.0 }
    }))
}

/// Rays that are left to the queue: those before the first of a packet, and some after it.
struct Rest<'a, R> {
    rays: &'a R,
    before: usize,
    after: &'a [u32],
}

impl<R: Rays> Rest<'_, R> {
    #[inline(always)]
    fn row(&self, index: usize) -> usize {
        if index < self.before { index } else { self.after[index - self.before] as usize }
    }
}

impl<R: Rays> Rays for Rest<'_, R> {
    fn count(&self) -> usize {
        self.before + self.after.len()
    }

    #[inline(always)]
    fn ray(&self, index: usize) -> queue::Segment {
        self.rays.ray(self.row(index))
    }

    #[inline(always)]
    fn id(&self, index: usize) -> u32 {
        self.rays.id(self.row(index))
    }
}

/// As [`queue::trace`], for rays of which those from [`Rays::coherent_from`] on run side by side.
pub(super) fn trace<const ANY: bool, C: Coverage>(
    accel: &Accel,
    rays: &impl Rays,
    coverage: &C,
    counters: &mut impl Counters,
    mut done: impl FnMut(usize, &Hit),
) {
    let mut kept = SCRATCH.take().unwrap_or_else(Scratch::new);
    let Scratch { from_camera, in_the_way, top, mesh, alone, after } = &mut *kept;
    after.clear();
    let world = World { accel, coverage };
    if ANY {
        trace_packets::<IN_THE_WAY, ANY, C>(&world, rays, in_the_way, (top, mesh), alone, after, counters, &mut done);
    } else {
        trace_packets::<FROM_CAMERA, ANY, C>(&world, rays, from_camera, (top, mesh), alone, after, counters, &mut done);
    }
    let rest = Rest { rays, before: rays.coherent_from(), after };
    queue::trace::<ANY, C>(accel, &rest, coverage, counters, |index, hit| done(rest.row(index), hit));
    SCRATCH.set(Some(kept));
}

/// Traces the rays that run side by side, and leaves the others in `after`.
#[inline(always)]
fn trace_packets<const V: usize, const ANY: bool, C: Coverage>(
    world: &World<C>,
    rays: &impl Rays,
    [packet, local]: &mut [Packet<V>; 2],
    (top, mesh): (&mut Stack, &mut Stack),
    alone: &mut bvh8::Stack,
    after: &mut Vec<u32>,
    counters: &mut impl Counters,
    done: &mut impl FnMut(usize, &Hit),
) {
    let count = rays.count();
    let each = |members: Members| (0..V * LANES).map(move |lane| members.row(lane)).filter(move |&row| row < count);
    let samples = if ANY { 1 } else { rays.samples() };
    for members in Members::all::<V>(rays.coherent_from()..count, samples) {
        if packet.gather::<C>(rays, members) {
            #[cfg(test)]
            tests::TOGETHER.set(tests::TOGETHER.get() + each(members).count() as u64);
            packet.trace::<ANY, C>(world, local, (top, mesh), alone, counters);
            packet.report(|lane, hit| {
                let row = members.row(lane);
                if row < count {
                    done(row, hit);
                }
            });
        } else {
            after.extend(each(members).map(|row| row as u32));
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
