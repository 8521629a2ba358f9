//! The render loop: a wave of paths moves through the stages until none is left.
//!
//! ```text
//! generate ─▶ PathQueue ─▶ intersect ─▶ HitQueue ─▶ sort ─▶ shade ─┬▶ ShadowQueue ─▶ connect ─▶ tile sums
//!                ▲                                                 │                             ▲
//!                └───────────────────── bounce ◀───────────────────┴▶ Reuse ─▶ LinkQueue ─▶ join ┘
//! ```
//!
//! `join` runs once when all paths of a tile's samples have ended, and only where the pilot found that it pays.
//!
//! In flow a [`FlatScene`] and settings; out flow tile sums. A stage is a free function
//! over queues, and knows no other; this module alone knows their order, and which of
//! them a scene needs at all. One worker owns a tile and its queues, which together fit
//! into a core's L2 cache. A wave is topped up with camera rays as its paths end, so that
//! blocks stay full; since light is added up exactly, that changes no bit.

// Stages, in the order they run; blank lines keep the formatter from sorting them.
mod generate;

mod intersect;

mod sort;

mod absorb;

mod layers;

mod sky;

mod emit;

mod shade;

mod connect;

mod bounce;

mod join;

// What stages call and what calls them.
mod ahead;
mod aim;
mod caustic;
mod classic;
mod coverage;
mod dimensions;
mod direct;
mod fetch;
mod groups;
mod ledger;
mod light_paths;
mod lobes;
mod one_path;
mod pilot;
mod queues;
mod resample;
mod reuse;
mod schedule;
mod stats;
mod surface;
mod taken;
mod tally;
#[cfg(test)]
mod tests;
mod view;

use std::sync::Arc;

pub use self::{
    aim::{Aim, Beam, Place, add_unseen},
    coverage::SceneCoverage,
    emit::emitted,
    one_path::render_one_path,
    queues::BYTES_PER_PATH,
    schedule::{render, render_aimed},
    stats::STAGES,
};
use self::{
    generate::{Cursor, Lens},
    join::Joiner,
    ledger::{Accounts, Ledger},
    light_paths::{LightPaths, LightWorker},
    queues::{HitQueue, PathQueue, ShadowQueue},
    reuse::{Reuse, Shares},
    sort::Order,
    stats::{Blocks, Counters, Stage},
    surface::Parts,
    tally::Tally,
};
use crate::{
    accel::{Coverage, Solid},
    bsdf::{Lambert, Opaque, Transmissive},
    film::{ExpressionError, Splits, Tile, Unit},
    flat::{FlatScene, LightGroups, NONE, SceneNeeds, ShadingClass},
    render::{Integrator, LayerKind, RenderSettings, SamplerKind, Sharing},
    sampling::{FilterTable, REPLICAS, Sampler, replica},
    simd::{Bits, LANES, Real},
};

/// Settings as the stages read them.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Paths in a wave.
    pub wave_size: usize,
    /// Rows that are sorted together: a wave, or a block if waves are to stay as they are.
    pub sorted: usize,
    /// Greatest number of scatterings.
    pub max_depth: u32,
    /// Lift rays to the smooth surface.
    pub terminator_fix: bool,
    /// Camera rays do not see the sky.
    pub transparent: bool,
    /// Scattered rays meet nothing beyond this, m.
    pub reach: f32,
    /// There is a light that can be sampled.
    pub sample_lights: bool,
    /// Which light is sampled depends on where.
    pub lights_by_place: bool,
    /// The row of the only light, if it is flat, of one colour, and all that can be sampled.
    pub only_flat_light: Option<u32>,
    /// What pixels share of what their paths find.
    pub shares: Shares,
    /// Some solid absorbs.
    pub absorbs: bool,
    /// Some surface does not stop every ray.
    pub partial_coverage: bool,
    /// Some surface stops rays at random, so that rays need names.
    pub blends: bool,
    /// The scene is so large that shading asks for its memory ahead.
    pub asks_ahead: bool,
    /// Light comes from the emitters too.
    pub caustics: bool,
    /// Luminance of the sky above which light comes from there too, nit.
    pub suns: f32,
    /// Layers beside the beauty picture.
    pub layers: Vec<LayerKind>,
    /// Something of the first hits is kept.
    pub has_first_hits: bool,
}

