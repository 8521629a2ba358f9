//! Glare ratings against the formula, worked out by hand for scenes in which all of it is known.

use std::f64::consts::PI;

use glam::{DAffine3, DVec3, Vec3};
use wavecast::{
    measure::{
        glare::{glare, position_index},
        meter::Effort,
    },
    world::{Environment, Material, PointLight, Shape, TriMesh, units::Candela},
};

use super::{lamp, with};
use crate::common::{show, show_shape};

fn effort() -> Effort {
    Effort { error: None, samples: Some(1 << 18), seed: 20_261_204, ..Effort::default() }
}

/// The table of CIE 117 for lamps straight above the line of sight, by height over distance: the formula is a fit of it.
#[test]
fn position_indices_are_those_of_the_standard() {
    let table =
        [(0.0, 1.00), (0.1, 1.26), (0.2, 1.53), (0.3, 1.90), (0.4, 2.35), (0.5, 2.86), (0.6, 3.50), (0.7, 4.20)];
    let rest = [(0.8, 5.00), (0.9, 6.00), (1.0, 7.00), (1.1, 8.10), (1.2, 9.25)];
    for (height, want) in table.into_iter().chain(rest) {
        let to = DVec3::new(0.0, height, -1.0).normalize();
        let got = position_index(to, DVec3::NEG_Z, DVec3::Y);
        assert!((got / want - 1.0).abs() < 0.035, "{height}: {got} {want}");
    }
    // Alike on both sides, greater below than beside, never without a bound.
    let at = |x: f64, y: f64| position_index(DVec3::new(x, y, -1.0).normalize(), DVec3::NEG_Z, DVec3::Y);
    assert_eq!(at(0.7, 0.2), at(-0.7, 0.2));
    assert!(at(0.0, -0.5) > 1.3 && at(0.0, 60.0) <= 16.0);
}

/// A ball of 1,000 nit above the line of sight in an even sky: all of the formula is known.
#[test]
fn a_ball_in_an_even_sky_dazzles_as_by_hand() {
    let (luminance, sky, r) = (1000.0, 20.0, 0.25_f64);
    let eye = DVec3::new(3.0, 1.2, -7.0);
    let ball = DVec3::new(0.0, 1.5, -3.0);
    let renderer = with(|scene| {
        show_shape(
            scene,
            Shape::Sphere { radius: r as f32 },
            lamp(luminance as f32),
            DAffine3::from_translation(eye + ball),
        );
        // One that is behind, and one that something hides.
        show_shape(scene, Shape::Sphere { radius: 0.5 }, lamp(9e3), DAffine3::from_translation(eye + DVec3::Z * 4.0));
        scene.spawn((Environment::constant(Vec3::splat(sky as f32)),));
    });
    let got = glare(renderer.scene(), eye, DVec3::NEG_Z, DVec3::Y, &effort(), &());
    let distance = ball.length();
    let sin2 = (r / distance).powi(2);
    let solid_angle = 2.0 * PI * (1.0 - (1.0 - sin2).sqrt());
    let cos = ball.normalize().dot(DVec3::NEG_Z);
    let background = sky * (1.0 - sin2 * cos);
    let p = position_index(ball.normalize(), DVec3::NEG_Z, DVec3::Y);
    let want = 8.0 * (0.25 / background * luminance * luminance * solid_angle / (p * p)).log10();
    println!("UGR {} {:?}, by hand {want}; {:?}", got.ugr, got.interval, got.sources);
    assert_eq!(got.sources.len(), 1, "{got:?}");
    let seen = &got.sources[0];
    assert!((seen.solid_angle / solid_angle - 1.0).abs() < 1e-3 && (seen.luminance / luminance - 1.0).abs() < 1e-6);
    assert!((seen.illuminance / (luminance * PI * sin2 * cos) - 1.0).abs() < 2e-3, "{seen:?}");
    assert!((got.background.value / background - 1.0).abs() < 5e-3, "{got:?} {background}");
    assert!((got.ugr - want).abs() < 0.02, "{got:?}, {want}");
    assert!(got.interval[0] <= got.ugr && got.ugr <= got.interval[1]);
}

/// Four panels of a quarter of the light each are rated as their sum; what a screen hides of one does not count, and lamps without
/// extent are told of.
#[test]
fn lamps_add_up_and_are_hidden() {
    let build = |screen: bool| {
        with(|scene| {
            for x in [-1.0_f32, 1.0] {
                let panel = TriMesh::quad(Vec3::new(x - 0.3, 2.8, -4.0), Vec3::X * 0.6, Vec3::Z * 0.6);
                show(scene, panel, lamp(500.0));
            }
            if screen {
                let black = Material { specular: 0.0, ..Material::lambert(Vec3::ZERO) };
                show(scene, TriMesh::quad(Vec3::new(0.1, 1.0, -2.0), Vec3::X * 1.5, Vec3::Y * 2.0), black);
            }
            scene.spawn((Environment::constant(Vec3::splat(10.0)),));
            scene.spawn((PointLight { color: Vec3::ONE, intensity: Candela(0.01) },));
        })
    };
    let rate = |screen| glare(build(screen).scene(), DVec3::Y * 1.2, DVec3::NEG_Z, DVec3::Y, &effort(), &());
    let (both, one) = (rate(false), rate(true));
    assert_eq!((both.sources.len(), one.sources.len(), both.without_extent), (2, 1, 1));
    assert!((both.sources[0].solid_angle / both.sources[1].solid_angle - 1.0).abs() < 2e-3, "{both:?}");
    // Half of the sum: 8 log₁₀ 2 less, but for the background, that the screen darkens.
    let background = 8.0 * (both.background.value / one.background.value).log10();
    assert!((both.ugr - one.ugr - 8.0 * 2.0_f64.log10() + background).abs() < 0.02, "{both:?} {one:?}");
    let dark = with(|scene| scene.spawn((Environment::constant(Vec3::ONE),)));
    assert_eq!(glare(dark.scene(), DVec3::ZERO, DVec3::X, DVec3::Y, &effort(), &()).ugr, f64::NEG_INFINITY);
}
