//! Scatters light paths: shows each vertex to the camera, and sends the path on. A kernel for eight lanes or one.
//!
//! What a camera path makes of a surface is a function of where it came from; so light is weighed by how the surface
//! looks along the direction that it leaves in. Of the light that arrives on a piece of the facet, `f cos(ns, wi)` is
//! scattered into radiance for each `cos(ng, wi)` of flux (Veach 1997, "Robust Monte Carlo Methods for Light Transport Simulation",
//! section 5.3); of radiance that is refracted the flux does not change by η².

use crate::{
    bsdf::Bsdf,
    flat::{FlatScene, flags},
    sampling::Sampler,
    simd::{Bits, Mask, Real, Rgb, V3},
    wavefront::{
        Settings,
        bounce::most_survivors,
        caustic, dimensions,
        generate::{Lens, Sighting},
        stats::Counters,
        surface::{self, Incoming, Parts, Surface},
        view::View,
    },
};

/// What the kernel reads beside the paths.
pub struct Around<'a> {
    /// Tables.
    pub scene: &'a FlatScene,
    /// Settings.
    pub settings: &'a Settings,
    /// Camera.
    pub lens: &'a Lens,
    /// Random numbers.
    pub sampler: &'a Sampler,
    /// Where on the film light counts: x0, y0, x1, y1, pixels.
    pub window: [f64; 4],
    /// Stands for the sample in the sampler.
    pub key: u32,
}

/// Light paths at surfaces, one per lane.
#[derive(Clone, Copy, Debug)]
pub struct Landed<F: Real> {
    /// Hits.
    pub hits: Incoming<F>,
    /// Lanes that carry a path.
    pub active: u32,
    /// As in the queue.
    pub flux: Rgb<F>,
    /// As in the queue.
    pub index: [u32; 8],
    /// As in the queue.
    pub depth: [u32; 8],
    /// Lanes that come from a sun and have met nothing before.
    pub from_sun: u32,
}

/// What the camera sees, per lane.
#[derive(Clone, Copy, Debug)]
pub struct Seen<F: Real> {
    /// Where from.
    pub sightings: [Sighting; 8],
    /// End of the camera's ray, m.
    pub end: V3<F>,
    /// Nit times pixels.
    pub light: Rgb<F>,
    /// Through the surface.
    pub transmitted: u32,
    /// Lanes that are seen.
    pub lanes: u32,
}

/// Where the path goes on, per lane.
#[derive(Clone, Copy, Debug)]
pub struct Onward<F: Real> {
    /// Start, m.
    pub origin: V3<F>,
    /// Unit direction.
    pub direction: V3<F>,
    /// Of those that go on.
    pub flux: Rgb<F>,
    /// Through the surface.
    pub transmitted: u32,
    /// By a mirror or clear glass.
    pub deltas: u32,
    /// Lanes that go on.
    pub lanes: u32,
    /// Start of a ray beyond the surface, m.
    pub beyond: V3<F>,
}

/// Light that leaves along a view, per flux that arrived along `to_light`, without the cosine of the geometric normal to the
/// view, and the density with which camera paths go to the light.
///
/// 0 where camera paths do not go there.
#[inline(always)]
fn scattered<F: Real, B: Bsdf>(
    surface: &Surface<F>,
    view: &View<F>,
    to_light: V3<F>,
    cos_light: F,
    transmissive: bool,
) -> (Rgb<F>, F) {
    let zero = F::zero();
    let local = view.frame.to_local(to_light);
    let height = to_light.dot(view.ng);
    let above = local.z.gt(zero) & height.gt(zero) & !surface.is_lifted;
    let below = local.z.lt(zero) & height.lt(zero);
    let sides = if transmissive { above | below } else { above };
    if !sides.any() {
        return (V3::splat(0.0), zero);
    }
    let (f, pdf) = B::eval(&B::prepare(&view.params, view.to_local), local);
    ((f * (F::one() / cos_light)).masked(sides), pdf)
}

