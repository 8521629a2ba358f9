//! Passes over the tiles: threads, progress, stop rules.

use std::{
    ops::Range,
    sync::{
        Mutex,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use rayon::prelude::*;

use super::{Accounts, Aim, Counters, Job, Worker, classic, light_paths, pilot};
use crate::{
    film::{Film, Growth, Splats, Tile, Unit},
    flat::{EnvironmentLight, FlatScene, flags},
    render::{Integrator, Observer, Progress, RenderSettings, RenderStats, Rendered, Sharing},
    sampling::REPLICAS,
    world::units::Nit,
};

/// Samples per pixel of a pass: enough to keep waves full, few enough to stop soon when asked.
const PASS: u32 = 16;
/// Passes that a time limit is cut into, at least.
const PASSES_PER_LIMIT: f64 = 24.0;
/// Paths of a round towards an error, at least and at most, over those before it.
const LEAST_GROWTH: f64 = 1.2;
const MOST_GROWTH: f64 = 6.0;
/// Share of the samples that all pixels get alike before some get more.
const EVEN_SHARE: f64 = 0.25;
/// A round aims at this share of the squared error that is asked for, so that mostly it is the last one.
const AIM: f64 = 0.95;
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

/// What workers tell and ask while they render.
struct Watcher<'a> {
    observer: &'a dyn Observer,
    start: Instant,
    limit: Option<Duration>,
    /// Pixels of the film.
    pixels: f64,
    /// Paths that the picture is expected to take.
    total: AtomicU64,
    done: AtomicU64,
    rays: AtomicU64,
    cancelled: AtomicBool,
    last: Mutex<Instant>,
}

impl Watcher<'_> {
    /// Called by a worker after each tile; one of them reports now and then.
    fn tick(&self, paths: u64, rays: u64) {
        let done = self.done.fetch_add(paths, Ordering::Relaxed) + paths;
        let rays = self.rays.fetch_add(rays, Ordering::Relaxed) + rays;
        let Ok(mut last) = self.last.try_lock() else { return };
        if last.elapsed() < REPORT_EVERY {
            return;
        }
        *last = Instant::now();
        let seconds = self.start.elapsed().as_secs_f64();
        let by_paths = done as f64 / self.total.load(Ordering::Relaxed) as f64;
        let by_time = self.limit.map_or(0.0, |limit| seconds / limit.as_secs_f64());
        self.observer.progress(&Progress {
            spp: done as f64 / self.pixels,
            done: by_paths.max(by_time).min(1.0),
            rays,
            seconds,
        });
        if self.observer.cancelled() {
            self.cancelled.store(true, Ordering::Relaxed);
        }
    }

    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// Seconds of the time limit that are left.
    fn left(&self) -> Option<f64> {
        self.limit.map(|limit| limit.saturating_sub(self.start.elapsed()).as_secs_f64())
    }

    fn late(&self) -> bool {
        self.left() == Some(0.0)
    }
}

/// Paths of a tile that are kept at a time for others to share: more take memory and gain nothing.
const MOST_SHARED: u32 = 1 << 14;

/// A way of adding every so-manieth sample of a range to a tile.
trait Run: Fn(&mut Worker, &Job, &mut Tile, u32, u32, u32) + Sync {}

impl<R: Fn(&mut Worker, &Job, &mut Tile, u32, u32, u32) + Sync> Run for R {}

/// All that a render goes through its passes with.
struct Passes<'a, R> {
    job: Job<'a>,
    run: R,
    watcher: Watcher<'a>,
    workers: Mutex<Vec<Worker>>,
}

