//! Small scenes that together have everything both renderers know.

use std::{f64::consts::TAU, sync::Arc};

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec2, Vec3, Vec4};
use wavecast::{
    render::{RenderSettings, Sharing},
    world::{
        AlphaMode, Camera, DirectionalLight, Environment, EnvironmentMap, Filter, Geometry, Image, LocalTransform,
        Material, MaterialSlots, PointLight, Projection, Scene, Sky, SpotLight, Texels, Texture, TriMesh, UvTransform,
        Wrap,
        units::{Candela, Lux},
    },
};

use crate::common::{look, show};

/// A bumpy, deterministic number in [0, 1).
fn noise(x: u32, y: u32, seed: u32) -> f64 {
    let mut h = (x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77) ^ seed.wrapping_mul(0xc2b2_ae3d)) | 1;
    for _ in 0..3 {
        h = (h ^ h >> 15).wrapping_mul(0x2c1b_3c6d);
    }
    f64::from(h >> 8) / f64::from(1 << 24)
}

/// An image of 4×4 texels with channels from `low` to `high`.
fn image(seed: u32, low: [u8; 4], high: [u8; 4]) -> Texture {
    let texel = |i: u32| {
        std::array::from_fn(|c| {
            let share = noise(i % 4, i / 4, seed + 17 * c as u32);
            (f64::from(low[c]) + share * (f64::from(high[c]) - f64::from(low[c]))).round() as u8
        })
    };
    let texels = Texels::Rgba8((0..16).map(texel).collect());
    Texture::new(Arc::new(Image { name: format!("noise {seed}"), width: 4, height: 4, texels }))
}

fn normal_map(seed: u32) -> Texture {
    image(seed, [70, 70, 200, 255], [185, 185, 255, 255])
}

/// A sky of 16×8 texels with a bright patch.
fn sky_map() -> Sky {
    let texel = |i: u32| {
        let base = noise(i % 16, i / 16, 5) as f32;
        let sun = if i == 16 * 2 + 5 { 40.0 } else { 0.0 };
        [0.2 + base + sun, 0.3 + 0.5 * base + sun, 0.8 - 0.4 * base + 0.8 * sun]
    };
    Sky::Map(Arc::new(EnvironmentMap {
        name: "sky".to_owned(),
        width: 16,
        height: 8,
        texels: (0..128).map(texel).collect(),
    }))
}