/// All that workers share while they make a picture.
#[derive(Clone)]
pub struct Job<'a> {
    scene: &'a FlatScene,
    settings: Settings,
    lens: Lens,
    filter: FilterTable,
    sampler: Sampler,
    unit: Unit,
    light_paths: Option<Arc<LightPaths>>,
    accounts: Arc<Accounts>,
    aim: Arc<Aim>,
    film_width: u32,
}

impl<'a> Job<'a> {
    /// For a scene and the user's settings.
    pub fn new(scene: &'a FlatScene, settings: &RenderSettings, unit: Unit) -> Self {
        let needs = scene.needs;
        // What is said of the error takes blocks of pixels for independent.
        let kind = match settings.sampler {
            SamplerKind::BlueNoise if settings.is_adaptive() => SamplerKind::Sobol,
            kind => kind,
        };
        let sampler = Sampler::new(kind, settings.seed).for_samples(settings.spp);
        let light_paths = LightPaths::new(scene, settings).map(Arc::new);
        Self {
            scene,
            settings: Settings {
                wave_size: settings.wave_size.max(1),
                sorted: if settings.sort { settings.wave_size.max(1) } else { LANES },
                max_depth: settings.max_depth.unwrap_or(u32::MAX),
                terminator_fix: settings.terminator_fix && needs.has(SceneNeeds::SMOOTH_NORMALS),
                asks_ahead: ahead::pays(scene),
                transparent: settings.transparent,
                reach: settings.integrator.reach(),
                sample_lights: !scene.lights.choice.is_empty(),
                only_flat_light: scene
                    .lights
                    .choice
                    .alone()
                    .filter(|&row| scene.lights.triangles.texture.get(row as usize) == Some(&NONE)),
                lights_by_place: scene.lights.choice.depends_on_place(),
                absorbs: needs.has(SceneNeeds::VOLUMES),
                blends: needs.has(SceneNeeds::ALPHA),
                partial_coverage: needs.has(SceneNeeds::ALPHA) || needs.has(SceneNeeds::CULLING),
                shares: shares(scene, settings),
                caustics: light_paths.is_some(),
                suns: light_paths.as_ref().map_or(f32::INFINITY, |paths| paths.suns()),
                has_first_hits: settings.transparent
                    || settings.layers.iter().any(|kind| kind.is_sum() || kind.is_id()),
                layers: settings.layers.clone(),
            },
            lens: Lens::new(scene.camera, settings.width, settings.height),
            filter: FilterTable::new(settings.filter),
            sampler: if settings.is_adaptive() { sampler.in_replicas() } else { sampler },
            unit,
            light_paths,
            accounts: Arc::new(accounts_or_less(scene, settings)),
            aim: Arc::default(),
            film_width: settings.width,
        }
    }
}

impl Job<'_> {
    /// The numbers of a sample of a pixel, and its ray: origin, direction and length. As [`generate`] starts it.
    fn camera_ray(&self, [x, y]: [u32; 2], sample: u32) -> (u32, u32, ([f32; 3], [f32; 3], f32)) {
        let (hash, index) = self.sampler.of_pixel(x, y, sample);
        type Integer = <f32 as Real>::Bits;
        let filter = Integer::splat(dimensions::FILTER);
        let u = self.sampler.pair::<f32>(Integer::splat(hash), Integer::splat(index), filter);
        let film = [(x, u.0), (y, u.1)].map(|(pixel, u)| f64::from(pixel) + 0.5 + f64::from(self.filter.offset(u)));
        (hash, index, self.lens.ray(film[0], film[1]))
    }

    /// With pixels that look elsewhere.
    fn aimed(mut self, aim: Aim, settings: &RenderSettings) -> Self {
        if let Aim::Pixels([width, height], _) = aim {
            self.lens = Lens::new(self.scene.camera, width, height);
        }
        self.film_width = settings.width;
        self.aim = Arc::new(aim);
        self
    }
}

