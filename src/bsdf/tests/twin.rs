//! Eight lanes against one.

use super::*;
use crate::bsdf::{Lambert, Opaque, Transmissive};

#[track_caller]
fn check_near(what: &str, got: [f64; 3], want: [f64; 3], s: &Surface) {
    for k in 0..3 {
        let tolerance = 1e-5 * want[k].abs() + 1e-7;
        assert!((got[k] - want[k]).abs() <= tolerance, "{what} of {s:?}: {got:?}, scalar {want:?}");
    }
}

fn check_twin<B: Bsdf>(seed: u64) {
    let mut rng = Rng(seed);
    for _ in 0..50_000 {
        let surfaces = [(); 8].map(|()| rng.surface());
        let wo: [_; 8] = [(); 8].map(|()| rng.direction_up());
        let wi: [_; 8] = [(); 8].map(|()| rng.direction());
        let load = |v: &[[f64; 3]; 8]| V3::<f32x8>::from_fn(|i| v[i].map(|v| v as f32));
        let eight = B::prepare(&gather(&surfaces), load(&wo));
        let (f, pdf) = B::eval(&eight, load(&wi));
        let (u_lobe, u) = (rng.block(), (rng.block(), rng.block()));
        let sampled = B::sample(&eight, u_lobe, u);
        for (i, drawn) in lanes(&sampled).enumerate() {
            let s = &surfaces[i];
            let (want, want_pdf) = eval_one::<B>(s, wo[i], wi[i]);
            check_near("f", f.lane(i).map(f64::from), want, s);
            check_near("pdf", [f64::from(Real::lane(pdf, i)), 0.0, 0.0], [want_pdf, 0.0, 0.0], s);

            let one = B::prepare::<f32>(&s.params(), vec(wo[i]));
            let twin = B::sample(&one, Real::lane(u_lobe, i), (Real::lane(u.0, i), Real::lane(u.1, i)));
            let twin = lanes(&twin).next().expect("one lane");
            let flags = |d: &Draw| (d.valid, d.delta, d.transmitted);
            assert_eq!(flags(&drawn), flags(&twin), "{s:?}");
            check_near("wi", drawn.wi, twin.wi, s);
            check_near("weight", drawn.weight, twin.weight, s);
            check_near("rest", [drawn.pdf, drawn.eta_scale, 0.0], [twin.pdf, twin.eta_scale, 0.0], s);
        }
    }
}

/// Lanes do not see each other, and each is what the scalar kernel gives: 400,000 random surfaces a version.
#[test]
fn each_lane_is_the_scalar_kernel() {
    check_twin::<Lambert>(10);
    check_twin::<Opaque>(11);
    check_twin::<Transmissive>(12);
}

/// All that a block of lanes gives, as bits, one row a lane.
fn bits<B: Bsdf>(surfaces: &[Surface; 8], numbers: &[[f64; 9]; 8]) -> [Vec<u32>; 8] {
    let column = |k: usize| -> f32x8 { Real::from_fn(|i| numbers[i][k] as f32) };
    let vector = |k: usize| V3::new(column(k), column(k + 1), column(k + 2));
    let prepared = B::prepare(&gather(surfaces), vector(0));
    let (f, pdf) = B::eval(&prepared, vector(3));
    let s = B::sample(&prepared, column(6), (column(7), column(8)));
    std::array::from_fn(|i| {
        let numbers = [f.lane(i), s.wi.lane(i), s.weight.lane(i)].concat();
        let more = [pdf, s.pdf, s.eta_scale].map(|v| Real::lane(v, i));
        let flags = [s.delta, s.transmitted, s.valid, B::scatters(&prepared)].map(|m| m.bits() >> i & 1);
        numbers.into_iter().chain(more).map(f32::to_bits).chain(flags).collect()
    })
}

fn check_alone<B: Bsdf>(seed: u64) {
    let mut rng = Rng(seed);
    for _ in 0..20_000 {
        let mut surfaces = [(); 8].map(|()| rng.surface());
        let mut numbers = [(); 8].map(|()| {
            let ([a, b, c], [d, e, f]) = (rng.direction_up(), rng.direction());
            [a, b, c, d, e, f, rng.unit(), rng.unit(), rng.unit()]
        });
        let together = bits::<B>(&surfaces, &numbers);
        let (kept, moved) = ((rng.next() % 8) as usize, (rng.next() % 8) as usize);
        let (surface, number) = (surfaces[kept], numbers[kept]);
        // In other company, which takes other branches, in another place.
        let company = rng.surface();
        surfaces.fill(company);
        surfaces[moved] = surface;
        numbers[moved] = number;
        assert_eq!(bits::<B>(&surfaces, &numbers)[moved], together[kept], "{surface:?}");
    }
}

/// A lane's bits do not depend on its place or its neighbours, so a picture does not depend on how paths are queued.
#[test]
fn company_does_not_change_a_lane() {
    check_alone::<Lambert>(13);
    check_alone::<Opaque>(14);
    check_alone::<Transmissive>(15);
}
