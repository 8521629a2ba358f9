//! The tree over instances, built whenever one of them moves.
//!
//! Boxes are put in the order of a Morton curve, and then in each round those pairs are joined of which either is the
//! other's best partner among the [`RADIUS`] next to it on both sides: the union of least area (Meister, Bittner 2018,
//! "Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy Construction"). Thousands of boxes take less than a
//! millisecond, so that there is no time to wake threads in each round: the order is cut into pieces, which are joined
//! until a few clusters are left of each, side by side, and then what is left of all is joined (Benthin et al. 2024,
//! "H-PLOC: Hierarchical Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy Construction"). A piece stays in
//! the nearest cache; its coordinates are in columns, of which eight are looked at at a time. What is best made of a node is
//! found as it is joined.

use std::cell::Cell;

use bytemuck::zeroed_vec;
use glam::Vec3A;
use obvhs::aabb::Aabb;
use rayon::prelude::*;
use wide::{f32x8, i32x8};

use super::{
    collapse::Leaves,
    plan::{Inner, Solved},
};
use crate::simd::LANES;

/// How far along the curve a partner is looked for, to either side.
const RADIUS: usize = 3;

/// Boxes of a piece at most. Fixed, so that trees do not depend on the number of threads.
const PIECE: usize = 1024;

/// Of a piece, clusters are left to be joined with those of others when they are no more than this.
const LEFT: usize = 32;

/// Joins the boxes of `rows`, of which there are at least two, to one tree: its inner nodes, and the root.
pub(super) fn cluster<L: Leaves>(boxes: &[Aabb], rows: &[u32]) -> (Vec<Inner>, Solved) {
    let order = order(boxes, rows);
    let pieces = order.len().div_ceil(PIECE);
    if pieces == 1 {
        let mut inners = zeroed_vec(order.len());
        let below = order.iter().map(|&row| Solved::primitive::<L>(row, &boxes[row as usize]));
        let root = join::<L>(below, 1, 0, &mut inners).pop().expect("one cluster");
        return (inners, root);
    }
    let size = order.len().div_ceil(pieces);
    let mut inners: Vec<Inner> = zeroed_vec(order.len() + pieces * LEFT);
    let (own, top) = inners.split_at_mut(order.len());
    let parts = own.par_chunks_mut(size).zip(order.par_chunks(size)).enumerate();
    let left: Vec<Vec<Solved>> = parts
        .map(|(piece, (inners, rows))| {
            let below = rows.iter().map(|&row| Solved::primitive::<L>(row, &boxes[row as usize]));
            join::<L>(below, LEFT, (piece * size) as u32, inners)
        })
        .collect();
    let root = join::<L>(left.into_iter().flatten(), 1, order.len() as u32, top).pop().expect("one cluster");
    (inners, root)
}

/// Joins clusters until no more than `most` are left, and returns those. The nodes made stand from `start` on.
fn join<L: Leaves>(below: impl Iterator<Item = Solved>, most: usize, start: u32, inners: &mut [Inner]) -> Vec<Solved> {
    let (mut known, mut clusters) = SCRATCH.take();
    known.clear();
    known.extend(below);
    clusters.set(known.iter().map(|one| &one.bounds));
    while clusters.count > most {
        clusters.round();
    }
    for ((place, &[first, second]), into) in (start..).zip(&clusters.pairs[..clusters.joined]).zip(inners) {
        let (solved, inner) = Solved::over::<L>(&known[first as usize], &known[second as usize], place);
        *into = inner;
        known.push(solved);
    }
    let left = clusters.names[..clusters.count].iter().map(|&name| known[name as usize]).collect();
    if known.len() <= 2 * PIECE {
        SCRATCH.set((known, clusters));
    }
    left
}

thread_local! {
    /// Kept, because the system would take it back after each piece and clear it for the next.
    static SCRATCH: Cell<(Vec<Solved>, Clusters)> = Cell::default();
}

/// Boxes behind the last cluster: the rest of a block, and the partners of its last one.
const BEHIND: usize = LANES + RADIUS.next_multiple_of(LANES);

