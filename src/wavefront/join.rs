//! Joins the near vertices of neighbouring pixels with the far vertices that any of their paths found.
//!
//! With xᵢ the near vertices of a group, yⱼ the far ones and p(y | x) the density, per area, with which a path leaves x for y,
//! pixel i gets from each far vertex that it sees
//!
//! ```text
//! f(xᵢ → yⱼ) G(xᵢ, yⱼ) L(yⱼ → xᵢ) / Σₖ V(xₖ, yⱼ) p(yⱼ | xₖ)
//! ```
//!
//! which is the balance heuristic (Veach and Guibas 1995) between the group's paths, each of which might have found yⱼ: an
//! unbiased estimate for every pixel, and never above what the pixel's own path would have counted for the same vertex. L was
//! estimated as yⱼ's own path saw it; where the far surface is not Lambertian, what came from each of the two directions that
//! the path looked in is scaled by the BSDF's value there.
//!
//! A pair that fails a test (a normal, a distance, the shadow ray) is no pair for any of the uses above. If it is a path's own
//! pair, its light goes to its own pixel as if there were no others.

use std::array;

use wide::f32x8;

use super::{
    Job, caustic,
    groups::{MOST, SQUARE, pixel_of},
    ledger::{Found, JOINTS, of_lobe},
    queues::{LinkBlock, LinkQueue},
    reuse::{Far, Glimpse, KINDS, Near, Reuse, Vertex, stage},
    shade::BEFORE_LIGHT,
    stats::Counters,
    surface::least_mirror_height,
    tally::Tally,
};
use crate::{
    accel::{Coverage, Rays},
    bsdf::{Bsdf, Opaque, Params},
    film::{Event, Label},
    flat::{FlatScene, Source},
    sampling::mis,
    simd::{Frame, LANES, Mask, Real, Rgb, V3},
};

/// Blocks of near vertices at most.
const MOST_BLOCKS: usize = MOST / LANES;
/// Links that are traced at a time: enough to fill waves.
const LINKS: usize = 4096;

/// A far vertex and a block of near ones.
#[derive(Clone, Copy, Debug)]
struct Pairs {
    /// What the pixels get over the sum of densities, nit/m².
    light: Rgb<f32x8>,
    /// Density per area of the near vertices' finding the far one, 1/m².
    density: f32x8,
    /// Pairs that stand; after the shadow rays, those that see each other.
    lanes: u32,
}

const NO_PAIRS: Pairs =
    Pairs { light: V3 { x: f32x8::ZERO, y: f32x8::ZERO, z: f32x8::ZERO }, density: f32x8::ZERO, lanes: 0 };

/// What of a find is worth how much, pair by pair, where its light is kept in parts.
#[derive(Clone, Copy, Debug)]
struct Apart {
    /// What far vertices' own light samples and what is behind them bring, 1/m².
    gains: [Rgb<f32x8>; 2],
    /// Of that, the share of the far vertex's diffuse lobe.
    far: [Rgb<f32x8>; 2],
    /// And of the near one's.
    near: Rgb<f32x8>,
}

impl Apart {
    const ALL: Self = {
        let one = V3 { x: f32x8::ONE, y: f32x8::ONE, z: f32x8::ONE };
        Self { gains: [one; 2], far: [one; 2], near: one }
    };
}

/// Paths of one sample in pixels near one another.
#[derive(Clone, Copy, Debug)]
struct Group {
    sample: u32,
    slots: [u32; MOST],
    count: usize,
}

/// Memory of the stage.
#[derive(Clone, Debug, Default)]
pub struct Joiner {
    links: LinkQueue,
    /// Some light is left to light paths.
    caustics: bool,
    groups: Vec<Group>,
    /// The far vertices that links lead to, sixteen links each.
    fars: Vec<u32>,
    /// Paths of a group, and blocks of near vertices.
    size: usize,
    blocks: usize,
    /// By group, find and block.
    pairs: Vec<Pairs>,
    /// As `pairs`, where light is kept in parts.
    apart: Vec<Apart>,
    /// Parts of what a group's pixels get.
    parts: Vec<(Label, [Rgb<f32x8>; MOST_BLOCKS])>,
    /// Lanes of the pairs that see each other.
    seen: Vec<u32>,
    /// By slot and kind, what pixels would get more without sharing, nit; where that is asked for.
    pub measured: Option<Vec<[[f64; 3]; KINDS]>>,
    /// Shadow rays so far.
    pub links_by_kind: [u64; KINDS],
}

