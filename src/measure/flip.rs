//! FLIP: what a viewer sees who switches between two pictures.
//!
//! Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images", and for
//! light beyond a display's range Andersson et al. 2021, "Visualizing Errors in Rendered High
//! Dynamic Range Images". Filters are separated as in NVIDIA's own program, version 1.7, whose
//! numbers the tests hold this to. Values are 0 (same) to 1 per pixel.

use rayon::prelude::*;

use crate::film::{srgb_decode, srgb_encode};

/// Pixels per degree of a viewer 0.7 m before a display 0.7 m wide of 3840 pixels.
pub const DEFAULT_PPD: f32 = 0.7 * (3840.0 / 0.7) * (std::f32::consts::PI / 180.0);

const QC: f32 = 0.7;
const PC: f32 = 0.4;
const PT: f32 = 0.95;
const FEATURE_WIDTH: f32 = 0.082;
/// D65, X and Z; Y is 1.
const WHITE: [f32; 3] = [0.950_428_55, 1.0, 1.088_900_4];

/// FLIP of two display-referred pictures: sRGB-encoded values in [0, 1], rows from the top.
pub fn ldr_flip(x: &[[f32; 3]], reference: &[[f32; 3]], width: usize, ppd: f32) -> Vec<f32> {
    let opponent = |picture: &[[f32; 3]]| -> Vec<[f32; 3]> {
        picture
            .par_iter()
            .map(|rgb| opponent_from_xyz(xyz_from_rgb(rgb.map(|c| srgb_decode(c.clamp(0.0, 1.0))))))
            .collect()
    };
    let (x, reference) = (opponent(x), opponent(reference));
    let colour = colour_difference(&filtered(&x, width, ppd), &filtered(&reference, width, ppd));
    let (fx, fr) = (features(&x, width, ppd), features(&reference, width, ppd));
    let feature = |i: usize| {
        let [edge, point] = [0, 1].map(|k| (fr[i][k] - fx[i][k]).abs());
        (std::f32::consts::FRAC_1_SQRT_2 * edge.max(point)).sqrt()
    };
    (0..colour.len()).map(|i| colour[i].powf(1.0 - feature(i))).collect()
}

/// FLIP of two pictures of light, the worst over a range of exposures.
#[derive(Clone, Debug, PartialEq)]
pub struct HdrFlip {
    /// Rows from the top.
    pub map: Vec<f32>,
    /// First and last exposure, stops.
    pub stops: [f32; 2],
    /// How many exposures, evenly spaced.
    pub exposures: usize,
}

/// HDR-FLIP of linear light ≥ 0, through the ACES curve of its paper (Narkowicz's).
///
/// From the exposure that takes the reference's brightest pixel to 0.85 to the one that takes
/// its median there, a stop apart at most. Where more than half of the reference is black, the
/// median is that of the rest; the original has no answer there.
pub fn hdr_flip(x: &[[f32; 3]], reference: &[[f32; 3]], width: usize, ppd: f32) -> HdrFlip {
    let stops = exposure_range(reference);
    let exposures = ((stops[1] - stops[0]).ceil() as usize).max(2);
    let step = (stops[1] - stops[0]) / (exposures - 1) as f32;
    let mut map = vec![0.0_f32; x.len()];
    for i in 0..exposures {
        let factor = (stops[0] + i as f32 * step).exp2();
        let shown = |picture: &[[f32; 3]]| -> Vec<[f32; 3]> {
            // Beyond 1e15 the curve is flat, and infinity would turn into ∞/∞.
            let show = |c: f32| srgb_encode(aces((c.max(0.0) * factor).min(1e15)).clamp(0.0, 1.0));
            picture.par_iter().map(|rgb| rgb.map(show)).collect()
        };
        let now = ldr_flip(&shown(x), &shown(reference), width, ppd);
        map.iter_mut().zip(now).for_each(|(worst, now)| *worst = worst.max(now));
    }
    HdrFlip { map, stops, exposures }
}

