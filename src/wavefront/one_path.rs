//! One path at a time: the same kernels with one lane and no queues, as the measure of what the wavefront gains.
//!
//! The picture is the wavefront's to the last bit. For benchmarks and tests.

use super::{
    Job, Worker, absorb,
    bounce::{ROULETTE_FROM, most_survivors, survival},
    caustic,
    coverage::SceneCoverage,
    dimensions::{self, ray_id},
    emit,
    ledger::Ledger,
    lobes, parts_of,
    reuse::{FIRST, SHARED},
    schedule,
    shade::{self, Arrived, Connection, Departure},
    sky,
    stats::Counters,
    surface::{Incoming, Parts},
    tally::Tally,
};
use crate::{
    accel::{Coverage, Solid, Stacks},
    bsdf::{Bsdf, Lambert, Opaque, Transmissive},
    film::Tile,
    flat::{FlatScene, NONE, ShadingClass, Source, flags},
    light::Receiver,
    render::{Observer, RenderSettings, Rendered},
    sampling::replica,
    simd::{Bits, Real, V3},
};

/// Makes the picture of [`render`](super::render) one path at a time. Layers are left black.
pub fn render_one_path(scene: &FlatScene, settings: &RenderSettings, observer: &dyn Observer) -> Rendered {
    schedule::render_by(scene, settings, observer, run)
}

/// As [`Worker::run`].
pub(super) fn run(worker: &mut Worker, job: &Job, tile: &mut Tile, from: u32, to: u32, step: u32) {
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
    let mut stacks = Stacks::default();
    let mut tally = worker.open(job, tile, from, to, step);
    for sample in (from..to).step_by(step as usize) {
        for slot in 0..tile.width * tile.height {
            let (x, y) = (tile.x + slot % tile.width, tile.y + slot / tile.width);
            trace(job, coverage, [x, y], slot, sample, &mut tally, &mut worker.counters, &mut stacks);
        }
        tile.samples[replica(sample)] += 1;
    }
    if job.settings.shares.any() {
        let rectangle = [tile.x, tile.y, tile.width, tile.height];
        worker.joiner.join(job, coverage, rectangle, from, to, step, &mut tally, &mut worker.counters);
    }
    worker.close(tally, tile);
}

type Integer = <f32 as Real>::Bits;

