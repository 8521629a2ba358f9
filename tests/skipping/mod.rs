//! What a scene does not need is not run: by counters, with a positive control for each need.

use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3, Vec4};
use wavecast::{
    flat::SceneNeeds,
    render::{RenderSettings, RenderStats, Renderer, Sharing},
    world::{
        AlphaMode, DirectionalLight, Environment, EnvironmentMap, Geometry, Image, LocalTransform, Material,
        PointLight, Scene, Sky, Texels, Texture, TriMesh,
        units::{Candela, Lux},
    },
};

use crate::common::{look, settings, show};

fn plain() -> Scene {
    let mut scene = Scene::new();
    let floor = TriMesh::quad(Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0);
    show(&mut scene, floor, Material::lambert(Vec3::splat(0.6)));
    look(&mut scene, DVec3::new(0.0, 2.0, 4.0), DVec3::ZERO, 40.0);
    scene
}

fn run(scene: &mut Scene) -> (SceneNeeds, RenderStats) {
    let mut renderer = Renderer::new();
    renderer.sync(scene);
    (renderer.scene().needs, renderer.render(&settings(24, 4), &()).stats)
}

fn count(stats: &RenderStats, name: &str) -> u64 {
    stats.counters.iter().find(|(n, _)| *n == name).map_or(0, |(_, count)| *count)
}

fn rows(stats: &RenderStats, name: &str) -> u64 {
    stats.stages.iter().find(|stage| stage.name == name).map_or(0, |stage| stage.rows)
}

fn texture() -> Texture {
    let texels = Texels::Rgba8(vec![[200, 200, 250, 255], [128, 128, 255, 60], [90, 100, 250, 255], [255; 4]]);
    Texture::new(Arc::new(Image { name: "test".to_owned(), width: 2, height: 2, texels }))
}

/// A need, a scene that has it, and the sign that its code ran.
#[track_caller]
fn check_need(need: SceneNeeds, build: impl FnOnce(&mut Scene), sign: impl Fn(&RenderStats) -> u64) {
    let (needs, stats) = run(&mut plain());
    assert!(!needs.has(need), "the plain scene needs {:?}", needs.names(false));
    assert_eq!(sign(&stats), 0, "the plain scene ran it");
    let mut scene = plain();
    build(&mut scene);
    let (needs, stats) = run(&mut scene);
    assert!(needs.has(need), "{:?}", needs.names(false));
    assert!(sign(&stats) > 0, "needed, but not run: {stats:?}");
}

fn quad_with(scene: &mut Scene, material: Material) {
    let mesh = TriMesh::quad(Vec3::new(-0.5, 0.2, 0.5), Vec3::X, Vec3::Y);
    show(scene, mesh, material);
}

fn lambert() -> Material {
    Material::lambert(Vec3::splat(0.5))
}

#[test]
fn textures_are_looked_up_where_a_material_has_one() {
    let build = |s: &mut Scene| quad_with(s, Material { base_color_texture: Some(texture()), ..lambert() });
    check_need(SceneNeeds::TEXTURES, build, |stats| count(stats, "texture_lookups"));
}

#[test]
fn normal_maps_are_looked_up_where_a_mesh_has_tangents() {
    let build = |s: &mut Scene| {
        let mut mesh = TriMesh::quad(Vec3::new(-0.5, 0.2, 0.5), Vec3::X, Vec3::Y);
        mesh.normals = vec![Vec3::Z; 4];
        mesh.tangents = vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4];
        show(s, mesh, Material { normal_texture: Some(texture()), ..lambert() });
    };
    check_need(SceneNeeds::NORMAL_MAPS, build, |stats| count(stats, "texture_lookups"));
    check_need(SceneNeeds::SMOOTH_NORMALS, build, |stats| count(stats, "texture_lookups"));
}

#[test]
fn alpha_is_tested_where_something_covers_in_part() {
    for alpha_mode in [AlphaMode::Blend, AlphaMode::Mask { cutoff: 0.5 }] {
        let build = |s: &mut Scene| quad_with(s, Material { alpha_mode, base_alpha: 0.4, ..lambert() });
        check_need(SceneNeeds::ALPHA, build, |stats| count(stats, "alpha_tests"));
    }
}

