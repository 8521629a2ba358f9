//! Thin things askew, which fill little of boxes along the axes: hair, a railing, crates.

use std::f64::consts::TAU;

use super::RayList;

type Triangles = Vec<[[f32; 3]; 3]>;

/// xorshift: numbers in [0, 1).
fn numbers(mut state: u64) -> impl FnMut() -> f64 {
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / 9_007_199_254_740_992.0
    }
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The twelve triangles of a bar between two points, by its widths.
pub fn bar(from: [f64; 3], to: [f64; 3], widths: [f64; 2]) -> Triangles {
    let along = unit(std::array::from_fn(|i| to[i] - from[i]));
    let least = (0..3).fold(0, |least, i| if along[i].abs() < along[least].abs() { i } else { least });
    let side = unit(cross(along, std::array::from_fn(|i| f64::from(u8::from(i == least)))));
    let up = cross(along, side);
    let corner = |bits: usize| -> [f32; 3] {
        let end = if bits & 1 == 0 { from } else { to };
        let [s, t] = [1, 2].map(|bit| widths[bit - 1] * if bits >> bit & 1 == 0 { -0.5 } else { 0.5 });
        std::array::from_fn(|i| (end[i] + s * side[i] + t * up[i]) as f32)
    };
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    faces
        .iter()
        .flat_map(|face| {
            let [a, b, c, d] = face.map(corner);
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

/// So many strands of eight bars each, combed askew, a three-hundredth as thick as long.
pub fn hair(strands: usize) -> Triangles {
    let mut u = numbers(1);
    let mut all = Vec::new();
    for _ in 0..strands {
        let mut at = [u(), u(), 0.0];
        let mut towards = [0.6 + 0.3 * u(), 0.4 + 0.3 * u(), 0.8];
        for _ in 0..8 {
            let next = std::array::from_fn(|i| at[i] + 0.12 * towards[i]);
            all.extend(bar(at, next, [0.003; 2]));
            at = next;
            towards = [towards[0] + 0.1 * (u() - 0.5), towards[1] + 0.1 * (u() - 0.5), towards[2] - 0.05];
        }
    }
    all
}

/// A handrail up a stair that runs askew, on so many bars that lean.
pub fn railing(bars: usize) -> Triangles {
    let foot = |share: f64| [4.0 * share, 3.0 * share, 2.0 * share];
    let head = |share: f64| [4.0 * share + 0.3, 3.0 * share - 0.2, 2.0 * share + 1.0];
    let share = |i: usize| (i as f64 + 0.5) / bars as f64;
    let mut all = bar(head(0.0), head(1.0), [0.05, 0.08]);
    all.extend(bar(foot(0.0), foot(1.0), [0.05; 2]));
    all.extend((0..bars).flat_map(|i| bar(foot(share(i)), head(share(i)), [0.015; 2])));
    all
}

/// So many long boxes, each turned its own way.
pub fn crates(count: usize) -> Triangles {
    let mut u = numbers(2);
    let spread = (count as f64).cbrt();
    (0..count)
        .flat_map(|_| {
            let from = [spread * u(), spread * u(), spread * u()];
            let (z, turn) = (2.0 * u() - 1.0, TAU * u());
            let r = (1.0 - z * z).sqrt();
            let to = [from[0] + r * turn.cos(), from[1] + r * turn.sin(), from[2] + z];
            bar(from, to, [0.3, 0.2])
        })
        .collect()
}

/// Rays from around the triangles to points among them.
pub fn rays(triangles: &[[[f32; 3]; 3]], count: usize, seed: u64) -> RayList {
    let (mut lower, mut upper) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for corner in triangles.iter().flatten() {
        let corner = corner.map(f64::from);
        lower = std::array::from_fn(|i| lower[i].min(corner[i]));
        upper = std::array::from_fn(|i| upper[i].max(corner[i]));
    }
    let mut u = numbers(seed);
    let mut point = |scale: f64| -> [f64; 3] {
        std::array::from_fn(|i| lower[i] + (upper[i] - lower[i]) * (0.5 + scale * (u() - 0.5)))
    };
    let ray = |_| {
        let (origin, target) = (point(3.0).map(|x| x as f32), point(1.0));
        (origin, std::array::from_fn(|i| (target[i] - f64::from(origin[i])) as f32), f32::INFINITY)
    };
    RayList((0..count).map(ray).collect())
}
