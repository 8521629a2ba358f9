//! The model's formulas in double precision, as the page has them, and the kernels against them.

use std::f64::consts::PI;

use super::*;
use crate::bsdf::{Lambert, Opaque, Transmissive};

/// The exact unpolarised Fresnel reflectance, as textbooks have it.
pub fn fresnel(eta: f64, cos: f64) -> f64 {
    let sin2_t = (1.0 - cos * cos) / (eta * eta);
    if sin2_t > 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let along = (eta * cos - cos_t) / (eta * cos + cos_t);
    let across = (cos - eta * cos_t) / (cos + eta * cos_t);
    if eta == 1.0 { 0.0 } else { (along * along + across * across) / 2.0 }
}

fn schlick(f0: f64, cos: f64) -> f64 {
    f0 + (1.0 - f0) * (1.0 - cos).powi(5)
}

fn largest(c: [f64; 3]) -> f64 {
    c[0].max(c[1]).max(c[2])
}

/// What facets of the surface reflect as glass, and let through, at |wo·h|.
pub fn glass(s: &Surface, cos: f64) -> ([f64; 3], [f64; 3]) {
    let fx = if s.ior == 0.0 { 1.0 } else { fresnel(s.eta_or_thin(), cos) };
    let total = s.ior != 0.0 && fx == 1.0 && s.solid && s.inside;
    let r = s.specular_color.map(|c| if total { 1.0 } else { (fx * s.specular * c).min(1.0) });
    let blocked = s.ior == 0.0 && s.solid;
    (r, s.base_color.map(|c| if blocked { 0.0 } else { (1.0 - largest(r)) * c }))
}

impl Surface {
    fn eta_or_thin(&self) -> f64 {
        if self.solid { self.eta() } else { self.ior }
    }
    fn alpha(&self) -> f64 {
        // The square of what the kernels are given.
        f64::from((self.roughness as f32).powi(2))
    }
    pub fn is_mirror(&self) -> bool {
        self.alpha() < 1e-4
    }
    /// Transmission is a delta.
    pub fn is_clear(&self) -> bool {
        self.is_mirror() || self.solid && self.alpha() * f64::from(self.ior as f32 - 1.0).abs() < 1e-4
    }
}

/// Dielectric coat and metal, reflectance at |wo·h|: `Fd` and `F_s(c, 1)`.
pub fn schlick_parts(s: &Surface, cos: f64) -> ([f64; 3], [f64; 3]) {
    let r0 = ((s.ior - 1.0) / (s.ior + 1.0)).powi(2);
    let fd = s.specular_color.map(|c| s.specular * schlick((r0 * c).min(1.0), cos));
    (fd, s.base_color.map(|c| schlick(c, cos)))
}

/// f·|cos θi| without deltas.
pub fn f_cos(s: &Surface, wo: [f64; 3], wi: [f64; 3]) -> [f64; 3] {
    let a2 = s.alpha().powi(2);
    let (no, ni) = (wo[2], wi[2].abs());
    // D and V at a unit half vector.
    let dv = |h: [f64; 3]| {
        let d = a2 / (PI * (h[0] * h[0] + h[1] * h[1] + a2 * h[2] * h[2]).powi(2));
        let smith = |a: f64, b: f64| a * (b * b * (1.0 - a2) + a2).sqrt();
        d * 0.5 / (smith(no, ni) + smith(ni, no))
    };
    let half = |wi: [f64; 3], eta: f64| {
        let h = [wo[0] + eta * wi[0], wo[1] + eta * wi[1], wo[2] + eta * wi[2]];
        let length = dot(h, h).sqrt().copysign(h[2]);
        h.map(|h| h / length)
    };
    let (m, t) = (s.metallic, s.transmission);
    let mut f = [0.0; 3];
    if wi[2] > 0.0 {
        let h = half(wi, 1.0);
        let (fd, fm) = schlick_parts(s, dot(wo, h).abs());
        let (r, _) = glass(s, dot(wo, h).abs());
        let dv = if s.is_mirror() { 0.0 } else { dv(h) };
        for k in 0..3 {
            let opaque = (1.0 - largest(fd)) * s.base_color[k] / PI + fd[k] * dv;
            f[k] = (1.0 - m) * ((1.0 - t) * opaque + t * r[k] * dv) + m * fm[k] * dv;
        }
    } else if !s.is_clear() && !s.solid {
        let h = half([wi[0], wi[1], -wi[2]], 1.0);
        let (_, through) = glass(s, dot(wo, h).abs());
        f = through.map(|c| (1.0 - m) * t * c * dv(h));
    } else if !s.is_clear() && s.ior > 0.0 {
        // Walter et al. 2007, eq. 21, light from wi: η_i on its side, η_o on the side of wo.
        let (eta_o, eta_i) = if s.inside { (s.ior, 1.0) } else { (1.0, s.ior) };
        let h = half(wi, eta_i / eta_o);
        let (o, i) = (dot(wo, h), dot(wi, h));
        if o > 0.0 && i < 0.0 {
            let (_, through) = glass(s, o);
            let g = dv(h) * 4.0 * no * ni;
            let jacobian = (i * o).abs() / (ni * no) * eta_o * eta_o / (eta_i * i + eta_o * o).powi(2);
            f = through.map(|c| (1.0 - m) * t * c * g * jacobian);
        }
    }
    f.map(|f| f * ni)
}

