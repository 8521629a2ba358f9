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
