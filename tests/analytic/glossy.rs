//! Mirrors and GGX: reflected skies and lamps, against quadrature of the model's formulas.

use glam::{DVec3, Vec3};
use wavecast::world::{Environment, Material, Scene};

use super::{
    Case, ceiling, lamp, look_at_point,
    oracle::{self, Ggx, fresnel, over_hemisphere, over_quad, schlick},
    plane,
};
use crate::common::show;

/// Straight above the camera's own ray lies nothing that could be in its way.
const EYE: DVec3 = DVec3::new(-2.0, 2.0, 0.0);

/// Opaque surface of the model, in f64: BRDF per channel, on the plane with normal +Y.
#[derive(Clone, Copy)]
struct Coat {
    base: Vec3,
    metallic: f32,
    roughness: f32,
    specular: f32,
    specular_color: Vec3,
}

impl Coat {
    fn material(&self) -> Material {
        let Self { base: base_color, metallic, roughness, specular, specular_color } = *self;
        Material {
            base_color,
            metallic,
            roughness,
            specular,
            specular_color,
            double_sided: true,
            ..Material::default()
        }
    }

    fn ggx(&self) -> Ggx {
        Ggx(f64::from(self.roughness).powi(2))
    }

    /// Reflectance of the dielectric's facets in each channel.
    fn dielectric(&self, cos: f64) -> [f64; 3] {
        let tint = self.specular_color.as_dvec3().to_array();
        tint.map(|tint| f64::from(self.specular) * schlick((0.04 * tint).min(1.0), cos))
    }

    /// Albedo of the part below the facets, and reflectance of the facets.
    fn parts(&self, channel: usize, cos: f64) -> (f64, f64) {
        let (m, c) = (f64::from(self.metallic), f64::from(self.base[channel]));
        let dielectric = self.dielectric(cos);
        let kd = 1.0 - dielectric.into_iter().fold(0.0, f64::max);
        ((1.0 - m) * kd * c, (1.0 - m) * dielectric[channel] + m * schlick(c, cos))
    }

    fn diffuse(&self, channel: usize, wo: DVec3, wi: DVec3) -> f64 {
        self.parts(channel, wo.dot((wo + wi).normalize())).0 / std::f64::consts::PI
    }

    fn brdf(&self, channel: usize, wo: DVec3, wi: DVec3) -> f64 {
        let (diffuse, facets) = self.parts(channel, wo.dot((wo + wi).normalize()));
        diffuse / std::f64::consts::PI + facets * self.ggx().dv(wo, wi)
    }
}

const METAL: Coat =
    Coat { base: Vec3::new(0.75, 0.5, 0.25), metallic: 1.0, roughness: 0.3, specular: 1.0, specular_color: Vec3::ONE };
const PAINT: Coat = Coat {
    base: Vec3::new(0.75, 0.25, 0.5),
    metallic: 0.0,
    roughness: 0.4,
    specular: 1.0,
    specular_color: Vec3::new(1.0, 0.5, 2.0),
};

fn floor(coat: Coat) -> Scene {
    let mut scene = Scene::new();
    show(&mut scene, plane(0.0), coat.material());
    look_at_point(&mut scene, EYE, DVec3::ZERO);
    scene
}

/// ∫ f cosθ L cosθ' / d² dA over a square lamp.
fn under_lamp(name: &str, coat: Coat, spp: u32) -> Case {
    let mut scene = floor(coat);
    let (mesh, [origin, u, v]) = ceiling(Vec3::new(0.75, 1.5, -0.5), 1.5);
    show(&mut scene, mesh, lamp(4.0));
    let wo = EYE.normalize();
    let truth = std::array::from_fn(|channel| {
        over_quad(origin, u, v, |q| {
            let wi = q.normalize();
            4.0 * coat.brdf(channel, wo, wi) * wi.y * wi.y / q.length_squared()
        })
    });
    Case::new(name, scene, truth, spp)
}

/// ∫ f cosθ L dω under a uniform sky of 2 nit.
fn under_sky(name: &str, coat: Coat, spp: u32) -> Case {
    let mut scene = floor(coat);
    scene.spawn((Environment::constant(Vec3::splat(2.0)),));
    let wo = EYE.normalize();
    let truth = std::array::from_fn(|channel| 2.0 * over_hemisphere(|wi| coat.brdf(channel, wo, wi)));
    Case::new(name, scene, truth, spp)
}