/// How far one rounding of every component of `wo` and `wi` moves the values.
fn spread(s: &Surface, wo: [f64; 3], wi: [f64; 3]) -> f64 {
    let eps = 1.5e-7;
    let at = f_cos(s, wo, wi);
    let mut most = 0.0f64;
    for k in 0..6 {
        for sign in [-1.0, 1.0] {
            let (mut o, mut i) = (wo, wi);
            if k < 3 {
                o[k] += sign * eps
            } else {
                i[k - 3] += sign * eps
            }
            let near = f_cos(s, o, i);
            let moved = largest([0, 1, 2].map(|k| (near[k] - at[k]).abs()));
            most = most.max(if moved.is_finite() { moved } else { f64::INFINITY });
        }
    }
    most
}

#[track_caller]
fn check_plain<B: Bsdf>(s: &Surface, wo: [f64; 3], wi: [f64; 3]) {
    // The kernels see rounded directions.
    let [wo, wi] = [wo, wi].map(|v| v.map(|v| f64::from(v as f32)));
    let (got, _) = eval_one::<B>(s, wo, wi);
    let want = f_cos(s, wo, wi);
    let slack = spread(s, wo, wi);
    for k in 0..3 {
        let tolerance = 3e-5 * want[k] + 4.0 * slack + 1e-7;
        assert!((got[k] - want[k]).abs() <= tolerance, "{s:?}\n{wo:?} {wi:?}\ngot {got:?}\nwant {want:?}");
    }
}

/// 400,000 pairs of directions and surfaces, of which a part is near the mirror or the refracted
/// direction, where lobes are. The tolerance is 3e-5 relative beyond what rounding the directions explains.
#[test]
fn values_are_those_of_the_formulas() {
    let mut rng = Rng(1);
    let mut large = 0;
    for i in 0..400_000 {
        let mut s = rng.surface();
        // The textbook's Fresnel loses its digits here, also in double precision.
        if s.ior == 1.0 + 1e-6 {
            s.ior = 1.0 + f64::from(f32::EPSILON) * 1024.0;
        }
        s.ior = f64::from(s.ior as f32);
        let wo = rng.direction_up();
        let mut wi = rng.direction();
        if i % 2 == 0 {
            // Near the peak, on a random side.
            let n = rng.direction_up();
            let blend = s.alpha() * rng.unit();
            let h: [f64; 3] = [0, 1, 2].map(|k| blend * n[k] + if k == 2 { 1.0 } else { 0.0 });
            let h = h.map(|x| x / dot(h, h).sqrt());
            let cos = dot(wo, h);
            wi = [0, 1, 2].map(|k| 2.0 * cos * h[k] - wo[k]);
            if rng.next() & 1 == 0 {
                wi[2] = -wi[2];
                let eta = s.eta();
                let g2 = eta * eta - 1.0 + cos * cos;
                if s.solid && cos > 0.0 && g2 > 0.0 && eta > 0.0 && eta.is_finite() {
                    let sum = cos + g2.sqrt();
                    wi = [0, 1, 2].map(|k| (-(eta * eta - 1.0) / sum * h[k] - wo[k]) / eta);
                }
            }
        }
        check_plain::<Transmissive>(&s, wo, wi);
        large += u32::from(largest(f_cos(&s, wo, wi)) > 1.0);
        if s.is_opaque() || wi[2] > 0.0 {
            let s = Surface { transmission: 0.0, ..s };
            check_plain::<Opaque>(&s, wo, wi);
        }
        check_plain::<Lambert>(&Surface { base_color: s.base_color, ..LAMBERT }, wo, wi);
    }
    assert!(large > 40_000, "only {large} pairs in a lobe");
}

