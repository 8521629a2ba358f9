//! What paths of neighbouring pixels leave for one another: the surface that the camera sees, and the light found behind it.
//!
//! A path goes from its *near* vertex, the first surface, to its *far* one, and what it finds from there on is the light that
//! the far vertex reflects towards the near one. That light is worth as much to the pixels beside it, whose near vertices could
//! just as well have sent their rays to the same place; so it is kept apart while paths are under way, and [`join`](super::join)
//! then connects every near vertex of a group with every far one (Bekaert, Sbert, Halton 2002, "Accelerating Path Tracing by
//! Re-Using Paths"). For the price of shadow rays each pixel gets the light of as many paths as the group has.

use super::{groups, shade::Arrived, surface::Surface};
use crate::{
    bsdf::Params,
    sampling::Sampler,
    simd::{Real, V3},
};

/// Marks a slot whose light is not the pixel's but belongs to the far vertex of its path.
pub const SHARED: u32 = 1 << 31;
/// Beside [`SHARED`]: found by the light sample of the far vertex itself.
pub const FIRST: u32 = 1 << 30;
/// The bits of a slot that are one.
const SLOT: u32 = FIRST - 1;

/// The narrowest lobes, by GGX width, of surfaces that take part: what narrower ones reflect towards one pixel says little
/// about another.
const LEAST_ALPHA: f32 = 0.05;
/// Vertices are joined if they are so many times as far apart as rays start off surfaces: nearer ones may be on one surface.
const APART: f32 = 64.0;

/// Kinds of finds that can be shared.
pub const KINDS: usize = 3;

/// What paths leave for those of other pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shares {
    /// Light from far vertices.
    pub surface: bool,
    /// The sky, where a scattered ray saw it.
    pub sky: bool,
    /// The sky, where a light sample looked for it.
    pub lit: bool,
    /// Paths that share: 8, 16, 32 or 64.
    pub group: usize,
}

impl Default for Shares {
    /// Nothing; sixteen shadow rays for each path cost about as much as the path.
    fn default() -> Self {
        Self { surface: false, sky: false, lit: false, group: 16 }
    }
}

impl Shares {
    /// Whether there is anything.
    pub fn any(self) -> bool {
        self.bits() != 0
    }

    /// Whether there is anything that scattered rays find.
    pub fn scattered(self) -> bool {
        self.surface || self.sky
    }

    /// A bit for each kind.
    pub fn bits(self) -> usize {
        usize::from(self.surface) | usize::from(self.sky) << 1 | usize::from(self.lit) << 2
    }

    /// The kinds whose bits are set, shared by so many.
    pub fn of(bits: usize, group: usize) -> Self {
        Self { surface: bits & 1 != 0, sky: bits & 2 != 0, lit: bits & 4 != 0, group }
    }
}

/// A surface as a path met it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Vertex {
    /// Where rays start, of a near vertex; the point, of a far one, m.
    pub p: [f32; 3],
    /// Least distance to a vertex that it is joined with, m.
    pub clear: f32,
    /// Geometric normal on the side that the path came from.
    pub ng: [f32; 3],
    /// Shading normal.
    pub ns: [f32; 3],
    /// As [`Params`].
    pub base_color: [f32; 3],
    /// As [`Params`].
    pub metallic: f32,
    /// As [`Params`].
    pub alpha: f32,
    /// As [`Params`].
    pub specular: f32,
    /// As [`Params`].
    pub specular_color: [f32; 3],
    /// As [`Params`].
    pub ior: f32,
}

impl Vertex {
    #[inline(always)]
    fn new<F: Real>(surface: &Surface<F>, p: V3<F>, lane: usize) -> Self {
        let Params { base_color, metallic, alpha, specular, specular_color, ior, .. } = &surface.params;
        let offset = surface.ng.abs().dot(surface.error) + surface.reach;
        Self {
            p: p.lane(lane),
            clear: APART * offset.lane(lane),
            ng: surface.ng.lane(lane),
            ns: surface.frame.n.lane(lane),
            base_color: base_color.lane(lane),
            metallic: metallic.lane(lane),
            alpha: alpha.lane(lane),
            specular: specular.lane(lane),
            specular_color: specular_color.lane(lane),
            ior: ior.lane(lane),
        }
    }

