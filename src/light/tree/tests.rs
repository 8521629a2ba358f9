use glam::Vec3;

use super::*;
use crate::light::{numbers, packed};

/// Lights of all kinds: flat ones, two-sided ones, points and spots, of very different intensity.
fn lights(count: usize, seed: u32) -> Vec<Emitter> {
    let mut random = numbers(seed);
    (0..count)
        .map(|i| {
            let mut vector = |size: f64| Vec3::from_array(std::array::from_fn(|_| (size * (random() - 0.5)) as f32));
            let (p, axis) = (vector(10.0), vector(2.0).normalize_or(Vec3::Y));
            let size = [vector(0.2).abs(), Vec3::ZERO][usize::from(i % 4 > 1)];
            let (cos_cone, cos_edge) = [(1.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.8, 1.0)][i % 4];
            let intensity = (random() as f32 * 6.0).exp();
            // A plate across its axis.
            let across = axis.any_orthonormal_pair();
            let reach = across.0.abs() * size.x + across.1.abs() * size.y;
            let spread2 = (size.x * size.x + size.y * size.y) / 3.0;
            let (lower, upper) = (p - reach, p + reach);
            let two_sided = i % 8 == 1;
            Emitter { lower, upper, middle: p, spread2, axis, cos_cone, cos_edge, two_sided, intensity }
        })
        .collect()
}

fn receivers(count: usize) -> Vec<Receiver> {
    let mut random = numbers(99);
    (0..count)
        .map(|i| {
            let mut vector = |size: f64| Vec3::from_array(std::array::from_fn(|_| (size * (random() - 0.5)) as f32));
            let side = packed(vector(2.0).normalize_or(Vec3::Y).to_array(), i % 3 == 0);
            Receiver::new(vector(12.0).to_array(), side)
        })
        .collect()
}

/// At each point the probabilities add up to 1, but for that of coming to a subtree where nothing shines on it; they are those with which lights are drawn, and what is left of the number is
/// uniform: drawn at the middles of 4096 equal steps, each light gets its share of them but for two.
#[test]
fn lights_are_drawn_with_their_probability() {
    for count in [1, 2, 7, 8, 9, 100, 3000] {
        let tree = LightTree::new(&lights(count, 5));
        let mut nothing = 0;
        for at in receivers(40) {
            let pmf: Vec<f32> = (0..count as u32).map(|row| tree.pmf(row, &at)).collect();
            let all: f64 = pmf.iter().map(|&p| f64::from(p)).sum();
            const N: u32 = 4096;
            let (mut drawn, mut nobody) = (vec![0_u32; count], 0);
            for i in 0..N {
                let Some(one) = tree.sample(&at, (f64::from(i) + 0.5) / f64::from(N)) else {
                    nobody += 1;
                    continue;
                };
                drawn[one.row as usize] += 1;
                assert!((one.pmf / pmf[one.row as usize] - 1.0).abs() < 1e-5 && (0.0..1.0).contains(&one.rest));
            }
            nothing += nobody;
            assert!((all + f64::from(nobody) / f64::from(N) - 1.0).abs() < 1e-2, "{count}: {all}");
            for (row, &times) in drawn.iter().enumerate() {
                let expected = f64::from(pmf[row]) * f64::from(N);
                assert!((f64::from(times) - expected).abs() < 2.0, "{count} {row}: {times} {expected}");
            }
        }
        // That is rare.
        assert!(count < 3 || f64::from(nothing) < 0.3 * 40.0 * 4096.0, "{count}: {nothing}");
    }
}

