//! Light from emitters through mirrors and clear glass: the part of a picture that [`caustic`] gives to it.
//!
//! ```text
//! start ─▶ LightQueue ─▶ intersect ─▶ HitQueue ─▶ sort ─▶ relay ─┬▶ SightQueue ─▶ splat ─▶ sums of their own
//!               ▲                                                │
//!               └────────────────────────────────────────────────┘
//! ```
//!
//! As the camera's paths, but started on emitters and towards the glass, and seen from the camera at every vertex that is
//! not a delta. Each sample of the picture brings the same number of them, wherever on the film their light falls; it is
//! added up apart from that of the camera's paths, and has a count of samples of its own.

mod history;
mod queues;
mod relay;
mod splat;
mod start;
mod sun;
mod targets;
#[cfg(test)]
mod tests;

use wide::f32x8;

use self::{
    history::{History, Node},
    queues::{LightBlock, LightPath, LightQueue, SightBlock, SightQueue},
    relay::{Around, Landed, Onward, Seen},
    start::Emitters,
    sun::{FROM_SUN, Suns},
    targets::Targets,
};
use super::{
    Job,
    coverage::{BothSides, SceneCoverage},
    dimensions::{mix, ray_id},
    lobes, parts_of,
    queues::{HitQueue, HitRow},
    shade::BEFORE_LIGHT,
    sort::{self, Order},
    stats::{Counters, Stage},
    surface::{Incoming, Parts},
};
use crate::{
    accel::{Coverage, Hit, Rays, Solid},
    bsdf::{Bsdf, Lambert, Opaque, Transmissive},
    film::{Automaton, Event, Label, Splat, Splats},
    flat::{FlatScene, NONE, SceneNeeds, ShadingClass, Source, flags},
    render::RenderSettings,
    sampling::{FilterDensity, Sampler},
    simd::{LANES, Mask, Real, V3},
};

/// Light paths for each pixel and sample. Of the caustic scene half of them take as long to the same error, and twice as many too.
const RATE: f64 = 0.25;
/// Light paths that a worker takes at a time: enough to fill waves, few enough that what they splat stays small.
pub const CHUNK: u32 = 8192;
/// Of the light that went past a surface without a back, as far as camera paths can tell, this share is followed.
const FOLLOWED: f32 = 0.125;

/// What light paths need to know.
#[derive(Clone, Debug)]
pub struct LightPaths {
    targets: Targets,
    emitters: Emitters,
    suns: Option<Suns>,
    filter: FilterDensity,
    /// For each sample of the picture. A power of two, so that those of a sample cover the emitters evenly.
    pub count: u32,
}

impl LightPaths {
    /// Those of a scene, if it has any.
    pub fn new(scene: &FlatScene, settings: &RenderSettings) -> Option<Self> {
        // A caustic takes two scatterings.
        if !settings.caustics || settings.max_depth.is_some_and(|most| most < 2) {
            return None;
        }
        let caustics = scene.needs.has(SceneNeeds::CAUSTICS);
        let targets = if caustics { Targets::new(scene, flags::DELTA) } else { Targets::default() };
        let emitters = if caustics { Emitters::new(scene, &targets) } else { Emitters::default() };
        let suns = Suns::new(scene);
        let pixels = f64::from(settings.width) * f64::from(settings.height);
        let count = 1 << (pixels * RATE).log2().round().clamp(4.0, 30.0) as u32;
        let filter = FilterDensity::new(settings.filter);
        (!emitters.is_empty() || suns.is_some()).then_some(Self { targets, emitters, suns, filter, count })
    }

    /// Luminance of the sky above which light comes from there, nit.
    pub fn suns(&self) -> f32 {
        self.suns.as_ref().map_or(f32::INFINITY, |suns| suns.least)
    }

    /// True if a triangle belongs to what a path that has met nothing is aimed at.
    fn aims(&self, scene: &FlatScene, target: u32, instance: u32, triangle: u32) -> bool {
        match &self.suns {
            Some(suns) if target & FROM_SUN != 0 => suns.targets.of(scene, instance, triangle) | FROM_SUN == target,
            _ => self.targets.of(scene, instance, triangle) == target,
        }
    }

