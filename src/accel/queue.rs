//! A wave of rays through the eight-wide trees: tens of them in flight, stepped in turn.
//!
//! One ray alone waits for memory at each node. Here [`IN_FLIGHT`] rays take turns, each asking for its next node as soon
//! as it knows which, so that the wait of one is the work of the others. What a ray needs next is not branched upon but
//! decides which of a few small queues its slot goes to; each queue is then drained by code that does one thing.
//!
//! The order of the walk changes with the neighbours in flight, but not the hits: of equally near ones that of the
//! smaller (instance, triangle) counts.

use wide::{f32x8, u16x8, u32x8};

use super::{
    Coverage,
    arena::Granule,
    bvh8::{INSTANCE, KIND, LEAF, Node},
    structure::Counters,
    triangle::{Ray, TriangleBlock},
    two_level::{Accel, Hit, NO_HIT, hit_of, to_local},
};
use crate::simd::{LANES, prefetch};

/// Rays in flight: fewer leave memory idle, more gain nothing and crowd the first-level cache.
const IN_FLIGHT: usize = 32;
/// Subtrees that a slot can put off; rays through a deeper tree are followed one by one.
pub(super) const STACK: usize = 120;
/// The slot's ray goes back to the top level.
const LEAVE: u32 = u32::MAX - 1;
/// Nothing is left to visit.
const DONE: u32 = u32::MAX;
/// How much farther than it is the nearest hit counts when subtrees are passed by: their distance carries a lane in its
/// last three bits.
const CULL: f32 = 1.0 + 8.0 * f32::EPSILON;

/// Rays to be traced.
pub trait Rays {
    /// How many.
    fn count(&self) -> usize;
    /// Start, direction (not zero, of any length), end in units of the direction.
    fn ray(&self, index: usize) -> ([f32; 3], [f32; 3], f32);
    /// Name of the ray, for surfaces that stop some rays only.
    fn id(&self, index: usize) -> u32;
}

/// Rays in a list, all of one name: start, direction, end in units of the direction.
#[derive(Clone, Copy, Debug, Default)]
pub struct RayList<'a>(pub &'a [([f32; 3], [f32; 3], f32)]);

impl Rays for RayList<'_> {
    fn count(&self) -> usize {
        self.0.len()
    }

    #[inline(always)]
    fn ray(&self, index: usize) -> ([f32; 3], [f32; 3], f32) {
        self.0[index]
    }

    #[inline(always)]
    fn id(&self, _: usize) -> u32 {
        0
    }
}

/// The lanes of each mask: those whose bit is set, then the others.
static COMPRESS: [[u16; LANES]; 256] = {
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

/// One ray under way.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Slot<'a> {
    ray: Ray,
    t_max: f32,
    /// Entries of the stack.
    top: usize,
    /// What is visited next.
    current: u32,
    /// What `current` and the stack refer to.
    arena: &'a [Granule],
    instance: u32,
    check: bool,
    best: Hit,
    /// Name of the ray.
    id: u32,
    /// Index of the ray in its wave.
    index: u32,
    /// The ray as it came.
    world: Ray,
    /// Subtrees put off, by distance. Eight entries that are always met lie below the first.
    near: [f32; STACK + 2 * LANES],
    child: [u32; STACK + 2 * LANES],
}

/// Slots in need of one kind of step.
struct Queue {
    slots: [u8; IN_FLIGHT],
    len: usize,
}

impl Queue {
    const EMPTY: Self = Self { slots: [0; IN_FLIGHT], len: 0 };
}

/// Queues by kind of the next step: nodes, leaves, instances, rays that leave a mesh or are done, by the upper two bits
/// of a reference; and rays that met none of a node's boxes.
struct Queues {
    of: [Queue; 5],
}

/// The last of [`Queues`].
const POP: usize = 4;

impl Queues {
    #[inline(always)]
    fn push(&mut self, slot: usize, kind: usize) {
        let queue = &mut self.of[kind];
        queue.slots[queue.len % IN_FLIGHT] = slot as u8;
        queue.len += 1;
    }
}