/// Mean of a map.
pub fn mean(map: &[f32]) -> f64 {
    map.iter().map(|&v| f64::from(v)).sum::<f64>() / map.len() as f64
}

/// Numerator's and denominator's coefficients of x² and x, and the denominator's constant.
const ACES: [f32; 5] = [0.36 * 2.51, 0.6 * 0.03, 0.36 * 2.43, 0.6 * 0.59, 0.14];

fn aces(v: f32) -> f32 {
    let [a, b, c, d, e] = ACES;
    (v * v * a + v * b) / (v * v * c + v * d + e)
}

/// First and last exposure, stops.
fn exposure_range(reference: &[[f32; 3]]) -> [f32; 2] {
    // The light that the curve takes to 0.85.
    let [a, b, c, d, e] = ACES;
    let (a, b, c) = (a - 0.85 * c, b - 0.85 * d, -0.85 * e);
    let half = -0.5 * b / a;
    let target = half + (half * half - c / a).sqrt();
    let mut luminances: Vec<f32> = reference.iter().map(|[r, g, b]| 0.2126 * r + 0.7152 * g + 0.0722 * b).collect();
    luminances.retain(|y| y.is_finite() && *y >= 0.0);
    luminances.sort_unstable_by(f32::total_cmp);
    let median = |sorted: &[f32]| match sorted {
        [] => 0.0,
        [only] => *only,
        _ => (sorted[sorted.len() / 2 - 1] + sorted[sorted.len() / 2]) * 0.5,
    };
    let mut middle = median(&luminances);
    if middle == 0.0 {
        middle = median(&luminances[luminances.partition_point(|y| *y == 0.0)..]);
    }
    match luminances.last() {
        Some(&most) if most > 0.0 => [(target / most).log2(), (target / middle).log2()],
        _ => [0.0, 0.0],
    }
}

fn xyz_from_rgb([r, g, b]: [f32; 3]) -> [f32; 3] {
    // Exact quotients of the sRGB primaries, as in the original.
    const D: f32 = 1.0 / 24_577_794.0;
    const E: f32 = 1.0 / 12_288_897.0;
    const F: f32 = 1.0 / 73_733_382.0;
    [
        10_135_552.0 * D * r + 8_788_810.0 * D * g + 4_435_075.0 * D * b,
        2_613_072.0 * E * r + 8_788_810.0 * E * g + 887_015.0 * E * b,
        1_425_312.0 * F * r + 8_788_810.0 * F * g + 70_074_185.0 * F * b,
    ]
}

fn rgb_from_xyz([x, y, z]: [f32; 3]) -> [f32; 3] {
    [
        3.241_003_3 * x - 1.537_399 * y - 0.498_615_86 * z,
        -0.969_224_33 * x + 1.875_930_1 * y + 0.041_554_224 * z,
        0.055_639_423 * x - 0.204_011_2 * y + 1.057_148_9 * z,
    ]
}