/// Clusters in the order of the curve.
#[derive(Default)]
struct Clusters {
    count: usize,
    /// Their boxes, the lower corner with its sign turned, so that the greater coordinates are those of the union; behind
    /// them some of infinite area.
    boxes: Vec<f32x8>,
    /// Their places among those that were given, followed by those that were made.
    names: Vec<u32>,
    /// How far it is to the best partner.
    partner: Vec<i32>,
    /// What was joined, in this order, and how much of it.
    pairs: Vec<[u32; 2]>,
    joined: usize,
    given: u32,
    /// So few found each other that neighbours are to be joined as they stand.
    stuck: bool,
    /// The boxes by columns.
    planes: [Vec<f32>; 6],
    /// Area of each with the next, with the one after that, …; infinite before the first.
    areas: [Vec<f32>; RADIUS],
}

/// Of infinite area.
const EVERYWHERE: f32x8 = f32x8::new([f32::INFINITY; LANES]);

impl Clusters {
    /// Begins anew with these.
    fn set<'a>(&mut self, all: impl ExactSizeIterator<Item = &'a Aabb>) {
        let count = all.len();
        let size = count.next_multiple_of(LANES) + BEHIND;
        self.boxes.clear();
        self.boxes
            .extend(all.map(|Aabb { min, max }| f32x8::new([-min.x, -min.y, -min.z, 0.0, max.x, max.y, max.z, 0.0])));
        self.boxes.resize(size, EVERYWHERE);
        self.names.clear();
        self.names.extend(0..count as u32);
        self.partner.resize(size, 0);
        self.pairs.resize(count, [0; 2]);
        self.planes.iter_mut().for_each(|plane| plane.resize(size, 0.0));
        self.areas.iter_mut().for_each(|areas| areas.resize(LANES + size, f32::INFINITY));
        (self.count, self.given, self.joined, self.stuck) = (count, count as u32, 0, false);
    }

    /// Joins pairs.
    fn round(&mut self) {
        if self.stuck {
            let neighbour = |at: usize| if at & 1 == 0 { 1 } else { -1 };
            self.partner.iter_mut().enumerate().for_each(|(at, partner)| *partner = neighbour(at));
        } else {
            self.turn();
            self.find();
        }
        // Nobody's.
        self.partner[self.count..][..RADIUS].fill(0);
        let before = self.count;
        self.join();
        // Where each is nearer to the one before than to the one behind, a single pair is joined in a round: n rounds.
        self.stuck = (before - self.count) * 8 < before;
    }

    /// Writes the boxes by columns.
    fn turn(&mut self) {
        let [lx, ly, lz, ux, uy, uz] = &mut self.planes;
        for start in (0..self.count + RADIUS).step_by(LANES) {
            let block: [f32x8; LANES] = *self.boxes[start..].first_chunk().expect("there are some behind");
            let [x, y, z, _, to_x, to_y, to_z, _] = f32x8::transpose(block);
            for (plane, from) in
                [(&mut *lx, x), (&mut *ly, y), (&mut *lz, z), (&mut *ux, to_x), (&mut *uy, to_y), (&mut *uz, to_z)]
            {
                plane[start..][..LANES].copy_from_slice(&from.to_array());
            }
        }
    }

    /// Finds everyone's best partner.
    fn find(&mut self) {
        // At equal area neighbours of even and odd number choose each other, so that all find someone.
        const NEIGHBOUR: i32x8 = i32x8::new([1, -1, 1, -1, 1, -1, 1, -1]);
        let even: f32x8 = bytemuck::cast(NEIGHBOUR.simd_gt(i32x8::ZERO));
        for start in (0..self.count).step_by(LANES) {
            let near: [&[f32; LANES + RADIUS]; 6] =
                self.planes.each_ref().map(|plane| plane[start..].first_chunk().expect("there are some behind"));
            let at = |plane: usize, offset: usize| f32x8::new(*near[plane][offset..].first_chunk().expect("a block"));
            for (offset, areas) in (1..).zip(&mut self.areas) {
                let widest = |plane: usize| at(plane, 0).fast_max(at(plane, offset));
                let [x, y, z] = [0, 1, 2].map(|axis| widest(axis) + widest(axis + 3));
                let area = (x + y) * z + x * y;
                areas[LANES + start..][..LANES].copy_from_slice(&area.to_array());
            }
            let area = |of: usize, before: usize| {
                f32x8::new(*self.areas[of - 1][LANES + start - before..].first_chunk().expect("a block"))
            };
            let (next, last) = (area(1, 0), area(1, 1));
            let (mut best, mut partner) = (even.bitselect(next, last), NEIGHBOUR);
            let mut consider = |area: f32x8, offset: i32x8| {
                let better = area.simd_lt(best);
                best = better.bitselect(area, best);
                partner = bytemuck::cast::<_, i32x8>(better).bitselect(offset, partner);
            };
            consider(even.bitselect(last, next), -NEIGHBOUR);
            for offset in 2..=RADIUS {
                consider(area(offset, 0), i32x8::splat(offset as i32));
                consider(area(offset, offset), i32x8::splat(-(offset as i32)));
            }
            self.partner[start..][..LANES].copy_from_slice(&partner.to_array());
        }
    }

    /// Joins those that chose each other, and closes the ranks. No branch depends on who did.
    fn join(&mut self) {
        let Self { boxes, names, partner, pairs, .. } = self;
        let (boxes, names, pairs) = (&mut boxes[..], &mut names[..], &mut pairs[..]);
        let (mut at, mut joined) = (0, self.joined);
        for place in 0..self.count {
            let offset = partner[place];
            let mutual = partner[place.wrapping_add_signed(offset as isize)] == -offset;
            let (first, second) = (mutual & (offset > 0), mutual & (offset < 0));
            let other = place + if first { offset as usize } else { 0 };
            let name = names[place];
            boxes[at] = boxes[place].fast_max(boxes[other]);
            pairs[joined] = [name, names[other]];
            names[at] = if first { self.given + joined as u32 } else { name };
            joined += usize::from(first);
            at += usize::from(!second);
        }
        boxes[at..][..BEHIND].fill(EVERYWHERE);
        (self.count, self.joined) = (at, joined);
    }
}