/// Asks for what a reference leads to: a node, or most of a block.
#[inline(always)]
fn fetch(arena: &[Granule], reference: u32) {
    prefetch::<4, Granule>(arena, (reference & !KIND) as usize);
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
fn sort4(mut keys: f32x8) -> f32x8 {
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
fn sort8(keys: f32x8) -> f32x8 {
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
    fn new() -> Self {
        let ray = Ray::new([0.0; 3], [0.0, 0.0, 1.0]);
        let mut slot = Self {
            ray,
            t_max: 0.0,
            top: LANES,
            current: DONE,
            arena: &[],
            instance: 0,
            check: false,
            best: NO_HIT,
            id: 0,
            index: 0,
            world: ray,
            near: [0.0; STACK + 2 * LANES],
            child: [0; STACK + 2 * LANES],
        };
        slot.near[..LANES].fill(f32::NEG_INFINITY);
        slot.child[..LANES].fill(DONE);
        slot
    }

    /// Tests a node's boxes; the nearest child is next, the others are put off.
    #[inline(always)]
    fn descend<const ANY: bool>(&mut self) -> usize {
        let node = Node::at(self.arena, self.current);
        let (near, far) = node.distances(&self.ray, self.t_max);
        let met = near.simd_le(far);
        let mask = met.to_bitmask() as usize & 255;
        let count = mask.count_ones() as usize;
        let lanes = u32x8::from(u16x8::new(COMPRESS[mask]));
        let top = self.top.min(STACK);
        if ANY {
            // All subtrees have to be seen, so that their order and distance do not matter.
            let children = u32x8::new(node.children()).shuffle_wrapping(lanes).to_array();
            self.child[top..top + LANES].copy_from_slice(&children);
        } else {
            // Each distance carries its lane in its last bits; what is not met comes last.
            let keys: u32x8 = bytemuck::cast(met.bitselect(near, f32x8::splat(f32::MIN)));
            let keys = bytemuck::cast(keys.shuffle_wrapping(lanes) & u32x8::splat(!7) | lanes);
            let keys = if count <= 4 { sort4(keys) } else { sort8(keys) };
            let children = u32x8::new(node.children()).shuffle_wrapping(bytemuck::cast(keys)).to_array();
            self.near[top..top + LANES].copy_from_slice(&keys.to_array());
            self.child[top..top + LANES].copy_from_slice(&children);
        }
        self.top = top + count;
        self.top -= usize::from(count != 0);
        self.current = self.child[self.top.min(STACK + LANES)];
        fetch(self.arena, self.current);
        // A choice of two numbers, not a branch.
        if count == 0 { POP } else { (self.current >> 30) as usize }
    }

    /// Makes the last subtree put off that is not beyond the nearest hit the next to visit.
    #[inline(always)]
    fn pop<const ANY: bool>(&mut self) {
        if ANY {
            self.top -= 1;
        } else {
            let limit = f32x8::splat(self.t_max * CULL);
            loop {
                let top = self.top.clamp(LANES, STACK + 2 * LANES);
                let near = f32x8::new(*self.near[top - LANES..top].first_chunk().expect("eight entries"));
                let met = near.simd_le(limit).to_bitmask();
                if met != 0 {
                    self.top = top - LANES + (31 - met.leading_zeros()) as usize;
                    break;
                }
                self.top = top - LANES;
            }
        }
        self.current = self.child[self.top.min(STACK + LANES)];
        fetch(self.arena, self.current);
    }

    /// Puts off something that is visited whatever is hit before.
    #[inline(always)]
    fn put_off(&mut self, reference: u32) {
        self.near[self.top] = f32::NEG_INFINITY;
        self.child[self.top] = reference;
        self.top += 1;
    }

    #[inline(always)]
    fn begin(&mut self, accel: &'a Accel, index: usize, rays: &impl Rays) {
        let (origin, direction, t_max) = rays.ray(index);
        self.index = index as u32;
        self.id = rays.id(index);
        self.world = Ray::new(origin, direction);
        self.ray = self.world;
        self.t_max = t_max;
        self.best = NO_HIT;
        self.top = LANES;
        self.arena = accel.tree.arena.granules();
        self.current = accel.tree.root.unwrap_or(DONE);
        if accel.parts.len() == 1 && self.current != DONE {
            // There is nothing to come back to.
            self.go_into(accel);
        }
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
        self.check = instance.check;
        if !instance.identity {
            self.ray = to_local(instance, self.world.origin, self.world.direction);
        }
        self.arena = instance.blas.tree.arena.granules();
        self.current = part.root;
        fetch(self.arena, self.current);
    }

    /// Goes back to the top level if that is next; returns the kind of the next step.
    #[inline(always)]
    fn leave_if_told<const ANY: bool>(&mut self, accel: &'a Accel) -> usize {
        if self.current == LEAVE {
            self.leave::<ANY>(accel);
        }
        (self.current >> 30) as usize
    }

    #[inline(always)]
    fn leave<const ANY: bool>(&mut self, accel: &'a Accel) {
        if !accel.instances[self.instance as usize].identity {
            self.ray = self.world;
        }
        self.arena = accel.tree.arena.granules();
        self.pop::<ANY>();
    }

    /// Tests a leaf's triangles.
    #[inline(always)]
    fn test<const ANY: bool, C: Coverage>(&mut self, coverage: &C) {
        let block = TriangleBlock::at(self.arena, self.current & !KIND);
        let met = block.intersect(&self.ray, self.t_max);
        let mut lanes = met.hits;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize & (LANES - 1);
            lanes &= lanes - 1;
            let found = hit_of(&met, block, self.instance, lane);
            let best = &self.best;
            let nearer = found.t < best.t
                || found.t == best.t && (self.instance, found.triangle) < (best.instance, best.triangle);
            if nearer && (C::TRIVIAL || !self.check || coverage.covers(self.id, &found)) {
                self.best = found;
                self.t_max = found.t;
                if ANY {
                    self.current = DONE;
                    return;
                }
            }
        }
        self.pop::<ANY>();
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
    let mut slots: [Slot; IN_FLIGHT] = [const { None::<()> }; IN_FLIGHT].map(|_| Slot::new());
    let mut queues = Queues { of: [Queue::EMPTY; 5] };
    let count = rays.count();
    let mut next = 0;
    for (row, slot) in slots.iter_mut().enumerate() {
        if next < count {
            slot.begin(accel, next, rays);
            queues.push(row, (slot.current >> 30) as usize);
            next += 1;
        }
    }
    let mut under_way = next;
    // A step puts its slot into a queue, the one being drained too, at a place that has been read.
    macro_rules! drain {
        ($kind:expr, |$slot:ident| $step:expr) => {
            let waiting = std::mem::replace(&mut queues.of[$kind].len, 0);
            for place in 0..waiting {
                let row = queues.of[$kind].slots[place % IN_FLIGHT] as usize % IN_FLIGHT;
                let $slot = &mut slots[row];
                let kind: usize = $step;
                queues.push(row, kind);
            }
        };
    }
    while under_way > 0 {
        drain!(0, |slot| {
            counters.node();
            slot.descend::<ANY>()
        });
        drain!(POP, |slot| {
            slot.pop::<ANY>();
            slot.leave_if_told::<ANY>(accel)
        });
        drain!((LEAF >> 30) as usize, |slot| {
            counters.triangles(LANES);
            slot.test::<ANY, C>(coverage);
            slot.leave_if_told::<ANY>(accel)
        });
        drain!((INSTANCE >> 30) as usize, |slot| {
            slot.enter(accel);
            (slot.current >> 30) as usize
        });
        drain!(3, |slot| {
            if slot.current == LEAVE {
                slot.leave_if_told::<ANY>(accel)
            } else {
                done(slot.index as usize, &slot.best);
                if next == count {
                    under_way -= 1;
                    continue;
                }
                slot.begin(accel, next, rays);
                next += 1;
                (slot.current >> 30) as usize
            }
        });
    }
}
