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

use wide::{f32x8, u16x8, u32x8};

use super::{
    Coverage, Rays, Solid,
    arena::Granule,
    bvh8::{self, BEYOND, FAR_SCALE, KIND, Node},
    queue::{self, COMPRESS, CULL, LANE, OWN, STACK, sort4, sort8},
    structure::Counters,
    triangle::{Axis, Leaf, Met, QUAD, Ray, Sheared, Side, TriangleBlock, TriangleQuad},
    two_level::{Accel, Hit, InstanceRef, NO_HIT, Part, nearest_in},
};
use crate::{
    flat::NONE,
    simd::{LANES, prefetch},
};

/// Vectors of rays in a packet. Of 1, 2, 4 and 8, the last two are equally fast and a fifth faster than the first; the
/// smaller of them leaves fewer rays to the queue where directions change their signs.
const VECTORS: usize = 4;
/// Rays in a packet.
const RAYS: usize = VECTORS * LANES;
/// Fewer rays than this go alone through an instance that is not where its mesh is: making a packet of its own for it
/// costs about as much as that.
const FEW: u32 = 4;

/// A bit pattern for each ray of a packet: all ones or all zeros.
type Mask = [f32x8; VECTORS];

/// Eight of a packet's rays.
#[derive(Clone, Copy, Debug)]
struct Eight {
    origin: [f32x8; 3],
    direction: [f32x8; 3],
    against: [f32x8; 3],
    sheared: Sheared,
    hits: Hits,
}

/// What eight rays have hit, and where they end: at the hit if there is one.
#[derive(Clone, Copy, Debug)]
struct Hits {
    t_max: f32x8,
    b1: f32x8,
    b2: f32x8,
    back: f32x8,
    instance: u32x8,
    triangle: u32x8,
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

#[derive(Clone, Debug)]
struct Packet {
    eights: [Eight; VECTORS],
    extremes: [Extremes; 3],
    first: [Side; 3],
    last: [Side; 3],
    /// What [`Slot`](queue) has for one ray, of the farthest.
    reach: f32,
    limit: f32,
}

/// Subtrees put off.
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

/// Scratch of a wave.
struct Scratch {
    top: Stack,
    mesh: Stack,
    /// For rays that go alone.
    alone: bvh8::Stack,
}

/// The least and the greatest of all lanes; NaN is lost.
#[inline(always)]
fn extremes(of: [f32x8; VECTORS]) -> (f32, f32) {
    let (mut least, mut most) = (of[0], of[0]);
    for one in &of[1..] {
        (least, most) = (one.fast_min(least), one.fast_max(most));
    }
    let fold = |of: f32x8, f: fn(f32, f32) -> f32| of.to_array().into_iter().reduce(f).unwrap_or_default();
    (fold(least, f32::min), fold(most, f32::max))
}

/// The greatest of all lanes.
#[inline(always)]
fn greatest(of: [f32x8; VECTORS]) -> f32 {
    let most = of.into_iter().reduce(|a, b| a.fast_max(b)).expect("not empty");
    let [a, b, c, d, e, f, g, h] = most.to_array();
    let max = |a: f32, b: f32| if a > b { a } else { b };
    max(max(max(a, b), max(c, d)), max(max(e, f), max(g, h)))
}

impl Packet {
    /// Of the rays from `start` on, the last of them several times over if they are too few; none if they do not run
    /// side by side.
    #[inline(always)]
    fn new(rays: &impl Rays, start: usize) -> Option<Self> {
        let last = rays.count() - 1;
        let mut columns = [[0.0; RAYS]; 7];
        for lane in 0..RAYS {
            let (origin, direction, t_max) = rays.ray((start + lane).min(last));
            let [ox, oy, oz] = origin;
            let [dx, dy, dz] = direction;
            for (column, value) in columns.iter_mut().zip([ox, oy, oz, dx, dy, dz, t_max]) {
                column[lane] = value;
            }
        }
        let vectors = |column: usize| -> [f32x8; VECTORS] {
            let (eights, _) = columns[column].as_chunks();
            std::array::from_fn(|vector| f32x8::new(eights[vector]))
        };
        Self::of([0, 1, 2].map(vectors), [3, 4, 5].map(vectors), vectors(6).map(Hits::none))
    }

