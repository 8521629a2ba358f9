//! From the unit square to points and directions; each with its density.
//!
//! All are continuous but where said, so that nearby numbers stay near and well-spread ones stay spread.

use std::f32::consts::{FRAC_1_PI, FRAC_PI_4};

use crate::simd::{Real, V3};

/// Density of [`concentric_disk`].
pub const DISK_PDF: f32 = FRAC_1_PI;
/// Density of [`uniform_sphere`], 1/sr.
pub const SPHERE_PDF: f32 = 0.25 * FRAC_1_PI;
/// Density of [`uniform_hemisphere`], 1/sr.
pub const HEMISPHERE_PDF: f32 = 0.5 * FRAC_1_PI;

/// Middle of the cell of a number of 24 bits, on −1 to 1 without the ends and without 0.
#[inline(always)]
fn signed<F: Real>(u: F) -> F {
    u.mul_add(F::splat(2.0), F::splat(1.0 / 16_777_216.0 - 1.0))
}

/// A point on the unit disk and its squared distance from the centre.
#[inline(always)]
fn disk<F: Real>(u: (F, F)) -> (F, F, F) {
    let (a, b) = (signed(u.0), signed(u.1));
    let across = a.abs().gt(b.abs());
    let (r, s) = (F::select(across, a, b), F::select(across, b, a));
    // |angle| ≤ π/4; r is 0 only if both are.
    let angle = s * F::splat(FRAC_PI_4) / F::select(r.eq(F::zero()), F::one(), r);
    let (sin, cos) = small_sin_cos(angle);
    let (near, far) = (r * cos, r * sin);
    (F::select(across, near, far), F::select(across, far, near), r * r)
}

/// Sine and cosine for |x| ≤ π/4, within 1e-7 (Moshier 1992, "Cephes", sinf and cosf).
#[inline(always)]
fn small_sin_cos<F: Real>(x: F) -> (F, F) {
    let x2 = x * x;
    let s = x2.mul_add(F::splat(-1.951_529_6e-4), F::splat(8.332_161e-3)).mul_add(x2, F::splat(-1.666_665_5e-1));
    let c = x2.mul_add(F::splat(2.443_315_7e-5), F::splat(-1.388_731_6e-3)).mul_add(x2, F::splat(4.166_664_6e-2));
    ((s * x2).mul_add(x, x), (c * x2).mul_add(x2, x2.mul_add(F::splat(-0.5), F::one())))
}

/// Sine and cosine of 2x for |x| ≤ π/2, within 3 ulp of one; the sine of a small angle to as many digits as the angle has.
///
/// The same bits from every [`Real`].
#[inline(always)]
pub fn sin_cos_twice<F: Real>(x: F) -> (F, F) {
    let x2 = x.sqr();
    let poly = |coefficients: &[f32]| {
        let (first, rest) = coefficients.split_first().expect("the tables below are not empty");
        rest.iter().fold(F::splat(*first), |sum, &c| sum.mul_add(x2, F::splat(c)))
    };
    // Taylor's; the first terms left out are below 1e-9 and 1e-8 at π/2.
    let sin = x * poly(&[
        1.0 / 6_227_020_800.0,
        -1.0 / 39_916_800.0,
        1.0 / 362_880.0,
        -1.0 / 5040.0,
        1.0 / 120.0,
        -1.0 / 6.0,
        1.0,
    ]);
    let cos = poly(&[1.0 / 479_001_600.0, -1.0 / 3_628_800.0, 1.0 / 40320.0, -1.0 / 720.0, 1.0 / 24.0, -0.5, 1.0]);
    let twice = sin + sin;
    (twice * cos, -twice.mul_add(sin, -F::one()))
}

/// Uniform on the unit disk (Shirley and Chiu 1997, "A Low Distortion Map Between Disk and Square").
#[inline(always)]
pub fn concentric_disk<F: Real>(u: (F, F)) -> (F, F) {
    let (x, y, _) = disk(u);
    (x, y)
}

/// Unit direction above the xy plane with density cosθ/π; z > 0.
#[inline(always)]
pub fn cosine_hemisphere<F: Real>(u: (F, F)) -> V3<F> {
    let (x, y, r2) = disk(u);
    V3::new(x, y, (F::one() - r2).safe_sqrt())
}

/// Density of [`cosine_hemisphere`], 1/sr, by the cosine with +z; 0 below the plane.
#[inline(always)]
pub fn cosine_hemisphere_pdf<F: Real>(cos: F) -> F {
    cos.max(F::zero()) * F::splat(FRAC_1_PI)
}