impl Joiner {
    /// Joins the paths of a tile for every `step`-th of samples `from..to`, and adds the light to the tile's pixels.
    pub fn join<C: Coverage>(
        &mut self,
        job: &Job,
        coverage: &C,
        [x0, y0, width, height]: [u32; 4],
        from: u32,
        to: u32,
        step: u32,
        tally: &mut Tally,
        counters: &mut Counters,
    ) {
        let size = job.settings.shares.group;
        // A path may have found two things.
        let finds = 2 * size;
        let batch = (LINKS / (finds * size)).max(1);
        (self.size, self.blocks) = (size, size / LANES);
        self.links.make_room(batch * finds * size);
        self.groups.reserve(batch);
        self.fars.reserve(batch * finds);
        self.pairs.resize(batch * finds * self.blocks, NO_PAIRS);
        self.seen.resize(batch * finds * self.blocks, 0);
        let apart = if tally.ledger.is_some() { self.pairs.len() } else { 0 };
        self.apart.resize(apart, Apart::ALL);
        self.groups.clear();
        self.caustics = job.settings.caustics;
        let first = |at: u32| at / SQUARE * SQUARE;
        for sample in (from..to).step_by(step as usize) {
            for y in (first(y0)..y0 + height).step_by(SQUARE as usize) {
                for x in (first(x0)..x0 + width).step_by(SQUARE as usize) {
                    for number in 0..MOST / size {
                        let mut group = Group { sample, slots: [0; MOST], count: 0 };
                        for member in 0..size {
                            let (dx, dy) = pixel_of(sample, size, number as u32, member as u32);
                            let (x, y) = (x + dx, y + dy);
                            if x >= x0 && y >= y0 && x < x0 + width && y < y0 + height {
                                group.slots[group.count] = (y - y0) * width + x - x0;
                                group.count += 1;
                            }
                        }
                        self.add(&group, tally);
                        if self.groups.len() == batch {
                            self.flush(job, coverage, tally, counters);
                        }
                    }
                }
            }
        }
        self.flush(job, coverage, tally, counters);
    }

    /// Makes the pairs of a group.
    fn add(&mut self, group: &Group, tally: &Tally) {
        let reuse = &tally.reuse;
        let row = |member: usize| reuse.row(group.slots[member], group.sample);
        if !(0..group.count).any(|member| Find::ALL.iter().any(|find| find.is_in(reuse, row(member)))) {
            return;
        }
        let index = self.groups.len();
        let (size, blocks) = (self.size, self.blocks);
        let mut near: [Option<NearBlock>; MOST_BLOCKS] = [const { None }; MOST_BLOCKS];
        let near = &mut near[..blocks];
        for (block, near) in near.iter_mut().enumerate() {
            let member = |lane: usize| (block * LANES + lane).min(group.count - 1);
            let mut lanes = 0;
            for lane in 0..LANES.min(group.count.saturating_sub(block * LANES)) {
                lanes |= u32::from(reuse.stage[row(member(lane))] & stage::NEAR != 0) << lane;
            }
            if lanes != 0 {
                *near = Some(NearBlock::new(lanes, |lane| &reuse.near[row(member(lane))]));
            }
        }
        for j in 0..group.count {
            let row = row(j);
            let start = || near[j / LANES].as_ref().map_or([0.0; 3], |near| near.p.lane(j % LANES));
            for find in Find::ALL {
                if !find.is_in(reuse, row) {
                    continue;
                }
                let first = (index * 2 * size + find.place(j, size)) * blocks;
                let pairs = &mut self.pairs[first..first + blocks];
                for (block, (pairs, near)) in pairs.iter_mut().zip(&*near).enumerate() {
                    *pairs = near.as_ref().map_or(NO_PAIRS, |near| match find {
                        Find::Surface => {
                            let (far, light) = (&reuse.far[row], &reuse.light[row]);
                            if self.apart.is_empty() {
                                near.pairs::<false>(far, light, self.caustics).0
                            } else {
                                let (pairs, apart) = near.pairs::<true>(far, light, self.caustics);
                                self.apart[first + block] = apart;
                                pairs
                            }
                        }
                        Find::Sky => near.glimpses::<false>(&reuse.glimpses[0][row]),
                        Find::Lit => near.glimpses::<true>(&reuse.glimpses[1][row]),
                    });
                    if let (Some(apart), Some(near)) = (self.apart.get_mut(first + block), near) {
                        match find {
                            Find::Surface => {}
                            Find::Sky => apart.near = near.share_of(V3::from_array(reuse.glimpses[0][row].direction)),
                            Find::Lit => apart.near = near.share_of(V3::from_array(reuse.glimpses[1][row].direction)),
                        }
                    }
                }
                // A pair that does not stand for the path's own near vertex leaves nothing to the others.
                if pairs[j / LANES].lanes >> (j % LANES) & 1 == 1 {
                    for (pairs, near) in pairs.iter().zip(&*near) {
                        let links = match find {
                            Find::Surface => links(near.as_ref(), start(), reuse.far[row].end, pairs.lanes),
                            Find::Sky => rays(near.as_ref(), start(), reuse.glimpses[0][row].direction, pairs.lanes),
                            Find::Lit => rays(near.as_ref(), start(), reuse.glimpses[1][row].direction, pairs.lanes),
                        };
                        self.links.put(&links, 0xff);
                    }
                    self.fars.push(first as u32);
                    self.links_by_kind[find as usize] += size as u64;
                }
            }
        }
        self.groups.push(*group);
    }