    /// Reflects alike in all directions.
    #[inline]
    pub fn is_lambert(&self) -> bool {
        self.specular == 0.0 && self.metallic == 0.0
    }
}

/// The first surface of a path.
#[derive(Clone, Copy, Debug, Default)]
pub struct Near {
    /// Of the surface.
    pub at: Vertex,
    /// Towards the camera.
    pub wo: [f32; 3],
    /// Share of the light leaving the surface that reaches the pixel.
    pub throughput: [f32; 3],
    /// Probability with which the sky is chosen to be sampled there.
    pub sky_pmf: f32,
}

/// The second surface of a path.
#[derive(Clone, Copy, Debug, Default)]
pub struct Far {
    /// Of the surface.
    pub at: Vertex,
    /// Where rays to the point end, m.
    pub end: [f32; 3],
    /// Share of the light leaving this surface that reaches the path's own pixel.
    pub weight: [f32; 3],
    /// Direction of the light sample.
    pub to_light: [f32; 3],
    /// f·cos of the light sample as the path saw it.
    pub f_light: [f32; 3],
    /// Direction in which the path went on.
    pub to_next: [f32; 3],
    /// f·cos of that.
    pub f_next: [f32; 3],
}

/// Light from infinitely far away, as one path found it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Glimpse {
    /// Unit direction.
    pub direction: [f32; 3],
    /// From there, nit.
    pub radiance: [f32; 3],
    /// Density of the sky's own samples, per sr, as far as the sky is chosen to be sampled.
    pub density: f32,
    /// What the path's own pixel gets if there is no sharing, nit.
    pub alone: [f32; 3],
}

/// How far a path has come.
pub mod stage {
    /// It has a near vertex.
    pub const NEAR: u8 = 1;
    /// And went on from there in a direction that others might have taken.
    pub const ON: u8 = 2;
    /// It has a far vertex.
    pub const FAR: u8 = 4;
    /// It went from its near vertex to the sky.
    pub const SKY: u8 = 8;
    /// At its near vertex it chose the sky to be sampled.
    pub const LIT: u8 = 16;
}

/// The paths of a tile, for some samples of each pixel, by sample and slot.
#[derive(Clone, Debug, Default)]
pub struct Reuse {
    first_sample: u32,
    step: u32,
    pixels: u32,
    /// First pixel, and pixels in a row.
    corner: [u32; 2],
    width: u32,
    /// See [`stage`].
    pub stage: Vec<u8>,
    /// Where [`stage::NEAR`].
    pub near: Vec<Near>,
    /// Where [`stage::FAR`].
    pub far: Vec<Far>,
    /// Light that leaves the far vertex towards the near one, nit: by its light sample, and by the rest of the path.
    pub light: Vec<[[f32; 3]; 2]>,
    /// Where [`stage::SKY`], and where [`stage::LIT`].
    pub glimpses: [Vec<Glimpse>; 2],
}

impl Reuse {
    /// Forgets everything, and makes room for every `step`-th of samples `from..to` of a rectangle of pixels.
    pub fn begin(&mut self, [x, y, width, height]: [u32; 4], from: u32, to: u32, step: u32) {
        let pixels = (width * height) as usize;
        (self.corner, self.width) = ([x, y], width);
        (self.first_sample, self.step, self.pixels) = (from, step, pixels as u32);
        let rows = pixels * (to - from).div_ceil(step) as usize;
        self.stage.clear();
        self.stage.resize(rows, 0);
        if self.near.len() < rows {
            self.near.resize(rows, Near::default());
            self.far.resize(rows, Far::default());
            self.light.resize(rows, Default::default());
            self.glimpses.iter_mut().for_each(|glimpses| glimpses.resize(rows, Glimpse::default()));
        }
    }

