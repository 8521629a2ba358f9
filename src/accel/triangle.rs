//! Ray against triangle, without gaps between neighbours.

use wide::f32x8;

use super::arena::Granule;
use crate::simd::LANES;

/// A ray with what the watertight test needs: the axis it mostly runs along, and the shear that makes
/// that axis its own.
///
/// The direction need not be of unit length; `t` is in units of it.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Start.
    pub origin: [f32; 3],
    /// Direction, not zero.
    pub direction: [f32; 3],
    /// One over each component of the direction; infinite where that is zero.
    pub inverse: [f32; 3],
    /// 1 for each component that runs towards smaller coordinates, else 0.
    pub negative: [usize; 3],
    axes: [usize; 3],
    shear: [f32; 3],
}

impl Ray {
    /// Prepares a ray.
    #[inline]
    pub fn new(origin: [f32; 3], direction: [f32; 3]) -> Self {
        let [x, y, z] = direction.map(f32::abs);
        let kz = if x > y {
            if x > z { 0 } else { 2 }
        } else if y > z {
            1
        } else {
            2
        };
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if direction[kz] < 0.0 {
            std::mem::swap(&mut kx, &mut ky);
        }
        let inverse = direction.map(|d| 1.0 / d);
        let shear = [direction[kx] * inverse[kz], direction[ky] * inverse[kz], inverse[kz]];
        let negative = inverse.map(|inverse| usize::from(inverse < 0.0));
        Self { origin, direction, inverse, negative, axes: [kx, ky, kz], shear }
    }
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    /// Along the ray, above zero.
    pub t: f32,
    /// Barycentric of the second corner.
    pub b1: f32,
    /// Barycentric of the third corner.
    pub b2: f32,
    /// True if the corners run clockwise as seen from the ray's origin.
    pub back: bool,
}

/// False where the corners lie on a line, or so nearly that the normal is lost to rounding.
///
/// The test below sees sheared corners, whose rounding can give such a triangle an area.
pub(super) fn has_area([a, b, c]: &[[f32; 3]; 3]) -> bool {
    let edge = |to: &[f32; 3]| -> [f32; 3] { std::array::from_fn(|axis| to[axis] - a[axis]) };
    let (e, f) = (edge(b), edge(c));
    (0..3).any(|axis| {
        let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
        e[j] * f[k] - e[k] * f[j] != 0.0
    })
}

/// The watertight test: a ray through a shared edge or vertex hits at least one of its triangles.
///
/// Edge functions are products rounded on their own (no fused multiply-add), so that both
/// triangles of an edge see the same number with opposite sign; zero counts as inside. Returns hits with 0 < t ≤ `t_max`.
///
/// Woop, Benthin, Wald 2013, "Watertight Ray/Triangle Intersection".
#[inline(always)]
pub fn intersect(ray: &Ray, corners: &[[f32; 3]; 3], t_max: f32) -> Option<TriangleHit> {
    let [kx, ky, kz] = ray.axes;
    let [sx, sy, sz] = ray.shear;
    let sheared = |corner: &[f32; 3]| {
        let (x, y, z) = (corner[kx] - ray.origin[kx], corner[ky] - ray.origin[ky], corner[kz] - ray.origin[kz]);
        (x - sx * z, y - sy * z, z)
    };
    let (ax, ay, az) = sheared(&corners[0]);
    let (bx, by, bz) = sheared(&corners[1]);
    let (cx, cy, cz) = sheared(&corners[2]);
    let u = cx * by - cy * bx;
    let v = ax * cy - ay * cx;
    let w = bx * ay - by * ax;
    let outside = (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0);
    let det = u + v + w;
    if outside || det == 0.0 {
        return None;
    }
    let inv_det = 1.0 / det;
    let t = (u * az + v * bz + w * cz) * sz * inv_det;
    // Written so that a NaN fails it.
    if !(t > 0.0 && t <= t_max) {
        return None;
    }
    Some(TriangleHit { t, b1: v * inv_det, b2: w * inv_det, back: det < 0.0 })
}

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

impl TriangleBlock {
    /// Of at most eight triangles with their rows.
    pub fn new(triangles: impl IntoIterator<Item = (u32, [[f32; 3]; 3])>) -> Self {
        let (mut block, mut rows) = ([[0.0; LANES]; BLOCK - 1], [u32::MAX; LANES]);
        for (lane, (row, corners)) in triangles.into_iter().enumerate() {
            rows[lane] = row;
            for (i, coordinate) in corners.into_iter().flatten().enumerate() {
                block[i][lane] = coordinate;
            }
        }
        Self(std::array::from_fn(|i| if i < BLOCK - 1 { Granule::of(block[i]) } else { Granule(rows) }))
    }

