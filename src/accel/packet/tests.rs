use std::{cell::Cell, sync::Arc};

use super::{
    super::{
        Blas, InstanceRef, SideBySide, Solid,
        tests::{Sieve, Wave, numbers, placed, sieved},
        two_level::NO_HIT,
    },
    *,
};
use crate::world::Shape;

thread_local! {
    /// Rays that this thread has sent through trees in packets.
    pub static TOGETHER: Cell<u64> = const { Cell::new(0) };
}

/// Rays from a point through tiles of 8×8 pixels, as a camera that looks at [0, 5]³ has them.
fn tiles(eye: [f32; 3], tiles: usize, t_max: f32) -> Vec<queue::Segment> {
    let forward = eye.map(|x| 2.4 - x);
    let aside = [forward[2], 0.1, -forward[0]];
    let up = [0.1 * forward[1], forward[0].abs() + forward[2].abs(), 0.2 * forward[2]];
    let ray = |i: usize| {
        let (tile, pixel) = (i / 64, i % 64);
        let x = ((tile % 8 * 8 + pixel % 8) as f32 + 0.5) / 64.0 - 0.5;
        let y = ((tile / 8 * 8 + pixel / 8) as f32 + 0.5) / 64.0 - 0.5;
        let direction = std::array::from_fn(|axis| forward[axis] + x * aside[axis] + y * up[axis]);
        (eye, direction, if i.is_multiple_of(3) { t_max } else { f32::INFINITY })
    };
    (0..64 * tiles).map(ray).collect()
}

/// From a square, all in the same direction, of which two components are zero.
fn orthographic(axis: usize, towards: f32) -> Vec<queue::Segment> {
    let ray = |i: usize| {
        let mut origin = [(i % 32) as f32 * 0.17, (i / 32) as f32 * 0.17, (i / 32) as f32 * 0.17];
        let mut direction = [0.0; 3];
        (origin[axis], direction[axis]) = (2.5 - 4.0 * towards, towards);
        origin.rotate_right(usize::from(axis == 0));
        direction.rotate_right(usize::from(axis == 0));
        (origin, direction, f32::INFINITY)
    };
    (0..1024).map(ray).collect()
}

fn triangles(count: usize) -> Vec<[[f32; 3]; 3]> {
    let mut u = numbers(11);
    let triangle = |_| {
        let base = [u() * 5.0, u() * 5.0, u() * 5.0];
        let size = 0.05 + u();
        [0, 1, 2].map(|_| base.map(|x| x + size * u()))
    };
    (0..count).map(triangle).collect()
}

/// Turned about the upright axis, by the angle whose cosine is 0.6.
fn turned(blas: &Arc<Blas>) -> InstanceRef {
    let world_from_local = [0.6, 0.0, 0.8, -1.0, 0.0, 1.0, 0.0, 0.5, -0.8, 0.0, 0.6, 3.0];
    let local_from_world = [0.6, 0.0, -0.8, 3.0, 0.0, 1.0, 0.0, -0.5, 0.8, 0.0, 0.6, -1.0];
    InstanceRef { world_from_local, local_from_world, ..placed(blas, 0.5, 0.0) }
}

fn scenes() -> Vec<Accel> {
    let few = [1.0, 2.0, 3.0].map(|x| [[x, 0.0, 0.0], [0.0, 5.0, x], [x, 1.0, 5.0]]);
    let few = Arc::new(Blas::build(&few));
    let many = sieved(&triangles(3000));
    let empty = Arc::new(Blas::build(&[]));
    let shapes = [Shape::Sphere { radius: 4.0 }, Shape::Plane, Shape::Cylinder { radius: 1.0, half_height: 5.0 }];
    let small = |i: usize| placed(if i.is_multiple_of(3) { &few } else { &many }, 0.3, i as f32 * 0.05);
    let scenes = [
        vec![placed(&many, 1.0, 0.0)],
        vec![placed(&few, 1.0, 0.0)],
        vec![turned(&many)],
        vec![placed(&many, 1.0, 0.0), placed(&empty, 1.0, 0.0), placed(&many, 1.0, 0.0), turned(&many)],
        vec![placed(&few, 1.0, 0.0), placed(&many, 0.5, 1.0), turned(&many), placed(&many, -1.0, 5.0)],
        (0..100).map(small).collect(),
        Vec::new(),
        shapes
            .map(|shape| turned(&Arc::new(Blas::of_shape(shape))))
            .into_iter()
            .chain([placed(&many, 1.0, 0.0)])
            .collect(),
    ];
    scenes.into_iter().map(Accel::build).collect()
}