/// Follows one path to its end.
fn trace<C: Coverage>(
    job: &Job,
    coverage: &C,
    [x, y]: [u32; 2],
    slot: u32,
    sample: u32,
    tally: &mut Tally,
    counters: &mut Counters,
    stacks: &mut Stacks,
) {
    let Job { scene, settings, sampler, .. } = job;
    let (pixel_hash, first, ray) = job.camera_ray([x, y], sample);
    let (mut hash, mut index) = (pixel_hash, first);
    let name = |depth, kind| if settings.blends { ray_id(pixel_hash, first, depth, kind) } else { 0 };
    let (mut origin, mut direction, mut t_max) = ray;
    let mut throughput = V3::splat(1.0);
    let (mut pdf, mut eta_scale, mut medium, mut side, mut slot) = (0.0, 1.0, NONE, 0, slot);
    counters.rays.camera += 1;
    for depth in 0.. {
        let hit = scene.accel.nearest(origin, direction, t_max, name(depth, 0), coverage, stacks);
        if hit.instance == NONE {
            if let Some(environment) = &scene.lights.environment
                && !(settings.transparent && depth == 0)
            {
                let direction = V3::from_array(direction);
                let seen = sky::seen::<f32>(scene, environment, direction, pdf, |_| Receiver::new(origin, side));
                if caustic::is_of_sun(settings.suns, eta_scale, pdf, depth, seen.radiance.lane(0)) {
                    return;
                }
                let shares = settings.shares.sky && depth == 1;
                sky::add(scene, tally, shares, (slot, sample, depth), direction, &seen, throughput, 0);
            }
            return;
        }
        let material = scene.material_of(hit.instance, hit.triangle);
        if settings.absorbs {
            let medium = absorb::medium_of(scene, medium, material, hit.back);
            if medium != NONE {
                let keep = scene.materials.absorption[medium as usize].map(|a| (-a * hit.t).exp());
                throughput = throughput * V3::from_array(keep);
            }
        }
        if scene.materials.flags[material as usize] & flags::EMISSIVE != 0
            && !caustic::is_one(scene, eta_scale, pdf, &hit)
        {
            let light = emit::emitted(scene, material, &hit, &mut counters.texture_lookups);
            let weight = emit::weight(scene, pdf, &Receiver::new(origin, side), &hit, direction);
            tally.add(slot, sample, (throughput * V3::from_array(light) * weight).lane(0), |ledger| {
                ledger.label(scene, depth, Source::Instance(hit.instance))
            });
        }
        if scene.materials.flags[material as usize] & flags::UNLIT != 0 {
            let light = emit::unlit(scene, material, &hit, &mut counters.texture_lookups);
            tally.add(slot, sample, (throughput * V3::from_array(light)).lane(0), |ledger| {
                ledger.label(scene, depth, Source::Instance(hit.instance))
            });
            return;
        }
        if depth >= settings.max_depth {
            return;
        }
        let at = Arrived {
            hits: Incoming {
                direction: V3::from_array(direction),
                b1: hit.b1,
                b2: hit.b2,
                back: hit.back,
                instance: [hit.instance; 8],
                triangle: [hit.triangle; 8],
                material: [material; 8],
            },
            active: 1,
            throughput,
            eta_scale,
            slot: [slot; 8],
            sample: [sample; 8],
            index: [index; 8],
            pixel_hash: [hash; 8],
            depth: [depth; 8],
            medium: [medium; 8],
        };
        let (connection, departure) = scatter(job, scene.materials.class[material as usize], &at, tally, counters);
        if connection.lanes != 0 {
            counters.rays.shadow += 1;
            let (origin, direction) = (connection.origin.lane(0), connection.direction.lane(0));
            let id = name(depth, 1);
            if !scene.accel.occluded(origin, direction, connection.t_max, id, coverage, stacks) {
                let slot = connection.slot[0];
                let account = |ledger: &Ledger| ledger.expected(slot & !(SHARED | FIRST), sample);
                tally.add(slot, sample, connection.light.lane(0), account);
            }
        }
        if departure.lanes == 0 {
            return;
        }
        throughput = departure.throughput;
        eta_scale = departure.eta_scale;
        (hash, index) = (departure.pixel_hash[0], departure.index[0]);
        let q = survival(throughput.max_element(), eta_scale, most_survivors(depth + 1));
        if q < 1.0 && depth + 1 >= ROULETTE_FROM {
            let dimension = dimensions::at::<f32>(Integer::splat(depth), dimensions::ROULETTE);
            let u: f32 = sampler.one(Integer::splat(hash), Integer::splat(index), dimension);
            if u >= q {
                return;
            }
            throughput = throughput * (1.0 / q);
        }
        (origin, direction, t_max) = (departure.origin.lane(0), departure.direction.lane(0), settings.reach);
        (pdf, medium, side, slot) = (departure.pdf, departure.medium[0], departure.side[0], departure.slot[0]);
        counters.rays.bounce += 1;
    }
}

fn scatter(
    job: &Job,
    class: u32,
    at: &Arrived<f32>,
    tally: &mut Tally,
    counters: &mut Counters,
) -> (Connection<f32>, Departure<f32>) {
    let class = ShadingClass::SCATTERING.into_iter().find(|&c| c as u32 == class).unwrap_or(ShadingClass::Lambert);
    let run = match class {
        ShadingClass::Unlit | ShadingClass::Lambert => scatter_by::<Lambert, false>,
        ShadingClass::Opaque => scatter_by::<Opaque, false>,
        ShadingClass::OpaqueTextured => scatter_by::<Opaque, true>,
        ShadingClass::Transmissive => scatter_by::<Transmissive, false>,
        ShadingClass::TransmissiveTextured => scatter_by::<Transmissive, true>,
    };
    run(job, parts_of(class), at, tally, counters)
}

fn scatter_by<B: Bsdf, const TEXTURED: bool>(
    Job { scene, settings, sampler, .. }: &Job,
    parts: Parts,
    at: &Arrived<f32>,
    tally: &mut Tally,
    counters: &mut Counters,
) -> (Connection<f32>, Departure<f32>) {
    let (connection, departure) =
        shade::scatter::<f32, B, TEXTURED>(scene, settings, sampler, at, parts, &mut tally.reuse, counters);
    if let Some(ledger) = &mut tally.ledger {
        let fix = settings.terminator_fix;
        lobes::note::<f32, B, TEXTURED>(scene, fix, at, parts, &connection, &departure, ledger);
    }
    (connection, departure)
}
