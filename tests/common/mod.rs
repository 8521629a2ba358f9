//! What several kinds of evidence build their scenes from.

pub mod trials;

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use glam::{DAffine3, DVec3, Vec3};
use wavecast::{
    load::{self, LoadOptions},
    render::{PixelFilter, RenderSettings, Rendered, Renderer},
    world::{Camera, Geometry, LocalTransform, Material, MaterialSlots, Scene, SceneKey, Shape, TriMesh},
};

/// Adds a mesh of one material; returns the keys of the entity and of the material.
pub fn show(scene: &mut Scene, mesh: TriMesh, material: Material) -> (SceneKey, SceneKey) {
    let material = scene.spawn((material,));
    let entity = scene.spawn((Geometry(Arc::new(mesh)), MaterialSlots::from(material)));
    (entity, material)
}

/// Adds a shape of one material; returns the keys of the entity and of the material.
pub fn show_shape(scene: &mut Scene, shape: Shape, material: Material, place: DAffine3) -> (SceneKey, SceneKey) {
    let material = scene.spawn((material,));
    let entity = scene.spawn((shape, MaterialSlots::from(material), LocalTransform::Matrix(place)));
    (entity, material)
}

/// Adds a perspective camera.
pub fn look(scene: &mut Scene, eye: DVec3, target: DVec3, degrees: f32) -> SceneKey {
    let up = if (target - eye).cross(DVec3::Y).length() > 1e-6 { DVec3::Y } else { DVec3::NEG_Z };
    scene.spawn((Camera::perspective(degrees.to_radians()), LocalTransform::looking_at(eye, target, up)))
}

/// A square picture with a box filter, so that pixels share no light.
pub fn settings(size: u32, spp: u32) -> RenderSettings {
    RenderSettings { width: size, height: size, spp: Some(spp), filter: PixelFilter::Box, ..RenderSettings::default() }
}

/// Syncs and renders; a warning or a discarded sample is a failure.
#[track_caller]
pub fn picture(scene: &mut Scene, settings: &RenderSettings) -> Rendered {
    let mut renderer = Renderer::new();
    let report = renderer.sync(scene);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let rendered = renderer.render(settings, &());
    assert_eq!(rendered.stats.discarded, []);
    rendered
}

/// The mean of all pixels, in f64.
pub fn mean(rendered: &Rendered) -> [f64; 3] {
    let pixels = &rendered.picture.rgb;
    std::array::from_fn(|i| pixels.iter().map(|rgb| f64::from(rgb[i])).sum::<f64>() / pixels.len() as f64)
}

/// The folder of the repository.
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// A scene file, loaded; it must be sound.
#[track_caller]
pub fn load_scene(path: &Path) -> Scene {
    load::load(path, &LoadOptions::default()).unwrap_or_else(|error| panic!("{}: {error}", path.display())).scene
}

/// A file of the shared assets, or `None`, said aloud, where they are not there.
pub fn asset(path: &str) -> Option<PathBuf> {
    let full = root().join("../shared/assets").join(path);
    if full.exists() {
        return Some(full);
    }
    println!("SKIPPED: {path} is not there ({})", full.display());
    None
}

/// A white room with a box, a lamp and some of everything that a path can meet.
pub fn varied() -> Scene {
    let mut scene = Scene::new();
    let plane = TriMesh::quad(Vec3::new(-3.0, 0.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0);
    show(&mut scene, plane, Material::lambert(Vec3::new(0.7, 0.6, 0.5)));
    let lamp = TriMesh::quad(Vec3::new(-0.5, 3.0, -0.5), Vec3::X, Vec3::Z);
    show(&mut scene, lamp, Material { emissive: Vec3::splat(9.0), double_sided: true, ..Material::default() });
    let gold = Material { base_color: Vec3::new(1.0, 0.8, 0.3), roughness: 0.3, ..Material::default() };
    show(&mut scene, TriMesh::sphere(Vec3::new(-1.2, 0.7, 0.0), 0.7, 16), gold);
    let mut glass = Material::glass(1.5);
    glass.attenuation_distance = 0.5;
    glass.attenuation_color = Vec3::new(0.5, 0.9, 0.6);
    show(&mut scene, TriMesh::sphere(Vec3::new(1.0, 0.7, 0.6), 0.7, 16), glass);
    let paint = Material { base_color: Vec3::new(0.8, 0.1, 0.1), metallic: 0.0, roughness: 0.4, ..Material::default() };
    show(&mut scene, TriMesh::cuboid(Vec3::new(-0.4, 0.0, -1.6), Vec3::new(0.6, 1.4, -0.8)), paint);
    scene.spawn((
        wavecast::world::PointLight { color: Vec3::ONE, intensity: wavecast::world::units::Candela(3.0) },
        LocalTransform::from_translation(DVec3::new(2.0, 2.0, 2.0)),
    ));
    scene.spawn((wavecast::world::Environment::constant(Vec3::new(0.1, 0.15, 0.2)),));
    look(&mut scene, DVec3::new(0.5, 1.8, 5.0), DVec3::new(0.0, 0.8, 0.0), 40.0);
    scene
}
