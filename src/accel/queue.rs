//! A wave of rays through the eight-wide trees: tens of them in flight, stepped in turn.
//!
//! One ray alone waits for memory at each node. Here [`IN_FLIGHT`] rays take turns, each asking for its next node as soon
//! as it knows which, so that the wait of one is the work of the others. What a ray needs next is not branched upon but
//! decides which of a few small queues its slot goes to; each queue is then drained by code that does one thing.
//!
//! The order of the walk changes with the neighbours in flight, but not the hits: of equally near ones that of the
//! smaller (instance, triangle) counts.

use std::cell::Cell;

use wide::{f32x8, u16x8, u32x8};

use super::{
    Coverage,
    arena::Granule,
    bvh8::{BEYOND, FAR_SCALE, INSTANCE, KIND, LEAF, Node},
    leaf::{Leaf, QUAD, TriangleBlock, TriangleQuad},
    opacity::Opacity,
    structure::Counters,
    triangle::Ray,
    two_level::{Accel, Hit, NO_HIT, SHAPE, hit_of, is_there, to_local},
};
use crate::{
    flat::NONE,
    simd::{LANES, prefetch},
};

/// Rays in flight: fewer leave memory idle, more gain nothing and crowd the first-level cache.
const IN_FLIGHT: usize = 32;
/// Subtrees that a slot can put off; rays through a deeper tree are followed one by one.
pub(super) const STACK: usize = 240;
/// The slot's ray goes back to the top level.
const LEAVE: u32 = u32::MAX - 1;
/// Nothing is left to visit.
const DONE: u32 = u32::MAX;
/// How much farther than it is the nearest hit counts when subtrees are passed by: their distance carries a lane in its
/// last three bits.
pub(super) const CULL: f32 = BEYOND * (1.0 + 9.0 * f32::EPSILON);
/// The bits of a distance that are its own.
pub(super) const OWN: u32 = !(LANES as u32 - 1);
/// The lanes, to be carried.
pub(super) const LANE: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7];

/// Rays to be traced.
pub trait Rays {
    /// How many.
    fn count(&self) -> usize;
    /// Start, direction (not zero, of any length), end in units of the direction.
    fn ray(&self, index: usize) -> ([f32; 3], [f32; 3], f32);
    /// Name of the ray, for surfaces that stop some rays only.
    fn id(&self, index: usize) -> u32;

    /// Index from which on rays that follow one another run side by side, as those of a camera do. If so many do not, that
    /// costs time and nothing else.
    #[inline(always)]
    fn coherent_from(&self) -> usize {
        self.count()
    }
}

/// Rays of which all run [side by side](Rays::coherent_from).
#[derive(Clone, Copy, Debug)]
pub struct SideBySide<R>(pub R);

impl<R: Rays> Rays for SideBySide<R> {
    fn count(&self) -> usize {
        self.0.count()
    }

    #[inline(always)]
    fn ray(&self, index: usize) -> Segment {
        self.0.ray(index)
    }

    #[inline(always)]
    fn id(&self, index: usize) -> u32 {
        self.0.id(index)
    }

    fn coherent_from(&self) -> usize {
        0
    }
}

/// Start, direction, end in units of the direction.
pub type Segment = ([f32; 3], [f32; 3], f32);

/// Rays in a list, all of one name; the list may be borrowed.
#[derive(Clone, Copy, Debug, Default)]
pub struct RayList<L = Vec<Segment>>(pub L);

impl<L: AsRef<[Segment]>> Rays for RayList<L> {
    fn count(&self) -> usize {
        self.0.as_ref().len()
    }

    #[inline(always)]
    fn ray(&self, index: usize) -> Segment {
        self.0.as_ref()[index]
    }

    #[inline(always)]
    fn id(&self, _: usize) -> u32 {
        0
    }
}