    #[inline(always)]
    fn of(origin: [[f32x8; VECTORS]; 3], direction: [[f32x8; VECTORS]; 3], hits: [Hits; VECTORS]) -> Option<Self> {
        // As in `Ray::new`; the axis has to be the same for all.
        let mut along = [0; 3];
        for vector in 0..VECTORS {
            let [x, y, z] = direction.map(|of| of[vector].abs());
            let is_x = (x.simd_gt(y) & x.simd_gt(z)).to_bitmask() & 255;
            let is_y = !is_x & (y.simd_ge(x) & y.simd_gt(z)).to_bitmask() & 255;
            along[0] += is_x.count_ones();
            along[1] += is_y.count_ones();
            along[2] += (is_x | is_y ^ 255).count_ones() - is_x.count_ones();
        }
        let kz = along.iter().position(|&rays| rays as usize == RAYS)?;
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if direction[kz][0].to_array()[0] < 0.0 {
            std::mem::swap(&mut kx, &mut ky);
        }
        let inverse = direction.map(|of| of.map(|d| f32x8::ONE / d));
        let mut bounds = [Extremes { ahead: 0.0, slow: 0.0, behind: 0.0, fast: 0.0 }; 3];
        let (mut first, mut last) = ([Side::Lower; 3], [Side::Upper; 3]);
        if !hits.iter().all(|hits| hits.t_max.simd_eq(hits.t_max).all()) {
            return None;
        }
        for axis in 0..3 {
            let (lower, upper) = extremes(inverse[axis]);
            let (start, end) = extremes(origin[axis]);
            // Directions of both signs, or zero and not, would make intervals that are not bounded; what is not a number
            // makes none. Infinite starts are left to the queue as well.
            let together = lower > 0.0 || upper < 0.0;
            let numbers = (0..VECTORS).all(|vector| {
                let finite = origin[axis][vector].abs().simd_lt(f32x8::splat(f32::INFINITY));
                (finite & inverse[axis][vector].simd_eq(inverse[axis][vector])).to_bitmask() & 255 == 255
            });
            if !together || !numbers || lower.is_finite() != upper.is_finite() {
                return None;
            }
            bounds[axis] = if lower > 0.0 {
                Extremes { ahead: end, slow: -lower, behind: start, fast: -upper }
            } else {
                (first[axis], last[axis]) = (Side::Upper, Side::Lower);
                Extremes { ahead: start, slow: -upper, behind: end, fast: -lower }
            };
        }
        let eights = std::array::from_fn(|vector| Eight {
            origin: origin.map(|of| of[vector]),
            direction: direction.map(|of| of[vector]),
            against: inverse.map(|of| -of[vector]),
            sheared: Sheared {
                axes: [kx, ky, kz].map(|axis| Axis::ALL[axis]),
                shear: [
                    direction[kx][vector] * inverse[kz][vector],
                    direction[ky][vector] * inverse[kz][vector],
                    inverse[kz][vector],
                ],
                from: [kx, ky, kz].map(|axis| origin[axis][vector]),
            },
            hits: hits[vector],
        });
        let mut packet = Self { eights, extremes: bounds, first, last, reach: 0.0, limit: 0.0 };
        packet.shorten();
        Some(packet)
    }

