//! Passes over the tiles: threads, progress, stop rules.

use std::{
    sync::{
        Mutex,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use rayon::prelude::*;

use super::{Counters, Job, Worker, light_paths};
use crate::{
    film::{Film, Splats, Tile, Unit},
    flat::{EnvironmentLight, FlatScene, flags},
    render::{Observer, Progress, RenderSettings, RenderStats, Rendered},
    world::units::Nit,
};

/// Samples per pixel of a pass: enough to keep waves full, few enough to stop soon when asked.
const PASS: u32 = 16;
/// Passes that a time limit is cut into, at least.
const PASSES_PER_LIMIT: f64 = 24.0;
/// Light paths after which cancelling is looked for.
const LIGHT_PATHS_TOGETHER: u32 = 1 << 18;
/// Time between two reports of progress.
const REPORT_EVERY: Duration = Duration::from_millis(100);

/// The greatest radiance, intensity or illuminance in the scene, which fixes the step of the sums.
fn brightest(scene: &FlatScene) -> Nit {
    let lights = &scene.lights;
    let colors = scene.materials.emissive.iter().chain(&lights.local.intensity).chain(&lights.distant.illuminance);
    let mut most = colors.flatten().copied().fold(0.0, f32::max);
    for (row, bits) in scene.materials.flags.iter().enumerate() {
        if bits & flags::UNLIT != 0 {
            most = scene.materials.base_color[row].into_iter().fold(most, f32::max);
        }
    }
    match &lights.environment {
        Some(EnvironmentLight::Constant(radiance)) => most = radiance.iter().copied().fold(most, f32::max),
        Some(EnvironmentLight::Map(map)) => most = map.texels.iter().flatten().copied().fold(most, f32::max),
        None => {}
    }
    Nit(most)
}

struct Watcher<'a> {
    observer: &'a dyn Observer,
    start: Instant,
    total: f64,
    limit: Option<Duration>,
    done: AtomicU64,
    rays: AtomicU64,
    cancelled: AtomicBool,
    last: Mutex<Instant>,
}

impl Watcher<'_> {
    /// Called by a worker after each tile; one of them reports now and then.
    fn tick(&self, samples: u64, rays: u64, pixels: f64) {
        let done = self.done.fetch_add(samples, Ordering::Relaxed) + samples;
        let rays = self.rays.fetch_add(rays, Ordering::Relaxed) + rays;
        let Ok(mut last) = self.last.try_lock() else { return };
        if last.elapsed() < REPORT_EVERY {
            return;
        }
        *last = Instant::now();
        let seconds = self.start.elapsed().as_secs_f64();
        let by_samples = done as f64 / self.total;
        let by_time = self.limit.map_or(0.0, |limit| seconds / limit.as_secs_f64());
        self.observer.progress(&Progress {
            spp: done as f64 / pixels,
            done: by_samples.max(by_time).min(1.0),
            rays,
            seconds,
        });
        if self.observer.cancelled() {
            self.cancelled.store(true, Ordering::Relaxed);
        }
    }
}

/// Makes a picture of the scene.
pub fn render(scene: &FlatScene, settings: &RenderSettings, observer: &dyn Observer) -> Rendered {
    render_by(scene, settings, observer, Worker::run)
}

