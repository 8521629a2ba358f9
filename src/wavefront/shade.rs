//! Scatters paths at surfaces: samples a light for the shadow queue, and the BSDF for the next ray.

use wide::{f32x8, u32x8};

use super::{
    Settings, ahead, caustic, dimensions, direct, lobes,
    queues::{HitQueue, PathBlock, PathQueue, ShadowBlock, ShadowQueue},
    resample::{Candidate, Place},
    reuse::{FIRST, Glimpse, Reuse, SHARED},
    stats::{Blocks, Counters},
    surface::{self, Incoming, Parts, Surface},
    taken::Taken,
    tally::Tally,
};
use crate::{
    bsdf::Bsdf,
    flat::{FlatScene, NONE, SceneNeeds},
    light::Receiver,
    sampling::Sampler,
    simd::{Bits, LANES, Mask, Real, Rgb, V3},
};

/// Share of the way to a light that must be clear: all of it but for the rounding of a distance.
pub const BEFORE_LIGHT: f32 = 1.0 - 8.0 * f32::EPSILON;

/// Paths at surfaces, one per lane.
#[derive(Clone, Copy, Debug)]
pub struct Arrived<F: Real> {
    /// Hits.
    pub hits: Incoming<F>,
    /// Lanes that carry a path.
    pub active: u32,
    /// As in the path queue.
    pub throughput: Rgb<F>,
    /// As in the path queue.
    pub eta_scale: F,
    /// As in the path queue.
    pub slot: [u32; 8],
    /// As in the path queue.
    pub sample: [u32; 8],
    /// As in the path queue.
    pub index: [u32; 8],
    /// As in the path queue.
    pub pixel_hash: [u32; 8],
    /// As in the path queue.
    pub depth: [u32; 8],
    /// As in the path queue.
    pub medium: [u32; 8],
}

/// A shadow ray per lane, with what it carries.
#[derive(Clone, Copy, Debug)]
pub struct Connection<F: Real> {
    /// Start, m.
    pub origin: V3<F>,
    /// Direction; of any length.
    pub direction: V3<F>,
    /// End, in units of the direction.
    pub t_max: F,
    /// What the pixel gets, nit.
    pub light: Rgb<F>,
    /// Where that goes.
    pub slot: [u32; 8],
    /// Rows of the lights.
    pub row: [u32; 8],
    /// Lanes that have one.
    pub lanes: u32,
}

/// The next ray per lane.
#[derive(Clone, Copy, Debug)]
pub struct Departure<F: Real> {
    /// Start, m.
    pub origin: V3<F>,
    /// Unit direction.
    pub direction: V3<F>,
    /// After this scattering.
    pub throughput: Rgb<F>,
    /// Density of the direction, 0 for a delta.
    pub pdf: F,
    /// After this scattering.
    pub eta_scale: F,
    /// Material row of the solid that the ray is inside.
    pub medium: [u32; 8],
    /// The side that it leaves to.
    pub side: [u32; 8],
    /// Where its light goes.
    pub slot: [u32; 8],
    /// Where its numbers come from from here on.
    pub index: [u32; 8],
    /// As above.
    pub pixel_hash: [u32; 8],
    /// Lanes that go on.
    pub lanes: u32,
}

/// The solid that a ray is inside after it left a surface.
#[inline(always)]
pub(super) fn medium_behind(medium: u32, material: u32, solid: bool, inside: bool, transmitted: bool) -> u32 {
    match (solid && transmitted, inside) {
        (true, true) => NONE,
        (true, false) => material,
        (false, _) => medium,
    }
}

/// What a surface is to its path's neighbours, lane by lane, and what of the path goes on under its own name.
struct Role<F: Real> {
    /// The first surface of a path that takes part.
    near: u32,
    /// The second one: what is found from here on belongs to it.
    far: u32,
    throughput: Rgb<F>,
    eta_scale: F,
    slot: [u32; 8],
}

impl<F: Real> Role<F> {
    /// None.
    #[inline(always)]
    fn alone(at: &Arrived<F>) -> Self {
        Self { near: 0, far: 0, throughput: at.throughput, eta_scale: at.eta_scale, slot: at.slot }
    }
}

