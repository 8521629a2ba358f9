//! A wave of rays through the eight-wide trees: tens of them in flight, stepped in turn.
//!
//! One ray alone waits for memory at each node. Here [`IN_FLIGHT`] rays take turns, each asking for its next node as soon
//! as it knows which, so that the wait of one is the work of the others. What a ray needs next is not branched upon but
//! decides which of a few small queues its slot goes to; each queue is then drained by code that does one thing.
//!
//! The order of the walk changes with the neighbours in flight, but not the hits: of equally near ones that of the
//! smaller (instance, triangle) counts.

use std::cell::Cell;

use wide::u32x8;

use super::{
    Coverage,
    bvh8::{INSTANCE, LEAF, Node},
    leaf::{Leaf, QUAD, TriangleBlock, TriangleQuad},
    slot::{LANE, LEAVE, POP, Slot, Stack},
    structure::Counters,
    two_level::{Accel, Hit, SHAPE},
};
use crate::simd::LANES;

/// Rays in flight: fewer leave memory idle, more gain nothing and crowd the first-level cache.
const IN_FLIGHT: usize = 32;

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

    /// How many samples of a pixel there are among [these](Rays::coherent_from), if they come in eights of neighbouring
    /// pixels, sample after sample of the same eight; or else 1.
    #[inline(always)]
    fn samples(&self) -> usize {
        1
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

thread_local! {
    /// Stacks of the rays in flight. Some 70 KiB, which would take as long to make as a small wave to trace.
    static STACKS: Cell<Vec<Stack>> = const { Cell::new(Vec::new()) };
}

/// Slots in need of each kind of step, a bit for each slot: nodes, leaves, instances, shapes, rays that leave a mesh, rays
/// that are done, by the upper three bits of a reference; and rays whose next subtree lies beyond what they have hit.
///
/// Bits, because the next slot is then known without a look at memory that a step before it may have written; and all in
/// one register, because where in memory a step adds to them is known only at its end, and until then the steps behind it
/// could read nothing.
struct Queues(u32x8);

impl Queues {
    /// Adds a slot, which is one bit.
    #[inline(always)]
    fn add(&mut self, kind: usize, slot: u32) {
        self.0 |= u32x8::splat(kind as u32).simd_eq(u32x8::new(LANE)) & u32x8::splat(slot);
    }

    /// The slots of a kind, which has none from then on.
    #[inline(always)]
    fn take<const KIND: usize>(&mut self) -> u32 {
        const { assert!(KIND < LANES) };
        let mut others = [u32::MAX; LANES];
        others[KIND] = 0;
        let slots = self.0.to_array()[KIND];
        self.0 &= u32x8::new(others);
        slots
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
    let mut queues = Queues(u32x8::ZERO);
    let count = rays.count();
    let mut next = 0;
    for (row, slot) in slots.iter_mut().enumerate() {
        if next < count {
            slot.begin::<ANY, C>(accel, next, rays, coverage);
            queues.add((slot.current >> 29) as usize, 1 << row);
            next += 1;
        }
    }
    let mut under_way = next;
    // Which slots are next is read one queue ahead: what the steps before it decide is then known, where it would otherwise
    // be waited for with nothing else to do. So what each of these names is the queue after its own.
    let mut ahead = 0;
    macro_rules! drain {
        ($next:expr, |$slot:ident| $step:expr) => {
            let mut waiting = ahead;
            ahead = queues.take::<{ $next as usize }>();
            while waiting != 0 {
                let row = waiting.trailing_zeros() as usize % IN_FLIGHT;
                let bit = waiting & waiting.wrapping_neg();
                waiting &= waiting - 1;
                let $slot = &mut slots[row];
                let kind: usize = $step;
                queues.add(kind, bit);
            }
        };
    }
    while under_way > 0 {
        drain!(POP, |slot| {
            counters.node();
            counters.lanes(|| Node::at(slot.arena, slot.current).boxes().count());
            slot.descend::<ANY>()
        });
        drain!(LEAF >> 29, |slot| slot.pop::<ANY>());
        drain!((LEAF | QUAD) >> 29, |slot| {
            counters.triangles(LANES);
            counters.lanes(|| slot.leaf::<TriangleBlock>().count());
            slot.test::<ANY, C, TriangleBlock>(accel, coverage)
        });
        drain!(INSTANCE >> 29, |slot| {
            counters.triangles(LANES);
            counters.lanes(|| slot.leaf::<TriangleQuad>().count());
            slot.test::<ANY, C, TriangleQuad>(accel, coverage)
        });
        drain!(SHAPE >> 29, |slot| {
            slot.enter(accel);
            (slot.current >> 29) as usize
        });
        drain!(LEAVE >> 29, |slot| slot.meet::<ANY, C>(accel, coverage));
        drain!(7, |slot| slot.leave::<ANY>(accel));
        drain!(0, |slot| {
            let best = slot.best;
            done(slot.index as usize, &if ANY { best } else { accel.merged.named(best) });
            if next == count {
                under_way -= 1;
                continue;
            }
            slot.begin::<ANY, C>(accel, next, rays, coverage);
            next += 1;
            (slot.current >> 29) as usize
        });
    }
    STACKS.set(stacks);
}
