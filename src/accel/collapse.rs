//! From a binary tree to one of eight children to a node.
//!
//! Which subtrees become the children of a wide node is chosen so that the expected cost of a ray is least (Ylitie, Karras,
//! Laine 2017, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", section 3.3), with one
//! difference: a leaf costs the same whether it holds one triangle or eight, as they are tested at once; only its memory
//! differs.
//!
//! Costs go up the tree: it is divided into pieces that are solved side by side, and then what is above them. How much
//! memory a subtree takes is known with its cost, so that nodes and leaves are then written down the tree, each subtree
//! into a slice of its own. What comes out does not depend on who wrote what.

use std::{
    collections::{HashMap, VecDeque},
    ops::{Deref, DerefMut},
};

use bytemuck::{Pod, Zeroable, zeroed_vec};
use obvhs::{aabb::Aabb, bvh2::node::Bvh2Node};
use rayon::prelude::*;
use wide::{f32x8, u32x8};

use super::{
    arena::{Arena, Granule},
    bvh8::NODE,
    leaf::{Leaf, QUAD, TriangleQuad},
};
use crate::simd::{LANES, prefetch};

/// How leaves are made.
pub(super) trait Leaves: Sync {
    /// Rows in a leaf at most, and no more than eight.
    const MOST: usize;

    /// Granules that a leaf of so many rows takes.
    fn granules(count: usize) -> usize;

    /// Writes a leaf that stands at `place` into the granules given to it, and returns its reference. The order of rows
    /// is not defined.
    fn write(&self, rows: &mut [u32], place: u32, into: &mut [Granule]) -> u32;

    /// Asks for the memory that a row will be written from.
    fn prefetch(&self, _row: u32) {}
}

/// Leaves without memory: what rows are referred to by, as the given function says.
pub(super) struct References<F>(pub F);

impl<F: Fn(u32) -> u32 + Sync> Leaves for References<F> {
    const MOST: usize = 1;

    fn granules(_: usize) -> usize {
        0
    }

    fn write(&self, rows: &mut [u32], _: u32, _: &mut [Granule]) -> u32 {
        self.0(rows[0])
    }
}

/// Cost of a leaf in units of that of a node. A step of either takes about as long, whatever the leaf holds, but a leaf of
/// more than four triangles takes twice the memory. Of 0.8, 1 and 1.2 for the first, and 1, 1.2, 1.5 and 2 for the
/// second, these gave the smallest trees, and rays as fast as any.
pub(super) fn leaf_cost(triangles: u32) -> f32 {
    if triangles as usize > TriangleQuad::MOST { 1.0 } else { 0.8 }
}

/// Marks a reference within the binary tree as a primitive, of which the other bits are the row.
const ROW: u32 = 1 << 31;
/// While a piece is listed: marks a reference as the root of another piece.
const PIECE: u32 = 1 << 30;

