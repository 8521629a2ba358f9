//! Rays against surfaces given by a formula, and the place on a surface that a hit means.
//!
//! A hit of a triangle is its row and two barycentrics. Here the three say where on the surface it is, without the ray and
//! to the last bits of a single-precision position: the row is a *face* of what is put around the surface, the two
//! numbers are coordinates on it.
//!
//! | shape | faces | coordinates |
//! |---|---|---|
//! | sphere | 6 of the cube around it: +X, −X, +Y, −Y, +Z, −Z | the two other axes, over that of the face |
//! | cylinder | 4 sides: +X, −X, +Z, −Z | the other axis over that of the side; height |
//! | disc, plane | 1 | x, z |
//!
//! The ray is single-precision, as for triangles; what is made of it here is double, so that distances are right but for
//! their last rounding, and a ray that starts off the surface by a unit in the last place is on that side of it.

use glam::{DVec2, DVec3};
use obvhs::aabb::Aabb;

#[cfg(test)]
mod tests;

use super::{Counters, Nearest, Ray, TriangleHit};
use crate::world::Shape;

/// A plane ends here, m: squares of coordinates beyond would overflow where surfaces are shaded.
const FARTHEST: f64 = 1e18;

/// Where a ray meets a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeHit {
    /// The face.
    pub face: u32,
    /// Distance, and coordinates on the face in place of barycentrics.
    pub hit: TriangleHit,
}

/// Distances of the two points that a ray shares with a circle or sphere about the origin: the first where it enters.
///
/// The discriminant is r² less the square of the ray's distance from the middle, and not the difference of two numbers
/// that grow with the distance of the ray's start; of the roots only the one is computed whose terms add up (Haines,
/// Günther, Akenine-Möller 2019, "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems, chapter 7).
///
/// Vectors are given by their products: `oo` = o·o and so on; `foot` is the square of the ray's distance from the middle.
#[inline]
fn crossings(oo: f64, od: f64, dd: f64, foot: f64, radius: f64) -> Option<[f64; 2]> {
    let discriminant = radius * radius - foot;
    // Of a ray along the axis of a cylinder it is not a number.
    (discriminant >= 0.0).then(|| {
        let root = (dd * discriminant).sqrt();
        let c = oo - radius * radius;
        if od > 0.0 {
            let q = -od - root;
            [q / dd, c / q]
        } else {
            let q = -od + root;
            [c / q, q / dd]
        }
    })
}

/// A distance as hits have it, if it is ahead.
#[inline]
fn ahead(t: f64) -> Option<f32> {
    let t = t as f32;
    (t > 0.0 && t < f32::INFINITY).then_some(t)
}

/// The place on the cube's face whose axis is `axis`.
#[inline]
fn on_cube(p: DVec3, axis: usize) -> (u32, f32, f32) {
    let scale = 1.0 / p[axis].abs();
    let face = 2 * axis as u32 + u32::from(p[axis] < 0.0);
    (face, (p[(axis + 1) % 3] * scale) as f32, (p[(axis + 2) % 3] * scale) as f32)
}

impl Shape {
    /// How many faces hits are told by.
    pub fn faces(&self) -> usize {
        match self {
            Self::Sphere { .. } => 6,
            Self::Cylinder { .. } => 4,
            Self::Disc { .. } | Self::Plane => 1,
        }
    }

    /// Where a ray meets the shape ahead of its start, nearest first.
    #[inline]
    pub fn meet(&self, ray: &Ray) -> [Option<ShapeHit>; 2] {
        let (o, d) = (DVec3::from_array(ray.origin.map(f64::from)), DVec3::from_array(ray.direction.map(f64::from)));
        match *self {
            Self::Sphere { radius } => {
                let (od, dd) = (o.dot(d), d.length_squared());
                let foot = o - (od / dd) * d;
                let Some(both) = crossings(o.length_squared(), od, dd, foot.length_squared(), radius.into()) else {
                    return [None; 2];
                };
                [0, 1].map(|which| {
                    let t = ahead(both[which])?;
                    let p = o + both[which] * d;
                    let a = p.abs();
                    let axis = if a.x >= a.y && a.x >= a.z {
                        0
                    } else if a.y >= a.z {
                        1
                    } else {
                        2
                    };
                    let (face, b1, b2) = on_cube(p, axis);
                    Some(ShapeHit { face, hit: TriangleHit { t, b1, b2, back: which == 1 } })
                })
            }
            Self::Cylinder { radius, half_height } => {
                let (across, along) = (DVec2::new(o.x, o.z), DVec2::new(d.x, d.z));
                let (od, dd) = (across.dot(along), along.length_squared());
                let foot = across - (od / dd) * along;
                let Some(both) = crossings(across.length_squared(), od, dd, foot.length_squared(), radius.into())
                else {
                    return [None; 2];
                };
                let meets = [0, 1].map(|which| {
                    let t = ahead(both[which])?;
                    let p = o + both[which] * d;
                    if p.y.abs() > half_height.into() {
                        return None;
                    }
                    let (side, other, face) = if p.x.abs() >= p.z.abs() { (p.x, p.z, 0) } else { (p.z, p.x, 2) };
                    let (face, b1) = (face + u32::from(side < 0.0), (other / side.abs()) as f32);
                    Some(ShapeHit { face, hit: TriangleHit { t, b1, b2: p.y as f32, back: which == 1 } })
                });
                if meets[0].is_none() { [meets[1], None] } else { meets }
            }
            Self::Disc { .. } | Self::Plane => {
                let t = -o.y / d.y;
                let (x, z) = (o.x + t * d.x, o.z + t * d.z);
                let within = match *self {
                    Self::Disc { radius } => x * x + z * z <= f64::from(radius) * f64::from(radius),
                    _ => x.abs().max(z.abs()) < FARTHEST,
                };
                let hit = ahead(t)
                    .filter(|_| within)
                    .map(|t| ShapeHit { face: 0, hit: TriangleHit { t, b1: x as f32, b2: z as f32, back: d.y > 0.0 } });
                [hit, None]
            }
        }
    }