/// Unit direction above the xy plane, all equally likely; z > 0.
#[inline(always)]
pub fn uniform_hemisphere<F: Real>(u: (F, F)) -> V3<F> {
    uniform_cone(u, F::one())
}

/// Unit direction, all equally likely.
#[inline(always)]
pub fn uniform_sphere<F: Real>(u: (F, F)) -> V3<F> {
    uniform_cone(u, F::splat(2.0))
}

/// Unit direction within a cone about +z, all equally likely.
///
/// The cone is given by 1 − cosθ of its half-angle, which unlike cosθ is accurate for narrow ones. The disk is lifted
/// onto the sphere as in Lambert's equal-area projection.
#[inline(always)]
pub fn uniform_cone<F: Real>(u: (F, F), one_minus_cos: F) -> V3<F> {
    let (x, y, r2) = disk(u);
    let height = r2 * one_minus_cos;
    let scale = ((F::splat(2.0) - height) * one_minus_cos).safe_sqrt();
    V3::new(x * scale, y * scale, F::one() - height)
}

/// Density of [`uniform_cone`] inside it, 1/sr.
#[inline(always)]
pub fn uniform_cone_pdf<F: Real>(one_minus_cos: F) -> F {
    F::splat(HEMISPHERE_PDF) / one_minus_cos
}