#[inline(always)]
fn role<F: Real>(at: &Arrived<F>, settings: &Settings, surface: &Surface<F>, reuse: &mut Reuse) -> Role<F> {
    let mut role = Role::alone(at);
    let early = (0..F::LANES).filter(|&lane| at.depth[lane] < 2).fold(0, |bits, lane| bits | 1 << lane);
    let mut lanes = at.active & early & Reuse::takes_part(&surface.params).bits();
    if settings.caustics {
        // Which of its light is left to light paths would not be the same for all who share it.
        lanes &= !surface.is_lifted.bits();
    }
    // What is left to light paths depends on where shiny surfaces are seen from.
    let matt = surface.params.specular.max(surface.params.metallic).le(F::zero()).bits();
    for lane in (0..F::LANES).filter(|lane| lanes >> lane & 1 == 1) {
        if at.medium[lane] != NONE {
            continue;
        }
        if at.depth[lane] == 0 {
            role.near |= 1 << lane;
        } else if settings.shares.surface
            && (settings.suns == f32::INFINITY || matt >> lane & 1 == 1)
            && reuse.awaits_far(at.slot[lane], at.sample[lane])
            && surface.bent.bits() >> lane & 1 == 0
        {
            role.far |= 1 << lane;
            reuse.keep_far(surface, at, lane);
            role.slot[lane] |= SHARED;
        }
    }
    if role.far != 0 {
        let far = F::Mask::from_bits(role.far);
        // Roulette goes on by what the path brings its own pixel.
        role.eta_scale = F::select(far, at.eta_scale * at.throughput.max_element(), at.eta_scale);
        role.throughput = V3::select(far, V3::splat(1.0), at.throughput);
    }
    role
}

/// Lanes whose surface is the first of its path.
#[inline(always)]
fn first_surfaces<F: Real>(at: &Arrived<F>) -> u32 {
    (0..F::LANES).filter(|&lane| at.depth[lane] == 0).fold(0, |bits, lane| bits | 1 << lane)
}

