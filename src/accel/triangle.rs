//! Ray against triangle, without gaps between neighbours.

use wide::{f32x4, f32x8, u16x8, u32x8};

use super::leaf::{Leaf, TriangleQuad};
use crate::simd::{LANES, Real};

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
    /// `inverse`, negated.
    pub(super) against: [f32; 3],
    /// For the axis that the ray mostly runs along and the two others.
    pub(super) shear: [f32; 3],
    /// The start, by the same axes.
    pub(super) from: [f32; 3],
    pub(super) axes: [Axis; 3],
    /// For each axis, which of a box's planes the ray comes to first.
    pub(super) first: [Side; 3],
    /// And which last.
    pub(super) last: [Side; 3],
}

/// An axis, as the place of its coordinates in a [`TriangleQuad`]. An enumeration, because then the compiler knows that
/// there are no others, and does not look whether they are inside the block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Axis {
    X = 0,
    Y = 4,
    Z = 8,
}

impl Axis {
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];

    #[inline(always)]
    pub fn number(self) -> usize {
        self as usize / TriangleQuad::MOST
    }
}

/// The lower or the upper planes of a node's boxes, as their place among those of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Side {
    Lower = 0,
    Upper = LANES as u8,
}

/// What follows from a direction's signs and from which of its components are larger than which.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
struct Turn {
    /// Where the direction's components lie by [`Ray::axes`], and behind them those of the start.
    order: [u16; LANES],
    /// The axis that the ray mostly runs along.
    along: u8,
    axes: [Axis; 3],
    first: [Side; 3],
    last: [Side; 3],
}

/// By |x| > |y|, |x| > |z|, |y| > |z| in the upper bits, the signs of x, y and z in the lower ones. A table, because what
/// rays through the leaves of a tree run along cannot be guessed.
static TURNS: [Turn; 64] = {
    let turn = Turn { order: [0; LANES], along: 0, axes: Axis::ALL, first: [Side::Lower; 3], last: [Side::Upper; 3] };
    let mut table = [turn; 64];
    let mut row = 0;
    while row < 64 {
        let turn = &mut table[row];
        let (x_over_y, x_over_z, y_over_z) = (row & 8 != 0, row & 16 != 0, row & 32 != 0);
        let kz = if x_over_y && x_over_z {
            0
        } else if !x_over_y && y_over_z {
            1
        } else {
            2
        };
        // Turned over if it runs backwards, so that triangles keep their orientation.
        let backwards = row >> kz & 1;
        let axes = [(kz + 1 + backwards) % 3, (kz + 2 - backwards) % 3, kz];
        turn.along = kz as u8;
        let mut axis = 0;
        while axis < 3 {
            turn.axes[axis] = Axis::ALL[axes[axis]];
            turn.order[axis] = axes[axis] as u16;
            turn.order[4 + axis] = 4 + axes[axis] as u16;
            if row >> axis & 1 == 1 {
                (turn.first[axis], turn.last[axis]) = (Side::Upper, Side::Lower);
            }
            axis += 1;
        }
        row += 1;
    }
    table
};

impl Ray {
    /// Prepares a ray.
    #[inline]
    pub fn new(origin: [f32; 3], direction: [f32; 3]) -> Self {
        let [origin, direction] = [origin, direction].map(|[x, y, z]| f32x4::new([x, y, z, 0.0]));
        Self::of(origin, direction)
    }

    /// [`Ray::new`], given vectors of three numbers, whose last lane is ignored.
    #[inline(always)]
    pub(super) fn of(origin: f32x4, direction: f32x4) -> Self {
        let both: f32x8 = bytemuck::cast([direction, origin]);
        let sizes: u32x8 = bytemuck::cast(both.abs());
        let one: f32x8 = bytemuck::cast(sizes.shuffle_wrapping(u32x8::new([0, 0, 1, 3, 3, 3, 3, 3])));
        let other: f32x8 = bytemuck::cast(sizes.shuffle_wrapping(u32x8::new([1, 2, 2, 3, 3, 3, 3, 3])));
        let larger = one.simd_gt(other).to_bitmask() & 7;
        let negative = both.to_bitmask() & 7;
        let turn = &TURNS[(larger << 3 | negative) as usize];
        let inverse = f32x4::ONE / direction;
        let against = -inverse;
        let along = inverse.to_array()[turn.along as usize % 4];
        let order = u32x8::from(u16x8::new(turn.order));
        let turned: f32x8 = bytemuck::cast(bytemuck::cast::<_, u32x8>(both).shuffle_wrapping(order));
        let [across, from]: [f32x4; 2] = bytemuck::cast(turned);
        let [sx, sy, ..] = (across * f32x4::splat(along)).to_array();
        let three = |of: f32x4| -> [f32; 3] { *of.as_array().first_chunk().expect("four lanes") };
        Self {
            origin: three(origin),
            direction: three(direction),
            inverse: three(inverse),
            against: three(against),
            shear: [sx, sy, along],
            from: three(from),
            axes: turn.axes,
            first: turn.first,
            last: turn.last,
        }
    }

