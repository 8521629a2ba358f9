//! Surfaces give back no more than they get.

use super::*;
use crate::bsdf::{Lambert, Opaque, Transmissive};

const ANGLES: [f64; 8] = [0.0, 20.0, 40.0, 60.0, 75.0, 85.0, 88.0, 89.0];
const ROUGHNESSES: [f64; 7] = [0.0, 0.001, 0.03, 0.1, 0.3, 0.6, 1.0];

/// Albedo (with the 1/η² of refraction undone) and the largest weight seen.
fn albedo<B: Bsdf>(s: &Surface, angle: f64) -> (f64, f64) {
    let drawn = draws::<B>(s, at_degrees(angle), 2_000, &mut Rng(40));
    let weights = drawn.iter().map(|d| d.weight[0].max(d.weight[1]).max(d.weight[2]) * d.eta_scale);
    (weights.clone().sum::<f64>() / drawn.len() as f64, weights.fold(0.0, f64::max))
}

/// Each lobe alone, white: no draw weighs more than 1, so the albedo is at most 1 with certainty.
#[test]
fn no_lobe_gives_back_more_than_it_gets() {
    let white = |s: Surface| Surface { base_color: [1.0; 3], ..s };
    let coat = Surface { base_color: [0.0; 3], ..PLASTIC };
    let strong = Surface { specular_color: [9.0; 3], ..coat };
    let mut most = 0.0f64;
    for roughness in ROUGHNESSES {
        for angle in ANGLES {
            let mut check = |name: &str, (albedo, weight): (f64, f64), least: f64| {
                assert!(weight <= 1.0 + 1e-4, "{name} {roughness} {angle}°: {weight}");
                assert!(albedo >= least, "{name} {roughness} {angle}°: {albedo}");
                most = most.max(weight);
            };
            let at = |s: Surface| Surface { roughness, ..s };
            // Single scattering loses up to half of the light, and nothing when smooth.
            let least = if roughness <= 0.03 { 0.98 } else { 0.3 };
            check("metal", albedo::<Opaque>(&at(white(METAL)), angle), least);
            check("coat", albedo::<Opaque>(&at(coat), angle), 0.0);
            check("strong coat", albedo::<Opaque>(&at(strong), angle), 0.0);
            check("diffuse", albedo::<Lambert>(&at(white(LAMBERT)), angle), 0.9999);
            check("diffuse", albedo::<Opaque>(&at(white(LAMBERT)), angle), 0.9999);
            check("thin", albedo::<Transmissive>(&at(white(THIN)), angle), least);
            for ior in [1.0, 1.0003, 1.5, 4.0] {
                check("entering", albedo::<Transmissive>(&at(Surface { ior, ..white(ENTERING) }), angle), 0.25);
                check("leaving", albedo::<Transmissive>(&at(Surface { ior, ..white(LEAVING) }), angle), 0.25);
            }
        }
    }
    println!("largest weight of a lobe {most}");
}

/// The coat over a white base is the one that may exceed 1, as `docs/model.md` says; no more than by
/// its Fresnel term, which is what the mix counts twice. Weights stay small.
#[test]
fn the_mix_exceeds_one_by_no_more_than_the_coat() {
    let (mut most, mut heaviest) = (0.0f64, 0.0f64);
    for roughness in ROUGHNESSES {
        for angle in ANGLES {
            let s = Surface { roughness, base_color: [1.0; 3], ..PLASTIC };
            let (mix, weight) = albedo::<Opaque>(&s, angle);
            let (coat, _) = albedo::<Opaque>(&Surface { base_color: [0.0; 3], ..s }, angle);
            assert!(mix <= 1.0 + coat + 0.02, "{roughness} {angle}°: {mix}");
            most = most.max(mix);
            heaviest = heaviest.max(weight);
        }
    }
    println!("largest albedo of the mix {most}, heaviest draw {heaviest}");
    assert!(heaviest < 4.0, "{heaviest}");
}

/// At normal incidence, where nothing is lost to roughness, the albedo layer is the albedo of a smooth surface.
#[test]
fn the_albedo_layer_is_the_albedo_at_normal_incidence() {
    for s in [LAMBERT, PLASTIC, METAL, THIN, Surface { metallic: 0.4, ..PLASTIC }] {
        let s = Surface { roughness: 0.0, ..s };
        let drawn = draws::<Transmissive>(&s, [0.0, 0.0, 1.0], 20_000, &mut Rng(41));
        let layer = s.params::<f32>().albedo().lane(0);
        for (k, layer) in layer.into_iter().enumerate() {
            let mean = drawn.iter().map(|d| d.weight[k]).sum::<f64>() / drawn.len() as f64;
            assert!((mean - f64::from(layer)).abs() < 0.01, "{s:?}: {mean} {layer}");
        }
    }
}
