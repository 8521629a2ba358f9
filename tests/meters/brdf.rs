//! BRDFs as they are measured against their formula, and against what a matt surface must send back.

use std::f64::consts::PI;

use glam::Vec3;
use wavecast::{
    measure::{
        brdf::{albedo, brdf},
        meter::Effort,
    },
    world::Material,
};

fn effort(samples: u64) -> Effort {
    Effort { error: None, samples: Some(samples), seed: 20_261_203, ..Effort::default() }
}

/// Matt, coated, metal and glass, rough and smooth, thin and solid; from all sides. What is left is the rounding of f32.
#[test]
fn measured_brdfs_are_their_formulas() {
    let paint = Material { metallic: 0.0, base_color: Vec3::new(0.8, 0.3, 0.1), ..Material::default() };
    let views: Vec<f64> = (-17..=17).map(|i| f64::from(i) * 5.0).collect();
    for (name, material, tolerance) in [
        ("matt", Material::lambert(Vec3::new(0.9, 0.5, 0.2)), 2e-6),
        ("paint", Material { roughness: 0.5, ..paint.clone() }, 2e-5),
        ("glossy paint", Material { roughness: 0.2, ..paint.clone() }, 2e-3),
        ("rough metal", Material { base_color: Vec3::new(1.0, 0.8, 0.3), roughness: 0.7, ..Material::default() }, 2e-5),
        ("frosted glass", Material { roughness: 0.4, ..Material::glass(1.5) }, 5e-5),
        ("frosted pane", Material { roughness: 0.4, thickness: 0.0, transmission: 0.6, ..paint.clone() }, 5e-5),
        ("half metal", Material { metallic: 0.5, specular: 0.6, ior: 1.8, roughness: 0.4, ..paint }, 5e-5),
    ] {
        let mut worst = 0.0_f64;
        for incident in [0.0, 30.0, 60.0, 80.0] {
            let samples = if material.transmission > 0.0 { 1 << 15 } else { 16 };
            for point in brdf(&material, incident, &views, &effort(samples), &()) {
                for (got, want) in point.measured.rgb.iter().zip(point.formula) {
                    assert!(want.is_finite() && (want > 0.0 || name == "matt"));
                    // Of what lets light through, either side is looked at by chance.
                    let noise = 6.0 * got.variance.sqrt();
                    assert!(noise < 0.02 * want.max(1e-3), "{name} {incident}° {point:?}");
                    let off = ((got.value - want).abs() - noise).max(0.0) / want.max(1e-3);
                    worst = worst.max(off);
                    assert!(off < tolerance, "{name} {incident}° {point:?}");
                }
            }
        }
        println!("{name}: within {worst:.1e} of its formula");
    }
}

/// A matt surface sends ρ/π of each lux into every direction, and of even light ρ; nothing sends more than it gets, and a mirror
/// has no BRDF that could be measured.
#[test]
fn matt_surfaces_are_equally_bright_from_all_sides() {
    let matt = Material::lambert(Vec3::splat(0.6));
    for point in brdf(&matt, 50.0, &[-70.0, 0.0, 35.0], &effort(16), &()) {
        assert!((point.measured.value.value * PI / 0.6 - 1.0).abs() < 1e-5, "{point:?}");
    }
    for degrees in [0.0, 45.0, 80.0] {
        let got = albedo(&matt, degrees, &effort(1 << 14), &()).value;
        assert!((got.value - 0.6).abs() < 1e-4 + 4.0 * got.variance.sqrt(), "{degrees} {got:?}");
        for material in [
            Material { roughness: 0.3, ..Material::default() },
            Material { metallic: 0.0, roughness: 0.5, base_color: Vec3::splat(0.8), ..Material::default() },
            Material { roughness: 0.3, thickness: 0.0, ..Material::glass(1.5) },
        ] {
            let got = albedo(&material, degrees, &effort(1 << 14), &()).value;
            assert!(got.value > 0.5 && got.value < 1.0 + 4.0 * got.variance.sqrt() + 1e-5, "{degrees} {got:?}");
        }
    }
    let mirror = Material { roughness: 0.0, ..Material::default() };
    assert_eq!(brdf(&mirror, 30.0, &[30.0], &effort(16), &())[0].measured.value.value, 0.0);
    assert!((albedo(&mirror, 30.0, &effort(64), &()).value.value - 1.0).abs() < 1e-5);
}
