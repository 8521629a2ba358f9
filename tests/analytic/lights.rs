//! Light that falls onto a diffuse plane at a point: ρE/π.

use std::{
    f64::consts::{PI, TAU},
    sync::Arc,
};

use glam::{DAffine3, DQuat, DVec3, Vec3};
use wavecast::world::{
    DirectionalLight, EmissiveSurface, Environment, EnvironmentMap, Filter, Geometry, Image, LocalTransform, Material,
    MaterialSlots, PointLight, Scene, Sky, SpotLight, Texels, Texture, TriMesh,
    units::{Candela, Lux},
};

use super::{Case, ceiling, lambert, lamp, look_at_point, look_at_square, oracle, plane};
use crate::common::show;

const RHO: f32 = 0.75;

/// A diffuse floor, seen at the origin.
fn floor() -> Scene {
    let mut scene = Scene::new();
    show(&mut scene, plane(0.0), Material::lambert(Vec3::splat(RHO)));
    look_at_point(&mut scene, DVec3::new(-1.5, 2.0, 1.0), DVec3::ZERO);
    scene
}

/// E = I cosθ / d², I = 20 cd at (x, 2, 0).
pub fn point_over_plane(x: f64) -> Case {
    let mut scene = floor();
    let at = DVec3::new(x, 2.0, 0.0);
    let light = PointLight { color: Vec3::ONE, intensity: Candela(20.0) };
    scene.spawn((light, LocalTransform::from_translation(at)));
    let irradiance = 20.0 * at.y / at.length().powi(3);
    Case::gray(&format!("point light over a plane, aside {x} m"), scene, lambert(RHO, irradiance), 16)
}

/// A spot of 20 cd, 2 m above, whose axis is turned so that the origin lies `degrees` off it; full within 20°, dark
/// beyond 40°: E = I · clamp((cos − cos 40°) / (cos 20° − cos 40°))² · cosθ / d².
fn spot(degrees: f64) -> Case {
    let mut scene = floor();
    let at = DVec3::new(0.5, 2.0, -0.25);
    let (inner, outer) = (20f32.to_radians(), 40f32.to_radians());
    let light = SpotLight { color: Vec3::ONE, intensity: Candela(20.0), inner, outer };
    let to_light = at.normalize();
    let axis = DQuat::from_axis_angle(to_light.any_orthonormal_vector(), degrees.to_radians()) * -to_light;
    scene.spawn((light, LocalTransform::looking_at(at, at + axis, DVec3::X)));
    let [inner, outer] = [20f64, 40.0].map(|a| a.to_radians().cos());
    let ramp = ((degrees.to_radians().cos() - outer) / (inner - outer)).clamp(0.0, 1.0);
    let irradiance = 20.0 * ramp * ramp * to_light.y / at.length_squared();
    Case::gray(&format!("spot light, {degrees}° off its axis"), scene, lambert(RHO, irradiance), 16)
}

/// E = E₀ cosθ.
pub fn sun(degrees: f64) -> Case {
    let mut scene = floor();
    let (sin, cos) = degrees.to_radians().sin_cos();
    let light = DirectionalLight { color: Vec3::ONE, illuminance: Lux(5.0) };
    scene.spawn((light, LocalTransform::looking_at(DVec3::new(sin, cos, 0.0), DVec3::ZERO, DVec3::Z)));
    Case::gray(&format!("directional light, {degrees}° from the zenith"), scene, lambert(RHO, 5.0 * cos), 16)
}

/// E = L · projected solid angle of the polygons that are there.
fn area(name: &str, mesh: TriMesh, spp: u32) -> Case {
    let mut scene = floor();
    let irradiance = 3.0 * oracle::mesh_irradiance(DVec3::ZERO, DVec3::Y, &mesh);
    show(&mut scene, mesh, lamp(3.0));
    Case::gray(name, scene, lambert(RHO, irradiance), spp)
}