    /// The block that a reference means.
    #[inline(always)]
    pub fn at(arena: &[Granule], reference: u32) -> &Self {
        let granules: &[Granule; BLOCK] = arena[reference as usize..].first_chunk().expect("a reference of this arena");
        bytemuck::cast_ref(granules)
    }

    /// Adds the block to an arena and returns its place.
    pub fn store(&self, arena: &mut Vec<Granule>) -> u32 {
        arena.extend(self.0);
        (arena.len() - BLOCK) as u32
    }

    /// Row of a lane's triangle.
    #[inline(always)]
    pub fn row(&self, lane: usize) -> u32 {
        self.0[BLOCK - 1].0[lane]
    }

    /// [`intersect`] for all eight, with the same roundings: its SIMD twin.
    #[inline(always)]
    pub fn intersect(&self, ray: &Ray, t_max: f32) -> BlockHit {
        let [kx, ky, kz] = ray.axes;
        let [sx, sy, sz] = ray.shear.map(f32x8::splat);
        let [ox, oy, oz] = ray.axes.map(|axis| f32x8::splat(ray.origin[axis]));
        let sheared = |corner: usize| {
            let at = |axis: usize| f32x8::new(self.0[3 * corner + axis].values());
            let (x, y, z) = (at(kx) - ox, at(ky) - oy, at(kz) - oz);
            (x - sx * z, y - sy * z, z)
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
        let inside = inside & det.simd_ne(zero);
        let none = BlockHit { t: [0.0; LANES], b1: [0.0; LANES], b2: [0.0; LANES], back: 0, hits: 0 };
        if inside.to_bitmask() == 0 {
            return none;
        }
        let inv_det = f32x8::ONE / det;
        let t = (u * az + v * bz + w * cz) * sz * inv_det;
        let hits = (inside & t.simd_gt(zero) & t.simd_le(f32x8::splat(t_max))).to_bitmask();
        if hits == 0 {
            return none;
        }
        BlockHit {
            t: t.to_array(),
            b1: (v * inv_det).to_array(),
            b2: (w * inv_det).to_array(),
            back: det.simd_lt(zero).to_bitmask(),
            hits,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    const CORNERS: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

    /// The ray at (b1, b2) from above meets t = 2 there; from below it sees the back.
    #[test]
    fn barycentrics_distance_and_side_are_right_from_every_axis() {
        // Turning x → y → z keeps the orientation, and brings each axis to the front once.
        for turn in 0..3 {
            let turned = |p: [f32; 3]| [p[(3 - turn) % 3], p[(4 - turn) % 3], p[(5 - turn) % 3]];
            let corners = CORNERS.map(turned);
            for (z, dz, back) in [(2.0, -1.0, false), (-2.0, 1.0, true)] {
                let ray = Ray::new(turned([0.25, 0.5, z]), turned([0.0, 0.0, dz]));
                let hit = intersect(&ray, &corners, f32::INFINITY).unwrap();
                assert_eq!(hit, TriangleHit { t: 2.0, b1: 0.25, b2: 0.5, back });
                assert_eq!(intersect(&ray, &corners, 1.9), None, "beyond t_max");
                let away = Ray::new(turned([0.25, 0.5, z]), turned([0.0, 0.0, -dz]));
                assert_eq!(intersect(&away, &corners, f32::INFINITY), None, "behind");
            }
        }
    }

    #[test]
    fn a_triangle_without_area_is_never_hit() {
        let line = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        let point = [[0.5, 0.0, 0.0]; 3];
        for corners in [line, point] {
            assert!(!has_area(&corners));
            assert_eq!(intersect(&Ray::new([0.5, 0.0, 1.0], [0.0, 0.0, -1.0]), &corners, 10.0), None);
        }
    }

    /// A line askew to the ray has an area once its corners are sheared and rounded: [`has_area`] must tell.
    #[test]
    fn the_test_alone_cannot_tell_a_line_askew() {
        let line = [[0.125, 0.75, 0.3125], [0.375, 1.0, 0.5625], [0.875, 1.5, 1.0625]];
        assert!(!has_area(&line) && has_area(&CORNERS));
        let mut hit = 0;
        for i in 0..10_000 {
            let at = |i: i32| (i % 100) as f32 * 0.01;
            let target: [f32; 3] = std::array::from_fn(|axis| line[0][axis] + at(i) * (line[2][axis] - line[0][axis]));
            let origin = [3.0 + at(i / 100), -0.2, 0.1 + at(i)];
            let ray = Ray::new(origin, std::array::from_fn(|axis| target[axis] - origin[axis]));
            hit += u32::from(intersect(&ray, &line, f32::INFINITY).is_some());
        }
        assert!(hit > 0, "then has_area is not needed");
    }
}