impl<R: Run> Passes<'_, R> {
    /// Adds every `step`-th of the samples `from..to` to a tile.
    fn add(&self, tile: &mut Tile, from: u32, to: u32, step: u32) {
        let mut worker = self.workers.lock().expect("no worker panics holding it").pop().unwrap_or_default();
        let rays = worker.counters.all_rays();
        let mut next = from;
        while next < to {
            let most = if self.job.settings.shares.any() { MOST_SHARED / tile.pixels() as u32 } else { to - next };
            let end = to.min(next + most.max(1).saturating_mul(step));
            (self.run)(&mut worker, &self.job, tile, next, end, step);
            next = end;
        }
        let rays = worker.counters.all_rays() - rays;
        self.watcher.tick(u64::from((to - from).div_ceil(step)) * tile.pixels() as u64, rays);
        self.workers.lock().expect("no worker panics holding it").push(worker);
    }

    /// Adds the samples `from..to` to all tiles.
    ///
    /// One by one: of what a thread has taken several at a time, another that is done cannot take any.
    fn pass(&self, film: &mut Film, from: u32, to: u32) {
        let Film { tiles, splats, .. } = film;
        let mut of_tiles = || {
            tiles.par_iter_mut().with_max_len(1).for_each(|tile| {
                if !self.watcher.cancelled() {
                    self.add(tile, from, to, 1);
                }
            });
        };
        match splats {
            Some(splats) => drop(rayon::join(of_tiles, || self.light(splats, from, to))),
            None => of_tiles(),
        }
    }

    /// Adds the samples `from..to` of light that falls anywhere.
    fn light(&self, splats: &Splats, from: u32, to: u32) {
        let Some(count) = self.job.light_paths.as_ref().map(|paths| paths.count) else { return };
        // All of a sample or nothing; of small pictures several samples at a time, so that there is work for all.
        let together = (LIGHT_PATHS_TOGETHER / count).max(1);
        for first in (from..to).step_by(together as usize) {
            if self.watcher.cancelled() {
                return;
            }
            let samples = first..first.saturating_add(together).min(to);
            let chunks = count.div_ceil(light_paths::CHUNK);
            (0..chunks * samples.len() as u32).into_par_iter().with_max_len(1).for_each(|chunk| {
                let (sample, start) = (samples.start + chunk / chunks, chunk % chunks * light_paths::CHUNK);
                let mut worker = self.workers.lock().expect("no worker panics holding it").pop().unwrap_or_default();
                let Worker { light, counters, .. } = &mut worker;
                let rays = counters.all_rays();
                light.run(&self.job, splats, sample, start, count.min(start + light_paths::CHUNK), counters);
                self.watcher.tick(0, counters.all_rays() - rays);
                self.workers.lock().expect("no worker panics holding it").push(worker);
            });
            samples.for_each(|sample| splats.finish(sample));
        }
    }

    /// As many samples for all pixels, until there are enough or the time is over.
    fn evenly(&self, film: &mut Film, samples: &Range<u32>) {
        let mut next = samples.start;
        while next < samples.end && !self.watcher.cancelled() {
            let mut count = PASS;
            if let (Some(limit), Some(left)) = (self.watcher.limit, self.watcher.left()) {
                let done = next - samples.start;
                if done == 0 {
                    count = 1;
                } else if left == 0.0 {
                    break;
                } else {
                    let each = self.watcher.start.elapsed().as_secs_f64() / f64::from(done);
                    if each > left {
                        return self.part_of_a_pass(film, next);
                    }
                    let share = (limit.as_secs_f64() / PASSES_PER_LIMIT).min(left);
                    count = (share / each).clamp(1.0, f64::from(PASS * 16)) as u32;
                }
            }
            let end = next.saturating_add(count).min(samples.end);
            self.pass(film, next, end);
            next = end;
        }
    }

    /// One more sample for tiles all over the picture, until the time is over.
    fn part_of_a_pass(&self, film: &mut Film, sample: u32) {
        // Fibonacci hashing (Knuth 1998, "The Art of Computer Programming" 3, section 6.4): near ones come far apart.
        let scattered = |i: usize| (i as u32).wrapping_mul(0x9e37_79b9);
        let mut order: Vec<_> = film.tiles.iter_mut().enumerate().map(|(i, tile)| (scattered(i), tile)).collect();
        order.sort_unstable_by_key(|(key, _)| *key);
        order.into_par_iter().with_max_len(1).for_each(|(_, tile)| {
            if !self.watcher.cancelled() && !self.watcher.late() {
                self.add(tile, sample, sample + 1, 1);
            }
        });
    }

    /// Samples until the picture's error is small enough, most where the error is.
    ///
    /// All pixels get as many at first, a quarter or so of what the picture will take; these say where the others go.
    /// Rounds are long, so that the error is looked at a few times only: each look is one more chance to stop because it
    /// seems smaller than it is. What a round does is decided before it from exact sums, so that it does not depend on the
    /// number of threads.
    fn to_error(&self, film: &mut Film, target: f64, most_spp: Option<u32>) {
        let watcher = &self.watcher;
        let most_paths = most_spp.map_or(f64::INFINITY, |spp| f64::from(spp) * watcher.pixels);
        let (mut spp, mut next_spp) = (0, PASS);
        let mut plan: Option<(Vec<[f64; 2]>, Growth)> = None;
        loop {
            let now = watcher.done.load(Ordering::Relaxed) as f64;
            match &plan {
                None => {
                    let end = most_spp.unwrap_or(u32::MAX).min(next_spp);
                    while spp < end && !watcher.cancelled() && !watcher.late() {
                        // With a time limit one by one, so that it ends in time.
                        let to = if watcher.limit.is_some() { spp + 1 } else { end.min(spp + PASS) };
                        self.pass(film, spp, to);
                        spp = to;
                    }
                }
                Some((shares, growth)) => {
                    let counts = film.allocate(shares, growth);
                    self.round(film, &counts);
                    // What falls anywhere gets as many samples as pixels have on average.
                    if let Some(splats) = &film.splats {
                        let done = splats.samples().iter().sum();
                        let end = (film.spp() as u32).next_multiple_of(REPLICAS as u32);
                        self.light(splats, done, end.max(done));
                    }
                }
            }
            let done = watcher.done.load(Ordering::Relaxed) as f64;
            let stuck = done == now;
            if stuck || watcher.cancelled() || watcher.late() {
                break;
            }
            let Some(error) = film.error() else { break };
            if error.upper95 <= target * target {
                break;
            }
            let ratio = AIM * target * target / error.upper95;
            watcher.total.store((done / ratio).min(most_paths) as u64, Ordering::Relaxed);
            let all_spp = (f64::from(spp) / ratio).min(most_spp.map_or(f64::INFINITY, f64::from));
            if plan.is_none() && EVEN_SHARE * all_spp > f64::from(spp) {
                // More than there are, or nothing would seem to be left to do.
                let want = (EVEN_SHARE * all_spp).min(MOST_GROWTH * f64::from(spp)) as u32;
                next_spp = (want.max(spp) + 1).next_multiple_of(PASS);
                continue;
            }
            let growth =
                Growth { error: ratio, least: LEAST_GROWTH * done, most: (MOST_GROWTH * done).min(most_paths) };
            let shares = plan.map_or_else(|| film.shares(), |(shares, _)| shares);
            plan = Some((shares, growth));
        }
    }

    /// Brings the even and odd replicas of each tile to so many samples, or as far as the time goes.
    fn round(&self, film: &mut Film, counts: &[[u32; 2]]) {
        film.tiles.par_iter_mut().zip(counts).with_max_len(1).for_each(|(tile, counts)| {
            for (half, &end) in counts.iter().enumerate() {
                let mut next = tile.samples[half] + tile.samples[half + 2];
                while next < end && !self.watcher.cancelled() && !self.watcher.late() {
                    let to = end.min(next + PASS * 16);
                    self.add(tile, 2 * next + half as u32, 2 * to, 2);
                    next = to;
                }
            }
        });
    }
}