/// Bytes that a film takes for light in parts.
pub fn bytes_of_parts(scene: &FlatScene, settings: &RenderSettings) -> Result<u64, ExpressionError> {
    let layers = accounts(scene, settings)?.splits.layers() as u64;
    // Sums, and the picture's own numbers; light that falls anywhere is kept apart.
    let kinds = 1 + u64::from(LightPaths::new(scene, settings).is_some());
    let sums = kinds * (REPLICAS * size_of::<[i128; 3]>()) as u64 + 2 * size_of::<[f32; 3]>() as u64;
    Ok(layers * sums * u64::from(settings.width) * u64::from(settings.height))
}

/// Of the light that the settings want to have in parts.
fn accounts(scene: &FlatScene, settings: &RenderSettings) -> Result<Accounts, ExpressionError> {
    let kinds = settings.layers.iter().filter_map(|kind| kind.split());
    let mut splits = Splits::new(kinds, settings.max_depth, 0);
    if !matches!(settings.integrator, Integrator::Path | Integrator::Direct) {
        splits = splits.without_paths();
    }
    let groups = if splits.by_light() { LightGroups::new(scene) } else { LightGroups::default() };
    let splits = splits.of_lights(groups.keys.len() as u32).with_paths(&settings.paths, &groups.keys)?;
    Ok(Accounts { splits, groups })
}

/// What can be kept of them.
fn accounts_or_less(scene: &FlatScene, settings: &RenderSettings) -> Accounts {
    accounts(scene, settings).unwrap_or_else(|_| {
        let layers = settings.layers.iter().copied().filter(|kind| !kind.split().is_some_and(|split| split.by_path()));
        accounts(scene, &RenderSettings { layers: layers.collect(), ..settings.clone() }).unwrap_or_default()
    })
}

/// What can be shared in a scene.
fn shares(scene: &FlatScene, settings: &RenderSettings) -> Shares {
    // Where rays are stopped at random, two vertices see each other only in part.
    if settings.sharing == Sharing::Off || scene.needs.has(SceneNeeds::ALPHA) {
        return Shares::default();
    }
    let scatterings = settings.max_depth.unwrap_or(u32::MAX);
    let environment = scatterings > 0 && scene.lights.environment.is_some();
    let map = environment && scene.needs.has(SceneNeeds::ENVIRONMENT_MAP);
    Shares {
        surface: scatterings > 1,
        sky: environment,
        lit: map && !scene.lights.choice.is_empty(),
        ..Shares::default()
    }
}

/// One core's queues; they keep their memory from tile to tile.
#[derive(Default)]
pub struct Worker {
    paths: PathQueue,
    next: PathQueue,
    hits: HitQueue,
    shadows: ShadowQueue,
    order: Order,
    reuse: Reuse,
    joiner: Joiner,
    ledger: Ledger,
    light: LightWorker,
    /// What this worker did.
    counters: Counters,
}

impl Worker {
    /// Adds every `step`-th of the samples `from..to` of every pixel to a tile.
    pub fn run(&mut self, job: &Job, tile: &mut Tile, from: u32, to: u32, step: u32) {
        if job.settings.partial_coverage {
            let coverage = SceneCoverage::new(job.scene);
            self.run_covered(job, &coverage, tile, from, to, step);
            self.counters.alpha_tests += coverage.alpha_tests.get();
            self.counters.texture_lookups += coverage.texture_lookups.get();
        } else {
            self.run_covered(job, &Solid, tile, from, to, step);
        }
    }

