//! Scattering of glTF's metallic-roughness surface, in the frame of the shading normal (+z).
//!
//! `docs/model.md`, "Scattering", term by term. What is exactly specular has no
//! value of `f`; it is the list of [`deltas`].

use std::f64::consts::{FRAC_1_PI, TAU};

use glam::{DVec2, DVec3};

/// A surface as textured, and the side it is seen from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Albedo of the dielectric, reflectance of the metal, tint of transmitted light.
    pub base_color: DVec3,
    /// 0 dielectric, 1 metal.
    pub metallic: f64,
    /// Perceptual; the GGX width is its square.
    pub roughness: f64,
    /// Strength of dielectric reflection.
    pub specular: f64,
    /// Tint of dielectric reflection.
    pub specular_color: DVec3,
    /// Index of refraction; 0 stands for infinite.
    pub ior: f64,
    /// Share of the diffuse part that is let through.
    pub transmission: f64,
    /// Bounds a solid, rather than being a thin wall.
    pub solid: bool,
    /// `wo` is on the back side: inside, if `solid`.
    pub inside: bool,
}

impl Default for Surface {
    /// White, wholly rough, dielectric, with the defaults of glTF.
    fn default() -> Self {
        Self {
            base_color: DVec3::ONE,
            metallic: 0.0,
            roughness: 1.0,
            specular: 1.0,
            specular_color: DVec3::ONE,
            ior: 1.5,
            transmission: 0.0,
            solid: false,
            inside: false,
        }
    }
}

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Unit, away from the surface.
    pub wi: DVec3,
    /// f·|cos|/pdf, or a delta's weight over its probability.
    pub weight: DVec3,
    /// 1/sr; `None` for a delta.
    pub pdf: Option<f64>,
}

/// A lobe of no width.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Delta {
    /// Unit, away from the surface.
    pub wi: DVec3,
    /// Radiance towards `wo` per radiance from `wi`.
    pub weight: DVec3,
}

/// What a facet does with light, by its normal's angle to `wo`.
struct Facet {
    /// Below the facets: albedo of the Lambertian part.
    diffuse: DVec3,
    reflected: DVec3,
    /// Before the factor 1/η² for radiance.
    transmitted: DVec3,
}

impl Surface {
    /// GGX width.
    pub fn alpha(&self) -> f64 {
        self.roughness * self.roughness
    }

    /// True if reflection and transmission are deltas.
    pub fn is_specular(&self) -> bool {
        self.alpha() < 1e-4
    }

    /// True if transmission is a delta: also where a rough solid would spread it over less than that angle.
    fn transmits_delta(&self) -> bool {
        self.is_specular() || (self.solid && self.alpha() * (self.ior - 1.0).abs() < 1e-4)
    }

    /// Index of refraction beyond the surface, seen from `wo`, over that before it.
    pub fn eta(&self) -> f64 {
        match self.ior {
            0.0 => f64::INFINITY,
            ior if self.solid && self.inside => 1.0 / ior,
            ior => ior,
        }
    }

    fn facet(&self, cos: f64) -> Facet {
        let Self { base_color, metallic, specular, specular_color, transmission, .. } = *self;
        let f0 = (((self.ior - 1.0) / (self.ior + 1.0)).powi(2) * specular_color).min(DVec3::ONE);
        let dielectric = specular * schlick(f0, cos);
        let kd = 1.0 - dielectric.max_element();

        let eta = self.eta();
        let glass = match fresnel(eta, cos) {
            None if self.solid => DVec3::ONE,
            fx => (fx.unwrap_or(1.0) * specular * specular_color).min(DVec3::ONE),
        };
        let passes = if self.solid && self.ior == 0.0 { 0.0 } else { 1.0 - glass.max_element() };

        let opaque = (1.0 - metallic) * (1.0 - transmission);
        let clear = (1.0 - metallic) * transmission;
        Facet {
            diffuse: opaque * kd * base_color,
            reflected: opaque * dielectric + clear * glass + metallic * schlick(base_color, cos),
            transmitted: clear * passes * base_color,
        }
    }
}

