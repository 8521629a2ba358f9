//! Adds the light of the environment for paths that met nothing.

use wide::f32x8;

use super::{caustic, queues::PathQueue, reuse::Glimpse, stats::Blocks, tally::Tally};
use crate::{
    flat::{EnvironmentLight, FlatScene},
    light::Receiver,
    sampling::mis,
    simd::{LANES, Real, Rgb, V3},
};

/// Light of the sky along rays.
#[derive(Clone, Copy, Debug)]
pub struct Seen<F: Real> {
    /// As it is, nit.
    pub radiance: Rgb<F>,
    /// Weighted against light sampling, nit.
    pub light: Rgb<F>,
    /// Density of the sky's samples there, before the choice of the sky, per sr.
    pub density: F,
}

/// What rays see that left with density `pdf` (0: no light sample competes) where `at` says of each lane.
#[inline(always)]
pub fn seen<F: Real>(
    scene: &FlatScene,
    sky: &EnvironmentLight,
    direction: V3<F>,
    pdf: F,
    at: impl Fn(usize) -> Receiver,
) -> Seen<F> {
    match sky {
        EnvironmentLight::Constant(radiance) => {
            let radiance = V3::from_array(*radiance);
            Seen { radiance, light: radiance, density: F::zero() }
        }
        EnvironmentLight::Map(map) => {
            let (radiance, density) = map.look_up(direction);
            let choice = &scene.lights.choice;
            if choice.is_empty() {
                return Seen { radiance, light: radiance, density: F::zero() };
            }
            let drawn = density * F::from_fn(|lane| choice.sky_pmf(&at(lane)));
            let light = radiance * F::select(pdf.eq(F::zero()), F::one(), mis::power(pdf, drawn));
            Seen { radiance, light, density }
        }
    }
}

/// Adds what the path in a lane saw: to its pixel, or to what it leaves for others.
#[inline]
pub fn add<F: Real>(
    tally: &mut Tally,
    shares: bool,
    (slot, sample): (u32, u32),
    direction: V3<F>,
    seen: &Seen<F>,
    throughput: Rgb<F>,
    lane: usize,
) {
    let light = (seen.light * throughput).lane(lane);
    if shares && tally.reuse.awaits_far(slot, sample) {
        let glimpse = Glimpse {
            direction: direction.lane(lane),
            radiance: seen.radiance.lane(lane),
            density: seen.density.lane(lane),
            alone: light,
        };
        tally.reuse.keep_sky(slot, sample, glimpse);
    } else {
        tally.add(slot, sample, light);
    }
}

/// Adds what the paths in `rows` see of the sky; with `hidden`, camera rays see nothing of it. If it `shares`, what paths see from
/// their near vertex is kept for others. What is brighter than `suns` may be left to light paths.
pub fn sky(
    scene: &FlatScene,
    sky: &EnvironmentLight,
    rows: &[u32],
    hidden: bool,
    shares: bool,
    suns: f32,
    paths: &PathQueue,
    tally: &mut Tally,
) -> Blocks {
    for rows in rows.chunks(LANES) {
        let index: [usize; LANES] = std::array::from_fn(|lane| rows[lane.min(rows.len() - 1)] as usize);
        let column = |column: &[f32]| <f32x8 as Real>::from_fn(|lane| column[index[lane]]);
        let direction = V3::new(column(&paths.dx), column(&paths.dy), column(&paths.dz));
        let throughput = V3::new(column(&paths.throughput_r), column(&paths.throughput_g), column(&paths.throughput_b));
        let at = |lane: usize| {
            let i = index[lane];
            Receiver::new([paths.ox[i], paths.oy[i], paths.oz[i]], paths.side[i])
        };
        let seen = seen(scene, sky, direction, column(&paths.pdf), at);
        for (lane, &i) in index.iter().enumerate().take(rows.len()) {
            let radiance = seen.radiance.lane(lane);
            let of_sun = caustic::is_of_sun(suns, paths.eta_scale[i], paths.pdf[i], paths.depth[i], radiance);
            if !of_sun && !(hidden && paths.depth[i] == 0) {
                let path = (paths.slot[i], paths.sample[i]);
                add(tally, shares && paths.depth[i] == 1, path, direction, &seen, throughput, lane);
            }
        }
    }
    Blocks::of(rows.len())
}
