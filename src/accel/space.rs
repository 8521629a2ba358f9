//! What the structures of one mesh share: its triangles, boxes, and a ray as thick as its rounding errors.
//!
//! [`super::intersect`] rounds, so that a ray may meet a triangle that it passes by at a small distance. A structure that
//! divides space must look for it on both sides of a plane that is as near. This is decided by a [`Beam`] during the walk
//! and not by fattening what is built, because the distance grows with that of the ray's origin.

use super::{Cell, Counters, Nearest, Ray, Shape, TriangleHit, intersect, triangle::has_area};

/// How far beside a triangle a hit may be, per distance from the ray's origin: 32 units in the last place.
///
/// A bound of the roundings of [`super::intersect`], in such units: 5 shear a corner, 2 round the products of an edge
/// function, 9 round `t`; another 3 round the distance to a plane. Rounded up generously, which costs nothing.
///
/// Not covered are rays so nearly in the plane of a triangle that its edge functions are noise: where their signs agree
/// by chance, the hit may be anywhere along the triangle. [`blur`] is for triangles that are as thin from all sides.
const SLACK: f32 = 16.0 * f32::EPSILON;

/// A box, with its faces.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Bounds {
    /// Lowest coordinates.
    pub lower: [f32; 3],
    /// Highest coordinates.
    pub upper: [f32; 3],
}

impl Bounds {
    /// Around nothing.
    pub const EMPTY: Self = Self { lower: [f32::INFINITY; 3], upper: [f32::NEG_INFINITY; 3] };

    /// Around points.
    pub fn of(points: &[[f32; 3]]) -> Self {
        points.iter().fold(Self::EMPTY, |all, &point| all.union(&Self { lower: point, upper: point }))
    }

    /// Around both.
    pub fn union(&self, other: &Self) -> Self {
        Self {
            lower: std::array::from_fn(|axis| self.lower[axis].min(other.lower[axis])),
            upper: std::array::from_fn(|axis| self.upper[axis].max(other.upper[axis])),
        }
    }

    /// What both hold; lower above upper where that is nothing.
    pub fn intersection(&self, other: &Self) -> Self {
        Self {
            lower: std::array::from_fn(|axis| self.lower[axis].max(other.lower[axis])),
            upper: std::array::from_fn(|axis| self.upper[axis].min(other.upper[axis])),
        }
    }

    /// Larger on all sides.
    pub fn padded(&self, pad: f64) -> Self {
        if pad == 0.0 {
            return *self;
        }
        Self {
            lower: self.lower.map(|x| ((f64::from(x) - pad) as f32).next_down()),
            upper: self.upper.map(|x| ((f64::from(x) + pad) as f32).next_up()),
        }
    }

    /// False if lower is above upper.
    pub fn valid(&self) -> bool {
        (0..3).all(|axis| self.lower[axis] <= self.upper[axis])
    }

    /// Lengths of the edges. In f64, because those of finite boxes may overflow.
    pub fn size(&self) -> [f64; 3] {
        std::array::from_fn(|axis| f64::from(self.upper[axis]) - f64::from(self.lower[axis]))
    }

    /// As a structure shows its cells.
    pub fn cell(&self, depth: usize, held: Option<usize>) -> Cell<'static> {
        Cell { depth, held, shape: Shape::Box { lower: self.lower, upper: self.upper } }
    }

    /// Both parts of a box divided by a plane.
    pub fn split(&self, axis: usize, at: f32) -> [Self; 2] {
        let [mut below, mut above] = [*self; 2];
        below.upper[axis] = at;
        above.lower[axis] = at;
        [below, above]
    }
}

/// The triangles of a mesh that have an area.
#[derive(Clone, Debug)]
pub(super) struct Soup {
    /// Row and corners of each; an index into it is a reference.
    pub triangles: Vec<(u32, [[f32; 3]; 3])>,
    /// Around all of them and where their hits may be.
    pub bounds: Bounds,
    /// Blur that the [`margin`] of any ray covers.
    covered: f64,
}

impl Soup {
    /// Leaves out triangles without area.
    pub fn new(triangles: &[[[f32; 3]; 3]]) -> Self {
        let triangles: Vec<_> = (0..).zip(triangles.iter().copied()).filter(|(_, corners)| has_area(corners)).collect();
        let bounds = triangles.iter().fold(Bounds::EMPTY, |all, (_, corners)| all.union(&Bounds::of(corners)));
        // No origin is nearer to the farthest corner than half the longest edge; half of it is left for other errors.
        let covered = covered(&bounds);
        let mut soup = Self { triangles, bounds, covered };
        soup.bounds = (0..soup.triangles.len()).fold(bounds, |all, index| all.union(&soup.bounds_of(index)));
        soup
    }