/// Metallic 0, specular 0, transmission 0 gives the bits of c·(cos·(1/π)) from every version.
#[test]
fn without_specular_it_is_exactly_lambert() {
    let mut rng = Rng(2);
    for _ in 0..100_000 {
        let s = Surface { specular: 0.0, metallic: 0.0, transmission: 0.0, ..rng.surface() };
        let (wo, wi) = (rng.direction_up(), rng.direction_up());
        let want = s.base_color.map(|c| f64::from(c as f32 * (wi[2] as f32 * std::f32::consts::FRAC_1_PI)));
        assert_eq!(eval_one::<Lambert>(&s, wo, wi).0, want);
        assert_eq!(eval_one::<Opaque>(&s, wo, wi).0, want, "{s:?}");
        assert_eq!(eval_one::<Transmissive>(&s, wo, wi).0, want, "{s:?}");
    }
}

/// f(wo, wi) = f(wi, wo) for reflection and thin walls; for refraction η²·f(wo, wi), η from wo's side to
/// wi's, equals f(wi, wo) seen from the other side.
#[test]
fn light_goes_both_ways_alike() {
    let mut rng = Rng(3);
    let mut compared = 0;
    for _ in 0..300_000 {
        let mut s = rng.surface();
        s.roughness = rng.pick(&[0.1, 0.3, 0.6, 1.0]);
        s.ior = rng.pick(&[1.2, 1.5, 2.0, 4.0]);
        // Grazing directions amplify rounding without bound.
        let [wo, wi] = [(); 2].map(|()| direction(0.05 + 0.95 * rng.unit(), rng.unit() * 2.0 * PI));
        let through = rng.next() & 1 == 0;
        let (s_back, wo_back, wi_there, wi_back) = match (through, s.solid) {
            (false, _) => (s, wi, wi, wo),
            // The frame is flipped to wi's side.
            (true, solid) => {
                let flip = |v: [f64; 3]| [v[0], v[1], -v[2]];
                let back = Surface { inside: solid && !s.inside, ..s };
                (back, wi, flip(wi), flip(wo))
            }
        };
        let there = eval_one::<Transmissive>(&s, wo, wi_there).0.map(|f| f / wi[2]);
        let back = eval_one::<Transmissive>(&s_back, wo_back, wi_back).0.map(|f| f / wo[2]);
        let factor = if through { s.eta().powi(2) } else { 1.0 };
        let slack = 4.0 * spread(&s, wo, wi_there) / wi[2] + 4.0 * spread(&s_back, wo_back, wi_back) / wo[2];
        for k in 0..3 {
            let (a, b) = (there[k] * factor, back[k]);
            assert!((a - b).abs() <= 1e-4 * a.max(b) + slack + 1e-6, "{s:?} {wo:?} {wi_there:?}: {a} {b}");
            compared += u32::from(a > 1e-3);
        }
    }
    assert!(compared > 300_000, "only {compared} values worth comparing");
}

/// Against the textbook's form where that is exact enough, and against the limit near index 1.
#[test]
fn fresnel_is_exact_and_keeps_its_digits_near_one() {
    use crate::bsdf::fresnel::Interface;
    let mut rng = Rng(4);
    for _ in 0..200_000 {
        let ior = f64::from((1.01 + 3.0 * rng.unit()) as f32);
        let cos = f64::from(rng.unit() as f32);
        for leaving in [false, true] {
            let got = f64::from(Interface::<f32>::new(ior as f32, leaving).meet(cos as f32).reflectance);
            let eta = if leaving { 1.0 / ior } else { ior };
            let want = fresnel(eta, cos);
            // Next to the critical angle the slope is infinite.
            let g2 = eta * eta - 1.0 + cos * cos;
            let slack = if leaving { 4e-7 / (eta * eta * cos * g2.abs().sqrt().max(2.5e-4)) } else { 0.0 };
            assert!((got - want).abs() <= 3e-6 + slack, "{ior} {cos} {leaving}: {got} {want}");
        }
    }
    for exponent in 1..=20 {
        // δ = ior − 1 exactly; at normal incidence R = (δ/(2+δ))².
        let delta = 2f64.powi(-exponent);
        let got = Interface::<f32>::new(1.0 + delta as f32, false).meet(1.0).reflectance;
        let want = (delta / (2.0 + delta)).powi(2);
        assert!((f64::from(got) / want - 1.0).abs() < 1e-6, "{delta}: {got} {want}");
    }
    assert_eq!(Interface::<f32>::new(1.0, true).meet(0.0).reflectance, 0.0);
}
