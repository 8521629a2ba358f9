//! The triangles of a leaf, tested eight at a time.

use wide::{f32x8, i32x8, u32x8};

use super::{
    arena::Granule,
    opacity::{ASKED, FRONT_ONLY, Opacity, ROW},
    triangle::{Axis, Ray, TriangleHit},
};
use crate::simd::LANES;

/// Eight triangles, by coordinate of corner: corner 0's x of all eight, its y, …, and their rows.
///
/// Lanes beyond the last hold triangles without area.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct TriangleBlock([Granule; BLOCK]);

/// Granules of a block.
const BLOCK: usize = 10;

/// Distances, barycentrics and sides of eight triangles, and a bit for each that is hit.
#[derive(Clone, Copy, Debug)]
pub struct BlockHit {
    /// As in [`TriangleHit`].
    pub t: [f32; LANES],
    /// As in [`TriangleHit`].
    pub b1: [f32; LANES],
    /// As in [`TriangleHit`].
    pub b2: [f32; LANES],
    /// Bits of the lanes whose back is met.
    pub back: u32,
    /// Bits of the lanes that are hit.
    pub hits: u32,
}

impl BlockHit {
    /// That of a lane.
    #[inline(always)]
    pub fn hit(&self, lane: usize) -> TriangleHit {
        TriangleHit { t: self.t[lane], b1: self.b1[lane], b2: self.b2[lane], back: self.back >> lane & 1 == 1 }
    }
}

/// Four triangles, as in a [`TriangleBlock`].
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct TriangleQuad([Granule; BLOCK / 2]);

/// What a leaf of the eight-wide tree holds.
pub trait Leaf: Sized {
    /// Triangles at most.
    const MOST: usize;

    /// Of at most so many triangles with their rows, which are below 2³⁰; the bits above say what is known of their opacity.
    fn new(triangles: impl IntoIterator<Item = (u32, [[f32; 3]; 3])>) -> Self;

    /// The one that stands at a place.
    fn at(arena: &[Granule], place: u32) -> &Self;

    /// Row of a lane's triangle; of a lane without any, [`NO_ROW`].
    fn row(&self, lane: usize) -> u32 {
        self.marked_row(lane) & ROW
    }

    /// Triangles in it.
    fn count(&self) -> usize {
        (0..Self::MOST).take_while(|&lane| self.row(lane) != NO_ROW).count()
    }

    /// The row, with what is known of the triangle's opacity.
    fn marked_row(&self, lane: usize) -> u32;

    /// What is known of a lane's triangle.
    #[inline(always)]
    fn opacity(&self, lane: usize) -> Opacity {
        Opacity::of(self.marked_row(lane))
    }

    /// A coordinate of a corner of a lane's triangle.
    fn coordinate(&self, corner: usize, axis: usize, lane: usize) -> f32;

    /// Corners of a lane's triangle.
    fn corners(&self, lane: usize) -> [[f32; 3]; 3] {
        [0, 1, 2].map(|corner| [0, 1, 2].map(|axis| self.coordinate(corner, axis, lane)))
    }

    /// [`intersect`](super::intersect) for all, with the same roundings: its SIMD twin.
    fn intersect(&self, ray: &Ray, t_max: f32) -> BlockHit;

    /// The nearest of those hits, if there is any, and its lane; of equally near ones that of the lowest.
    fn nearest(&self, ray: &Ray, t_max: f32) -> Option<(usize, TriangleHit)>;

    /// [`Leaf::nearest`], of hits that are not of a missing back.
    fn nearest_there(&self, ray: &Ray, t_max: f32) -> Option<(usize, TriangleHit)>;

    /// True if there is any hit.
    fn any(&self, ray: &Ray, t_max: f32) -> bool;

    /// True if there is any hit of what stops the ray for sure; and if there is any of what has to be asked.
    fn any_there(&self, ray: &Ray, t_max: f32) -> (bool, bool);
}

/// The row of a lane that holds no triangle.
pub const NO_ROW: u32 = ROW;

/// What the test says of eight pairs of ray and triangle: distances and barycentrics, and which are hit.
pub(super) struct Met {
    pub t: f32x8,
    pub b1: f32x8,
    pub b2: f32x8,
    pub back: f32x8,
    pub hits: f32x8,
}

/// Eight rays, or one eight times over, as the test needs them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sheared {
    pub axes: [Axis; 3],
    /// For the axis that the rays mostly run along and the two others.
    pub shear: [f32x8; 3],
    /// Where they start, by the same axes.
    pub from: [f32x8; 3],
}

/// The first half of the test: which lanes are inside all edges, and what the rest needs.
pub(super) struct Edges {
    u: f32x8,
    v: f32x8,
    w: f32x8,
    /// Of the corners, along the rays.
    depth: [f32x8; 3],
    det: f32x8,
    pub inside: f32x8,
}

