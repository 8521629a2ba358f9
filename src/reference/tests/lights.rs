//! Light on a plane, by formula.

use std::f64::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::scene::*;
use crate::{
    flat::LocalLight,
    world::{Material, TriMesh},
};

/// A white floor whose radiance is its illuminance over π.
fn white_floor() -> TestScene {
    let mut scene = TestScene::new();
    scene.mesh(floor(Vec3::new(0.3, 0.0, 0.2), 50.0), &lambert(1.0));
    scene
}

const EYE: Vec3 = Vec3::new(0.7, 3.0, 0.0);

/// Illuminance I·cosθ/d² under a point light.
#[test]
fn point_light_gives_its_lux() {
    let mut scene = white_floor();
    scene.point_light(Vec3::new(0.0, 2.0, 0.0), 30.0);
    let (dx, h) = (f64::from(0.7f32), 2.0);
    let d2 = dx * dx + h * h;
    scene.check(EYE, Vec3::NEG_Y, &samples(4, 1), 30.0 * h / d2.powf(1.5) / PI);
}

/// The ramp squared, within and without the cone.
#[test]
fn spot_light_falls_off_as_the_square_of_a_ramp() {
    let (inner, outer) = (0.95f32, 0.8f32);
    let (cos_scale, cos_offset) = (1.0 / (inner - outer), -outer / (inner - outer));
    for (x, brightness) in [(0.0f32, 1.0..=1.0), (1.0, 0.1..=0.99), (1.3, 0.001..=0.5), (2.0, 0.0..=0.0)] {
        let mut scene = white_floor();
        scene.flat.lights.local.push(LocalLight {
            position: [0.0, 2.0, 0.01],
            axis: [0.0, -1.0, 0.0],
            intensity: [10.0; 3],
            cos_scale,
            cos_offset,
            key: 0,
        });
        let d = (4.0 + f64::from(x).powi(2) + f64::from(0.01f32).powi(2)).sqrt();
        let ramp = (2.0 / d * f64::from(cos_scale) + f64::from(cos_offset)).clamp(0.0, 1.0);
        assert!(brightness.contains(&(ramp * ramp)), "{x}: {ramp}");
        scene.check(Vec3::new(x, 3.0, 0.0), Vec3::NEG_Y, &samples(2, 1), 10.0 * ramp * ramp * 2.0 / d.powi(3) / PI);
    }
}

/// E·cosθ, and nothing from below.
#[test]
fn distant_light_gives_its_lux_times_cosine() {
    let mut scene = white_floor();
    scene.distant_light(Vec3::new(3.0, 4.0, 0.0), 100.0);
    scene.check(EYE, Vec3::NEG_Y, &samples(4, 1), 80.0 / PI);
    let mut dark = white_floor();
    dark.distant_light(Vec3::new(3.0, -4.0, 0.0), 100.0);
    dark.check(EYE, Vec3::NEG_Y, &samples(4, 1), 0.0);
}

/// An occluder between, but not one beyond, the light hides it.
#[test]
fn only_what_is_between_casts_a_shadow() {
    for (height, lit) in [(1.0, false), (2.5, true)] {
        let mut scene = white_floor();
        scene.point_light(Vec3::new(0.7, 2.0, 0.0), 10.0);
        scene.mesh(floor(Vec3::new(0.7, height, 0.02), 0.3), &lambert(0.0));
        let want = if lit { 10.0 / 4.0 / PI } else { 0.0 };
        scene.check(Vec3::new(0.7, 0.5, 0.0), Vec3::NEG_Y, &samples(4, 1), want);
    }
}

/// A disc of radiance L that fills a cone of half-angle θ about the normal gives πL·sin²θ lx;
/// inscribed in the circle, a regular n-gon has less: (n/2π)·sin(2π/n) of the area, and almost so of the light.
#[test]
fn disc_light_gives_pi_l_sine_squared() {
    let (radius, height) = (1.0, 1.5);
    let mut scene = white_floor();
    let disc = turned_inside_out(TriMesh::disc(Vec3::new(0.7, height, 0.0), radius, 512));
    let light = Material { double_sided: false, ..emitter(0.0, 4.0) };
    scene.mesh(disc, &light);
    let sin2 = 1.0 / (1.0 + f64::from(height).powi(2));
    let (mean, error) = scene.look(Vec3::new(0.7, 0.1, 0.0), Vec3::NEG_Y, &samples(40_000, 1));
    let want = 4.0 * sin2;
    assert!((mean.y - want).abs() < 4.0 * error + 1e-4 * want, "got {mean}, want {want} ± {error}");
    assert!(error < 2e-3 * want);
}