/// Bit for bit, whichever lanes are asked for.
#[test]
fn lanes_draw_what_each_place_draws_alone() {
    let mut random = numbers(17);
    for count in [1, 2, 9, 300, 5000] {
        let tree = LightTree::new(&lights(count, 6));
        for (block, places) in receivers(800).as_chunks::<LANES>().0.iter().enumerate() {
            let mut at = Receivers::default();
            for (lane, place) in places.iter().enumerate() {
                (0..3).for_each(|axis| (at.p[axis][lane], at.n[axis][lane]) = (place.p[axis], place.n[axis]));
                at.halved |= u32::from(place.halved) << lane;
            }
            let u = std::array::from_fn(|_| random());
            let lanes = [0xff, 0b0110_1001][block % 2];
            let chosen = tree.sample_each(&at, u, lanes);
            for (lane, place) in places.iter().enumerate() {
                let alone = tree.sample(place, u[lane]).filter(|_| lanes >> lane & 1 == 1);
                assert_eq!(chosen.lane(lane), alone, "{count} {block} {lane}");
            }
        }
    }
}

/// Whatever a light brings to a point, it may be drawn there.
#[test]
fn no_light_that_arrives_is_left_out() {
    let mut random = numbers(3);
    let (mut reached, mut tried) = (0, 0);
    for count in [2, 30, 1000] {
        let all = lights(count, 8);
        let tree = LightTree::new(&all);
        for at in receivers(60) {
            for (row, light) in all.iter().enumerate().take(200) {
                // A point of the largest plate in its box.
                let across = light.axis.any_orthonormal_pair();
                let half = 0.5 * (light.upper - light.lower);
                let most = |v: Vec3| (half / v.abs().max(Vec3::splat(1e-9))).min_element().min(1.0) * 0.5 * v;
                let mut side = || random() as f32 * 2.0 - 1.0;
                let to = light.middle + most(across.0) * side() + most(across.1) * side() - Vec3::from(at.p);
                let (to, n) = (to.normalize(), Vec3::from(at.n));
                let cos = if light.two_sided { to.dot(light.axis).abs() } else { -to.dot(light.axis) };
                let edge = light.cos_cone * light.cos_edge.max(1e-3);
                let arrives = light.cos_cone < 0.0 || cos > edge.max(1e-3);
                let facing = to.dot(n) > 1e-3;
                tried += 1;
                if arrives && facing {
                    reached += 1;
                    assert!(tree.pmf(row as u32, &at) > 0.0, "{count} {row} {light:?} {at:?}");
                }
            }
        }
    }
    assert!(reached > tried / 10, "{reached} of {tried}");
}

/// Lights all in one place, in a line, and of no intensity.
#[test]
fn odd_sets_of_lights_make_trees() {
    let point = |x: f32, intensity: f32| Emitter {
        lower: Vec3::X * x,
        upper: Vec3::X * x,
        middle: Vec3::X * x,
        spread2: 0.0,
        axis: Vec3::Y,
        cos_cone: -1.0,
        cos_edge: 0.0,
        two_sided: false,
        intensity,
    };
    let at = Receiver::new([0.5, 3.0, 0.0], packed([0.0, -1.0, 0.0], false));
    let one_place: Vec<_> = (0..5000).map(|_| point(1.0, 1.0)).collect();
    let line: Vec<_> = (0..5000).map(|i| point((i as f32).exp2().min(1e15), 1.0)).collect();
    let growing: Vec<_> = (0..500).map(|i| point(i as f32, (i as f32 * 0.1).exp2())).collect();
    for all in [one_place, line, growing] {
        let tree = LightTree::new(&all);
        let sum: f64 = (0..all.len() as u32).map(|row| f64::from(tree.pmf(row, &at))).sum();
        assert!((sum - 1.0).abs() < 1e-3, "{sum}");
    }
    let dark = [point(0.0, 0.0), point(1.0, 2.0), point(2.0, 0.0)];
    let tree = LightTree::new(&dark);
    assert_eq!([0, 1, 2].map(|row| tree.pmf(row, &at)), [0.0, 1.0, 0.0]);
    assert_eq!(tree.sample(&at, 0.3).map(|one| one.row), Some(1));
    assert!(LightTree::new(&dark[..1]).is_empty() && LightTree::new(&[]).is_empty());
    assert!(LightTree::new(&[]).sample(&at, 0.3).is_none());
}

/// The same whatever the number of threads.
#[test]
fn trees_do_not_depend_on_threads() {
    let all = lights(20_000, 12);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| LightTree::new(&all))
    };
    assert!(on(1) == on(3));
}