/// A picture of which the left half covers and the right half does not, on a quad whose triangles show one half each,
/// both the left, or both the right: the left is never asked for its alpha, and the picture is that of a solid quad.
#[test]
fn alpha_is_not_asked_for_where_it_covers_wholly() {
    let texels = (0..32 * 32).map(|at| [200, 180, 160, if at % 32 < 16 { 255 } else { 20 }]).collect();
    let image = Image { name: "half".to_owned(), width: 32, height: 32, texels: Texels::Rgba8(texels) };
    let half = Texture::new(Arc::new(image));
    // Away from where the halves meet, and from the border, where the right half comes in again.
    let (left, right) = ([0.15, 0.35], [0.65, 0.85]);
    let seen = |alpha_mode, halves: [[f32; 2]; 2]| {
        let mut scene = plain();
        let mut mesh = TriMesh::quad(Vec3::new(-0.5, 0.2, 0.5), Vec3::X, Vec3::Y);
        mesh.positions = [0, 1, 2, 0, 2, 3].map(|corner| mesh.positions[corner]).to_vec();
        mesh.triangles = vec![[0, 1, 2], [3, 4, 5]];
        let uv = |[from, to]: [f32; 2]| [Vec2::new(from, 0.2), Vec2::new(to, 0.2), Vec2::new(to, 0.8)];
        mesh.uvs = vec![halves.map(uv).concat()];
        show(&mut scene, mesh, Material { alpha_mode, base_color_texture: Some(half.clone()), ..lambert() });
        let mut renderer = Renderer::new();
        renderer.sync(&mut scene);
        let needs_alpha = renderer.scene().needs.has(SceneNeeds::ALPHA);
        assert_eq!(needs_alpha, alpha_mode != AlphaMode::Opaque);
        // Where coverage is left to chance nothing is shared, and here nothing shall be.
        let settings = RenderSettings { sharing: Sharing::Off, ..settings(24, 4) };
        let rendered = renderer.render(&settings, &());
        (count(&rendered.stats, "alpha_tests"), rendered.picture.rgb)
    };
    let (_, solid) = seen(AlphaMode::Opaque, [left, left]);
    for alpha_mode in [AlphaMode::Blend, AlphaMode::Mask { cutoff: 0.5 }] {
        let ((none, picture), (some, _), (all, _)) =
            (seen(alpha_mode, [left, left]), seen(alpha_mode, [left, right]), seen(alpha_mode, [right, right]));
        assert!(none == 0 && picture == solid, "{alpha_mode:?}: {none}");
        assert!(0 < some && some < all, "{alpha_mode:?}: {some} of {all}");
    }
}

/// A single-sided quad seen from behind is not there: by camera rays alone the picture is that of the plain scene.
#[test]
fn backs_are_culled_where_a_material_has_none() {
    let with_quad = |double_sided| {
        let mut scene = plain();
        let mesh = TriMesh::quad(Vec3::new(0.5, 0.2, 0.5), Vec3::NEG_X, Vec3::Y);
        show(&mut scene, mesh, Material { double_sided, ..lambert() });
        scene
    };
    assert!(run(&mut with_quad(false)).0.has(SceneNeeds::CULLING));
    assert!(!run(&mut with_quad(true)).0.has(SceneNeeds::CULLING));
    let seen = |mut scene: Scene| {
        let mut renderer = Renderer::new();
        renderer.sync(&mut scene);
        let settings = RenderSettings { max_depth: Some(0), ..settings(24, 4) };
        renderer.render(&settings, &()).picture.rgb
    };
    assert_eq!(seen(with_quad(false)), seen(plain()));
    assert_ne!(seen(with_quad(true)), seen(plain()));
}

#[test]
fn solids_absorb_where_a_material_says_so() {
    let build = |s: &mut Scene| {
        let mut glass = Material::glass(1.5);
        glass.attenuation_distance = 0.2;
        glass.attenuation_color = Vec3::splat(0.5);
        show(s, TriMesh::sphere(Vec3::new(0.0, 0.5, 0.0), 0.4, 8), glass);
    };
    check_need(SceneNeeds::VOLUMES, build, |stats| count(stats, "absorbed_paths"));
    check_need(SceneNeeds::TRANSMISSION, build, |stats| count(stats, "absorbed_paths"));
}

#[test]
fn shadow_rays_are_traced_where_there_is_a_light() {
    let lamp = |s: &mut Scene| quad_with(s, Material { emissive: Vec3::ONE, ..lambert() });
    check_need(SceneNeeds::AREA_LIGHTS, lamp, |stats| rows(stats, "emit").min(stats.rays.shadow));
    let point = |s: &mut Scene| {
        let light = PointLight { color: Vec3::ONE, intensity: Candela(5.0) };
        s.spawn((light, LocalTransform::from_translation(DVec3::Y)));
    };
    check_need(SceneNeeds::LOCAL_LIGHTS, point, |stats| stats.rays.shadow);
    let sun = |s: &mut Scene| {
        let light = DirectionalLight { color: Vec3::ONE, illuminance: Lux(5.0) };
        s.spawn((light, LocalTransform::looking_at(DVec3::Y, DVec3::ZERO, DVec3::X)));
    };
    check_need(SceneNeeds::DISTANT_LIGHTS, sun, |stats| stats.rays.shadow);
}

