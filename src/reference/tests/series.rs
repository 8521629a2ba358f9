//! Closed shells, whose light is a geometric series.

use std::f64::consts::PI;

use glam::Vec3;

use super::scene::*;
use crate::world::TriMesh;

/// Inside a closed Lambertian shell of albedo ρ that emits `L` everywhere, each ray sees
/// `L · (1 − ρⁿ⁺¹) / (1 − ρ)` after at most `n` scatterings.
#[test]
fn emitting_shell_shows_the_geometric_series() {
    let shell = |albedo: f32| {
        let mut scene = TestScene::new();
        scene.mesh(flat_shaded(TriMesh::sphere(Vec3::ZERO, 2.0, 5)), &emitter(albedo, 3.0));
        scene
    };
    for depth in [0, 1, 4] {
        for albedo in [0.0, 0.5, 0.9] {
            let rho: f64 = albedo;
            let want = 3.0 * (1.0 - rho.powi(depth as i32 + 1)) / (1.0 - rho);
            shell(albedo as f32).check(Vec3::new(0.3, 0.2, 0.1), Vec3::new(0.5, 0.6, 0.7), &samples(4000, depth), want);
        }
    }
    let want = 3.0 / (1.0 - f64::from(0.75f32));
    shell(0.75).check(Vec3::ZERO, Vec3::new(0.5, 0.6, 0.7), &samples(20_000, None), want);
}

/// A point light of intensity I at the centre of a sphere of radius r gives I/r² lx
/// everywhere, so ρI/(πr²) nit after one scattering and 1/(1 − ρ) times that in all.
///
/// The mesh is inscribed: with n rings a facet is nearer by up to (π/2n)² of the radius and tilted by up
/// to π/n at its corners, which at 64 rings stays below 0.3 %.
#[test]
fn light_at_the_centre_of_a_sphere_shows_its_illuminance() {
    let (rho, candela, radius) = (0.5, 8.0, 2.0);
    let mut scene = TestScene::new();
    scene.mesh(flat_shaded(TriMesh::sphere(Vec3::ZERO, radius, 64)), &lambert(rho));
    scene.point_light(Vec3::ZERO, candela);
    let (rho, candela, radius) = (f64::from(rho), f64::from(candela), f64::from(radius));
    let direct = rho * candela / (PI * radius * radius);
    for along in [Vec3::new(0.5, 0.6, 0.7), Vec3::new(-0.1, 0.9, -0.4), Vec3::new(0.9, 0.05, 0.2)] {
        let (mean, error) = scene.look(Vec3::ZERO, along, &samples(4, 1));
        assert!(error < 1e-12, "one light, one scattering: no noise, but {error}");
        assert!((mean.y / direct - 1.0).abs() < 2e-3, "got {mean}, want {direct}");
        let (mean, error) = scene.look(Vec3::ZERO, along, &samples(20_000, None));
        let total = direct / (1.0 - rho);
        assert!((mean.y - total).abs() < 4.0 * error + 3e-3 * total, "got {mean}, want {total}");
    }
}

/// In a cube of side 2h with a light at its centre, a wall's centre gets I/h² lx directly.
#[test]
fn cube_wall_sees_the_light_by_the_inverse_square() {
    let mut scene = TestScene::new();
    scene.mesh(turned_inside_out(TriMesh::cuboid(Vec3::splat(-1.5), Vec3::splat(1.5))), &lambert(0.8));
    scene.point_light(Vec3::ZERO, 5.0);
    let want = f64::from(0.8f32) / PI * 5.0 / 2.25;
    // Off the diagonals' crossing by too little to matter.
    scene.check(Vec3::new(1e-4, 0.0, 2e-4), Vec3::Y, &samples(4, 1), want);
}

/// What is lit evenly from everywhere and reflects all of it cannot be seen.
#[test]
fn white_lambert_vanishes_in_a_white_sky() {
    let mut scene = TestScene::new();
    scene.mesh(TriMesh::sphere(Vec3::ZERO, 1.0, 24), &lambert(1.0));
    scene.sky(2.0);
    let settings = samples(400, None);
    for x in [0.0, 0.4, 0.8] {
        // Convex and facetted with smooth normals: sampled directions below a facet are lost, so
        // flat shading is the exact case.
        let mut flat = TestScene::new();
        flat.mesh(flat_shaded(TriMesh::sphere(Vec3::ZERO, 1.0, 24)), &lambert(1.0));
        flat.sky(2.0);
        flat.check(Vec3::new(x, 0.1, 5.0), Vec3::NEG_Z, &settings, 2.0);
        let (mean, _) = scene.look(Vec3::new(x, 0.1, 5.0), Vec3::NEG_Z, &settings);
        assert!(mean.y > 1.95 && mean.y < 2.0 + 1e-9, "smooth normals lose little: {mean}");
    }
}
