//! Whole pictures: camera, filters, variance, repeatability.

use glam::{DVec2, DVec3, Vec3};

use super::scene::*;
use crate::{
    flat::{CameraView, ViewProjection},
    reference::{ReferenceSettings, render, render::camera_ray},
    render::PixelFilter,
    world::{Material, TriMesh},
};

/// A Cornell box of side 2 with a square light in its ceiling and two blocks.
fn cornell() -> TestScene {
    let mut scene = TestScene::new();
    let quad = |origin: Vec3, u: Vec3, v: Vec3| TriMesh::quad(origin, u, v);
    let (x, y, z) = (2.0 * Vec3::X, 2.0 * Vec3::Y, 2.0 * Vec3::Z);
    let white = lambert(0.75);
    let colored = |color: Vec3| Material { base_color: color, ..lambert(1.0) };
    let low = Vec3::splat(-1.0);
    scene.mesh(quad(low, z, x), &white);
    scene.mesh(quad(low + y, x, z), &white);
    scene.mesh(quad(low, x, y), &white);
    scene.mesh(quad(low, y, z), &colored(Vec3::new(0.6, 0.06, 0.05)));
    scene.mesh(quad(low + x, z, y), &colored(Vec3::new(0.1, 0.45, 0.08)));
    scene.mesh(TriMesh::cuboid(Vec3::new(-0.6, -1.0, -0.6), Vec3::new(0.0, 0.2, 0.0)), &white);
    scene.mesh(TriMesh::sphere(Vec3::new(0.45, -0.6, 0.3), 0.4, 16), &Material::glass(1.5));
    let light = Material { double_sided: false, ..emitter(0.0, 20.0) };
    scene.mesh(quad(Vec3::new(-0.25, 0.999, -0.25), 0.25 * x, 0.25 * z), &light);
    scene.flat.camera = CameraView {
        origin: DVec3::new(0.0, 0.0, 3.8),
        projection: ViewProjection::Perspective { tan_half_yfov: 0.36 },
        ..CameraView::default()
    };
    scene
}

/// Bit for bit, from any number of threads; another seed gives other noise about the same mean.
#[test]
fn picture_is_repeatable_and_seeds_agree() {
    let scene = cornell();
    let settings = ReferenceSettings { width: 16, height: 16, spp: 32, ..ReferenceSettings::default() };
    let a = render(&scene.flat, &settings);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(pool.install(|| render(&scene.flat, &settings)), a);
    let b = render(&scene.flat, &ReferenceSettings { seed: 9, ..settings });
    assert_ne!(a.rgb, b.rgb);
    let mean = |p: &crate::reference::ReferencePicture| p.rgb.iter().sum::<DVec3>() / 256.0;
    let variance = |p: &crate::reference::ReferencePicture| p.variance.iter().sum::<DVec3>() / (256.0 * 256.0);
    let z = (mean(&a) - mean(&b)).abs() / (variance(&a) + variance(&b)).map(f64::sqrt);
    assert!(z.max_element() < 4.0, "z {z}");
    assert!(a.rgb.iter().all(|c| c.is_finite() && c.min_element() >= 0.0));
}

/// The variance that a picture reports is that of its pixels over seeds.
#[test]
fn reported_variance_is_that_over_seeds() {
    let mut scene = TestScene::new();
    scene.mesh(
        floor(Vec3::ZERO, 1.0),
        &Material { alpha_mode: crate::world::AlphaMode::Blend, base_alpha: 0.3, ..emitter(0.0, 1.0) },
    );
    scene.flat.camera =
        CameraView { origin: DVec3::Y, forward: DVec3::NEG_Y, up: DVec3::NEG_Z, ..CameraView::default() };
    let settings = ReferenceSettings { width: 64, height: 64, spp: 50, ..ReferenceSettings::default() };
    let picture = render(&scene.flat, &settings);
    // p(1 − p)/n, estimated by 4096 pixels of 50 samples.
    let want = 0.3 * 0.7 / 50.0;
    let reported = picture.variance.iter().map(|v| v.y).sum::<f64>() / 4096.0;
    let spread = picture.rgb.iter().map(|c| (c.y - 0.3).powi(2)).sum::<f64>() / 4096.0;
    assert!((reported / want - 1.0).abs() < 0.02, "{reported} {want}");
    // The relative error of a variance from N values is √(2/N): four times that.
    assert!((spread / want - 1.0).abs() < 0.09, "{spread} {want}");
}