/// Makes a picture of the scene.
pub fn render(scene: &FlatScene, settings: &RenderSettings, observer: &dyn Observer) -> Rendered {
    match settings.integrator {
        Integrator::Path => render_by(scene, settings, observer, Worker::run),
        Integrator::Direct => {
            let most = settings.max_depth.map_or(1, |most| most.min(1));
            let settings = RenderSettings { max_depth: Some(most), ..settings.clone() };
            render_by(scene, &settings, observer, Worker::run)
        }
        Integrator::Whitted => {
            // What it leaves out must not come back by light paths, or from neighbours.
            let settings = RenderSettings { caustics: false, sharing: Sharing::Off, ..settings.clone() };
            render_by(scene, &settings, observer, classic::run_whitted)
        }
        Integrator::Ambient { .. } => {
            let scene = classic::in_white_sky(scene);
            let settings =
                RenderSettings { max_depth: Some(1), caustics: false, sharing: Sharing::Off, ..settings.clone() };
            render_by(&scene, &settings, observer, Worker::run)
        }
    }
}

/// Makes a picture whose pixels look elsewhere. No light comes from the emitters then: only the camera sees that.
pub fn render_aimed(scene: &FlatScene, settings: &RenderSettings, aim: Aim, observer: &dyn Observer) -> Rendered {
    let settings = RenderSettings { caustics: false, ..settings.clone() };
    film_by(scene, &settings, aim, observer, Worker::run).1
}

