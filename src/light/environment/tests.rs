//! Look-up and sampling of skies of which all is known.

use std::f64::consts::PI;

use wide::f32x8;

use super::*;
use crate::{
    measure::statistics::{Moments, chi_square_test},
    sampling::{lengthen, tests::numbers, warp::uniform_sphere},
};

fn map(width: u32, height: u32, texel: impl Fn(u32, u32) -> [f32; 3]) -> EnvironmentMap {
    let texels = (0..height).flat_map(|row| (0..width).map(move |column| (row, column))).map(|(r, c)| texel(r, c));
    EnvironmentMap { name: String::new(), width, height, texels: texels.collect() }
}

/// Direction of a place on the map, 0 to 1, without rotation.
fn direction(u: f64, v: f64) -> [f32; 3] {
    let (sin, cos) = (PI * v).sin_cos();
    let (z, x) = (2.0 * PI * (u - 0.5)).sin_cos();
    [sin * x, cos, sin * z].map(|v| v as f32)
}

/// A map with all sorts of texels: grey noise, a sun, a black band and coloured ones.
fn sky(width: u32, height: u32) -> EnvironmentMap {
    map(width, height, |row, column| match (row, column) {
        (r, c) if r == height / 3 && c == width / 4 => [4e5, 4e5, 3e5],
        (r, _) if r == height / 2 => [0.0; 3],
        (r, c) => [1.0 + (r * 7 + c * 13) as f32 % 11.0, 1.0 + (c % 3) as f32, (r % 5) as f32],
    })
}

/// Integral over the sphere of a function of (direction, solid angle weight in it): the midpoint rule, several
/// points to each texel, weighted by exact solid angles.
fn quadrature(table: &EnvironmentTable, per_texel: u32, mut f: impl FnMut([f32; 3], f64)) {
    let (rows, columns) = (table.height * per_texel, table.width * per_texel);
    for row in 0..rows {
        let edge = |row: u32| PI * f64::from(row) / f64::from(rows);
        let weight = (edge(row).cos() - edge(row + 1).cos()) * 2.0 * PI / f64::from(columns);
        for column in 0..columns {
            let u = (f64::from(column) + 0.5) / f64::from(columns);
            let d = direction(u, (f64::from(row) + 0.5) / f64::from(rows));
            let (sin, cos) = f64::from(table.rotation).sin_cos();
            let (x, z) = (f64::from(d[0]), f64::from(d[2]));
            f([(x * cos + z * sin) as f32, d[1], (z * cos - x * sin) as f32], weight);
        }
    }
}

/// An even map has its value as its mean, however it is cut, and nothing beyond it to look for.
#[test]
fn even_map_has_nothing_to_look_for() {
    for (width, height) in [(1, 1), (2, 1), (1, 2), (7, 3), (64, 32), (1000, 501)] {
        let table = EnvironmentTable::new(&map(width, height, |_, _| [1.5; 3]), 33.0, 2.0);
        assert!((table.mean - 3.0).abs() < 1e-5, "{width}×{height}");
        assert!(table.choice.is_empty() && table.mean_illuminance() == 0.0);
        assert_eq!((table.pdf([0.0, 1.0, 0.0]), table.radiance([1.0, 0.0, 0.0])), (0.0, [3.0; 3]));
    }
}

/// Half the sky at 3 nit, half at 1: what is beyond the mean of 2 nit is 2π·1 lx, a quarter of which arrives on average.
#[test]
fn what_is_brighter_than_the_mean_is_looked_for() {
    let table = EnvironmentTable::new(&map(8, 64, |row, _| [if row < 32 { 3.0 } else { 1.0 }; 3]), 0.0, 1.0);
    assert!((table.mean - 2.0).abs() < 1e-5);
    assert!((f64::from(table.mean_illuminance()) - 0.5 * PI).abs() < 1e-5);
    assert!((f64::from(table.pdf([0.0, 1.0, 0.0])) - 0.5 / PI).abs() < 1e-5);
    assert_eq!(table.pdf([0.0, -1.0, 0.0]), 0.0);
}