/// Bits of a coordinate on the curve.
const BITS: u32 = 21;

/// Rows in the order of a Morton curve through the middles of their boxes.
fn order(boxes: &[Aabb], rows: &[u32]) -> Vec<u32> {
    let middle = |&row: &u32| {
        let one = &boxes[row as usize];
        0.5 * one.min + 0.5 * one.max
    };
    let (lower, upper) = rows
        .iter()
        .map(middle)
        .filter(|middle| middle.is_finite())
        .fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(lower, upper), middle| (lower.min(middle), upper.max(middle)));
    let most = ((1_u32 << BITS) - 1) as f32;
    // Cells are cubes: along the short side of a flat scene nothing is to be told apart.
    let scale = most / (upper - lower).max_element().clamp(f32::MIN_POSITIVE * most, f32::MAX);
    let key = |row: &u32| {
        let [x, y, z] = ((middle(row) - lower) * scale).clamp(Vec3A::ZERO, Vec3A::splat(most)).to_array();
        spread(x as u64) << 2 | spread(y as u64) << 1 | spread(z as u64)
    };
    let keys: Vec<u64> = match rows.len() {
        ..=PIECE => rows.iter().map(key).collect(),
        _ => rows.par_iter().with_min_len(PIECE).map(key).collect(),
    };
    let mut items: Vec<u64> =
        keys.iter().enumerate().map(|(at, key)| key >> (3 * BITS - 32) << 32 | at as u64).collect();
    sort(&mut items);
    // Those that the upper half does not tell apart.
    for run in items.chunk_by_mut(|a, b| a >> 32 == b >> 32).filter(|run| run.len() > 1) {
        run.sort_unstable_by_key(|&item| (keys[item as u32 as usize], item));
    }
    items.into_iter().map(|item| rows[item as u32 as usize]).collect()
}