    /// Traces the shadow rays of the groups at hand and adds what arrives.
    fn flush<C: Coverage>(&mut self, job: &Job, coverage: &C, tally: &mut Tally, counters: &mut Counters) {
        let Self { links, groups, fars, size, blocks, pairs, apart, parts, seen, measured, .. } = self;
        let (size, blocks) = (*size, *blocks);
        counters.rays.shadow += links.len() as u64;
        seen.iter_mut().zip(&*pairs).for_each(|(seen, pairs)| *seen = pairs.lanes);
        job.scene.accel.occluded_of(links, coverage, |row, occluded| {
            if occluded {
                let lane = row % size;
                seen[fars[row / size] as usize + lane / LANES] &= !(1 << (lane % LANES));
            }
        });
        links.rewind();
        fars.clear();
        for (index, group) in groups.drain(..).enumerate() {
            let mut sums = [[V3::<f32x8>::splat(0.0); MOST_BLOCKS]; KINDS];
            parts.clear();
            for j in 0..group.count {
                let (slot, row) = (group.slots[j], tally.reuse.row(group.slots[j], group.sample));
                for find in Find::ALL {
                    if !find.is_in(&tally.reuse, row) {
                        continue;
                    }
                    let first = (index * 2 * size + find.place(j, size)) * blocks;
                    let of_find = first..first + blocks;
                    let (pairs, seen) = (&pairs[of_find.clone()], &seen[of_find.clone()]);
                    // What a light sample finds is not known before the shadow ray, so that none of its paths depends on that.
                    let candidate = |block: usize| if find == Find::Lit { pairs[block].lanes } else { seen[block] };
                    let own = |lanes: u32| lanes >> (j % LANES) & 1 == 1;
                    if !own(candidate(j / LANES)) {
                        let alone = find.alone(&tally.reuse, row);
                        let of_alone = find.parts_alone(job.scene, tally, slot, group.sample, alone);
                        tally.add_parts(slot, group.sample, alone, &of_alone);
                        continue;
                    }
                    let mut density = 0.0;
                    for (block, pairs) in pairs.iter().enumerate() {
                        let lanes = Mask::from_bits(candidate(block));
                        density += Real::masked(pairs.density, lanes).to_array().into_iter().sum::<f32>();
                    }
                    let scale = f32x8::splat(1.0 / density);
                    for ((sum, pairs), lanes) in sums[find as usize].iter_mut().zip(pairs).zip(seen) {
                        *sum = *sum + (pairs.light * scale).masked(Mask::from_bits(*lanes));
                    }
                    if let Some(ledger) = &tally.ledger {
                        let mut add = |label: Label, light: &dyn Fn(usize) -> Rgb<f32x8>| {
                            let row = parts.iter().position(|(other, _)| *other == label).unwrap_or_else(|| {
                                parts.push((label, [V3::<f32x8>::splat(0.0); MOST_BLOCKS]));
                                parts.len() - 1
                            });
                            for (block, (sum, lanes)) in parts[row].1.iter_mut().zip(seen).enumerate() {
                                *sum = *sum + (light(block) * scale).masked(Mask::from_bits(*lanes));
                            }
                        };
                        let one = V3::<f32x8>::splat(1.0);
                        let lobe = |share: Rgb<f32x8>, lobe: Event| {
                            if lobe == Event::DiffuseReflection { share } else { one - share }
                        };
                        let apart = &apart[of_find.clone()];
                        if find == Find::Surface {
                            for found in ledger.found(slot, group.sample) {
                                let light = V3::<f32x8>::from_array(found.light);
                                let row = usize::from(!found.first);
                                if !ledger.follows_paths() {
                                    add(found.label, &|block| apart[block].gains[row] * light);
                                    continue;
                                }
                                for ([near, far], way) in JOINTS.into_iter().zip(found.ways) {
                                    add(Label { way, ..found.label }, &|block| {
                                        let of = &apart[block];
                                        of.gains[row] * light * lobe(of.near, near) * lobe(of.far[row], far)
                                    });
                                }
                            }
                        } else {
                            let label = ledger.label(job.scene, 1, Source::Sky);
                            if ledger.follows_paths() {
                                for (event, label, _) in ledger.near(slot, group.sample, find == Find::Lit, label) {
                                    add(label, &|block| pairs[block].light * lobe(apart[block].near, event));
                                }
                            } else {
                                add(label, &|block| pairs[block].light);
                            }
                        }
                    }
                    if let Some(measured) = measured
                        && own(seen[j / LANES])
                    {
                        let (pairs, lane) = (&pairs[j / LANES], j % LANES);
                        let (light, density) = (pairs.light.lane(lane), pairs.density.lane(lane));
                        (0..3).for_each(|i| measured[slot as usize][find as usize][i] += f64::from(light[i] / density));
                    }
                }
            }
            for (member, &slot) in group.slots.iter().enumerate().take(group.count) {
                let got = sums.map(|sums| sums[member / LANES].lane(member % LANES));
                let light = array::from_fn(|i| got.iter().map(|kind| kind[i]).sum());
                let of_light: Vec<_> =
                    parts.iter().map(|(label, sums)| (*label, sums[member / LANES].lane(member % LANES))).collect();
                tally.add_parts(slot, group.sample, light, &of_light);
                if let Some(measured) = measured {
                    for (more, got) in measured[slot as usize].iter_mut().zip(got) {
                        (0..3).for_each(|i| more[i] -= f64::from(got[i]));
                    }
                }
            }
        }
    }
}

