//! One ray on its way through the eight-wide trees, a step at a time.
//!
//! A step is some hundred instructions, each of which waits for one before it; what keeps a core busy is that it works on
//! the steps of a few rays at once. So a step must not end in anything that steps of other rays have to wait for: no
//! store to a place that is known only when the step is done, which all later reads might be of. That alone was a tenth of
//! the time.

use std::hint::select_unpredictable;

use wide::{f32x8, u16x8, u32x8};

use super::{
    Coverage, Rays,
    arena::Granule,
    bvh8::{BEYOND, FAR_SCALE, KIND, Node},
    leaf::{Leaf, QUAD, least},
    opacity::Opacity,
    triangle::Ray,
    two_level::{Accel, Hit, NO_HIT, SHAPE, hit_of, is_there},
};
use crate::{
    flat::NONE,
    simd::{LANES, prefetch},
};

/// Subtrees that a slot can put off; rays through a deeper tree are followed one by one.
pub(super) const STACK: usize = 240;
/// The slot's ray goes back to the top level.
pub(super) const LEAVE: u32 = DONE & !QUAD;
/// Nothing is left to visit.
const DONE: u32 = u32::MAX;
/// How much farther than it is the nearest hit counts when subtrees are passed by: their distance carries a lane in its
/// last three bits.
pub(super) const CULL: f32 = BEYOND * (1.0 + 9.0 * f32::EPSILON);
/// The bits of a distance that are its own.
pub(super) const OWN: u32 = !(LANES as u32 - 1);
/// The lanes, to be carried.
pub(super) const LANE: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7];

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
pub(super) struct Slot<'a> {
    ray: Ray,
    t_max: f32,
    /// Boxes that begin beyond are not met.
    reach: f32,
    /// Subtrees put off that begin beyond are passed by.
    limit: f32,
    /// What is visited next.
    pub current: u32,
    /// What `current` and the stack refer to.
    pub arena: &'a [Granule],
    /// Subtrees put off: a byte, so that the compiler knows it to be inside the stack.
    top: u8,
    instance: u32,
    /// The nearest hit.
    pub best: Hit,
    /// Name of the ray.
    id: u32,
    /// Index of the ray in its wave.
    pub index: u32,
    /// The ray as it came, if it has to come back from anywhere.
    world: Ray,
    stack: &'a mut Stack,
    /// Without it a slot is 256 bytes long, and every sixteenth stands at the same place in its page, which the core takes for
    /// the same address until it knows better: 4 % of the time of occlusion.
    _apart: [u32; 16],
}

/// Subtrees put off, by distance. Eight entries that are always met lie below the first.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Stack {
    near: [f32; ENTRIES],
    child: [u32; ENTRIES],
}

impl Stack {
    pub const EMPTY: Self = {
        let (mut near, mut child) = ([0.0; ENTRIES], [0; ENTRIES]);
        let mut entry = 0;
        while entry < LANES {
            (near[entry], child[entry]) = (f32::NEG_INFINITY, DONE);
            entry += 1;
        }
        Self { near, child }
    };
}