/// An inner node of the binary tree, and what is best made of it.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Inner {
    lower: [f32; 3],
    upper: [f32; 3],
    /// Other inner nodes, or primitives if [`ROW`] is set.
    children: [u32; 2],
    plan: Plan,
    /// Granules of all that is written for it, if it has a place of its own.
    granules: u32,
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
    fn of(self, places: usize) -> usize {
        if places < 2 { 0 } else { (self.0 >> (3 * (places - 2)) & 7) as usize }
    }

    /// How many of the places of its own node go to the first child.
    fn of_node(self) -> usize {
        (self.0 >> Self::NODE & 7) as usize
    }

    fn is_leaf(self) -> bool {
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
    reference: u32,
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

/// Inner nodes from `root` down, parents before children, up to where `end` says that another piece begins. Each is
/// given by its children: primitives, inner nodes of this piece (of no defined number), or other pieces.
fn list(binary: &[Bvh2Node], root: u32, end: impl Fn(u32) -> Option<u32>) -> Vec<[u32; 2]> {
    let (mut all, mut pending) = (Vec::new(), vec![root]);
    while let Some(node) = pending.pop() {
        let first = binary[node as usize].first_index;
        let reference = |child: u32| {
            let node = &binary[child as usize];
            if node.is_leaf() { node.first_index | ROW } else { end(child).map_or(0, |piece| piece | PIECE) }
        };
        let children = [first, first + 1].map(reference);
        all.push(children);
        pending.extend([1, 0].into_iter().filter(|&side| children[side] == 0).map(|side| first + side as u32));
    }
    all
}

/// Solves the nodes of a piece, which stand from `start` on, and returns that of its root.
fn solve<L: Leaves>(listed: &[[u32; 2]], start: u32, boxes: &[Aabb], pieces: &[Solved], into: &mut [Inner]) -> Solved {
    // The last of those that are listed is the lowest, and of a node's children the first comes to lie on top.
    let mut below: Vec<Solved> = Vec::new();
    for (place, children) in listed.iter().enumerate().rev() {
        for child in place.checked_sub(AHEAD).map_or([0; 2], |ahead| listed[ahead]) {
            if child & ROW != 0 {
                prefetch::<1, _>(boxes, (child & !ROW) as usize);
            }
        }
        let [first, second] = children.map(|child| match child {
            0 => below.pop().expect("solved before its parent"),
            row if row & ROW != 0 => Solved::primitive::<L>(row & !ROW, &boxes[(row & !ROW) as usize]),
            piece => pieces[(piece & !PIECE) as usize],
        });
        let (solved, inner) = Solved::over::<L>(&first, &second, start + place as u32);
        into[place] = inner;
        below.push(solved);
    }
    below.pop().expect("a piece has a root")
}

/// How many nodes ahead boxes are asked for. They lie anywhere, and waiting for them was half of the time.
const AHEAD: usize = 16;

/// Primitives of a piece, about. Of 1024, 4096 and 16384 all are as fast on few threads; it is for many.
const PIECE_SIZE: usize = 2048;

/// What is written by one thread, in granules, at most: some thousand triangles.
const TASK: u32 = 1 << 14;

/// In small trees it is less; what takes as long as waking another thread is not divided.
const LEAST_TASK: u32 = 1 << 10;

/// What is made of a binary tree; see [`super::bvh8::Bvh8`].
pub(super) struct Collapsed {
    pub arena: Arena,
    pub root: u32,
    pub stack: usize,
    pub cost: f32,
}

/// Collapses a binary tree of at least two leaves, whose own boxes are not looked at.
pub(super) fn collapse<L: Leaves>(binary: &[Bvh2Node], boxes: &[Aabb], leaves: &L) -> Collapsed {
    let (inners, root) = plan::<L>(binary, boxes);
    write(&inners, &root, boxes, leaves)
}

/// Writes what is planned below an inner node.
pub(super) fn write<L: Leaves>(inners: &[Inner], root: &Solved, boxes: &[Aabb], leaves: &L) -> Collapsed {
    let (root, cost) = (root.reference, root.columns.cost[0]);
    let whole = &inners[root as usize];
    assert!(whole.granules < QUAD, "16 GiB of one mesh");
    let writer = Writer { inners, boxes, leaves };
    let mut arena = Arena::zeroed(whole.granules as usize);
    if whole.plan.is_leaf() {
        let mut rows = Few::new();
        writer.rows(root, &mut rows);
        let root = leaves.write(&mut rows, 0, arena.granules_mut());
        return Collapsed { arena, root, stack: 0, cost };
    }
    let task = (whole.granules / 16).clamp(LEAST_TASK, TASK);
    let (mut large, mut tasks, mut stack) = (Vec::new(), Vec::new(), 0);
    large.push(Subtree { inner: root, place: 0, put_off: 0, into: arena.granules_mut() });
    while let Some(subtree) = large.pop() {
        if inners[subtree.inner as usize].granules < task {
            tasks.push(subtree);
        } else {
            stack = stack.max(writer.node(subtree, &mut large));
        }
    }
    let write = |subtree| {
        let (mut pending, mut stack) = (vec![subtree], 0);
        while let Some(subtree) = pending.pop() {
            stack = stack.max(writer.node(subtree, &mut pending));
        }
        stack
    };
    let stack = match tasks.len() {
        0 | 1 => tasks.into_iter().map(write).fold(stack, usize::max),
        _ => tasks.into_par_iter().map(write).reduce(|| stack, usize::max),
    };
    Collapsed { arena, root: 0, stack, cost }
}

/// The inner nodes of a binary tree with what is best made of each, the root first; and the root.
fn plan<L: Leaves>(binary: &[Bvh2Node], boxes: &[Aabb]) -> (Vec<Inner>, Solved) {
    // What is left of a walk by levels are the roots of pieces.
    let mut roots = VecDeque::from([0_u32]);
    while roots.len() < binary.len() / (2 * PIECE_SIZE)
        && let Some(node) = roots.pop_front()
    {
        let first = binary[node as usize].first_index;
        roots.extend([first, first + 1].into_iter().filter(|&child| !binary[child as usize].is_leaf()));
    }
    let roots = if roots.len() < 2 { Vec::new() } else { Vec::from(roots) };
    let pieces: HashMap<u32, u32> = (0..).zip(&roots).map(|(piece, &root)| (root, piece)).collect();
    let above = list(binary, 0, |node| pieces.get(&node).copied());
    let lists: Vec<_> = roots.into_par_iter().map(|root| list(binary, root, |_| None)).collect();
    let mut inners: Vec<Inner> = zeroed_vec(above.len() + lists.iter().map(Vec::len).sum::<usize>());
    let (top, mut rest) = inners.split_at_mut(above.len());
    let (mut start, mut parts) = (above.len() as u32, Vec::new());
    for list in &lists {
        let (own, others) = rest.split_at_mut(list.len());
        parts.push((list, start, own));
        (start, rest) = (start + list.len() as u32, others);
    }
    let solved: Vec<Solved> =
        parts.into_par_iter().map(|(list, start, into)| solve::<L>(list, start, boxes, &[], into)).collect();
    let whole = solve::<L>(&above, 0, boxes, &solved, top);
    (inners, whole)
}

/// A wide node to write with all that is below it.
struct Subtree<'a> {
    inner: u32,
    /// Where it stands in the arena.
    place: u32,
    /// Subtrees that a walk has put off before it gets there.
    put_off: usize,
    into: &'a mut [Granule],
}

