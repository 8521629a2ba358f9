//! Ray against box, one at a time: the scalar twin of what the eight-wide tree does.
//!
//! What is promised, and tested below on ten million rays: a ray that meets the closed box within 0 to `t_max` is never
//! said to miss it, flat boxes, touched edges and corners included. A ray said to meet the box meets the one whose faces
//! are each moved outwards by 19/2²⁴ of their distance from the ray's origin, which is 19 units in the last place at most.
//! Both hold as long as nothing overflows or is denormal; a direction component below 2⁻¹²⁶ counts as zero.

use super::{bvh8::FAR_SCALE, triangle::Ray};

/// Distances from and up to which the ray is in the box, within 0 to `t_max`; first above second if it misses.
///
/// Each distance is off by three roundings, (1 ± 2⁻²⁴)³. Leaving, and the end of the ray, count as 16/2²⁴ farther than
/// computed, so that the order of the two is never turned.
#[inline(always)]
pub fn distances(lower: [f32; 3], upper: [f32; 3], ray: &Ray, t_max: f32) -> (f32, f32) {
    let plane = |side: usize, axis: usize| [lower, upper][side][axis];
    let (mut near, mut far) = (0.0, t_max);
    for axis in 0..3 {
        let side = ray.negative(axis);
        let enter = (ray.origin[axis] - plane(side, axis)) * ray.against[axis];
        let leave = (ray.origin[axis] - plane(1 - side, axis)) * ray.against[axis];
        // In this order the NaN of a ray in a slab's plane changes nothing.
        near = if enter > near { enter } else { near };
        far = if leave < far { leave } else { far };
    }
    (near, far * FAR_SCALE)
}

/// The test as lectures have it: a hit if the ray enters the last slab before it leaves the first, and leaves it ahead of
/// its origin.
///
/// Strict, it loses all flat boxes and all rays that only touch; it loses rays in the plane of a face, whose distances are
/// NaN, and others to rounding.
#[inline(always)]
pub fn lecture(lower: [f32; 3], upper: [f32; 3], origin: [f32; 3], direction: [f32; 3]) -> bool {
    let (mut enter, mut exit) = (f32::NEG_INFINITY, f32::INFINITY);
    for axis in 0..3 {
        let [a, b] = [lower, upper].map(|corner| (corner[axis] - origin[axis]) / direction[axis]);
        enter = enter.max(a.min(b));
        exit = exit.min(a.max(b));
    }
    enter < exit && exit >= 0.0
}

#[cfg(test)]
mod tests {
    use rayon::prelude::*;

    use super::*;
    use crate::accel::{
        arena::Granule,
        bvh8::{NODE, Node},
        space::{Beam, Bounds},
    };

    /// All coordinates, directions and ends are multiples of 2⁻³⁰, so that whole numbers decide.
    const UNIT: f64 = 1_073_741_824.0;
    /// How far a face is moved at most to make a false hit right, in 2⁻²⁴ of its distance.
    const GROWN: i128 = 19;

    #[derive(Clone, Copy, Debug)]
    struct Case {
        lower: [f32; 3],
        upper: [f32; 3],
        origin: [f32; 3],
        direction: [f32; 3],
        t_max: f32,
    }

    fn whole(x: f32) -> i128 {
        let units = f64::from(x) * UNIT;
        debug_assert_eq!(units, units.trunc());
        i128::from(units as i64)
    }

    impl Case {
        /// True if the ray meets the closed box whose faces are moved outwards by `grown`/2²⁴ of their distance: exactly.
        fn meets(&self, grown: i128) -> bool {
            const ONE: i128 = 1 << 24;
            // Where slabs are entered and left, over the speed across. Of a ray along a slab, whose speed is zero, the
            // comparisons below say whether it is in it.
            let slabs: [[i128; 3]; 3] = std::array::from_fn(|axis| {
                let (origin, d) = (whole(self.origin[axis]), whole(self.direction[axis]));
                let (below, above) = (whole(self.lower[axis]) - origin, whole(self.upper[axis]) - origin);
                let (first, last) = if d < 0 { (-above, -below) } else { (below, above) };
                [first * ONE - first.abs() * grown, last * ONE + last.abs() * grown, d.abs()]
            });
            let ahead = |[enter, leave, speed]: &[i128; 3]| {
                *leave >= 0 && (self.t_max == f32::INFINITY || enter * (1 << 30) <= whole(self.t_max) * speed * ONE)
            };
            let in_order = |[enter, _, a]: &[i128; 3]| slabs.iter().all(|[_, leave, b]| enter * b <= leave * a);
            slabs.iter().all(ahead) && slabs.iter().all(in_order)
        }