#[test]
fn density_is_not_negative_and_integrates_to_one() {
    for (width, height, rotation) in [(8, 4, 0.0), (16, 9, 77.0), (64, 32, -200.0)] {
        let table = EnvironmentTable::new(&sky(width, height), rotation, 0.25);
        let mut integral = 0.0;
        quadrature(&table, 4, |d, weight| {
            let pdf = table.pdf(d);
            assert!(pdf >= 0.0 && pdf.is_finite());
            integral += f64::from(pdf) * weight;
        });
        assert!((integral - 1.0).abs() < 1e-4, "{width}×{height}: {integral}");
    }
}

/// Samples against the density: counts per texel and within texels, and E[f] for three functions.
/// Significance 1e-4 each.
#[test]
fn directions_follow_the_density() {
    let functions: [fn([f32; 3]) -> f64; 3] = [
        |d| f64::from(d[0]) + 2.0 * f64::from(d[1]),
        |d| f64::from(d[0] * d[2]) + f64::from(d[1] * d[1]),
        |d| (3.0 * f64::from(d[2])).exp(),
    ];
    for (width, height, rotation) in [(8, 4, 0.0), (16, 9, 77.0)] {
        // Without the sun, which would take nearly all samples.
        let mut picture = sky(width, height);
        picture.texels.iter_mut().for_each(|t| *t = t.map(|v| v.min(30.0)));
        let table = EnvironmentTable::new(&picture, rotation, 1.0);
        // Midpoints of the bands are not where half their solid angle is, so the quadrature is fine.
        let cells = (width * height * 4) as usize;
        let cell = |d: [f32; 3]| {
            let (row, column) = table.texel(d);
            let (row_half, column_half) = {
                let finer = EnvironmentTable { width: 2 * width, height: 2 * height, ..table.clone_frame() };
                finer.texel(d)
            };
            assert_eq!((row_half / 2, column_half / 2), (row, column), "halves of the texel");
            row_half * 2 * width as usize + column_half
        };
        let (mut expected, mut means) = (vec![0.0; cells], [0.0; 3]);
        quadrature(&table, 32, |d, weight| {
            let p = f64::from(table.pdf(d)) * weight;
            expected[cell(d)] += p;
            means.iter_mut().zip(functions).for_each(|(mean, f)| *mean += p * f(d));
        });
        let (mut observed, mut moments) = (vec![0u64; cells], [Moments::default(); 3]);
        for (u, v) in numbers(21, 300_000).zip(numbers(22, 300_000)) {
            let (d, pdf, radiance) = table.sample(lengthen(u.0, (f64::from(u.1) * f64::from(u32::MAX)) as u32), v);
            assert_eq!((radiance, pdf), (table.radiance(d), table.pdf(d)));
            let length: f32 = d.iter().map(|v| v * v).sum();
            assert!((length - 1.0).abs() < 5e-7, "{d:?}");
            observed[cell(d)] += 1;
            moments.iter_mut().zip(functions).for_each(|(moments, f)| moments.push(f(d)));
        }
        let test = chi_square_test(&observed, &expected);
        assert!(test.p > 1e-4, "{width}×{height}: {test:?}");
        for (got, want) in moments.iter().zip(means) {
            let off = (got.mean - want).abs() - 1e-4;
            assert!(off < 3.9 * got.standard_error(), "{width}×{height}: {got:?} is not {want}");
        }
    }
}

impl EnvironmentTable {
    /// Only what [`EnvironmentTable::texel`] needs.
    fn clone_frame(&self) -> Self {
        Self { rotation: self.rotation, rotation_sin_cos: self.rotation_sin_cos, ..Self::default() }
    }
}

/// Numbers that lead to the edges of texels and to both sides of the seams.
fn edges(table: &EnvironmentTable) -> impl Iterator<Item = (f32, f32)> {
    let seam = table.seam;
    let places = [0.0, 0.5 * seam, 0.99 * seam, 1.01 * seam, 1.0 - 1.01 * seam, 1.0 - f32::EPSILON / 2.0];
    (0..6000).map(move |i| (0.31 + 1e-4 * i as f32, places[i % 6])).map(|(u, place)| (u.min(0.99), place))
}

