//! Ray against triangle, without gaps between neighbours.

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
        Self { origin, direction, inverse, axes: [kx, ky, kz], shear }
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

/// The watertight test: a ray through a shared edge or vertex hits at least one of its triangles.
///
/// Edge functions are products rounded on their own (no fused multiply-add), so that both
/// triangles of an edge see the same number with opposite sign; zero counts as inside. A
/// triangle without area is never hit. Returns hits with 0 < t ≤ `t_max`.
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

#[cfg(test)]
mod tests {
    use super::*;

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
            assert_eq!(intersect(&Ray::new([0.5, 0.0, 1.0], [0.0, 0.0, -1.0]), &corners, 10.0), None);
        }
    }
}