#[test]
fn the_environment_is_read_where_there_is_one() {
    let sky = |s: &mut Scene| {
        let map = EnvironmentMap { name: "test".to_owned(), width: 2, height: 1, texels: vec![[1.0; 3], [2.0; 3]] };
        s.spawn((Environment { sky: Sky::Map(Arc::new(map)), rotation_degrees: 0.0, scale: 1.0 },));
    };
    check_need(SceneNeeds::ENVIRONMENT_MAP, sky, |stats| count(stats, "environment_lookups"));
    // The plain scene has no light and so gets a constant sky; a scene with a lamp has none.
    let mut lit = plain();
    let light = PointLight { color: Vec3::ONE, intensity: Candela(5.0) };
    lit.spawn((light, LocalTransform::from_translation(DVec3::Y)));
    let (needs, stats) = run(&mut lit);
    assert!(!needs.has(SceneNeeds::CONSTANT_SKY) && rows(&stats, "sky") == 0);
    let (needs, stats) = run(&mut plain());
    assert!(needs.has(SceneNeeds::CONSTANT_SKY) && rows(&stats, "sky") > 0);
    assert_eq!(stats.rays.shadow, 0, "a constant sky is found by scattering alone");
}

#[test]
fn unlit_surfaces_and_vertex_colors_are_shown_where_there_are_some() {
    let build = |s: &mut Scene| quad_with(s, Material { unlit: true, ..lambert() });
    check_need(SceneNeeds::UNLIT, build, |stats| rows(stats, "unlit"));
    let mut scene = plain();
    let mut mesh = TriMesh::quad(Vec3::new(-0.5, 0.2, 0.5), Vec3::X, Vec3::Y);
    mesh.uvs = vec![vec![Vec2::ZERO; 4]];
    mesh.colors = vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4];
    show(&mut scene, mesh, lambert());
    let (needs, stats) = run(&mut scene);
    assert!(needs.has(SceneNeeds::VERTEX_COLORS));
    assert_eq!(count(&stats, "texture_lookups"), 0, "vertex colours are no textures");
}

#[test]
fn shapes_are_needed_where_one_is_visible() {
    let mut scene = plain();
    let ball = scene.spawn((wavecast::world::Shape::Sphere { radius: 0.5 },));
    assert!(run(&mut scene).0.has(SceneNeeds::SHAPES));
    scene.insert(ball, wavecast::world::Visibility(false));
    let (needs, _) = run(&mut scene);
    assert!(!needs.has(SceneNeeds::SHAPES) && needs == run(&mut plain()).0);
}

#[test]
fn instancing_is_needed_for_more_than_one_thing_or_a_moved_one() {
    let (needs, _) = run(&mut plain());
    assert!(!needs.has(SceneNeeds::INSTANCING));
    let mut scene = plain();
    let floor = scene.keys_with::<Geometry>()[0];
    scene.insert(floor, LocalTransform::from_translation(DVec3::X));
    assert!(run(&mut scene).0.has(SceneNeeds::INSTANCING));
}

/// Materials, images and meshes that nothing visible uses are in no table.
#[test]
fn what_nothing_shows_is_not_built() {
    let mut scene = plain();
    scene.spawn((Material { base_color_texture: Some(texture()), emissive: Vec3::ONE, unlit: true, ..lambert() },));
    let mut renderer = Renderer::new();
    renderer.sync(&mut scene);
    let flat = renderer.scene();
    assert_eq!((flat.materials.len(), flat.textures.images.len(), flat.meshes.len()), (1, 0, 1));
    assert_eq!(flat.needs, run(&mut plain()).0);
}

/// A mirror without a lamp, or a lamp without a mirror, costs nothing.
#[test]
fn light_is_traced_from_emitters_where_there_is_a_mirror_too() {
    let mirror = Material { roughness: 0.0, ..Material::default() };
    let lamp = Material { emissive: Vec3::ONE, ..lambert() };
    for alone in [&mirror, &lamp] {
        let mut scene = plain();
        quad_with(&mut scene, alone.clone());
        let (needs, stats) = run(&mut scene);
        assert!(!needs.has(SceneNeeds::CAUSTICS), "{:?}", needs.names(false));
        assert_eq!(rows(&stats, "caustics"), 0);
    }
    let build = |s: &mut Scene| {
        quad_with(s, mirror);
        quad_with(s, lamp);
    };
    check_need(SceneNeeds::CAUSTICS, build, |stats| rows(stats, "caustics"));
}