    /// Start of one of all paths: every second one comes from a sun where others come from emitters.
    fn start(
        &self,
        scene: &FlatScene,
        sampler: &Sampler,
        key: u32,
        index: u32,
        lookups: &mut u64,
    ) -> Option<LightPath> {
        let (emitters, targets) = (&self.emitters, &self.targets);
        match &self.suns {
            None => emitters.start(scene, targets, sampler, key, index, lookups),
            Some(suns) if emitters.is_empty() => suns.start(scene, sampler, key, index),
            Some(suns) => {
                let path = if index & 1 == 0 {
                    emitters.start(scene, targets, sampler, key, index, lookups)
                } else {
                    suns.start(scene, sampler, key, index)
                };
                path.map(|path| LightPath {
                    flux_r: 2.0 * path.flux_r,
                    flux_g: 2.0 * path.flux_g,
                    flux_b: 2.0 * path.flux_b,
                    ..path
                })
            }
        }
    }
}

/// One core's queues of light paths.
#[derive(Default)]
pub struct LightWorker {
    paths: LightQueue,
    next: LightQueue,
    hits: HitQueue,
    order: Order,
    sights: SightQueue,
    history: History,
    splats: Vec<Splat>,
    /// What started each path of a chunk, where layers tell.
    sources: Vec<Source>,
    /// What happened to the light of each row of `sights`, where layers tell.
    ways: Vec<[u16; 3]>,
}

impl LightWorker {
    /// Adds the light of the paths `from..to` of a sample.
    pub fn run(&mut self, job: &Job, film: &Splats, sample: u32, from: u32, to: u32, counters: &mut Counters) {
        let (scene, settings) = (job.scene, &job.settings);
        counters.time(Stage::Caustics, (to - from) as usize, |counters| {
            if !settings.partial_coverage {
                return self.run_covered(job, &Solid, &Solid, film, sample, from..to, counters);
            }
            let coverage = SceneCoverage::new(scene);
            if settings.blends {
                let both = BothSides(SceneCoverage::new(scene));
                self.run_covered(job, &coverage, &both, film, sample, from..to, counters);
                counters.alpha_tests += both.0.alpha_tests.get();
                counters.texture_lookups += both.0.texture_lookups.get();
            } else {
                self.run_covered(job, &coverage, &Solid, film, sample, from..to, counters);
            }
            counters.alpha_tests += coverage.alpha_tests.get();
            counters.texture_lookups += coverage.texture_lookups.get();
        });
        self.splats.iter_mut().for_each(|splat| {
            let count = job.light_paths.as_ref().map_or(1, |light| light.count);
            splat.light = splat.light.map(|x| x * (1.0 / count as f32));
        });
        film.add(sample, &mut self.splats);
    }

    fn run_covered<C: Coverage, L: Coverage>(
        &mut self,
        job: &Job,
        coverage: &C,
        for_light: &L,
        film: &Splats,
        sample: u32,
        range: std::ops::Range<u32>,
        counters: &mut Counters,
    ) {
        let Job { scene, settings, lens, sampler, .. } = job;
        let Some(light) = &job.light_paths else { return };
        let number = u64::from(sample) * u64::from(light.count);
        let first = number as u32;
        let [x, y, width, height] = film.window.map(f64::from);
        let beyond = f64::from(light.filter.radius) - 0.5;
        let around = Around {
            scene,
            settings,
            lens,
            sampler,
            window: [x - beyond, y - beyond, x + width + beyond, y + height + beyond],
            // Pixels of a picture come before.
            key: sampler.pixel_hash((number >> 32) as u32, u32::MAX),
        };
        let Self { paths, next, hits, order, sights, history, splats, sources, ways } = self;
        let accounts = &job.accounts;
        let by_light = accounts.splits.by_light();
        let automaton = accounts.splits.automaton.as_deref();
        let keeps_history = settings.absorbs || automaton.is_some();
        sources.clear();
        let rows = settings.wave_size.min(range.len());
        // A path may be scattered and go on behind a surface without a back at once.
        paths.make_room(2 * rows);
        next.make_room(2 * rows);
        sights.make_room(2 * rows);
        paths.rewind();
        history.0.clear();
        let mut started = range.start;
        loop {
            while started < range.end && paths.len() < rows {
                let index = first.wrapping_add(started);
                started += 1;
                let lookups = &mut counters.texture_lookups;
                let start = light.start(scene, sampler, around.key, index, lookups);
                if by_light {
                    sources.push(match &start {
                        Some(path) if path.node != NONE => Source::Chosen(path.node / 2),
                        _ => Source::Sky,
                    });
                }
                if let Some(mut path) = start {
                    if keeps_history {
                        path.node = history.push(on_emitter(scene, path.node));
                    }
                    paths.put(&LightBlock::all(&path), 1);
                }
            }
            if paths.is_empty() {
                break;
            }
            counters.rays.bounce += paths.len() as u64;
            hits.resize(paths.len());
            let named = settings.blends.then_some(around.key);
            scene.accel.nearest_of(&LightRays { paths, named }, for_light, |row, hit| {
                let Hit { t, b1, b2, instance, triangle, back } = *hit;
                hits.set(row, HitRow { t, b1, b2, instance, triangle, back: u32::from(back) });
            });
            sort::sort(scene, hits, settings.sorted, settings.asks_ahead, order);
            next.rewind();
            sights.rewind();
            ways.clear();
            let wave = Wave { around: &around, light, automaton, paths, hits, materials: &order.materials };
            for piece in order.pieces() {
                for class in ShadingClass::SCATTERING {
                    let rows = piece.run(class as usize);
                    if !rows.is_empty() {
                        wave.relay(class, rows, sights, ways, next, history, counters);
                    }
                }
            }
            counters.rays.shadow += sights.len() as u64;
            scene.accel.occluded_of(&*sights, coverage, |row, occluded| {
                if !occluded {
                    let sight = sights.row(row);
                    let number = sight.index.wrapping_sub(first).wrapping_sub(range.start) as usize;
                    let light_row = sources.get(number).map_or(0, |&source| accounts.groups.of(scene, source));
                    let way = ways.get(row).copied().unwrap_or_default();
                    let label = Label { scatterings: sight.depth, light: light_row, way };
                    splat::splat(&light.filter, film, &sight, label, splats);
                }
            });
            std::mem::swap(paths, next);
        }
    }
}

