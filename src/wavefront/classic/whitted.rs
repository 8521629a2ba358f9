//! Whitted's ray tracing: mirrors and clear glass by recursion, lamps by one ray each, no other light.
//!
//! After Whitted 1980, "An Improved Illumination Model for Shaded Display". At each surface every lamp is looked for by one ray:
//! those without extent where they are, facets at their middle, and what has many of them, or is a shape, as a ball of that surface, so that
//! all shadows are hard. A mirror is followed, and of
//! clear glass both what it reflects and what it lets through, down to the greatest depth. Nothing else is: no light from one
//! matt surface to another, no blurred reflections, no caustics, and of a sky only what is seen directly, in mirrors and through glass.
//! There is no noise but that of the pixel filter.

use std::collections::BTreeMap;

use crate::{
    accel::{Coverage, Hit, Solid, Stacks},
    bsdf::{Bsdf, Transmissive},
    film::Tile,
    flat::{EnvironmentLight, FlatScene, NONE, Source, flags},
    sampling::replica,
    simd::{Mask, Rgb, V3},
    wavefront::{
        Job, Worker,
        absorb::medium_of,
        coverage::SceneCoverage,
        dimensions::ray_id,
        direct, emit,
        ledger::Ledger,
        shade::{BEFORE_LIGHT, medium_behind},
        surface::{self, Incoming, Parts, Surface},
        tally::Tally,
    },
};

/// Surfaces that a ray goes on from, where nothing else is said: the tree has twice as many branches with each.
pub const MOST_DEPTH: u32 = 10;
/// Emitting facets of an entity from which on it is looked for as one lamp.
const MANY: usize = 16;
/// Branches that bring the pixel less than this share of their light end.
const LEAST: f32 = 1e-5;

/// A ray of the tree.
#[derive(Clone, Copy)]
struct Branch {
    origin: [f32; 3],
    direction: [f32; 3],
    t_max: f32,
    /// Share of its light that reaches the pixel.
    throughput: Rgb<f32>,
    depth: u32,
    /// Material row of the solid that it is inside.
    medium: u32,
}

/// Where a pixel's light goes.
struct Sample<'a> {
    tally: &'a mut Tally,
    slot: u32,
    number: u32,
    /// Names for rays that are stopped at random.
    names: [u32; 2],
}

/// As [`Worker::run`].
pub fn run(worker: &mut Worker, job: &Job, tile: &mut Tile, from: u32, to: u32, step: u32) {
    if job.settings.partial_coverage {
        run_covered(worker, job, &SceneCoverage::new(job.scene), tile, from, to, step);
    } else {
        run_covered(worker, job, &Solid, tile, from, to, step);
    }
}

fn run_covered<C: Coverage>(
    worker: &mut Worker,
    job: &Job,
    coverage: &C,
    tile: &mut Tile,
    from: u32,
    to: u32,
    step: u32,
) {
    let mut tally = worker.open(job, tile, from, to, step);
    let mut tree =
        Tree { job, coverage, stacks: Stacks::default(), worker, lights: lamps(job.scene), balls: balls(job.scene) };
    for sample in (from..to).step_by(step as usize) {
        for slot in 0..tile.width * tile.height {
            let (x, y) = (tile.x + slot % tile.width, tile.y + slot / tile.width);
            let (hash, index, (origin, direction, t_max)) = job.camera_ray([x, y], sample);
            let ray = Branch { origin, direction, t_max, throughput: V3::splat(1.0), depth: 0, medium: NONE };
            let mut sample = Sample { tally: &mut tally, slot, number: sample, names: [hash, index] };
            tree.worker.counters.rays.camera += 1;
            tree.follow(ray, &mut sample);
        }
        tile.samples[replica(sample)] += 1;
    }
    worker.close(tally, tile);
}

/// Where a facet is looked for: its middle, with what it sends from there, as if all came from that point.
#[derive(Clone, Copy)]
struct Lamp {
    /// Row as light is chosen by.
    row: u32,
    at: [f32; 3],
    error: [f32; 3],
    n: [f32; 3],
    /// Radiance times area, nit·m².
    power: [f32; 3],
    two_sided: bool,
}