#[test]
fn camera_rays_go_where_the_view_says() {
    let camera = CameraView { origin: DVec3::new(1.0, 2.0, 3.0), ..CameraView::default() };
    let (origin, direction) = camera_ray(&camera, DVec2::new(20.0, 10.0), 40, 20);
    assert_eq!((origin, direction), (camera.origin, DVec3::NEG_Z));
    let (_, corner) = camera_ray(&camera, DVec2::ZERO, 40, 20);
    assert!((corner - DVec3::new(-1.0, 0.5, -1.0).normalize()).length() < 1e-15);
    let flat = CameraView { projection: ViewProjection::Orthographic { half_height: 3.0 }, ..camera };
    let (origin, direction) = camera_ray(&flat, DVec2::new(40.0, 20.0), 40, 20);
    assert_eq!((origin, direction), (DVec3::new(7.0, -1.0, 3.0), DVec3::NEG_Z));
}

/// A step edge between black and white through a pixel's centre gives 1/2 in it, and next to it what the filter
/// leaves beyond one half: nothing of a box, 0.157 = (Φ(3) − Φ(1))/(Φ(3) − Φ(−3)) of a Gaussian with σ = 0.5.
#[test]
fn filters_spread_an_edge_as_they_should() {
    // Integral of the Blackman–Harris window from x to 1.5, over the whole.
    let blackman = |x: f64| {
        let a = std::f64::consts::PI / 1.5;
        let part = |k: f64, c: f64| -c * (k * a * x).sin() / (k * a);
        (0.35875 * (1.5 - x) + part(1.0, 0.48829) + part(2.0, 0.14128) + part(3.0, 0.01168)) / (3.0 * 0.35875)
    };
    for (filter, beside) in
        [(PixelFilter::Box, 0.0), (PixelFilter::Gaussian, 0.15771), (PixelFilter::BlackmanHarris, blackman(0.5))]
    {
        let mut scene = TestScene::new();
        // White for x > 0.
        scene.mesh(floor(Vec3::new(50.0, 0.0, 0.0), 50.0), &emitter(0.0, 1.0));
        scene.flat.camera = CameraView {
            origin: DVec3::Y,
            forward: DVec3::NEG_Y,
            up: DVec3::NEG_Z,
            projection: ViewProjection::Orthographic { half_height: 0.5 },
            ..CameraView::default()
        };
        // One metre is one pixel. The edge is at the centre of pixel 2 of 5, half a pixel from the edge of pixel 1;
        // with 4 pixels it is on the border of pixels 1 and 2.
        let settings = ReferenceSettings { width: 5, height: 1, spp: 100_000, filter, ..ReferenceSettings::default() };
        let five = render(&scene.flat, &settings);
        let four = render(&scene.flat, &ReferenceSettings { width: 4, ..settings });
        // Four standard errors of 100,000 coin tosses.
        let check = |got: f64, want: f64| {
            assert!((got - want).abs() < 4.0 * 0.5 / 100_000f64.sqrt(), "{filter:?}: {got} {want}")
        };
        check(five.rgb[2].y, 0.5);
        check(four.rgb[1].y, beside);
        check(four.rgb[2].y, 1.0 - beside);
        check(four.rgb[0].y, 0.0);
    }
}

/// Depth along `forward` decides, and the sky is behind all; with `transparent` not even that.
#[test]
fn nothing_is_seen_before_znear_or_beyond_zfar() {
    let mut scene = TestScene::new();
    scene.mesh(floor(Vec3::ZERO, 5.0), &emitter(0.0, 3.0));
    scene.mesh(floor(Vec3::new(0.0, -1.0, 0.0), 5.0), &emitter(0.0, 5.0));
    scene.sky(7.0);
    let look = |znear: f32, zfar: f32, transparent: bool, scene: &mut TestScene| {
        scene.flat.camera = CameraView {
            origin: DVec3::Y,
            forward: DVec3::NEG_Y,
            up: DVec3::NEG_Z,
            znear,
            zfar,
            ..CameraView::default()
        };
        let settings =
            ReferenceSettings { width: 4, height: 4, spp: 8, max_depth: Some(0), transparent, ..Default::default() };
        let picture = render(&scene.flat, &settings);
        assert!(picture.rgb.iter().all(|c| *c == picture.rgb[0]), "an even depth is seen evenly");
        picture.rgb[0].y
    };
    assert_eq!(look(0.0, 9.0, false, &mut scene), 3.0);
    assert_eq!(look(1.01, 9.0, false, &mut scene), 5.0);
    assert_eq!(look(1.01, 1.99, false, &mut scene), 7.0);
    assert_eq!(look(1.01, 1.99, true, &mut scene), 0.0);
}