/// The vertex of a path that is at its start.
fn on_emitter(scene: &FlatScene, node: u32) -> Node {
    let events = [Event::DiffuseReflection; 3];
    if node == NONE {
        // The sky, which no solid is around.
        return Node { before: NONE, material: NONE, back: false, transmitted: false, t: 0.0, events };
    }
    let (triangles, row) = (&scene.lights.triangles, (node / 2) as usize);
    let material = scene.material_of(triangles.instance[row], triangles.triangle[row]);
    Node { before: NONE, material, back: node & 1 == 1, transmitted: false, t: 0.0, events }
}

/// A wave of light paths with what they met.
struct Wave<'a> {
    around: &'a Around<'a>,
    light: &'a LightPaths,
    /// Where layers tell what happened to light.
    automaton: Option<&'a Automaton>,
    paths: &'a LightQueue,
    hits: &'a HitQueue,
    materials: &'a [u32],
}

impl Wave<'_> {
    /// Scatters rows of one class.
    fn relay(
        &self,
        class: ShadingClass,
        rows: &[u32],
        sights: &mut SightQueue,
        ways: &mut Vec<[u16; 3]>,
        next: &mut LightQueue,
        history: &mut History,
        counters: &mut Counters,
    ) {
        let run = match class {
            ShadingClass::Unlit | ShadingClass::Lambert => Self::relay_by::<Lambert, false>,
            ShadingClass::Opaque => Self::relay_by::<Opaque, false>,
            ShadingClass::OpaqueTextured => Self::relay_by::<Opaque, true>,
            ShadingClass::Transmissive => Self::relay_by::<Transmissive, false>,
            ShadingClass::TransmissiveTextured => Self::relay_by::<Transmissive, true>,
        };
        for rows in rows.chunks(LANES) {
            let index: [usize; LANES] = std::array::from_fn(|lane| rows[lane.min(rows.len() - 1)] as usize);
            let (at, passes) = self.gather(&index, rows.len());
            if at.active | passes != 0 {
                let (seen, onward, events) = run(self, &at, parts_of(class), counters);
                self.push(&index, &at, &seen, &onward, events, passes, sights, ways, next, history);
            }
        }
    }

    /// One block, and what its surfaces do to what the camera sees and to what goes on.
    fn relay_by<B: Bsdf, const TEXTURED: bool>(
        &self,
        at: &Landed<f32x8>,
        parts: Parts,
        counters: &mut Counters,
    ) -> (Seen<f32x8>, Onward<f32x8>, [[[Event; 3]; 8]; 2]) {
        let (seen, onward) = relay::relay::<f32x8, B, TEXTURED>(self.around, at, parts, counters);
        if self.automaton.is_none() {
            return (seen, onward, [[[Event::DiffuseReflection; 3]; 8]; 2]);
        }
        let Around { scene, settings, key, .. } = *self.around;
        let to_light = -at.hits.direction;
        // Lanes that see nothing look along the way that they came.
        let to_camera = V3::from_fn(|lane| seen.sightings[lane].direction.map(|c| -c));
        let to_camera = V3::select(Mask::from_bits(seen.lanes), to_camera, to_light);
        let events = |towards: V3<f32x8>, delta: u32, kind: u32| {
            let fix = settings.terminator_fix;
            let u = |lane: usize| lobes::uniform(key ^ kind, at.index[lane], at.depth[lane]);
            lobes::of_light_paths::<f32x8, B, TEXTURED>(scene, fix, &at.hits, parts, towards, Mask::from_bits(delta), u)
        };
        let events = [events(to_camera, 0, 0), events(onward.direction, onward.deltas, 1)];
        (seen, onward, events)
    }

    /// Paths of one block, and the lanes that go on behind the surface too.
    fn gather(&self, index: &[usize; LANES], count: usize) -> (Landed<f32x8>, u32) {
        let Self { around: Around { scene, settings, .. }, paths, hits, .. } = *self;
        let number = |column: &[f32]| <f32x8 as Real>::from_fn(|lane| column[index[lane]]);
        let bits = |column: &[u32]| -> [u32; LANES] { std::array::from_fn(|lane| column[index[lane]]) };
        let (mut back, mut active, mut passes, mut from_sun) = (0, 0, 0, 0);
        for (lane, &i) in index.iter().enumerate() {
            back |= hits.back[i] << lane;
            if lane >= count || paths.depth[i] >= settings.max_depth {
                continue;
            }
            let aimed =
                paths.depth[i] > 0 || self.light.aims(scene, paths.target[i], hits.instance[i], hits.triangle[i]);
            from_sun |= u32::from(paths.depth[i] == 0 && paths.target[i] & FROM_SUN != 0) << lane;
            active |= u32::from(aimed) << lane;
            let has_back =
                scene.materials.flags[self.materials[i] as usize] & (flags::DOUBLE_SIDED | flags::TRANSMISSION) != 0;
            if !has_back && hits.back[i] == 0 && (!aimed || self.is_followed(i)) {
                passes |= 1 << lane;
            }
        }
        let hits = Incoming {
            direction: V3::new(number(&paths.dx), number(&paths.dy), number(&paths.dz)),
            b1: number(&hits.b1),
            b2: number(&hits.b2),
            back: Mask::from_bits(back),
            instance: bits(&hits.instance),
            triangle: bits(&hits.triangle),
            material: bits(self.materials),
        };
        let flux = V3::new(number(&paths.flux_r), number(&paths.flux_g), number(&paths.flux_b));
        (Landed { hits, active, flux, index: bits(&paths.index), depth: bits(&paths.depth), from_sun }, passes)
    }

    /// True for one of [`FOLLOWED`]⁻¹ paths that meet a surface, by chance.
    fn is_followed(&self, i: usize) -> bool {
        let (paths, hits) = (self.paths, self.hits);
        let name = ray_id(self.around.key, paths.index[i], paths.depth[i], 0);
        let u = mix(name ^ mix(hits.triangle[i] ^ mix(hits.instance[i]))) >> 8;
        (u as f32) < FOLLOWED * 16_777_216.0
    }

    fn push(
        &self,
        index: &[usize; LANES],
        at: &Landed<f32x8>,
        seen: &Seen<f32x8>,
        onward: &Onward<f32x8>,
        [to_camera, on]: [[[Event; 3]; 8]; 2],
        passes: u32,
        sights: &mut SightQueue,
        ways: &mut Vec<[u16; 3]>,
        next: &mut LightQueue,
        history: &mut History,
    ) {
        let Around { scene, settings, key, .. } = *self.around;
        let keeps_history = settings.absorbs || self.automaton.is_some();
        let node = |lane: usize, transmitted: u32, events: [Event; 3]| {
            let (i, transmitted) = (index[lane], transmitted >> lane & 1 == 1);
            let back = (self.hits.back[i] == 1) != transmitted;
            let material = at.hits.material[lane];
            Node { before: self.paths.node[i], material, back, transmitted, t: self.hits.t[i], events }
        };
        if seen.lanes != 0 {
            let mut light = [seen.light.x, seen.light.y, seen.light.z].map(|c| c.to_array());
            if settings.absorbs {
                for lane in (0..LANES).filter(|lane| seen.lanes >> lane & 1 == 1) {
                    let distance = seen.sightings[lane].distance;
                    let last = node(lane, seen.transmitted, to_camera[lane]);
                    let keep = history.transmittance(scene, last, distance);
                    (0..3).for_each(|c| light[c][lane] *= keep[c]);
                }
            }
            if let Some(automaton) = self.automaton {
                let lanes = (0..LANES).filter(|lane| seen.lanes >> lane & 1 == 1);
                ways.extend(lanes.map(|lane| history.way(automaton, node(lane, seen.transmitted, to_camera[lane]))));
            }
            let from: V3<f32x8> = V3::from_fn(|lane| seen.sightings[lane].origin);
            let to = seen.end - from;
            let name = |lane| if settings.blends { ray_id(key, at.index[lane], at.depth[lane], 1) } else { 0 };
            let block = SightBlock {
                ox: from.x.to_array(),
                oy: from.y.to_array(),
                oz: from.z.to_array(),
                dx: to.x.to_array(),
                dy: to.y.to_array(),
                dz: to.z.to_array(),
                ray_id: std::array::from_fn(name),
                light_r: light[0],
                light_g: light[1],
                light_b: light[2],
                x: std::array::from_fn(|lane| seen.sightings[lane].film[0] as f32),
                y: std::array::from_fn(|lane| seen.sightings[lane].film[1] as f32),
                index: at.index,
                depth: at.depth.map(|depth| depth + 1),
            };
            sights.put(&block, seen.lanes);
        }
        let mut block = LightBlock {
            ox: onward.origin.x.to_array(),
            oy: onward.origin.y.to_array(),
            oz: onward.origin.z.to_array(),
            dx: onward.direction.x.to_array(),
            dy: onward.direction.y.to_array(),
            dz: onward.direction.z.to_array(),
            flux_r: onward.flux.x.to_array(),
            flux_g: onward.flux.y.to_array(),
            flux_b: onward.flux.z.to_array(),
            index: at.index,
            depth: at.depth.map(|depth| depth + 1),
            target: [NONE; LANES],
            node: [NONE; LANES],
        };
        if keeps_history {
            for lane in (0..LANES).filter(|lane| onward.lanes >> lane & 1 == 1) {
                block.node[lane] = history.push(node(lane, onward.transmitted, on[lane]));
            }
        }
        next.put(&block, onward.lanes);
        for lane in (0..LANES).filter(|lane| passes >> lane & 1 == 1) {
            let weight = if at.active >> lane & 1 == 1 { 1.0 / FOLLOWED } else { 1.0 };
            let i = index[lane];
            let mut path = self.paths.row(i);
            [path.ox, path.oy, path.oz] = onward.beyond.lane(lane);
            (path.flux_r, path.flux_g, path.flux_b) =
                (path.flux_r * weight, path.flux_g * weight, path.flux_b * weight);
            if keeps_history {
                path.node = history.push(Node { material: NONE, ..node(lane, 0, on[lane]) });
            }
            next.put(&LightBlock::all(&path), 1);
        }
    }
}