/// Puts two bits of zeros before each.
fn spread(x: u64) -> u64 {
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// Sorts by the upper halves.
fn sort(items: &mut Vec<u64>) {
    const DIGITS: [u32; 3] = [32, 43, 54];
    const VALUES: usize = 1 << 11;
    if items.len() < VALUES / 4 {
        items.sort_unstable();
        return;
    }
    let digit = |item: u64, from: u32| (item >> from) as usize & (VALUES - 1);
    let mut counts = vec![[0_u32; VALUES]; DIGITS.len()];
    for &item in &*items {
        for (counts, from) in counts.iter_mut().zip(DIGITS) {
            counts[digit(item, from)] += 1;
        }
    }
    let mut sorted = vec![0; items.len()];
    for (places, from) in counts.iter_mut().zip(DIGITS) {
        let mut next = 0;
        for place in places.iter_mut() {
            (*place, next) = (next, next + *place);
        }
        for &item in &*items {
            let place = &mut places[digit(item, from)];
            sorted[*place as usize] = item;
            *place += 1;
        }
        std::mem::swap(items, &mut sorted);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{binary::union, bvh8::bounds_of, tests::numbers};

    /// However many: by the upper halves, and otherwise as they were.
    #[test]
    fn items_are_sorted_by_their_upper_halves() {
        let mut random = numbers(3);
        for (count, values) in [(0, 1.0), (1, 1.0), (500, 50.0), (511, 1e9), (512, 4e9), (5000, 3.0), (30_000, 4e9)] {
            let mut items: Vec<u64> =
                (0..count).map(|at| (f64::from(random()) * values) as u64 >> 1 << 33 | at).collect();
            let mut expected = items.clone();
            expected.sort_by_key(|item| item >> 32);
            sort(&mut items);
            assert!(items == expected, "{count}");
        }
    }

    /// Points on a line stay in their order, also where all but one are within a thousandth of the whole; and each row is
    /// there once.
    #[test]
    fn what_is_near_on_a_line_is_near_on_the_curve() {
        for (step, far) in [(1.0, 0.0), (1e-3, 1e3), (0.0, 1e3), (1e35, 0.0), (1.0, f32::INFINITY)] {
            // Every seventh of them in turn.
            let place = |row: u32| row * 7 % 1000;
            let mut boxes: Vec<Aabb> = (0..1000).map(|row| bounds_of([[step * place(row) as f32, 0.0, 0.0]])).collect();
            boxes.push(bounds_of([[far; 3]]));
            let rows: Vec<u32> = (0..boxes.len() as u32).filter(|&row| far > 0.0 || row < 1000).collect();
            let mut ordered = order(&boxes, &rows);
            let along: Vec<f32> = ordered.iter().map(|&row| boxes[row as usize].min.x).collect();
            // Of an infinite place no more is known than that it is one.
            assert!(along.iter().filter(|x| x.is_finite()).is_sorted(), "{step} {far}");
            ordered.sort_unstable();
            assert!(ordered == rows);
        }
    }

    /// Where all prefer the one before, by however little, there are as many rounds as where they do not: half of those
    /// left, or an eighth and then half.
    #[test]
    fn rounds_are_few_whatever_the_order_of_sizes() {
        let growing = |i: f32| 1.0 + 1e-4 * i;
        let sizes: [&dyn Fn(f32) -> f32; 4] = [&|_| 1.0, &growing, &|i| 1.0 / growing(i), &|i| (i * 0.7).sin() + 2.0];
        for (kind, size) in sizes.iter().enumerate() {
            let boxes: Vec<Aabb> = (0..1000).map(|i| size(i as f32)).map(|r| bounds_of([[-r; 3], [r; 3]])).collect();
            let mut clusters = Clusters::default();
            clusters.set(boxes.iter());
            let mut rounds = 0;
            while clusters.count > 1 {
                clusters.round();
                rounds += 1;
            }
            assert!(rounds <= 30, "{kind}: {rounds}");
            let whole = clusters.boxes[0].to_array();
            let all = union(boxes.into_iter());
            assert_eq!([-whole[0], whole[6]], [all.min.x, all.max.z]);
            assert_eq!(clusters.joined, 999);
            // All are in it, and nothing that is not: each cluster is joined once.
            let mut joined: Vec<u32> = clusters.pairs[..999].iter().flatten().copied().collect();
            joined.sort_unstable();
            assert!(joined.into_iter().eq(0..1998));
        }
    }
}
