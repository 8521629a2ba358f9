//! Rays that leave a shape must not meet it again where they start; camera rays go together.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::{
    Job, Parts, Worker, schedule,
    surface::{self, Incoming},
};
use crate::{
    accel::{NO_HIT, Solid, Stacks, TOGETHER},
    film::Tile,
    reference::Rng,
    render::{RenderSettings, Renderer, Sharing},
    simd::V3,
    world::{AlphaMode, LocalTransform, Material, Scene, Shape, generated},
};

fn vector(v: DVec3) -> V3<f32> {
    V3::from_array(v.as_vec3().to_array())
}

fn double(v: V3<f32>) -> DVec3 {
    DVec3::from_array(v.lane(0).map(f64::from))
}

/// Follows rays on from where rays have met a shape from outside, to both sides: outside they never meet it again, inside
/// only on its other side, half the true chord away at least, and of what is closed always.
#[track_caller]
fn check_leaving(shape: Shape, place: DAffine3, rays: u32, rng: &mut Rng) -> [u32; 2] {
    let mut scene = Scene::new();
    scene.spawn((shape, LocalTransform::Matrix(place)));
    let mut renderer = Renderer::new();
    let report = renderer.sync(&mut scene);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let flat = renderer.scene();
    let m = flat.instances.world_from_local[0].map(f64::from);
    let column = |i: usize| DVec3::new(m[i], m[i + 4], m[i + 8]);
    let world_from_local =
        DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) };
    let local_from_world = world_from_local.inverse();
    let size = match shape {
        Shape::Sphere { radius } | Shape::Disc { radius } | Shape::Cylinder { radius, .. } => f64::from(radius),
        Shape::Plane => 1.0,
    };
    let mut between = || 2.0 * rng.uniform() - 1.0;
    let mut stacks = Stacks::default();
    let mut nearest = |origin: V3<f32>, direction: V3<f32>| {
        flat.accel.nearest(origin.lane(0), direction.lane(0), f32::INFINITY, 0, &Solid, &mut stacks)
    };
    let mut left = [0; 2];
    for _ in 0..rays {
        let mut point = |scale: f64| scale * DVec3::new(between(), between(), between());
        let origin = world_from_local.transform_point3(point(5.0 * size));
        let target = world_from_local.transform_point3(point(0.8 * size));
        let direction = (target - origin).normalize();
        let hit = nearest(vector(origin), vector(direction));
        if hit == NO_HIT {
            continue;
        }
        let incoming = Incoming::<f32> {
            direction: vector(direction),
            b1: hit.b1,
            b2: hit.b2,
            back: hit.back,
            instance: [0; 8],
            triangle: [hit.triangle; 8],
            material: [0; 8],
        };
        let surface = surface::interact::<f32, false>(flat, &incoming, Parts::Color, true, &mut 0);
        let local = shape.point(hit.triangle, hit.b1, hit.b2);
        let normal = shape.normal(local);
        let away = (double(surface.p) - world_from_local.transform_point3(local)).abs();
        assert!(away.cmple(double(surface.error)).all(), "{shape:?} {place:?}: {away} {:?}", surface.error);
        let facing = (local_from_world.matrix3.transpose() * normal).normalize();
        let side = if hit.back { -1.0 } else { 1.0 };
        assert!((double(surface.ng) - side * facing).length() < 1e-6, "{:?} {facing}", surface.ng);
        // As often as not along the surface.
        let mut wi = point(1.0).normalize();
        wi -= wi.dot(facing) * facing * [0.0, 0.9, 0.999, 0.99999][(between() * 2.0 + 2.0) as usize & 3];
        let wi = vector(wi.normalize());
        let height = double(wi).dot(side * facing);
        if height.abs() < 1e-6 {
            continue;
        }
        let origin = surface.leave(height > 0.0);
        let again = nearest(origin, wi);
        let d = local_from_world.matrix3 * double(wi);
        let flat_d = if matches!(shape, Shape::Cylinder { .. }) { d.with_y(0.0) } else { d };
        // From p on the surface the other crossing is where |p + t d| = |p|.
        let chord = -2.0 * local.dot(flat_d) / flat_d.length_squared();
        let round = matches!(shape, Shape::Sphere { .. } | Shape::Cylinder { .. });
        if !round || normal.dot(d) > 0.0 {
            left[0] += 1;
            assert!(again == NO_HIT, "{shape:?} {place:?}: left at {height}, met again after {}", again.t);
        } else {
            left[1] += 1;
            let closed = matches!(shape, Shape::Sphere { .. });
            assert!(again != NO_HIT || !closed, "{shape:?} {place:?}: lost inside at {height}");
            assert!(f64::from(again.t) >= 0.5 * chord, "{shape:?} {place:?}: {} of {chord}", again.t);
        }
    }
    left
}

