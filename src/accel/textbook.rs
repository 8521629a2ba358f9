//! Ray against triangle as textbooks have it, to be compared with what renders.
//!
//! Three tests over any kind of number: through the triangle's plane, Möller's and Trumbore's, and the watertight one,
//! which is [`super::intersect`] over again. The same code runs on `f32`, on `f64`, and on [`Counted`], which tallies
//! what it is asked to do.

use std::{
    cell::Cell,
    cmp::Ordering,
    ops::{Add, Div, Mul, Sub},
};

use crate::simd::Real;

/// What the tests need of a number.
pub trait Scalar:
    Copy + PartialOrd + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// From single precision; exact.
    fn of(value: f32) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// `self · a + b`, which may be rounded once.
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    /// `b − self · a`, which may be rounded once.
    #[inline(always)]
    fn mul_neg_add(self, a: Self, b: Self) -> Self {
        b - self * a
    }
}

impl Scalar for f32 {
    #[inline(always)]
    fn of(value: f32) -> Self {
        value
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Real::mul_add(self, a, b)
    }
    #[inline(always)]
    fn mul_neg_add(self, a: Self, b: Self) -> Self {
        Real::mul_add(-self, a, b)
    }
}

impl Scalar for f64 {
    #[inline(always)]
    fn of(value: f32) -> Self {
        value.into()
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
}

/// Arithmetic that was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Operations {
    /// Divisions.
    pub divisions: u32,
    /// Multiplications.
    pub multiplications: u32,
    /// Additions and subtractions.
    pub additions: u32,
    /// Comparisons.
    pub comparisons: u32,
}

thread_local! {
    static TALLY: Cell<Operations> = const { Cell::new(Operations { divisions: 0, multiplications: 0, additions: 0, comparisons: 0 }) };
}

/// Result of `work`, and what it did with [`Counted`] numbers.
pub fn counted<T>(work: impl FnOnce() -> T) -> (T, Operations) {
    TALLY.set(Operations::default());
    let result = work();
    (result, TALLY.get())
}

fn tally(kind: impl FnOnce(&mut Operations) -> &mut u32) {
    let mut tally = TALLY.get();
    *kind(&mut tally) += 1;
    TALLY.set(tally);
}

/// A number that counts what is done with it; see [`counted`]. Its magnitude costs nothing, as on hardware.
#[derive(Clone, Copy, Debug)]
pub struct Counted(pub f32);

impl Scalar for Counted {
    fn of(value: f32) -> Self {
        Self(value)
    }
    fn abs(self) -> Self {
        Self(self.0.abs())
    }
}

impl Add for Counted {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        tally(|tally| &mut tally.additions);
        Self(self.0 + other.0)
    }
}

impl Sub for Counted {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        tally(|tally| &mut tally.additions);
        Self(self.0 - other.0)
    }
}

impl Mul for Counted {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        tally(|tally| &mut tally.multiplications);
        Self(self.0 * other.0)
    }
}

impl Div for Counted {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        tally(|tally| &mut tally.divisions);
        Self(self.0 / other.0)
    }
}

impl PartialEq for Counted {
    fn eq(&self, other: &Self) -> bool {
        tally(|tally| &mut tally.comparisons);
        self.0 == other.0
    }
}

impl PartialOrd for Counted {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        tally(|tally| &mut tally.comparisons);
        self.0.partial_cmp(&other.0)
    }
}

/// Three coordinates.
pub type V<S> = [S; 3];

/// As numbers of another kind; exact.
#[inline(always)]
pub fn vector<S: Scalar>(v: [f32; 3]) -> V<S> {
    v.map(S::of)
}

