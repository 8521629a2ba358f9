//! How rays become a packet, if they run side by side.

use std::ops::Range;

use wide::{f32x8, u32x8};

use super::{Eight, Extremes, Packet, hits::Hits};
use crate::{
    accel::{
        Coverage, Rays,
        leaf::Sheared,
        triangle::{Axis, Side},
    },
    simd::LANES,
};

/// Which rays are in a packet. Those of one pixel run closer by one another than those of its neighbours, and share a vector
/// if they can.
#[derive(Clone, Copy, Debug)]
pub struct Members {
    /// Row of the first.
    start: usize,
    /// Rays of a pixel.
    samples: usize,
}

impl Members {
    /// Row of a lane's ray, which may be beyond the last.
    #[inline(always)]
    pub fn row(self, lane: usize) -> usize {
        self.start + lane % self.samples * LANES + lane / self.samples
    }

    /// Packets of so many vectors, of all rays in `rows`, which come in eights; if so many `samples` are told of, each eight
    /// is followed by others of the same pixels until there are as many of each.
    #[inline(always)]
    pub fn all<const V: usize>(rows: Range<usize>, samples: usize) -> impl Iterator<Item = Self> {
        let (mut start, mut packet) = (rows.start, 0);
        std::iter::from_fn(move || {
            if start >= rows.end {
                return None;
            }
            // As many of a pixel as there are, up to half a packet of four vectors: the eight pixels are shared out to four
            // packets, or to two, or are in one.
            let left = rows.end - start;
            let shared_out = |&packets: &usize| samples.is_multiple_of(packets * V) && left >= packets * V * LANES;
            let packets = [4, 2, 1].into_iter().find(shared_out);
            let samples = packets.map_or(1, |packets| packets * V);
            let packets = packets.unwrap_or(1);
            let members = Self { start: start + packet * (LANES / packets), samples };
            packet += 1;
            if packet == packets {
                (start, packet) = (start + packets * V * LANES, 0);
            }
            Some(members)
        })
    }
}

impl<const V: usize> Packet<V> {
    pub fn empty() -> Self {
        let zero = [f32x8::ZERO; 3];
        let sheared = Sheared { axes: Axis::ALL, shear: zero, from: zero };
        let hits = Hits::none(f32x8::ZERO);
        Self {
            eights: [Eight { origin: zero, direction: zero, against: zero, sheared, hits, ids: [0; LANES] }; V],
            extremes: [Extremes { ahead: 0.0, slow: 0.0, behind: 0.0, fast: 0.0 }; 3],
            first: [Side::Lower; 3],
            last: [Side::Upper; 3],
            reach: 0.0,
            limit: 0.0,
        }
    }

    /// Becomes that of some rays; false if they do not run side by side, and it is then of no use.
    #[inline(always)]
    pub fn gather<C: Coverage>(&mut self, rays: &impl Rays, members: Members) -> bool {
        let last = rays.count() - 1;
        let mut columns = [[[0.0; LANES]; V]; 7];
        for lane in 0..V * LANES {
            let (origin, direction, t_max) = rays.ray(members.row(lane).min(last));
            let [ox, oy, oz] = origin;
            let [dx, dy, dz] = direction;
            for (column, value) in columns.iter_mut().zip([ox, oy, oz, dx, dy, dz, t_max]) {
                column[lane / LANES][lane % LANES] = value;
            }
        }
        let vectors = |column: usize| columns[column].map(f32x8::new);
        for (eight, t_max) in self.eights.iter_mut().zip(vectors(6)) {
            eight.hits = Hits::none(t_max);
        }
        if !C::TRIVIAL {
            for lane in 0..V * LANES {
                self.eights[lane / LANES].ids[lane % LANES] = rays.id(members.row(lane).min(last));
            }
        }
        self.prepare(&[0, 1, 2].map(vectors), &[3, 4, 5].map(vectors))
    }