/// One scattering: the kernel behind [`shade`], for eight lanes or one.
///
/// Contributions along the connection and the departure are complete but for visibility and roulette.
#[inline(always)]
pub fn scatter<F: Real, B: Bsdf, const TEXTURED: bool>(
    scene: &FlatScene,
    settings: &Settings,
    sampler: &Sampler,
    at: &Arrived<F>,
    parts: Parts,
    reuse: &mut Reuse,
    counters: &mut Counters,
) -> (Connection<F>, Departure<F>) {
    let fix = settings.terminator_fix;
    let surface = surface::interact::<F, TEXTURED>(scene, &at.hits, parts, fix, &mut counters.texture_lookups);
    let prepared = B::prepare(&surface.params, surface.wo_local);
    let active = F::Mask::from_bits(at.active);
    let bits = |values: &[u32; 8]| F::Bits::from_fn(|lane| values[lane]);
    let depth = bits(&at.depth);
    let (pixel_hash, index) = (bits(&at.pixel_hash), bits(&at.index));
    let pair = |decision| sampler.pair::<F>(pixel_hash, index, dimensions::at::<F>(depth, decision));
    // Side by side, since each waits for one product after another.
    let u_light = if settings.sample_lights { pair(dimensions::LIGHT) } else { (F::zero(), F::zero()) };
    let u_direction = pair(dimensions::DIRECTION);
    // One light is no choice, and one lobe neither.
    let chooses = B::CHOOSES || settings.only_flat_light.is_none();
    let (u_choice, u_lobe) = if chooses { pair(dimensions::CHOICE) } else { (F::zero(), F::zero()) };
    let zero = F::zero();
    let transmissive = parts == Parts::All;
    let solids = if transmissive { surface.params.solid.bits() } else { 0 };
    let insides = if transmissive { surface.params.inside.bits() } else { 0 };
    let behind = |lane: usize, transmitted: u32| {
        let bit = |mask: u32| mask >> lane & 1 == 1;
        medium_behind(at.medium[lane], at.hits.material[lane], bit(solids), bit(insides), bit(transmitted))
    };

    let Role { near, far, throughput, eta_scale, slot } =
        if settings.shares.any() && !transmissive { role(at, settings, &surface, reuse) } else { Role::alone(at) };

    let reflected = F::Mask::splat(true);
    let start = if near == 0 { surface.p } else { surface.leave(reflected) };
    let sky_pmf = |lane: usize| {
        let sides = direct::sides(settings, &surface, reflected, false);
        scene.lights.choice.sky_pmf(&Receiver::new(start.lane(lane), sides.lane(lane)))
    };

    let mut connection = Connection {
        origin: surface.p,
        direction: surface.wo,
        t_max: zero,
        light: V3::splat(0.0),
        slot,
        row: [NONE; 8],
        lanes: 0,
    };
    let lit = active & B::scatters(&prepared);
    if settings.sample_lights && lit.any() {
        let place = Place::<F, B> {
            scene,
            settings,
            sampler,
            surface: &surface,
            prepared: &prepared,
            throughput,
            transmissive,
            pixel_hash,
            index,
            depth,
        };
        let lookups = &mut counters.light_lookups;
        // What pixels share of the sky is known by the density of a single sample.
        let shares_sky = settings.shares.sky || settings.shares.lit;
        let first = if parts == Parts::Opaque && !shares_sky { lit.bits() & first_surfaces::<F>(at) } else { 0 };
        let chosen = if first == 0 {
            place.candidate(lit, u_choice, u_light, lookups)
        } else {
            place.best(lit, F::Mask::from_bits(first), lookups)
        };
        let Candidate { light, f, pdf, mut carried, below, reached } = chosen;
        if reached.any() {
            let origin = light.origin;
            let direction = V3::select(light.near, light.target - origin, light.target);
            if settings.absorbs {
                let reach = light.near.bits();
                let transmitted = below.bits();
                let keep: Rgb<F> = V3::from_fn(|lane| match behind(lane, transmitted) {
                    medium if medium != NONE && reach >> lane & 1 == 1 => {
                        let [x, y, z] = direction.lane(lane);
                        let length = (x * x + y * y + z * z).sqrt();
                        scene.materials.absorption[medium as usize].map(|a| (-a * length).exp())
                    }
                    _ => [1.0; 3],
                });
                carried = carried * keep;
            }
            for lane in (0..F::LANES).filter(|lane| far >> lane & 1 == 1) {
                let kept = reuse.far_of(at.slot[lane], at.sample[lane]);
                (kept.to_light, kept.f_light) = (light.wi.lane(lane), f.lane(lane));
            }
            let mut lanes = reached & !carried.max_element().eq(zero);
            if settings.suns < f32::INFINITY && light.sky != 0 {
                let exact = !surface.is_lifted | below;
                let radiance = light.light * light.pdf;
                for lane in (0..F::LANES).filter(|lane| (light.sky & exact.bits()) >> lane & 1 == 1) {
                    // As it would be if a scattered ray had found it.
                    let (eta_scale, depth) = (at.eta_scale.lane(lane), at.depth[lane] + 1);
                    let pdf = pdf.lane(lane);
                    if pdf > 0.0 && caustic::is_of_sun(settings.suns, eta_scale, pdf, depth, radiance.lane(lane)) {
                        lanes = lanes & !F::Mask::from_bits(1 << lane);
                    }
                }
            }
            let shared = if settings.shares.lit { near & light.sky } else { 0 }
                & reached.bits()
                & light.wi.dot(surface.ng).gt(zero).bits();
            if shared != 0 {
                lanes = lanes & !F::Mask::from_bits(shared);
                for lane in (0..F::LANES).filter(|lane| shared >> lane & 1 == 1) {
                    let pdf = light.pdf.lane(lane);
                    let density = pdf / sky_pmf(lane);
                    let radiance = light.light.lane(lane).map(|light| light * pdf);
                    let direction = light.wi.lane(lane);
                    let glimpse = Glimpse { direction, radiance, density, alone: [0.0; 3] };
                    reuse.keep_lit(at.slot[lane], at.sample[lane], glimpse);
                }
            }
            connection = Connection {
                origin,
                direction,
                t_max: F::select(light.near, F::splat(BEFORE_LIGHT), F::splat(f32::INFINITY)),
                light: carried,
                slot: std::array::from_fn(|lane| if far >> lane & 1 == 1 { slot[lane] | FIRST } else { slot[lane] }),
                row: light.rows,
                lanes: lanes.bits(),
            };
        }
    }

    let (mut hash_on, mut index_on) = (at.pixel_hash, at.index);
    let (u_lobe, u_direction) = if near != 0 && settings.shares.scattered() {
        // What they find is for all of them, and so they look for it as one: their numbers are one sequence.
        for lane in (0..F::LANES).filter(|lane| near >> lane & 1 == 1) {
            (hash_on[lane], index_on[lane]) = reuse.key(sampler, settings.shares.group, at.slot[lane], at.sample[lane]);
        }
        let (pixel_hash, index) = (bits(&hash_on), bits(&index_on));
        let pair = |decision| sampler.pair::<F>(pixel_hash, index, dimensions::at::<F>(depth, decision));
        let u_lobe = if !B::CHOOSES { u_lobe } else { pair(dimensions::CHOICE).1 };
        (u_lobe, pair(dimensions::DIRECTION))
    } else {
        (u_lobe, u_direction)
    };
    let drawn = B::sample(&prepared, u_lobe, u_direction);
    let wi = surface.frame.to_world(drawn.wi);
    let (above, below) = surface.sides(wi, drawn.wi);
    let agrees = if transmissive { (above & !drawn.transmitted) | (below & drawn.transmitted) } else { above };
    let throughput = throughput * drawn.weight;
    let goes_on = active & drawn.valid & agrees & throughput.max_element().gt(zero);
    if (near | far) != 0 {
        let others = goes_on & drawn.pdf.gt(zero);
        let f = drawn.weight * drawn.pdf;
        for lane in 0..F::LANES {
            if near >> lane & 1 == 1 {
                let row = reuse.row(at.slot[lane], at.sample[lane]);
                let on = others.bits() >> lane & 1 == 1;
                let sky = if settings.sample_lights { sky_pmf(lane) } else { 0.0 };
                reuse.keep_near(row, &surface, start, at.throughput, sky, on, lane);
            } else if far >> lane & 1 == 1 {
                let kept = reuse.far_of(at.slot[lane], at.sample[lane]);
                (kept.to_next, kept.f_next) = (wi.lane(lane), f.lane(lane));
            }
        }
    }
    let transmitted = if transmissive { drawn.transmitted.bits() } else { 0 };
    let mut medium = at.medium;
    if settings.absorbs {
        (0..F::LANES).for_each(|lane| medium[lane] = behind(lane, transmitted));
    }
    let mut eta_scale = eta_scale * drawn.eta_scale;
    if settings.caustics {
        eta_scale = caustic::marked(scene, &at.hits.material, &at.depth, at.eta_scale, &surface, &drawn, eta_scale);
    }
    let sides = direct::sides(settings, &surface, above, transmissive);
    let departure = Departure {
        origin: surface.leave_at(above, above & !drawn.delta),
        direction: wi,
        throughput,
        pdf: drawn.pdf,
        eta_scale,
        medium,
        slot,
        index: index_on,
        pixel_hash: hash_on,
        side: std::array::from_fn(|lane| sides.lane(lane % F::LANES)),
        lanes: goes_on.bits(),
    };
    (connection, departure)
}