/// As [`render`], with a given way of adding samples to a tile.
pub(super) fn render_by(
    scene: &FlatScene,
    settings: &RenderSettings,
    observer: &dyn Observer,
    run: impl Fn(&mut Worker, &Job, &mut Tile, u32, u32) + Sync,
) -> Rendered {
    let start = Instant::now();
    let unit = Unit::for_emission(brightest(scene));
    let mut film = Film::new(settings, unit);
    let job = Job::new(scene, settings, unit);
    if job.light_paths.is_some() {
        film.keep_splats(settings);
    }
    let samples = settings.samples.clone().unwrap_or(0..settings.spp.unwrap_or(u32::MAX));
    let pixels = film.tiles.iter().map(|tile| tile.pixels() as f64).sum::<f64>();
    let watcher = Watcher {
        observer,
        start,
        total: pixels * f64::from(samples.end - samples.start),
        limit: settings.time,
        done: AtomicU64::new(0),
        rays: AtomicU64::new(0),
        cancelled: AtomicBool::new(false),
        last: Mutex::new(start),
    };
    let workers: Mutex<Vec<Worker>> = Mutex::new(Vec::new());
    let take = || workers.lock().expect("no worker panics holding it").pop().unwrap_or_default();
    let give_back = |worker| workers.lock().expect("no worker panics holding it").push(worker);
    let cancelled = || watcher.cancelled.load(Ordering::Relaxed);
    let light = |splats: &Splats, count: u32, from: u32, to: u32| {
        // All of a sample or nothing; of small pictures several samples at a time, so that there is work for all.
        let together = (LIGHT_PATHS_TOGETHER / count).max(1);
        for first in (from..to).step_by(together as usize) {
            if cancelled() {
                return;
            }
            let samples = first..first.saturating_add(together).min(to);
            let chunks = count.div_ceil(light_paths::CHUNK);
            (0..chunks * samples.len() as u32).into_par_iter().for_each(|chunk| {
                let (sample, start) = (samples.start + chunk / chunks, chunk % chunks * light_paths::CHUNK);
                let mut worker: Worker = take();
                let Worker { light, counters, .. } = &mut worker;
                let rays = counters.all_rays();
                light.run(&job, splats, sample, start, count.min(start + light_paths::CHUNK), counters);
                watcher.tick(0, counters.all_rays() - rays, pixels);
                give_back(worker);
            });
            samples.for_each(|sample| splats.finish(sample));
        }
    };
    let pass_of_tiles = |tiles: &mut [Tile], from: u32, to: u32| {
        tiles.par_iter_mut().for_each(|tile| {
            if cancelled() {
                return;
            }
            let mut worker: Worker = take();
            let rays = worker.counters.all_rays();
            run(&mut worker, &job, tile, from, to);
            let rays = worker.counters.all_rays() - rays;
            watcher.tick(u64::from(to - from) * tile.pixels() as u64, rays, pixels);
            give_back(worker);
        });
    };
    let pass = |film: &mut Film, from: u32, to: u32| {
        let Film { tiles, splats, .. } = film;
        match (splats, &job.light_paths) {
            (Some(splats), Some(paths)) => {
                rayon::join(|| pass_of_tiles(tiles, from, to), || light(splats, paths.count, from, to));
            }
            _ => pass_of_tiles(tiles, from, to),
        }
    };
    let mut all_passes = || {
        let mut next = samples.start;
        while next < samples.end && !watcher.cancelled.load(Ordering::Relaxed) {
            let mut count = PASS;
            if let Some(limit) = settings.time {
                let spent = start.elapsed();
                let left = limit.saturating_sub(spent).as_secs_f64();
                let done = next - samples.start;
                if left == 0.0 && done > 0 {
                    break;
                }
                if done == 0 {
                    count = 1;
                } else {
                    let each = spent.as_secs_f64() / f64::from(done);
                    // Ends on time rather than a pass late.
                    if each > left * 1.5 {
                        break;
                    }
                    let share = (limit.as_secs_f64() / PASSES_PER_LIMIT).min(left);
                    count = (share / each).clamp(1.0, f64::from(PASS * 16)) as u32;
                }
            }
            let end = next.saturating_add(count).min(samples.end);
            pass(&mut film, next, end);
            next = end;
        }
    };
    match rayon::ThreadPoolBuilder::new().num_threads(settings.threads).build() {
        Ok(pool) => pool.install(&mut all_passes),
        // Without threads of its own it runs on those there are.
        Err(_) => all_passes(),
    }
    let mut counters = Counters::default();
    for worker in workers.into_inner().expect("no worker panics holding it") {
        counters.add(&worker.counters);
    }
    counters.discarded += film.splats.as_ref().map_or(0, Splats::discarded);
    let mut stats = RenderStats {
        seconds: start.elapsed().as_secs_f64(),
        spp: film.spp(),
        relmse: film.relmse(),
        threads: if settings.threads == 0 { rayon::current_num_threads() } else { settings.threads },
        cancelled: watcher.cancelled.load(Ordering::Relaxed),
        ..RenderStats::default()
    };
    counters.report(&mut stats);
    Rendered { picture: film.resolve(), stats }
}
