//! Adds the light of the environment for paths that met nothing.

use wide::f32x8;

use super::{caustic, queues::PathQueue, reuse::Glimpse, stats::Blocks, taken::Taken, tally::Tally};
use crate::{
    flat::{EnvironmentLight, FlatScene, Source},
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
    scene: &FlatScene,
    tally: &mut Tally,
    shares: bool,
    (slot, sample, depth): (u32, u32, u32),
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
        tally.add(slot, sample, light, |ledger| ledger.label(scene, depth, Source::Sky));
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
        let taken = Taken::new(rows);
        let block =
            if taken.is_near(paths.len()) { gather::<true>(&taken, paths) } else { gather::<false>(&taken, paths) };
        let SkyBlock { direction, throughput, pdf, slot, sample, depth } = block;
        let at = |lane: usize| {
            let i = taken.index[lane] as usize;
            Receiver::new([paths.ox[i], paths.oy[i], paths.oz[i]], paths.side[i])
        };
        let seen = seen(scene, sky, direction, pdf, at);
        for lane in 0..rows.len() {
            let (i, radiance) = (taken.index[lane] as usize, seen.radiance.lane(lane));
            let of_sun = caustic::is_of_sun(suns, paths.eta_scale[i], paths.pdf[i], paths.depth[i], radiance);
            let unseen = of_sun || (hidden && depth[lane] == 0);
            if !unseen {
                let path = (slot[lane], sample[lane], depth[lane]);
                add(scene, tally, shares && depth[lane] == 1, path, direction, &seen, throughput, lane);
            }
        }
    }
    Blocks::of(rows.len())
}

/// Paths that see the sky.
struct SkyBlock {
    direction: V3<f32x8>,
    throughput: Rgb<f32x8>,
    pdf: f32x8,
    slot: [u32; LANES],
    sample: [u32; LANES],
    depth: [u32; LANES],
}

#[inline(always)]
fn gather<const NEAR: bool>(taken: &Taken, paths: &PathQueue) -> SkyBlock {
    let number = |column: &[f32]| f32x8::new(taken.of::<NEAR, f32>(column));
    let bits = |column: &[u32]| taken.of::<NEAR, u32>(column);
    SkyBlock {
        direction: V3::new(number(&paths.dx), number(&paths.dy), number(&paths.dz)),
        throughput: V3::new(number(&paths.throughput_r), number(&paths.throughput_g), number(&paths.throughput_b)),
        pdf: number(&paths.pdf),
        slot: bits(&paths.slot),
        sample: bits(&paths.sample),
        depth: bits(&paths.depth),
    }
}
