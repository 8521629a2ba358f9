//! Meshes in one structure and another: the same hits, wherever they stand.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::*;
use crate::{
    accel::{
        Accel, Coverage, Hit, InstanceRef, NO_HIT, Solid, family,
        tests::{Sieve, Wave, placed, sieved_as},
    },
    flat::NONE,
};

/// As [`placed`], but anyhow.
fn turned(blas: &Arc<Blas>, world_from_local: DAffine3) -> InstanceRef {
    let rows = |m: DAffine3| -> [f32; 12] {
        let [x, y, z, w] = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis, m.translation];
        std::array::from_fn(|i| [x, y, z, w][i % 4][i / 4] as f32)
    };
    let [world_from_local, local_from_world] = [world_from_local, world_from_local.inverse()].map(rows);
    InstanceRef { blas: Arc::clone(blas), world_from_local, local_from_world, identity: false }
}

/// Meshes in a structure: where they were made, moved, turned and stretched, mirrored, in the same place twice, and
/// one that is empty. Every other one is asked about its coverage.
fn scene(kind: AccelKind) -> Vec<InstanceRef> {
    let [soup, torus, twice, none] = [
        family::soup(400, 0.3, 21),
        family::torus(24, 16),
        [family::soup(30, 0.5, 22), family::soup(30, 0.5, 22)].concat(),
        Vec::new(),
    ]
    .map(|triangles| sieved_as(kind, &triangles));
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -3.0).normalize(), 0.7);
    let stretch = DMat3::from_quat(turn) * DMat3::from_diagonal(DVec3::new(1.5, 0.4, 0.9));
    let mirror = DMat3::from_quat(turn.inverse()) * DMat3::from_diagonal(DVec3::new(-1.0, 0.7, 1.1));
    let at = |linear: DMat3, x: f64, y: f64, z: f64| DAffine3 { matrix3: linear, translation: DVec3::new(x, y, z) };
    vec![
        placed(&torus, 1.0, 0.0),
        placed(&none, 1.0, 0.0),
        turned(&torus, at(stretch, 1.0, -0.5, 0.3)),
        turned(&soup, at(mirror, 0.5, 0.2, -1.0)),
        placed(&soup, -2.0, 0.5),
        placed(&twice, 1.0, 0.0),
        placed(&twice, 1.0, 0.0),
        turned(&twice, at(mirror, -1.0, 0.0, 0.0)),
        turned(&twice, at(mirror, -1.0, 0.0, 0.0)),
        placed(&torus, 1.0, 0.0),
    ]
}

/// Answers to all rays: what each meets, and whether it meets anything.
fn answers<C: Coverage>(accel: &Accel, wave: &Wave, coverage: &C) -> Vec<(Hit, bool)> {
    let mut answers = vec![(NO_HIT, false); wave.0.len()];
    accel.nearest_of(wave, coverage, |index, hit| answers[index].0 = *hit);
    accel.occluded_of(wave, coverage, |index, occluded| answers[index].1 = occluded);
    answers
}

#[test]
fn placed_meshes_are_hit_alike_in_every_structure() {
    // Rays through all of the scene, some of which end within it.
    let corners = [-3.0, 3.0].map(|x| [[x; 3], [x, x, -x], [x, -x, -x]]);
    let around = [family::torus(12, 8), corners.to_vec()].concat();
    let ends = [f32::INFINITY, 0.8, f32::INFINITY, 1.3];
    let rays = family::rays(&around, 6000, 23).into_iter().zip(ends.iter().cycle());
    let wave = Wave(rays.map(|(ray, end)| (ray.origin, ray.direction, *end)).collect());
    let accel = Accel::build(scene(AccelKind::default()));
    let (solid, sieved) = (answers(&accel, &wave, &Solid), answers(&accel, &wave, &Sieve));
    let hits = solid.iter().filter(|(hit, _)| hit.instance != NONE).count();
    let through = solid.iter().zip(&sieved).filter(|(a, b)| a != b).count();
    let instances = |row: u32| solid.iter().filter(|(hit, _)| hit.instance == row).count();
    assert!(hits > 2000 && through > 300 && (0..5).all(|row| row == 1 || instances(row) > 50), "{hits} {through}");
    assert_eq!(instances(6) + instances(8) + instances(9), 0, "of equal ones the first is hit");
    for kind in AccelKind::ALL {
        let other = Accel::build(scene(kind));
        assert_eq!(other.bounds(), accel.bounds());
        assert_eq!(other.others, kind != AccelKind::default(), "{}", kind.name());
        let got = [answers(&other, &wave, &Solid), answers(&other, &wave, &Sieve)];
        for (got, want) in got.iter().zip([&solid, &sieved]) {
            for (index, (got, want)) in got.iter().zip(want).enumerate() {
                assert_eq!(got, want, "{}: ray {index} {:?}", kind.name(), wave.0[index]);
            }
        }
    }
}

/// Structures may even be mixed.
#[test]
fn each_mesh_may_be_in_another_structure() {
    let triangles = family::soup(300, 0.3, 24);
    let scene = |kinds: &[AccelKind]| {
        let place = |(i, kind): (usize, &AccelKind)| placed(&sieved_as(*kind, &triangles), 1.0 + i as f32, 0.3);
        Accel::build(kinds.iter().enumerate().map(place).collect())
    };
    let rays = family::rays(&triangles, 2000, 25).into_iter();
    let wave = Wave(rays.map(|ray| (ray.origin, ray.direction, f32::INFINITY)).collect());
    let [mixed, plain] = [AccelKind::ALL, [AccelKind::default(); 7]].map(|kinds| scene(&kinds));
    assert!(answers(&mixed, &wave, &Sieve) == answers(&plain, &wave, &Sieve));
}
