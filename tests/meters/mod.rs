//! Light meters against closed forms, and intervals against what they promise.

mod brdf;
mod far_field;
mod glare;

use std::f64::consts::PI;

use glam::{DAffine3, DQuat, DVec3, Vec3};
use rayon::prelude::*;
use wavecast::{
    measure::{
        flux::flux,
        meter::{Effort, Meters, Reading, read},
        statistics::{binomial_cdf, sidak},
        student::student_two_sided,
    },
    render::Renderer,
    world::{
        Camera, DirectionalLight, Environment, LocalTransform, Material, PointLight, Scene, SceneKey, Shape, SpotLight,
        TriMesh,
        units::{Candela, Lumens, Lux},
    },
};

use crate::common::{load_scene, look, root, show, show_shape, trials::scaled};

/// How far a reading may be from the truth at most, as a share of it.
const TOLERANCE: f64 = 1e-3;
/// What rounding in f32 along a path may cost, as a share of the truth: where there is no noise to hide it.
const ROUNDING: f64 = 2e-6;
/// A right meter fails the whole family with this probability.
const FALSE_ALARM: f64 = 0.01;

fn tables(scene: &mut Scene) -> Renderer {
    let mut renderer = Renderer::new();
    let report = renderer.sync(scene);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    renderer
}

fn effort(spp: u32) -> Effort {
    Effort { error: None, samples: Some(u64::from(spp) * 1024), seed: 20_261_201, ..Effort::default() }
}

/// One plane's illuminance, lx.
fn lux(renderer: &Renderer, p: DVec3, n: DVec3) -> Reading {
    read(renderer.scene(), &Meters::Planes(vec![(p, n)]), &effort(scaled(256)), &()).each[0]
}

fn lamp(luminance: f32) -> Material {
    Material { emissive: Vec3::splat(luminance), double_sided: true, ..Material::lambert(Vec3::ZERO) }
}

/// At (0, 0, 0), facing up; all lights above.
fn with<T>(build: impl Fn(&mut Scene) -> T) -> Renderer {
    let mut scene = Scene::new();
    build(&mut scene);
    tables(&mut scene)
}

fn pointing(scene: &mut Scene, light: impl hecs::Component, at: DVec3, towards: DVec3) -> SceneKey {
    scene.spawn((light, LocalTransform::looking_at(at, towards, DVec3::X)))
}

/// Illuminance from a rectangle that faces the meter's plane, under one of its corners (Siegel, Howell, "Thermal Radiation Heat
/// Transfer", configuration C-11 times πL).
fn under_corner(luminance: f64, a: f64, b: f64, h: f64) -> f64 {
    let half = |a: f64, b: f64| a / a.hypot(h) * (b / a.hypot(h)).atan();
    0.5 * luminance * (half(a, b) + half(b, a))
}