/// Achromatic, red–green and blue–yellow, linear in light (Y, Cx, Cz).
fn opponent_from_xyz(xyz: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = [0, 1, 2].map(|c| xyz[c] / WHITE[c]);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn xyz_from_opponent([y, cx, cz]: [f32; 3]) -> [f32; 3] {
    let y = (y + 16.0) / 116.0;
    [(y + cx / 500.0) * WHITE[0], y, (y - cz / 200.0) * WHITE[2]]
}

/// CIELAB with a and b scaled by Hunt's effect.
fn hunt_lab_from_rgb(rgb: [f32; 3]) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let xyz = xyz_from_rgb(rgb);
    let [x, y, z] = [0, 1, 2].map(|c| {
        let v = xyz[c] / WHITE[c];
        if v > DELTA * DELTA * DELTA { v.cbrt() } else { v / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    });
    let l = 116.0 * y - 16.0;
    [l, 0.01 * l * 500.0 * (x - y), 0.01 * l * 200.0 * (y - z)]
}

/// City-block in lightness, Euclidean in colour, to the power of `QC`.
fn distance(x: [f32; 3], r: [f32; 3]) -> f32 {
    ((r[0] - x[0]).abs() + (r[1] - x[1]).hypot(r[2] - x[2])).powf(QC)
}

/// Colour differences in [0, 1] of two pictures of [`hunt_lab_from_rgb`].
fn colour_difference(x: &[[f32; 3]], reference: &[[f32; 3]]) -> Vec<f32> {
    let most = distance(hunt_lab_from_rgb([0.0, 0.0, 1.0]), hunt_lab_from_rgb([0.0, 1.0, 0.0]));
    let knee = PC * most;
    let bent = |d: f32| if d < knee { d * PT / knee } else { PT + (d - knee) / (most - knee) * (1.0 - PT) };
    x.iter().zip(reference).map(|(x, r)| bent(distance(*x, *r))).collect()
}

/// What the eye resolves: contrast sensitivity filters in opponent space, then Lab.
///
/// Blue–yellow has a sum of two Gaussians, each of which is filtered on its own.
fn filtered(opponent: &[[f32; 3]], width: usize, ppd: f32) -> Vec<[f32; 3]> {
    use std::f32::consts::PI;
    // Amplitude and width of each, degrees; the paper's table 1.
    const GAUSSIANS: [[f32; 2]; 4] = [[1.0, 0.0047], [1.0, 0.0053], [34.1, 0.04], [13.5, 0.025]];
    let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * ppd).ceil() as i32;
    let taps: Vec<[f32; 4]> = (-radius..=radius)
        .map(|i| {
            let x = i as f32 / ppd;
            GAUSSIANS.map(|[_, b]| (-PI * PI * x * x / b).exp())
        })
        .collect();
    let mut scale = [0, 1, 2, 3].map(|k| taps.iter().map(|tap| tap[k]).sum::<f32>().recip());
    // The square roots of the two amplitudes, such that the two-dimensional sums add up to 1.
    let [first, second] = [2, 3].map(|k| (GAUSSIANS[k][0] * (PI / GAUSSIANS[k][1]).sqrt()).sqrt());
    let norm = (first / scale[2]).hypot(second / scale[3]);
    scale[2] = first / norm;
    scale[3] = second / norm;
    let taps: Vec<[f32; 4]> = taps.iter().map(|tap| [0, 1, 2, 3].map(|k| tap[k] * scale[k])).collect();
    let split: Vec<[f32; 4]> = opponent.iter().map(|&[y, cx, cz]| [y, cx, cz, cz]).collect();
    let along = convolve_x(&split, width, &taps, |value, tap| [0, 1, 2, 3].map(|k| value[k] * tap[k]));
    let across = convolve_y(&along, width, &taps, |value, tap| [0, 1, 2, 3].map(|k| value[k] * tap[k]));
    across
        .into_par_iter()
        .map(|[y, cx, cz1, cz2]| {
            let rgb = rgb_from_xyz(xyz_from_opponent([y, cx, cz1 + cz2]));
            hunt_lab_from_rgb(rgb.map(|c| c.clamp(0.0, 1.0)))
        })
        .collect()
}

/// Strength of edges and of points in the achromatic channel.
fn features(opponent: &[[f32; 3]], width: usize, ppd: f32) -> Vec<[f32; 2]> {
    let sigma = 0.5 * FEATURE_WIDTH * ppd;
    let radius = (3.0 * sigma).ceil() as i32;
    let mut taps: Vec<[f32; 3]> = (-radius..=radius)
        .map(|i| {
            let x = i as f32;
            let g = (-x * x / (2.0 * sigma * sigma)).exp();
            [g, -x * g, (x * x / (sigma * sigma) - 1.0) * g]
        })
        .collect();
    // The Gaussian sums to 1; of the derivatives the positive taps to 1 and the negative to −1.
    let sum = |k: usize, sign: f32| taps.iter().map(|tap| (tap[k] * sign).max(0.0)).sum::<f32>();
    let sums = [0, 1, 2].map(|k| [sum(k, 1.0), sum(k, -1.0)]);
    for tap in &mut taps {
        *tap = [0, 1, 2].map(|k| tap[k] / if tap[k] > 0.0 { sums[k][0] } else { sums[k][1].max(f32::MIN_POSITIVE) });
    }
    let grey: Vec<[f32; 1]> = opponent.iter().map(|v| [(v[0] + 16.0) / 116.0]).collect();
    let along = convolve_x(&grey, width, &taps, |[value], tap| tap.map(|t| t * value));
    let across = convolve_y(&along, width, &taps, |[g, dx, ddx], [tg, td, tdd]| [dx * tg, ddx * tg, g * td, g * tdd]);
    across.into_iter().map(|[dx, ddx, dy, ddy]| [dx.hypot(dy), ddx.hypot(ddy)]).collect()
}