    /// The row of a path.
    #[inline(always)]
    pub fn row(&self, slot: u32, sample: u32) -> usize {
        ((sample - self.first_sample) / self.step * self.pixels + (slot & SLOT)) as usize
    }

    /// Where the numbers of a path come from that shares what it finds with others, see [`groups::key`].
    #[inline]
    pub fn key(&self, sampler: &Sampler, group: usize, slot: u32, sample: u32) -> (u32, u32) {
        let slot = slot & SLOT;
        let [x, y] = self.corner;
        groups::key(sampler, group, [x + slot % self.width, y + slot / self.width], sample)
    }

    /// Adds light to a far vertex. Contributions of one path come in the order of its vertices, whatever runs beside it.
    #[inline]
    pub fn add(&mut self, slot: u32, sample: u32, light: [f32; 3]) {
        let row = self.row(slot, sample);
        let sum = &mut self.light[row][usize::from(slot & FIRST == 0)];
        (0..3).for_each(|i| sum[i] += light[i]);
    }

    /// Whether what such a surface reflects is of use to others.
    ///
    /// Black ones have no next ray: were they near vertices, the light of others would be shared with paths that never look for
    /// any, and be lost beside every black lamp.
    #[inline(always)]
    pub fn takes_part<F: Real>(params: &Params<F>) -> F::Mask {
        let matt = params.specular.max(params.metallic).le(F::zero());
        (matt | params.alpha.ge(F::splat(LEAST_ALPHA))) & params.albedo().max_element().gt(F::zero())
    }

    /// Keeps the first surface of the path in `lane`; `goes_on` if its next ray is not of a delta.
    #[inline(always)]
    pub fn keep_near<F: Real>(
        &mut self,
        row: usize,
        surface: &Surface<F>,
        start: V3<F>,
        throughput: V3<F>,
        sky_pmf: f32,
        goes_on: bool,
        lane: usize,
    ) {
        self.near[row] = Near {
            at: Vertex::new(surface, start, lane),
            wo: surface.wo.lane(lane),
            throughput: throughput.lane(lane),
            sky_pmf,
        };
        self.stage[row] |= if goes_on { stage::NEAR | stage::ON } else { stage::NEAR };
    }

    /// Whether the next surface of a path may become its far vertex.
    #[inline(always)]
    pub fn awaits_far(&self, slot: u32, sample: u32) -> bool {
        self.stage[self.row(slot, sample)] & stage::ON != 0
    }

    /// Keeps what a path that [awaits](Self::awaits_far) a far vertex saw of the sky instead.
    pub fn keep_sky(&mut self, slot: u32, sample: u32, glimpse: Glimpse) {
        let row = self.row(slot, sample);
        self.glimpses[0][row] = glimpse;
        self.stage[row] |= stage::SKY;
    }

    /// Keeps the sample of the sky that was drawn at a near vertex.
    pub fn keep_lit(&mut self, slot: u32, sample: u32, glimpse: Glimpse) {
        let row = self.row(slot, sample);
        self.glimpses[1][row] = glimpse;
        self.stage[row] |= stage::LIT;
    }

    /// The far vertex of a path.
    #[inline(always)]
    pub fn far_of(&mut self, slot: u32, sample: u32) -> &mut Far {
        let row = self.row(slot, sample);
        &mut self.far[row]
    }

    /// Keeps the second surface of the path in `lane`.
    #[inline(always)]
    pub fn keep_far<F: Real>(&mut self, surface: &Surface<F>, at: &Arrived<F>, lane: usize) {
        let row = self.row(at.slot[lane], at.sample[lane]);
        let shift = (surface.ng.abs().dot(surface.error) + surface.reach).lane(lane);
        let (p, ng) = (surface.p.lane(lane), surface.ng.lane(lane));
        self.far[row] = Far {
            at: Vertex::new(surface, surface.p, lane),
            end: std::array::from_fn(|i| ng[i].mul_add(shift, p[i])),
            weight: at.throughput.lane(lane),
            ..Far::default()
        };
        self.light[row] = Default::default();
        self.stage[row] |= stage::FAR;
    }
}