    /// Takes a tile's sums to add samples to.
    fn open(&mut self, job: &Job, tile: &mut Tile, from: u32, to: u32, step: u32) -> Tally {
        let (reuse, ledger) = (std::mem::take(&mut self.reuse), std::mem::take(&mut self.ledger));
        let mut tally = Tally::of(tile, job.unit, reuse, ledger);
        if job.settings.shares.any() {
            tally.reuse.begin([tile.x, tile.y, tile.width, tile.height], from, to, step);
        }
        if let Some(ledger) = &mut tally.ledger {
            ledger.begin(&job.accounts, tile.pixels(), from, to, step);
        }
        tally
    }

    /// Gives them back.
    fn close(&mut self, tally: Tally, tile: &mut Tile) {
        self.counters.discarded += tally.discarded;
        (self.reuse, self.ledger) = tally.close(tile);
    }

    fn run_covered<C: Coverage>(&mut self, job: &Job, coverage: &C, tile: &mut Tile, from: u32, to: u32, step: u32) {
        let Job { scene, settings, lens, filter, sampler, aim, film_width, .. } = job;
        let at_places = matches!(**aim, Aim::Places(_));
        let rectangle = [tile.x, tile.y, tile.width, tile.height];
        let mut tally = self.open(job, tile, from, to, step);
        let mut cursor = Cursor::new(from, to, step);
        let Self { paths, next, hits, shadows, order, joiner, counters, .. } = self;
        paths.rewind();
        next.rewind();
        // Once, so that no stage allocates however the paths of a wave turn out.
        let rows = settings.wave_size.min(tile.pixels() * (to - from).div_ceil(step) as usize);
        paths.make_room(rows);
        next.make_room(rows);
        hits.reserve(rows);
        shadows.make_room(rows);
        order.reserve(rows, settings.sorted);
        loop {
            // Half a wave of survivors is topped up at once rather than a few rows at a time.
            let before = paths.len();
            if before <= settings.wave_size / 2 && cursor.sample < cursor.end {
                counters.time_blocks(Stage::Generate, 0, |_| {
                    let blocks = generate::generate(
                        lens,
                        filter,
                        sampler,
                        aim,
                        *film_width,
                        rectangle,
                        &mut cursor,
                        settings.wave_size,
                        paths,
                    );
                    if at_places {
                        aim::point(aim, rectangle, *film_width, before, paths);
                    }
                    aim::shine(aim, rectangle, *film_width, before, sampler, paths);
                    blocks
                });
                let started = paths.len() - before;
                counters.add_rows(Stage::Generate, started);
                counters.rays.camera += started as u64;
            }
            counters.rays.bounce += before as u64;
            if paths.is_empty() {
                break;
            }
            counters.time(Stage::Intersect, paths.len(), |_| {
                let camera = (before, (to - from).div_ceil(step) as usize);
                intersect::intersect(&scene.accel, paths, camera, settings.blends, coverage, hits);
                if at_places {
                    aim::arrive(aim, rectangle, *film_width, before, paths, hits);
                }
            });
            counters.time(Stage::Sort, paths.len(), |_| {
                sort::sort(scene, hits, settings.sorted, settings.asks_ahead, order);
            });
            if settings.absorbs {
                counters.time(Stage::Absorb, paths.len(), |counters| {
                    counters.absorbed += absorb::absorb(scene, &order.materials, hits, paths);
                });
            }
            if settings.has_first_hits {
                counters.time(Stage::Layers, paths.len(), |_| {
                    layers::layers(scene, &settings.layers, &order.materials, paths, hits, tile);
                });
            }
            if let Some(environment) = &scene.lights.environment {
                let count = order.count(sort::MISS);
                if count > 0 {
                    counters.time_blocks(Stage::Sky, count, |counters| {
                        if scene.needs.has(SceneNeeds::ENVIRONMENT_MAP) {
                            counters.environment_lookups += count as u64;
                        }
                        let mut blocks = Blocks::default();
                        for rows in order.runs(sort::MISS) {
                            blocks += sky::sky(
                                scene,
                                environment,
                                rows,
                                settings.transparent,
                                settings.shares.sky,
                                settings.suns,
                                paths,
                                &mut tally,
                            );
                        }
                        blocks
                    });
                }
            }
            if !order.emissive.is_empty() {
                counters.time(Stage::Emit, order.emissive.len(), |counters| {
                    let lookups = &mut counters.texture_lookups;
                    emit::emit(scene, &order.emissive, &order.materials, paths, hits, &mut tally, lookups);
                });
            }
            let unlit = order.count(ShadingClass::Unlit as usize);
            if unlit > 0 {
                counters.time(Stage::Unlit, unlit, |counters| {
                    for rows in order.runs(ShadingClass::Unlit as usize) {
                        let lookups = &mut counters.texture_lookups;
                        emit::show_unlit(scene, rows, &order.materials, paths, hits, &mut tally, lookups);
                    }
                });
            }
            shadows.rewind();
            let surfaces = paths.len() - order.count(sort::MISS) - unlit;
            if surfaces > 0 {
                counters.time_blocks(Stage::Shade, surfaces, |counters| {
                    let mut blocks = Blocks::default();
                    for piece in order.pieces() {
                        for class in ShadingClass::SCATTERING {
                            let rows = piece.run(class as usize);
                            if !rows.is_empty() {
                                blocks += shade_class(
                                    job, class, rows, order, paths, hits, shadows, next, &mut tally, counters,
                                );
                            }
                        }
                    }
                    blocks
                });
            }
            if !shadows.is_empty() {
                counters.rays.shadow += shadows.len() as u64;
                counters.time(Stage::Connect, shadows.len(), |_| {
                    connect::connect(&scene.accel, shadows, coverage, &mut tally);
                });
            }
            paths.rewind();
            if !next.is_empty() {
                counters.time_blocks(Stage::Bounce, next.len(), |_| bounce::bounce(sampler, next, paths));
            }
        }
        if settings.shares.any() {
            counters.time(Stage::Join, tile.pixels() * (to - from).div_ceil(step) as usize, |counters| {
                joiner.join(job, coverage, rectangle, from, to, step, &mut tally, counters);
            });
        }
        self.close(tally, tile);
        for sample in (from..to).step_by(step as usize) {
            tile.samples[replica(sample)] += 1;
        }
    }
}

