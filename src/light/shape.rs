//! Points on surfaces given by a formula.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use crate::world::Shape;

/// How densely points are drawn, in local space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Density {
    /// Per m² of the surface.
    Area(f64),
    /// Per sr of the directions to it.
    SolidAngle(f64),
}

/// On the unit circle.
fn on_circle(u: f64) -> DVec2 {
    DVec2::from_angle(TAU * u)
}

impl Shape {
    /// A point of the surface in local space, m, uniform by area there. A plane has no such point: its origin is given.
    #[inline]
    pub fn sample(&self, u: (f32, f32)) -> DVec3 {
        let (u0, u1) = (f64::from(u.0), f64::from(u.1));
        match *self {
            Self::Sphere { radius } => {
                // Archimedes: as much of a sphere lies between two heights as of the cylinder around it.
                let y = 1.0 - 2.0 * u0;
                let DVec2 { x, y: z } = (1.0 - y * y).max(0.0).sqrt() * on_circle(u1);
                f64::from(radius) * DVec3::new(x, y, z)
            }
            Self::Cylinder { radius, half_height } => {
                let DVec2 { x, y: z } = f64::from(radius) * on_circle(u1);
                DVec3::new(x, f64::from(half_height) * (1.0 - 2.0 * u0), z)
            }
            Self::Disc { radius } => {
                let DVec2 { x, y: z } = f64::from(radius) * u0.sqrt() * on_circle(u1);
                DVec3::new(x, 0.0, z)
            }
            Self::Plane => DVec3::ZERO,
        }
    }

    /// A point of the surface that is seen from `eye`, both in local space, and how densely such are drawn.
    ///
    /// Spheres are drawn from by the solid angle that they take, cylinders by the half that faces the eye. Of discs all points are
    /// seen, and their solid angle, an elliptic integral, would cost more than it saves.
    #[inline]
    pub fn sample_seen(&self, eye: DVec3, two_sided: bool, u: (f32, f32)) -> (DVec3, Density) {
        let (u0, u1) = (f64::from(u.0), f64::from(u.1));
        let density = self.density_seen(eye, two_sided);
        let point = match (*self, density) {
            (Self::Sphere { radius }, Density::SolidAngle(density)) => {
                let (radius, distance) = (f64::from(radius), eye.length());
                let sin2_most = (radius / distance).powi(2);
                // 1 − cos of the angle at the eye.
                let versine = u0 / (TAU * density);
                let sin2 = versine * (2.0 - versine);
                // Of the angle at the middle.
                let cos =
                    (sin2 / sin2_most.sqrt() + (1.0 - versine) * (1.0 - sin2 / sin2_most).max(0.0).sqrt()).min(1.0);
                let axis = eye / distance;
                let (side, other) = axis.any_orthonormal_pair();
                let DVec2 { x, y } = (1.0 - cos * cos).sqrt() * on_circle(u1);
                radius * (axis * cos + side * x + other * y)
            }
            (Self::Cylinder { radius, half_height }, Density::Area(_)) if !two_sided => {
                let (half, radius) = (half_turn_seen(eye, radius.into()), f64::from(radius));
                let middle = eye.z.atan2(eye.x);
                let DVec2 { x, y: z } = radius * DVec2::from_angle(middle + half * (2.0 * u1 - 1.0));
                DVec3::new(x, f64::from(half_height) * (1.0 - 2.0 * u0), z)
            }
            _ => self.sample(u),
        };
        (point, density)
    }

    /// How densely [`Shape::sample_seen`] draws those points that may be seen.
    #[inline]
    pub fn density_seen(&self, eye: DVec3, two_sided: bool) -> Density {
        match *self {
            Self::Sphere { radius } => {
                let sin2 = f64::from(radius).powi(2) / eye.length_squared();
                // A surface that touches it sees half of all, and is not told from one inside.
                if sin2 < 1.0 - 1e-6 {
                    return Density::SolidAngle((1.0 + (1.0 - sin2).sqrt()) / (TAU * sin2));
                }
            }
            Self::Cylinder { radius, .. } if !two_sided => {
                return Density::Area(PI / (half_turn_seen(eye, radius.into()) * self.area()));
            }
            _ => {}
        }
        Density::Area(1.0 / self.area())
    }

    /// Mean squares of the coordinates over the surface, m²; none of a plane.
    pub fn mean_squares(&self) -> [f32; 3] {
        match *self {
            Self::Sphere { radius } => [radius * radius / 3.0; 3],
            Self::Cylinder { radius, half_height } => {
                [radius * radius / 2.0, half_height * half_height / 3.0, radius * radius / 2.0]
            }
            Self::Disc { radius } => [radius * radius / 4.0, 0.0, radius * radius / 4.0],
            Self::Plane => [0.0; 3],
        }
    }
}