/// F_s with f90 = 1 (Schlick 1994, "An Inexpensive BRDF Model for Physically-based Rendering").
fn schlick(f0: DVec3, cos: f64) -> DVec3 {
    f0 + (DVec3::ONE - f0) * (1.0 - cos).clamp(0.0, 1.0).powi(5)
}

/// Unpolarised Fresnel reflectance; `None` where nothing can be transmitted for the angle alone.
pub fn fresnel(eta: f64, cos: f64) -> Option<f64> {
    if eta.is_infinite() {
        return Some(1.0);
    }
    let cos_t2 = 1.0 - (1.0 - cos * cos) / (eta * eta);
    if cos_t2 <= 0.0 {
        return None;
    }
    let cos_t = cos_t2.sqrt();
    let s = (cos - eta * cos_t) / (cos + eta * cos_t);
    let p = (eta * cos - cos_t) / (eta * cos + cos_t);
    Some((s * s + p * p) / 2.0)
}

/// The direction on the far side of `h` that Snell's law gives, if there is one.
fn refract(wo: DVec3, h: DVec3, eta: f64) -> Option<DVec3> {
    let cos = wo.dot(h);
    let cos_t2 = 1.0 - (1.0 - cos * cos) / (eta * eta);
    (cos_t2 > 0.0).then(|| ((cos / eta - cos_t2.sqrt()) * h - wo / eta).normalize())
}

fn reflect(wo: DVec3, h: DVec3) -> DVec3 {
    (2.0 * wo.dot(h) * h - wo).normalize()
}

fn mirrored(w: DVec3) -> DVec3 {
    DVec3::new(w.x, w.y, -w.z)
}

/// Density of facet normals, 1/sr (Walter et al. 2007, eq. 33).
fn ggx_d(h: DVec3, alpha: f64) -> f64 {
    let k = h.z * h.z * (alpha * alpha - 1.0) + 1.0;
    if h.z > 0.0 { alpha * alpha * FRAC_1_PI / (k * k) } else { 0.0 }
}

/// Smith's Λ (Heitz 2014, "Understanding the Masking-Shadowing Function", eq. 72).
fn ggx_lambda(w: DVec3, alpha: f64) -> f64 {
    let tan2 = (1.0 - w.z * w.z).max(0.0) / (w.z * w.z);
    ((1.0 + alpha * alpha * tan2).sqrt() - 1.0) / 2.0
}

/// Height-correlated masking and shadowing (Heitz 2014, eq. 99).
fn ggx_g(wo: DVec3, wi: DVec3, alpha: f64) -> f64 {
    1.0 / (1.0 + ggx_lambda(wo, alpha) + ggx_lambda(wi, alpha))
}

/// Density of the facet normals that `wo` sees, 1/sr (Heitz 2014, eq. 16).
fn visible_pdf(wo: DVec3, h: DVec3, alpha: f64) -> f64 {
    ggx_d(h, alpha) * wo.dot(h).max(0.0) / (wo.z * (1.0 + ggx_lambda(wo, alpha)))
}

/// A facet normal of that density (Dupuy, Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps").
fn sample_visible(wo: DVec3, alpha: f64, u: DVec2) -> DVec3 {
    let stretched = DVec3::new(alpha * wo.x, alpha * wo.y, wo.z).normalize();
    let z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    let sin = (1.0 - z * z).max(0.0).sqrt();
    let (sin_phi, cos_phi) = (TAU * u.x).sin_cos();
    let h = DVec3::new(sin * cos_phi, sin * sin_phi, z) + stretched;
    DVec3::new(alpha * h.x, alpha * h.y, h.z.max(0.0)).normalize()
}

/// The facet normal that takes light from `wi` to `wo`, on the side of `wo`; `None` if there is none.
fn half_vector(s: &Surface, wo: DVec3, wi: DVec3) -> Option<DVec3> {
    let h = if wi.z > 0.0 {
        wo + wi
    } else if s.solid && s.ior == 0.0 {
        return None;
    } else if s.solid {
        wo + s.eta() * wi
    } else {
        wo + mirrored(wi)
    };
    let h = h.try_normalize()?;
    let h = if h.z < 0.0 { -h } else { h };
    let faces = if s.solid && wi.z < 0.0 { wi.dot(h) < 0.0 } else { true };
    (wo.dot(h) > 0.0 && faces).then_some(h)
}