/// A wave of which the rays from some row on are said to run side by side, and to be so many samples of their pixels.
struct From<'a>(&'a Wave, usize, usize);

impl Rays for From<'_> {
    fn count(&self) -> usize {
        self.0.count()
    }
    fn ray(&self, index: usize) -> queue::Segment {
        self.0.ray(index)
    }
    fn id(&self, index: usize) -> u32 {
        self.0.id(index)
    }
    fn coherent_from(&self) -> usize {
        self.1
    }
    fn samples(&self) -> usize {
        self.2
    }
}

/// The wave finds, bit for bit, what the queue finds. Returns how many rays hit something.
#[track_caller]
fn check<C: Coverage>(accel: &Accel, wave: &Wave, from: usize, coverage: &C) -> usize {
    let mut want = vec![None; wave.count()];
    accel.nearest_of(wave, coverage, |index, hit| want[index] = Some(*hit));
    let bits = |hit: &Option<Hit>| hit.map(|hit| (hit, [hit.t, hit.b1, hit.b2].map(f32::to_bits)));
    for samples in [1, 4, 8, 16] {
        let mut got = vec![None; wave.count()];
        accel.nearest_of(&From(wave, from, samples), coverage, |index, hit| {
            assert!(got[index].replace(*hit).is_none(), "twice");
        });
        for index in 0..wave.count() {
            assert_eq!(bits(&got[index]), bits(&want[index]), "ray {index}: {:?}", wave.ray(index));
        }
    }
    let mut dark = vec![None; wave.count()];
    accel.occluded_of(&From(wave, from, 1), coverage, |index, occluded| {
        assert!(dark[index].replace(occluded).is_none(), "twice");
    });
    for (index, hit) in want.iter().enumerate() {
        assert_eq!(dark[index], hit.map(|hit| hit != NO_HIT), "ray {index}: {:?}", wave.ray(index));
    }
    want.iter().flatten().filter(|hit| **hit != NO_HIT).count()
}

/// Of 1,000 rays, of which some do not fill a packet, each is in one; those of a pixel are in as few vectors as can be.
#[test]
fn every_ray_is_in_one_packet() {
    for (samples, pixels) in [(1, 8), (4, 2), (12, 2), (8, 1), (24, 1), (16, 1), (32, 1)] {
        let mut packets = vec![0; 1000];
        for members in Members::all::<FROM_CAMERA>(7..1000, samples) {
            for vector in 0..FROM_CAMERA {
                let rows = (0..LANES).map(|lane| members.row(vector * LANES + lane));
                let mut seen: Vec<usize> = rows.clone().map(|row| (row - 7) % 8).collect();
                seen.sort_unstable();
                seen.dedup();
                // The last few are what is left.
                assert!(seen.len() == pixels || rows.clone().max() >= Some(1000 - 128), "{samples}: {seen:?}");
                rows.filter(|&row| row < 1000).for_each(|row| packets[row] += 1);
            }
        }
        assert!(packets.iter().enumerate().all(|(row, &packets)| packets == usize::from(row >= 7)), "{samples}");
    }
}

fn packets(rays: &impl Rays) -> usize {
    let all = Members::all::<FROM_CAMERA>(0..rays.count(), 1);
    all.filter(|&members| Packet::<FROM_CAMERA>::empty().gather::<Solid>(rays, members)).count()
}

const EYES: [[f32; 3]; 4] = [[-6.0, 4.0, -9.0], [2.5, 2.0, 2.6], [11.0, 7.5, 1.0], [1.0, -9.0, 3.0]];

#[test]
fn packets_find_what_the_queue_finds() {
    for (scene, accel) in scenes().iter().enumerate() {
        let mut hits = 0;
        for eye in EYES {
            for t_max in [f32::INFINITY, 0.9] {
                let wave = Wave(tiles(eye, 64, t_max));
                assert!(packets(&wave) > 64, "{} of 128", packets(&wave));
                hits += check(accel, &wave, 0, &Solid);
            }
        }
        assert!(hits > 500 || scene == 6, "{hits} hits in scene {scene}: too few to mean anything");
        for (axis, towards) in [(0, 1.0), (1, -1.0), (2, 1.0), (2, -0.5)] {
            let wave = Wave(orthographic(axis, towards));
            assert_eq!(packets(&wave), 32);
            check(accel, &wave, 0, &Solid);
        }
    }
}