/// The lanes of each mask: those whose bit is set, then the others.
pub(super) static COMPRESS: [[u16; LANES]; 256] = {
    let mut table = [[0; LANES]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut count) = (0, 0);
        while lane < 2 * LANES {
            if (mask >> (lane % LANES) & 1 == 1) == (lane < LANES) {
                table[mask][count] = (lane % LANES) as u16;
                count += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    table
};

/// Numbers of one of a ray's stacks: as many as a byte can count, and eight above and below that are never read.
const ENTRIES: usize = 256 + 2 * LANES;

/// One ray under way.
#[derive(Debug)]
#[repr(C, align(64))]
struct Slot<'a> {
    ray: Ray,
    t_max: f32,
    /// Boxes that begin beyond are not met.
    reach: f32,
    /// Subtrees put off that begin beyond are passed by.
    limit: f32,
    /// What is visited next.
    current: u32,
    /// What `current` and the stack refer to.
    arena: &'a [Granule],
    /// Subtrees put off: a byte, so that the compiler knows it to be inside the stack.
    top: u8,
    instance: u32,
    /// The nearest hit, after one that is not looked at.
    best: [Hit; 2],
    /// Name of the ray.
    id: u32,
    /// Index of the ray in its wave.
    index: u32,
    /// The ray as it came, if it has to come back from anywhere.
    world: Ray,
    stack: &'a mut Stack,
}

/// Subtrees put off, by distance. Eight entries that are always met lie below the first.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Stack {
    near: [f32; ENTRIES],
    child: [u32; ENTRIES],
}

impl Stack {
    const EMPTY: Self = {
        let (mut near, mut child) = ([0.0; ENTRIES], [0; ENTRIES]);
        let mut entry = 0;
        while entry < LANES {
            (near[entry], child[entry]) = (f32::NEG_INFINITY, DONE);
            entry += 1;
        }
        Self { near, child }
    };
}

thread_local! {
    /// Stacks of the rays in flight. Some 70 KiB, which would take as long to make as a small wave to trace.
    static STACKS: Cell<Vec<Stack>> = const { Cell::new(Vec::new()) };
}

/// Slots in need of each kind of step, a bit for each slot: nodes, leaves, instances, shapes, rays that leave a mesh or are
/// done, by the upper three bits of a reference; and rays whose next subtree lies beyond what they have hit.
///
/// Bits, because the next slot is then known without a look at memory that a step before it may have written.
struct Queues {
    of: [u32; 8],
}

/// Of [`Queues`], the one that no reference leads to.
const POP: usize = 1;

/// Asks for what a reference leads to: a node, or most of a block.
#[inline(always)]
fn fetch(arena: &[Granule], reference: u32) {
    prefetch::<6, Granule>(arena, (reference & !(KIND | QUAD)) as usize);
}

/// Exchanges lanes `a` and `b` of each pair so that the larger comes first.
macro_rules! order {
    ($keys:ident, $partner:expr, $first:expr) => {
        const PARTNER: [u32; 8] = $partner;
        const FIRST: [u32; 8] = $first;
        let other: f32x8 = bytemuck::cast(bytemuck::cast::<_, u32x8>($keys).shuffle_wrapping(u32x8::new(PARTNER)));
        let (large, small) = ($keys.fast_max(other), $keys.fast_min(other));
        $keys = bytemuck::cast::<_, f32x8>(u32x8::new(FIRST)).bitselect(large, small);
    };
}

const YES: u32 = u32::MAX;

/// The first four lanes in descending order.
#[inline(always)]
pub(super) fn sort4(mut keys: f32x8) -> f32x8 {
    {
        order!(keys, [1, 0, 3, 2, 5, 4, 7, 6], [YES, 0, 0, YES, YES, 0, 0, YES]);
    }
    {
        order!(keys, [2, 3, 0, 1, 6, 7, 4, 5], [YES, YES, 0, 0, 0, 0, YES, YES]);
    }
    {
        order!(keys, [1, 0, 3, 2, 5, 4, 7, 6], [YES, 0, YES, 0, 0, YES, 0, YES]);
    }
    keys
}

/// All eight lanes in descending order (Batcher 1968, "Sorting networks and their applications").
#[inline(always)]
pub(super) fn sort8(keys: f32x8) -> f32x8 {
    let mut keys = sort4(keys);
    {
        order!(keys, [4, 5, 6, 7, 0, 1, 2, 3], [YES, YES, YES, YES, 0, 0, 0, 0]);
    }
    {
        order!(keys, [2, 3, 0, 1, 6, 7, 4, 5], [YES, YES, 0, 0, YES, YES, 0, 0]);
    }
    {
        order!(keys, [1, 0, 3, 2, 5, 4, 7, 6], [YES, 0, YES, 0, YES, 0, YES, 0]);
    }
    keys
}