    /// False if it starts nowhere or leads nowhere: no triangle is hit by that, but boxes are met, those of missing children too,
    /// because the slab test passes over what is not a number.
    #[inline(always)]
    pub(super) fn is_finite(&self) -> bool {
        let zero = |of: [f32; 3]| of[0] * 0.0 + of[1] * 0.0 + of[2] * 0.0;
        zero(self.origin) + zero(self.direction) == 0.0
    }

    /// 1 if it runs towards smaller coordinates of an axis, else 0.
    #[inline(always)]
    pub fn negative(&self, axis: usize) -> usize {
        usize::from(self.inverse[axis] < 0.0)
    }
}

/// `a · b + c`, rounded once where eight at a time are too.
#[inline(always)]
fn mul_add(a: f32, b: f32, c: f32) -> f32 {
    <f32 as Real>::mul_add(a, b, c)
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
    let [kx, ky, kz] = ray.axes.map(Axis::number);
    let [sx, sy, sz] = ray.shear;
    let sheared = |corner: &[f32; 3]| {
        let (x, y, z) = (corner[kx] - ray.origin[kx], corner[ky] - ray.origin[ky], corner[kz] - ray.origin[kz]);
        (mul_add(-sx, z, x), mul_add(-sy, z, y), z)
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
    let t = mul_add(w, cz, mul_add(v, bz, u * az)) * sz * inv_det;
    // Written so that a NaN fails it.
    if !(t > 0.0 && t <= t_max) {
        return None;
    }
    Some(TriangleHit { t, b1: v * inv_det, b2: w * inv_det, back: det < 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// [`Ray::new`] a number at a time.
    fn scalar(origin: [f32; 3], direction: [f32; 3]) -> Ray {
        let [x, y, z] = direction.map(f32::abs);
        let kz = if x > y && x > z {
            0
        } else if y >= x && y > z {
            1
        } else {
            2
        };
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if direction[kz] < 0.0 {
            std::mem::swap(&mut kx, &mut ky);
        }
        let inverse = direction.map(|d| 1.0 / d);
        let side = |backwards: bool| if backwards { Side::Upper } else { Side::Lower };
        Ray {
            origin,
            direction,
            inverse,
            against: inverse.map(|inverse| -inverse),
            shear: [direction[kx] * inverse[kz], direction[ky] * inverse[kz], inverse[kz]],
            from: [kx, ky, kz].map(|axis| origin[axis]),
            axes: [kx, ky, kz].map(|axis| Axis::ALL[axis]),
            first: inverse.map(|inverse| side(inverse < 0.0)),
            last: inverse.map(|inverse| side(inverse >= 0.0)),
        }
    }

    /// In all directions of a grid, of which many have equal components and components that are a zero of either sign,
    /// in all orders of size, and from one number to the largest and the smallest.
    #[test]
    fn rays_are_prepared_as_they_are_a_number_at_a_time() {
        let components = [-f32::MAX, -2.0, -1.0, -0.3, -1e-40, -0.0, 0.0, 1e-40, 0.3, 1.0, 2.0, f32::MAX];
        for (i, x) in components.into_iter().enumerate() {
            for (j, y) in components.into_iter().enumerate() {
                for (k, z) in components.into_iter().enumerate().filter(|&(_, z)| [x, y, z] != [0.0; 3]) {
                    let origin = [components[k], components[i], components[j]];
                    let (got, want) = (Ray::new(origin, [x, y, z]), scalar(origin, [x, y, z]));
                    let numbers = |ray: &Ray| {
                        [ray.origin, ray.direction, ray.inverse, ray.against, ray.shear, ray.from]
                            .map(|of| of.map(f32::to_bits))
                    };
                    // Zero times infinite is not a number of no defined bits.
                    let same = numbers(&got) == numbers(&want) || want.shear.iter().any(|x| x.is_nan());
                    assert!(same, "{got:?} {want:?}");
                    assert_eq!((got.axes, got.first, got.last), (want.axes, want.first, want.last), "{x} {y} {z}");
                }
            }
        }
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