/// The same light as an instance that is stretched, turned and mirrored, made to emit by a component.
fn mirrored_instance() -> Case {
    let mut scene = floor();
    let (mesh, [origin, u, v]) = ceiling(Vec3::new(-0.25, 0.0, -0.5), 1.0);
    let rotation = DQuat::from_rotation_z(0.3);
    let [translation, scale] = [DVec3::new(0.5, 1.5, 0.0), DVec3::new(-1.0, 1.0, 1.5)];
    let world = DAffine3::from_scale_rotation_translation(scale, rotation, translation);
    let polygon = [origin, origin + u, origin + u + v, origin + v].map(|p| world.transform_point3(p));
    let material = scene.spawn((lamp(0.0),));
    scene.spawn((
        Geometry(Arc::new(mesh)),
        MaterialSlots::from(material),
        EmissiveSurface { radiance: Vec3::splat(3.0) },
        LocalTransform::Trs { translation, rotation, scale },
    ));
    let irradiance = 3.0 * oracle::polygon_irradiance(DVec3::ZERO, DVec3::Y, &polygon);
    Case::gray("area light as a mirrored, stretched instance", scene, lambert(RHO, irradiance), 16_384)
}

/// Two by two texels, sRGB, rows from the top.
const TEXELS: [[u8; 3]; 4] = [[255, 20, 128], [60, 200, 90], [10, 90, 250], [180, 140, 30]];

fn checker(filter: Filter) -> Texture {
    let texels = Texels::Rgba8(TEXELS.iter().map(|&[r, g, b]| [r, g, b, 255]).collect());
    let image = Image { name: "checker".to_owned(), width: 2, height: 2, texels };
    Texture { filter, ..Texture::new(Arc::new(image)) }
}

/// E = Σ L_texel · projected solid angle of the texel.
fn textured() -> Case {
    let mut scene = floor();
    let (mesh, [origin, u, v]) = ceiling(Vec3::new(-0.5, 1.0, -1.0), 2.0);
    show(&mut scene, mesh, Material { emissive_texture: Some(checker(Filter::Nearest)), ..lamp(3.0) });
    let truth = std::array::from_fn(|channel| {
        let of_texel = |i: usize| {
            // u runs with the columns; v, of the image, from the top, and the quad's bottom row is at its origin.
            let corner = origin + 0.5 * u * (i % 2) as f64 + 0.5 * v * (1 - i / 2) as f64;
            let polygon = [corner, corner + 0.5 * u, corner + 0.5 * (u + v), corner + 0.5 * v];
            oracle::srgb(TEXELS[i][channel]) * oracle::polygon_irradiance(DVec3::ZERO, DVec3::Y, &polygon)
        };
        lambert(RHO, 3.0 * (0..4).map(of_texel).sum::<f64>())
    });
    Case::new("area light with texels", scene, truth, 32_768)
}

/// Seen as a whole, a bilinear texture that repeats has the mean of its texels.
fn textured_seen() -> Case {
    let mut scene = Scene::new();
    let (mesh, _) = ceiling(Vec3::new(-1.0, 0.0, -1.0), 2.0);
    show(&mut scene, mesh, Material { emissive_texture: Some(checker(Filter::Linear)), ..lamp(3.0) });
    look_at_square(&mut scene, DVec3::NEG_Y, DVec3::ZERO, DVec3::Z, 1.0);
    let truth = std::array::from_fn(|i| 3.0 * TEXELS.iter().map(|texel| oracle::srgb(texel[i])).sum::<f64>() / 4.0);
    Case::new("textured emission seen as a whole", scene, truth, 4096)
}

