//! Finds out what sharing pays: a few squares of pixels, rendered with everything shared.
//!
//! Sharing what paths find makes noise smaller and samples dearer. Of what a pixel gets from each kind of find, both the shared
//! and the unshared amount come out of the same paths, so that one pilot says for each set of kinds what the variance of a
//! sample would be, and from the two follows what groups of another size would do. Paths that share nothing are measured for
//! themselves: each pixel then has a sequence of its own, which is more even than its part of a group's. What has the least
//! product of variance and cost is taken. The pilot's samples have numbers of their own and are counted nowhere, so nothing depends on them but how long the
//! picture takes (chosen by the picture's own samples, the way that happens to look dark would be taken too often); and they are the
//! same whatever part of a picture is rendered, and however.

use std::array;

use rayon::prelude::*;

use super::{
    Job, Settings, Worker,
    reuse::{KINDS, Shares},
    stats::Counters,
};
use crate::{
    film::{BLOCK, Film},
    render::{RenderSettings, Sharing},
};

/// Squares that are looked at: enough to tell, few enough to cost some hundredths of a second.
const SQUARES: u32 = 32;
/// Of all squares one of so many, in small pictures.
const ONE_OF: u32 = 4;
/// Samples of each of two means: together they are as even as samples of pictures are, so that what falls faster than by their number
/// does so here too.
const MEAN_OF: u32 = 4;
/// Price of a shadow ray between neighbours in rays of a path, in small scenes: they run side by side, and nothing is shaded where
/// they end.
const PRICE: f64 = 0.35;
/// What is added to it each time that a scene has twice as many triangles as [`SMALL`]: neighbouring rays then go separate ways.
const PER_DOUBLING: f64 = 0.12;
/// Triangles of a small scene.
const SMALL: f64 = 20_000.0;
/// What a path costs beside its rays, in the same unit.
const BASE: f64 = 1.0;
/// Share of the picture's mean below which darkness counts no more.
const FLOOR: f64 = 0.1;

/// Sizes of groups. The pilot is rendered with those of sixteen.
const GROUPS: [usize; 4] = [8, 16, 32, 64];
/// Power of the size by which the price of all links of a path grows: the more, the better they run side by side.
const PRICE_GROWS: f64 = 0.8;
/// What sharing must come down to of what there is without, by an estimate that errs by a tenth or so.
const WORTHWHILE: f64 = 0.9;
/// Share of the pixels, the noisiest ones, that do not count.
const LEFT_OUT: f64 = 0.002;

/// Light of each kind of find, nit.
type Finds = [[f64; 3]; KINDS];

/// What was measured in a square.
struct Square {
    /// By pixel and mean: what the pixel got by all kinds shared, and for each kind what it would get more if it were not.
    totals: Vec<[[f64; 3]; 2]>,
    /// What it got by paths that share nothing.
    alone: Vec<[[f64; 3]; 2]>,
    excess: Vec<[Finds; 2]>,
    rays: f64,
    links: [f64; KINDS],
}

/// The kinds of finds that are worth sharing in a picture.
pub fn plan(job: &Job, settings: &RenderSettings) -> Shares {
    if !job.settings.shares.any() || settings.sharing == Sharing::Always {
        return job.settings.shares;
    }
    let job = &Job { sampler: job.sampler.other(), ..job.clone() };
    let [columns, rows] = [settings.width, settings.height].map(|edge| edge.div_ceil(BLOCK));
    let all = columns * rows;
    let count = SQUARES.min(all.div_ceil(ONE_OF));
    let squares: Vec<Square> = (0..count)
        .into_par_iter()
        .with_max_len(2)
        .map_init(Worker::default, |worker, i| {
            // Every so many of a walk through all squares that does not line up with rows.
            let at = (u64::from(i) * u64::from(all) / u64::from(count)) as u32;
            let (x, y) = (at % columns, at / columns);
            let shifted = (x + y * 7) % columns;
            measure(worker, job, settings, [shifted * BLOCK, y * BLOCK])
        })
        .collect();
    let triangles: usize =
        job.scene.instances.mesh.iter().map(|&mesh| job.scene.meshes[mesh as usize].triangles.len()).sum();
    let price = PRICE + PER_DOUBLING * (triangles as f64 / SMALL).log2().max(0.0);
    choose(&squares, job.settings.shares, price)
}