/// Gathers the rows of one block; paths at their greatest depth rest.
#[inline(always)]
fn gather<const NEAR: bool>(
    taken: &Taken,
    rows: usize,
    materials: &[u32],
    max_depth: u32,
    paths: &PathQueue,
    hits: &HitQueue,
) -> Arrived<f32x8> {
    let number = |column: &[f32]| f32x8::new(taken.of::<NEAR, f32>(column));
    let bits = |column: &[u32]| taken.of::<NEAR, u32>(column);
    let (depth, back) = (bits(&paths.depth), bits(&hits.back));
    let goes_on = u32x8::new(depth).simd_lt(u32x8::splat(max_depth)).to_bitmask();
    let incoming = Incoming {
        direction: V3::new(number(&paths.dx), number(&paths.dy), number(&paths.dz)),
        b1: number(&hits.b1),
        b2: number(&hits.b2),
        back: Mask::from_bits(u32x8::new(back).simd_gt(u32x8::ZERO).to_bitmask()),
        instance: bits(&hits.instance),
        triangle: bits(&hits.triangle),
        material: bits(materials),
    };
    Arrived {
        hits: incoming,
        active: goes_on & ((1 << rows) - 1),
        throughput: V3::new(number(&paths.throughput_r), number(&paths.throughput_g), number(&paths.throughput_b)),
        eta_scale: number(&paths.eta_scale),
        slot: bits(&paths.slot),
        sample: bits(&paths.sample),
        index: bits(&paths.index),
        pixel_hash: bits(&paths.pixel_hash),
        depth,
        medium: bits(&paths.medium),
    }
}