/// One bright texel of an otherwise black map, on a plane that faces up or along +X:
/// E↑ = L Δφ (sin²θ₁ − sin²θ₀) / 2, E→ = L [θ/2 − sin 2θ/4] [sin φ].
fn bright_texel(up: bool, rotation_degrees: f32) -> Case {
    const COLUMNS: u32 = 32;
    const ROWS: u32 = 16;
    let (row, column) = (4, 17);
    let mut texels = vec![[0.0; 3]; (COLUMNS * ROWS) as usize];
    texels[(row * COLUMNS + column) as usize] = [100.0; 3];
    let map = EnvironmentMap { name: "star".to_owned(), width: COLUMNS, height: ROWS, texels };
    let mut scene = Scene::new();
    scene.spawn((Environment { sky: Sky::Map(Arc::new(map)), rotation_degrees, scale: 0.5 },));
    let mesh =
        if up { plane(0.0) } else { TriMesh::quad(Vec3::new(0.0, -8.0, 8.0), Vec3::NEG_Z * 16.0, Vec3::Y * 16.0) };
    show(&mut scene, mesh, Material::lambert(Vec3::splat(RHO)));
    look_at_point(&mut scene, DVec3::new(2.0, 2.0, 1.0), DVec3::ZERO);
    // The map's azimuth is the world's plus the rotation.
    let [phi0, phi1] =
        [0, 1].map(|i| TAU * (f64::from(column + i) / 32.0 - 0.5) - f64::from(rotation_degrees).to_radians());
    let [theta0, theta1] = [0, 1].map(|i| PI * f64::from(row + i) / 16.0);
    let across = |theta: f64| 0.5 * theta - 0.25 * (2.0 * theta).sin();
    let irradiance = if up {
        0.5 * (phi1 - phi0) * (theta1.sin().powi(2) - theta0.sin().powi(2))
    } else {
        (across(theta1) - across(theta0)) * (phi1.sin() - phi0.sin())
    };
    let side = if up { "up" } else { "aside" };
    let name = format!("one bright texel, plane faces {side}, turned {rotation_degrees}°");
    Case::gray(&name, scene, lambert(RHO, 50.0 * irradiance), 16_384)
}

/// E = πL under a sky of half a million texels, the lower half of which is out of sight but is drawn too, as are lamps
/// below the plane: a choice of light, then of texel, that is short of bits draws what is in sight too seldom.
fn fine_sky(lamps: u32) -> Case {
    let texels = (0..1024 * 512).map(|i| [if i < 1024 * 256 { 2.0 } else { 0.2 }; 3]).collect();
    let map = EnvironmentMap { name: "halves".to_owned(), width: 1024, height: 512, texels };
    let mut scene = floor();
    scene.spawn((Environment { sky: Sky::Map(Arc::new(map)), rotation_degrees: 0.0, scale: 1.0 },));
    for i in 0..lamps {
        let place = LocalTransform::from_translation(DVec3::new(f64::from(i), -3.0, 0.0));
        scene.spawn((PointLight { color: Vec3::ONE, intensity: Candela(20.0) }, place));
    }
    let name = format!("a sky of 1024×512 texels and {lamps} lamps out of sight");
    Case::gray(&name, scene, lambert(RHO, 2.0 * PI), 65_536).max_depth(1)
}

pub fn cases() -> Vec<Case> {
    let mut disc = TriMesh::disc(Vec3::new(0.5, 1.0, 0.25), 0.75, 24);
    disc.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    // From the floor up to 2 m, at x = 1, facing −X; half of it below the horizon.
    let wall = TriMesh::quad(Vec3::new(1.0, -2.0, -1.0), Vec3::Z * 2.0, Vec3::Y * 4.0);
    vec![
        point_over_plane(0.0),
        point_over_plane(1.5),
        spot(10.0),
        spot(30.0),
        spot(37.0),
        sun(0.0),
        sun(45.0),
        sun(80.0),
        area("disc light", disc, 16_384),
        area("sphere light", TriMesh::sphere(Vec3::new(0.5, 1.5, 0.0), 0.75, 12), 65_536),
        area("wall light across the horizon", wall, 32_768),
        mirrored_instance(),
        textured(),
        textured_seen(),
        bright_texel(true, 0.0),
        bright_texel(true, 75.0),
        bright_texel(false, 30.0),
        fine_sky(0),
        fine_sky(15),
    ]
}
