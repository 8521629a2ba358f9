//! Glass: what it shows, loses and absorbs.

use glam::Vec3;

use super::scene::*;
use crate::{
    reference::bsdf::fresnel,
    world::{Material, TriMesh},
};

fn thin_glass(ior: f32) -> Material {
    Material { metallic: 0.0, roughness: 0.0, transmission: 1.0, ior, ..Material::default() }
}

/// A smooth solid of any index loses nothing, so a uniform sky shows through and off it as itself.
#[test]
fn glass_sphere_shows_the_uniform_sky() {
    for ior in [1.0, 1.33, 1.5, 2.4, 0.8] {
        let mut scene = TestScene::new();
        // Flat: smooth normals on a mesh would lose what they bend below a facet.
        scene.mesh(flat_shaded(TriMesh::sphere(Vec3::ZERO, 1.0, 32)), &Material::glass(ior));
        scene.sky(2.0);
        for x in [0.03, 0.5, 0.9] {
            scene.check(Vec3::new(x, 0.1, 5.0), Vec3::NEG_Z, &samples(20_000, None), 2.0);
        }
    }
}

/// With smooth normals too, but for the few paths whose refraction is on the wrong side of a facet.
#[test]
fn smooth_glass_sphere_loses_little() {
    let mut scene = TestScene::new();
    scene.mesh(TriMesh::sphere(Vec3::ZERO, 1.0, 48), &Material::glass(1.5));
    scene.sky(1.0);
    for x in [0.0, 0.4, 0.8] {
        let (mean, error) = scene.look(Vec3::new(x, 0.1, 5.0), Vec3::NEG_Z, &samples(20_000, None));
        assert!((mean.y - 1.0).abs() < 4.0 * error + 0.01, "{mean} ± {error}");
    }
}

/// A plate reflects F of what is before it and lets 1 − F of what is behind it straight through.
#[test]
fn thin_wall_reflects_f_and_transmits_the_rest() {
    for (cos, sin) in [(1.0, 0.0), (0.6f64, 0.8f64), (0.1, 0.99f64.sqrt())] {
        let f = fresnel(1.5, cos).unwrap();
        // Above 1 nit, below 5.
        let mut scene = TestScene::new();
        scene.mesh(floor(Vec3::ZERO, 0.5), &thin_glass(1.5));
        scene.sky_map(1, vec![[1.0; 3], [5.0; 3]], 0.0);
        let along = Vec3::new(sin as f32, -cos as f32, 0.0);
        let from = Vec3::new(0.01, 0.0, 0.02) - along;
        let want = f + 5.0 * (1.0 - f);
        scene.check(from, along, &samples(40_000, None), want);
    }
}

/// A rough thin wall has no inside: it is the same from its back.
#[test]
fn thin_wall_is_the_same_from_both_sides() {
    let looks = [1.0, -1.0].map(|side: f32| {
        let mut scene = TestScene::new();
        scene.mesh(floor(Vec3::ZERO, 0.5), &Material { roughness: 0.4, ..thin_glass(1.5) });
        let sky = if side > 0.0 { [1.0, 5.0] } else { [5.0, 1.0] };
        scene.sky_map(1, sky.map(|v| [v; 3]).to_vec(), 0.0);
        let along = Vec3::new(0.6, -0.8 * side, 0.0);
        scene.look(Vec3::new(0.01, 0.0, 0.02) - along, along, &samples(40_000, None))
    });
    let [(a, ea), (b, eb)] = looks;
    assert!((a.y - b.y).abs() < 4.0 * ea.hypot(eb), "{a} {b}");
}

/// Straight through a slab of thickness d: (1 − R)² e^{−σd} Σ (R e^{−σd})^{2k} of what is behind it; with
/// at most two scatterings only the first term.
#[test]
fn slab_absorbs_by_beer_and_lambert() {
    let (depth, ior) = (0.5f32, 1.5);
    let glass = Material { attenuation_color: Vec3::splat(0.25), attenuation_distance: 0.8, ..Material::glass(ior) };
    let mut scene = TestScene::new();
    scene.mesh(TriMesh::cuboid(Vec3::new(-9.0, 0.0, -9.0), Vec3::new(9.0, depth, 9.0)), &glass);
    // Light from behind alone.
    scene.sky_map(1, vec![[0.0; 3], [1.0; 3]], 0.0);
    let sigma = f64::from(scene.flat.materials.absorption[0][0]);
    assert!((sigma + 0.25f64.ln() / f64::from(0.8f32)).abs() < 1e-6);
    let a = (-sigma * f64::from(depth)).exp();
    let r = 0.04;
    let from = Vec3::new(0.1, 2.0, 0.2);
    let once = (1.0 - r) * (1.0 - r) * a;
    scene.check(from, Vec3::NEG_Y, &samples(40_000, 2), once);
    scene.check(from, Vec3::NEG_Y, &samples(40_000, None), once / (1.0 - r * r * a * a));
    // From within, the camera's ray counts as inside the solid whose back it meets; radiance in there is η² times larger.
    let within = 2.25 * (1.0 - r) * (-sigma * 0.25).exp();
    scene.check(Vec3::new(0.1, 0.25, 0.2), Vec3::NEG_Y, &samples(40_000, 1), within);
}

/// A light and what it lights inside of a solid: the light's way to the surface is absorbed, and the view's.
#[test]
fn light_inside_a_solid_is_absorbed_on_its_way() {
    let glass = Material { attenuation_color: Vec3::splat(0.5), attenuation_distance: 1.0, ..Material::glass(1.5) };
    let mut scene = TestScene::new();
    scene.mesh(TriMesh::cuboid(Vec3::splat(-4.0), Vec3::splat(4.0)), &glass);
    scene.mesh(floor(Vec3::new(0.1, 0.0, 0.0), 1.0), &lambert(1.0));
    scene.point_light(Vec3::new(0.5, 1.5, 0.0), 7.0);
    let sigma = f64::from(scene.flat.materials.absorption[0][0]);
    // From above through the top: one interface, 4 m of glass, then the floor lit directly.
    let want = 0.96 / 2.25 * (-sigma * 4.0f64).exp() * 7.0 / 2.25 * (-sigma * 1.5).exp() / std::f64::consts::PI;
    let (mean, error) = scene.look(Vec3::new(0.5, 6.0, 0.01), Vec3::NEG_Y, &samples(40_000, 2));
    // The view is 1 cm beside the light.
    assert!((mean.y - want).abs() < 4.0 * error + 1e-3 * want, "got {mean}, want {want}");
}

/// Infinite index: all is reflected, inside and out.
#[test]
fn infinitely_dense_glass_is_a_mirror() {
    let mut scene = TestScene::new();
    scene.mesh(flat_shaded(TriMesh::sphere(Vec3::ZERO, 1.0, 16)), &Material::glass(0.0));
    scene.sky_map(1, vec![[3.0; 3], [1.0; 3]], 0.0);
    scene.check(Vec3::new(0.1, 5.0, 0.2), Vec3::NEG_Y, &samples(100, None), 3.0);
}