/// Sum along x of `product(value, tap)`; beyond an edge its value goes on.
fn convolve_x<const A: usize, const T: usize, const B: usize>(
    values: &[[f32; A]],
    width: usize,
    taps: &[[f32; T]],
    product: impl Fn([f32; A], [f32; T]) -> [f32; B] + Sync,
) -> Vec<[f32; B]> {
    let radius = taps.len() / 2;
    values
        .par_chunks_exact(width)
        .flat_map_iter(|row| {
            let product = &product;
            (0..width).map(move |x| {
                let at = |i: usize| row[(x + i).saturating_sub(radius).min(width - 1)];
                taps.iter().enumerate().fold([0.0; B], |sum, (i, &tap)| add(sum, product(at(i), tap)))
            })
        })
        .collect()
}

/// As [`convolve_x`], along y.
fn convolve_y<const A: usize, const T: usize, const B: usize>(
    values: &[[f32; A]],
    width: usize,
    taps: &[[f32; T]],
    product: impl Fn([f32; A], [f32; T]) -> [f32; B] + Sync,
) -> Vec<[f32; B]> {
    let (radius, height) = (taps.len() / 2, values.len() / width);
    (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let mut sums = vec![[0.0; B]; width];
            for (i, &tap) in taps.iter().enumerate() {
                let row = (y + i).saturating_sub(radius).min(height - 1) * width;
                for (sum, &value) in sums.iter_mut().zip(&values[row..row + width]) {
                    *sum = add(*sum, product(value, tap));
                }
            }
            sums
        })
        .collect()
}

fn add<const N: usize>(a: [f32; N], b: [f32; N]) -> [f32; N] {
    std::array::from_fn(|i| a[i] + b[i])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_pictures_do_not_differ() {
        let picture: Vec<_> = (0..20 * 15).map(|i| [(i % 7) as f32 / 6.0, (i % 5) as f32 / 4.0, 0.3]).collect();
        assert!(ldr_flip(&picture, &picture, 20, DEFAULT_PPD).iter().all(|v| *v == 0.0));
        let hdr = hdr_flip(&picture, &picture, 20, DEFAULT_PPD);
        assert!(hdr.map.iter().all(|v| *v == 0.0));
    }

    /// The paper scales differences so that pure green against pure blue, flat, is 1.
    #[test]
    fn green_against_blue_is_the_greatest_difference() {
        let map = ldr_flip(&[[0.0, 0.0, 1.0]; 400], &[[0.0, 1.0, 0.0]; 400], 20, DEFAULT_PPD);
        assert!(map.iter().all(|v| (v - 1.0).abs() < 2e-3), "{:?}", &map[..3]);
    }

    #[test]
    fn black_references_and_wild_light_give_numbers() {
        let black = vec![[0.0; 3]; 64];
        let mut wild = black.clone();
        wild[9] = [f32::INFINITY, f32::NAN, -1.0];
        wild[10] = [1e30; 3];
        for (x, r) in [(&wild, &black), (&black, &wild), (&black, &black)] {
            let flip = hdr_flip(x, r, 8, DEFAULT_PPD);
            assert!(flip.map.iter().all(|v| (0.0..=1.0).contains(v)), "{flip:?}");
        }
    }
}