    /// Nothing counts from now on beyond where all rays end.
    #[inline(always)]
    fn shorten(&mut self) {
        let t_max = greatest(std::array::from_fn(|vector| self.eights[vector].hits.t_max));
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
        mut leaf: impl FnMut(&mut Self, u32, &Mask, &mut C),
    ) {
        if root & KIND != 0 {
            leaf(self, root, &[f32x8::splat(f32::from_bits(u32::MAX)); VECTORS], counters);
            return;
        }
        let mut top = 0;
        let mut current = root;
        loop {
            counters.node();
            let node = Node::at(arena, current);
            let (near, far) = self.distances(node);
            let met = near.simd_le(far);
            let mask = met.to_bitmask() as usize & 255;
            let count = mask.count_ones();
            let lanes = u32x8::from(u16x8::new(COMPRESS[mask]));
            let keys = (bytemuck::cast::<_, u32x8>(near) & u32x8::splat(OWN) | u32x8::new(LANE))
                & bytemuck::cast::<_, u32x8>(met);
            let keys = bytemuck::cast(keys.shuffle_wrapping(lanes));
            let keys = if count <= 4 { sort4(keys) } else { sort8(keys) };
            let children = u32x8::new(node.children()).shuffle_wrapping(bytemuck::cast(keys)).to_array();
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
                let mut active = [f32x8::ZERO; VECTORS];
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
    fn test<L: Leaf>(&mut self, block: &L, instance: u32, active: &Mask, counters: &mut impl Counters) {
        let mut any = false;
        for (eight, &active) in self.eights.iter_mut().zip(active) {
            if active.to_bitmask() & 255 == 0 {
                continue;
            }
            for lane in 0..L::MOST {
                let triangle = block.row(lane);
                if triangle == NONE {
                    break;
                }
                counters.triangles(LANES);
                let at = |corner: usize, axis: Axis| f32x8::splat(block.coordinate(corner, axis.number(), lane));
                let edges = eight.sheared.edges(at);
                if (edges.inside & active).to_bitmask() & 255 == 0 {
                    continue;
                }
                let met = eight.sheared.meet(edges, eight.hits.t_max);
                any |= eight.hits.take(&met, active, instance, triangle);
            }
        }
        if any {
            self.shorten();
        }
    }

    /// The nearest hits.
    fn trace(&mut self, accel: &Accel, scratch: &mut Scratch, counters: &mut impl Counters) {
        let Some(root) = accel.tree.root else { return };
        let Scratch { top, mesh, alone } = scratch;
        self.walk(accel.tree.arena.granules(), root, top, counters, |this, reference, active, counters| {
            let part = accel.parts[(reference & !KIND) as usize];
            let instance = &accel.instances[part.instance as usize];
            if instance.identity {
                this.enter(instance, part, active, mesh, counters);
                return;
            }
            let rays: u32 = active.iter().map(|eight| (eight.to_bitmask() & 255).count_ones()).sum();
            let local = if rays < FEW { None } else { this.to_local(&instance.local_from_world) };
            if let Some(mut local) = local {
                local.enter(instance, part, active, mesh, counters);
                for (eight, local) in this.eights.iter_mut().zip(local.eights) {
                    eight.hits = local.hits;
                }
            } else {
                for (eight, &active) in this.eights.iter_mut().zip(active) {
                    eight.follow(instance, part, active.to_bitmask() & 255, alone);
                }
            }
            this.shorten();
        });
    }

    /// Goes through a part of an instance, with rays as its mesh sees them.
    #[inline(never)]
    fn enter(
        &mut self,
        instance: &InstanceRef,
        part: Part,
        among: &Mask,
        stack: &mut Stack,
        counters: &mut impl Counters,
    ) {
        let arena = instance.blas.tree.arena.granules();
        self.walk(arena, part.root, stack, counters, |this, reference, active, counters| {
            let active = std::array::from_fn(|vector| active[vector] & among[vector]);
            let place = reference & !(KIND | QUAD);
            if reference & QUAD == 0 {
                this.test(TriangleBlock::at(arena, place), part.instance, &active, counters);
            } else {
                this.test(TriangleQuad::at(arena, place), part.instance, &active, counters);
            }
        });
    }

    /// [`to_local`](super::two_level::to_local), of all rays, with the same roundings.
    fn to_local(&self, m: &[f32; 12]) -> Option<Self> {
        let m = m.map(f32x8::splat);
        let linear = |row: usize, [x, y, z]: [f32x8; 3]| m[4 * row] * x + m[4 * row + 1] * y + m[4 * row + 2] * z;
        let each = |f: &dyn Fn(&Eight, usize) -> f32x8| {
            std::array::from_fn(|row| std::array::from_fn(|vector| f(&self.eights[vector], row)))
        };
        let origin = each(&|eight, row| linear(row, eight.origin) + m[4 * row + 3]);
        let direction = each(&|eight, row| linear(row, eight.direction));
        Self::of(origin, direction, self.eights.map(|eight| eight.hits))
    }

    /// What each ray hit.
    fn report(&self, mut done: impl FnMut(usize, &Hit)) {
        for (vector, eight) in self.eights.iter().enumerate() {
            let hits = eight.hits.each();
            hits.iter().enumerate().for_each(|(lane, hit)| done(vector * LANES + lane, hit));
        }
    }
}

impl Eight {
    /// Goes through a part of an instance with the rays in `lanes`, one by one.
    #[cold]
    fn follow(&mut self, instance: &InstanceRef, part: Part, mut lanes: u32, stack: &mut bvh8::Stack) {
        let [origin, direction] = [self.origin, self.direction].map(|of| of.map(f32x8::to_array));
        let mut hits = self.hits.each();
        let mut t_max = self.hits.t_max.to_array();
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize % LANES;
            lanes &= lanes - 1;
            let ray = Ray::new(origin.map(|of| of[lane]), direction.map(|of| of[lane]));
            nearest_in(instance, part, &ray, &mut t_max[lane], &mut hits[lane], 0, &Solid, stack);
        }
        let column = |f: fn(&Hit) -> f32| f32x8::new(hits.each_ref().map(f));
        let row = |f: fn(&Hit) -> u32| u32x8::new(hits.each_ref().map(f));
        self.hits = Hits {
            t_max: f32x8::new(t_max),
            b1: column(|hit| hit.b1),
            b2: column(|hit| hit.b2),
            back: column(|hit| if hit.back { f32::from_bits(u32::MAX) } else { 0.0 }),
            instance: row(|hit| hit.instance),
            triangle: row(|hit| hit.triangle),
        };
    }
}

impl Hits {
    fn none(t_max: f32x8) -> Self {
        let (zero, none) = (f32x8::ZERO, u32x8::splat(NONE));
        Self { t_max, b1: zero, b2: zero, back: zero, instance: none, triangle: none }
    }

