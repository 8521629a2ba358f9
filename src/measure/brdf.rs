//! A material's BRDF, f = dLᵣ/dEᵢ, as a gonioreflectometer reads it (Nicodemus et al. 1977, "Geometrical Considerations and Nomenclature
//! for Reflectance", section III): a patch of it in parallel light from one direction, its luminance seen from another, over
//! the illuminance that a meter reads on it.

use glam::{DVec3, Vec3};

use super::{
    meter::{Effort, Meters, Reading, read},
    student::Estimate,
};
use crate::{
    film::luminance,
    reference,
    render::{Observer, Renderer},
    world::{
        AlphaMode, Camera, DirectionalLight, Environment, Geometry, LocalTransform, Material, MaterialSlots,
        Projection, Scene, SceneKey, TriMesh, units::Lux,
    },
};

/// What is measured in one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflectance {
    /// Angle of view to the normal, degrees; positive on the side of the mirror direction, in the plane of incidence.
    pub view_degrees: f64,
    /// 1/sr, by channel and as luminance.
    pub measured: Reading,
    /// By the formula of `docs/model.md`, in f64, 1/sr.
    pub formula: [f64; 3],
}

/// A patch, its light and its eye.
struct Bench {
    scene: Scene,
    renderer: Renderer,
    camera: SceneKey,
}

/// Half the edge of the patch, m.
const PATCH: f32 = 1.0;
/// Half of what the eye sees of it, m.
const SEEN: f32 = 0.01;
/// From the patch, m.
const AWAY: f64 = 10.0;
/// Of the light, on a plane that faces it.
const LIGHT: Lux = Lux(1000.0);

/// A direction in the plane of incidence.
fn at(degrees: f64) -> DVec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    DVec3::new(sin, cos, 0.0)
}

impl Bench {
    /// With the material's factors, without its textures; it covers wholly and does not shine.
    fn new(material: &Material) -> Self {
        let mut scene = Scene::new();
        let plain = Material {
            base_color_texture: None,
            metallic_roughness_texture: None,
            normal_texture: None,
            emissive_texture: None,
            specular_texture: None,
            specular_color_texture: None,
            transmission_texture: None,
            emissive: Vec3::ZERO,
            base_alpha: 1.0,
            alpha_mode: AlphaMode::Opaque,
            ..material.clone()
        };
        let material = scene.spawn((plain,));
        let quad = TriMesh::quad(Vec3::new(-PATCH, 0.0, PATCH), Vec3::X * 2.0 * PATCH, Vec3::NEG_Z * 2.0 * PATCH);
        scene.spawn((Geometry(quad.into()), MaterialSlots::from(material)));
        let projection = Projection::Orthographic { xmag: SEEN, ymag: SEEN };
        let camera = scene.spawn((Camera { projection, znear: 0.0, zfar: f32::INFINITY }, LocalTransform::IDENTITY));
        scene.active_camera = Some(camera);
        Self { scene, renderer: Renderer::new(), camera }
    }

    fn look_from(&mut self, degrees: f64) {
        let eye = LocalTransform::looking_at(at(degrees) * AWAY, DVec3::ZERO, DVec3::Z);
        self.scene.insert(self.camera, eye);
        self.renderer.sync(&mut self.scene);
    }

    fn luminance(&self, effort: &Effort, observer: &dyn Observer) -> Reading {
        let effort = Effort { max_depth: Some(1), ..*effort };
        read(self.renderer.scene(), &Meters::Pixels([1, 1], vec![[0, 0]]), &effort, observer).mean
    }
}

/// The factors of a material, as the reference takes them; seen from its front.
fn of_formula(material: &Material) -> reference::Surface {
    reference::Surface {
        base_color: material.base_color.as_dvec3(),
        metallic: material.metallic.into(),
        roughness: material.roughness.into(),
        specular: material.specular.into(),
        specular_color: material.specular_color.as_dvec3(),
        ior: material.ior.into(),
        transmission: material.transmission.into(),
        solid: material.is_solid(),
        inside: false,
    }
}

/// Measures a material in light that comes in at an angle to the normal, degrees, from some angles of view, degrees, in the plane of
/// incidence. Its mirror and clear glass, which are not functions, are not seen.
pub fn brdf(
    material: &Material,
    incident_degrees: f64,
    views: &[f64],
    effort: &Effort,
    observer: &dyn Observer,
) -> Vec<Reflectance> {
    let mut bench = Bench::new(material);
    let from = at(-incident_degrees);
    let light = DirectionalLight { color: Vec3::ONE, illuminance: LIGHT };
    bench.scene.spawn((light, LocalTransform::looking_at(from, DVec3::ZERO, DVec3::Z)));
    bench.renderer.sync(&mut bench.scene);
    let plane = Meters::Planes(vec![(DVec3::ZERO, DVec3::Y)]);
    let falls = read(bench.renderer.scene(), &plane, &Effort { max_depth: Some(0), ..*effort }, observer).mean;
    let one = |&view_degrees: &f64| {
        bench.look_from(view_degrees);
        let seen = bench.luminance(effort, observer);
        let over = |l: Estimate, e: Estimate| {
            let (scale, share) = (1.0 / e.value, l.value / e.value);
            // Both are independent; the second hardly varies.
            Estimate::sum([(scale, l), (share * scale, Estimate { value: 0.0, ..e })])
        };
        let rgb = std::array::from_fn(|c| over(seen.rgb[c], falls.rgb[c]));
        Reflectance {
            view_degrees,
            measured: Reading { rgb, value: over(seen.value, falls.value) },
            formula: reference::brdf(&of_formula(material), at(view_degrees), from).to_array(),
        }
    };
    views.iter().map(one).collect()
}

/// The formula alone, as luminance, 1/sr: angles as for [`brdf`].
pub fn formula(material: &Material, incident_degrees: f64, view_degrees: f64) -> f64 {
    luminance(reference::brdf(&of_formula(material), at(view_degrees), at(-incident_degrees)).to_array())
}

/// Share of even light from all sides that a material sends into a direction at an angle to the normal, degrees: at most 1 if energy
/// is kept. What comes through it counts as well; out of a solid it is less by the square of its index, as rays spread there.
pub fn albedo(material: &Material, view_degrees: f64, effort: &Effort, observer: &dyn Observer) -> Reading {
    let mut bench = Bench::new(material);
    bench.scene.spawn((Environment::constant(Vec3::ONE),));
    bench.look_from(view_degrees);
    bench.luminance(effort, observer)
}

impl Reflectance {
    /// Luminance of the formula, 1/sr.
    pub fn expected(&self) -> f64 {
        luminance(self.formula)
    }
}