#[test]
fn meters_agree_with_closed_forms() {
    let up = DVec3::Y;
    let tilted = |degrees: f64| DQuat::from_rotation_z(degrees.to_radians()) * DVec3::Y;
    let far = DVec3::new(1e5, -2e4, 3e4);
    let mut trials: Vec<(String, f64, Reading)> = Vec::new();
    let mut trial = |name: &str, truth: f64, got: Reading| trials.push((name.to_owned(), truth, got));

    // A lamp of 815 lm in all directions (`docs/light.md`).
    let led = |scene: &mut Scene, at: DVec3| {
        let light = PointLight { color: Vec3::ONE, intensity: Lumens(815.0).over_sphere() };
        scene.spawn((light, LocalTransform::from_translation(at)))
    };
    let candela = 815.0 / (4.0 * PI);
    let one = with(|scene| led(scene, up));
    trial("815 lm at 1 m", candela, lux(&one, DVec3::ZERO, up));
    trial("815 lm at 2 m", candela / 4.0, lux(&one, -up, up));
    trial("815 lm at 1 m, turned away by 60°", candela / 2.0, lux(&one, DVec3::ZERO, tilted(60.0)));
    trial("815 lm far from the origin", candela, lux(&with(|scene| led(scene, far + up)), far, up));

    let spot = SpotLight { color: Vec3::ONE, intensity: Candela(120.0), inner: 0.3, outer: 0.6 };
    let beam = with(|scene| pointing(scene, spot, up * 2.0, DVec3::ZERO));
    trial("spot, in its beam", 30.0, lux(&beam, DVec3::ZERO, up));
    let at = DVec3::new(2.0 * 0.45_f64.tan(), 0.0, 0.0);
    let ramp = (0.45_f64.cos() - 0.6_f64.cos()) / (0.3_f64.cos() - 0.6_f64.cos());
    let fading = 120.0 * ramp * ramp * 0.45_f64.cos().powi(3) / 4.0;
    trial("spot, at its rim", fading, lux(&beam, at, up));

    let sun = DirectionalLight { color: Vec3::ONE, illuminance: Lux(1000.0) };
    let day = with(|scene| pointing(scene, sun, up, DVec3::ZERO));
    trial("directional", 1000.0, lux(&day, DVec3::ZERO, up));
    for from in
        [DVec3::new(1.0, 2.0, 3.0), DVec3::new(-3.0, 1.0, -2.0), DVec3::new(0.1, 0.2, -4.0), DVec3::new(5.0, 1e-2, 1.0)]
    {
        let day = with(|scene| pointing(scene, sun, from, DVec3::ZERO));
        trial(&format!("directional, from {from}"), 1000.0 * from.normalize().y, lux(&day, DVec3::ZERO, up));
    }
    trial("directional, turned away by 75°", 1000.0 * 75_f64.to_radians().cos(), lux(&day, DVec3::ZERO, tilted(75.0)));

    for (r, h) in [(0.5, 1.0), (2.0, 0.1), (0.01, 3.0)] {
        let turned = DAffine3::from_scale_rotation_translation(DVec3::ONE, DQuat::IDENTITY, up * h);
        let disc = with(|scene| show_shape(scene, Shape::Disc { radius: r as f32 }, lamp(5.0), turned));
        let truth = 5.0 * PI * r * r / (r * r + h * h);
        trial(&format!("disc of {r} m at {h} m"), truth, lux(&disc, DVec3::ZERO, up));
    }
    for (a, b, h) in [(1.0, 1.0, 1.0), (3.0, 0.2, 0.5), (4.0, 4.0, 0.05), (0.1, 0.1, 5.0)] {
        let rectangle = with(|scene| {
            let quad = TriMesh::quad(Vec3::new(0.0, h as f32, 0.0), Vec3::X * a as f32, Vec3::Z * b as f32);
            show(scene, quad, lamp(2.0));
        });
        let truth = under_corner(2.0, a, b, h);
        trial(&format!("rectangle of {a} × {b} m at {h} m"), truth, lux(&rectangle, DVec3::ZERO, up));
    }
    for (r, d, tilt) in [(0.5, 2.0, 0.0_f64), (0.5, 2.0, 60.0), (0.02, 1.0, 30.0)] {
        let ball = with(|scene| {
            let at = DAffine3::from_translation(up * d);
            show_shape(scene, Shape::Sphere { radius: r as f32 }, lamp(7.0), at);
        });
        let truth = 7.0 * PI * (r / d).powi(2) * tilt.to_radians().cos();
        trial(&format!("sphere of {r} m at {d} m, turned {tilt}°"), truth, lux(&ball, DVec3::ZERO, tilted(tilt)));
    }

    let sky = with(|scene| scene.spawn((Environment::constant(Vec3::splat(3.0)),)));
    trial("uniform sky", 3.0 * PI, lux(&sky, DVec3::ZERO, tilted(17.0)));
    // Half of it is a wall that reaches as far as rays do: the plane through the meter's normal.
    let half = with(|scene| {
        scene.spawn((Environment::constant(Vec3::splat(3.0)),));
        let wall = TriMesh::quad(Vec3::new(-1e-3, -1e4, -1e4), Vec3::Y * 2e4, Vec3::Z * 2e4);
        show(scene, wall, Material { double_sided: true, ..Material::lambert(Vec3::ZERO) });
    });
    trial("half of a uniform sky", 1.5 * PI, lux(&half, DVec3::ZERO, up));
    // In a closed shell that emits and reflects, radiance is L/(1 − ρ) everywhere.
    let furnace = with(|scene| {
        let shell = Material { emissive: Vec3::splat(0.5), double_sided: true, ..Material::lambert(Vec3::splat(0.8)) };
        show(scene, TriMesh::cuboid(Vec3::splat(-1.0), Vec3::ONE), shell);
    });
    trial("furnace", 2.5 * PI, lux(&furnace, DVec3::new(0.3, -0.2, 0.5), tilted(200.0)));

    // Light that comes back from a floor: a wide one, so that what is beyond counts for little, of which the meter faces
    // nothing else: E' = ρE at its side.
    let floor = with(|scene| {
        pointing(scene, sun, up * 1e3, DVec3::ZERO);
        let quad = TriMesh::quad(Vec3::new(-1e3, 0.0, 1e3), Vec3::X * 2e3, Vec3::NEG_Z * 2e3);
        show(scene, quad, Material::lambert(Vec3::splat(0.6)));
    });
    trial("back from a floor", 600.0, lux(&floor, up * 0.05, -up));

    let level = sidak(FALSE_ALARM, trials.len());
    let mut failed = Vec::new();
    for (name, truth, got) in &trials {
        let off = got.value.value / truth - 1.0;
        let noise = got.value.variance.sqrt() / truth;
        let p = student_two_sided(off / noise.hypot(ROUNDING), got.value.dof);
        println!(
            "{name:50} {truth:12.6} {:12.6} {:9.5} % ± {:.5} %  p {p:.3}",
            got.value.value,
            100.0 * off,
            100.0 * noise
        );
        if off.abs() > TOLERANCE || p < level {
            failed.push(name);
        }
    }
    println!("{} trials, level of each {level:.1e}", trials.len());
    assert!(failed.is_empty(), "{failed:?}");
}