/// The coat is a mirror of weight F_s(wo·n), the rest as before.
fn smooth_paint_under_sky() -> Case {
    let coat = Coat { roughness: 0.0, ..PAINT };
    let mut scene = floor(coat);
    scene.spawn((Environment::constant(Vec3::splat(2.0)),));
    let wo = EYE.normalize();
    let truth = std::array::from_fn(|channel| {
        2.0 * (over_hemisphere(|wi| coat.diffuse(channel, wo, wi)) + coat.parts(channel, wo.y).1)
    });
    Case::new("smooth paint under a uniform sky", scene, truth, 16_384)
}

/// A mirror shows the lamp above it, times F_s.
fn mirror() -> Case {
    let coat = Coat { roughness: 0.0, ..METAL };
    let mut scene = floor(coat);
    let (mesh, _) = ceiling(Vec3::new(1.0, 2.0, -1.0), 2.0);
    show(&mut scene, mesh, lamp(4.0));
    let truth = std::array::from_fn(|channel| 4.0 * coat.parts(channel, EYE.normalize().y).1);
    Case::new("metal mirror shows a lamp", scene, truth, 16)
}

/// A thin rough plate with light on the far side: T·D·V of the mirrored direction.
fn through_thin_plate() -> Case {
    let (ior, roughness) = (1.5_f32, 0.4_f32);
    let mut scene = Scene::new();
    let glass = Material { base_color: Vec3::new(0.75, 0.5, 1.0), roughness, thickness: 0.0, ..Material::glass(ior) };
    show(&mut scene, plane(0.0), glass);
    look_at_point(&mut scene, EYE, DVec3::ZERO);
    let (mesh, [origin, u, v]) = floor_lamp();
    show(&mut scene, mesh, lamp(4.0));
    let wo = EYE.normalize();
    let ggx = Ggx(f64::from(roughness).powi(2));
    let truth = [0.75, 0.5, 1.0].map(|c| {
        over_quad(origin, u, v, |q| {
            let wi = q.normalize();
            let mirrored = DVec3::new(wi.x, -wi.y, wi.z);
            let cos = wo.dot((wo + mirrored).normalize());
            let t = c * (1.0 - fresnel(f64::from(ior), cos));
            4.0 * t * ggx.dv(wo, mirrored) * wi.y * wi.y / q.length_squared()
        })
    });
    Case::new("lamp behind a thin rough plate", scene, truth, 16_384)
}

/// One rough interface, the lamp in the glass below: Walter et al. 2007, eq. 21, for radiance.
fn through_interface() -> Case {
    let (ior, roughness) = (1.5_f32, 0.5_f32);
    let mut scene = Scene::new();
    show(&mut scene, plane(0.0), Material { roughness, ..Material::glass(ior) });
    look_at_point(&mut scene, EYE, DVec3::ZERO);
    let (mesh, [origin, u, v]) = floor_lamp();
    show(&mut scene, mesh, lamp(4.0));
    let wo = EYE.normalize();
    let eta = f64::from(ior);
    let ggx = Ggx(f64::from(roughness).powi(2));
    let truth = over_quad(origin, u, v, |q| {
        let wi = q.normalize();
        let h = -(wo + eta * wi).normalize();
        let (cos_o, cos_i) = (wo.dot(h), wi.dot(h));
        if h.y <= 0.0 || cos_o <= 0.0 || cos_i >= 0.0 {
            return 0.0;
        }
        let t = 1.0 - fresnel(eta, cos_o);
        let f = (cos_o * cos_i).abs() * t * ggx.d(h) * ggx.g(wo, wi)
            / ((wo.y * wi.y).abs() * (cos_o + eta * cos_i).powi(2));
        4.0 * f * wi.y * wi.y / q.length_squared()
    });
    Case::gray("lamp below a rough interface", scene, truth, 16_384)
}

/// A square below the plane that faces up.
fn floor_lamp() -> (wavecast::world::TriMesh, [DVec3; 3]) {
    let origin = Vec3::new(0.25, -1.5, 1.0);
    let mesh = wavecast::world::TriMesh::quad(origin, Vec3::X * 1.5, Vec3::NEG_Z * 2.0);
    (mesh, [oracle::exact(origin), DVec3::X * 1.5, DVec3::NEG_Z * 2.0])
}

pub fn cases() -> Vec<Case> {
    let mixed = Coat { metallic: 0.5, roughness: 0.6, specular: 0.5, ..PAINT };
    vec![
        mirror(),
        under_lamp("rough metal under a lamp", METAL, 16_384),
        under_lamp("paint under a lamp", PAINT, 32_768),
        under_lamp("half metal under a lamp", mixed, 32_768),
        under_sky("rough metal under a uniform sky", Coat { roughness: 0.6, ..METAL }, 8192),
        under_sky("paint under a uniform sky", PAINT, 16_384),
        smooth_paint_under_sky(),
        through_thin_plate(),
        through_interface(),
    ]
}