impl Sheared {
    /// That of a ray, for eight triangles.
    #[inline(always)]
    fn of(ray: &Ray) -> Self {
        Self { axes: ray.axes, shear: ray.shear.map(f32x8::splat), from: ray.from.map(f32x8::splat) }
    }

    /// Tests eight pairs of ray and triangle, given the coordinates of the triangles' corners.
    #[inline(always)]
    pub fn edges(&self, at: impl Fn(usize, Axis) -> f32x8) -> Edges {
        let [kx, ky, kz] = self.axes;
        let [sx, sy, _] = self.shear;
        let [ox, oy, oz] = self.from;
        let sheared = |corner: usize| {
            let (x, y, z) = (at(corner, kx) - ox, at(corner, ky) - oy, at(corner, kz) - oz);
            // Where it is cheap, rounded once; that of a corner is the same in all triangles that share it.
            (sx.mul_neg_add(z, x), sy.mul_neg_add(z, y), z)
        };
        let (ax, ay, az) = sheared(0);
        let (bx, by, bz) = sheared(1);
        let (cx, cy, cz) = sheared(2);
        let u = cx * by - cy * bx;
        let v = ax * cy - ay * cx;
        let w = bx * ay - by * ax;
        let zero = f32x8::ZERO;
        let least = u.fast_min(v).fast_min(w);
        let most = u.fast_max(v).fast_max(w);
        let inside = least.simd_ge(zero) | most.simd_le(zero);
        let det = u + v + w;
        Edges { u, v, w, depth: [az, bz, cz], det, inside: inside & det.simd_ne(zero) }
    }

    /// The second half of the test.
    #[inline(always)]
    pub fn meet(&self, edges: Edges, t_max: f32x8) -> Met {
        let Edges { u, v, w, depth: [az, bz, cz], det, inside } = edges;
        let inv_det = f32x8::ONE / det;
        let t = w.mul_add(cz, v.mul_add(bz, u * az)) * self.shear[2] * inv_det;
        let hits = inside & t.simd_gt(f32x8::ZERO) & t.simd_le(t_max);
        Met { t, b1: v * inv_det, b2: w * inv_det, back: det.simd_lt(f32x8::ZERO), hits }
    }
}

impl Met {
    /// Which lanes are not a missing back, given the rows of their triangles.
    #[inline(always)]
    fn there(&self, rows: u32x8) -> f32x8 {
        const { assert!(FRONT_ONLY << 1 == ASKED, "the sign, once moved up") };
        let front_only: i32x8 = bytemuck::cast::<_, i32x8>(rows << 1) >> 31;
        !(self.back & bytemuck::cast::<_, f32x8>(front_only))
    }

    #[inline(always)]
    fn all(self) -> BlockHit {
        BlockHit {
            t: self.t.to_array(),
            b1: self.b1.to_array(),
            b2: self.b2.to_array(),
            back: self.back.to_bitmask() & 255,
            hits: self.hits.to_bitmask() & 255,
        }
    }

    /// The nearest, of equally near ones that of the lowest lane.
    #[inline(always)]
    fn nearest(self) -> Option<(usize, TriangleHit)> {
        if self.hits.to_bitmask() & 255 == 0 {
            return None;
        }
        let t = self.hits.bitselect(self.t, f32x8::splat(f32::INFINITY));
        // Positive numbers are in the order of their bits.
        let t: u32x8 = bytemuck::cast(t);
        let least = least(t);
        let lane = t.simd_eq(least).to_bitmask().trailing_zeros() as usize % LANES;
        let hit = TriangleHit {
            t: f32::from_bits(least.to_array()[0]),
            b1: self.b1.to_array()[lane],
            b2: self.b2.to_array()[lane],
            back: self.back.to_bitmask() >> lane & 1 == 1,
        };
        Some((lane, hit))
    }
}

/// The least of eight, eight times over.
#[inline(always)]
pub(super) fn least(of: u32x8) -> u32x8 {
    let of = of.min(of.shuffle_wrapping(u32x8::new([1, 0, 3, 2, 5, 4, 7, 6])));
    let of = of.min(of.shuffle_wrapping(u32x8::new([2, 3, 0, 1, 6, 7, 4, 5])));
    of.min(of.shuffle_wrapping(u32x8::new([4, 5, 6, 7, 0, 1, 2, 3])))
}