/// The same figure from everything that can tell it: flux from the light, illuminance from what an ideal meter around it reads, and
/// a surface's luminance from three sides.
#[test]
fn flux_illuminance_and_luminance_of_one_lamp_agree() {
    let mut scene = Scene::new();
    let light = PointLight { color: Vec3::ONE, intensity: Lumens(815.0).over_sphere() };
    let point = scene.spawn((light, LocalTransform::from_translation(DVec3::Y)));
    let spot = SpotLight { color: Vec3::new(0.2, 0.4, 0.6), intensity: Candela(9.0), inner: 0.2, outer: 0.9 };
    let spot = pointing(&mut scene, spot, DVec3::Y * 50.0, DVec3::Y * 60.0);
    let (panel, _) = show(
        &mut scene,
        TriMesh::quad(Vec3::new(0.0, 20.0, 0.0), Vec3::X * 2.0, Vec3::Z * 3.0),
        Material { double_sided: false, ..lamp(4.0) },
    );
    let renderer = tables(&mut scene);
    let of = |key: SceneKey| flux(renderer.scene(), key.0).expect("it is a light").value.value;
    assert!((of(point) / 815.0 - 1.0).abs() < 1e-6);
    assert!((of(panel) / (PI * 4.0 * 6.0) - 1.0).abs() < 1e-6);
    // The spot's by quadrature over its falloff.
    let (inner, outer) = (0.2_f64, 0.9_f64);
    let steps = 200_000;
    let sum: f64 = (0..steps)
        .map(|i| {
            let angle = (f64::from(i) + 0.5) / f64::from(steps) * outer;
            let ramp = ((angle.cos() - outer.cos()) / (inner.cos() - outer.cos())).clamp(0.0, 1.0);
            2.0 * PI * angle.sin() * ramp * ramp * outer / f64::from(steps)
        })
        .sum();
    let luminance = 0.2126 * 0.2 + 0.7152 * 0.4 + 0.0722 * 0.6;
    assert!((of(spot) / (9.0 * luminance * sum) - 1.0).abs() < 1e-5, "{}", of(spot));
    assert_eq!(flux(renderer.scene(), 999), None);
}