        /// The same in other units: exactly, as these are powers of two.
        fn scaled(&self, space: f32, speed: f32) -> Self {
            Self {
                lower: self.lower.map(|x| x * space),
                upper: self.upper.map(|x| x * space),
                origin: self.origin.map(|x| x * space),
                direction: self.direction.map(|x| x * speed),
                t_max: self.t_max * (space / speed),
            }
        }
    }

    struct Numbers(u64);

    impl Numbers {
        fn bits(&mut self) -> u64 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
        }

        /// One of `count`.
        fn pick(&mut self, count: u64) -> usize {
            (((self.bits() >> 32) * count) >> 32) as usize
        }

        /// In [-2, 3]: whole, or of 24 significant bits at three magnitudes.
        fn coordinate(&mut self, coarse: bool) -> f32 {
            if coarse {
                return self.pick(6) as f32 - 2.0;
            }
            let number = (self.bits() >> 40) as f32 / 16_777_216.0 - 0.5;
            let number = number * [4.0, 0.5, 1.0 / 64.0][self.pick(3)];
            (f64::from(number) * UNIT).trunc() as f32 / UNIT as f32
        }

        /// A box and a ray at it.
        fn case(&mut self) -> Case {
            let coarse = self.pick(3) == 0;
            let mut point = || [0; 3].map(|_| self.coordinate(coarse));
            let (p, q, mut origin, anywhere) = (point(), point(), point(), point());
            let lower: [f32; 3] = std::array::from_fn(|i| p[i].min(q[i]));
            let mut upper: [f32; 3] = std::array::from_fn(|i| p[i].max(q[i]));
            if self.pick(4) == 0 {
                // Flat, or a line, or a point.
                for _ in 0..=self.pick(3) {
                    let axis = self.pick(3);
                    upper[axis] = lower[axis];
                }
            }
            // At a corner, an edge, a face, the inside, anything.
            let mut target = anywhere;
            let fixed = self.pick(4);
            for (axis, x) in target.iter_mut().enumerate().take(fixed) {
                *x = [lower, upper][self.pick(2)][axis];
            }
            if self.pick(2) == 0 {
                target = std::array::from_fn(|i| target[i].clamp(lower[i], upper[i]));
            }
            match self.pick(4) {
                // From inside, from a face's plane, from anywhere.
                0 => origin = std::array::from_fn(|i| origin[i].clamp(lower[i], upper[i])),
                1 => {
                    let axis = self.pick(3);
                    origin[axis] = [lower, upper][self.pick(2)][axis];
                }
                _ => {}
            }
            let zero = [0.0, -0.0][self.pick(2)];
            let away = if self.pick(8) == 0 { -1.0 } else { 1.0 };
            let mut direction: [f32; 3] = std::array::from_fn(|i| away * (target[i] - origin[i]));
            if self.pick(4) == 0 {
                for _ in 0..=self.pick(2) {
                    direction[self.pick(3)] = zero;
                }
            }
            if direction.iter().all(|&d| d == 0.0) {
                direction[self.pick(3)] = away;
            }
            direction = direction.map(|d| if d == 0.0 { zero } else { d });
            let one: f32 = 1.0;
            let t_max = [f32::INFINITY, one, one.next_down(), one.next_up(), 0.5, 0.0][self.pick(6)];
            let t_max = (f64::from(t_max) * UNIT).trunc() as f32 / UNIT as f32;
            Case { lower, upper, origin, direction, t_max }
        }
    }

    /// Rays by what came of them.
    #[derive(Clone, Copy, Debug, Default)]
    struct Seen {
        rays: u64,
        met: u64,
        /// Met boxes without volume.
        flat: u64,
        /// Met from inside or from the surface.
        inside: u64,
        /// Met only because touching counts.
        touching: u64,
        /// Met with a direction component that is zero.
        axial: u64,
        /// Not met because the ray ends before.
        cut: u64,
        /// Not met, but said to be.
        false_hits: u64,
        /// Met, but lost by the lecture's form.
        lost_by_lecture: u64,
    }

    impl Seen {
        fn and(self, other: Self) -> Self {
            Self {
                rays: self.rays + other.rays,
                met: self.met + other.met,
                flat: self.flat + other.flat,
                inside: self.inside + other.inside,
                touching: self.touching + other.touching,
                axial: self.axial + other.axial,
                cut: self.cut + other.cut,
                false_hits: self.false_hits + other.false_hits,
                lost_by_lecture: self.lost_by_lecture + other.lost_by_lecture,
            }
        }
    }

    /// Checks the three forms that the structures use on so many rays, each at a box of its own.
    fn check(rays: u64, seed: u64) -> Seen {
        let mut numbers = Numbers(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        let mut seen = Seen { rays, ..Seen::default() };
        // A node whose boxes are those of the last eight cases.
        let mut granules = [Granule::of([0.0; 8]); NODE];
        for number in 0..rays {
            let small = numbers.case();
            let power = |bits: usize| 2.0_f32.powi(bits as i32 - 16);
            let case = small.scaled(power(numbers.pick(32)), power(numbers.pick(32)));
            let ray = Ray::new(case.origin, case.direction);
            let lane = number as usize % 8;
            for axis in 0..3 {
                granules[2 * axis].0[lane] = case.lower[axis].to_bits();
                granules[2 * axis + 1].0[lane] = case.upper[axis].to_bits();
            }
            let (near, far) = Node::at(&granules, 0).distances(&ray, case.t_max);
            let (near, far) = (near.to_array(), far.to_array());
            let twin = distances(case.lower, case.upper, &ray, case.t_max);
            let bits = |(near, far): (f32, f32)| (near.to_bits(), far.to_bits());
            assert_eq!(bits((near[lane], far[lane])), bits(twin), "{case:?}: the twins differ");
            if number % 64 == 63 {
                for lane in 0..8 {
                    let corner = |side: usize| [0, 1, 2].map(|axis| granules[2 * axis + side].values()[lane]);
                    let twin = distances(corner(0), corner(1), &ray, case.t_max);
                    assert_eq!(bits((near[lane], far[lane])), bits(twin), "{case:?}: the twins differ");
                }
            }
            let said = twin.0 <= twin.1;
            let met = small.meets(0);
            assert!(said || !met, "{case:?} is met, but said to be missed: {twin:?}");
            if met {
                let bounds = Bounds { lower: case.lower, upper: case.upper };
                let (from, to) = Beam::new(&ray, &bounds).within(&bounds, case.t_max);
                assert!(from <= to, "{case:?} is met, but not by a beam: {from} {to}");
                let axes = || 0..3;
                let holds =
                    |axis: usize| case.lower[axis] <= case.origin[axis] && case.origin[axis] <= case.upper[axis];
                seen.met += 1;
                seen.flat += u64::from(axes().any(|axis| case.lower[axis] == case.upper[axis]));
                seen.inside += u64::from(axes().all(holds));
                seen.touching += u64::from(!small.meets(-1));
                seen.axial += u64::from(case.direction.contains(&0.0));
                let lecture = lecture(case.lower, case.upper, case.origin, case.direction);
                seen.lost_by_lecture += u64::from(!lecture);
            } else {
                seen.cut += u64::from(Case { t_max: f32::INFINITY, ..small }.meets(0));
                if said {
                    seen.false_hits += 1;
                    assert!(small.meets(GROWN), "{case:?} is farther off than {GROWN}/2²⁴: {twin:?}");
                }
            }
        }
        seen
    }

    /// The eight-wide test and its twin, and the beam of the other structures, against whole numbers.
    #[test]
    fn no_box_that_is_met_is_missed_in_ten_million_rays() {
        const PARTS: u64 = 50;
        const RAYS: u64 = 10_000_000;
        let parts = (0..PARTS).into_par_iter().map(|part| check(RAYS / PARTS, part + 1));
        let seen = parts.reduce(Seen::default, Seen::and);
        println!("{seen:?}");
        assert_eq!(seen.rays, RAYS);
        let Seen { met, flat, inside, touching, axial, cut, false_hits, lost_by_lecture, .. } = seen;
        for (what, count) in [
            ("met", met),
            ("flat", flat),
            ("inside", inside),
            ("touching", touching),
            ("axial", axial),
            ("cut", cut),
            ("said to be met", false_hits),
            ("lost by the lecture's form", lost_by_lecture),
        ] {
            assert!(count > RAYS / 100, "{what}: {count} of {RAYS} are too few to mean anything");
        }
    }

    /// A ray straight through a flat box: the closed test meets it, the lecture's `enter < exit` does not.
    #[test]
    fn flat_boxes_are_met_unlike_in_the_lecture() {
        let (lower, upper) = ([-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]);
        let (origin, direction) = ([0.25, 0.5, 3.0], [0.0, 0.0, -1.0]);
        let (near, far) = distances(lower, upper, &Ray::new(origin, direction), f32::INFINITY);
        assert!(near <= 3.0 && 3.0 <= far && near > 2.999 && far < 3.001);
        assert!(!lecture(lower, upper, origin, direction));
        assert!(lecture(lower, [1.0, 1.0, 0.001], origin, direction));
        let (near, far) = distances(lower, upper, &Ray::new(origin, direction), 2.9);
        assert!(near > far, "beyond the end");
    }
}