    /// How far from a triangle its hits may be because it is thin.
    pub fn blur(&self, index: usize) -> f64 {
        blur(&self.triangles[index].1, self.covered)
    }

    /// The box around a triangle and where its hits may be.
    pub fn bounds_of(&self, index: usize) -> Bounds {
        blurred(&self.triangles[index].1, self.covered)
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(self.triangles.as_slice())
    }

    /// Offers to `best` what the ray meets among the triangles referred to.
    #[inline(always)]
    pub fn nearest(
        &self,
        references: impl ExactSizeIterator<Item = u32>,
        ray: &Ray,
        best: &mut Nearest,
        accept: &impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    ) {
        counters.triangles(references.len());
        for reference in references {
            let (row, corners) = &self.triangles[reference as usize];
            if let Some(hit) = intersect(ray, corners, best.t) {
                best.offer(*row, &hit, accept);
            }
        }
    }

    /// True if the ray meets one of the triangles referred to, up to `t_max`.
    #[inline(always)]
    pub fn occluded(
        &self,
        references: impl Iterator<Item = u32>,
        ray: &Ray,
        t_max: f32,
        accept: &impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    ) -> bool {
        let mut tested = 0;
        let found = references.into_iter().any(|reference| {
            tested += 1;
            let (row, corners) = &self.triangles[reference as usize];
            intersect(ray, corners, t_max).is_some_and(|hit| accept(*row, &hit))
        });
        counters.triangles(tested);
        found
    }
}

/// Blur that the [`margin`] of any ray covers, for triangles within bounds.
pub(super) fn covered(bounds: &Bounds) -> f64 {
    let [x, y, z] = bounds.size();
    0.25 * f64::from(SLACK) * x.max(y).max(z)
}

/// The box around a triangle and where its hits may be, but for what is [`covered`].
pub(super) fn blurred(corners: &[[f32; 3]; 3], covered: f64) -> Bounds {
    Bounds::of(corners).padded(blur(corners, covered))
}

/// How far from a triangle its hits may be because it is thin; zero unless it is so thin that this matters.
///
/// Edge functions are off by about ε·l², where l is the longest edge, the barycentrics by ε·l²/(l·h), where h is the
/// height over it, and `t`, which is mixed by them, by ε·l²/h.
pub(super) fn blur(corners: &[[f32; 3]; 3], covered: f64) -> f64 {
    let [a, b, c] = corners.map(|corner| corner.map(f64::from));
    let between = |from: [f64; 3], to: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| to[i] - from[i]) };
    let square = |[x, y, z]: [f64; 3]| x * x + y * y + z * z;
    let (e, f) = (between(a, b), between(a, c));
    let normal = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
    let longest = square(e).max(square(f)).max(square(between(b, c))).sqrt();
    let height = square(normal).sqrt() / longest;
    let blur = (4.0 * f64::from(f32::EPSILON) * longest * longest / height).min(longest);
    if blur > covered { blur } else { 0.0 }
}

/// A ray as thick as its rounding errors.
///
/// A hit at `t` is a point of a triangle within the beam at `t`: whoever visits at `t` all that the beam meets there
/// finds the hit. Distances along a beam that runs in a plane may be NaN; compare so that NaN goes on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beam {
    /// Origins from which planes are met early and late.
    early: [f32; 3],
    /// As above.
    late: [f32; 3],
    /// One over each component of the direction.
    inverse: [f32; 3],
    /// 1 for each component that runs towards smaller coordinates, else 0.
    negative: [usize; 3],
}

/// How far beside the ray its hits may be, for triangles within bounds.
#[inline(always)]
pub(super) fn margin(ray: &Ray, bounds: &Bounds) -> f32 {
    let reach = |axis: usize| {
        let [below, above] = [bounds.lower, bounds.upper].map(|corner| (corner[axis] - ray.origin[axis]).abs());
        below.max(above)
    };
    SLACK * reach(0).max(reach(1)).max(reach(2))
}

impl Beam {
    /// Between two rays: that which comes to planes first and that which comes last; one over each component of their
    /// direction, and 1 for those that are negative.
    #[inline(always)]
    pub fn between(early: [f32; 3], late: [f32; 3], inverse: [f32; 3], negative: [usize; 3]) -> Self {
        Self { early, late, inverse, negative }
    }

