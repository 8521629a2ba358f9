//! Tells the ledger by which lobes surfaces send light on. Runs only where layers tell what happened to paths: it looks at
//! surfaces anew, so that scattering itself need not know.

use super::{
    dimensions::{mix, ray_id},
    ledger::{Ledger, Scattered},
    reuse::SHARED,
    shade::{Arrived, Connection, Departure},
    surface::{self, Incoming, Parts, Surface},
};
use crate::{
    bsdf::Bsdf,
    film::{Event, Label},
    flat::{FlatScene, Source},
    simd::{Mask, Real, Rgb, V3},
};

/// Tells apart these choices from rays that are named alike.
const KIND: u32 = 5;

/// Of light that a surface sends along a direction, the shares of its lobes; `delta` are lanes without blur.
#[inline(always)]
fn scattered<F: Real>(diffuse: Rgb<F>, through: F::Mask, delta: F::Mask, lane: usize) -> Scattered {
    let (through, delta) = (through.bits() >> lane & 1 == 1, delta.bits() >> lane & 1 == 1);
    let other = match (through, delta) {
        (false, false) => Event::GlossyReflection,
        (false, true) => Event::SingularReflection,
        (true, false) => Event::GlossyTransmission,
        (true, true) => Event::SingularTransmission,
    };
    let diffuse = if through || delta { [0.0; 3] } else { diffuse.lane(lane) };
    Scattered { diffuse, other: Some(other) }
}

/// Share of the diffuse lobe in directions as seen from the paths, and the lanes in which they lie beyond the surface.
#[inline(always)]
fn share<F: Real, B: Bsdf>(surface: &Surface<F>, towards: V3<F>) -> (Rgb<F>, F::Mask) {
    let prepared = B::prepare(&surface.params, surface.wo_local);
    let local = surface.frame.to_local(towards);
    (B::diffuse_share(&prepared, local), towards.dot(surface.ng).lt(F::zero()))
}

/// A number in [0, 1) that nothing else is drawn with.
#[inline(always)]
pub fn uniform(pixel_hash: u32, index: u32, depth: u32) -> f32 {
    (mix(ray_id(pixel_hash, index, depth, KIND) ^ 0x5bd1_e995) >> 8) as f32 / 16_777_216.0
}

/// Notes what paths do at surfaces: what their light samples are, and by which lobe they go on.
#[inline(always)]
pub fn note<F: Real, B: Bsdf, const TEXTURED: bool>(
    scene: &FlatScene,
    terminator_fix: bool,
    at: &Arrived<F>,
    parts: Parts,
    connection: &Connection<F>,
    departure: &Departure<F>,
    ledger: &mut Ledger,
) {
    let label =
        |ledger: &Ledger, lane: usize| ledger.label(scene, at.depth[lane] + 1, Source::Chosen(connection.row[lane]));
    if !ledger.follows_paths() {
        for lane in (0..F::LANES).filter(|lane| connection.lanes >> lane & 1 == 1) {
            let label = label(ledger, lane);
            ledger.expect(at.slot[lane] & !SHARED, at.sample[lane], label, Scattered::default());
        }
        return;
    }
    let mut lookups = 0;
    let surface = surface::interact::<F, TEXTURED>(scene, &at.hits, parts, terminator_fix, &mut lookups);
    let no = F::Mask::splat(false);
    let (lit, lit_through) = share::<F, B>(&surface, connection.direction.normalize());
    let (on, on_through) = share::<F, B>(&surface, departure.direction);
    let delta = departure.pdf.eq(F::zero());
    for lane in (0..F::LANES).filter(|lane| at.active >> lane & 1 == 1) {
        let (slot, sample) = (at.slot[lane] & !SHARED, at.sample[lane]);
        let light = scattered::<F>(lit, lit_through, no, lane);
        let next = scattered::<F>(on, on_through, delta, lane);
        let is_far = departure.slot[lane] & !at.slot[lane] & SHARED != 0;
        if is_far {
            ledger.go_far(slot, sample, next);
        }
        if connection.lanes >> lane & 1 == 1 {
            let label: Label = label(ledger, lane);
            ledger.expect(slot, sample, label, light);
        }
        if at.depth[lane] == 0 {
            ledger.lit(slot, sample, light);
        }
        if !is_far && departure.lanes >> lane & 1 == 1 {
            ledger.go_on(slot, sample, next, uniform(at.pixel_hash[lane], at.index[lane], at.depth[lane]));
        }
    }
}

/// What surfaces that light paths come to do to light which leaves along `towards`, as the camera sees it; and lane by lane which
/// of the lobes it is that did it, by channel.
#[inline(always)]
pub fn of_light_paths<F: Real, B: Bsdf, const TEXTURED: bool>(
    scene: &FlatScene,
    terminator_fix: bool,
    hits: &Incoming<F>,
    parts: Parts,
    towards: V3<F>,
    delta: F::Mask,
    uniform: impl Fn(usize) -> f32,
) -> [[Event; 3]; 8] {
    let mut lookups = 0;
    let surface = surface::interact::<F, TEXTURED>(scene, hits, parts, terminator_fix, &mut lookups);
    let to_light = surface.wo;
    let view = surface.view(towards, true);
    let prepared = B::prepare(&view.params, view.to_local);
    let diffuse = B::diffuse_share(&prepared, view.frame.to_local(to_light));
    let through = view.other_side;
    std::array::from_fn(|lane| {
        let lane = lane % F::LANES;
        let Scattered { diffuse, other } = scattered::<F>(diffuse, through, delta, lane);
        let (u, other) = (uniform(lane), other.unwrap_or(Event::GlossyReflection));
        diffuse.map(|share| if u < share { Event::DiffuseReflection } else { other })
    })
}
