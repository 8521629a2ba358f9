//! What all warps and tables must keep: densities that integrate to 1, and samples that follow them.

use std::num::Wrapping;

use crate::{
    measure::statistics::{Moments, chi_square_test, normal_two_sided},
    render::SamplerKind,
    sampling::Sampler,
};

/// Independent pairs for a test; `stream` tells tests apart.
pub(crate) fn numbers(stream: u32, count: u32) -> impl Iterator<Item = (f32, f32)> {
    let sampler = Sampler::new(SamplerKind::Independent, 20_260_101);
    (0..count).map(move |sample| sampler.pair::<f32>(Wrapping(stream), Wrapping(sample), Wrapping(0)))
}

/// Tests a map from the unit square to `domain`, a rectangle, against its density there:
/// the density is not negative; its integral is 1 within 1e-4; samples fill 16 × 16 cells as it says (chi-square);
/// and the means of a linear, a quadratic and a transcendental function are right.
///
/// Each of the four statistical tests fails a right map with probability 1e-4.
#[track_caller]
pub(crate) fn check_warp(
    name: &str,
    domain: [[f64; 2]; 2],
    warp: impl Fn((f32, f32)) -> [f64; 2],
    density: impl Fn([f64; 2]) -> f64,
) {
    const SIGNIFICANCE: f64 = 1e-4;
    const CELLS: usize = 16;
    const FINE: usize = 1024;
    let functions: [fn([f64; 2]) -> f64; 3] =
        [|[x, y]| x + 0.5 * y + 1.0, |[x, y]| x * x - x * y, |[x, y]| (3.0 * x).cos() * (0.5 * y).exp()];

    let size = domain.map(|[low, high]| high - low);
    let weight = size[0] * size[1] / (FINE * FINE) as f64;
    let mut expected = vec![0.0; CELLS * CELLS];
    let (mut integral, mut means) = (0.0, [0.0; 3]);
    for j in 0..FINE {
        for i in 0..FINE {
            let at = [
                domain[0][0] + size[0] * (i as f64 + 0.5) / FINE as f64,
                domain[1][0] + size[1] * (j as f64 + 0.5) / FINE as f64,
            ];
            let p = density(at) * weight;
            assert!(p >= 0.0, "{name}: density {p} at {at:?}");
            integral += p;
            expected[j * CELLS / FINE * CELLS + i * CELLS / FINE] += p;
            for (mean, f) in means.iter_mut().zip(functions) {
                *mean += p * f(at);
            }
        }
    }
    assert!((integral - 1.0).abs() < 1e-4, "{name}: the density integrates to {integral}");

    let mut observed = vec![0u64; CELLS * CELLS];
    let mut moments = [Moments::default(); 3];
    for u in numbers(name.len() as u32, 400_000) {
        let at = warp(u);
        let cell = [0, 1].map(|axis| {
            let place = (at[axis] - domain[axis][0]) / size[axis];
            assert!((-1e-6..=1.0 + 1e-6).contains(&place), "{name}: {at:?} from {u:?}");
            ((place * CELLS as f64) as usize).min(CELLS - 1)
        });
        observed[cell[1] * CELLS + cell[0]] += 1;
        for (moments, f) in moments.iter_mut().zip(functions) {
            moments.push(f(at));
        }
    }
    let test = chi_square_test(&observed, &expected);
    assert!(test.p > SIGNIFICANCE, "{name}: {test:?}");
    for (k, (got, want)) in moments.iter().zip(means).enumerate() {
        // The midpoint rule itself is off by about 1e-5 of the function's range.
        let off = ((got.mean - want).abs() - 2e-5).max(0.0);
        let p = normal_two_sided(off / got.standard_error());
        assert!(p > SIGNIFICANCE, "{name}: mean of function {k} is {} not {want}, p = {p}", got.mean);
    }
}
