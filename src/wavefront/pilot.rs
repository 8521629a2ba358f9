//! Finds out what sharing pays: a few squares of pixels, rendered with everything shared.
//!
//! Sharing what paths find makes noise smaller and samples dearer. Of what a pixel gets from each kind of find, both the shared
//! and the unshared amount come out of the same paths, so that one pilot says for each set of kinds what the variance of a
//! sample would be, and from the two follows what groups of another size would do. What has the least product of variance and cost
//! is taken. The pilot's samples have numbers of their own and are counted nowhere, so nothing depends on them but how long the
//! picture takes (chosen by the picture's own samples, the way that happens to look dark would be taken too often); and they are the
//! same whatever part of a picture is rendered, and however.

use rayon::prelude::*;

use super::{
    Job, Worker,
    reuse::{KINDS, Shares},
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
/// Share of the pixels, the noisiest ones, that do not count.
const LEFT_OUT: f64 = 0.002;

/// What was measured in a square.
struct Square {
    /// By pixel and mean: what the pixel got by all kinds shared, and for each kind what it would get more if it were not.
    totals: Vec<[[f64; 3]; 2]>,
    excess: Vec<[[[f64; 3]; KINDS]; 2]>,
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
    let mut film = Film::new(&of_square, job.unit);
    let tile = &mut film.tiles[0];
    let pixels = tile.pixels();
    let mut square = Square {
        totals: vec![[[0.0; 3]; 2]; pixels],
        excess: vec![[[[0.0; 3]; KINDS]; 2]; pixels],
        rays: 0.0,
        links: [0.0; KINDS],
    };
    let mut before = vec![[0; 3]; pixels];
    for half in 0..2 {
        worker.joiner.measured = Some(vec![[[0.0; 3]; KINDS]; pixels]);
        worker.run(job, tile, half * MEAN_OF, (half + 1) * MEAN_OF, 1);
        let excess = worker.joiner.measured.take().unwrap_or_default();
        let mean = |sum: f64| sum / f64::from(MEAN_OF);
        for pixel in 0..pixels {
            let now = tile.light(pixel);
            let got = std::array::from_fn(|i| mean(job.unit.value(now[i] - before[pixel][i])));
            square.totals[pixel][half as usize] = got;
            square.excess[pixel][half as usize] = excess[pixel].map(|kind| kind.map(mean));
            before[pixel] = now;
        }
    }
    let each = f64::from(2 * MEAN_OF);
    let links = std::mem::take(&mut worker.joiner.links_by_kind);
    square.links = links.map(|links| links as f64 / each);
    let counters = std::mem::take(&mut worker.counters);
    square.rays = counters.all_rays() as f64 / each - square.links.iter().sum::<f64>();
    square
}

fn choose(squares: &[Square], all: Shares, price: f64) -> Shares {
    let pixels: f64 = squares.iter().map(|square| square.totals.len() as f64).sum();
    let mean_of =
        |square: &Square| square.totals.iter().flatten().flatten().sum::<f64>() / (6 * square.totals.len()) as f64;
    let mean = squares.iter().map(|square| mean_of(square) * square.totals.len() as f64).sum::<f64>() / pixels;
    let rays = squares.iter().map(|square| square.rays).sum::<f64>() / pixels;
    // By set and pixel.
    let mut noise: [Vec<f64>; 1 << KINDS] = Default::default();
    let mut links = [0.0; KINDS];
    for square in squares {
        let scale = mean_of(square).powi(2) + (FLOOR * mean).powi(2);
        if scale <= 0.0 {
            continue;
        }
        for (totals, excess) in square.totals.iter().zip(&square.excess) {
            for (set, noise) in noise.iter_mut().enumerate() {
                let with = |sample: usize, channel: usize| {
                    let more = |kind: usize| if set >> kind & 1 == 1 { 0.0 } else { excess[sample][kind][channel] };
                    totals[sample][channel] + (0..KINDS).map(more).sum::<f64>()
                };
                let variance: f64 = (0..3).map(|i| (with(0, i) - with(1, i)).powi(2) / 2.0).sum();
                noise.push(variance / scale);
            }
        }
        (0..KINDS).for_each(|kind| links[kind] += square.links[kind] / pixels);
    }
    let noise = noise.map(without_worst);
    let (mut best, mut least) = (Shares::of(0, all.group), noise[0] * (BASE + rays));
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