/// A lamp of many facets, or of a formula: as much as a ball of that surface sends to all sides, from its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Ball {
    /// Row as light is chosen by, of one of its facets.
    row: u32,
    instance: u32,
    at: [f32; 3],
    /// L·A/4, cd: a convex surface shows a quarter of itself on average (Cauchy).
    intensity: [f32; 3],
}

/// By instance, the rows of its facets.
fn facets_of(scene: &FlatScene) -> BTreeMap<u32, Vec<usize>> {
    let mut rows: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (row, &instance) in scene.lights.triangles.instance.iter().enumerate() {
        rows.entry(instance).or_default().push(row);
    }
    rows
}

fn balls(scene: &FlatScene) -> Vec<Ball> {
    let lights = &scene.lights;
    let of_facets = |(&instance, rows): (&u32, &Vec<usize>)| {
        let (mut at, mut area, mut intensity) = ([0.0; 3], 0.0, [0.0; 3]);
        for lamp in rows.iter().map(|&row| facet(scene, row)) {
            let own = lights.triangles.area[lamp.row as usize];
            (0..3).for_each(|i| at[i] += own * lamp.at[i]);
            (0..3).for_each(|i| intensity[i] += 0.25 * lamp.power[i]);
            area += own;
        }
        Ball { row: rows[0] as u32, instance, at: at.map(|x| x / area), intensity }
    };
    let mut balls: Vec<Ball> = facets_of(scene).iter().filter(|(_, rows)| rows.len() > MANY).map(of_facets).collect();
    balls.extend((0..lights.shapes.len()).map(|i| {
        let light = lights.shapes.row(i);
        let m = scene.instances.world_from_local[light.instance as usize];
        let intensity = light.radiance.map(|c| 0.25 * light.world_area * c);
        Ball { row: lights.first_shape() + i as u32, instance: light.instance, at: [m[3], m[7], m[11]], intensity }
    }));
    balls
}

fn lamps(scene: &FlatScene) -> Vec<Lamp> {
    let few = facets_of(scene).into_values().filter(|rows| rows.len() <= MANY);
    few.flatten().map(|row| facet(scene, row)).collect()
}

fn facet(scene: &FlatScene, row: usize) -> Lamp {
    let triangles = &scene.lights.triangles;
    let (p, e1, e2) = (triangles.p0[row], triangles.e1[row], triangles.e2[row]);
    let share = if triangles.four[row] == 1 { 0.5 } else { 1.0 / 3.0 };
    let texel = if triangles.texture[row] == NONE { [1.0; 4] } else { direct::texel(scene, row, share, share) };
    Lamp {
        row: row as u32,
        at: std::array::from_fn(|i| p[i] + share * (e1[i] + e2[i])),
        error: triangles.error[row],
        n: triangles.n[row],
        power: std::array::from_fn(|i| triangles.radiance[row][i] * texel[i] * triangles.area[row]),
        two_sided: triangles.two_sided[row] == 1,
    }
}

struct Tree<'a, 'b, C> {
    job: &'a Job<'b>,
    coverage: &'a C,
    stacks: Stacks,
    worker: &'a mut Worker,
    lights: Vec<Lamp>,
    balls: Vec<Ball>,
}

impl<C: Coverage> Tree<'_, '_, C> {
    fn name(&self, sample: &Sample, depth: u32, kind: u32) -> u32 {
        let [hash, index] = sample.names;
        if self.job.settings.blends { ray_id(hash, index, depth, kind) } else { 0 }
    }

    fn add(&self, sample: &mut Sample, light: Rgb<f32>, scatterings: u32, source: Source) {
        let scene = self.job.scene;
        let label = |ledger: &Ledger| ledger.label(scene, scatterings, source);
        sample.tally.add(sample.slot, sample.number, light.lane(0), label);
    }

