//! The BSDF by quadrature: reciprocity, energy, and that sampling fits.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use crate::reference::{
    Rng,
    bsdf::{Surface, deltas, eval, fresnel, pdf, sample},
};

pub fn direction(cos: f64, phi: f64) -> DVec3 {
    let sin = (1.0 - cos * cos).sqrt();
    DVec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

pub fn random_direction(rng: &mut Rng, z: f64) -> DVec3 {
    direction(0.02 + 0.98 * rng.uniform(), TAU * rng.uniform()) * DVec3::new(1.0, 1.0, z)
}

/// A spread of opaque and thin surfaces.
pub fn surfaces() -> Vec<Surface> {
    let mut all = Vec::new();
    for roughness in [0.0, 0.25, 0.6, 1.0] {
        for metallic in [0.0, 0.5, 1.0] {
            for transmission in [0.0, 0.4, 1.0] {
                for (specular, ior) in [(1.0, 1.5), (0.0, 1.5), (0.7, 0.0), (1.0, 1.0)] {
                    all.push(Surface {
                        base_color: DVec3::new(0.9, 0.5, 0.1),
                        specular_color: DVec3::new(1.0, 0.8, 1.3),
                        roughness,
                        metallic,
                        transmission,
                        specular,
                        ior,
                        ..Surface::default()
                    });
                }
            }
        }
    }
    all
}

pub fn solids() -> Vec<Surface> {
    let mut all = Vec::new();
    for inside in [false, true] {
        for roughness in [0.2, 0.5, 1.0] {
            for ior in [1.0, 1.1, 1.5, 2.4, 0.8] {
                all.push(Surface { solid: true, transmission: 1.0, inside, roughness, ior, ..Surface::default() });
            }
        }
    }
    all
}

/// Quadrature of g over all directions, the upper half about the mirror direction of `wo`, the lower about where
/// light goes through.
fn integrate(s: &Surface, wo: DVec3, g: impl Fn(DVec3) -> DVec3) -> DVec3 {
    let below = if s.solid { refracted(s, wo) } else { -wo };
    [mirror(wo), below].into_iter().map(|axis| integrate_half(axis, &g)).sum()
}

fn integrate_half(axis: DVec3, g: impl Fn(DVec3) -> DVec3) -> DVec3 {
    // Polar coordinates about the axis, denser towards it: θ = π x³.
    let (n, m) = (400, 120);
    let x = axis.any_orthonormal_vector();
    let y = axis.cross(x);
    let mut sum = DVec3::ZERO;
    for i in 0..n {
        let u = (f64::from(i) + 0.5) / f64::from(n);
        let (theta, dtheta) = (PI * u.powi(3), 3.0 * PI * u * u / f64::from(n));
        for j in 0..m {
            let phi = TAU * (f64::from(j) + 0.5) / f64::from(m);
            let w = theta.cos() * axis + theta.sin() * (phi.cos() * x + phi.sin() * y);
            if w.z * axis.z > 0.0 {
                sum += theta.sin() * dtheta * TAU / f64::from(m) * g(w);
            }
        }
    }
    sum
}

fn mirror(wo: DVec3) -> DVec3 {
    DVec3::new(-wo.x, -wo.y, wo.z)
}

/// By Snell's law, or straight down where there is total reflection.
fn refracted(s: &Surface, wo: DVec3) -> DVec3 {
    let eta = if s.inside { 1.0 / s.ior } else { s.ior };
    let (x, y) = (-wo.x / eta, -wo.y / eta);
    let rest = 1.0 - x * x - y * y;
    if rest > 0.0 { DVec3::new(x, y, -rest.sqrt()) } else { DVec3::NEG_Z }
}

/// f(wo, wi) = f(wi, wo) for everything that does not refract; below a thin wall, both from the other side.
#[test]
fn what_does_not_refract_is_reciprocal() {
    let mut rng = Rng::new(1, 1);
    for s in surfaces() {
        for _ in 0..50 {
            let (a, b) = (random_direction(&mut rng, 1.0), random_direction(&mut rng, 1.0));
            let below = |w: DVec3| w * DVec3::new(1.0, 1.0, -1.0);
            for (there, back) in [(eval(&s, a, b), eval(&s, b, a)), (eval(&s, a, below(b)), eval(&s, b, below(a)))] {
                assert!((there - back).abs().max_element() <= 1e-9 * (1.0 + there.max_element()), "{s:?}");
            }
        }
    }
}

/// η²-scaled: f(wo, wi)/f(wi, wo) = (η_o/η_i)² through a refracting boundary (Walter et al. 2007, section 4.2).
#[test]
fn refraction_is_reciprocal_up_to_eta_squared() {
    let mut rng = Rng::new(2, 1);
    let mut seen = 0;
    for s in solids() {
        for _ in 0..200 {
            let (a, b) = (random_direction(&mut rng, 1.0), random_direction(&mut rng, -1.0));
            let other = Surface { inside: !s.inside, ..s };
            // Seen from below, z points the other way.
            let turn = |w: DVec3| w * DVec3::new(1.0, -1.0, -1.0);
            let (there, back) = (eval(&s, a, b).y, eval(&other, turn(b), turn(a)).y);
            let eta = if s.inside { 1.0 / s.ior } else { s.ior };
            assert!((there * eta * eta - back).abs() <= 1e-6 * (1e-6 + back), "{s:?} {there} {back}");
            seen += usize::from(there > 0.0);
        }
    }
    assert!(seen > 500);
}

/// Lobes one at a time reflect and transmit at most all of the light: metal, coat over black, glass of both kinds.
///
/// Light that goes into a denser solid is squeezed: its radiance counts η² here.
#[test]
fn each_lobe_keeps_or_loses_energy() {
    let dielectric = Surface { base_color: DVec3::ZERO, ..Surface::default() };
    let lobes = [
        Surface { metallic: 1.0, ..Surface::default() },
        dielectric,
        Surface { ior: 0.0, ..dielectric },
        Surface { specular: 0.0, ..Surface::default() },
        Surface { transmission: 1.0, ..Surface::default() },
        Surface { transmission: 1.0, ior: 1.0, ..Surface::default() },
        Surface { transmission: 1.0, solid: true, ..Surface::default() },
        Surface { transmission: 1.0, solid: true, inside: true, ..Surface::default() },
    ];
    for lobe in lobes {
        for roughness in [0.0, 0.3, 0.6, 1.0] {
            for cos in [1.0, 0.7, 0.3, 0.08] {
                let s = Surface { roughness, ..lobe };
                let eta2 = if s.inside { s.ior.powi(-2) } else { s.ior.powi(2) };
                let measure = |wi: DVec3| if s.solid && wi.z < 0.0 { eta2 } else { 1.0 };
                let wo = direction(cos, 0.5);
                let continuous = integrate(&s, wo, |wi| eval(&s, wo, wi) * wi.z.abs() * measure(wi));
                let delta: DVec3 = deltas(&s, wo).iter().map(|d| d.weight * measure(d.wi)).sum();
                let albedo = (continuous + delta).max_element();
                assert!(albedo <= 1.0 + 2e-3, "{s:?} at {cos}: {albedo}");
                let smooth_glass = s.transmission == 1.0 && roughness == 0.0;
                assert!(!smooth_glass || (albedo - 1.0).abs() < 1e-12, "smooth glass loses nothing: {albedo}");
            }
        }
    }
}

/// Without specular reflection what is left is c/π, exactly.
#[test]
fn no_specular_is_exactly_lambert() {
    let base_color = DVec3::new(0.2, 0.5, 1.0);
    let s = Surface { base_color, specular: 0.0, roughness: 0.3, ..Surface::default() };
    for cos in [1.0, 0.5, 0.01] {
        assert_eq!(eval(&s, direction(cos, 1.0), direction(0.3, 4.0)), base_color / PI);
    }
    assert!(deltas(&s, DVec3::Z).is_empty());
}

/// The mean weight of samples is the albedo by quadrature, and the density integrates to the share of
/// samples that are not deltas or lost below the surface (at most 1).
#[test]
fn sampling_fits_eval_and_pdf() {
    let mut rng = Rng::new(3, 1);
    let chosen = surfaces().into_iter().step_by(5).chain(solids());
    for s in chosen.filter(|s| s.is_specular() || s.roughness > 0.2) {
        let wo = direction(0.6, 0.5);
        let mut albedo = integrate(&s, wo, |wi| eval(&s, wo, wi) * wi.z.abs());
        let density = integrate(&s, wo, |wi| DVec3::splat(pdf(&s, wo, wi))).x;
        albedo += deltas(&s, wo).iter().map(|d| d.weight).sum::<DVec3>();

        let n = 40_000;
        let (mut mean, mut square, mut found, mut largest) = (DVec3::ZERO, DVec3::ZERO, 0, 0.0f64);
        for _ in 0..n {
            let u = std::array::from_fn(|_| rng.uniform());
            let Some(sample) = sample(&s, wo, u) else { continue };
            if let Some(p) = sample.pdf {
                found += 1;
                let expected = eval(&s, wo, sample.wi) * sample.wi.z.abs() / p;
                assert!((expected - sample.weight).abs().max_element() < 1e-9);
            }
            mean += sample.weight / f64::from(n);
            square += sample.weight * sample.weight / f64::from(n);
            largest = largest.max(sample.weight.max_element());
        }
        let error = ((square - mean * mean) / f64::from(n)).max(DVec3::ZERO);
        let error = DVec3::new(error.x.sqrt(), error.y.sqrt(), error.z.sqrt());
        // Five standard errors over some 60 cases of three channels; quadrature to 0.3 %.
        let difference = (mean - albedo).abs();
        assert!(difference.cmple(5.0 * error + 3e-3 * albedo + 1e-9).all(), "{s:?}: sampled {mean}, albedo {albedo}");
        let share = f64::from(found) / f64::from(n);
        assert!(share <= density + 0.015 && density < 1.01, "{s:?}: density {density}, found {share}");
        assert!(largest < 12.0, "{s:?}: a sample weighs {largest}");
    }
}

/// Normal incidence ((η−1)/(η+1))²; at Brewster's angle half of what is polarised across; total reflection
/// beyond the critical angle; the same both ways along a ray.
#[test]
fn fresnel_has_its_known_values() {
    assert!((fresnel(1.5, 1.0).unwrap() - 0.04).abs() < 1e-15);
    let brewster = 1.5f64.atan().cos();
    let s = (1.0 - 1.5f64.powi(2)) / (1.0 + 1.5f64.powi(2));
    assert!((fresnel(1.5, brewster).unwrap() - s * s / 2.0).abs() < 1e-12);
    let critical = (1.0 - 1.5f64.powi(-2)).sqrt();
    assert!(fresnel(1.0 / 1.5, critical - 1e-6).is_none());
    assert!(fresnel(1.0 / 1.5, critical + 1e-6).unwrap() < 1.0);
    let (cos_i, cos_t) = (0.5f64, (1.0 - 0.75 / 2.25f64).sqrt());
    assert!((fresnel(1.5, cos_i).unwrap() - fresnel(1.0 / 1.5, cos_t).unwrap()).abs() < 1e-12);
    assert_eq!(fresnel(f64::INFINITY, 0.3), Some(1.0));
}