    /// The point that a hit means, m.
    #[inline]
    pub fn point(&self, face: u32, b1: f32, b2: f32) -> DVec3 {
        let side = if face & 1 == 0 { 1.0 } else { -1.0 };
        let (b1, b2) = (f64::from(b1), f64::from(b2));
        match *self {
            Self::Sphere { radius } => {
                let p = match face >> 1 {
                    0 => DVec3::new(side, b1, b2),
                    1 => DVec3::new(b2, side, b1),
                    _ => DVec3::new(b1, b2, side),
                };
                p * (f64::from(radius) / p.length())
            }
            Self::Cylinder { radius, .. } => {
                let scale = f64::from(radius) / (1.0 + b1 * b1).sqrt();
                let [x, z] = if face >> 1 == 0 { [side, b1] } else { [b1, side] };
                DVec3::new(x * scale, b2, z * scale)
            }
            Self::Disc { .. } | Self::Plane => DVec3::new(b1, 0.0, b2),
        }
    }

    /// Unit normal of the front at a point of the surface.
    #[inline]
    pub fn normal(&self, p: DVec3) -> DVec3 {
        match self {
            Self::Sphere { .. } => p.normalize(),
            Self::Cylinder { .. } => DVec3::new(p.x, 0.0, p.z).normalize(),
            Self::Disc { .. } | Self::Plane => DVec3::Y,
        }
    }

    /// Texture coordinates at a point of the surface.
    #[inline]
    pub fn uv(&self, p: DVec3) -> [f32; 2] {
        use std::f64::consts::{PI, TAU};
        let around = || {
            let turn = p.z.atan2(p.x) / TAU;
            if turn < 0.0 { turn + 1.0 } else { turn }
        };
        let [u, v] = match *self {
            Self::Sphere { .. } => [around(), p.x.hypot(p.z).atan2(p.y) / PI],
            Self::Cylinder { half_height, .. } => [around(), 0.5 - 0.5 * p.y / f64::from(half_height)],
            Self::Disc { radius } => [p.x, p.z].map(|x| 0.5 + 0.5 * x / f64::from(radius)),
            Self::Plane => [p.x, p.z],
        };
        [u as f32, v as f32]
    }

    /// Direction of growing u at a point of the surface, and the sign of the bitangent as glTF has it: upwards in the
    /// picture. Zero at a sphere's poles.
    #[inline]
    pub fn tangent(&self, p: DVec3) -> [f32; 4] {
        let (t, sign) = match self {
            Self::Sphere { .. } | Self::Cylinder { .. } => (DVec3::new(-p.z, 0.0, p.x).normalize_or_zero(), -1.0),
            Self::Disc { .. } | Self::Plane => (DVec3::X, 1.0),
        };
        t.as_vec3().extend(sign).to_array()
    }

    /// Boxes hold the surface and the rounding of the test above; that of a plane, which has none, is empty.
    pub(super) fn bounds(&self) -> Aabb {
        let [x, y, z] = match *self {
            Self::Sphere { radius } => [radius; 3],
            Self::Cylinder { radius, half_height } => [radius, half_height, radius],
            Self::Disc { radius } => [radius, 0.0, radius],
            Self::Plane => return Aabb::empty(),
        }
        .map(|size| if size == 0.0 { 0.0 } else { size.next_up() });
        Aabb::new([-x, -y, -z].into(), [x, y, z].into())
    }
}

/// A shape in the place of a structure of triangles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Formula(pub Shape);

impl Formula {
    /// Memory beside the shape itself.
    pub fn bytes(&self) -> usize {
        0
    }

    /// Triangles that it refers to.
    pub fn references(&self) -> usize {
        0
    }

    /// As [`super::Structure::nearest`].
    #[inline]
    pub fn nearest(
        &self,
        ray: &Ray,
        best: &mut Nearest,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        _: &mut impl Counters,
    ) {
        for ShapeHit { face, hit } in self.0.meet(ray).into_iter().flatten() {
            best.offer(face, &hit, &accept);
        }
    }

    /// As [`super::Structure::occluded`].
    #[inline]
    pub fn occluded(
        &self,
        ray: &Ray,
        t_max: f32,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        _: &mut impl Counters,
    ) -> bool {
        self.0.meet(ray).into_iter().flatten().any(|ShapeHit { face, hit }| hit.t <= t_max && accept(face, &hit))
    }
}
