//! Far fields against closed forms, and as lighting programs read them.

use std::f64::consts::PI;

use glam::{DAffine3, DVec3, Vec3};
use wavecast::{
    measure::{
        far_field::{FarField, FarFieldError, direction, far_field},
        flux::flux,
        meter::Effort,
    },
    render::Renderer,
    world::{
        LocalTransform, Material, Parent, PointLight, Scene, Shape, SpotLight, TriMesh,
        units::{Candela, Lumens},
    },
};

use super::{lamp, pointing, tables, with};
use crate::common::{show, show_shape};

fn seen(renderer: &Renderer, gammas: u32, cs: u32, samples: u64) -> FarField {
    let effort = Effort { error: None, samples: Some(samples), seed: 20_261_202, ..Effort::default() };
    far_field(renderer.scene(), gammas, cs, &effort, &()).expect("it has an end")
}

/// The reading of one direction must hold the truth within five times its standard error and rounding.
#[track_caller]
fn check(what: &str, field: &FarField, truth: impl Fn(DVec3) -> f64) {
    let gammas = field.gamma_degrees.len();
    let (mut squares, mut count) = (0.0, 0);
    for (row, reading) in field.intensity.iter().enumerate() {
        let (gamma, c) = (field.gamma_degrees[row % gammas], field.c_degrees[row / gammas]);
        let (want, got) = (truth(direction(gamma, c)), reading.value);
        let off = (got.value - want).abs();
        assert!(off <= 6.0 * got.variance.sqrt() + 2e-5 * want.abs() + 1e-6, "{what} γ {gamma} C {c}: {got:?}, {want}");
        if got.variance > 0.0 {
            squares += off * off / got.variance;
            count += 1;
        }
    }
    // Intervals are of the right size too.
    if count > 50 {
        let spread = (squares / f64::from(count)).sqrt();
        println!("{what}: {count} directions, errors of {spread:.3} standard errors");
        assert!((0.7..1.5).contains(&spread), "{what}: {spread}");
    }
}

#[track_caller]
fn check_flux(what: &str, field: &FarField, truth: f64) {
    let flux = field.flux();
    let [from, to] = flux.interval(0.999);
    println!("{what}: {} lm of {truth}, {from} to {to}", flux.value);
    assert!((from..=to).contains(&truth), "{what}: {flux:?}, {truth}");
    assert!(to - from < 0.02 * truth, "{what}: {flux:?} says something");
}