/// The only bright texel is drawn always, and what it is beyond the mean, over its density, is the whole integral of that.
#[test]
fn single_bright_texel_is_always_met() {
    for (width, height) in [(16, 8), (4096, 2048)] {
        for (row, column) in [(0, 0), (height - 1, width - 1), (height / 2, width / 2), (height / 2, 0), (1, width / 3)]
        {
            let lit = |r, c| if (r, c) == (row, column) { [5.0; 3] } else { [0.0; 3] };
            let table = EnvironmentTable::new(&map(width, height, lit), 123.0, 1.0);
            let mut strayed = 0;
            let random = numbers(23, 3000).zip(numbers(24, 3000)).map(|(u, v)| (u.0, v, 1));
            let edges = edges(&table).zip(edges(&table).map(|(a, b)| (b, a)));
            let edges = edges.flat_map(|(a, b)| [(a.0, a, 0), (a.0, b, 0), (a.1, a, 0), (b.1, (a.1, b.0), 0)]);
            for (u, v, counts) in random.chain(edges) {
                let (d, pdf, radiance) = table.sample(lengthen(u, 0), v);
                assert_eq!((radiance, pdf), (table.radiance(d), table.pdf(d)));
                if pdf > 0.0 {
                    assert_eq!(table.texel(d), (row as usize, column as usize));
                    let ratio = f64::from(5.0 - table.mean) / f64::from(pdf) / table.beyond_integral;
                    assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
                } else {
                    strayed += counts;
                }
            }
            assert!(strayed <= 3 * width / 4096, "{width}×{height} {row} {column}: {strayed}");
        }
    }
}

/// What a grey sky is beyond the mean, over the density, is the integral of that wherever there is something: no rounding at an
/// edge between the sun and the dark makes it larger.
#[test]
fn samples_of_a_grey_sky_have_no_variance() {
    let picture = map(512, 256, |row, column| match (row * 31 + column * 17) % 5 {
        0 => [1e6; 3],
        1 => [0.0; 3],
        k => [1e-3 * k as f32; 3],
    });
    let table = EnvironmentTable::new(&picture, 10.0, 1.0);
    for (u, v) in numbers(25, 200_000).zip(numbers(26, 200_000)) {
        let (_, pdf, radiance) = table.sample(lengthen(u.0, (f64::from(u.1) * f64::from(u32::MAX)) as u32), v);
        if pdf > 0.0 {
            let ratio = f64::from((radiance[0] - table.mean) / pdf) / table.beyond_integral;
            assert!((ratio - 1.0).abs() < 2e-6, "{ratio}");
        } else {
            assert!(radiance[0] < table.mean);
        }
    }
}

/// The centre of the map looks along +X, a quarter to the right along +Z, the top along +Y; a turn of 90° takes
/// +X to −Z, counter-clockwise seen from above.
#[test]
fn turned_map_looks_where_it_should() {
    // Column k of 8 spans u = k/8 to (k+1)/8; the middle of the map is the edge between 3 and 4.
    let picture = map(8, 2, |row, column| [(10 * row + column) as f32; 3]);
    let look = |rotation: f32, d: [f32; 3]| EnvironmentTable::new(&picture, rotation, 1.0).radiance(d)[0];
    let up = 0.1;
    assert_eq!(look(0.0, [1.0, up, 0.1]), 4.0);
    assert_eq!(look(0.0, [1.0, up, -0.1]), 3.0);
    assert_eq!(look(0.0, [0.1, up, 1.0]), 5.0);
    assert_eq!(look(0.0, [-0.1, up, 1.0]), 6.0);
    assert_eq!(look(0.0, [-1.0, up, 0.1]), 7.0);
    assert_eq!(look(0.0, [-1.0, up, -0.1]), 0.0);
    assert_eq!(look(0.0, [0.1, up, -1.0]), 2.0);
    assert_eq!(look(0.0, [1.0, -up, 0.1]), 14.0);
    // What was at +X is at −Z now, what was at +Z at +X.
    assert_eq!(look(90.0, [0.1, up, -1.0]), 4.0);
    assert_eq!(look(90.0, [-0.1, up, -1.0]), 3.0);
    assert_eq!(look(90.0, [1.0, up, 0.1]), 6.0);
    assert_eq!(look(-270.0, [1.0, up, -0.1]), 5.0);
    assert_eq!(look(360.0, [1.0, up, 0.1]), 4.0);
}