impl<'a> Slot<'a> {
    fn new(stack: &'a mut Stack) -> Self {
        let ray = Ray::new([0.0; 3], [0.0, 0.0, 1.0]);
        Self {
            ray,
            t_max: 0.0,
            reach: 0.0,
            limit: 0.0,
            current: DONE,
            arena: &[],
            top: 0,
            instance: 0,
            best: [NO_HIT; 2],
            id: 0,
            index: 0,
            world: ray,
            stack,
        }
    }

    /// Nothing beyond counts from now on.
    #[inline(always)]
    fn shorten(&mut self, t_max: f32) {
        self.t_max = t_max;
        self.reach = t_max * (BEYOND / FAR_SCALE);
        self.limit = f32::mul_add(t_max, CULL, f32::MIN_POSITIVE);
    }

    /// Takes what was put off last.
    #[inline(always)]
    fn take<const ANY: bool>(&mut self) -> usize {
        // Below the first are entries that mean the end.
        let last = usize::from(self.top) + LANES - 1;
        self.top = self.top.wrapping_sub(1);
        self.current = self.stack.child[last];
        fetch(self.arena, self.current);
        // A choice of two numbers, not a branch. All subtrees have to be seen to know that there is no hit.
        if ANY || self.stack.near[last] <= self.limit { (self.current >> 29) as usize } else { POP }
    }

    /// Tests a node's boxes; the nearest child is next, the others are put off.
    #[inline(always)]
    fn descend<const ANY: bool>(&mut self) -> usize {
        let node = Node::at(self.arena, self.current);
        let (near, far) = node.distances(&self.ray, self.reach);
        let met = near.simd_le(far);
        let mask = met.to_bitmask() as usize & 255;
        let count = mask.count_ones();
        let lanes = u32x8::from(u16x8::new(COMPRESS[mask]));
        let top = usize::from(self.top) + LANES;
        let children = if ANY {
            // Order and distance do not matter.
            lanes
        } else {
            // Each distance carries its lane in its last bits; what is not met becomes zero. That may tie
            // with the first child, and is then as good as it.
            let keys = (bytemuck::cast::<_, u32x8>(near) & u32x8::splat(OWN) | u32x8::new(LANE))
                & bytemuck::cast::<_, u32x8>(met);
            let keys = bytemuck::cast(keys.shuffle_wrapping(lanes));
            let keys = if count <= 4 { sort4(keys) } else { sort8(keys) };
            self.stack.near[top..top + LANES].copy_from_slice(&keys.to_array());
            bytemuck::cast(keys)
        };
        let children = u32x8::new(node.children()).shuffle_wrapping(children).to_array();
        self.stack.child[top..top + LANES].copy_from_slice(&children);
        self.top = self.top.wrapping_add(count as u8);
        self.take::<ANY>()
    }

    /// Makes the last subtree put off that is not beyond the nearest hit the next to visit.
    #[inline(always)]
    fn pop<const ANY: bool>(&mut self) -> usize {
        if ANY {
            return self.take::<ANY>();
        }
        let limit = f32x8::splat(self.limit);
        loop {
            let top = usize::from(self.top);
            let near = f32x8::new(*self.stack.near[top..].first_chunk().expect("eight entries"));
            let met = near.simd_le(limit).to_bitmask() & 255;
            if met != 0 {
                let lane = (31 - met.leading_zeros()) & 7;
                self.top = self.top.wrapping_add(lane as u8).wrapping_sub(LANES as u8);
                self.current = self.stack.child[top + lane as usize];
                break;
            }
            self.top = self.top.wrapping_sub(LANES as u8);
        }
        fetch(self.arena, self.current);
        (self.current >> 29) as usize
    }

    /// Puts off something that is visited whatever is hit before.
    #[inline(always)]
    fn put_off(&mut self, reference: u32) {
        let top = usize::from(self.top) + LANES;
        self.stack.near[top] = f32::NEG_INFINITY;
        self.stack.child[top] = reference;
        self.top = self.top.wrapping_add(1);
    }

    #[inline(always)]
    fn begin<const ANY: bool, C: Coverage>(&mut self, accel: &'a Accel, index: usize, rays: &impl Rays, coverage: &C) {
        let (origin, direction, t_max) = rays.ray(index);
        self.index = index as u32;
        self.id = rays.id(index);
        self.ray = Ray::new(origin, direction);
        self.shorten(t_max);
        self.best[1] = NO_HIT;
        self.top = 0;
        self.arena = accel.tree.arena.granules();
        self.current = accel.tree.root.unwrap_or(DONE);
        if !accel.unbounded.is_empty() {
            let (t_max, best) = (&mut self.t_max, &mut self.best[1]);
            accel.meet_unbounded(&self.ray, t_max, best, self.id, coverage);
            self.shorten(self.t_max);
            if ANY && self.best[1].instance != NONE {
                self.current = DONE;
                return;
            }
        }
        if accel.alone && self.current != DONE {
            // There is nothing to come back to.
            self.go_into(accel);
        } else {
            self.world = self.ray;
        }
    }