struct Writer<'a, L> {
    inners: &'a [Inner],
    boxes: &'a [Aabb],
    leaves: &'a L,
}

impl<L: Leaves> Writer<'_, L> {
    fn is_leaf(&self, reference: u32) -> bool {
        reference & ROW != 0 || self.inners[reference as usize].plan.is_leaf()
    }

    /// Lower and upper corner.
    fn bounds(&self, reference: u32) -> [[f32; 3]; 2] {
        if reference & ROW != 0 {
            let bounds = &self.boxes[(reference & !ROW) as usize];
            [bounds.min.to_array(), bounds.max.to_array()]
        } else {
            let inner = &self.inners[reference as usize];
            [inner.lower, inner.upper]
        }
    }

    /// Adds the subtrees that a subtree is opened into when it gets so many places.
    fn open(&self, reference: u32, places: usize, into: &mut Few) {
        if reference & ROW == 0 {
            let inner = &self.inners[reference as usize];
            let to_first = inner.plan.of(places);
            if to_first > 0 {
                self.open(inner.children[0], to_first, into);
                self.open(inner.children[1], places - to_first, into);
                return;
            }
        }
        into.push(reference);
    }

    /// Adds the primitives below.
    fn rows(&self, reference: u32, into: &mut Few) {
        if reference & ROW != 0 {
            into.push(reference & !ROW);
        } else {
            self.inners[reference as usize].children.iter().for_each(|&child| self.rows(child, into));
        }
    }

    /// Writes a node with its leaves beside it, adds its other children to those to write, and returns what a walk has
    /// put off when it leaves it.
    fn node<'a>(&self, subtree: Subtree<'a>, more: &mut Vec<Subtree<'a>>) -> usize {
        let Subtree { inner, place, put_off, into } = subtree;
        let Inner { children, plan, .. } = &self.inners[inner as usize];
        let mut opened = Few::new();
        self.open(children[0], plan.of_node(), &mut opened);
        self.open(children[1], LANES - plan.of_node(), &mut opened);
        let put_off = put_off + opened.len();
        let (node, mut rest) = into.split_at_mut(NODE);
        let mut planes = [[[f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]]; 3];
        for (lane, &child) in opened.iter().enumerate() {
            let bounds = self.bounds(child);
            for (axis, planes) in planes.iter_mut().enumerate() {
                (planes[0][lane], planes[1][lane]) = (bounds[0][axis], bounds[1][axis]);
            }
        }
        for (granule, plane) in node.iter_mut().zip(planes.as_flattened()) {
            *granule = Granule::of(*plane);
        }
        let references = &mut node[NODE - 1].0;
        let mut next = place + NODE as u32;
        let mut leaves = [const { Few::new() }; LANES];
        for (&child, rows) in opened.iter().zip(&mut leaves).filter(|(child, _)| self.is_leaf(**child)) {
            self.rows(child, rows);
            rows.iter().for_each(|&row| self.leaves.prefetch(row));
        }
        for (lane, rows) in leaves.iter_mut().enumerate().filter(|(_, rows)| !rows.is_empty()) {
            let granules = L::granules(rows.len());
            let (own, others) = rest.split_at_mut(granules);
            references[lane] = self.leaves.write(rows, next, own);
            (next, rest) = (next + granules as u32, others);
        }
        // The last to be added is the first to be written, so that the first stands right behind the leaves.
        for (lane, &child) in opened.iter().enumerate().filter(|(_, child)| !self.is_leaf(**child)).rev() {
            let granules = self.inners[child as usize].granules;
            let (own, others) = rest.split_at_mut(granules as usize);
            references[lane] = next;
            more.push(Subtree { inner: child, place: next, put_off: put_off - 1, into: own });
            (next, rest) = (next + granules, others);
        }
        put_off
    }
}

/// At most eight references or rows.
struct Few {
    all: [u32; LANES],
    count: usize,
}

impl Few {
    const fn new() -> Self {
        Self { all: [0; LANES], count: 0 }
    }

    fn push(&mut self, one: u32) {
        self.all[self.count] = one;
        self.count += 1;
    }
}

impl Deref for Few {
    type Target = [u32];

    fn deref(&self) -> &[u32] {
        &self.all[..self.count]
    }
}

impl DerefMut for Few {
    fn deref_mut(&mut self) -> &mut [u32] {
        &mut self.all[..self.count]
    }
}
