//! Whatever comes in, numbers come out.

use super::*;
use crate::bsdf::{Lambert, Opaque, Transmissive};

fn check_finite<B: Bsdf>(seed: u64, blocks: usize) -> f64 {
    let mut rng = Rng(seed);
    let mut most = 0.0f64;
    for _ in 0..blocks {
        let surfaces = [(); 8].map(|()| {
            let s = rng.surface();
            let roughness = rng.unit();
            Surface { roughness: rng.pick(&[s.roughness, roughness, 0.01, 0.010_001]), ..s }
        });
        let z = [(); 8].map(|()| {
            let u = rng.unit();
            rng.pick(&[1.0, u, u * 1e-4, 1e-6, 1e-12, 1e-30, 1.0 - 1e-7])
        });
        let wo = V3::<f32x8>::from_fn(|i| direction(z[i], rng.unit() * 7.0).map(|v| v as f32));
        let wi = V3::<f32x8>::from_fn(|i| {
            let o = wo.lane(i).map(f64::from);
            let away = direction(rng.unit() * 2.0 - 1.0, rng.unit() * 7.0);
            let grazing = direction(rng.pick(&[1e-30, -1e-30, 0.0, 1e-7, -1e-7]), rng.unit() * 7.0);
            let mirror = [-o[0], -o[1], o[2]];
            let all = [away, grazing, mirror, o.map(|o| -o), o, [-o[0], -o[1], 0.0], [0.0, 0.0, -1.0]];
            rng.pick(&all).map(|v| v as f32)
        });
        let edge = |rng: &mut Rng| {
            Real::from_fn(|_| {
                let u = rng.unit() as f32;
                rng.pick(&[u, u, u, 0.0, 0.5, f32::EPSILON, 1.0 - f32::EPSILON / 2.0])
            })
        };
        let prepared = B::prepare(&gather(&surfaces), wo);
        let (f, pdf) = B::eval(&prepared, wi);
        let s = B::sample(&prepared, edge(&mut rng), (edge(&mut rng), edge(&mut rng)));
        for (i, drawn) in lanes(&s).enumerate() {
            let context = || format!("{:?} wo {:?} wi {:?}\n{drawn:?}", surfaces[i], wo.lane(i), wi.lane(i));
            let fine = |v: f64| v.is_finite() && v >= 0.0;
            let [a, b, c] = f.lane(i).map(f64::from);
            let values = [a, b, c, f64::from(Real::lane(pdf, i)), drawn.pdf, drawn.eta_scale];
            assert!(values.into_iter().chain(drawn.weight).all(fine), "{values:?} {}", context());
            assert!((dot(drawn.wi, drawn.wi) - 1.0).abs() < 1e-5, "{}", context());
            assert!(drawn.valid || drawn.weight == [0.0; 3], "{}", context());
            assert!(!drawn.valid || drawn.transmitted == (drawn.wi[2] < 0.0), "{}", context());
            assert!(!drawn.valid || drawn.delta == (drawn.pdf == 0.0), "{}", context());
            for w in drawn.weight {
                let w = w * drawn.eta_scale;
                if w > most {
                    most = w;
                    if w > 25.0 {
                        panic!("weight {w} {}", context());
                    }
                }
            }
        }
    }
    most
}

/// 8 · 400,000 random and adversarial draws and values a version: none negative, infinite or NaN; directions of unit
/// length and on the side they say; weights (times η²) below what starving a lobe down to 1/20 could give.
#[test]
fn nothing_is_ever_negative_infinite_or_undefined() {
    let most = [
        check_finite::<Lambert>(20, 400_000),
        check_finite::<Opaque>(21, 400_000),
        check_finite::<Transmissive>(22, 400_000),
    ];
    println!("largest weights {most:?}");
}
