//! Draws against densities and values, by quadrature over cells fitted to the lobes.

use std::f64::consts::PI;

use super::*;
use crate::bsdf::{Lambert, Opaque, Transmissive};

const SECTORS: usize = 12;
const BLOCKS: usize = 25_000;

/// Polar cells about an axis, whose rings double in width from a quarter of the lobe's.
struct Cells {
    axis: [[f64; 3]; 3],
    rings: Vec<f64>,
}

impl Cells {
    fn new(pole: [f64; 3], width: f64) -> Self {
        let n = crate::simd::Frame::<f32>::new(vec(pole));
        let axis = [n.s, n.t, n.n].map(|v| v.lane(0).map(f64::from));
        let mut rings = vec![0.0];
        let mut edge = width / 4.0;
        while edge < PI {
            rings.push(edge);
            edge = (edge * 2.0).min(edge + 0.3);
        }
        // The horizon itself where the axis is upright.
        rings.extend([PI / 2.0, PI]);
        rings.sort_by(f64::total_cmp);
        Self { axis, rings }
    }
    fn len(&self) -> usize {
        (self.rings.len() - 1) * SECTORS
    }
    fn find(&self, v: [f64; 3]) -> usize {
        let [x, y, z] = self.axis.map(|a| dot(a, v));
        let theta = x.hypot(y).atan2(z);
        let turn = (y.atan2(x) / (2.0 * PI)).rem_euclid(1.0);
        let ring = self.rings[1..self.rings.len() - 1].partition_point(|&edge| edge <= theta);
        ring * SECTORS + ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
    }
    fn direction(&self, theta: f64, phi: f64) -> [f64; 3] {
        let local = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
        [0, 1, 2].map(|k| (0..3).map(|a| self.axis[a][k] * local[a]).sum())
    }
    /// Integrals of two functions over cell `i`.
    fn integrate(&self, i: usize, f: &impl Fn([f64; 3]) -> [f64; 2]) -> [f64; 2] {
        let (ring, sector) = (i / SECTORS, (i % SECTORS) as f64);
        let step = 2.0 * PI / SECTORS as f64;
        let g = |theta: f64, phi: f64| f(self.direction(theta, phi)).map(|f| f * theta.sin());
        let area = [self.rings[ring], self.rings[ring + 1], sector * step, (sector + 1.0) * step];
        refine(&g, area, gauss(&g, area), 0)
    }
}

type Area = [f64; 4];

/// Gauss–Legendre with three by three points.
fn gauss(g: &impl Fn(f64, f64) -> [f64; 2], [t0, t1, p0, p1]: Area) -> [f64; 2] {
    const POINTS: [(f64, f64); 3] =
        [(-0.774_596_669_241_483_4, 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.774_596_669_241_483_4, 5.0 / 18.0)];
    let mut sum = [0.0; 2];
    for (x, wx) in POINTS {
        for (y, wy) in POINTS {
            let v = g((t0 + t1 + x * (t1 - t0)) / 2.0, (p0 + p1 + y * (p1 - p0)) / 2.0);
            for k in 0..2 {
                sum[k] += wx * wy * v[k] * (t1 - t0) * (p1 - p0);
            }
        }
    }
    sum
}

fn refine(g: &impl Fn(f64, f64) -> [f64; 2], [t0, t1, p0, p1]: Area, whole: [f64; 2], depth: u32) -> [f64; 2] {
    let (t, p) = ((t0 + t1) / 2.0, (p0 + p1) / 2.0);
    let parts = [[t0, t, p0, p], [t, t1, p0, p], [t0, t, p, p1], [t, t1, p, p1]].map(|a| (a, gauss(g, a)));
    let sum = [0, 1].map(|k| parts.iter().map(|(_, v)| v[k]).sum::<f64>());
    let settled = (0..2).all(|k| (sum[k] - whole[k]).abs() < 1e-6);
    // Two levels at least: a lobe may hide between nine points.
    if depth >= 9 || depth >= 2 && settled {
        return sum;
    }
    parts.map(|(a, v)| refine(g, a, v, depth + 1)).into_iter().fold([0.0; 2], |s, v| [s[0] + v[0], s[1] + v[1]])
}

/// Pearson's statistic as standard deviations of a normal (Wilson and Hilferty 1931), cells pooled to at least ten.
fn chi_square(mut cells: Vec<(f64, f64)>) -> f64 {
    cells.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (mut x, mut n) = (0.0, 0.0f64);
    let mut pool = (0.0, 0.0);
    for (seen, expected) in cells {
        pool = (pool.0 + seen, pool.1 + expected);
        if pool.1 >= 10.0 {
            x += (pool.0 - pool.1).powi(2) / pool.1;
            n += 1.0;
            pool = (0.0, 0.0);
        }
    }
    // What is left would break the law of small numbers if it were more than a trace.
    assert!(pool.0 <= pool.1 + 5.0 * pool.1.sqrt() + 8.0, "{pool:?} in the last, rare cells");
    let n = (n - 1.0).max(1.0);
    ((x / n).cbrt() - (1.0 - 2.0 / (9.0 * n))) / (2.0 / (9.0 * n)).sqrt()
}

