//! Pictures whose every pixel is known from a formula.

use glam::{DVec3, Vec3};
use wavecast::world::{Environment, Material, Scene, TriMesh};

use crate::common::{look, picture, settings, show};

/// A white diffuse object in a white sky reflects what it hides: L = 1 everywhere.
#[test]
fn white_diffuse_objects_vanish_in_a_white_sky() {
    let mut scene = Scene::new();
    show(&mut scene, TriMesh::cuboid(Vec3::splat(-1.0), Vec3::ONE), Material::lambert(Vec3::ONE));
    scene.spawn((Environment::constant(Vec3::ONE),));
    look(&mut scene, DVec3::new(3.0, 2.0, 4.0), DVec3::ZERO, 40.0);
    let rendered = picture(&mut scene, &settings(32, 16));
    for rgb in &rendered.picture.rgb {
        assert!(rgb.iter().all(|c| (c - 1.0).abs() < 1e-4), "{rgb:?}");
    }
}