#[inline(always)]
fn sub<S: Scalar>(a: V<S>, b: V<S>) -> V<S> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn dot<S: Scalar>(a: V<S>, b: V<S>) -> S {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross<S: Scalar>(a: V<S>, b: V<S>) -> V<S> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Met<S> {
    /// Along the ray.
    pub t: S,
    /// Barycentric of the second corner.
    pub b1: S,
    /// Barycentric of the third corner.
    pub b2: S,
}

/// Distance to the triangle's plane, if the point there is on the inner side of each edge.
///
/// `t = (p₀ − o)·n / d·n`, then `(eᵢ × (p − pᵢ))·n ≥ 0` for all three edges.
#[inline(always)]
pub fn plane_and_inside<S: Scalar>(origin: V<S>, direction: V<S>, corners: &[V<S>; 3], t_max: S) -> Option<S> {
    let edges = [sub(corners[1], corners[0]), sub(corners[2], corners[1]), sub(corners[0], corners[2])];
    let normal = cross(edges[0], edges[1]);
    let t = dot(sub(corners[0], origin), normal) / dot(direction, normal);
    // Written so that a NaN, of a ray along the plane, fails it.
    if !(t > S::of(0.0) && t <= t_max) {
        return None;
    }
    let p = [origin[0] + t * direction[0], origin[1] + t * direction[1], origin[2] + t * direction[2]];
    let inside = |i: usize| dot(cross(edges[i], sub(p, corners[i])), normal) >= S::of(0.0);
    (inside(0) && inside(1) && inside(2)).then_some(t)
}

/// Distance and barycentrics of where a ray meets a triangle's plane, given a corner and the edges from there.
///
/// With `s = o − p₀`, `s₁ = d × e₂`, `s₂ = s × e₁`: `(t, b₁, b₂) = (s₂·e₂, s₁·s, s₂·d) / s₁·e₁`. That is 1 division, 27
/// multiplications and 17 additions, as lectures count it; the edges, another 6, are taken to be there.
///
/// Möller, Trumbore 1997, "Fast, Minimum Storage Ray/Triangle Intersection".
#[inline(always)]
pub fn solve<S: Scalar>(origin: V<S>, direction: V<S>, corner: V<S>, e1: V<S>, e2: V<S>) -> Met<S> {
    let s = sub(origin, corner);
    let s1 = cross(direction, e2);
    let s2 = cross(s, e1);
    let inverse = S::of(1.0) / dot(s1, e1);
    Met { t: dot(s2, e2) * inverse, b1: dot(s1, s) * inverse, b2: dot(s2, direction) * inverse }
}

/// [`solve`]; a hit if all three barycentrics are at least zero.
///
/// It loses rays at edges: the two triangles of an edge see it from corners and along edges of their own, and round
/// differently.
#[inline(always)]
pub fn moller_trumbore<S: Scalar>(
    origin: V<S>,
    direction: V<S>,
    corner: V<S>,
    e1: V<S>,
    e2: V<S>,
    t_max: S,
) -> Option<Met<S>> {
    let met = solve(origin, direction, corner, e1, e2);
    let zero = S::of(0.0);
    // Of a ray along the plane they are infinite or NaN, and one of these fails.
    let inside = met.b1 >= zero && met.b2 >= zero && S::of(1.0) - met.b1 - met.b2 >= zero;
    (inside && met.t > zero && met.t <= t_max).then_some(met)
}

/// [`moller_trumbore`] of a triangle by its corners.
#[inline(always)]
pub fn moller_trumbore_corners<S: Scalar>(
    origin: V<S>,
    direction: V<S>,
    corners: &[V<S>; 3],
    t_max: S,
) -> Option<Met<S>> {
    let [e1, e2] = [sub(corners[1], corners[0]), sub(corners[2], corners[0])];
    moller_trumbore(origin, direction, corners[0], e1, e2, t_max)
}

/// A ray as the watertight test sees it: as [`super::Ray`], over any kind of number.
#[derive(Clone, Copy, Debug)]
pub struct Sheared<S> {
    origin: V<S>,
    axes: [usize; 3],
    shear: V<S>,
}

impl<S: Scalar> Sheared<S> {
    /// Prepares a ray.
    #[inline(always)]
    pub fn new(origin: V<S>, direction: V<S>) -> Self {
        let [x, y, z] = direction.map(S::abs);
        let kz = if x > y {
            if x > z { 0 } else { 2 }
        } else if y > z {
            1
        } else {
            2
        };
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if direction[kz] < S::of(0.0) {
            std::mem::swap(&mut kx, &mut ky);
        }
        let inverse = S::of(1.0) / direction[kz];
        let shear = [direction[kx] * inverse, direction[ky] * inverse, inverse];
        Self { origin, axes: [kx, ky, kz], shear }
    }
}

/// The watertight test: the ray becomes an axis, and the edge functions about it have the same rounding for both
/// triangles of an edge.
///
/// Woop, Benthin, Wald 2013, "Watertight Ray/Triangle Intersection".
#[inline(always)]
pub fn watertight<S: Scalar>(ray: &Sheared<S>, corners: &[V<S>; 3], t_max: S) -> Option<Met<S>> {
    let [kx, ky, kz] = ray.axes;
    let [sx, sy, sz] = ray.shear;
    let sheared = |corner: &V<S>| {
        let (x, y, z) = (corner[kx] - ray.origin[kx], corner[ky] - ray.origin[ky], corner[kz] - ray.origin[kz]);
        (sx.mul_neg_add(z, x), sy.mul_neg_add(z, y), z)
    };
    let (ax, ay, az) = sheared(&corners[0]);
    let (bx, by, bz) = sheared(&corners[1]);
    let (cx, cy, cz) = sheared(&corners[2]);
    let u = cx * by - cy * bx;
    let v = ax * cy - ay * cx;
    let w = bx * ay - by * ax;
    let zero = S::of(0.0);
    let outside = (u < zero || v < zero || w < zero) && (u > zero || v > zero || w > zero);
    let det = u + v + w;
    if outside || det == zero {
        return None;
    }
    let inverse = S::of(1.0) / det;
    let t = w.mul_add(cz, v.mul_add(bz, u * az)) * sz * inverse;
    (t > zero && t <= t_max).then(|| Met { t, b1: v * inverse, b2: w * inverse })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        accel::{Leaf, Ray, TriangleBlock, family::numbers},
        simd::LANES,
    };

    const CORNERS: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    const ORIGIN: [f32; 3] = [0.25, 0.5, 2.0];
    const DOWN: [f32; 3] = [0.0, 0.0, -1.0];

    /// Three barycentrics and a distance take 1 division, 27 multiplications and 17 additions when the edges are at
    /// hand: 9 for each of two cross products (6 and 3), 5 for each of four inner products (3 and 2), 3 for `s`, 3 to
    /// divide. The third barycentric takes 2 more, the edges 6.
    #[test]
    fn moller_trumbore_takes_one_division_27_multiplications_and_17_additions() {
        let [o, d] = [ORIGIN, DOWN].map(vector::<Counted>);
        let corners = CORNERS.map(vector::<Counted>);
        let [e1, e2] = [corners[1], corners[2]];
        let (_, solved) = counted(|| solve(o, d, corners[0], e1, e2));
        let textbook = Operations { divisions: 1, multiplications: 27, additions: 17, comparisons: 0 };
        assert_eq!(solved, textbook);
        let (hit, tested) = counted(|| moller_trumbore(o, d, corners[0], e1, e2, Counted(3.0)));
        assert!(hit.is_some());
        assert_eq!(tested, Operations { additions: 17 + 2, comparisons: 5, ..textbook });
        let (_, whole) = counted(|| moller_trumbore_corners(o, d, &corners, Counted(3.0)));
        assert_eq!(whole, Operations { additions: 17 + 2 + 6, comparisons: 5, ..textbook });
    }

    /// Plane: edges 9, normal 6 and 3, `t` 1 and 6 and 7, point 3 and 3, each edge 6 + 3 and 3 + 3 + 2. Watertight: corners
    /// 9, shear 6 and 6, edge functions 6 and 3, their sum 2, `t` 5 and 2, barycentrics 2; for each ray 1 and 2.
    #[test]
    fn the_other_tests_take_what_their_formulas_say() {
        let [o, d] = [ORIGIN, DOWN].map(vector::<Counted>);
        let corners = CORNERS.map(vector::<Counted>);
        let (hit, plane) = counted(|| plane_and_inside(o, d, &corners, Counted(3.0)));
        assert!(hit.is_some());
        let want = Operations { divisions: 1, multiplications: 42, additions: 46, comparisons: 5 };
        assert_eq!(plane, want);
        let (ray, set_up) = counted(|| Sheared::new(o, d));
        assert_eq!(set_up, Operations { divisions: 1, multiplications: 2, additions: 0, comparisons: 3 });
        let (hit, watertight) = counted(|| watertight(&ray, &corners, Counted(3.0)));
        assert!(hit.is_some());
        assert_eq!(watertight.divisions, 1);
        assert_eq!((watertight.multiplications, watertight.additions), (19, 22));
    }

    /// All tests, in both precisions, say of 20,000 random pairs what the others say, but for rays within rounding of an
    /// edge.
    #[test]
    fn the_tests_agree_away_from_edges() {
        let mut u = numbers(5);
        let (mut hits, mut doubtful) = (0, 0);
        for case in 0..20_000 {
            let mut point = || [u() * 2.0 - 1.0, u() * 2.0 - 1.0, u() * 2.0 - 1.0];
            let corners = [point(), point(), point()];
            let (origin, direction) = (point(), point());
            let t_max = 4.0;
            let wide = corners.map(vector::<f64>);
            let (o, d) = (vector::<f64>(origin), vector::<f64>(direction));
            let exact = solve(o, d, wide[0], sub(wide[1], wide[0]), sub(wide[2], wide[0]));
            let scale = dot(d, d).sqrt();
            let least = [exact.b1, exact.b2, 1.0 - exact.b1 - exact.b2, exact.t * scale, (4.0 - exact.t) * scale]
                .into_iter()
                .fold(f64::INFINITY, |least, x| least.min(x.abs()));
            if least < 1e-3 {
                doubtful += 1;
                continue;
            }
            let truth = moller_trumbore_corners(o, d, &wide, 4.0).map(|met| met.t);
            let mut check = |what: &str, t: Option<f64>| {
                assert_eq!(t.is_some(), truth.is_some(), "case {case}, {what}");
                if let (Some(t), Some(truth)) = (t, truth) {
                    assert!((t - truth).abs() <= 1e-3 * truth, "case {case}, {what}: {t}, not {truth}");
                    hits += 1;
                }
            };
            check("plane, f64", plane_and_inside(o, d, &wide, 4.0));
            check("watertight, f64", watertight(&Sheared::new(o, d), &wide, 4.0).map(|met| met.t));
            check("plane", plane_and_inside(origin, direction, &corners, t_max).map(f64::from));
            check("Möller", moller_trumbore_corners(origin, direction, &corners, t_max).map(|met| met.t.into()));
            check("watertight", watertight(&Sheared::new(origin, direction), &corners, t_max).map(|met| met.t.into()));
        }
        assert!(hits > 3_000 && doubtful < 1_000, "{hits} {doubtful}");
    }

    /// Of 200,000 pairs of random rays and triangles, half of them aimed at a corner: the watertight test here, in single
    /// precision, is the eight-wide one that renders, to the last bit.
    #[test]
    fn the_watertight_twin_is_the_eight_wide_test_bit_for_bit() {
        let mut u = numbers(9);
        let mut hits = 0;
        for case in 0..25_000 {
            let scale = [1.0, 1e-4, 1e6][case % 3];
            let mut point = || [u(), u(), u()].map(|x| scale * (2.0 * x - 1.0));
            let triangles: [[[f32; 3]; 3]; LANES] = std::array::from_fn(|_| [point(), point(), point()]);
            let (origin, target) = (point(), if case % 2 == 0 { triangles[case % 8][case % 3] } else { point() });
            let mut direction: [f32; 3] = std::array::from_fn(|axis| target[axis] - origin[axis]);
            if case % 5 == 0 {
                direction[case % 3] = 0.0;
            }
            let block = TriangleBlock::new((0..).zip(triangles)).intersect(&Ray::new(origin, direction), 2.0);
            let ray = Sheared::new(origin, direction);
            for (lane, corners) in triangles.iter().enumerate() {
                let got = (block.hits >> lane & 1 == 1).then(|| block.hit(lane));
                let got = got.map(|hit| [hit.t, hit.b1, hit.b2].map(f32::to_bits));
                let want = watertight(&ray, corners, 2.0).map(|met| [met.t, met.b1, met.b2].map(f32::to_bits));
                assert_eq!(got, want, "case {case}, lane {lane}");
                hits += u32::from(want.is_some());
            }
        }
        assert!(hits > 15_000, "{hits}");
    }

    /// Of a ray along its plane no test makes a hit.
    #[test]
    fn a_ray_along_the_plane_meets_nothing() {
        let (origin, direction) = ([-1.0, 0.25, 0.0], [1.0, 0.0, 0.0]);
        assert_eq!(plane_and_inside(origin, direction, &CORNERS, 9.0), None);
        assert_eq!(moller_trumbore_corners(origin, direction, &CORNERS, 9.0), None);
        assert_eq!(watertight(&Sheared::new(origin, direction), &CORNERS, 9.0), None);
    }
}