/// What a path may have found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Find {
    /// A far vertex.
    Surface,
    /// The sky, by a scattered ray.
    Sky,
    /// The sky, by a light sample.
    Lit,
}

impl Find {
    const ALL: [Self; 3] = [Self::Surface, Self::Sky, Self::Lit];

    /// Whether the path in a row found it, and light with it.
    #[inline(always)]
    fn is_in(self, reuse: &Reuse, row: usize) -> bool {
        let stage = reuse.stage[row];
        match self {
            Self::Surface => stage & stage::FAR != 0 && reuse.light[row] != [[0.0; 3]; 2],
            Self::Sky => stage & stage::SKY != 0,
            Self::Lit => stage & stage::LIT != 0,
        }
    }

    /// Its place among the finds of a group: a ray finds a surface or the sky.
    #[inline(always)]
    fn place(self, member: usize, size: usize) -> usize {
        if self == Self::Lit { size + member } else { member }
    }

    /// What the path's own pixel gets if nobody else does, nit.
    fn alone(self, reuse: &Reuse, row: usize) -> [f32; 3] {
        match self {
            Self::Surface => {
                let (Far { weight, .. }, [first, later]) = (&reuse.far[row], reuse.light[row]);
                array::from_fn(|i| weight[i] * (first[i] + later[i]))
            }
            Self::Sky => reuse.glimpses[0][row].alone,
            Self::Lit => reuse.glimpses[1][row].alone,
        }
    }
}

impl Find {
    /// What of [`alone`](Self::alone) is which light.
    fn parts_alone(
        self,
        scene: &FlatScene,
        tally: &Tally,
        slot: u32,
        sample: u32,
        alone: [f32; 3],
    ) -> Vec<(Label, [f32; 3])> {
        let Some(ledger) = &tally.ledger else { return Vec::new() };
        let times = |a: [f32; 3], b: [f32; 3]| -> [f32; 3] { array::from_fn(|c| a[c] * b[c]) };
        if self != Self::Surface {
            let label = ledger.label(scene, 1, Source::Sky);
            if !ledger.follows_paths() {
                return vec![(label, alone)];
            }
            let lobes = ledger.near(slot, sample, self == Self::Lit, label);
            return lobes.map(|(_, label, share)| (label, times(alone, share))).to_vec();
        }
        let weight = tally.reuse.far[tally.reuse.row(slot, sample)].weight;
        let part = |found: &Found| (found.label, times(weight, found.light));
        if !ledger.follows_paths() {
            return ledger.found(slot, sample).map(part).collect();
        }
        let own = ledger.near_share(slot, sample);
        let lobes = |found: &Found| {
            let (label, light) = part(found);
            let Found { ways, far: of_far, .. } = *found;
            JOINTS.into_iter().zip(ways).map(move |([near, far], way)| {
                (Label { way, ..label }, times(light, times(of_lobe(own, near), of_lobe(of_far, far))))
            })
        };
        ledger.found(slot, sample).flat_map(lobes).collect()
    }
}