    /// Takes what rays among the `active` have met of a triangle. True if there is any.
    #[inline(always)]
    fn take(&mut self, met: &Met, active: f32x8, instance: u32, triangle: u32) -> bool {
        let mut hits = met.hits & active;
        let ties = (hits & met.t.simd_eq(self.t_max)).to_bitmask() & 255;
        if ties != 0 {
            hits = self.unless_behind(hits, ties, instance, triangle);
        }
        let bits: u32x8 = bytemuck::cast(hits);
        self.t_max = hits.bitselect(met.t, self.t_max);
        self.b1 = hits.bitselect(met.b1, self.b1);
        self.b2 = hits.bitselect(met.b2, self.b2);
        self.back = hits.bitselect(met.back, self.back);
        self.instance = bits.bitselect(u32x8::splat(instance), self.instance);
        self.triangle = bits.bitselect(u32x8::splat(triangle), self.triangle);
        hits.to_bitmask() & 255 != 0
    }

    /// Takes out of `hits` those of `ties` whose ray has hit a smaller (instance, triangle) at the same distance.
    #[cold]
    fn unless_behind(&self, hits: f32x8, ties: u32, instance: u32, triangle: u32) -> f32x8 {
        let mut hits = hits.to_array();
        let best = self.instance.to_array().into_iter().zip(self.triangle.to_array());
        for (lane, best) in best.enumerate() {
            if ties >> lane & 1 == 1 && best <= (instance, triangle) {
                hits[lane] = 0.0;
            }
        }
        f32x8::new(hits)
    }