/// A rough metal sees area lights both ways: by looking for them and by reflection. Turning one
/// way off must not matter, so the mean equals quadrature over the light.
#[test]
fn area_light_on_a_rough_metal_is_that_of_quadrature() {
    use glam::DVec3;

    use crate::reference::bsdf::{Surface, eval};
    for roughness in [0.15, 0.5] {
        let mut scene = TestScene::new();
        scene.mesh(
            floor(Vec3::new(0.3, 0.0, 0.2), 50.0),
            &Material { base_color: Vec3::ONE, metallic: 1.0, roughness, ..Material::default() },
        );
        // A square of side 1 at height 1, facing down.
        let quad = turned_inside_out(floor(Vec3::new(-1.0, 1.0, 0.0), 0.5));
        scene.mesh(quad, &Material { double_sided: false, ..emitter(0.0, 1.0) });
        let from = Vec3::new(1.0, 1.0, 0.0);
        let surface = Surface { metallic: 1.0, roughness: f64::from(roughness), ..Surface::default() };
        let turn = |v: DVec3| DVec3::new(v.x, -v.z, v.y);
        let n = 600;
        let mut want = 0.0;
        for i in 0..n * n {
            let (x, z) = ((f64::from(i % n) + 0.5) / f64::from(n) - 1.5, (f64::from(i / n) + 0.5) / f64::from(n) - 0.5);
            let to = DVec3::new(x, 1.0, z);
            let wi = to.normalize();
            let f = eval(&surface, turn(from.as_dvec3().normalize()), turn(wi)).y;
            want += f * wi.y * wi.y / to.length_squared() / f64::from(n * n);
        }
        scene.check(from, -from, &samples(40_000, 1), want);
    }
}

/// One texel of radiance L in an else black sky, over rows and columns that are away from the
/// horizon, gives L ∫∫ cosθ sinθ dθ dφ = L·Δφ·(sin²θ₁ − sin²θ₀)/2 lx.
#[test]
fn single_texel_of_sky_gives_its_lux() {
    let (width, height, row, column) = (16u32, 8u32, 2u32, 11u32);
    let mut texels = vec![[0.0; 3]; (width * height) as usize];
    texels[(row * width + column) as usize] = [500.0; 3];
    let sin2 = |row: u32| (PI * f64::from(row) / f64::from(height)).sin().powi(2);
    let lux = 500.0 * TAU / f64::from(width) * (sin2(row + 1) - sin2(row)) / 2.0;
    for rotation in [0.0, 1.0] {
        let mut scene = white_floor();
        scene.sky_map(width, texels.clone(), rotation);
        scene.check(EYE, Vec3::NEG_Y, &samples(20_000, 1), lux / PI);
    }
}

/// The texel's centre is seen where the formulas put it, and a turn of the sky about +Y by +90° moves
/// what was at +X to −Z.
#[test]
fn sky_is_seen_at_its_place_and_turns_with_its_rotation() {
    let (width, height) = (8u32, 4u32);
    let texels: Vec<_> = (0..width * height).map(|i| [i as f32 + 1.0; 3]).collect();
    for (along, rotation, texel) in [
        // φ slightly above 0: column 4; a little above the horizon: row 1.
        (Vec3::new(1.0, 0.1, 0.1), 0.0, 8 + 4),
        (Vec3::new(0.1, 0.1, 1.0), 0.0, 8 + 5),
        (Vec3::new(0.1, 0.1, -1.0), std::f32::consts::FRAC_PI_2, 8 + 4),
        (Vec3::new(0.1, -9.0, 0.05), 0.0, 24 + 4),
    ] {
        let mut scene = TestScene::new();
        scene.sky_map(width, texels.clone(), rotation);
        scene.check(Vec3::ZERO, along, &samples(1, None), f64::from(texel) + 1.0);
    }
}

/// A small Lambertian emitter and a small Lambertian receiver may change places.
#[test]
fn exchanging_emitter_and_receiver_leaves_the_transfer() {
    let shapes = [
        floor(Vec3::new(0.0, 0.0, 0.0), 0.05),
        turned_inside_out(TriMesh::quad(
            Vec3::new(0.8, 1.0, 0.3),
            Vec3::new(0.1, 0.0, 0.0),
            Vec3::new(0.0, 0.02, -0.1),
        )),
    ];
    let between = |emitting: usize| {
        let mut scene = TestScene::new();
        scene.mesh(shapes[emitting].clone(), &emitter(0.0, 1.0));
        scene.mesh(shapes[1 - emitting].clone(), &lambert(1.0));
        // A mirror and a diffuse wall take part.
        let wall = |x: f32| TriMesh::quad(Vec3::new(x, -2.0, 2.0), Vec3::new(0.0, 4.0, 0.0), Vec3::new(0.0, 0.0, -4.0));
        scene.mesh(wall(2.0), &lambert(0.5));
        scene.mesh(wall(-1.0), &Material { metallic: 1.0, roughness: 0.3, double_sided: true, ..Material::default() });
        let receiver = &shapes[1 - emitting];
        // The mean over the receiver, from a grid of points; a view from its front.
        let [a, b, d] = [0, 1, 3].map(|i| receiver.positions[i]);
        let n = (b - a).cross(d - a).normalize() * if emitting == 0 { -1.0 } else { 1.0 };
        let area = f64::from((b - a).cross(d - a).length());
        let (mut mean, mut variance) = (0.0, 0.0);
        for i in 0..16 {
            let uv = Vec2::new((i % 4) as f32 + 0.45, (i / 4) as f32 + 0.55) / 4.0;
            let p = a + uv.x * (b - a) + uv.y * (d - a);
            let (radiance, error) = scene.look(p + 1e-3 * n, -n, &samples(20_000, 3));
            mean += radiance.y / 16.0;
            variance += error * error / 256.0;
        }
        (mean * area, area * variance.sqrt())
    };
    let (there, back) = (between(0), between(1));
    let error = there.1.hypot(back.1);
    // The grid of points stands for the mean over a small square to about (size/distance)².
    assert!((there.0 - back.0).abs() < 4.0 * error + 3e-3 * there.0, "{there:?} {back:?}");
    assert!(error < 0.02 * there.0, "{error} of {}", there.0);
}
