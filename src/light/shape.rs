//! Points on surfaces given by a formula.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use crate::world::Shape;

impl Shape {
    /// A point of the surface in local space, m, uniform by area there. A plane has no such point: its origin is given.
    #[inline]
    pub fn sample(&self, u: (f32, f32)) -> DVec3 {
        let (u0, u1) = (f64::from(u.0), f64::from(u.1));
        let on_circle = |u: f64| DVec2::from_angle(TAU * u);
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
}