    /// Adds what a ray sees.
    fn follow(&mut self, mut ray: Branch, sample: &mut Sample) {
        let (scene, settings) = (self.job.scene, &self.job.settings);
        let id = self.name(sample, ray.depth, 0);
        let hit = scene.accel.nearest(ray.origin, ray.direction, ray.t_max, id, self.coverage, &mut self.stacks);
        if hit.instance == NONE {
            if let Some(sky) = &scene.lights.environment
                && !(settings.transparent && ray.depth == 0)
            {
                let radiance = match sky {
                    EnvironmentLight::Constant(radiance) => V3::from_array(*radiance),
                    EnvironmentLight::Map(map) => map.look_up::<f32>(V3::from_array(ray.direction)).0,
                };
                self.add(sample, ray.throughput * radiance, ray.depth, Source::Sky);
            }
            return;
        }
        let material = scene.material_of(hit.instance, hit.triangle);
        if settings.absorbs {
            let medium = medium_of(scene, ray.medium, material, hit.back);
            if medium != NONE {
                let keep = scene.materials.absorption[medium as usize].map(|a| (-a * hit.t).exp());
                ray.throughput = ray.throughput * V3::from_array(keep);
            }
        }
        let bits = scene.materials.flags[material as usize];
        let lookups = &mut self.worker.counters.texture_lookups;
        if bits & flags::EMISSIVE != 0 {
            let light = V3::<f32>::from_array(emit::emitted(scene, material, &hit, lookups));
            self.add(sample, ray.throughput * light, ray.depth, Source::Instance(hit.instance));
        }
        let lookups = &mut self.worker.counters.texture_lookups;
        if bits & flags::UNLIT != 0 {
            let light = V3::<f32>::from_array(emit::unlit(scene, material, &hit, lookups));
            self.add(sample, ray.throughput * light, ray.depth, Source::Instance(hit.instance));
            return;
        }
        if ray.depth < settings.max_depth {
            self.scatter(&ray, &hit, material, sample);
        }
    }

    fn scatter(&mut self, ray: &Branch, hit: &Hit, material: u32, sample: &mut Sample) {
        let (scene, settings) = (self.job.scene, &self.job.settings);
        let incoming = Incoming::<f32> {
            direction: V3::from_array(ray.direction),
            b1: hit.b1,
            b2: hit.b2,
            back: hit.back,
            instance: [hit.instance; 8],
            triangle: [hit.triangle; 8],
            material: [material; 8],
        };
        let (fix, lookups) = (settings.terminator_fix, &mut self.worker.counters.texture_lookups);
        let surface = if scene.materials.flags[material as usize] & flags::TEXTURED != 0 {
            surface::interact::<f32, true>(scene, &incoming, Parts::All, fix, lookups)
        } else {
            surface::interact::<f32, false>(scene, &incoming, Parts::All, fix, lookups)
        };
        let bsdf = Transmissive::prepare(&surface.params, surface.wo_local);
        if Transmissive::scatters(&bsdf).any() {
            self.lit_by_lamps(ray, &surface, &bsdf, sample);
        }
        let most = settings.max_depth.min(MOST_DEPTH);
        for lobe in Transmissive::deltas(&bsdf) {
            let throughput = ray.throughput * lobe.weight;
            if !lobe.valid || ray.depth >= most || (throughput * lobe.eta_scale).max_element() < LEAST {
                continue;
            }
            let direction = surface.frame.to_world(lobe.wi);
            let (above, below) = surface.sides(direction, lobe.wi);
            if !(if lobe.transmitted { below } else { above }) {
                continue;
            }
            let (solid, inside) = (surface.params.solid, surface.params.inside);
            let next = Branch {
                origin: surface.leave_at(above, false).lane(0),
                direction: direction.lane(0),
                t_max: f32::INFINITY,
                throughput,
                depth: ray.depth + 1,
                medium: medium_behind(ray.medium, material, solid, inside, lobe.transmitted),
            };
            self.worker.counters.rays.bounce += 1;
            self.follow(next, sample);
        }
    }