impl LightBlock {
    /// Eight times the same.
    fn all(path: &LightPath) -> Self {
        let LightPath { ox, oy, oz, dx, dy, dz, flux_r, flux_g, flux_b, index, depth, target, node } = *path;
        Self {
            ox: [ox; LANES],
            oy: [oy; LANES],
            oz: [oz; LANES],
            dx: [dx; LANES],
            dy: [dy; LANES],
            dz: [dz; LANES],
            flux_r: [flux_r; LANES],
            flux_g: [flux_g; LANES],
            flux_b: [flux_b; LANES],
            index: [index; LANES],
            depth: [depth; LANES],
            target: [target; LANES],
            node: [node; LANES],
        }
    }
}

/// The rays of a queue of light paths, named after a key where something blends.
struct LightRays<'a> {
    paths: &'a LightQueue,
    named: Option<u32>,
}

impl Rays for LightRays<'_> {
    fn count(&self) -> usize {
        self.paths.len()
    }

    #[inline(always)]
    fn ray(&self, i: usize) -> ([f32; 3], [f32; 3], f32) {
        let paths = self.paths;
        ([paths.ox[i], paths.oy[i], paths.oz[i]], [paths.dx[i], paths.dy[i], paths.dz[i]], f32::INFINITY)
    }

    #[inline(always)]
    fn id(&self, i: usize) -> u32 {
        self.named.map_or(0, |key| ray_id(key, self.paths.index[i], self.paths.depth[i], 0))
    }
}

impl Rays for SightQueue {
    fn count(&self) -> usize {
        self.len()
    }

    #[inline(always)]
    fn ray(&self, i: usize) -> ([f32; 3], [f32; 3], f32) {
        ([self.ox[i], self.oy[i], self.oz[i]], [self.dx[i], self.dy[i], self.dz[i]], BEFORE_LIGHT)
    }

    #[inline(always)]
    fn id(&self, i: usize) -> u32 {
        self.ray_id[i]
    }
}