    /// For triangles within bounds.
    #[inline(always)]
    pub fn new(ray: &Ray, bounds: &Bounds) -> Self {
        let margin = margin(ray, bounds);
        // Far from zero the margin may be less than the origin's last place, and would be lost.
        let ahead = ray.origin.map(|x| x + (margin + f32::EPSILON * x.abs()));
        let behind = ray.origin.map(|x| x - (margin + f32::EPSILON * x.abs()));
        let of = |positive: [f32; 3], negative: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|axis| if ray.negative(axis) == 0 { positive[axis] } else { negative[axis] })
        };
        Self {
            early: of(ahead, behind),
            late: of(behind, ahead),
            inverse: ray.inverse,
            negative: [0, 1, 2].map(|axis| ray.negative(axis)),
        }
    }

    /// Distance at which the beam first meets a plane across an axis.
    #[inline(always)]
    pub fn early(&self, axis: usize, plane: f32) -> f32 {
        (plane - self.early[axis]) * self.inverse[axis]
    }

    /// Distance at which the beam last meets a plane across an axis.
    #[inline(always)]
    pub fn late(&self, axis: usize, plane: f32) -> f32 {
        (plane - self.late[axis]) * self.inverse[axis]
    }

    /// 1 if the beam runs towards smaller coordinates, else 0.
    #[inline(always)]
    pub fn negative(&self, axis: usize) -> usize {
        self.negative[axis]
    }

    /// Distances from and up to which the beam is in the box, within 0 to `t_max`; first above second if it misses it.
    #[inline(always)]
    pub fn within(&self, bounds: &Bounds, t_max: f32) -> (f32, f32) {
        let planes = [bounds.lower, bounds.upper];
        let (mut from, mut to) = (0.0, t_max);
        for axis in 0..3 {
            let enter = self.early(axis, planes[self.negative[axis]][axis]);
            let leave = self.late(axis, planes[1 - self.negative[axis]][axis]);
            // In this order NaN changes nothing.
            from = if enter > from { enter } else { from };
            to = if leave < to { leave } else { to };
        }
        (from, to)
    }
}

/// A part of a triangle: a convex polygon. In f64, so that its error is far below [`margin`].
pub(super) type Polygon = Vec<[f64; 3]>;

/// The part of a polygon where `distance` (linear in the point) is at least zero.
pub(super) fn cut(polygon: &[[f64; 3]], into: &mut Polygon, distance: impl Fn(&[f64; 3]) -> f64) {
    into.clear();
    let Some(last) = polygon.last() else { return };
    let (mut p, mut at_p) = (last, distance(last));
    for q in polygon {
        let at_q = distance(q);
        if at_p * at_q < 0.0 {
            let share = at_p / (at_p - at_q);
            into.push(std::array::from_fn(|axis| p[axis] + share * (q[axis] - p[axis])));
        }
        if at_q >= 0.0 {
            into.push(*q);
        }
        (p, at_p) = (q, at_q);
    }
}

/// Space to cut polygons in.
#[derive(Debug, Default)]
pub(super) struct Scissors([Polygon; 2]);

impl Scissors {
    /// The part of a triangle within a box (Sutherland, Hodgman 1974, "Reentrant Polygon Clipping").
    pub fn clip(&mut self, corners: &[[f32; 3]; 3], cell: &Bounds) -> &[[f64; 3]] {
        let Self([polygon, spare]) = self;
        polygon.clear();
        polygon.extend(corners.map(|corner| corner.map(f64::from)));
        for axis in 0..3 {
            let (lower, upper) = (f64::from(cell.lower[axis]), f64::from(cell.upper[axis]));
            if polygon.iter().any(|p| p[axis] < lower) {
                cut(polygon, spare, |p| p[axis] - lower);
                std::mem::swap(polygon, spare);
            }
            if polygon.iter().any(|p| p[axis] > upper) {
                cut(polygon, spare, |p| upper - p[axis]);
                std::mem::swap(polygon, spare);
            }
        }
        polygon
    }

    /// The box around the part of a triangle and its blur within a box, if there is one.
    pub fn clipped_bounds(&mut self, corners: &[[f32; 3]; 3], blur: f64, cell: &Bounds) -> Option<Bounds> {
        // Rounded to the nearest: what that leaves out is less than a beam is thick.
        let points = self.clip(corners, &cell.padded(blur)).iter().map(|p| p.map(|x| x as f32));
        let bounds = points.fold(Bounds::EMPTY, |all, p| all.union(&Bounds { lower: p, upper: p }));
        let bounds = bounds.padded(blur).intersection(cell);
        bounds.valid().then_some(bounds)
    }
}