/// Barycentrics of corners 1 and 2 of a uniform point in a triangle; its density is 1/area.
///
/// Both are positive or 0 and their sum is below 1 (Heitz 2019, "A Low-Distortion Map Between Triangle and Square").
#[inline(always)]
pub fn triangle<F: Real>(u: (F, F)) -> (F, F) {
    let half = u.0.min(u.1) * F::splat(0.5);
    (u.0 - half, u.1 - half)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use wide::f32x8;

    use super::*;
    use crate::sampling::tests::{check_warp, numbers};

    const TURN: [f64; 2] = [0.0, TAU];

    /// Angle about the origin, 0 to 2π.
    fn angle(x: f32, y: f32) -> f64 {
        f64::from(y).atan2(f64::from(x)).rem_euclid(TAU)
    }

    /// In (r², angle) the disk has half its density; in (z, angle) the sphere has all of its own.
    #[test]
    fn points_and_directions_follow_their_densities() {
        check_warp(
            "disk",
            [[0.0, 1.0], TURN],
            |u| {
                let (x, y) = concentric_disk(u);
                [f64::from(x * x + y * y), angle(x, y)]
            },
            |_| 0.5 * f64::from(DISK_PDF),
        );
        check_warp(
            "cosine hemisphere",
            [[0.0, 1.0], TURN],
            |u| {
                let d: V3<f32> = cosine_hemisphere(u);
                [f64::from(d.z), angle(d.x, d.y)]
            },
            |[z, _]| f64::from(cosine_hemisphere_pdf(z as f32)),
        );
        check_warp(
            "hemisphere",
            [[0.0, 1.0], TURN],
            |u| {
                let d: V3<f32> = uniform_hemisphere(u);
                [f64::from(d.z), angle(d.x, d.y)]
            },
            |_| f64::from(HEMISPHERE_PDF),
        );
        check_warp(
            "sphere",
            [[-1.0, 1.0], TURN],
            |u| {
                let d: V3<f32> = uniform_sphere(u);
                [f64::from(d.z), angle(d.x, d.y)]
            },
            |_| f64::from(SPHERE_PDF),
        );
        assert_eq!(cosine_hemisphere_pdf(-0.5f32), 0.0, "nothing below the plane");
    }

    /// Down to the sun and far below it, where 1 − cosθ is read from the sine: sin²θ = h (2 − h).
    #[test]
    fn cones_follow_their_density_however_narrow() {
        for one_minus_cos in [1.0f32, 0.3, 1.08e-5, 1e-12] {
            let height = f64::from(one_minus_cos);
            // In units of the cone's height, so that the mesh of the test fits any cone.
            check_warp(
                &format!("cone of {one_minus_cos:e}"),
                [[0.0, 1.0], TURN],
                |u| {
                    let d: V3<f32> = uniform_cone(u, one_minus_cos);
                    let sin2 = f64::from(d.x).powi(2) + f64::from(d.y).powi(2);
                    [sin2 / (1.0 + (1.0 - sin2).max(0.0).sqrt()) / height, angle(d.x, d.y)]
                },
                |_| f64::from(uniform_cone_pdf(one_minus_cos)) * height,
            );
        }
    }

    /// In barycentrics the half square has density 2; on the diagonal itself half of that, for the quadrature.
    #[test]
    fn triangle_is_covered_evenly() {
        check_warp(
            "triangle",
            [[0.0, 1.0], [0.0, 1.0]],
            |u| {
                let (b1, b2) = triangle(u);
                [f64::from(b1), f64::from(b2)]
            },
            |[b1, b2]| if (b1 + b2 - 1.0).abs() < 1e-9 { 1.0 } else { 2.0 * f64::from(b1 + b2 < 1.0) },
        );
    }

    /// Corners of the unit square and its middle, at the ends of what 24 bits hold.
    fn extremes() -> impl Iterator<Item = (f32, f32)> {
        let ends = [0.0, 0.5, 0.5 - f32::EPSILON / 4.0, 1.0 - f32::EPSILON / 2.0, f32::MIN_POSITIVE];
        ends.into_iter().flat_map(move |a| ends.map(|b| (a, b)))
    }

    #[test]
    fn directions_are_of_unit_length_and_on_their_side() {
        for u in numbers(1, 100_000).chain(extremes()) {
            for d in [cosine_hemisphere(u), uniform_hemisphere(u), uniform_sphere(u), uniform_cone(u, 1e-6f32)] {
                let length = [d.x, d.y, d.z].map(|v| f64::from(v).powi(2)).iter().sum::<f64>();
                assert!((length - 1.0).abs() < 6e-7, "{d:?} from {u:?}");
            }
            assert!(cosine_hemisphere(u).z > 0.0 && uniform_hemisphere(u).z > 0.0, "{u:?}");
            assert!(cosine_hemisphere_pdf(cosine_hemisphere(u).z) > 0.0, "{u:?}");
            let (x, y) = concentric_disk(u);
            assert!(f64::from(x).hypot(f64::from(y)) < 1.0 + 1e-7, "{u:?}");
            let (b1, b2) = triangle(u);
            assert!(b1 >= 0.0 && b2 >= 0.0 && b1 + b2 < 1.0, "{b1} {b2} from {u:?}");
        }
    }

    /// Nearby numbers stay near, also across the diagonals: the disk stretches a step to 2·√(1 + (π/4)²) times its length at most.
    #[test]
    fn disk_and_triangle_are_continuous() {
        let step = 1e-4;
        let move_of = |f: fn((f32, f32)) -> (f32, f32), u: (f32, f32), v: (f32, f32)| {
            let (p, q) = (f(u), f(v));
            (p.0 - q.0).hypot(p.1 - q.1) / step
        };
        for i in 0..200 {
            for j in 0..200 {
                let u = ((i as f32 + 0.5) / 200.0, (j as f32 + 0.5) / 200.0);
                for v in [(u.0 + step, u.1), (u.0, u.1 + step)] {
                    assert!(move_of(concentric_disk::<f32>, u, v) < 2.6, "disk at {u:?}");
                    assert!(move_of(triangle::<f32>, u, v) < 1.5, "triangle at {u:?}");
                }
            }
        }
    }

    /// Sine and cosine stay within two roundings of the true ones.
    #[test]
    fn small_angles_are_accurate() {
        for i in -1000..=1000 {
            let x = (f64::from(i) / 1000.0 * PI / 4.0) as f32;
            let (sin, cos) = small_sin_cos(x);
            assert!(
                (f64::from(sin) - f64::from(x).sin()).abs() < 8e-8
                    && (f64::from(cos) - f64::from(x).cos()).abs() < 1.2e-7
            );
        }
    }

    #[test]
    fn lanes_agree_with_the_scalar() {
        let points: Vec<_> = numbers(2, 800).chain(extremes()).take(824).collect();
        for block in points.as_chunks::<8>().0 {
            let u = (f32x8::new(block.map(|u| u.0)), f32x8::new(block.map(|u| u.1)));
            let lanes = [cosine_hemisphere(u), uniform_sphere(u), uniform_cone(u, f32x8::splat(0.1))];
            let (b1, b2) = triangle(u);
            for (i, &u) in block.iter().enumerate() {
                let scalars = [cosine_hemisphere(u), uniform_sphere(u), uniform_cone(u, 0.1f32)];
                for (lanes, scalar) in lanes.iter().zip(scalars) {
                    for (got, want) in lanes.lane(i).into_iter().zip(scalar.lane(0)) {
                        assert!((got - want).abs() < 2e-7, "{got} {want}");
                    }
                }
                assert_eq!((Real::lane(b1, i), Real::lane(b2, i)), triangle(u));
            }
        }
    }
}