#[test]
fn far_fields_are_those_of_closed_forms() {
    let at = DVec3::new(3.0, -2.0, 0.5);
    let led = with(|scene| {
        let light = PointLight { color: Vec3::ONE, intensity: Lumens(815.0).over_sphere() };
        scene.spawn((light, LocalTransform::from_translation(at)));
    });
    let field = seen(&led, 12, 8, 8);
    check("815 lm", &field, |_| 815.0 / (4.0 * PI));
    assert!((field.flux().value / 815.0 - 1.0).abs() < 1e-6, "{:?}", field.flux());

    let (inner, outer) = (0.3_f64, 0.9_f64);
    let spot = SpotLight { color: Vec3::ONE, intensity: Candela(120.0), inner: inner as f32, outer: outer as f32 };
    let axis = DVec3::new(1.0, -2.0, 0.5).normalize();
    let beam = with(|scene| pointing(scene, spot, at, at + axis));
    let field = seen(&beam, 180, 360, 8);
    let falloff = |to: DVec3| {
        let ramp = (to.dot(axis) - outer.cos()) / (inner.cos() - outer.cos());
        120.0 * ramp.clamp(0.0, 1.0).powi(2)
    };
    check("spot", &field, falloff);
    check_flux("spot", &field, flux(beam.scene(), beam.scene().lights.local.key[0]).expect("it has one").value.value);

    // L A cos θ, on one side and on both.
    let (radius, luminance) = (0.4_f64, 5.0_f64);
    let disc = with(|scene| {
        show_shape(
            scene,
            Shape::Disc { radius: radius as f32 },
            lamp(luminance as f32),
            DAffine3::from_translation(at),
        );
    });
    let area = PI * radius * radius;
    let field = seen(&disc, 12, 8, 4096);
    check("disc", &field, |to| luminance * area * to.y.abs());
    check_flux("disc", &field, 2.0 * PI * luminance * area);
    let quad = with(|scene| {
        let lamp = Material { double_sided: false, ..lamp(luminance as f32) };
        show(scene, TriMesh::quad(Vec3::new(1.0, 0.0, 2.0), Vec3::X * 0.5, Vec3::Y * 2.0), lamp);
    });
    check("rectangle", &seen(&quad, 12, 8, 4096), |to| luminance * to.z.max(0.0));
    let ball = with(|scene| {
        show_shape(scene, Shape::Sphere { radius: 0.2 }, lamp(7.0), DAffine3::from_translation(at));
    });
    check("ball", &seen(&ball, 12, 8, 4096), |_| 7.0 * PI * 0.04);

    // Hidden by a black screen below it, which is as wide as 45° and 8 sides can be.
    let hung = with(|scene| {
        let light = PointLight { color: Vec3::ONE, intensity: Candela(10.0) };
        scene.spawn((light, LocalTransform::from_translation(DVec3::Y)));
        let screen = TriMesh::quad(Vec3::new(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0);
        show(scene, screen, Material { double_sided: true, specular: 0.0, ..Material::lambert(Vec3::ZERO) });
    });
    let is_open = |to: DVec3| to.y >= 0.0 || (to.x.abs().max(to.z.abs()) > -to.y);
    check("lamp above a screen", &seen(&hung, 31, 7, 64), |to| if is_open(to) { 10.0 } else { 0.0 });
    // A square of 2 m seen from 1 m is a face of a cube: a sixth of all directions.
    check_flux("lamp above a screen", &seen(&hung, 31, 7, 64), 40.0 * PI * 5.0 / 6.0);
}

/// What a box of white walls around a lamp lets out of its open side is all that the lamp sends off.
#[test]
fn white_walls_lose_nothing() {
    let white = || Material { double_sided: true, ..Material::lambert(Vec3::ONE) };
    let renderer = with(|scene| {
        for (corner, a, b) in [
            (Vec3::new(-1.0, 1.0, -1.0), Vec3::X, Vec3::Z),
            (Vec3::new(-1.0, -1.0, -1.0), Vec3::X, Vec3::Y),
            (Vec3::new(-1.0, -1.0, 1.0), Vec3::X, Vec3::Y),
            (Vec3::new(-1.0, -1.0, -1.0), Vec3::Y, Vec3::Z),
            (Vec3::new(1.0, -1.0, -1.0), Vec3::Y, Vec3::Z),
        ] {
            show(scene, TriMesh::quad(corner, a * 2.0, b * 2.0), white());
        }
        let light = PointLight { color: Vec3::ONE, intensity: Candela(10.0) };
        scene.spawn((light, LocalTransform::from_translation(DVec3::new(0.2, 0.3, -0.1))));
    });
    let field = seen(&renderer, 36, 24, 4096);
    check_flux("white walls", &field, 40.0 * PI);
    let (peak, [gamma, _]) = field.peak();
    assert!(gamma < 30.0 && peak.value.value > 20.0, "{peak:?} at {gamma}");
    for reading in field.gamma_degrees.iter().zip(&field.intensity).filter(|(gamma, _)| **gamma > 90.0) {
        assert!(reading.1.value.value < 1e-9, "nothing goes up: {reading:?}");
    }
}

/// Of a scene an entity is kept with all that hangs below it, where it is.
#[test]
fn luminaires_are_read_without_what_is_around_them() {
    let mut scene = Scene::new();
    let arm = scene.spawn((LocalTransform::from_translation(DVec3::Y * 2.0),));
    let (shade, _) = show(&mut scene, TriMesh::quad(Vec3::ZERO, Vec3::X, Vec3::Z), lamp(3.0));
    scene.insert(shade, Parent(arm));
    show(&mut scene, TriMesh::cuboid(-Vec3::ONE, Vec3::ONE), Material::lambert(Vec3::splat(0.5)));
    scene.spawn((PointLight { color: Vec3::ONE, intensity: Candela(10.0) },));
    scene.spawn((wavecast::world::Environment::constant(Vec3::ONE),));
    scene.keep_only(arm);
    let renderer = tables(&mut scene);
    let flat = renderer.scene();
    assert_eq!((flat.instances.len(), flat.lights.local.len()), (1, 0));
    assert!(flat.lights.environment.is_none());
    check("shade", &seen(&renderer, 6, 4, 4096), |to| 3.0 * to.y.abs());
    let field = seen(&renderer, 6, 4, 64);
    let text = field.to_ies("an\narm", &["one".into()]);
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "IESNA:LM-63-2002");
    assert!(lines.contains(&"[LUMINAIRE] anarm") && lines.contains(&"[OTHER] one"), "{text}");
    let tilt = lines.iter().position(|line| *line == "TILT=NONE").expect("it is there");
    let numbers: Vec<f64> =
        lines[tilt + 1..].iter().flat_map(|line| line.split(' ')).filter_map(|word| word.parse().ok()).collect();
    // Head, angles, and each of five half planes, the first once more at 360°.
    assert_eq!(numbers[..13], [1.0, -1.0, 1.0, 7.0, 5.0, 1.0, 2.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0]);
    assert_eq!(numbers[13..20], [0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0]);
    assert_eq!(numbers[20..25], [0.0, 90.0, 180.0, 270.0, 360.0]);
    assert_eq!(numbers.len(), 25 + 5 * 7);
    for (got, reading) in numbers[25..].iter().zip(&field.intensity) {
        assert!((got - reading.value.value).abs() <= 1e-5 * reading.value.value.abs() + 1e-9);
    }
    assert_eq!(numbers[25..32], numbers[53..60]);
}

#[test]
fn what_has_no_end_has_no_far_field() {
    let renderer = with(|scene| show_shape(scene, Shape::Plane, lamp(1.0), DAffine3::IDENTITY));
    let result = far_field(renderer.scene(), 4, 4, &Effort::default(), &());
    assert_eq!(result.err(), Some(FarFieldError::Endless));
}