    /// Becomes that of rays with the ends it has.
    #[inline(always)]
    fn prepare(&mut self, origin: &[[f32x8; V]; 3], direction: &[[f32x8; V]; 3]) -> bool {
        // As in `Ray::new`; the axis has to be the same for all.
        let mut along = [0; 3];
        let [dx, dy, dz] = direction;
        for ((x, y), z) in dx.iter().zip(dy).zip(dz) {
            let [x, y, z] = [x, y, z].map(|of| of.abs());
            let is_x = (x.simd_gt(y) & x.simd_gt(z)).to_bitmask() & 255;
            let is_y = !is_x & (y.simd_ge(x) & y.simd_gt(z)).to_bitmask() & 255;
            along[0] += is_x.count_ones();
            along[1] += is_y.count_ones();
            along[2] += (is_x | is_y ^ 255).count_ones() - is_x.count_ones();
        }
        let Some(kz) = along.iter().position(|&rays| rays as usize == V * LANES) else { return false };
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if direction[kz][0].to_array()[0] < 0.0 {
            std::mem::swap(&mut kx, &mut ky);
        }
        let inverse = direction.map(|of| of.map(|d| f32x8::ONE / d));
        if !self.eights.iter().all(|Eight { hits, .. }| hits.t_max.simd_eq(hits.t_max).all()) {
            return false;
        }
        for axis in 0..3 {
            let (lower, upper) = extremes(&inverse[axis]);
            let (start, end) = extremes(&origin[axis]);
            // Directions of both signs, or zero and not, would make intervals that are not bounded; what is not a number
            // makes none. Infinite starts are left to the queue as well.
            let together = lower > 0.0 || upper < 0.0;
            let numbers = (0..V).all(|vector| {
                let finite = origin[axis][vector].abs().simd_lt(f32x8::splat(f32::INFINITY));
                (finite & inverse[axis][vector].simd_eq(inverse[axis][vector])).to_bitmask() & 255 == 255
            });
            if !together || !numbers || lower.is_finite() != upper.is_finite() {
                return false;
            }
            (self.first[axis], self.last[axis]) = (Side::Lower, Side::Upper);
            self.extremes[axis] = if lower > 0.0 {
                Extremes { ahead: end, slow: -lower, behind: start, fast: -upper }
            } else {
                (self.first[axis], self.last[axis]) = (Side::Upper, Side::Lower);
                Extremes { ahead: start, slow: -upper, behind: end, fast: -lower }
            };
        }
        let axes = [kx, ky, kz].map(|axis| Axis::ALL[axis]);
        for (vector, eight) in self.eights.iter_mut().enumerate() {
            let along = inverse[kz][vector];
            let [x, y] = [kx, ky].map(|axis| direction[axis][vector] * along);
            eight.origin = [0, 1, 2].map(|axis| origin[axis][vector]);
            eight.direction = [0, 1, 2].map(|axis| direction[axis][vector]);
            eight.against = [0, 1, 2].map(|axis| -inverse[axis][vector]);
            let from = [kx, ky, kz].map(|axis| origin[axis][vector]);
            eight.sheared = Sheared { axes, shear: [x, y, along], from };
        }
        self.shorten();
        true
    }

    /// [`Way::lead`](crate::accel::way::Way::lead), of all rays, with the same roundings; false if there they do not run side
    /// by side.
    pub fn to_local(&self, m: &[f32; 12], local: &mut Self) -> bool {
        let m = m.map(f32x8::splat);
        let linear = |row: usize, [x, y, z]: [f32x8; 3]| m[4 * row] * x + m[4 * row + 1] * y + m[4 * row + 2] * z;
        let each = |f: &dyn Fn(&Eight, usize) -> f32x8| {
            std::array::from_fn(|row| std::array::from_fn(|vector| f(&self.eights[vector], row)))
        };
        for (to, from) in local.eights.iter_mut().zip(&self.eights) {
            (to.hits, to.ids) = (from.hits, from.ids);
        }
        let origin = each(&|eight, row| linear(row, eight.origin) + m[4 * row + 3]);
        local.prepare(&origin, &each(&|eight, row| linear(row, eight.direction)))
    }
}

/// The least and the greatest of all lanes, if all are numbers.
#[inline(always)]
fn extremes<const V: usize>(of: &[f32x8; V]) -> (f32, f32) {
    let least = of[1..].iter().fold(of[0], |least, &one| least.fast_min(one));
    (across(least, |a, b| a.fast_min(b)), greatest(*of))
}

/// The greatest of all lanes.
#[inline(always)]
pub fn greatest<const V: usize>(of: [f32x8; V]) -> f32 {
    across(of[1..].iter().fold(of[0], |most, &one| most.fast_max(one)), |a, b| a.fast_max(b))
}

/// Puts eight numbers together by pairs.
#[inline(always)]
fn across(of: f32x8, pair: impl Fn(f32x8, f32x8) -> f32x8) -> f32 {
    let partners = [[4, 5, 6, 7, 0, 1, 2, 3], [2, 3, 0, 1, 6, 7, 4, 5], [1, 0, 3, 2, 5, 4, 7, 6]];
    let swapped = |of: f32x8, partner| bytemuck::cast(bytemuck::cast::<_, u32x8>(of).shuffle_wrapping(partner));
    partners.into_iter().fold(of, |of, partner| pair(of, swapped(of, u32x8::new(partner)))).to_array()[0]
}