    /// Tests a shape.
    #[inline(always)]
    fn meet<const ANY: bool, C: Coverage>(&mut self, accel: &'a Accel, coverage: &C) -> usize {
        let part = accel.parts[(self.current & !SHAPE) as usize];
        // Of equally near hits the names outside decide.
        let (mut t_max, mut best) = (self.t_max, accel.merged.named(self.best[1]));
        accel.meet_shape(part.instance, &self.ray, &mut t_max, &mut best, self.id, coverage);
        if best.instance == part.instance {
            self.best[1] = best;
            self.shorten(t_max);
            if ANY {
                self.current = DONE;
                return (DONE >> 29) as usize;
            }
        }
        self.pop::<ANY>()
    }

    /// Goes into a part of an instance, and comes back.
    #[inline(always)]
    fn enter(&mut self, accel: &'a Accel) {
        self.put_off(LEAVE);
        self.go_into(accel);
    }

    #[inline(always)]
    fn go_into(&mut self, accel: &'a Accel) {
        let part = accel.parts[(self.current & !KIND) as usize];
        let instance = &accel.instances[part.instance as usize];
        self.instance = part.instance;
        if !instance.identity {
            self.ray = to_local(instance, self.ray.origin, self.ray.direction);
        }
        self.arena = instance.blas.tree.arena.granules();
        self.current = part.root;
        fetch(self.arena, self.current);
    }

    /// [`Slot::leave`] if that is next: so soon after a leaf it often is.
    #[inline(always)]
    fn leave_if_told<const ANY: bool>(&mut self, kind: usize, accel: &'a Accel) -> usize {
        if self.current == LEAVE { self.leave::<ANY>(accel) } else { kind }
    }

    /// Goes back to the top level.
    #[inline(always)]
    fn leave<const ANY: bool>(&mut self, accel: &'a Accel) -> usize {
        if !accel.instances[self.instance as usize].identity {
            self.ray = self.world;
        }
        self.arena = accel.tree.arena.granules();
        self.pop::<ANY>()
    }

    /// The leaf that is next.
    #[inline(always)]
    fn leaf<L: Leaf>(&self) -> &'a L {
        L::at(self.arena, self.current & !(KIND | QUAD))
    }

    /// Tests a leaf's triangles.
    #[inline(always)]
    fn test<const ANY: bool, C: Coverage, L: Leaf>(&mut self, accel: &Accel, coverage: &C) -> usize {
        let block = self.leaf::<L>();
        if ANY {
            let (hit, asked) = if C::TRIVIAL {
                (block.any(&self.ray, self.t_max), false)
            } else {
                block.any_there(&self.ray, self.t_max)
            };
            if asked && !hit {
                return self.ask::<ANY, C, L>(block, accel, coverage);
            }
            let next = self.take::<ANY>();
            // All bits or none, to be done whatever comes next.
            let hit = 0_u32.wrapping_sub(u32::from(hit));
            self.best[1].instance = self.instance | !hit;
            self.current |= hit;
            return next | (hit >> 29) as usize;
        }
        let (lane, hit) =
            if C::TRIVIAL { block.nearest(&self.ray, self.t_max) } else { block.nearest_there(&self.ray, self.t_max) };
        if !C::TRIVIAL && block.opacity(lane) == Opacity::Asked && hit.t <= self.t_max {
            return self.ask::<ANY, C, L>(block, accel, coverage);
        }
        let (triangle, best) = (block.row(lane), &self.best[1]);
        // Distances are positive, so that they are in the order of their bits.
        let mut nearer = hit.t.to_bits().wrapping_sub(best.t.to_bits()) >> 31;
        if hit.t == best.t {
            // Of neighbours, or in the same place: seldom.
            let name = |instance: u32, triangle: u32| accel.merged.name(instance, triangle);
            nearer = u32::from(name(self.instance, triangle) < name(best.instance, best.triangle));
        }
        // What is not nearer is kept where nobody looks.
        self.best[nearer as usize & 1] =
            Hit { t: hit.t, instance: self.instance, triangle, b1: hit.b1, b2: hit.b2, back: hit.back };
        self.shorten(if hit.t < self.t_max { hit.t } else { self.t_max });
        self.pop::<ANY>()
    }

    /// The same where the first hit has to be asked whether it is there.
    #[inline(never)]
    fn ask<const ANY: bool, C: Coverage, L: Leaf>(&mut self, block: &L, accel: &Accel, coverage: &C) -> usize {
        let met = block.intersect(&self.ray, self.t_max);
        let mut lanes = met.hits;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize & (LANES - 1);
            lanes &= lanes - 1;
            let found = hit_of(&met, block.row(lane), self.instance, lane);
            let best = &self.best[1];
            let name = |hit: &Hit| accel.merged.name(hit.instance, hit.triangle);
            let nearer = found.t < best.t || found.t == best.t && name(&found) < name(best);
            if nearer && is_there(block.opacity(lane), self.id, &accel.merged.named(found), coverage) {
                self.best[1] = found;
                self.shorten(found.t);
                if ANY {
                    self.current = DONE;
                    return (DONE >> 29) as usize;
                }
            }
        }
        self.pop::<ANY>()
    }
}