/// What a slot needs next if that is not known by a reference: its next subtree lies beyond what it has hit.
pub(super) const POP: usize = 1;

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
    pub fn new(stack: &'a mut Stack) -> Self {
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
            best: NO_HIT,
            id: 0,
            index: 0,
            world: ray,
            stack,
            _apart: [0; 16],
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
    fn take(&mut self) -> usize {
        // Below the first are entries that mean the end.
        let last = usize::from(self.top) + LANES - 1;
        self.top = self.top.wrapping_sub(1);
        self.current = self.stack.child[last];
        fetch(self.arena, self.current);
        (self.current >> 29) as usize
    }

    /// Tests a node's boxes; the nearest child is next, the others are put off.
    #[inline(always)]
    pub fn descend<const ANY: bool>(&mut self) -> usize {
        let node = Node::at(self.arena, self.current);
        let (near, far) = node.distances(&self.ray, self.reach);
        let met = near.simd_le(far);
        let mask = met.to_bitmask() as usize & 255;
        let count = mask.count_ones();
        let lanes = u32x8::from(u16x8::new(COMPRESS[mask]));
        let top = usize::from(self.top) + LANES;
        let stack = &mut *self.stack;
        // What is next if no child is met; below the first put off are entries that mean the end.
        let (older, older_near) = (stack.child[top - 1], stack.near[top - 1]);
        let (lane, children) = if ANY {
            // Order and distance do not matter.
            (31_u32.wrapping_sub((mask as u32).leading_zeros()) as usize % LANES, lanes)
        } else {
            // Each distance carries its lane in its last bits; what is not met becomes zero. That may tie
            // with the first child, and is then as good as it.
            let own = bytemuck::cast::<_, u32x8>(near) & u32x8::splat(OWN) | u32x8::new(LANE);
            let met = bytemuck::cast::<_, u32x8>(met);
            let keys: f32x8 = bytemuck::cast((own & met).shuffle_wrapping(lanes));
            let keys = if count <= 4 { sort4(keys) } else { sort8(keys) };
            stack.near[top..top + LANES].copy_from_slice(&keys.to_array());
            // The last of them is the nearest, but it is known sooner like this, and the slot waits for it.
            (least(own | !met).to_array()[0] as usize % LANES, bytemuck::cast(keys))
        };
        let nearest = node.child(lane);
        let children = u32x8::new(*node.children()).shuffle_wrapping(children).to_array();
        stack.child[top..top + LANES].copy_from_slice(&children);
        self.top = self.top.wrapping_add(count as u8).wrapping_sub(1);
        let any = count != 0;
        self.current = select_unpredictable(any, nearest, older);
        fetch(self.arena, self.current);
        // A choice of two numbers, not a branch. All subtrees have to be seen to know that there is no hit.
        if ANY || any | (older_near <= self.limit) { (self.current >> 29) as usize } else { POP }
    }

    /// Makes the last subtree put off that is not beyond the nearest hit the next to visit.
    #[inline(always)]
    pub fn pop<const ANY: bool>(&mut self) -> usize {
        if ANY {
            return self.take();
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
    pub fn begin<const ANY: bool, C: Coverage>(
        &mut self,
        accel: &'a Accel,
        index: usize,
        rays: &impl Rays,
        coverage: &C,
    ) {
        let (origin, direction, t_max) = rays.ray(index);
        self.index = index as u32;
        self.id = rays.id(index);
        self.ray = Ray::new(origin, direction);
        self.shorten(t_max);
        self.best = NO_HIT;
        self.top = 0;
        self.arena = accel.tree.arena.granules();
        self.current = accel.tree.root.unwrap_or(DONE);
        // Nothing is nearer than an end that is not a number, not even the end of the walk.
        if !self.ray.is_finite() || t_max.is_nan() {
            self.current = DONE;
            return;
        }
        if !accel.unbounded.is_empty() {
            let (t_max, best) = (&mut self.t_max, &mut self.best);
            accel.meet_unbounded(&self.ray, t_max, best, self.id, coverage);
            self.shorten(self.t_max);
            if ANY && self.best.instance != NONE {
                self.current = DONE;
                return;
            }
        }
        if accel.alone && self.current != DONE {
            // There is nothing to come back to.
            self.go_into::<DONE>(accel);
        } else {
            self.world = self.ray;
        }
    }

    /// Tests a shape.
    #[inline(always)]
    pub fn meet<const ANY: bool, C: Coverage>(&mut self, accel: &'a Accel, coverage: &C) -> usize {
        let part = accel.parts[(self.current & !SHAPE) as usize];
        // Of equally near hits the names outside decide.
        let (mut t_max, mut best) = (self.t_max, accel.merged.named(self.best));
        accel.meet_shape(part.instance, &self.ray, &mut t_max, &mut best, self.id, coverage);
        if best.instance == part.instance {
            self.best = best;
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
    pub fn enter(&mut self, accel: &'a Accel) {
        self.put_off(LEAVE);
        self.go_into::<LEAVE>(accel);
    }

    /// Goes on with `ELSE` if the ray cannot be seen from there.
    #[inline(always)]
    fn go_into<const ELSE: u32>(&mut self, accel: &'a Accel) {
        let part = accel.parts[(self.current & !KIND) as usize];
        let instance = &accel.instances[part.instance as usize];
        self.instance = part.instance;
        if !instance.identity {
            self.ray = accel.ways[part.instance as usize].lead(self.ray.origin, self.ray.direction);
        }
        self.arena = instance.blas.tree.arena.granules();
        self.current = part.root;
        fetch(self.arena, self.current);
        if !instance.identity && !self.ray.is_finite() {
            self.current = ELSE;
            self.top = self.top.saturating_sub(1);
        }
    }

    /// Goes back to the top level.
    #[inline(always)]
    pub fn leave<const ANY: bool>(&mut self, accel: &'a Accel) -> usize {
        // Also where it is the same: a branch that cannot be guessed takes longer.
        self.ray = self.world;
        self.arena = accel.tree.arena.granules();
        self.pop::<ANY>()
    }

    /// The leaf that is next.
    #[inline(always)]
    pub fn leaf<L: Leaf>(&self) -> &'a L {
        L::at(self.arena, self.current & !(KIND | QUAD))
    }

    /// Tests a leaf's triangles.
    #[inline(always)]
    pub fn test<const ANY: bool, C: Coverage, L: Leaf>(&mut self, accel: &Accel, coverage: &C) -> usize {
        let block = self.leaf::<L>();
        if ANY {
            let (hit, asked) = if C::TRIVIAL {
                (block.any(&self.ray, self.t_max), false)
            } else if C::BACKS {
                (false, block.any(&self.ray, self.t_max))
            } else {
                block.any_there(&self.ray, self.t_max)
            };
            if asked && !hit {
                return self.ask::<ANY, C, L>(block, accel, coverage);
            }
            let next = self.take();
            // All bits or none, to be done whatever comes next.
            let hit = 0_u32.wrapping_sub(u32::from(hit));
            self.best.instance = self.instance | !hit;
            self.current |= hit;
            return next | (hit >> 29) as usize;
        }
        let nearest = if C::TRIVIAL || C::BACKS {
            block.nearest(&self.ray, self.t_max)
        } else {
            block.nearest_there(&self.ray, self.t_max)
        };
        // A branch, because then what is next does not wait for the test: four of five leaves are missed.
        let Some((lane, hit)) = nearest else { return self.pop::<ANY>() };
        if !C::TRIVIAL && block.opacity(lane) == Opacity::Asked {
            return self.ask::<ANY, C, L>(block, accel, coverage);
        }
        let found = Hit {
            t: hit.t,
            instance: self.instance,
            triangle: block.row(lane),
            b1: hit.b1,
            b2: hit.b2,
            back: hit.back,
        };
        // Of neighbours, or in the same place: seldom.
        let name = |hit: &Hit| accel.merged.name(hit.instance, hit.triangle);
        if found.t < self.best.t || name(&found) < name(&self.best) {
            self.best = found;
            self.shorten(found.t);
        }
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
            let best = &self.best;
            let name = |hit: &Hit| accel.merged.name(hit.instance, hit.triangle);
            let nearer = found.t < best.t || found.t == best.t && name(&found) < name(best);
            if nearer && is_there(block.opacity(lane), self.id, &accel.merged.named(found), coverage) {
                self.best = found;
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
