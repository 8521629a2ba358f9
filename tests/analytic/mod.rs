//! Pictures whose every pixel is known from a formula.

use glam::{DVec3, Vec3};
use wavecast::{
    render::{PixelFilter, RenderSettings, Rendered, Renderer},
    world::{
        Camera, Environment, Geometry, LocalTransform, Material, MaterialSlots, Scene, TriMesh,
    },
};
use std::sync::Arc;

fn show(scene: &mut Scene, mesh: TriMesh, material: Material) {
    let material = scene.spawn((material,));
    scene.spawn((Geometry(Arc::new(mesh)), MaterialSlots::from(material)));
}

fn settings(size: u32, spp: u32) -> RenderSettings {
    RenderSettings { width: size, height: size, spp: Some(spp), filter: PixelFilter::Box, ..RenderSettings::default() }
}

fn picture(scene: &mut Scene, settings: &RenderSettings) -> Rendered {
    let mut renderer = Renderer::new();
    let report = renderer.sync(scene);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let rendered = renderer.render(settings, &());
    assert!(rendered.stats.discarded.is_empty());
    rendered
}

fn look(scene: &mut Scene, eye: DVec3, target: DVec3, degrees: f32) {
    scene.spawn((Camera::perspective(degrees.to_radians()), LocalTransform::looking_at(eye, target, DVec3::Y)));
}

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