    #[inline(always)]
    fn each(&self) -> [Hit; LANES] {
        let [t, b1, b2] = [self.t_max, self.b1, self.b2].map(f32x8::to_array);
        let [instance, triangle] = [self.instance, self.triangle].map(u32x8::to_array);
        let back = self.back.to_bitmask();
        std::array::from_fn(|lane| Hit {
            // The end of a ray that has hit nothing is no distance.
            t: if instance[lane] == NONE { NO_HIT.t } else { t[lane] },
            instance: instance[lane],
            triangle: triangle[lane],
            b1: b1[lane],
            b2: b2[lane],
            back: back >> lane & 1 == 1,
        })
    }
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
pub(super) fn trace<C: Coverage>(
    accel: &Accel,
    rays: &impl Rays,
    coverage: &C,
    counters: &mut impl Counters,
    mut done: impl FnMut(usize, &Hit),
) {
    let (before, count) = (rays.coherent_from(), rays.count());
    let mut after = Vec::new();
    let mut scratch = Scratch { top: Stack::new(), mesh: Stack::new(), alone: bvh8::Stack::default() };
    for start in (before..count).step_by(RAYS) {
        let rows = start..count.min(start + RAYS);
        if let Some(mut packet) = Packet::new(rays, start) {
            packet.trace(accel, &mut scratch, counters);
            packet.report(|lane, hit| {
                if start + lane < rows.end {
                    done(start + lane, hit);
                }
            });
        } else {
            after.extend(rows.map(|row| row as u32));
        }
    }
    let rest = Rest { rays, before, after: &after };
    queue::trace::<false, C>(accel, &rest, coverage, counters, |index, hit| done(rest.row(index), hit));
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::{
        super::{
            Blas, SideBySide,
            tests::{Sieve, Wave, numbers, placed},
        },
        *,
    };

    /// Rays from a point through tiles of 8×8 pixels, as a camera that looks at [0, 5]³ has them.
    fn tiles(eye: [f32; 3], tiles: usize, t_max: f32) -> Vec<queue::Segment> {
        let forward = eye.map(|x| 2.4 - x);
        let aside = [forward[2], 0.1, -forward[0]];
        let up = [0.1 * forward[1], forward[0].abs() + forward[2].abs(), 0.2 * forward[2]];
        let ray = |i: usize| {
            let (tile, pixel) = (i / 64, i % 64);
            let x = ((tile % 8 * 8 + pixel % 8) as f32 + 0.5) / 64.0 - 0.5;
            let y = ((tile / 8 * 8 + pixel / 8) as f32 + 0.5) / 64.0 - 0.5;
            let direction = std::array::from_fn(|axis| forward[axis] + x * aside[axis] + y * up[axis]);
            (eye, direction, if i.is_multiple_of(3) { t_max } else { f32::INFINITY })
        };
        (0..64 * tiles).map(ray).collect()
    }

    /// From a square, all in the same direction, of which two components are zero.
    fn orthographic(axis: usize, towards: f32) -> Vec<queue::Segment> {
        let ray = |i: usize| {
            let mut origin = [(i % 32) as f32 * 0.17, (i / 32) as f32 * 0.17, (i / 32) as f32 * 0.17];
            let mut direction = [0.0; 3];
            (origin[axis], direction[axis]) = (2.5 - 4.0 * towards, towards);
            origin.rotate_right(usize::from(axis == 0));
            direction.rotate_right(usize::from(axis == 0));
            (origin, direction, f32::INFINITY)
        };
        (0..1024).map(ray).collect()
    }

    fn triangles(count: usize) -> Vec<[[f32; 3]; 3]> {
        let mut u = numbers(11);
        let triangle = |_| {
            let base = [u() * 5.0, u() * 5.0, u() * 5.0];
            let size = 0.05 + u();
            [0, 1, 2].map(|_| base.map(|x| x + size * u()))
        };
        (0..count).map(triangle).collect()
    }

    /// Turned about the upright axis, by the angle whose cosine is 0.6.
    fn turned(blas: &Arc<Blas>) -> InstanceRef {
        let world_from_local = [0.6, 0.0, 0.8, -1.0, 0.0, 1.0, 0.0, 0.5, -0.8, 0.0, 0.6, 3.0];
        let local_from_world = [0.6, 0.0, -0.8, 3.0, 0.0, 1.0, 0.0, -0.5, 0.8, 0.0, 0.6, -1.0];
        InstanceRef { world_from_local, local_from_world, ..placed(blas, 0.5, 0.0) }
    }

    fn scenes() -> Vec<Accel> {
        let few = [1.0, 2.0, 3.0].map(|x| [[x, 0.0, 0.0], [0.0, 5.0, x], [x, 1.0, 5.0]]);
        let few = Arc::new(Blas::build(&few));
        let many = Arc::new(Blas::build(&triangles(3000)));
        let empty = Arc::new(Blas::build(&[]));
        let small = |i: usize| placed(if i.is_multiple_of(3) { &few } else { &many }, 0.3, i as f32 * 0.05);
        let scenes = [
            vec![placed(&many, 1.0, 0.0)],
            vec![placed(&few, 1.0, 0.0)],
            vec![turned(&many)],
            vec![placed(&many, 1.0, 0.0), placed(&empty, 1.0, 0.0), placed(&many, 1.0, 0.0), turned(&many)],
            vec![placed(&few, 1.0, 0.0), placed(&many, 0.5, 1.0), turned(&many), placed(&many, -1.0, 5.0)],
            (0..100).map(small).collect(),
            Vec::new(),
        ];
        scenes.into_iter().map(Accel::build).collect()
    }

    /// A wave of which the rays from `from` on are said to run side by side.
    struct From<'a>(&'a Wave, usize);

