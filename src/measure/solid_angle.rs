//! Solid angles by formula, and integrals over directions by dω = sin θ dθ dφ.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

/// All directions, sr.
pub const SPHERE: f64 = 4.0 * PI;

/// Directions within a half angle of an axis, rad: 2π(1 − cos α), written so that small ones keep their digits.
pub fn cap(half_angle: f64) -> f64 {
    2.0 * TAU * (0.5 * half_angle).sin().powi(2)
}

/// Directions from the origin to a triangle (Van Oosterom, Strackee 1983, "The Solid Angle of a Plane Triangle").
pub fn triangle([a, b, c]: [DVec3; 3]) -> f64 {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let numerator = a.dot(b.cross(c));
    let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    (2.0 * numerator.abs().atan2(denominator)).rem_euclid(TAU)
}

/// Directions from the origin to a rectangle of edges `a` and `b` whose middle is at distance `d`, and which faces it:
/// 4 arcsin(ab / √((a² + 4d²)(b² + 4d²))).
pub fn rectangle(a: f64, b: f64, d: f64) -> f64 {
    4.0 * (a * b / ((a * a + 4.0 * d * d) * (b * b + 4.0 * d * d)).sqrt()).asin()
}

/// ∫ f(ω) dω over the sphere by the midpoint rule in θ and φ, `steps` by twice as many: dω = sin θ dθ dφ.
pub fn integrate(steps: u32, f: impl Fn(DVec3) -> f64) -> f64 {
    let step = PI / f64::from(steps);
    let mut sum = 0.0;
    for i in 0..steps {
        let (sin, cos) = ((f64::from(i) + 0.5) * step).sin_cos();
        for j in 0..2 * steps {
            let (y, x) = ((f64::from(j) + 0.5) * step).sin_cos();
            sum += f(DVec3::new(sin * x, sin * y, cos)) * sin * step * step;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{tests::numbers, warp};

    /// Rays at a triangle (Möller, Trumbore 1997).
    fn meets(triangle: [DVec3; 3], direction: DVec3) -> bool {
        let [e1, e2] = [triangle[1] - triangle[0], triangle[2] - triangle[0]];
        let p = direction.cross(e2);
        let determinant = e1.dot(p);
        let s = -triangle[0];
        let u = s.dot(p) / determinant;
        let q = s.cross(e1);
        let v = direction.dot(q) / determinant;
        determinant.abs() > 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && e2.dot(q) / determinant > 0.0
    }

    /// Each by its formula, by quadrature and by directions drawn evenly from the sphere, of which so many land inside.
    #[test]
    fn formulas_quadrature_and_sampling_agree() {
        let flat = [DVec3::new(0.3, -0.8, 1.0), DVec3::new(1.4, 0.2, 0.9), DVec3::new(-0.5, 0.9, 1.3)];
        let behind = [DVec3::new(0.1, -0.9, 0.2), DVec3::new(1.0, 0.8, -0.4), DVec3::new(-1.1, 0.7, 0.1)];
        let (a, b, d) = (1.3, 0.7, 0.8);
        let on_rectangle = move |w: DVec3| {
            let at = w * (d / w.z);
            w.z > 0.0 && at.x.abs() <= 0.5 * a && at.y.abs() <= 0.5 * b
        };
        type Inside = Box<dyn Fn(DVec3) -> bool>;
        let cases: [(&str, f64, Inside); 6] = [
            ("sphere", SPHERE, Box::new(|_| true)),
            ("hemisphere", cap(PI / 2.0), Box::new(|w| w.y > 0.0)),
            ("cap", cap(0.6), Box::new(|w| w.dot(DVec3::new(0.6, 0.0, 0.8)) > 0.6_f64.cos())),
            ("triangle", triangle(flat), Box::new(move |w| meets(flat, w))),
            ("triangle around", triangle(behind), Box::new(move |w| meets(behind, w))),
            ("rectangle", rectangle(a, b, d), Box::new(on_rectangle)),
        ];
        for (name, formula, inside) in cases {
            let by_steps = integrate(1000, |w| f64::from(u8::from(inside(w))));
            const N: u32 = 200_000;
            let drawn = numbers(7, N).filter(|&u| {
                let w: [f32; 3] = warp::uniform_sphere::<f32>(u).lane(0);
                inside(DVec3::from_array(w.map(f64::from)))
            });
            let share = drawn.count() as f64 / f64::from(N);
            let noise = (share * (1.0 - share) / f64::from(N)).sqrt() * SPHERE;
            println!(
                "{name}: {formula:.5} by formula, {by_steps:.5} by quadrature, {:.5} ± {noise:.5} drawn",
                share * SPHERE
            );
            assert!((by_steps / formula - 1.0).abs() < 2e-3, "{name}: {formula} {by_steps}");
            assert!((share * SPHERE - formula).abs() <= 4.0 * noise + 1e-9, "{name}: {formula} {share}");
        }
        // ∫ cos θ dω over a hemisphere is π.
        assert!((integrate(1000, |w| w.z.max(0.0)) - PI).abs() < 1e-5);
        assert!((cap(1e-6) / (PI * 1e-12) - 1.0).abs() < 1e-9);
    }
}