/// BSDF value without the cosine, 1/sr, of all but the delta lobes; `wo.z` must be positive.
pub fn eval(s: &Surface, wo: DVec3, wi: DVec3) -> DVec3 {
    if wo.z <= 0.0 || wi.z == 0.0 || (wi.z < 0.0 && s.transmits_delta()) {
        return DVec3::ZERO;
    }
    let Some(h) = half_vector(s, wo, wi) else { return DVec3::ZERO };
    let facet = s.facet(wo.dot(h));
    let alpha = s.alpha();
    let diffuse = if wi.z > 0.0 { facet.diffuse * FRAC_1_PI } else { DVec3::ZERO };
    if s.is_specular() {
        return diffuse;
    }
    let dg = ggx_d(h, alpha) * ggx_g(wo, wi, alpha);
    let dv = dg / (4.0 * wo.z * wi.z.abs());
    if wi.z > 0.0 {
        diffuse + facet.reflected * dv
    } else if s.solid {
        // Walter et al. 2007, eq. 21, with the indices divided by that of wo's side.
        let bent = wo.dot(h) + s.eta() * wi.dot(h);
        facet.transmitted * dg * (wi.dot(h) * wo.dot(h)).abs() / (wi.z.abs() * wo.z * bent * bent)
    } else {
        facet.transmitted * dv
    }
}

/// BRDF, 1/sr, for unit directions away from a surface whose normal is +Y; both above it.
pub fn brdf(surface: &Surface, wo: DVec3, wi: DVec3) -> DVec3 {
    let up = |w: DVec3| DVec3::new(w.z, w.x, w.y);
    eval(surface, up(wo), up(wi))
}

/// A way in which a surface scatters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    /// The Lambertian part.
    Diffuse,
    /// Facets that are no mirror, reflecting or transmitting.
    Rough,
    /// What has no width.
    Singular,
}

/// Of [`eval`], what one lobe does.
pub fn eval_lobe(s: &Surface, wo: DVec3, wi: DVec3, lobe: Lobe) -> DVec3 {
    let diffuse = match half_vector(s, wo, wi) {
        Some(h) if wo.z > 0.0 && wi.z > 0.0 => s.facet(wo.dot(h)).diffuse * FRAC_1_PI,
        _ => DVec3::ZERO,
    };
    match lobe {
        Lobe::Diffuse => diffuse,
        Lobe::Rough => eval(s, wo, wi) - diffuse,
        Lobe::Singular => DVec3::ZERO,
    }
}

/// The lobes without width.
pub fn deltas(s: &Surface, wo: DVec3) -> Vec<Delta> {
    let mut deltas = Vec::new();
    let facet = s.facet(wo.z);
    if s.is_specular() {
        deltas.push(Delta { wi: mirrored(-wo), weight: facet.reflected });
    }
    if s.transmits_delta() && !s.solid {
        deltas.push(Delta { wi: -wo, weight: facet.transmitted });
    } else if s.transmits_delta()
        && facet.transmitted != DVec3::ZERO
        && let Some(wi) = refract(wo, DVec3::Z, s.eta())
    {
        deltas.push(Delta { wi, weight: facet.transmitted / (s.eta() * s.eta()) });
    }
    deltas.retain(|delta| delta.weight != DVec3::ZERO);
    deltas
}

/// Probabilities with which [`sample`] takes the Lambertian part and each delta; the rest goes to rough facets.
fn choice(s: &Surface, wo: DVec3, deltas: &[Delta]) -> (f64, Vec<f64>) {
    let facet = s.facet(wo.z);
    // Not times kd of this angle: that of half vectors nearer to wo is larger.
    let diffuse = ((1.0 - s.metallic) * (1.0 - s.transmission) * s.base_color).element_sum();
    // Facets at a slant reflect more than this says: hence at least a fifth for them.
    let rough_reflected = if s.is_specular() { DVec3::ZERO } else { facet.reflected };
    let rough_transmitted = if s.transmits_delta() { DVec3::ZERO } else { facet.transmitted };
    let mut rough = (rough_reflected + rough_transmitted).element_sum();
    let lambert = s.metallic == 0.0 && s.specular == 0.0 && s.transmission == 0.0;
    if !s.is_specular() && !lambert {
        rough = rough.max(0.25 * (diffuse + rough)).max(1e-3);
    }
    // 1/η² is a change of the measure, not of how much light there is.
    let power = |d: &Delta| d.weight.element_sum() * if d.wi.z < 0.0 && s.solid { s.eta().powi(2) } else { 1.0 };
    let total = diffuse + rough + deltas.iter().map(power).sum::<f64>();
    if total == 0.0 {
        return (0.0, vec![0.0; deltas.len()]);
    }
    (diffuse / total, deltas.iter().map(|d| power(d) / total).collect())
}