macro_rules! leaf {
    ($name:ident, $lanes:expr) => {
        impl Leaf for $name {
            const MOST: usize = $lanes;

            fn new(triangles: impl IntoIterator<Item = (u32, [[f32; 3]; 3])>) -> Self {
                let mut this: Self = bytemuck::Zeroable::zeroed();
                let words: &mut [u32] = bytemuck::cast_slice_mut(&mut this.0);
                words[9 * $lanes..].fill(u32::MAX);
                for (lane, (row, corners)) in triangles.into_iter().enumerate() {
                    words[9 * $lanes + lane] = row;
                    for (i, coordinate) in corners.into_iter().flatten().enumerate() {
                        words[i * $lanes + lane] = coordinate.to_bits();
                    }
                }
                this
            }

            #[inline(always)]
            fn at(arena: &[Granule], place: u32) -> &Self {
                let granules: &[Granule; size_of::<Self>() / size_of::<Granule>()] =
                    arena[place as usize..].first_chunk().expect("a place in this arena");
                bytemuck::cast_ref(granules)
            }

            #[inline(always)]
            fn marked_row(&self, lane: usize) -> u32 {
                bytemuck::cast_slice::<_, u32>(&self.0)[9 * $lanes + lane % $lanes]
            }

            #[inline(always)]
            fn coordinate(&self, corner: usize, axis: usize, lane: usize) -> f32 {
                let (corners, _) = bytemuck::cast_slice::<_, f32>(&self.0).as_chunks::<{ 3 * $lanes }>();
                corners[corner][axis * $lanes + lane % $lanes]
            }

            #[inline(always)]
            fn intersect(&self, ray: &Ray, t_max: f32) -> BlockHit {
                self.met(ray, t_max).all()
            }

            #[inline(always)]
            fn nearest(&self, ray: &Ray, t_max: f32) -> Option<(usize, TriangleHit)> {
                self.met(ray, t_max).nearest()
            }

            #[inline(always)]
            fn nearest_there(&self, ray: &Ray, t_max: f32) -> Option<(usize, TriangleHit)> {
                let mut met = self.met(ray, t_max);
                met.hits &= met.there(self.rows());
                met.nearest()
            }

            #[inline(always)]
            fn any(&self, ray: &Ray, t_max: f32) -> bool {
                self.met(ray, t_max).hits.to_bitmask() & 255 != 0
            }

            #[inline(always)]
            fn any_there(&self, ray: &Ray, t_max: f32) -> (bool, bool) {
                let (met, rows) = (self.met(ray, t_max), self.rows());
                // Of whole lanes the mask takes the sign, which is the bit that says so.
                let asked = bytemuck::cast::<_, f32x8>(rows).to_bitmask() & 255;
                let hits = (met.hits & met.there(rows)).to_bitmask() & 255;
                (hits & !asked != 0, hits & asked != 0)
            }
        }

        impl $name {
            /// All rows, with what is known of opacity; lanes beyond the last are never hit.
            #[inline(always)]
            fn rows(&self) -> u32x8 {
                let mut rows = [0; LANES];
                rows[..$lanes].copy_from_slice(&bytemuck::cast_slice::<_, u32>(&self.0)[9 * $lanes..]);
                u32x8::new(rows)
            }

            #[inline(always)]
            fn met(&self, ray: &Ray, t_max: f32) -> Met {
                let (corners, _) = bytemuck::cast_slice::<_, f32>(&self.0).as_chunks::<{ 3 * $lanes }>();
                let ray = Sheared::of(ray);
                let edges = ray.edges(|corner, axis| {
                    let own: [f32; $lanes] = *corners[corner][axis as usize * ($lanes / TriangleQuad::MOST)..]
                        .first_chunk()
                        .expect("an axis");
                    let mut all = [0.0; LANES];
                    all[..$lanes].copy_from_slice(&own);
                    f32x8::new(all)
                });
                ray.meet(edges, f32x8::splat(t_max))
            }
        }
    };
}

leaf!(TriangleBlock, 8);
leaf!(TriangleQuad, 4);

/// Marks the reference of a leaf that is a [`TriangleQuad`].
pub(super) const QUAD: u32 = 1 << 29;

