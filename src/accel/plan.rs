//! What is best made of a binary node: which subtrees below it become the children of a wide one.
//!
//! By dynamic programming, as [`super::collapse`] says: a subtree is solved for 1, 2, … 8 places at a time, from what has
//! been found for the two below it.

use bytemuck::{Pod, Zeroable};
use obvhs::aabb::Aabb;
use wide::{f32x8, u32x8};

use super::{
    bvh8::NODE,
    collapse::{Leaves, leaf_cost},
};
use crate::simd::LANES;

/// Marks a reference within the binary tree as a primitive, of which the other bits are the row.
pub(super) const ROW: u32 = 1 << 31;
/// An inner node of the binary tree, and what is best made of it.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Inner {
    pub lower: [f32; 3],
    pub upper: [f32; 3],
    /// Other inner nodes, or primitives if [`ROW`] is set.
    pub children: [u32; 2],
    pub plan: Plan,
    /// Granules of all that is written for it, if it has a place of its own.
    pub granules: u32,
}

/// How places of a wide node are shared between the two children of a binary node, three bits for each number of places:
/// how many of two places go to the first child, of three, … of eight; none if a node or leaf of its own is better. Then
/// the same for eight if there must be a node of its own, and then whether a leaf is better than that.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(transparent)]
pub(super) struct Plan(u32);

impl Plan {
    const NODE: u32 = 3 * (LANES as u32 - 1);
    const IS_LEAF: u32 = 1 << (Self::NODE + 3);

    /// How many of so many places go to the first child; zero if it is not opened.
    pub fn of(self, places: usize) -> usize {
        if places < 2 { 0 } else { (self.0 >> (3 * (places - 2)) & 7) as usize }
    }

    /// How many of the places of its own node go to the first child.
    pub fn of_node(self) -> usize {
        (self.0 >> Self::NODE & 7) as usize
    }

    pub fn is_leaf(self) -> bool {
        self.0 & Self::IS_LEAF != 0
    }
}

/// Of a subtree: what it costs, and the granules it takes, when it is given up to 1, 2, … 8 places in a wide node.
#[derive(Clone, Copy)]
pub(super) struct Solved {
    columns: Columns,
    pub bounds: Aabb,
    count: u32,
    /// Of the inner node or the primitive.
    pub reference: u32,
}

/// Costs and granules. With infinities before the costs, those with so many places less can be read in one go; what is
/// then read before the granules counts for nothing.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Columns {
    before: [f32; LANES],
    cost: [f32; LANES],
    granules: [u32; LANES],
}

impl Columns {
    fn new(cost: f32x8, granules: u32x8) -> Self {
        Self { before: [f32::INFINITY; LANES], cost: cost.to_array(), granules: granules.to_array() }
    }

    /// Eight from so many before the costs on.
    #[inline(always)]
    fn costs(&self, places_less: usize) -> f32x8 {
        let all: &[f32; 3 * LANES] = bytemuck::cast_ref(self);
        f32x8::new(*all[LANES - places_less..].first_chunk().expect("eight places"))
    }

    #[inline(always)]
    fn granules(&self, places_less: usize) -> u32x8 {
        let all: &[u32; 3 * LANES] = bytemuck::cast_ref(self);
        u32x8::new(*all[2 * LANES - places_less..].first_chunk().expect("eight places"))
    }
}

/// The best shares of 1, 2, … 8 places between two subtrees; what it says of one place counts for nothing.
struct Shares {
    cost: f32x8,
    granules: u32x8,
    /// Places of the first, each where [`Plan`] has it.
    to_first: u32x8,
}

/// One place cannot be shared.
const SHARED: [u32; LANES] = [0, !0, !0, !0, !0, !0, !0, !0];

/// So many places for the first, of 1, 2, … 8 where [`Plan`] has them.
const fn to_first(own: u32) -> [u32; LANES] {
    let mut all = [0; LANES];
    let mut place = 1;
    while place < LANES {
        all[place] = own << (3 * (place - 1));
        place += 1;
    }
    all
}

