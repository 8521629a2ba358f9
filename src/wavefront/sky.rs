//! Adds the light of the environment for paths that met nothing.

use wide::f32x8;

use super::{queues::PathQueue, stats::Blocks, tally::Tally};
use crate::{
    flat::{EnvironmentLight, FlatScene},
    light::Receiver,
    sampling::mis,
    simd::{LANES, Real, Rgb, V3},
};

/// Radiance of the sky along rays that left with density `pdf` (0: no light sample competes) where `at` says of each lane, weighted
/// against light sampling.
#[inline(always)]
pub fn seen<F: Real>(
    scene: &FlatScene,
    sky: &EnvironmentLight,
    direction: V3<F>,
    pdf: F,
    at: impl Fn(usize) -> Receiver,
) -> Rgb<F> {
    match sky {
        EnvironmentLight::Constant(radiance) => V3::from_array(*radiance),
        EnvironmentLight::Map(map) => {
            let (radiance, density) = map.look_up(direction);
            let choice = &scene.lights.choice;
            if choice.is_empty() {
                return radiance;
            }
            let drawn = density * F::from_fn(|lane| choice.sky_pmf(&at(lane)));
            radiance * F::select(pdf.eq(F::zero()), F::one(), mis::power(pdf, drawn))
        }
    }
}

/// Adds what the paths in `rows` see of the sky; with `hidden`, camera rays see nothing of it.
pub fn sky(
    scene: &FlatScene,
    sky: &EnvironmentLight,
    rows: &[u32],
    hidden: bool,
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
        let light = seen(scene, sky, direction, column(&paths.pdf), at) * throughput;
        for (lane, &i) in index.iter().enumerate().take(rows.len()) {
            if !(hidden && paths.depth[i] == 0) {
                tally.add(paths.slot[i], paths.sample[i], light.lane(lane));
            }
        }
    }
    Blocks::of(rows.len())
}