/// A leaf of either kind.
#[derive(Clone, Copy, Debug)]
pub(super) enum Block<'a> {
    Eight(&'a TriangleBlock),
    Four(&'a TriangleQuad),
}

impl<'a> Block<'a> {
    /// The leaf that a reference means.
    #[inline(always)]
    pub fn at(arena: &'a [Granule], reference: u32) -> Self {
        if reference & QUAD == 0 {
            Self::Eight(TriangleBlock::at(arena, reference))
        } else {
            Self::Four(TriangleQuad::at(arena, reference & !QUAD))
        }
    }

    /// Says of the triangles of the leaf that a reference means what is known of their opacity, by their rows.
    pub fn mark(arena: &mut [Granule], reference: u32, mut of: impl FnMut(u32) -> Opacity) {
        let lanes = if reference & QUAD == 0 { TriangleBlock::MOST } else { TriangleQuad::MOST };
        let block: &mut [u32] = bytemuck::cast_slice_mut(&mut arena[(reference & !QUAD) as usize..]);
        for row in block[9 * lanes..10 * lanes].iter_mut().filter(|row| **row & ROW != NO_ROW) {
            *row = *row & ROW | of(*row & ROW).bits();
        }
    }

    /// Rows of the triangles in it, with what is known of their opacity.
    pub fn marked_rows(self) -> impl Iterator<Item = u32> {
        let most = match self {
            Self::Eight(_) => TriangleBlock::MOST,
            Self::Four(_) => TriangleQuad::MOST,
        };
        let row = move |lane| match self {
            Self::Eight(block) => block.marked_row(lane),
            Self::Four(block) => block.marked_row(lane),
        };
        (0..most).map(row).take_while(|&row| row & ROW != NO_ROW)
    }

    /// The triangles in it, with their rows and what is known of their opacity.
    pub fn triangles(&self) -> Vec<(u32, [[f32; 3]; 3])> {
        fn of<L: Leaf>(block: &L) -> Vec<(u32, [[f32; 3]; 3])> {
            let all = (0..L::MOST).map(|lane| (block.marked_row(lane), block.corners(lane)));
            all.filter(|&(row, _)| row & ROW != NO_ROW).collect()
        }
        match self {
            Self::Eight(block) => of(*block),
            Self::Four(block) => of(*block),
        }
    }

    #[inline(always)]
    pub fn row(&self, lane: usize) -> u32 {
        match self {
            Self::Eight(block) => block.row(lane),
            Self::Four(block) => block.row(lane),
        }
    }

    #[inline(always)]
    pub fn opacity(&self, lane: usize) -> Opacity {
        match self {
            Self::Eight(block) => block.opacity(lane),
            Self::Four(block) => block.opacity(lane),
        }
    }

    #[inline(always)]
    pub fn intersect(&self, ray: &Ray, t_max: f32) -> BlockHit {
        match self {
            Self::Eight(block) => block.intersect(ray, t_max),
            Self::Four(block) => block.intersect(ray, t_max),
        }
    }

    /// Granules of a leaf of so many triangles, at most eight.
    pub fn granules(triangles: usize) -> usize {
        if triangles > TriangleQuad::MOST { BLOCK } else { BLOCK / 2 }
    }

    /// Writes a leaf of at most eight triangles that stands at a place, and returns its reference.
    pub fn write(
        triangles: impl ExactSizeIterator<Item = (u32, [[f32; 3]; 3])>,
        place: u32,
        into: &mut [Granule],
    ) -> u32 {
        if triangles.len() > TriangleQuad::MOST {
            into.copy_from_slice(&TriangleBlock::new(triangles).0);
            place
        } else {
            into.copy_from_slice(&TriangleQuad::new(triangles).0);
            place | QUAD
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{super::triangle::intersect, *};

    /// Random and touching triangles: the block says bit for bit what the scalar says of each.
    #[test]
    fn a_block_agrees_with_the_scalar_bit_for_bit() {
        let number = |i: u32| {
            ((i.wrapping_mul(2_654_435_761) ^ i >> 3).wrapping_mul(0x9e37_79b9) >> 8) as f32 / 8_388_608.0 - 1.0
        };
        let mut hits = 0;
        for case in 0..20_000_u32 {
            let at = |i: u32| number(case * 131 + i);
            let triangles: [[[f32; 3]; 3]; LANES] = std::array::from_fn(|lane| {
                std::array::from_fn(|corner| std::array::from_fn(|axis| at((lane * 9 + corner * 3 + axis) as u32)))
            });
            let origin = [at(100), at(101), at(102)];
            // Every other ray is aimed at a vertex, where the signs of the edge functions matter most.
            let target = if case % 2 == 0 { triangles[3][1] } else { [at(103), at(104), at(105)] };
            let ray = Ray::new(origin, std::array::from_fn(|axis| target[axis] - origin[axis]));
            let block = TriangleBlock::new((0..).zip(triangles));
            let got = block.intersect(&ray, 3.0);
            for (lane, corners) in triangles.iter().enumerate() {
                let want = intersect(&ray, corners, 3.0);
                assert_eq!(got.hits >> lane & 1 == 1, want.is_some(), "case {case}, lane {lane}");
                if let Some(want) = want {
                    let back = got.back >> lane & 1 == 1;
                    assert_eq!(TriangleHit { t: got.t[lane], b1: got.b1[lane], b2: got.b2[lane], back }, want);
                    hits += 1;
                }
            }
        }
        assert!(hits > 10_000, "{hits}");
    }
}
