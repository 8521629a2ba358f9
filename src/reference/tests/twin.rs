//! The fast BSDF against this one, direction by direction.

use glam::DVec3;

use super::bsdf::{random_direction, solids, surfaces};
use crate::{
    bsdf::{Bsdf, Params, Transmissive},
    reference::{
        Rng,
        bsdf::{Surface, deltas, eval, sample},
    },
    simd::V3,
};

fn v3(v: DVec3) -> V3<f32> {
    let [x, y, z] = v.as_vec3().to_array();
    V3::new(x, y, z)
}

fn dvec3(v: V3<f32>) -> DVec3 {
    DVec3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z))
}

fn params(s: &Surface) -> Params<f32> {
    Params {
        base_color: v3(s.base_color),
        metallic: s.metallic as f32,
        alpha: s.alpha() as f32,
        specular: s.specular as f32,
        specular_color: v3(s.specular_color),
        ior: s.ior as f32,
        transmission: s.transmission as f32,
        solid: s.solid,
        inside: s.inside,
    }
}

fn random_surface(rng: &mut Rng, i: u32) -> Surface {
    let mut color = |max: f64| DVec3::new(rng.uniform(), max * rng.uniform(), rng.uniform());
    let (base_color, specular_color) = (color(1.0), color(1.5));
    Surface {
        base_color,
        specular_color,
        metallic: rng.uniform(),
        roughness: 0.05 + 0.95 * rng.uniform(),
        specular: rng.uniform(),
        ior: 1.0 + rng.uniform(),
        transmission: rng.uniform(),
        solid: i.is_multiple_of(2),
        inside: i % 4 < 2,
    }
}

/// Values agree to 0.1 %, since peaks of narrow lobes magnify the rounding of directions to f32, and deltas of the
/// fast one are among those here.
#[test]
fn fast_bsdf_has_the_values_of_this_one() {
    let mut rng = Rng::new(11, 0);
    let mut all = surfaces();
    all.extend(solids().into_iter().filter(|s| s.ior >= 1.0));
    all.extend((0..1000).map(|i| random_surface(&mut rng, i)));
    for s in all {
        let params = params(&s);
        for k in 0..60 {
            let wo = random_direction(&mut rng, 1.0);
            let wi = match sample(&s, wo, std::array::from_fn(|_| rng.uniform())) {
                Some(sample) if k % 2 == 0 && sample.pdf.is_some() => sample.wi,
                _ => random_direction(&mut rng, if k % 4 == 1 { -1.0 } else { 1.0 }),
            };
            let prepared = Transmissive::prepare(&params, v3(wo));
            let got = dvec3(Transmissive::eval(&prepared, v3(wi)).0);
            let want = eval(&s, wo, wi) * wi.z.abs();
            assert!((got - want).abs().cmple(1e-3 * want + 1e-5).all(), "{s:?} {wo} {wi}: got {got}, want {want}");

            let u = (k as f32 + 0.5) / 60.0;
            let sampled = Transmissive::sample(&prepared, u, (0.3, 0.6));
            if sampled.delta && sampled.valid {
                let got = dvec3(sampled.wi);
                // Towards the critical angle a lobe fans out, however narrow it is elsewhere.
                let apart = 1e-3 / got.z.abs().max(1e-3);
                let near = |delta: &crate::reference::bsdf::Delta| (delta.wi - got).length() < apart;
                assert!(deltas(&s, wo).iter().any(near), "{s:?} {wo}: {:?}", sampled.wi);
            }
        }
    }
}
