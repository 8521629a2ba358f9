use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use wide::f32x8;

use super::*;
use crate::{light::numbers, measure::statistics::chi_square_test};

fn facets(p0: Vec3, e1: Vec3, e2: Vec3, four: bool) -> Facets<f32> {
    Facets {
        p0: V3::from_array(p0.to_array()),
        e1: V3::from_array(e1.to_array()),
        e2: V3::from_array(e2.to_array()),
        four,
    }
}

/// The solid angle of a spherical triangle, by its angles, in f64 (Girard).
fn girard(corners: [DVec3; 3]) -> f64 {
    let [a, b, c] = corners.map(DVec3::normalize);
    let angle = |at: DVec3, p: DVec3, q: DVec3| {
        let side = |v: DVec3| (v - at * v.dot(at)).normalize();
        side(p).angle_between(side(q))
    };
    angle(a, b, c) + angle(b, c, a) + angle(c, a, b) - PI
}

/// Lights near and far, seen from the front and along them: the solid angle is Girard's; points drawn fall into each
/// sixteenth as often as its solid angle says.
#[test]
fn directions_are_uniform_in_the_solid_angle() {
    let mut random = numbers(7);
    let mut checked = 0;
    for case in 0..60 {
        let mut vector = |size: f64| Vec3::from_array(std::array::from_fn(|_| (size * (random() - 0.5)) as f32));
        let (p0, e1, e2) = (vector(4.0), vector(2.0), vector(2.0));
        let four = case % 2 == 0;
        let seen = facets(p0, e1, e2, four).seen_from(V3::splat(0.0));
        let at = |b1: f64, b2: f64| p0.as_dvec3() + e1.as_dvec3() * b1 + e2.as_dvec3() * b2;
        let piece = |x: [f64; 2], y: [f64; 2]| -> f64 {
            let [a, b, c, d] = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| at(x[i], y[j]));
            let first = girard([a, b, c]);
            // Beyond the diagonal there is no triangle.
            if four || x[1] + y[1] <= 1.0 + 1e-9 { first + girard([d, b, c]) } else { first }
        };
        let mut shares = Vec::new();
        for i in 0..4 {
            for j in 0..4 {
                let cell = |i: usize| [i as f64 / 4.0, (i + 1) as f64 / 4.0];
                shares.push(if four || i + j < 4 { piece(cell(i), cell(j)) } else { 0.0 });
            }
        }
        let whole: f64 = shares.iter().sum();
        let got = f64::from(seen.solid_angle);
        assert!((got / whole - 1.0).abs() < 1e-4, "{case}: {got} {whole}");
        if whole < 1e-3 {
            continue;
        }
        checked += 1;
        let mut counts = [0_u64; 16];
        const N: u32 = 40_000;
        for _ in 0..N {
            let u = (random() as f32, random() as f32);
            let (b1, b2) = seen.sample(u);
            assert!(b1 >= 0.0 && b2 >= 0.0 && (four || b1 + b2 <= 1.0 + 1e-6) && b1 <= 1.0 && b2 <= 1.0);
            counts[((b1 * 4.0) as usize).min(3) * 4 + ((b2 * 4.0) as usize).min(3)] += 1;
        }
        // On the rim of an empty cell lies what rounding put there.
        let used: Vec<usize> = (0..16).filter(|&i| shares[i] > 1e-9).collect();
        let counts: Vec<u64> = used.iter().map(|&i| counts[i]).collect();
        let shares: Vec<f64> = used.iter().map(|&i| shares[i]).collect();
        let test = chi_square_test(&counts, &shares);
        assert!(test.p > 1e-5, "{case}: {test:?}");
    }
    assert!(checked > 30, "{checked}");
}

/// A light of a micrometre at ten kilometres: its solid angle is area · cosine / distance².
#[test]
fn small_solid_angles_lose_nothing() {
    for size in [1.0_f32, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6] {
        for tilt in [0.0_f32, 1.0, 1.5, 1.57] {
            let distance = if size < 1e-2 { 1e4 } else { 300.0 };
            let (e1, e2) = (Vec3::X * size, Vec3::new(0.0, tilt.cos(), tilt.sin()) * size);
            let seen = facets(Vec3::Z * distance, e1, e2, true).seen_from(V3::splat(0.0));
            let area = f64::from(size * size);
            let exact = area * f64::from(tilt).cos() / f64::from(distance).powi(2);
            let got = f64::from(seen.solid_angle);
            // The corners are at other angles and distances than the middle.
            let within = 3.0 * f64::from(size / distance) / f64::from(tilt).cos() + 1e-5;
            assert!((got / exact - 1.0).abs() < within, "{size} {tilt}: {got} {exact}");
            assert!(seen.by_area() || seen.solid_angle > SMALL);
            if seen.by_area() {
                assert_eq!(seen.sample((0.25, 0.75)), (0.25, 0.75));
            }
        }
    }
}

#[test]
fn lanes_equal_the_scalar() {
    let mut random = numbers(9);
    let mut vector = |size: f64| -> [f32; 3] { std::array::from_fn(|_| (size * (random() - 0.5)) as f32) };
    for _ in 0..500 {
        let rows: [[[f32; 3]; 3]; 8] = std::array::from_fn(|_| [vector(4.0), vector(1.0), vector(1.0)]);
        let column = |i: usize| V3::<f32x8>::from_fn(|lane| rows[lane][i]);
        let four = <f32x8 as Real>::Mask::from_bits(0b0110_1010);
        let all = Facets { p0: column(0), e1: column(1), e2: column(2), four };
        let seen = all.seen_from(V3::splat(0.0));
        let u = [vector(1.0), vector(1.0)].map(|v| v[0] + 0.5);
        let (b1, b2) = seen.sample((Real::splat(u[0]), Real::splat(u[1])));
        for (lane, [p0, e1, e2]) in rows.into_iter().enumerate() {
            let four = 0b0110_1010 >> lane & 1 == 1;
            let one = facets(p0.into(), e1.into(), e2.into(), four).seen_from(V3::splat(0.0));
            let near = |a: f32, b: f32| (a - b).abs() <= 1e-5 * b.abs().max(0.1);
            assert!(near(seen.solid_angle.lane(lane), one.solid_angle));
            let (c1, c2) = one.sample((u[0], u[1]));
            assert!(near(b1.lane(lane), c1) && near(b2.lane(lane), c2));
        }
    }
}