fn measure(worker: &mut Worker, job: &Job, settings: &RenderSettings, [x, y]: [u32; 2]) -> Square {
    let edge = |at: u32, end: u32| BLOCK.min(end - at);
    let crop = Some([x, y, edge(x, settings.width), edge(y, settings.height)]);
    let of_square = RenderSettings { crop, ..settings.clone() };
    let nothing = Shares::of(0, job.settings.shares.group);
    let apart = Job { settings: Settings { shares: nothing, ..job.settings.clone() }, ..job.clone() };
    let (alone, _) = means(worker, &apart, &of_square);
    worker.counters = Counters::default();
    let (totals, excess) = means(worker, job, &of_square);
    let each = f64::from(2 * MEAN_OF);
    let links = std::mem::take(&mut worker.joiner.links_by_kind).map(|links| links as f64 / each);
    let counters = std::mem::take(&mut worker.counters);
    let rays = counters.all_rays() as f64 / each - links.iter().sum::<f64>();
    Square { totals, alone, excess, rays, links }
}

/// Two means of [`MEAN_OF`] samples, by pixel, and what each kind of find adds to them if it is not shared.
fn means(worker: &mut Worker, job: &Job, settings: &RenderSettings) -> (Vec<[[f64; 3]; 2]>, Vec<[Finds; 2]>) {
    let mut film = Film::new(settings, job.unit);
    let tile = &mut film.tiles[0];
    let pixels = tile.pixels();
    let mut totals = vec![[[0.0; 3]; 2]; pixels];
    let mut excess = vec![[[[0.0; 3]; KINDS]; 2]; pixels];
    let mut before = vec![[0; 3]; pixels];
    let mean = |sum: f64| sum / f64::from(MEAN_OF);
    for half in 0..2 {
        worker.joiner.measured = Some(vec![[[0.0; 3]; KINDS]; pixels]);
        worker.run(job, tile, half * MEAN_OF, (half + 1) * MEAN_OF, 1);
        let more = worker.joiner.measured.take().unwrap_or_default();
        for pixel in 0..pixels {
            let now = tile.light(pixel);
            totals[pixel][half as usize] = array::from_fn(|i| mean(job.unit.value(now[i] - before[pixel][i])));
            excess[pixel][half as usize] = more[pixel].map(|kind| kind.map(mean));
            before[pixel] = now;
        }
    }
    (totals, excess)
}

