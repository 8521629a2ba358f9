//! Flat lights: directions uniform in the solid angle that they take.

use std::f32::consts::TAU;

use super::turns;
use crate::{
    sampling::warp::{sin_cos_twice, triangle},
    simd::{Mask, Real, V3},
};

/// Triangles and parallelograms, one per lane.
#[derive(Clone, Copy, Debug)]
pub struct Facets<F: Real> {
    /// First corner, m.
    pub p0: V3<F>,
    /// Second minus first.
    pub e1: V3<F>,
    /// Third minus first.
    pub e2: V3<F>,
    /// The fourth corner is `p0 + e1 + e2`; else there are three.
    pub four: F::Mask,
}

/// What depends on where they are seen from.
#[derive(Clone, Copy, Debug)]
pub struct Seen<F: Real> {
    facets: Facets<F>,
    /// From the point to the first corner.
    to: V3<F>,
    /// Unit directions to the corners: first, second, third, fourth.
    corners: [V3<F>; 4],
    halves: [Half<F>; 2],
    /// Solid angle, sr; 0 where they are seen edge-on.
    pub solid_angle: F,
}

/// The spherical triangle of corners a, b, c.
#[derive(Clone, Copy, Debug)]
struct Half<F: Real> {
    /// |a × b · c|.
    volume: F,
    /// c·(a + b).
    sides: F,
    /// 1 + a·b.
    base: F,
    solid_angle: F,
}

/// Solid angles below which points are drawn by area, sr: the light is then less than a thousandth rad across, or seen
/// edge-on, and a direction of 24 bits would no longer tell its points apart.
const SMALL: f32 = 1e-6;

impl<F: Real> Half<F> {
    /// The volume is given: computed from the directions it would lose what small triangles are made of.
    #[inline(always)]
    fn new(a: V3<F>, b: V3<F>, c: V3<F>, volume: F) -> Self {
        let sides = c.dot(a) + c.dot(b);
        let base = F::one() + a.dot(b);
        // Van Oosterom, Strackee 1983, "The Solid Angle of a Plane Triangle", equation 8.
        let solid_angle = F::splat(2.0 * TAU) * turns(volume, sides + base);
        Self { volume, sides, base, solid_angle }
    }
}

impl<F: Real> Facets<F> {
    /// As seen from a point.
    #[inline(always)]
    pub fn seen_from(self, p: V3<F>) -> Seen<F> {
        let Self { p0, e1, e2, four } = self;
        let to = p0 - p;
        let far = [to, to + e1, to + e2, to + e1 + e2];
        let per_length = far.map(|v| F::one() / v.length_squared().max(F::splat(f32::MIN_POSITIVE)).sqrt());
        let corners = [0, 1, 2, 3].map(|i| far[i] * per_length[i]);
        let [a, b, c, d] = corners;
        // Of the pyramid with its tip at the point, six times; right also where it is thin or small.
        let volume = to.dot(e1.cross(e2)).abs();
        let shared = volume * per_length[1] * per_length[2];
        let first = Half::new(a, b, c, shared * per_length[0]);
        let mut second = Half { volume: F::zero(), sides: F::zero(), base: F::one(), solid_angle: F::zero() };
        if four.any() {
            let half = Half::new(c, b, d, shared * per_length[3]);
            second = Half { solid_angle: half.solid_angle.masked(four), ..half };
        }
        let solid_angle = first.solid_angle + second.solid_angle;
        Seen { facets: self, to, corners, halves: [first, second], solid_angle }
    }
}

impl<F: Real> Seen<F> {
    /// Those whose points [`Seen::sample`] draws by area.
    #[inline(always)]
    pub fn by_area(&self) -> F::Mask {
        !self.solid_angle.gt(F::splat(SMALL))
    }

    /// Shares of the two edges of a point, uniform in solid angle, or by area where that is small.
    ///
    /// Two arcs from the second corner to the edge between the others cut off the share `u.0`; along the one in between
    /// goes `u.1` (Arvo 1995, "Stratified Sampling of Spherical Triangles", in the form of Peters 2021, "BRDF Importance
    /// Sampling for Polygonal Lights", section 3). A parallelogram's two triangles follow one another, with no seam.
    #[inline(always)]
    pub fn sample(&self, u: (F, F)) -> (F, F) {
        let Facets { e1, e2, four, .. } = self.facets;
        let [a, b, c, d] = self.corners;
        let [first, second] = self.halves;
        let one = F::one();
        let cut_off = u.0 * self.solid_angle;
        let beyond = four & cut_off.gt(first.solid_angle);
        let pick = |yes: F, no: F| F::select(beyond, yes, no);
        let (from, to) = (V3::select(beyond, c, a), V3::select(beyond, d, c));
        let cut_off = pick(cut_off - first.solid_angle, cut_off);
        let (volume, sides, base) =
            (pick(second.volume, first.volume), pick(second.sides, first.sides), pick(second.base, first.base));
        let (sin, cos) = sin_cos_twice(cut_off * F::splat(0.25));
        let middle = from * (volume * cos - sides * sin) + to * (base * sin);
        let length2 = middle.length_squared().max(F::splat(f32::MIN_POSITIVE));
        // Where the arc from the second corner meets the edge.
        let end = middle * (F::splat(2.0) * from.dot(middle) / length2) - from;
        let cos_end = b.dot(end);
        let cos = u.1.mul_add(cos_end - one, one);
        // The quotient of the sines, without what cancels.
        let share = (u.1 * (one + cos) / (one + cos_end).max(F::splat(1e-12))).safe_sqrt();
        let direction = b * (cos - share * cos_end) + end * share;

        // Its place in the plane (Möller, Trumbore 1997).
        let across = direction.cross(e2);
        let determinant = e1.dot(across);
        let scale = one / F::select(determinant.eq(F::zero()), one, determinant);
        let from = -self.to;
        let b1 = (from.dot(across) * scale).saturate();
        let b2 = (direction.dot(from.cross(e1)) * scale).saturate();
        // Rounding leads out of a triangle.
        let over = (b1 + b2 - one).max(F::zero()).masked(!four) * F::splat(0.5);
        let (b1, b2) = ((b1 - over).max(F::zero()), (b2 - over).max(F::zero()));
        let by_area = self.by_area();
        if by_area.any() {
            let (t1, t2) = triangle(u);
            let (t1, t2) = (F::select(four, u.0, t1), F::select(four, u.1, t2));
            return (F::select(by_area, t1, b1), F::select(by_area, t2, b2));
        }
        (b1, b2)
    }

    /// Density of a direction that [`Seen::sample`] gives, 1/sr, by the squared distance of the point and what the light's
    /// area is from there: times the cosine.
    #[inline(always)]
    pub fn pdf(&self, distance2: F, seen_area: F) -> F {
        let (top, bottom) =
            (F::select(self.by_area(), distance2, F::one()), F::select(self.by_area(), seen_area, self.solid_angle));
        top / bottom.max(F::splat(1e-30))
    }
}

#[cfg(test)]
mod tests;