/// As [`render`], with a given way of adding samples to a tile.
pub(super) fn render_by(
    scene: &FlatScene,
    settings: &RenderSettings,
    observer: &dyn Observer,
    run: impl Fn(&mut Worker, &Job, &mut Tile, u32, u32, u32) + Send + Sync,
) -> Rendered {
    film_by(scene, settings, Aim::Camera, observer, run).1
}

/// The same with the film that the picture is of.
pub(super) fn film_by(
    scene: &FlatScene,
    settings: &RenderSettings,
    aim: Aim,
    observer: &dyn Observer,
    run: impl Fn(&mut Worker, &Job, &mut Tile, u32, u32, u32) + Send + Sync,
) -> (Film, Rendered) {
    let start = Instant::now();
    let unit = Unit::for_emission(brightest(scene));
    let mut film = Film::new(settings, unit);
    let samples = settings.samples.clone().unwrap_or(0..settings.spp.unwrap_or(u32::MAX));
    let pixels = film.tiles.iter().map(|tile| tile.pixels() as f64).sum::<f64>();
    let mut passes = Passes {
        job: Job::new(scene, settings, unit).aimed(aim, settings),
        run,
        watcher: Watcher {
            observer,
            start,
            limit: settings.time,
            pixels,
            total: AtomicU64::new((pixels * f64::from(samples.end - samples.start)) as u64),
            done: AtomicU64::new(0),
            rays: AtomicU64::new(0),
            cancelled: AtomicBool::new(false),
            last: Mutex::new(start),
        },
        workers: Mutex::new(Vec::new()),
    };
    let Accounts { splits, groups } = &*passes.job.accounts;
    let lights = groups.keys.iter().map(|&key| if key == u64::MAX { "sky".to_owned() } else { key.to_string() });
    film.split(splits.clone(), lights.collect());
    if passes.job.light_paths.is_some() {
        film.keep_splats();
    }
    let mut stats = RenderStats::default();
    let mut all_passes = || {
        passes.job.settings.shares = pilot::plan(&passes.job, settings);
        match settings.error {
            Some(target) if settings.is_adaptive() => passes.to_error(&mut film, target, settings.spp),
            _ => passes.evenly(&mut film, &samples),
        }
        stats.seconds = start.elapsed().as_secs_f64();
        stats.error = film.error();
        if stats.error.is_some() {
            stats.parts = film.part_means();
        }
        film.resolve()
    };
    let picture = match rayon::ThreadPoolBuilder::new().num_threads(settings.threads).build() {
        // A worker of another pool would take up other work of its own while it waits here, such as a render, and then another
        // one, until its stack is full.
        Ok(pool) if rayon::current_thread_index().is_some() => std::thread::scope(|scope| {
            let waits = scope.spawn(|| pool.install(&mut all_passes));
            waits.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        }),
        Ok(pool) => pool.install(&mut all_passes),
        // Without threads of its own it runs on those there are.
        Err(_) => all_passes(),
    };
    stats.spp = film.spp();
    stats.threads = if settings.threads == 0 { rayon::current_num_threads() } else { settings.threads };
    stats.cancelled = passes.watcher.cancelled();
    let mut counters = Counters::default();
    for worker in passes.workers.into_inner().expect("no worker panics holding it") {
        counters.add(&worker.counters);
    }
    counters.discarded += film.splats.as_ref().map_or(0, Splats::discarded);
    counters.report(&mut stats);
    (film, Rendered { picture, stats })
}