    impl Rays for From<'_> {
        fn count(&self) -> usize {
            self.0.count()
        }
        fn ray(&self, index: usize) -> queue::Segment {
            self.0.ray(index)
        }
        fn id(&self, index: usize) -> u32 {
            self.0.id(index)
        }
        fn coherent_from(&self) -> usize {
            self.1
        }
    }

    /// The wave finds, bit for bit, what the queue finds. Returns how many rays hit something.
    #[track_caller]
    fn check<C: Coverage>(accel: &Accel, wave: &Wave, from: usize, coverage: &C) -> usize {
        let (mut want, mut got) = (vec![None; wave.count()], vec![None; wave.count()]);
        accel.nearest_of(wave, coverage, |index, hit| want[index] = Some(*hit));
        accel.nearest_of(&From(wave, from), coverage, |index, hit| {
            assert!(got[index].replace(*hit).is_none(), "twice");
        });
        let bits = |hit: &Option<Hit>| hit.map(|hit| (hit, [hit.t, hit.b1, hit.b2].map(f32::to_bits)));
        for index in 0..wave.count() {
            assert_eq!(bits(&got[index]), bits(&want[index]), "ray {index}: {:?}", wave.ray(index));
        }
        want.iter().flatten().filter(|hit| **hit != NO_HIT).count()
    }

    fn packets(rays: &impl Rays) -> usize {
        (0..rays.count()).step_by(RAYS).filter(|&start| Packet::new(rays, start).is_some()).count()
    }

    const EYES: [[f32; 3]; 4] = [[-6.0, 4.0, -9.0], [2.5, 2.0, 2.6], [11.0, 7.5, 1.0], [1.0, -9.0, 3.0]];

    #[test]
    fn packets_find_what_the_queue_finds() {
        for (scene, accel) in scenes().iter().enumerate() {
            let mut hits = 0;
            for eye in EYES {
                for t_max in [f32::INFINITY, 0.9] {
                    let wave = Wave(tiles(eye, 64, t_max));
                    assert!(packets(&wave) > 64, "{} of 128", packets(&wave));
                    hits += check(accel, &wave, 0, &Solid);
                }
            }
            assert!(hits > 500 || scene == 6, "{hits} hits in scene {scene}: too few to mean anything");
            for (axis, towards) in [(0, 1.0), (1, -1.0), (2, 1.0), (2, -0.5)] {
                let wave = Wave(orthographic(axis, towards));
                assert_eq!(packets(&wave), 32);
                check(accel, &wave, 0, &Solid);
            }
        }
    }

