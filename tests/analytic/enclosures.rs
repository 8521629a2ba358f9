//! Closed rooms, where light that is not absorbed has nowhere to go.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use wavecast::world::{LocalTransform, Material, PointLight, Scene, TriMesh, units::Candela};

use super::{Case, flat_sphere, look_at_point, oracle};
use crate::common::{look, show};

/// A closed box of albedo ρ that emits L = 2 nit everywhere: L (1 − ρⁿ) / (1 − ρ) after n surfaces, L / (1 − ρ) after
/// all. Exact for a shell of any shape.
pub fn shell(rho: f32, max_depth: Option<u32>, spp: u32) -> Case {
    let mut scene = Scene::new();
    let material = Material { emissive: Vec3::splat(2.0), ..Material::lambert(Vec3::splat(rho)) };
    show(&mut scene, TriMesh::cuboid(Vec3::new(-1.0, -0.75, -1.25), Vec3::ONE), material);
    look(&mut scene, DVec3::new(0.5, 0.25, 0.25), DVec3::new(-0.5, -0.5, 0.0), 90.0);
    let ratio = f64::from(rho);
    let lost = max_depth.map_or(0.0, |depth| ratio.powi(depth as i32 + 1));
    let truth = 2.0 * (1.0 - lost) / (1.0 - ratio);
    let depth = max_depth.map_or("all".to_owned(), |depth| (depth + 1).to_string());
    let mut case = Case::gray(&format!("emitting shell, albedo {rho}, {depth} surfaces"), scene, truth, spp);
    case.settings.max_depth = max_depth;
    case.sobol = spp;
    case
}

fn lit_sphere(rho: f32, rings: u32) -> (Scene, TriMesh) {
    let mut scene = Scene::new();
    let mesh = flat_sphere(2.0, rings);
    show(&mut scene, mesh.clone(), Material::lambert(Vec3::splat(rho)));
    let light = PointLight { color: Vec3::ONE, intensity: Candela(10.0) };
    scene.spawn((light, LocalTransform::IDENTITY));
    (scene, mesh)
}

/// A point of one facet, lit by the light alone: L = ρ/π · I cosθ / d², exact for the facet.
fn facet_of_lit_sphere() -> Case {
    let (mut scene, mesh) = lit_sphere(0.5, 12);
    let (eye, towards) = (DVec3::new(0.5, 0.1, 0.2), DVec3::new(0.3, -0.62, 0.71).normalize());
    look_at_point(&mut scene, eye, eye + towards);
    let (q, n) = oracle::meet(&mesh, eye, towards);
    let truth = 0.5 / PI * 10.0 * n.dot(-q.normalize()) / q.length_squared();
    Case::gray("facet of a sphere, light at its centre", scene, truth, 16).max_depth(1)
}

/// With all interreflections, the mean over the surface is ρ/(1 − ρ) · 4πI / (πA), exact for a polyhedron: what is lit
/// is the flux, and each surface returns the share ρ of it. Seen from the centre the facets weigh by solid angle in
/// place of area, which at 96 rings (facets of 1.9°) changes the mean by less than 10⁻⁵.
fn lit_sphere_with_interreflection() -> Case {
    let rho = 0.5;
    let (mut scene, mesh) = lit_sphere(rho, 96);
    look(&mut scene, DVec3::ZERO, DVec3::new(1.0, 0.3, 0.4), 100.0);
    let truth = f64::from(rho / (1.0 - rho)) * 4.0 * 10.0 / oracle::area(&mesh);
    Case::gray("closed sphere, light at its centre, albedo 0.5", scene, truth, 4096)
}

pub fn cases() -> Vec<Case> {
    vec![
        shell(0.0, Some(8), 16),
        shell(0.5, Some(1), 8192),
        shell(0.5, Some(7), 8192),
        shell(0.9, Some(63), 16_384),
        shell(0.75, None, 8192),
        facet_of_lit_sphere(),
        lit_sphere_with_interreflection(),
    ]
}