    /// Adds the light of every lamp that nothing is in the way of.
    fn lit_by_lamps(
        &mut self,
        ray: &Branch,
        surface: &Surface<f32>,
        bsdf: &<Transmissive as Bsdf>::Prepared<f32>,
        sample: &mut Sample,
    ) {
        let lights = &self.job.scene.lights;
        for row in 0..self.lights.len() {
            let Lamp { row, at, error, n, power, two_sided } = self.lights[row];
            let (at, n) = (V3::<f32>::from_array(at), V3::<f32>::from_array(n));
            let to = at - surface.p;
            let distance2 = to.length_squared().max(f32::MIN_POSITIVE);
            let wi = to * (1.0 / distance2.sqrt());
            let cos = -wi.dot(n);
            if cos > 0.0 || (two_sided && cos < 0.0) {
                let light = V3::from_array(power) * (cos.abs() / distance2);
                // As a light sample: off the lamp by its own error.
                let end = n.scale_add(n.abs().dot(V3::from_array(error)).copysign(cos), at);
                self.lit_from(ray, surface, bsdf, Some(end), wi, light, row, sample);
            }
        }
        for i in 0..lights.local.len() {
            let light = lights.local.row(i);
            let at = V3::<f32>::from_array(light.position);
            let to = at - surface.lifted;
            let distance2 = to.length_squared().max(f32::MIN_POSITIVE);
            let wi = to * (1.0 / distance2.sqrt());
            let cos = -wi.dot(V3::from_array(light.axis));
            let falloff = cos.mul_add(light.cos_scale, light.cos_offset).clamp(0.0, 1.0);
            if falloff > 0.0 {
                let arriving = V3::from_array(light.intensity) * (falloff * falloff / distance2);
                self.lit_from(ray, surface, bsdf, Some(at), wi, arriving, lights.first_local() + i as u32, sample);
            }
        }
        for i in 0..lights.distant.len() {
            let light = lights.distant.row(i);
            let (wi, arriving) = (V3::from_array(light.to_light), V3::from_array(light.illuminance));
            self.lit_from(ray, surface, bsdf, None, wi, arriving, lights.first_distant() + i as u32, sample);
        }
        for i in 0..self.balls.len() {
            let Ball { row, instance, at, intensity } = self.balls[i];
            let to = V3::<f32>::from_array(at) - surface.p;
            let distance2 = to.length_squared().max(f32::MIN_POSITIVE);
            let wi = to * (1.0 / distance2.sqrt());
            let up = surface.frame.to_local(wi).z > 0.0;
            // As far as the lamp's own surface.
            let (id, start) = (self.name(sample, ray.depth, 2), surface.leave(up).lane(0));
            let accel = &self.job.scene.accel;
            let met = accel.nearest(start, wi.lane(0), f32::INFINITY, id, self.coverage, &mut self.stacks);
            self.worker.counters.rays.shadow += 1;
            if met.instance == instance {
                let arriving = V3::from_array(intensity) * (1.0 / distance2);
                self.reflect(ray, surface, bsdf, wi, arriving, row, sample);
            }
        }
    }

    /// Adds what a surface makes of light from a direction, if nothing is in its way; `end` is where it comes from.
    fn lit_from(
        &mut self,
        ray: &Branch,
        surface: &Surface<f32>,
        bsdf: &<Transmissive as Bsdf>::Prepared<f32>,
        end: Option<V3<f32>>,
        wi: V3<f32>,
        arriving: Rgb<f32>,
        row: u32,
        sample: &mut Sample,
    ) {
        let up = surface.frame.to_local(wi).z > 0.0;
        let origin = surface.leave(up);
        let (direction, t_max) = end.map_or((wi, f32::INFINITY), |end| (end - origin, BEFORE_LIGHT));
        let id = self.name(sample, ray.depth, 1);
        let scene = self.job.scene;
        self.worker.counters.rays.shadow += 1;
        let (start, way) = (origin.lane(0), direction.lane(0));
        if !scene.accel.occluded(start, way, t_max, id, self.coverage, &mut self.stacks) {
            self.reflect(ray, surface, bsdf, wi, arriving, row, sample);
        }
    }

    fn reflect(
        &self,
        ray: &Branch,
        surface: &Surface<f32>,
        bsdf: &<Transmissive as Bsdf>::Prepared<f32>,
        wi: V3<f32>,
        arriving: Rgb<f32>,
        row: u32,
        sample: &mut Sample,
    ) {
        let local = surface.frame.to_local(wi);
        let (above, below) = surface.sides(wi, local);
        if above | below {
            let (f, _) = Transmissive::eval(bsdf, local);
            self.add(sample, ray.throughput * f * arriving, ray.depth + 1, Source::Chosen(row));
        }
    }
}
