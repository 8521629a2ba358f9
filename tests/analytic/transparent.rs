//! Light through clear plates and slabs.

use glam::{DVec3, Vec3};
use wavecast::world::{Environment, Material, Scene, TriMesh};

use super::{Case, flat_sphere, look_at_square, oracle::fresnel, plane};
use crate::common::show;

fn under_sky(mesh: TriMesh, material: Material) -> Scene {
    let mut scene = Scene::new();
    show(&mut scene, mesh, material);
    scene.spawn((Environment::constant(Vec3::splat(2.0)),));
    scene
}

/// R + (1 − max R) c per channel, R of one interface with the tint of the specular colour.
fn thin_plate(specular_color: Vec3) -> Case {
    let base_color = Vec3::new(0.75, 0.5, 0.25);
    let mut scene =
        under_sky(plane(0.0), Material { base_color, specular_color, thickness: 0.0, ..Material::glass(1.5) });
    let wo = DVec3::new(0.75, 0.5, 0.25).normalize();
    look_at_square(&mut scene, 4.0 * wo, DVec3::ZERO, DVec3::Y, 0.5);
    let r = specular_color.as_dvec3() * fresnel(1.5, wo.y);
    let truth = 2.0 * (r + (1.0 - r.max_element()) * base_color.as_dvec3());
    Case::new(&format!("thin plate, specular tint {}", specular_color.x), scene, truth.to_array(), 32_768)
}

/// A slab of thickness d between parallel faces, seen straight on: with τ = e^(−ad) and R of a face,
/// R + (1 − R)² τ / (1 − Rτ).
fn slab(ior: f32) -> Case {
    let color = Vec3::new(0.5, 0.25, 0.75);
    let glass = Material { attenuation_distance: 0.5, attenuation_color: color, ..Material::glass(ior) };
    let mut scene = under_sky(TriMesh::cuboid(Vec3::new(-1.0, 0.0, -1.0), Vec3::new(1.0, 0.75, 1.0)), glass);
    look_at_square(&mut scene, 4.0 * DVec3::Y, DVec3::ZERO, DVec3::NEG_Z, 0.5);
    let r = fresnel(f64::from(ior), 1.0);
    let truth = color.as_dvec3().to_array().map(|c| {
        let tau = c.powf(0.75 / 0.5);
        2.0 * (r + (1.0 - r).powi(2) * tau / (1.0 - r * tau))
    });
    Case::new(&format!("absorbing slab, index {ior}"), scene, truth, 32_768)
}

/// Nothing is lost in clear glass: but for rays by the rim, see `check_vanishes`, in no pixel.
fn sphere() -> Case {
    let mut scene = under_sky(flat_sphere(1.0, 48), Material::glass(1.5));
    look_at_square(&mut scene, DVec3::new(0.5, 1.0, 3.0), DVec3::ZERO, DVec3::Y, 0.5);
    Case::gray("glass sphere in a uniform sky", scene, 2.0, 256)
}

pub fn cases() -> Vec<Case> {
    vec![thin_plate(Vec3::ONE), thin_plate(Vec3::new(0.5, 1.0, 0.75)), slab(1.0), slab(1.5), sphere()]
}