/// True if a triangle and a box have a point in common, for boxes given by centre and half their size.
///
/// By separating axes: the box's, the triangle's normal, and the nine between their edges (Akenine-Möller 2001, "Fast
/// 3D Triangle-Box Overlap Testing"). In f64, so that its error is far below [`margin`].
pub(super) fn overlaps(corners: &[[f32; 3]; 3], center: [f64; 3], half: [f64; 3]) -> bool {
    let [a, b, c] = corners.map(|corner| -> [f64; 3] { std::array::from_fn(|i| f64::from(corner[i]) - center[i]) });
    for axis in 0..3 {
        let (low, high) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
        if low > half[axis] || high < -half[axis] {
            return false;
        }
    }
    let between = |from: &[f64; 3], to: &[f64; 3]| -> [f64; 3] { std::array::from_fn(|i| to[i] - from[i]) };
    let dot = |v: &[f64; 3], w: &[f64; 3]| v[0] * w[0] + v[1] * w[1] + v[2] * w[2];
    let cross = |v: &[f64; 3], w: &[f64; 3]| -> [f64; 3] {
        std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            v[j] * w[k] - v[k] * w[j]
        })
    };
    let edges = [between(&a, &b), between(&b, &c), between(&c, &a)];
    let apart = |along: &[f64; 3]| {
        let reach = dot(&half, &along.map(f64::abs));
        let (x, y, z) = (dot(&a, along), dot(&b, along), dot(&c, along));
        x.min(y).min(z) > reach || x.max(y).max(z) < -reach
    };
    if apart(&cross(&edges[0], &edges[1])) {
        return false;
    }
    !edges.iter().any(|edge| {
        (0..3).any(|axis| {
            let unit = std::array::from_fn(|i| f64::from(u8::from(i == axis)));
            apart(&cross(edge, &unit))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::family::numbers;

    /// Two ways to tell whether a triangle and a box overlap say the same of 20,000 random pairs.
    #[test]
    fn clipping_and_separating_axes_agree() {
        let mut u = numbers(3);
        let mut scissors = Scissors::default();
        let mut overlapping = 0;
        for case in 0..20_000 {
            let mut point = || [u() * 3.0 - 1.0, u() * 3.0 - 1.0, u() * 3.0 - 1.0];
            let corners = [point(), point(), point()];
            let cell = Bounds { lower: [0.0; 3], upper: [1.0, 0.5, 0.25] };
            let by_axes = overlaps(&corners, [0.5, 0.25, 0.125], [0.5, 0.25, 0.125]);
            assert_eq!(scissors.clipped_bounds(&corners, 0.0, &cell).is_some(), by_axes, "case {case}");
            overlapping += u32::from(by_axes);
        }
        assert!((2_000..18_000).contains(&overlapping), "{overlapping}");
    }

    /// A triangle whose corners are cut off by x ≤ 1 keeps the part of its box that is left, not more.
    #[test]
    fn a_clipped_triangle_has_the_bounds_of_what_is_left() {
        let corners = [[0.0, 0.0, 0.0], [2.0, 2.0, 0.0], [2.0, 0.0, 2.0]];
        let cell = Bounds { lower: [0.0; 3], upper: [1.0, 4.0, 4.0] };
        let got = Scissors::default().clipped_bounds(&corners, 0.0, &cell).unwrap();
        assert_eq!(got, Bounds { lower: [0.0; 3], upper: [1.0; 3] });
        let beside = Bounds { lower: [0.0, 3.0, 0.0], upper: [4.0; 3] };
        assert_eq!(Scissors::default().clipped_bounds(&corners, 0.0, &beside), None);
    }

    /// Of a ray that runs in a face of a box, and of one a millionth of its way beside it, the beam meets the box;
    /// of one a thousandth beside it, not.
    #[test]
    fn a_beam_meets_what_its_ray_only_touches() {
        let cell = Bounds { lower: [0.0; 3], upper: [1.0; 3] };
        for (x, meets) in [(1.0, true), (1.0 + 1e-6, true), (1.001, false), (-1e-6, true), (-0.001, false)] {
            for z in [0.0, -0.0] {
                let ray = Ray::new([x, -1.0, 0.5], [z, 1.0, z]);
                let (from, to) = Beam::new(&ray, &cell).within(&cell, f32::INFINITY);
                assert_eq!(from <= to, meets, "{x} {from} {to}");
                assert!(!meets || from <= 1.0 && to >= 2.0);
            }
        }
    }
}
