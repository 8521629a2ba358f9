use glam::Vec3;

use super::*;
use crate::light::packed;

fn lamp(x: f32) -> Emitter {
    Emitter {
        lower: Vec3::X * x,
        upper: Vec3::X * x,
        middle: Vec3::X * x,
        spread2: 0.0,
        axis: Vec3::Y,
        cos_cone: -1.0,
        cos_edge: 0.0,
        two_sided: false,
        intensity: 10.0,
    }
}

/// Of every mixture of kinds the probabilities add up to 1, and drawn at even steps each row gets its share but for two.
#[test]
fn kinds_are_mixed_with_their_probability() {
    let suns = [([0.0, 1.0, 0.0], 50.0), ([0.6, 0.8, 0.0], 20.0), ([0.0, -1.0, 0.0], 1e5)];
    for mixture in 1..8 {
        let near: Vec<_> = (0..5).map(|i| lamp(i as f32)).filter(|_| mixture & 1 != 0).collect();
        let far = suns.into_iter().filter(|_| mixture & 2 != 0);
        let sky = if mixture & 4 != 0 { 100.0 } else { 0.0 };
        let choice = LightChoice::new(&near, far, sky);
        assert_eq!(choice.len(), near.len() + 3 * (mixture >> 1 & 1) + (mixture >> 2));
        let at = Receiver::new([0.3, -1.0, 0.2], packed([0.0, 1.0, 0.0], false));
        const N: u32 = 10_000;
        let mut drawn = vec![(0_u32, 0.0_f32); choice.len()];
        for i in 0..N {
            let one = choice
                .sample(&at, (f64::from(i) + 0.5) / f64::from(N))
                .unwrap_or_else(|| panic!("{mixture} {i} {at:?}"));
            let (times, pmf) = &mut drawn[one.row as usize];
            (*times, *pmf) = (*times + 1, one.pmf);
            assert!((0.0..1.0).contains(&one.rest));
        }
        let all: f32 = drawn.iter().map(|(_, pmf)| pmf).sum();
        assert!((all - 1.0).abs() < 1e-4, "{mixture}: {all}");
        for (row, (times, pmf)) in drawn.into_iter().enumerate() {
            assert!((times as f32 - pmf * N as f32).abs() < 2.0, "{mixture} {row}: {times} {pmf}");
            if row < near.len() {
                assert!((choice.near_pmf(row as u32, &at) / pmf - 1.0).abs() < 1e-5);
            }
        }
        if sky > 0.0 {
            assert!(choice.sky_pmf(&at) > 0.05);
        }
    }
    // The sun below is not looked for from above.
    let choice = LightChoice::new(&[], suns, 0.0);
    let at = Receiver::new([0.0; 3], packed([0.0, 1.0, 0.0], false));
    assert!((0..100).all(|i| choice.sample(&at, f64::from(i) / 100.0).unwrap().row < 2));
}

/// A single sun is found from every surface that faces it, wherever it stands: so paths must carry the side that they leave to.
#[test]
fn a_single_light_far_away_depends_on_the_side() {
    for to_light in [[0.0, 0.6, 0.8], [0.0, 0.6, -0.8], [1.0, 0.0, 0.0]] {
        let choice = LightChoice::new(&[], [(to_light, 9.0)], 0.0);
        assert!(choice.depends_on_place() && choice.alone().is_none());
        let at = |n: [f32; 3]| Receiver::new([0.0; 3], packed(n, false));
        assert_eq!(choice.sample(&at(to_light), 0.5).map(|one| (one.row, one.pmf)), Some((0, 1.0)));
        assert!(choice.sample(&at(to_light.map(|c| -c)), 0.5).is_none());
    }
}