/// Eight near vertices.
struct NearBlock {
    lanes: u32,
    p: V3<f32x8>,
    clear: f32x8,
    ng: V3<f32x8>,
    frame: Frame<f32x8>,
    throughput: Rgb<f32x8>,
    sky_pmf: f32x8,
    bsdf: <Opaque as Bsdf>::Prepared<f32x8>,
}

impl NearBlock {
    fn new<'a>(lanes: u32, near: impl Fn(usize) -> &'a Near) -> Self {
        let ns: V3<f32x8> = V3::from_fn(|lane| near(lane).at.ns);
        let frame = Frame::new(ns);
        let mut wo = frame.to_local(V3::from_fn(|lane| near(lane).wo));
        wo.z = Real::max(wo.z, f32x8::splat(1e-6));
        Self {
            lanes,
            p: V3::from_fn(|lane| near(lane).at.p),
            clear: f32x8::from_fn(|lane| near(lane).at.clear),
            ng: V3::from_fn(|lane| near(lane).at.ng),
            frame,
            throughput: V3::from_fn(|lane| near(lane).throughput),
            sky_pmf: f32x8::from_fn(|lane| near(lane).sky_pmf),
            bsdf: Opaque::prepare(&params(|lane| &near(lane).at), wo),
        }
    }

    /// What the eight pixels get from a far vertex that reflects `light`.
    ///
    /// Also what of each of the two lights gets there, if `APART` is asked for.
    #[inline(always)]
    fn pairs<const APART: bool>(&self, far: &Far, light: &[[f32; 3]; 2], caustics: bool) -> (Pairs, Apart) {
        let y = &far.at;
        let (ng, ns) = (V3::from_array(y.ng), V3::from_array(y.ns));
        let way = V3::from_array(y.p) - self.p;
        let distance2 = way.length_squared();
        let clear = self.clear + f32x8::splat(y.clear);
        let apart = Real::gt(distance2, clear * clear);
        let wi = way * (f32x8::ONE / Real::select(apart, distance2, f32x8::ONE).sqrt());
        let local = self.frame.to_local(wi);
        let zero = f32x8::ZERO;
        let (back, cos) = (-wi, -wi.dot(ng));
        let shading_cos = back.dot(ns);
        // Where the shading normal would have to be bent, the far surface is another one for this near vertex.
        let mirrored = ns.scale_add(shading_cos + shading_cos, wi).dot(ng);
        let mut stands = apart & Real::gt(local.z, zero) & Real::gt(wi.dot(self.ng), zero);
        stands = stands & Real::gt(cos, zero) & Real::gt(shading_cos, zero);
        stands = stands & Real::ge(mirrored, least_mirror_height(cos));
        let (f, pdf) = Opaque::eval(&self.bsdf, local);
        let geometry = cos / Real::select(apart, distance2, f32x8::ONE);
        let density = pdf * geometry;
        stands = stands & Real::gt(density, f32x8::splat(f32::MIN_POSITIVE));
        if caustics {
            // For all others, the far vertex's light has caustics in it that these leave to light paths.
            stands = stands & caustic::seldom(pdf);
        }
        let [first, later] = light.map(V3::<f32x8>::from_array);
        let one = V3::<f32x8>::splat(1.0);
        let mut apart = Apart::ALL;
        let light = if y.is_lambert() {
            first + later
        } else {
            let frame = Frame::new(ns);
            let bsdf = Opaque::prepare(&params(|_| y), frame.to_local(back));
            let scaled = |light: V3<f32x8>, towards: [f32; 3], f_own: [f32; 3]| {
                let (f, _) = Opaque::eval(&bsdf, frame.to_local(V3::from_array(towards)));
                let inverse = V3::from_array(f_own.map(|f| if f > 0.0 { 1.0 / f } else { 0.0 }));
                light * f * inverse
            };
            if APART {
                apart.gains = [scaled(one, far.to_light, far.f_light), scaled(one, far.to_next, far.f_next)];
                let share = |towards: [f32; 3]| Opaque::diffuse_share(&bsdf, frame.to_local(V3::from_array(towards)));
                apart.far = [share(far.to_light), share(far.to_next)];
            }
            scaled(first, far.to_light, far.f_light) + scaled(later, far.to_next, far.f_next)
        };
        if APART {
            apart.gains = apart.gains.map(|gain| self.throughput * f * gain * geometry);
            apart.near = Opaque::diffuse_share(&self.bsdf, local);
        }
        let light = self.throughput * f * light * geometry;
        (Pairs { light, density, lanes: self.lanes & stands.bits() }, apart)
    }

    /// Of light from a direction, the share of the diffuse lobe.
    fn share_of(&self, direction: V3<f32x8>) -> Rgb<f32x8> {
        Opaque::diffuse_share(&self.bsdf, self.frame.to_local(direction))
    }

    /// What the eight pixels get from a direction in which one of them saw the sky, or with `SAMPLED` looked for it. The densities
    /// are per solid angle.
    #[inline(always)]
    fn glimpses<const SAMPLED: bool>(&self, glimpse: &Glimpse) -> Pairs {
        let zero = f32x8::ZERO;
        let wi = V3::from_array(glimpse.direction);
        let local = self.frame.to_local(wi);
        let (f, scattered) = Opaque::eval(&self.bsdf, local);
        let sampled = self.sky_pmf * f32x8::splat(glimpse.density);
        let (density, other) = if SAMPLED { (sampled, scattered) } else { (scattered, sampled) };
        let weight = mis::power(density, other);
        let stands = Real::gt(local.z, zero) & Real::gt(wi.dot(self.ng), zero) & Real::gt(density, zero);
        let light = self.throughput * f * V3::from_array(glimpse.radiance) * weight;
        Pairs { light, density, lanes: self.lanes & stands.bits() }
    }
}