/// Scatters the paths in `rows`, which are all of one shading class.
///
/// Shadow rays go to `shadows`, paths that go on to `next`.
pub fn shade<B: Bsdf, const TEXTURED: bool>(
    scene: &FlatScene,
    settings: &Settings,
    sampler: &Sampler,
    rows: &[u32],
    materials: &[u32],
    parts: Parts,
    paths: &PathQueue,
    hits: &HitQueue,
    shadows: &mut ShadowQueue,
    next: &mut PathQueue,
    tally: &mut Tally,
    counters: &mut Counters,
) -> Blocks {
    let mut blocks = Blocks::default();
    // The rows of a block that comes so many later.
    let later = |from: usize, blocks: usize| {
        let first = (from + blocks * LANES).min(rows.len());
        &rows[first..(first + LANES).min(rows.len())]
    };
    if settings.asks_ahead {
        (0..ahead::VERTICES).for_each(|blocks| ahead::vertices(scene, later(0, blocks), hits));
        if TEXTURED {
            (0..ahead::TEXELS).for_each(|blocks| ahead::texels(scene, later(0, blocks), materials, hits));
        }
    }
    for (block, rows) in rows.chunks(LANES).enumerate() {
        if settings.asks_ahead {
            ahead::vertices(scene, later(block * LANES, ahead::VERTICES), hits);
            if TEXTURED {
                ahead::texels(scene, later(block * LANES, ahead::TEXELS), materials, hits);
            }
        }
        let taken = Taken::new(rows);
        let at = if taken.is_near(hits.len()) {
            gather::<true>(&taken, rows.len(), materials, settings.max_depth, paths, hits)
        } else {
            gather::<false>(&taken, rows.len(), materials, settings.max_depth, paths, hits)
        };
        if at.active == 0 {
            continue;
        }
        blocks += Blocks::one(at.active.count_ones());
        let (connection, departure) =
            scatter::<f32x8, B, TEXTURED>(scene, settings, sampler, &at, parts, &mut tally.reuse, counters);
        if let Some(ledger) = &mut tally.ledger {
            let fix = settings.terminator_fix;
            lobes::note::<f32x8, B, TEXTURED>(scene, fix, &at, parts, &connection, &departure, ledger);
        }
        push_connections(&at, &connection, shadows, settings.blends);
        push_departures(&at, &departure, settings.reach, next);
    }
    debug_assert!(scene.needs.has(SceneNeeds::TEXTURES) || scene.needs.has(SceneNeeds::VERTEX_COLORS) || !TEXTURED);
    blocks
}

#[inline(always)]
fn push_connections(at: &Arrived<f32x8>, c: &Connection<f32x8>, shadows: &mut ShadowQueue, blends: bool) {
    let mut ray_id = [0; LANES];
    if blends {
        ray_id = std::array::from_fn(|i| dimensions::ray_id(at.pixel_hash[i], at.index[i], at.depth[i], 1));
    }
    let block = ShadowBlock {
        ox: c.origin.x.to_array(),
        oy: c.origin.y.to_array(),
        oz: c.origin.z.to_array(),
        dx: c.direction.x.to_array(),
        dy: c.direction.y.to_array(),
        dz: c.direction.z.to_array(),
        t_max: c.t_max.to_array(),
        ray_id,
        light_r: c.light.x.to_array(),
        light_g: c.light.y.to_array(),
        light_b: c.light.z.to_array(),
        slot: c.slot,
        sample: at.sample,
    };
    shadows.put(&block, c.lanes);
}

#[inline(always)]
fn push_departures(at: &Arrived<f32x8>, d: &Departure<f32x8>, reach: f32, next: &mut PathQueue) {
    let block = PathBlock {
        ox: d.origin.x.to_array(),
        oy: d.origin.y.to_array(),
        oz: d.origin.z.to_array(),
        dx: d.direction.x.to_array(),
        dy: d.direction.y.to_array(),
        dz: d.direction.z.to_array(),
        t_max: [reach; LANES],
        throughput_r: d.throughput.x.to_array(),
        throughput_g: d.throughput.y.to_array(),
        throughput_b: d.throughput.z.to_array(),
        pdf: d.pdf.to_array(),
        eta_scale: d.eta_scale.to_array(),
        slot: d.slot,
        sample: at.sample,
        index: d.index,
        pixel_hash: d.pixel_hash,
        depth: at.depth.map(|depth| depth + 1),
        medium: d.medium,
        side: d.side,
    };
    next.put(&block, d.lanes);
}