/// Rays of all directions called coherent, waves that are so in part, of lengths that fill no packet, away from
/// everything, with what is not a number among them, and where surfaces let some rays through.
#[test]
fn rays_that_do_not_run_side_by_side_find_their_hits_too() {
    let mut u = numbers(5);
    let mut point = |spread: f32| [u() * spread, u() * spread, u() * spread];
    let scattered: Vec<queue::Segment> = (0..999)
        .map(|i: usize| {
            let mut direction = point(2.0).map(|x| x - 1.0);
            if i.is_multiple_of(4) {
                direction[i % 3] = if i.is_multiple_of(8) { 0.0 } else { -0.0 };
            }
            (point(5.0), direction, f32::INFINITY)
        })
        .collect();
    // The same signs and axis, but nothing else in common: packets that are of no use.
    let spread = scattered
        .iter()
        .map(|&(origin, [x, y, z], t_max)| (origin, [x.abs() + 0.01, y.abs() + 0.01, 2.0 + z.abs()], t_max));
    let spread = Wave(spread.collect());
    assert_eq!(packets(&spread), 32);
    let mut mixed = Wave(scattered.clone());
    mixed.0.extend(tiles(EYES[0], 5, 0.8));
    mixed.0.truncate(999 + 5 * 64 - 7);
    let away = tiles(EYES[0], 4, 1.0).into_iter().map(|(o, d, t_max)| (o, d.map(|x: f32| -x), t_max));
    let away = Wave(away.collect());
    let mut strange = Wave(tiles(EYES[0], 8, 1.0));
    for (i, ray) in strange.0.iter_mut().enumerate().step_by(37) {
        match i % 5 {
            0 => ray.0[i % 3] = f32::NAN,
            1 => ray.1[i % 3] = f32::NAN,
            2 => ray.0[i % 3] = f32::INFINITY,
            3 => ray.1[i % 3] = 1e-42,
            _ => ray.2 = -1.0,
        }
    }
    let scattered = Wave(scattered);
    for accel in &scenes() {
        check(accel, &scattered, 0, &Solid);
        check(accel, &spread, 0, &Solid);
        for from in [0, 999, 1000, mixed.count() - 1, mixed.count()] {
            check(accel, &mixed, from, &Solid);
        }
        check(accel, &away, 0, &Solid);
        check(accel, &strange, 0, &Solid);
        check(accel, &mixed, 999, &Sieve);
        check(accel, &mixed, 0, &Sieve);
    }
}

/// Of triangles in the same place the smallest row is hit, and of instances the smallest.
#[test]
fn at_equal_distance_the_smaller_row_wins_in_packets_too() {
    let triangle = [[-50.0, -50.0, 0.0], [50.0, -50.0, 1.0], [0.0, 50.0, 2.0]];
    let blas = Arc::new(Blas::build(&[triangle; 21]));
    let accel = Accel::build(vec![placed(&blas, 1.0, 0.0); 3]);
    let wave = SideBySide(Wave(tiles([-1.0, -2.0, -9.0], 4, f32::INFINITY)));
    assert!(packets(&wave) > 4);
    accel.nearest_of(&wave, &Solid, |_, hit| assert_eq!((hit.instance, hit.triangle), (0, 0)));
}

/// What a ray's own test lets pass, that of its packet does.
#[test]
fn bounds_hold_for_every_ray() {
    let accel = Accel::build(vec![placed(&Arc::new(Blas::build(&triangles(3000))), 1.0, 0.0)]);
    let arena = accel.instances[0].blas.tree.arena.granules();
    let mut nodes = vec![accel.parts[0].root];
    let mut next = 0;
    while let Some(&node) = nodes.get(next) {
        nodes.extend(Node::at(arena, node).boxes().map(|(_, child)| child).filter(|child| child & KIND == 0));
        next += 1;
    }
    let mut tight = 0;
    for rays in EYES.map(|eye| Wave(tiles(eye, 64, 0.7))).into_iter().chain([Wave(orthographic(0, 1.0))]) {
        for members in Members::all::<FROM_CAMERA>(0..rays.count(), 1) {
            let mut packet = Packet::<FROM_CAMERA>::empty();
            if !packet.gather::<Solid>(&rays, members) {
                continue;
            }
            for node in nodes.iter().map(|&node| Node::at(arena, node)) {
                let (from, to) = packet.distances(node);
                tight += from.simd_gt(to).to_bitmask().count_ones();
                for (origin, direction, t_max) in (0..FROM_CAMERA * LANES).map(|lane| rays.ray(members.row(lane))) {
                    let (near, far) = node.distances(&Ray::new(origin, direction), t_max * (BEYOND / FAR_SCALE));
                    let inside = from.simd_le(near) & far.simd_le(to);
                    assert_eq!((near.simd_le(far) & !inside).to_bitmask() & 255, 0);
                }
            }
        }
    }
    assert!(tight > 100_000, "{tight} boxes missed: bounds that hold for anything");
}