/// Shadow rays of the near vertices in `lanes` to a far one; the other lanes repeat the one from `own`.
#[inline(always)]
fn links(near: Option<&NearBlock>, own: [f32; 3], end: [f32; 3], lanes: u32) -> LinkBlock {
    let start = starts(near, own, lanes);
    block(start, V3::from_array(end) - start, BEFORE_LIGHT)
}

/// The same to the sky.
#[inline(always)]
fn rays(near: Option<&NearBlock>, own: [f32; 3], direction: [f32; 3], lanes: u32) -> LinkBlock {
    block(starts(near, own, lanes), V3::from_array(direction), f32::INFINITY)
}

#[inline(always)]
fn starts(near: Option<&NearBlock>, own: [f32; 3], lanes: u32) -> V3<f32x8> {
    let own = V3::from_array(own);
    near.map_or(own, |near| V3::select(Mask::from_bits(lanes), near.p, own))
}

#[inline(always)]
fn block(start: V3<f32x8>, way: V3<f32x8>, t_max: f32) -> LinkBlock {
    LinkBlock {
        ox: start.x.to_array(),
        oy: start.y.to_array(),
        oz: start.z.to_array(),
        dx: way.x.to_array(),
        dy: way.y.to_array(),
        dz: way.z.to_array(),
        t_max: [t_max; LANES],
    }
}

fn params<'a>(vertex: impl Fn(usize) -> &'a Vertex) -> Params<f32x8> {
    let number = |f: fn(&Vertex) -> f32| <f32x8 as Real>::from_fn(|lane| f(vertex(lane)));
    Params {
        metallic: number(|v| v.metallic),
        alpha: number(|v| v.alpha),
        specular: number(|v| v.specular),
        specular_color: V3::from_fn(|lane| vertex(lane).specular_color),
        ior: number(|v| v.ior),
        ..Params::lambert(V3::from_fn(|lane| vertex(lane).base_color))
    }
}

impl Rays for LinkQueue {
    fn count(&self) -> usize {
        self.len()
    }

    #[inline(always)]
    fn ray(&self, i: usize) -> ([f32; 3], [f32; 3], f32) {
        ([self.ox[i], self.oy[i], self.oz[i]], [self.dx[i], self.dy[i], self.dz[i]], self.t_max[i])
    }

    #[inline(always)]
    fn id(&self, _: usize) -> u32 {
        0
    }

    fn coherent_from(&self) -> usize {
        0
    }
}