/// L = ρE/π, whatever side a matt surface is seen from.
#[test]
fn a_matt_surface_is_as_bright_from_every_side() {
    const ALBEDO: f64 = 0.6;
    for eye in [DVec3::new(0.0, 3.0, 0.01), DVec3::new(2.0, 1.0, 0.5), DVec3::new(-3.0, 0.4, 2.0)] {
        let mut scene = Scene::new();
        let quad = TriMesh::quad(Vec3::new(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0);
        show(&mut scene, quad, Material::lambert(Vec3::splat(ALBEDO as f32)));
        let ceiling = TriMesh::quad(Vec3::new(0.2, 4.0, -0.3), Vec3::X, Vec3::Z);
        show(&mut scene, ceiling, lamp(30.0));
        look(&mut scene, eye, DVec3::ZERO, 1e-2);
        let renderer = tables(&mut scene);
        let lux = lux(&renderer, DVec3::ZERO, DVec3::Y).value;
        let nit = read(renderer.scene(), &Meters::Pixels([9, 9], vec![[4, 4]]), &effort(64), &()).mean.value;
        let off = nit.value / (ALBEDO * lux.value / PI) - 1.0;
        println!("from {eye}: {} lx, {} nit, off by {:.4} %", lux.value, nit.value, 100.0 * off);
        assert!(off.abs() < TOLERANCE, "{eye}: {off}");
    }
}

/// E = ∫ L cos dω: a meter against the luminance seen from its place in all directions of the hemisphere.
#[test]
fn illuminance_is_the_cosine_integral_of_what_is_seen() {
    let mut scene = load_scene(&root().join("scenes/cornell.gltf"));
    let place = DVec3::new(0.05, 0.0, 0.1);
    for key in scene.keys_with::<Camera>() {
        scene.despawn(key);
    }
    let camera = look(&mut scene, place, place + DVec3::Y, 90.0);
    let want = lux(&tables(&mut scene), place, DVec3::Y).value;
    // Five faces of a cube around the place, each pixel by its solid angle; the half of the four at the sides that is below does not
    // count.
    const SIZE: u32 = 64;
    let pixel = |i: u32| (f64::from(i) + 0.5) / f64::from(SIZE) * 2.0 - 1.0;
    let mut sum = 0.0;
    for (forward, up) in [
        (DVec3::Y, DVec3::NEG_Z),
        (DVec3::X, DVec3::Y),
        (DVec3::NEG_X, DVec3::Y),
        (DVec3::Z, DVec3::Y),
        (DVec3::NEG_Z, DVec3::Y),
    ] {
        scene.insert(camera, LocalTransform::looking_at(place, place + forward, up));
        let renderer = tables(&mut scene);
        let pixels: Vec<[u32; 2]> = (0..SIZE * SIZE).map(|i| [i % SIZE, i / SIZE]).collect();
        let samples = Effort { samples: Some(8 * 16), ..effort(1) };
        let seen = read(renderer.scene(), &Meters::Pixels([SIZE; 2], pixels.clone()), &samples, &());
        for ([x, y], reading) in pixels.iter().zip(&seen.each) {
            let (s, t) = (pixel(*x), -pixel(*y));
            let to = forward + forward.cross(up) * s + up * t;
            let distance2 = to.length_squared();
            let cos = to.y / distance2.sqrt();
            let solid_angle = (2.0 / f64::from(SIZE)).powi(2) / (distance2 * distance2.sqrt());
            sum += reading.value.value * cos.max(0.0) * solid_angle;
        }
    }
    let off = sum / want.value - 1.0;
    println!("meter {}, integral {sum}: {:.4} %", want.value, 100.0 * off);
    // Pixels see from their whole square, but count by the middle.
    assert!(off.abs() < 0.004, "{off}");
}

/// Of all light on a ball in parallel light, half of its surface gets E cos θ: a quarter of E on average.
#[test]
fn meters_on_a_surface_read_what_falls_on_it() {
    let mut scene = Scene::new();
    let sun = DirectionalLight { color: Vec3::ONE, illuminance: Lux(800.0) };
    pointing(&mut scene, sun, DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO);
    let turned = DAffine3::from_scale_rotation_translation(
        DVec3::new(-2.0, 2.0, 2.0),
        DQuat::from_rotation_x(0.7),
        DVec3::new(5.0, 1.0, 2.0),
    );
    let (ball, _) = show(&mut scene, TriMesh::sphere(Vec3::ZERO, 1.0, 40), Material::lambert(Vec3::splat(0.5)));
    scene.insert(ball, LocalTransform::Matrix(turned));
    let renderer = tables(&mut scene);
    let mesh = &renderer.scene().meshes[0];
    let places: Vec<(u32, [f32; 2])> = (0..mesh.triangles.len() as u32).map(|t| (t, [1.0 / 3.0; 2])).collect();
    let samples = Effort { samples: Some(8), ..effort(1) };
    let read = read(renderer.scene(), &Meters::On(0, places.clone()), &samples, &());
    let (mut lumens, mut area) = (0.0, 0.0);
    for ((triangle, _), reading) in places.iter().zip(&read.each) {
        let [a, b, c] = mesh.corners(*triangle).map(|p| turned.transform_point3(Vec3::from(p).as_dvec3()));
        let n = (b - a).cross(c - a) * -0.5;
        lumens += reading.value.value * n.length();
        area += n.length();
        // Its own normal's cosine, to the last triangle.
        let cos = n.normalize().dot(DVec3::new(1.0, 2.0, 3.0).normalize());
        assert!((reading.value.value - 800.0 * cos.max(0.0)).abs() < 0.5, "{triangle}: {} {cos}", reading.value.value);
    }
    let off = lumens / area / 200.0 - 1.0;
    assert!(off.abs() < 2e-3, "{off}");
}

/// Of readings of one meter in a room, 95 % have the truth in their interval: of so many samples, and ended by an error.
#[test]
fn intervals_hold_the_truth_as_often_as_they_say() {
    let mut scene = load_scene(&root().join("scenes/cornell.gltf"));
    let renderer = tables(&mut scene);
    // In the shadow of a box, where half of the light comes by way of the walls.
    let meters = Meters::Planes(vec![(DVec3::new(-0.35, 0.001, 0.35), DVec3::Y)]);
    let long = Effort { error: None, samples: Some(1 << 24), seed: 1, ..Effort::default() };
    let truth = read(renderer.scene(), &meters, &long, &()).mean.value;
    let trials = u64::from(scaled(300));
    for (name, effort) in [
        ("of 8192 samples", Effort { error: None, samples: Some(8192), ..Effort::default() }),
        ("to 0.7 %", Effort { error: Some(0.007), ..Effort::default() }),
    ] {
        let readings: Vec<_> = (0..trials)
            .into_par_iter()
            .map(|seed| read(renderer.scene(), &meters, &Effort { seed: 100 + seed, threads: 1, ..effort }, &()))
            .collect();
        let holds = |reading: &&wavecast::measure::meter::Readings| {
            let [from, to] = reading.mean.value.minus(truth).interval(0.95);
            (from..=to).contains(&0.0)
        };
        let held = readings.iter().filter(holds).count() as u64;
        let samples = readings.iter().map(|reading| reading.samples).sum::<u64>() / trials;
        println!("{name}: {held} of {trials} hold {} ± {}, {samples} samples", truth.value, truth.variance.sqrt());
        assert!(binomial_cdf(held, trials, 0.93) > 1e-3 && binomial_cdf(trials - held, trials, 0.03) > 1e-3, "{held}");
        if effort.error.is_some() {
            assert!(
                readings.iter().all(|reading| reading.reached && reading.samples > 16 * 1024),
                "the first look is not all"
            );
        }
    }
}