#[test]
fn turns_are_those_of_the_arc_tangent() {
    for i in 0..100_000 {
        let angle = PI * (f64::from(i) / 50_000.0 - 1.0);
        for radius in [1.0, 1e-15, 1e15] {
            let (y, x) = ((angle.sin() * radius) as f32, (angle.cos() * radius) as f32);
            let want = f64::from(y).atan2(f64::from(x)) / (2.0 * PI);
            assert!((f64::from(turns(y, x)) - want).abs() < 7e-8, "{angle}");
        }
    }
    assert_eq!(turns(0.0f32, 0.0), 0.0);
}

#[test]
fn lanes_look_up_what_the_scalar_does() {
    let table = EnvironmentTable::new(&sky(512, 256), 40.0, 1.0);
    let directions: Vec<[f32; 3]> = numbers(27, 8000).map(|u| uniform_sphere::<f32>(u).lane(0)).collect();
    for block in directions.as_chunks::<8>().0 {
        let (radiance, pdf) = table.look_up::<f32x8>(V3::from_fn(|i| block[i]));
        for (i, &d) in block.iter().enumerate() {
            assert_eq!((radiance.lane(i), Real::lane(pdf, i)), (table.radiance(d), table.pdf(d)));
        }
    }
}

#[test]
fn poles_and_seams_have_a_texel() {
    for (width, height) in [(1, 1), (3, 1), (16, 8), (8192, 4096)] {
        let table = EnvironmentTable { width, height, rotation_sin_cos: [0.0, 1.0], ..EnvironmentTable::default() };
        let (w, h) = (width as usize, height as usize);
        for tiny in [0.0, -0.0, 1e-30, -1e-30, 1e-8, -1e-8f32] {
            assert_eq!(table.texel([tiny, 1.0, tiny]).0, 0);
            assert_eq!(table.texel([tiny, -1.0, -tiny]).0, h - 1);
            for d in [[tiny, 1.0, tiny], [-1.0, tiny, tiny], [1.0, 0.0, tiny], [tiny, tiny, tiny]] {
                let (row, column) = table.texel(d);
                assert!(row < h && column < w, "{d:?}");
            }
        }
        let seam = [table.texel([-1.0, 0.0, 0.0]).1, table.texel([-1.0, 0.0, -0.0]).1];
        assert!(seam.iter().all(|&column| column == 0 || column == w - 1));
    }
}

/// The middle of each texel is found again, also in the rows at the poles of a fine map.
#[test]
fn centres_of_texels_are_found_again() {
    let (width, height) = (4096, 2048);
    let table = EnvironmentTable { width, height, rotation_sin_cos: [0.0, 1.0], ..EnvironmentTable::default() };
    for row in (0..height).step_by(31).chain([1, 2, height - 3, height - 2, height - 1]) {
        for column in (0..width).step_by(57).chain([width - 1]) {
            let d = direction((f64::from(column) + 0.5) / f64::from(width), (f64::from(row) + 0.5) / f64::from(height));
            assert_eq!(table.texel(d), (row as usize, column as usize));
        }
    }
}

#[test]
fn black_sky_has_nothing_to_choose() {
    let table = EnvironmentTable::new(&map(4, 2, |_, _| [0.0; 3]), 0.0, 1.0);
    assert!(table.choice.is_empty());
    assert_eq!((table.mean, table.pdf([0.0, 1.0, 0.0]), table.radiance([1.0, 0.0, 0.0])), (0.0, 0.0, [0.0; 3]));
}