/// Scatters rows of one class.
fn shade_class(
    job: &Job,
    class: ShadingClass,
    rows: &[u32],
    order: &Order,
    paths: &PathQueue,
    hits: &HitQueue,
    shadows: &mut ShadowQueue,
    next: &mut PathQueue,
    tally: &mut Tally,
    counters: &mut Counters,
) -> Blocks {
    let run = match class {
        ShadingClass::Unlit | ShadingClass::Lambert => shade::shade::<Lambert, false>,
        ShadingClass::Opaque => shade::shade::<Opaque, false>,
        ShadingClass::OpaqueTextured => shade::shade::<Opaque, true>,
        ShadingClass::Transmissive => shade::shade::<Transmissive, false>,
        ShadingClass::TransmissiveTextured => shade::shade::<Transmissive, true>,
    };
    let Job { scene, settings, sampler, .. } = job;
    let (materials, parts) = (&order.materials, parts_of(class));
    run(scene, settings, sampler, rows, materials, parts, paths, hits, shadows, next, tally, counters)
}

/// The parameters that a class reads.
fn parts_of(class: ShadingClass) -> Parts {
    match class {
        ShadingClass::Unlit | ShadingClass::Lambert => Parts::Color,
        ShadingClass::Opaque | ShadingClass::OpaqueTextured => Parts::Opaque,
        ShadingClass::Transmissive | ShadingClass::TransmissiveTextured => Parts::All,
    }
}