    /// Rays of all directions called coherent, waves that are so in part, of lengths that fill no packet, away from
    /// everything, with what is not a number among them, and where surfaces let some rays through.
    #[test]
    fn rays_that_do_not_run_side_by_side_find_their_hits_too() {
        let mut u = numbers(5);
        let mut point = |spread: f32| [u() * spread, u() * spread, u() * spread];
        let scattered: Vec<queue::Segment> = (0..999)
            .map(|i: usize| {
                let mut direction = point(2.0).map(|x| x - 1.0);
                if i.is_multiple_of(4) {
                    direction[i % 3] = if i.is_multiple_of(8) { 0.0 } else { -0.0 };
                }
                (point(5.0), direction, f32::INFINITY)
            })
            .collect();
        // The same signs and axis, but nothing else in common: packets that are of no use.
        let spread = scattered
            .iter()
            .map(|&(origin, [x, y, z], t_max)| (origin, [x.abs() + 0.01, y.abs() + 0.01, 2.0 + z.abs()], t_max));
        let spread = Wave(spread.collect());
        assert_eq!(packets(&spread), 32);
        let mut mixed = Wave(scattered.clone());
        mixed.0.extend(tiles(EYES[0], 5, 0.8));
        mixed.0.truncate(999 + 5 * 64 - 7);
        let away = tiles(EYES[0], 4, 1.0).into_iter().map(|(o, d, t_max)| (o, d.map(|x: f32| -x), t_max));
        let away = Wave(away.collect());
        let mut strange = Wave(tiles(EYES[0], 8, 1.0));
        for (i, ray) in strange.0.iter_mut().enumerate().step_by(37) {
            match i % 5 {
                0 => ray.0[i % 3] = f32::NAN,
                1 => ray.1[i % 3] = f32::NAN,
                2 => ray.0[i % 3] = f32::INFINITY,
                3 => ray.1[i % 3] = 1e-42,
                _ => ray.2 = -1.0,
            }
        }
        let scattered = Wave(scattered);
        for accel in &mut scenes() {
            check(accel, &scattered, 0, &Solid);
            check(accel, &spread, 0, &Solid);
            for from in [0, 999, 1000, mixed.count() - 1, mixed.count()] {
                check(accel, &mixed, from, &Solid);
            }
            check(accel, &away, 0, &Solid);
            check(accel, &strange, 0, &Solid);
            accel.set_checks(|row| row % 2 == 0);
            check(accel, &mixed, 999, &Sieve);
        }
    }

    /// Of triangles in the same place the smallest row is hit, and of instances the smallest.
    #[test]
    fn at_equal_distance_the_smaller_row_wins_in_packets_too() {
        let triangle = [[-50.0, -50.0, 0.0], [50.0, -50.0, 1.0], [0.0, 50.0, 2.0]];
        let blas = Arc::new(Blas::build(&[triangle; 21]));
        let accel = Accel::build(vec![placed(&blas, 1.0, 0.0); 3]);
        let wave = SideBySide(Wave(tiles([-1.0, -2.0, -9.0], 4, f32::INFINITY)));
        assert!(packets(&wave) > 4);
        accel.nearest_of(&wave, &Solid, |_, hit| assert_eq!((hit.instance, hit.triangle), (0, 0)));
    }

    /// What a ray's own test lets pass, that of its packet does.
    #[test]
    fn bounds_hold_for_every_ray() {
        let accel = Accel::build(vec![placed(&Arc::new(Blas::build(&triangles(3000))), 1.0, 0.0)]);
        let arena = accel.instances[0].blas.tree.arena.granules();
        let mut nodes = vec![accel.parts[0].root];
        let mut next = 0;
        while let Some(&node) = nodes.get(next) {
            nodes.extend(Node::at(arena, node).boxes().map(|(_, child)| child).filter(|child| child & KIND == 0));
            next += 1;
        }
        let mut tight = 0;
        for rays in EYES.map(|eye| Wave(tiles(eye, 64, 0.7))).into_iter().chain([Wave(orthographic(0, 1.0))]) {
            for start in (0..rays.count()).step_by(RAYS) {
                let Some(packet) = Packet::new(&rays, start) else { continue };
                for node in nodes.iter().map(|&node| Node::at(arena, node)) {
                    let (from, to) = packet.distances(node);
                    tight += from.simd_gt(to).to_bitmask().count_ones();
                    for (origin, direction, t_max) in (start..start + RAYS).map(|row| rays.ray(row)) {
                        let (near, far) = node.distances(&Ray::new(origin, direction), t_max * (BEYOND / FAR_SCALE));
                        let inside = from.simd_le(near) & far.simd_le(to);
                        assert_eq!((near.simd_le(far) & !inside).to_bitmask() & 255, 0);
                    }
                }
            }
        }
        assert!(tight > 100_000, "{tight} boxes missed: bounds that hold for anything");
    }
}