fn floor(scene: &mut Scene, material: Material) {
    show(scene, TriMesh::quad(Vec3::new(-4.0, 0.0, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 8.0), material);
}

fn ceiling_lamp(scene: &mut Scene, radiance: f32) {
    let mesh = TriMesh::quad(Vec3::new(-1.0, 3.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0);
    show(scene, mesh, Material { emissive: Vec3::splat(radiance), ..Material::lambert(Vec3::splat(0.5)) });
}

fn point(scene: &mut Scene, at: DVec3, candela: f32) {
    let light = PointLight { color: Vec3::new(1.0, 0.9, 0.8), intensity: Candela(candela) };
    scene.spawn((light, LocalTransform::from_translation(at)));
}

fn camera(scene: &mut Scene) {
    look(scene, DVec3::new(0.6, 1.9, 4.6), DVec3::new(0.0, 0.6, 0.0), 38.0);
}

/// A sphere with tangents along its parallels; facets on the equator have both signs of the bitangent, and the
/// interpolated one decides.
fn sphere_with_tangents(rings: u32) -> TriMesh {
    let mut mesh = TriMesh::sphere(Vec3::ZERO, 0.7, rings);
    mesh.tangents = mesh.uvs[0]
        .iter()
        .map(|uv| {
            let phi = f64::from(uv.x) * TAU;
            Vec4::new(-phi.sin() as f32, 0.0, phi.cos() as f32, if uv.y < 0.5 { 1.0 } else { -1.0 })
        })
        .collect();
    mesh
}

/// Spheres with smooth normals and normal maps; as they are, stretched, mirrored, sheared.
pub fn transforms() -> Scene {
    let mut scene = Scene::new();
    floor(&mut scene, Material::lambert(Vec3::new(0.5, 0.6, 0.7)));
    ceiling_lamp(&mut scene, 4.0);
    point(&mut scene, DVec3::new(2.0, 2.5, 2.0), 6.0);
    let mesh = Arc::new(sphere_with_tangents(6));
    let mapped = Material { roughness: 0.4, metallic: 0.3, normal_texture: Some(normal_map(3)), ..Material::default() };
    let mapped = scene.spawn((Material { base_color: Vec3::new(0.9, 0.6, 0.3), ..mapped },));
    let plain =
        Material { roughness: 0.25, metallic: 0.0, base_color: Vec3::new(0.3, 0.7, 0.4), ..Material::default() };
    let plain = scene.spawn((Material { double_sided: true, ..plain },));
    let turn = DQuat::from_rotation_z(0.7);
    let shear = DMat3::from_cols(DVec3::new(0.7, 0.0, 0.2), DVec3::new(0.4, 0.9, 0.0), DVec3::new(0.0, 0.3, -0.8));
    for (material, place) in [
        (mapped, DAffine3::from_translation(DVec3::new(-1.5, 0.7, 0.3))),
        (
            mapped,
            DAffine3::from_scale_rotation_translation(DVec3::new(-0.6, 1.2, 0.8), turn, DVec3::new(0.0, 0.8, 0.0)),
        ),
        (mapped, DAffine3::from_mat3_translation(shear, DVec3::new(1.4, 0.7, 0.5))),
        (
            plain,
            DAffine3::from_scale_rotation_translation(DVec3::new(0.5, -0.3, 0.5), turn, DVec3::new(-0.7, 0.3, 1.5)),
        ),
        (plain, DAffine3::from_scale_rotation_translation(DVec3::new(0.9, 0.2, 0.4), turn, DVec3::new(0.8, 0.5, 1.6))),
    ] {
        scene.spawn((Geometry(Arc::clone(&mesh)), MaterialSlots::from(material), LocalTransform::Matrix(place)));
    }
    camera(&mut scene);
    scene
}

/// Solids of rough and clear glass that absorb, with a lamp, a point light and one light inside.
pub fn solids() -> Scene {
    let mut scene = Scene::new();
    floor(&mut scene, Material::lambert(Vec3::new(0.7, 0.6, 0.5)));
    ceiling_lamp(&mut scene, 5.0);
    point(&mut scene, DVec3::new(-2.0, 2.0, 2.0), 4.0);
    let glass = |roughness: f32, ior: f32, color: [f32; 3]| Material {
        roughness,
        attenuation_distance: 0.6,
        attenuation_color: Vec3::from(color),
        base_color: Vec3::new(0.95, 0.9, 1.0),
        ..Material::glass(ior)
    };
    show(&mut scene, TriMesh::sphere(Vec3::new(-1.3, 0.7, 0.2), 0.7, 10), glass(0.4, 1.5, [0.3, 0.8, 0.5]));
    let block = TriMesh::cuboid(Vec3::new(-0.4, 0.01, -0.5), Vec3::new(0.4, 1.2, 0.3));
    show(&mut scene, block, glass(0.6, 1.3, [0.8, 0.4, 0.3]));
    point(&mut scene, DVec3::new(0.0, 0.6, -0.1), 0.3);
    show(&mut scene, TriMesh::sphere(Vec3::new(1.3, 0.6, 0.7), 0.6, 8), glass(0.25, 1.8, [0.5, 0.5, 0.9]));
    // Barely a solid: its transmission is a delta though it is rough.
    show(&mut scene, TriMesh::sphere(Vec3::new(0.3, 0.3, 1.5), 0.3, 8), glass(0.05, 1.0, [0.9, 0.2, 0.2]));
    camera(&mut scene);
    scene
}

/// Clear solids, seen in a soft sky, so that there is no caustic to wait for.
pub fn clear_solids() -> Scene {
    let mut scene = Scene::new();
    floor(&mut scene, Material::lambert(Vec3::new(0.7, 0.6, 0.5)));
    scene.spawn((Environment::constant(Vec3::new(0.8, 1.0, 1.2)),));
    let glass =
        Material { attenuation_distance: 0.7, attenuation_color: Vec3::new(0.4, 0.7, 0.9), ..Material::glass(1.5) };
    show(&mut scene, TriMesh::sphere(Vec3::new(-1.0, 0.7, 0.2), 0.7, 8), glass.clone());
    show(
        &mut scene,
        TriMesh::cuboid(Vec3::new(0.2, 0.2, -0.4), Vec3::new(1.2, 1.2, 0.6)),
        Material { ior: 2.0, ..glass.clone() },
    );
    let half = Material { transmission: 0.5, base_color: Vec3::new(0.8, 0.5, 0.4), ior: 0.0, specular: 0.5, ..glass };
    show(&mut scene, TriMesh::sphere(Vec3::new(0.0, 0.4, 1.4), 0.4, 8), half);
    camera(&mut scene);
    scene
}

/// Thin walls, clear and rough, tinted and half diffuse.
pub fn thin_walls() -> Scene {
    let mut scene = Scene::new();
    floor(&mut scene, Material::lambert(Vec3::new(0.7, 0.7, 0.6)));
    ceiling_lamp(&mut scene, 4.0);
    point(&mut scene, DVec3::new(1.0, 1.5, -2.5), 8.0);
    let pane = |x: f32| TriMesh::quad(Vec3::new(x, 0.05, 0.3), Vec3::new(0.9, 0.0, 0.2), Vec3::Y * 1.4);
    let thin = |roughness, transmission, color: [f32; 3]| Material {
        roughness,
        transmission,
        base_color: Vec3::from(color),
        thickness: 0.0,
        ..Material::glass(1.5)
    };
    show(&mut scene, pane(-1.8), thin(0.3, 1.0, [0.9, 0.5, 0.4]));
    show(&mut scene, pane(-0.6), thin(0.6, 0.6, [0.4, 0.8, 0.5]));
    show(
        &mut scene,
        pane(0.6),
        Material { specular_color: Vec3::new(0.4, 0.8, 1.5), ..thin(0.2, 0.8, [0.8, 0.8, 0.9]) },
    );
    show(&mut scene, TriMesh::sphere(Vec3::new(0.0, 0.35, 1.6), 0.35, 8), thin(0.0, 1.0, [0.7, 0.9, 0.9]));
    camera(&mut scene);
    scene
}

/// Every slot of a material holds a texture, each read in its own way.
pub fn textures() -> Scene {
    let mut scene = Scene::new();
    let transform = UvTransform { offset: [0.3, -0.2], rotation: 0.4, scale: [3.0, 2.0] };
    let ground = Material {
        base_color_texture: Some(Texture { transform, filter: Filter::Nearest, ..image(1, [60; 4], [250; 4]) }),
        ..Material::lambert(Vec3::ONE)
    };
    floor(&mut scene, ground);
    let lamp = TriMesh::quad(Vec3::new(-1.0, 3.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0);
    let glow =
        Texture { wrap_u: Wrap::ClampToEdge, wrap_v: Wrap::MirroredRepeat, transform, ..image(2, [20; 4], [255; 4]) };
    show(
        &mut scene,
        lamp,
        Material { emissive: Vec3::splat(8.0), emissive_texture: Some(glow), ..Material::lambert(Vec3::ONE) },
    );
    let mut mesh = sphere_with_tangents(8);
    let second = mesh.uvs[0].iter().map(|uv| Vec2::new(3.0 * uv.y, 2.0 * uv.x)).collect();
    mesh.uvs.push(second);
    mesh.colors = mesh.positions.iter().map(|p| (0.5 + 0.6 * *p).extend(1.0).clamp(Vec4::ZERO, Vec4::ONE)).collect();
    let mesh = Arc::new(mesh);
    let everything = Material {
        base_color_texture: Some(image(4, [90; 4], [255; 4])),
        metallic_roughness_texture: Some(Texture { tex_coord: 1, ..image(5, [0, 80, 0, 0], [0, 255, 255, 0]) }),
        normal_texture: Some(normal_map(6)),
        normal_scale: 0.7,
        specular_texture: Some(image(7, [0; 4], [255; 4])),
        specular_color_texture: Some(Texture { tex_coord: 1, ..image(8, [50; 4], [255; 4]) }),
        specular_color: Vec3::new(1.5, 1.0, 0.8),
        roughness: 0.9,
        metallic: 0.8,
        ior: 1.7,
        ..Material::default()
    };
    let pearly =
        Material { transmission: 0.9, transmission_texture: Some(image(9, [0; 4], [255; 4])), ..everything.clone() };
    let solid = Material {
        thickness: 1.0,
        metallic: 0.2,
        attenuation_distance: 0.5,
        attenuation_color: Vec3::new(0.5, 0.8, 0.6),
        ..pearly.clone()
    };
    let holes = Texture { transform, ..image(10, [200, 200, 200, 0], [255; 4]) };
    let masked = Material {
        alpha_mode: AlphaMode::Mask { cutoff: 0.4 },
        base_color_texture: Some(holes.clone()),
        double_sided: true,
        ..everything.clone()
    };
    let blended = Material {
        alpha_mode: AlphaMode::Blend,
        base_color_texture: Some(holes),
        base_alpha: 0.8,
        ..everything.clone()
    };
    let places = [(-1.6, 0.7, -0.2), (0.0, 0.7, -0.4), (1.6, 0.7, -0.2), (-0.8, 0.7, 1.3), (0.9, 0.7, 1.3)];
    for (material, (x, y, z)) in [everything, pearly, solid, masked, blended].into_iter().zip(places) {
        let material = scene.spawn((material,));
        scene.spawn((
            Geometry(Arc::clone(&mesh)),
            MaterialSlots::from(material),
            LocalTransform::from_translation(DVec3::new(x, y, z)),
        ));
    }
    camera(&mut scene);
    scene
}

/// Lambert, metal, glossy paint and an unlit card under a picture of the sky, turned.
pub fn sky() -> Scene {
    let mut scene = Scene::new();
    floor(&mut scene, Material::lambert(Vec3::new(0.5, 0.5, 0.6)));
    scene.spawn((Environment { sky: sky_map(), rotation_degrees: 65.0, scale: 0.7 },));
    let metal = Material { roughness: 0.3, base_color: Vec3::new(0.9, 0.7, 0.4), ..Material::default() };
    show(&mut scene, TriMesh::sphere(Vec3::new(-1.2, 0.7, 0.0), 0.7, 10), metal);
    let paint = Material { roughness: 0.2, metallic: 0.0, base_color: Vec3::new(0.2, 0.3, 0.8), ..Material::default() };
    show(&mut scene, TriMesh::cuboid(Vec3::new(-0.3, 0.0, -0.8), Vec3::new(0.5, 1.3, 0.0)), paint);
    show(&mut scene, TriMesh::sphere(Vec3::new(1.3, 0.6, 0.4), 0.6, 10), Material::lambert(Vec3::new(0.8, 0.4, 0.3)));
    let card =
        Material { unlit: true, base_color: Vec3::new(0.3, 0.8, 0.4), double_sided: true, ..Material::default() };
    show(&mut scene, TriMesh::quad(Vec3::new(-0.4, 0.0, 1.4), Vec3::X * 0.7, Vec3::Y * 0.5), card);
    camera(&mut scene);
    scene
}

/// Parallel rays, clipped in front and behind, on lights that have no size.
pub fn parallel() -> Scene {
    let mut scene = Scene::new();
    floor(&mut scene, Material::lambert(Vec3::new(0.6, 0.5, 0.5)));
    let plastic =
        Material { roughness: 0.35, metallic: 0.0, base_color: Vec3::new(0.7, 0.3, 0.2), ..Material::default() };
    show(&mut scene, TriMesh::cuboid(Vec3::new(-1.0, 0.0, -0.5), Vec3::new(-0.2, 1.6, 0.5)), plastic);
    show(&mut scene, TriMesh::sphere(Vec3::new(0.9, 0.6, 0.2), 0.6, 8), Material::default());
    let light = SpotLight { color: Vec3::new(1.0, 0.7, 0.5), intensity: Candela(30.0), inner: 0.2, outer: 0.5 };
    scene.spawn((light, LocalTransform::looking_at(DVec3::new(2.0, 3.0, 2.0), DVec3::new(0.0, 0.5, 0.0), DVec3::Y)));
    let light = DirectionalLight { color: Vec3::new(0.6, 0.8, 1.0), illuminance: Lux(2.0) };
    scene.spawn((light, LocalTransform::looking_at(DVec3::new(-1.0, 2.0, 0.5), DVec3::ZERO, DVec3::Y)));
    let projection = Projection::Orthographic { xmag: 1.8, ymag: 1.8 };
    let eye = DVec3::new(1.0, 2.0, 4.0);
    let camera = Camera { projection, znear: 3.6, zfar: 6.5 };
    scene.spawn((camera, LocalTransform::looking_at(eye, DVec3::new(0.0, 0.6, 0.0), DVec3::Y)));
    scene
}

/// Coarse spheres with smooth normals, where the shadow terminator matters.
pub fn coarse() -> Scene {
    let mut scene = Scene::new();
    floor(&mut scene, Material::lambert(Vec3::splat(0.5)));
    point(&mut scene, DVec3::new(3.0, 2.0, 0.5), 15.0);
    ceiling_lamp(&mut scene, 1.5);
    show(&mut scene, TriMesh::sphere(Vec3::new(-1.0, 0.8, 0.0), 0.8, 4), Material::lambert(Vec3::new(0.8, 0.5, 0.4)));
    let gloss = Material { roughness: 0.4, metallic: 0.5, base_color: Vec3::new(0.5, 0.7, 0.9), ..Material::default() };
    show(&mut scene, TriMesh::sphere(Vec3::new(1.0, 0.8, 0.3), 0.8, 4), gloss);
    // A bowl: smooth, hollow and seen from its back.
    let mut bowl = TriMesh::sphere(Vec3::new(0.0, 0.6, 1.5), 0.5, 6);
    let keep =
        bowl.triangles.iter().filter(|t| t.iter().all(|&i| bowl.positions[i as usize].y < 0.62)).copied().collect();
    bowl.triangles = keep;
    show(&mut scene, bowl, Material::lambert(Vec3::new(0.4, 0.7, 0.4)));
    camera(&mut scene);
    scene
}

/// The rim of a coarse sphere, lit by nothing but a lamp that is just above its horizon.
pub fn rim() -> Scene {
    let mut scene = Scene::new();
    ceiling_lamp(&mut scene, 1.5);
    show(&mut scene, TriMesh::sphere(Vec3::new(1.0, 0.8, 0.3), 0.8, 4), Material::lambert(Vec3::new(0.8, 0.5, 0.4)));
    look(&mut scene, DVec3::new(0.6, 1.9, 4.6), DVec3::new(1.65, 1.05, 0.3), 8.0);
    scene
}

/// The settings shared by all: what differs is set by the test.
pub fn settings() -> RenderSettings {
    RenderSettings { width: 16, height: 16, tile_size: 8, sharing: Sharing::Always, ..RenderSettings::default() }
}