/// Share of reflection where a facet both reflects and transmits.
fn reflects(s: &Surface, facet: &Facet) -> f64 {
    let transmitted = if s.transmits_delta() { 0.0 } else { facet.transmitted.element_sum() };
    let reflected = facet.reflected.element_sum();
    if reflected + transmitted == 0.0 { 1.0 } else { reflected / (reflected + transmitted) }
}

/// Density with which [`sample`] finds `wi` otherwise than through a delta, 1/sr.
pub fn pdf(s: &Surface, wo: DVec3, wi: DVec3) -> f64 {
    if wo.z <= 0.0 {
        return 0.0;
    }
    let (diffuse, deltas) = choice(s, wo, &deltas(s, wo));
    let lambert = diffuse * wi.z.max(0.0) * FRAC_1_PI;
    let rough = 1.0 - diffuse - deltas.iter().sum::<f64>();
    if s.is_specular() || rough <= 0.0 || wi.z == 0.0 {
        return lambert;
    }
    let Some(h) = half_vector(s, wo, wi) else { return lambert };
    let facet = s.facet(wo.dot(h));
    let chosen = if wi.z > 0.0 { reflects(s, &facet) } else { 1.0 - reflects(s, &facet) };
    // dω(h)/dω(wi): Walter et al. 2007, eq. 14 and 17.
    let jacobian = if wi.z < 0.0 && s.solid {
        let (eta, bent) = (s.eta(), wo.dot(h) + s.eta() * wi.dot(h));
        eta * eta * wi.dot(h).abs() / (bent * bent)
    } else {
        1.0 / (4.0 * wo.dot(h))
    };
    if chosen == 0.0 { lambert } else { lambert + rough * chosen * visible_pdf(wo, h, s.alpha()) * jacobian }
}

/// A direction for light to come from; `u` holds four uniform numbers. `None` where nothing comes of it.
pub fn sample(s: &Surface, wo: DVec3, u: [f64; 4]) -> Option<BsdfSample> {
    let deltas = deltas(s, wo);
    let (diffuse, delta_choice) = choice(s, wo, &deltas);
    let mut rest = u[0];
    for (delta, probability) in deltas.iter().zip(delta_choice) {
        if rest < probability {
            return Some(BsdfSample { wi: delta.wi, weight: delta.weight / probability, pdf: None });
        }
        rest -= probability;
    }
    let wi = if rest < diffuse {
        let (radius, phi) = (u[2].sqrt(), TAU * u[3]);
        DVec3::new(radius * phi.cos(), radius * phi.sin(), (1.0 - u[2]).sqrt())
    } else if s.is_specular() {
        return None;
    } else {
        let h = sample_visible(wo, s.alpha(), DVec2::new(u[2], u[3]));
        let facet = s.facet(wo.dot(h));
        let reflection = u[1] < reflects(s, &facet);
        let wi = match (reflection, s.solid) {
            (true, _) => reflect(wo, h),
            (false, false) => mirrored(reflect(wo, h)),
            (false, true) => refract(wo, h, s.eta())?,
        };
        if (wi.z > 0.0) != reflection {
            return None;
        }
        wi
    };
    let pdf = pdf(s, wo, wi);
    let weight = eval(s, wo, wi) * wi.z.abs() / pdf;
    (pdf > 0.0 && weight != DVec3::ZERO).then_some(BsdfSample { wi, weight, pdf: Some(pdf) })
}