/// Half the turn of a tube around Y whose outside is seen from `eye`, rad; all of it from within.
#[inline]
fn half_turn_seen(eye: DVec3, radius: f64) -> f64 {
    let away = eye.x.hypot(eye.z);
    if away > radius { (radius / away).acos().max(1e-3) } else { PI }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points lie on the surface; as many on each of eight parts of equal area, to five standard deviations.
    #[test]
    fn points_are_uniform_by_area() {
        const N: u32 = 400;
        let shapes = [
            Shape::Sphere { radius: 2.0 },
            Shape::Disc { radius: 2.0 },
            Shape::Cylinder { radius: 2.0, half_height: 3.0 },
        ];
        for shape in shapes {
            let mut counts = [0_u32; 8];
            for i in 0..N * N {
                let u = [i % N, i / N].map(|i| (i as f32 + 0.5) / N as f32);
                let p = shape.sample((u[0], u[1]));
                let across = p.x.hypot(p.z);
                let (off, half) = match shape {
                    Shape::Sphere { .. } => (p.length() - 2.0, p.y > 1.0),
                    // A circle of half the area has the radius 2/√2.
                    Shape::Disc { .. } => (p.y + (across - 2.0).max(0.0), across * across > 2.0),
                    _ => (across - 2.0 + (p.y.abs() - 3.0).max(0.0), p.y > 1.5),
                };
                assert!(off.abs() < 1e-12, "{shape:?} {p}");
                let quarter = usize::from(p.x > 0.0) + 2 * usize::from(p.z > 0.0);
                counts[quarter + 4 * usize::from(half)] += 1;
            }
            let share = if matches!(shape, Shape::Disc { .. }) { 0.5 } else { 0.25 };
            for (part, &count) in counts.iter().enumerate() {
                let want = f64::from(N * N) / 4.0 * if part < 4 { 1.0 - share } else { share };
                // The grid is more even than chance; its lines along the borders are not.
                assert!((f64::from(count) - want).abs() < 5.0 * want.sqrt(), "{shape:?}: {counts:?}");
            }
        }
    }

    /// Integrals over what is seen of a shape, by directions: as [`Shape::sample_seen`] gives them and as points over the
    /// whole surface do, of which those that face away count for nothing.
    #[test]
    fn points_that_are_seen_stand_for_all() {
        const N: u32 = 600;
        let shapes = [
            Shape::Sphere { radius: 2.0 },
            Shape::Disc { radius: 2.0 },
            Shape::Cylinder { radius: 2.0, half_height: 3.0 },
        ];
        let eyes = [[0.3, 4.0, 1.0], [-3.0, 0.5, 0.1], [2.3, -0.2, 1.5], [40.0, -70.0, 10.0], [0.4, 5.0, -0.3]];
        for (shape, eye) in shapes.into_iter().flat_map(|shape| eyes.map(|eye| (shape, DVec3::from_array(eye)))) {
            let mean = |f: &dyn Fn((f32, f32)) -> [f64; 3]| {
                let at = |i: u32| f([i % N, i / N].map(|i| (i as f32 + 0.5) / N as f32).into());
                let all = (0..N * N).map(at).fold([0.0; 3], |sum, one| [0, 1, 2].map(|i| sum[i] + one[i]));
                all.map(|sum| sum / f64::from(N * N))
            };
            let per_area = |p: DVec3| {
                let to_eye = eye - p;
                (shape.normal(p).dot(to_eye) / to_eye.length().powi(3)).max(0.0)
            };
            let moments = |p: DVec3, weight: f64| [1.0, 1.0 + p.x * 0.3 + 0.1 * p.y, p.z * p.z].map(|f| f * weight);
            let want = mean(&|u| {
                let p = shape.sample(u);
                moments(p, per_area(p) * shape.area())
            });
            let got = mean(&|u| {
                let (p, density) = shape.sample_seen(eye, false, u);
                assert_eq!(density, shape.density_seen(eye, false));
                match density {
                    Density::Area(density) => moments(p, per_area(p) / density),
                    Density::SolidAngle(density) => {
                        assert!((p.length() - 2.0).abs() < 1e-9 && per_area(p) > -1e-9, "{p}");
                        moments(p, 1.0 / density)
                    }
                }
            });
            for (got, want) in got.into_iter().zip(want) {
                assert!((got - want).abs() < 4e-3 * want.abs().max(1e-12), "{shape:?} {eye}: {got} {want}");
            }
        }
    }

    /// A ball of a nanometre at a thousand kilometres, and an eye that touches one.
    #[test]
    fn balls_are_seen_from_far_and_near() {
        let ball = Shape::Sphere { radius: 1e-9 };
        let radius = f64::from(1e-9_f32);
        let (point, density) = ball.sample_seen(DVec3::X * 1e6, false, (0.7, 0.2));
        let Density::SolidAngle(density) = density else { panic!("{density:?}") };
        assert!(
            (density * PI * (radius / 1e6).powi(2) - 1.0).abs() < 1e-6 && (point.length() / radius - 1.0).abs() < 1e-6
        );
        assert!(matches!(ball.density_seen(DVec3::X * radius, false), Density::Area(_)));
        assert!(matches!(ball.density_seen(DVec3::X * 0.1 * radius, true), Density::Area(_)));
    }
}