/// A million rays: radii and distances from the origin from 1 mm to 100 km, as they are and turned, stretched and mirrored.
/// Not where the radius is so small that positions there cannot tell its points apart.
#[test]
fn rays_that_leave_a_shape_do_not_meet_it_where_they_start() {
    let mut rng = Rng::new(5, 0);
    let mut left = [0; 2];
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 0.4, -0.3).normalize(), 0.8);
    let sizes = [1e-3_f32, 0.1, 10.0, 1e3, 1e5];
    for radius in sizes {
        for far in sizes.map(f64::from).into_iter().filter(|far| *far <= 1.1e4 * f64::from(radius)) {
            for shape in [
                Shape::Sphere { radius },
                Shape::Cylinder { radius, half_height: 0.7 * radius },
                Shape::Disc { radius },
                Shape::Plane,
            ] {
                for scale in [DVec3::ONE, DVec3::new(0.3, -1.5, 0.8)] {
                    let turn = if scale == DVec3::ONE { DQuat::IDENTITY } else { turn };
                    let at = far * DVec3::new(0.6, -1.0, 0.3);
                    let place = DAffine3::from_scale_rotation_translation(scale, turn, at);
                    let some = check_leaving(shape, place, 10_000, &mut rng);
                    left = [left[0] + some[0], left[1] + some[1]];
                }
                let some = check_leaving(shape, DAffine3::IDENTITY, 2_000, &mut rng);
                left = [left[0] + some[0], left[1] + some[1]];
            }
        }
    }
    assert!(left[0] > 500_000 && left[1] > 150_000, "{left:?}");
}

/// Camera rays of a render, and rays that went in packets.
fn rays_in_packets(scene: &mut Scene, max_depth: Option<u32>) -> [u64; 2] {
    let mut renderer = Renderer::new();
    renderer.sync(scene);
    let together = AtomicU64::new(0);
    let counted = |worker: &mut Worker, job: &Job, tile: &mut Tile, from, to, step| {
        TOGETHER.set(0);
        worker.run(job, tile, from, to, step);
        together.fetch_add(TOGETHER.get(), Ordering::Relaxed);
    };
    // Rays between neighbours go in packets too.
    let sharing = Sharing::Off;
    let settings =
        RenderSettings { width: 192, height: 128, spp: Some(4), max_depth, sharing, ..RenderSettings::default() };
    let stats = schedule::render_by(renderer.scene(), &settings, &(), counted).stats;
    assert_eq!(stats.rays.camera, 192 * 128 * 4);
    assert_eq!(stats.rays.bounce > stats.rays.camera, max_depth.is_none());
    [stats.rays.camera, together.into_inner()]
}

/// Where all surfaces are solid, and where some let rays pass; with bounces before them in a wave, and without. Those go
/// alone whose neighbours differ in the sign or the longest axis of a direction.
#[test]
fn camera_rays_go_in_packets() {
    let mut veiled = generated::hall(3000);
    for key in veiled.keys_with::<Material>() {
        let material: Material = veiled.get(key).unwrap();
        veiled.insert(key, Material { alpha_mode: AlphaMode::Blend, base_alpha: 0.7, ..material });
    }
    for scene in [&mut generated::hall(3000), &mut veiled] {
        for max_depth in [Some(0), None] {
            let [camera, together] = rays_in_packets(scene, max_depth);
            assert!(together <= camera && together > camera * 3 / 4, "{together} of {camera}, {max_depth:?}");
        }
    }
}