fn choose(squares: &[Square], all: Shares, price: f64) -> Shares {
    let pixels: f64 = squares.iter().map(|square| square.totals.len() as f64).sum();
    let mean_of =
        |square: &Square| square.totals.iter().flatten().flatten().sum::<f64>() / (6 * square.totals.len()) as f64;
    let mean = squares.iter().map(|square| mean_of(square) * square.totals.len() as f64).sum::<f64>() / pixels;
    let rays = squares.iter().map(|square| square.rays).sum::<f64>() / pixels;
    // By pixel, of paths that share nothing; and by set and pixel.
    let mut alone = Vec::new();
    let mut noise: [Vec<f64>; 1 << KINDS] = Default::default();
    let mut links = [0.0; KINDS];
    for square in squares {
        let scale = mean_of(square).powi(2) + (FLOOR * mean).powi(2);
        if scale <= 0.0 {
            continue;
        }
        let variance = |of: [[f64; 3]; 2]| (0..3).map(|i| (of[0][i] - of[1][i]).powi(2) / 2.0).sum::<f64>() / scale;
        alone.extend(square.alone.iter().map(|&of| variance(of)));
        for (totals, excess) in square.totals.iter().zip(&square.excess) {
            for (set, noise) in noise.iter_mut().enumerate() {
                let unshared = |kind: &usize| set >> kind & 1 == 0;
                noise.push(variance(array::from_fn(|half| {
                    let more = |i: usize| (0..KINDS).filter(unshared).map(|kind| excess[half][kind][i]).sum::<f64>();
                    array::from_fn(|i| totals[half][i] + more(i))
                })));
            }
        }
        (0..KINDS).for_each(|kind| links[kind] += square.links[kind] / pixels);
    }
    let noise = noise.map(without_worst);
    let (mut best, mut least) = (Shares::of(0, all.group), WORTHWHILE * without_worst(alone) * (BASE + rays));
    for set in (1..1 << KINDS).filter(|set| set & !all.bits() == 0) {
        let links: f64 = (0..KINDS).filter(|kind| set >> kind & 1 == 1).map(|kind| links[kind]).sum();
        // What sharing took away is as good as all that was to be shared, but for its mean over the group.
        let measured = all.group as f64;
        let shared = (noise[0] - noise[set]) / (1.0 - 1.0 / measured);
        for group in GROUPS {
            let size = group as f64;
            let noise = (noise[0] - shared).max(0.0) + shared / size;
            let cost = BASE + rays + price * (size / measured).powf(PRICE_GROWS) * links;
            if noise * cost < least {
                (best, least) = (Shares::of(set, group), noise * cost);
            }
        }
    }
    best
}

/// The sum of numbers but for the greatest, which a few samples say nothing about.
fn without_worst(mut numbers: Vec<f64>) -> f64 {
    let left_out = (numbers.len() as f64 * LEFT_OUT) as usize;
    numbers.sort_unstable_by(f64::total_cmp);
    numbers.iter().rev().skip(left_out).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squares whose pixels differ between the halves by `alone` if nothing is shared, by `rest` if the first kind is, and by `kept`
    /// more by the same paths if it is not.
    fn squares(alone: f64, rest: f64, kept: f64, links: f64) -> Vec<Square> {
        let between = |difference: f64| vec![[[1.0; 3], [1.0 + difference; 3]]; 64];
        let mut excess = [[[0.0; 3]; KINDS]; 2];
        excess[1][0] = [kept; 3];
        let links = [64.0 * links, 0.0, 0.0];
        let square = || Square {
            totals: between(rest),
            alone: between(alone),
            excess: vec![excess; 64],
            rays: 64.0 * 5.0,
            links,
        };
        (0..4).map(|_| square()).collect()
    }

    /// Where three quarters of the variance go away by sharing among sixteen: the dearer links are, the fewer share.
    #[test]
    fn as_many_share_as_pays() {
        let all = Shares::of(0b111, 16);
        let chosen = |links: f64| choose(&squares(0.1, 0.05, 0.05, links), all, 0.35);
        assert_eq!(chosen(0.1), Shares::of(1, 64));
        assert_eq!(chosen(1.0), Shares::of(1, 32));
        assert_eq!(chosen(20.0), Shares::of(1, 8));
        assert_eq!(chosen(200.0).bits(), 0);
        // What may not be shared is not.
        assert_eq!(choose(&squares(0.1, 0.05, 0.05, 0.1), Shares::of(0b110, 16), 0.35).bits(), 0);
    }

    /// Paths with sequences of their own can be better than those that share show.
    #[test]
    fn paths_that_share_nothing_count_as_they_are() {
        let chosen = |alone: f64| choose(&squares(alone, 0.05, 0.05, 4.0), Shares::of(1, 16), 0.35).bits();
        assert_eq!([chosen(0.1), chosen(0.05)], [1, 0]);
        // Nothing is gained by sharing what makes no difference.
        assert_eq!(choose(&squares(0.1, 0.1, 0.0, 1.0), Shares::of(1, 16), 0.35).bits(), 0);
    }
}