/// All but one place for the first.
const fn all_but_one() -> [u32; LANES] {
    let mut all = [0; LANES];
    let mut place = 1;
    while place < LANES {
        all[place] = (place as u32) << (3 * (place - 1));
        place += 1;
    }
    all
}

impl Shares {
    #[inline(always)]
    fn of(first: &Solved, second: &Solved) -> Self {
        if second.reference & ROW != 0 {
            // It needs one place.
            let cost = first.columns.costs(1) + second.columns.costs(0);
            let granules = first.columns.granules(1) + second.columns.granules(0);
            return Self { cost, granules, to_first: u32x8::new(const { all_but_one() }) };
        }
        let share = |own: usize| {
            let cost = f32x8::splat(first.columns.cost[own - 1]) + second.columns.costs(own);
            (cost, u32x8::splat(first.columns.granules[own - 1]) + second.columns.granules(own))
        };
        let (mut cost, mut granules) = share(1);
        let mut places = u32x8::new(const { to_first(1) });
        if first.reference & ROW == 0 {
            const TO_FIRST: [[u32; LANES]; LANES] = {
                let mut all = [[0; LANES]; LANES];
                let mut own = 0;
                while own < LANES {
                    all[own] = to_first(own as u32);
                    own += 1;
                }
                all
            };
            for (own, &to_first) in TO_FIRST.iter().enumerate().skip(2) {
                let (candidate, size) = share(own);
                let better = candidate.simd_lt(cost);
                cost = better.bitselect(candidate, cost);
                let better: u32x8 = bytemuck::cast(better);
                granules = better.bitselect(size, granules);
                places = better.bitselect(u32x8::new(to_first), places);
            }
        }
        Self { cost, granules, to_first: places }
    }
}

impl Solved {
    pub fn primitive<L: Leaves>(row: u32, bounds: &Aabb) -> Self {
        let cost = f32x8::splat(leaf_cost(1) * bounds.half_area());
        let granules = u32x8::splat(L::granules(1) as u32);
        Self { columns: Columns::new(cost, granules), bounds: *bounds, count: 1, reference: row | ROW }
    }

    /// With one place.
    pub fn cost(&self) -> f32 {
        self.columns.cost[0]
    }

    /// Of the node over two subtrees, which is `reference`.
    #[inline(always)]
    pub fn over<L: Leaves>(first: &Self, second: &Self, reference: u32) -> (Self, Inner) {
        let shares = Shares::of(first, second);
        let bounds = first.bounds.union(&second.bounds);
        let count = first.count + second.count;
        let area = bounds.half_area();
        let leaf = if count as usize <= L::MOST { leaf_cost(count) * area } else { f32::INFINITY };
        let node = area + shares.cost.to_array()[LANES - 1];
        let is_leaf = count as usize <= L::MOST && leaf <= node;
        let of_node = shares.granules.to_array()[LANES - 1];
        let own = if is_leaf { L::granules(count as usize) as u32 } else { NODE as u32 + of_node };
        // More places are never worse. At equal cost memory decides.
        let (whole, size) = (f32x8::splat(if is_leaf { leaf } else { node }), u32x8::splat(own));
        let [less, equal] = [shares.cost.simd_lt(whole), shares.cost.simd_eq(whole)].map(bytemuck::cast::<_, u32x8>);
        let opened = u32x8::new(SHARED) & (less | (equal & shares.granules.simd_lt(size)));
        let cost = bytemuck::cast::<_, f32x8>(opened).bitselect(shares.cost, whole);
        let granules = opened.bitselect(shares.granules, size);
        let mut plan = (opened & shares.to_first).reduce_add();
        let last = shares.to_first.to_array()[LANES - 1];
        plan |= last << 3;
        plan |= if is_leaf { Plan::IS_LEAF } else { 0 };
        let this = Self { columns: Columns::new(cost, granules), bounds, count, reference };
        let inner = Inner {
            lower: bounds.min.to_array(),
            upper: bounds.max.to_array(),
            children: [first.reference, second.reference],
            plan: Plan(plan),
            granules: own,
        };
        (this, inner)
    }
}
