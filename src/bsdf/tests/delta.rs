//! Mirrors and clear glass, by formula.

use super::plain::{glass, schlick_parts};
use super::*;
use crate::bsdf::{Opaque, Transmissive};

/// Mean weight (times η²) of what was reflected and what was transmitted.
fn shares<B: Bsdf>(s: &Surface, wo: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let drawn = draws::<B>(s, wo, 20_000, &mut Rng(30));
    let mut sums = [[0.0; 3]; 2];
    for d in drawn.iter().filter(|d| d.delta) {
        for k in 0..3 {
            sums[usize::from(d.transmitted)][k] += d.weight[k] * d.eta_scale / drawn.len() as f64;
        }
    }
    (sums[0], sums[1])
}

/// Weights of deltas are values over probabilities; the directions are the mirror's and Snell's.
#[test]
fn smooth_surfaces_reflect_and_refract_by_the_formulas() {
    let surfaces = [PLASTIC, METAL, THIN, ENTERING, LEAVING, MIXED, MIXED_THIN];
    for s in surfaces.map(|s| Surface { roughness: 0.0, ..s }) {
        for angle in [0.0, 20.0, 40.0, 41.0, 42.0, 60.0, 80.0, 89.0] {
            let wo = at_degrees(angle);
            let (fd, fm) = schlick_parts(&s, wo[2]);
            let (r, t) = glass(&s, wo[2]);
            let (m, g) = (s.metallic, s.transmission);
            let (reflected, transmitted) = shares::<Transmissive>(&s, wo);
            for k in 0..3 {
                let want_r = (1.0 - m) * ((1.0 - g) * fd[k] + g * r[k]) + m * fm[k];
                let want_t = (1.0 - m) * g * t[k];
                // 160,000 draws: four standard deviations of a share are below 0.5 %.
                assert!((reflected[k] - want_r).abs() < 0.01, "{s:?} {angle}: {reflected:?} {want_r}");
                assert!((transmitted[k] - want_t).abs() < 0.01, "{s:?} {angle}: {transmitted:?} {want_t}");
            }
            for d in draws::<Transmissive>(&s, wo, 100, &mut Rng(31)).iter().filter(|d| d.delta) {
                let eta = s.eta();
                let want = if !d.transmitted {
                    [-wo[0], -wo[1], wo[2]]
                } else {
                    let sin = wo[0] / eta;
                    [-sin, 0.0, -(1.0 - sin * sin).max(0.0).sqrt()]
                };
                for k in 0..3 {
                    assert!((d.wi[k] - want[k]).abs() < 3e-6, "{s:?} {angle}: {d:?} {want:?}");
                }
                assert!((d.eta_scale / if d.transmitted { eta * eta } else { 1.0 } - 1.0).abs() < 1e-6);
                assert_eq!(d.pdf, 0.0);
            }
        }
    }
}

/// Clear white glass, of which nothing else is: R + T = 1 in every draw, so each weight is 1, or 1/η² when refracted.
#[test]
fn clear_white_glass_loses_nothing() {
    for s in [THIN, ENTERING, LEAVING] {
        for ior in [1.0, 1.0 + 1e-6, 1.0003, 1.5, 4.0] {
            let s = Surface { base_color: [1.0; 3], roughness: 0.0, ior, ..s };
            for angle in [0.0, 30.0, 60.0, 85.0, 89.9] {
                let wo = at_degrees(angle);
                for d in draws::<Transmissive>(&s, wo, 500, &mut Rng(32)) {
                    assert!(d.valid && d.delta);
                    // The probability of reflection is 1 minus that of transmission, which is rounded.
                    let p = if d.transmitted { 1.0 } else { glass(&s, wo[2]).0[0] };
                    for w in d.weight {
                        assert!((w * d.eta_scale - 1.0).abs() < 1e-5 + 1.2e-7 / p, "{s:?} {angle} {d:?}");
                    }
                }
            }
        }
    }
}

/// At index 1 a solid bends nothing and reflects nothing, whatever its roughness; a thin wall of no roughness neither.
#[test]
fn index_one_goes_exactly_straight() {
    for s in [THIN, ENTERING, LEAVING] {
        for roughness in [0.0, 0.1, 0.5, 1.0] {
            if !s.solid && roughness > 0.0 {
                continue;
            }
            let s = Surface { ior: 1.0, roughness, ..s };
            let wo = at_degrees(70.0).map(|v| f64::from(v as f32));
            for d in draws::<Transmissive>(&s, wo, 100, &mut Rng(33)) {
                assert!(d.delta && d.transmitted && d.valid);
                assert_eq!(d.wi, wo.map(|o| -o));
                for k in 0..3 {
                    assert!((d.weight[k] - s.base_color[k]).abs() < 1e-6);
                }
            }
        }
    }
}

/// A solid of infinite index is a mirror.
#[test]
fn infinite_index_lets_nothing_into_a_solid() {
    for s in [ENTERING, LEAVING].map(|s| Surface { ior: 0.0, ..s }) {
        for roughness in [0.0, 0.4] {
            let s = Surface { roughness, ..s };
            assert!(draws::<Transmissive>(&s, at_degrees(50.0), 100, &mut Rng(34)).iter().all(|d| !d.transmitted));
        }
    }
}

/// A mirror over a diffuse base leaves to light samples the diffuse part alone.
#[test]
fn deltas_are_left_out_of_values_and_densities() {
    let s = Surface { roughness: 0.005, ..PLASTIC };
    let wo = at_degrees(40.0);
    let mirror = [-wo[0], 0.0, wo[2]];
    let (f, pdf) = eval_one::<Opaque>(&s, wo, mirror);
    let black = Surface { base_color: [0.0; 3], ..s };
    assert!(f[0] > 0.0 && f[0] < s.base_color[0] && pdf > 0.0 && pdf < 1.0);
    assert_eq!(eval_one::<Opaque>(&black, wo, mirror), ([0.0; 3], 0.0));
    let scatters = |s: &Surface| Opaque::scatters(&Opaque::prepare::<f32>(&s.params(), vec(wo)));
    assert!(scatters(&s) && !scatters(&black) && scatters(&Surface { roughness: 0.1, ..black }));
}
