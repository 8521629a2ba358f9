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

use bytemuck::zeroed_vec;
use obvhs::{aabb::Aabb, bvh2::node::Bvh2Node};
use rayon::prelude::*;

use super::{
    arena::{Arena, Granule},
    bvh8::NODE,
    leaf::{Leaf, QUAD, TriangleQuad},
    plan::{Inner, ROW, Solved},
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

/// While a piece is listed: marks a reference as the root of another piece.
const PIECE: u32 = 1 << 30;

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
    let (root, cost) = (root.reference, root.cost());
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