#[track_caller]
fn check_draws<B: Bsdf>(s: &Surface, angle: f64, seed: u64) {
    let wo = at_degrees(angle).map(|v| f64::from(v as f32));
    let eta = s.eta();
    let sin = (wo[0] / eta).min(0.999);
    let through = if s.solid { [-sin, 0.0, -(1.0 - sin * sin).sqrt()] } else { wo.map(|o| -o) };
    let width = s.roughness.powi(2).max(1e-4);
    let sides = [Cells::new([-wo[0], -wo[1], wo[2]], width), Cells::new(through, width)];
    let drawn = draws::<B>(s, wo, BLOCKS, &mut Rng(seed));
    let n = drawn.len() as f64;

    let prepared = B::prepare::<f32>(&s.params(), vec(wo));
    let mut counts = sides.each_ref().map(|side| vec![0.0; side.len()]);
    let (mut lost, mut sum, mut sum2, mut differ) = (0.0, 0.0, 0.0, 0.0);
    for d in &drawn {
        let weight = if d.delta { 0.0 } else { d.weight[1] };
        sum += weight / n;
        sum2 += weight * weight / n;
        if d.valid && !d.delta {
            let side = usize::from(d.wi[2] < 0.0);
            counts[side][sides[side].find(d.wi)] += 1.0;
            let pdf = f64::from(B::eval(&prepared, vec(d.wi)).1);
            differ += (d.pdf / pdf - 1.0).abs() / n;
        } else {
            lost += 1.0;
        }
    }
    // The density said with a draw is the one that would be said of it. Near the critical angle, and in narrow lobes, the
    // rounding of the direction shows.
    let slack = 1e-4 + 1e-6 / (width * wo[2]);
    assert!(differ < slack, "{s:?} at {angle}°: densities differ by {differ} of themselves, on average");
    let mut cells = Vec::new();
    let (mut mass, mut albedo) = (0.0, 0.0);
    for (k, side) in sides.iter().enumerate() {
        for (i, &count) in counts[k].iter().enumerate() {
            let [pdf, f] = side.integrate(i, &|wi| {
                if (wi[2] < 0.0) != (k == 1) {
                    return [0.0; 2];
                }
                let (f, pdf) = B::eval(&prepared, vec(wi));
                [f64::from(pdf), f64::from(f.lane(0)[1])]
            });
            mass += pdf;
            albedo += f;
            cells.push((count, pdf * n));
        }
    }
    assert!(mass < 1.0 + 1e-3, "{s:?} {angle}: densities sum to {mass}");
    cells.push((lost, (1.0 - mass).max(0.0) * n));
    let z = chi_square(cells);
    // One-sided 1 % over the 240 tests below, after Šidák: 4.2e-5 each.
    assert!(z < 3.93, "{s:?} at {angle}°: {z} standard deviations; density sums to {mass}, lost {}", lost / n);

    let error = ((sum2 - sum * sum).max(0.0) / n).sqrt();
    assert!(
        (sum - albedo).abs() < 4.2 * error + 1e-3,
        "{s:?} at {angle}°: mean weight {sum}±{error}, ∫ f cos {albedo}"
    );
}

fn check_all<B: Bsdf>(surfaces: &[Surface], seed: u64) {
    for (i, &surface) in surfaces.iter().enumerate() {
        for (j, roughness) in [0.03, 0.1, 0.3, 0.6, 1.0].into_iter().enumerate() {
            for (k, angle) in [0.0, 30.0, 60.0, 80.0, 85.0].into_iter().enumerate() {
                let seed = seed + (100 * i + 10 * j + k) as u64;
                check_draws::<B>(&Surface { roughness, ..surface }, angle, seed);
            }
        }
    }
}

/// 200,000 draws over some 300 cells; the mean of the weights is ∫ f·cos within its error.
#[test]
fn diffuse_draws_follow_their_density() {
    for angle in [0.0, 45.0, 85.0] {
        check_draws::<Lambert>(&LAMBERT, angle, 1000);
        check_draws::<Opaque>(&LAMBERT, angle, 1100);
    }
}

/// As above.
#[test]
fn opaque_draws_follow_their_density() {
    let tinted = Surface { metallic: 0.3, specular: 0.5, specular_color: [2.0, 0.3, 0.0], ..PLASTIC };
    check_all::<Opaque>(&[PLASTIC, METAL, tinted], 2000);
}

/// As above.
#[test]
fn thin_wall_draws_follow_their_density() {
    check_all::<Transmissive>(&[THIN, MIXED_THIN], 3000);
}

/// As above.
#[test]
fn solid_draws_follow_their_density() {
    check_all::<Transmissive>(&[ENTERING, LEAVING, MIXED], 4000);
}

/// A mirror over diffuse: the diffuse draws alone have a density.
#[test]
fn mirror_draws_are_not_in_the_density() {
    for angle in [0.0, 60.0, 85.0] {
        check_draws::<Opaque>(&Surface { roughness: 0.0, ..PLASTIC }, angle, 5000);
        check_draws::<Transmissive>(&Surface { roughness: 0.0, ..MIXED }, angle, 5100);
    }
}