/// Traces all rays; `done` gets the index and the nearest hit of each, in no particular order. With `ANY`, what it
/// gets is some hit if there is one.
#[inline(always)]
pub(super) fn trace<const ANY: bool, C: Coverage>(
    accel: &Accel,
    rays: &impl Rays,
    coverage: &C,
    counters: &mut impl Counters,
    mut done: impl FnMut(usize, &Hit),
) {
    let mut stacks = STACKS.take();
    stacks.resize(IN_FLIGHT, Stack::EMPTY);
    let mut stack = stacks.iter_mut();
    let mut slots: [Slot; IN_FLIGHT] = std::array::from_fn(|_| Slot::new(stack.next().expect("a stack for each slot")));
    let mut queues = Queues { of: [0; 8] };
    let count = rays.count();
    let mut next = 0;
    for (row, slot) in slots.iter_mut().enumerate() {
        if next < count {
            slot.begin::<ANY, C>(accel, next, rays, coverage);
            queues.of[(slot.current >> 29) as usize] |= 1 << row;
            next += 1;
        }
    }
    let mut under_way = next;
    macro_rules! drain {
        ($kind:expr, |$slot:ident| $step:expr) => {
            let mut waiting = std::mem::take(&mut queues.of[$kind]);
            while waiting != 0 {
                let row = waiting.trailing_zeros() as usize % IN_FLIGHT;
                waiting &= waiting - 1;
                let $slot = &mut slots[row];
                let kind: usize = $step;
                queues.of[kind] |= 1 << row;
            }
        };
    }
    while under_way > 0 {
        drain!(0, |slot| {
            counters.node();
            counters.lanes(|| Node::at(slot.arena, slot.current).boxes().count());
            slot.descend::<ANY>()
        });
        drain!(POP, |slot| slot.pop::<ANY>());
        drain!((LEAF >> 29) as usize, |slot| {
            counters.triangles(LANES);
            counters.lanes(|| slot.leaf::<TriangleBlock>().count());
            let kind = slot.test::<ANY, C, TriangleBlock>(accel, coverage);
            slot.leave_if_told::<ANY>(kind, accel)
        });
        drain!(((LEAF | QUAD) >> 29) as usize, |slot| {
            counters.triangles(LANES);
            counters.lanes(|| slot.leaf::<TriangleQuad>().count());
            let kind = slot.test::<ANY, C, TriangleQuad>(accel, coverage);
            slot.leave_if_told::<ANY>(kind, accel)
        });
        drain!((INSTANCE >> 29) as usize, |slot| {
            slot.enter(accel);
            (slot.current >> 29) as usize
        });
        drain!((SHAPE >> 29) as usize, |slot| slot.meet::<ANY, C>(accel, coverage));
        drain!(7, |slot| {
            if slot.current == LEAVE {
                slot.leave::<ANY>(accel)
            } else {
                let best = slot.best[1];
                done(slot.index as usize, &if ANY { best } else { accel.merged.named(best) });
                if next == count {
                    under_way -= 1;
                    continue;
                }
                slot.begin::<ANY, C>(accel, next, rays, coverage);
                next += 1;
                (slot.current >> 29) as usize
            }
        });
    }
    STACKS.set(stacks);
}