/// One scattering.
#[inline(always)]
pub fn relay<F: Real, B: Bsdf, const TEXTURED: bool>(
    around: &Around,
    at: &Landed<F>,
    parts: Parts,
    counters: &mut Counters,
) -> (Seen<F>, Onward<F>) {
    let Around { scene, settings, sampler, .. } = around;
    let fix = settings.terminator_fix;
    let surface = surface::interact::<F, TEXTURED>(scene, &at.hits, parts, fix, &mut counters.texture_lookups);
    let (zero, one) = (F::zero(), F::one());
    let transmissive = parts == Parts::All;
    let to_light = surface.wo;
    let cos_light = to_light.dot(surface.ng).max(F::splat(1e-12));
    let mut first = 0;
    at.depth.iter().enumerate().take(F::LANES).for_each(|(lane, &depth)| first |= u32::from(depth == 0) << lane);
    let first = F::Mask::from_bits(first);
    // What has no back is dark there.
    let mut solid_there = u32::MAX;
    for (lane, &row) in at.hits.material.iter().enumerate().take(F::LANES) {
        let has_back = scene.materials.flags[row as usize] & (flags::DOUBLE_SIDED | flags::TRANSMISSION) != 0;
        solid_there &= !(u32::from(!has_back) << lane);
    }
    let active = F::Mask::from_bits(at.active) & (!at.hits.back | F::Mask::from_bits(solid_there));

    let arrived = surface.view(to_light, false);
    let prepared = B::prepare(&arrived.params, arrived.to_local);
    let shown = active & !first & B::scatters(&prepared);
    let seen = show::<F, B>(around, at, &surface, shown.bits(), to_light, cos_light, transmissive);

    let index = F::Bits::from_fn(|lane| at.index[lane]);
    let key = F::Bits::splat(around.key);
    let depth = F::Bits::from_fn(|lane| at.depth[lane]);
    let pair = |decision| sampler.pair::<F>(key, index, dimensions::at::<F>(depth, decision));
    let (u_roulette, u_lobe) = pair(dimensions::CHOICE);
    let drawn = B::sample(&prepared, u_lobe, pair(dimensions::DIRECTION));
    let onward = arrived.frame.to_world(drawn.wi);
    let height = onward.dot(surface.ng);
    let above = drawn.wi.z.gt(zero) & height.gt(zero);
    let below = drawn.wi.z.lt(zero) & height.lt(zero);
    let agrees = if transmissive { (above & !drawn.transmitted) | (below & drawn.transmitted) } else { above };
    let view = surface.view(onward, true);
    let (f, density) = scattered::<F, B>(&surface, &view, to_light, cos_light, transmissive);
    let mut weight = f * (height.abs() / F::select(drawn.pdf.gt(zero), drawn.pdf, one));
    // What is shiny enough sends the light of a sun on.
    let mut goes_on = !first | (F::Mask::from_bits(at.from_sun) & density.gt(F::splat(caustic::NARROW)));
    if drawn.delta.any() {
        let cos_smooth = view.frame.to_local(to_light).z;
        // A camera path would be sent here from the side that it comes from.
        let sides = F::select(drawn.transmitted, -cos_smooth, cos_smooth).gt(zero);
        let turned = height.abs() * cos_smooth.abs() / (view.to_local.z * cos_light);
        let value = drawn.weight * (drawn.eta_scale * turned);
        weight = V3::select(drawn.delta, value, weight);
        let exact = caustic::deltas::<F>(scene, &at.hits.material) & !view.bent;
        goes_on = F::Mask::from_bits((drawn.delta & exact & sides).bits() | (!drawn.delta & goes_on).bits());
    }
    let limit = F::from_fn(|lane| most_survivors(at.depth[lane]));
    let survival = weight.max_element().min(limit);
    let goes_on = active & goes_on & drawn.valid & agrees & u_roulette.lt(survival);
    let flux = at.flux * weight * (one / F::select(goes_on, survival, one));
    let onward = Onward {
        origin: surface.ng.scale_add((surface.ng.abs().dot(surface.error) + surface.reach).copysign(height), surface.p),
        direction: onward,
        flux,
        transmitted: if transmissive { drawn.transmitted.bits() } else { 0 },
        deltas: drawn.delta.bits(),
        lanes: goes_on.bits(),
        beyond: surface.leave(F::Mask::splat(false)),
    };
    (seen, onward)
}

/// What the camera sees of vertices.
#[inline(always)]
fn show<F: Real, B: Bsdf>(
    around: &Around,
    at: &Landed<F>,
    surface: &Surface<F>,
    shown: u32,
    to_light: V3<F>,
    cos_light: F,
    transmissive: bool,
) -> Seen<F> {
    let mut sightings = [Sighting::default(); 8];
    let mut lanes = 0;
    let [x0, y0, x1, y1] = around.window;
    for (lane, sighting) in sightings.iter_mut().enumerate().take(F::LANES) {
        if shown >> lane & 1 == 0 || at.depth[lane] >= around.settings.max_depth {
            continue;
        }
        if let Some(seen) = around.lens.see(surface.p.lane(lane))
            && (x0..x1).contains(&seen.film[0])
            && (y0..y1).contains(&seen.film[1])
        {
            *sighting = seen;
            lanes |= 1 << lane;
        }
    }
    let mut seen = Seen { sightings, end: surface.p, light: V3::splat(0.0), transmitted: 0, lanes };
    if lanes == 0 {
        return seen;
    }
    // Lanes that see nothing look along the way that they came.
    let to_camera = V3::select(F::Mask::from_bits(lanes), -V3::from_fn(|lane| sightings[lane].direction), to_light);
    let view = surface.view(to_camera, true);
    let (f, pdf) = scattered::<F, B>(surface, &view, to_light, cos_light, transmissive);
    let pixels = F::from_fn(|lane| sightings[lane].pixels);
    let light = at.flux * f * (to_camera.dot(view.ng) * pixels);
    let bright = light.max_element().gt(F::zero()) & caustic::seldom(pdf);
    let distance = surface.ng.abs().dot(surface.error) + surface.reach;
    seen.end = view.ng.scale_add(distance, surface.p);
    seen.transmitted = view.other_side.bits();
    seen.light = light;
    seen.lanes = lanes & bright.bits();
    seen
}
