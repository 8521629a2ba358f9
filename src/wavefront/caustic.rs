//! Which light comes from the emitters rather than to the camera's paths.
//!
//! A path that is scattered at a surface, goes on through mirrors or clear glass alone and then meets an emitter has found
//! it by chance: nothing that looks for lights from the surface can know the way. Seen from the emitter the same way is
//! easy: [light paths](super::light_paths) go through the glass and are then seen by the camera. Each way is counted by one of
//! the two, so that no weights are needed. The light's are those
//!
//! - from an emitting triangle or parallelogram of full coverage, through one or more deltas,
//! - that the camera sees at a surface which scatters them, and from directions that the surface seldom scatters
//!   camera paths to: what is nearly a mirror finds the light better than the light finds it,
//! - along which no normal of a delta has to be bent and nothing else is scattered off its facet (see the shadow terminator
//!   in `docs/model.md`): what that does to paths has no inverse.
//!
//! So it is with suns, the few texels of a sky that are far brighter than it is on average: what is scattered at a surface,
//! then off something shiny and into a sun lights single pixels up when a path finds it. The light's is what
//!
//! - comes from a texel of a sun,
//! - is scattered first by a delta, or into a direction from which camera paths go to the sun with a density of more than
//!   [`NARROW`], which no material does that is not marked as shiny,
//! - and then goes on as above.
//!
//! A path from the camera remembers in the sign of its `eta_scale` whether that holds so far: negative if so.

use super::surface::Surface;
use crate::{
    accel::Hit,
    bsdf::Sampled,
    flat::{FlatScene, NONE, flags},
    simd::{Mask, Real, V3},
};

/// Density per sr above which a direction is left to paths from the camera: they go there often enough. Diffuse surfaces stay
/// below 1/π.
const SELDOM: f32 = 2.0;

/// Density per sr above which the way from a surface to a sun is left to light paths.
pub const NARROW: f32 = 2.0;

/// Lanes whose material has a lobe that is a delta for light from emitters too.
#[inline(always)]
pub fn deltas<F: Real>(scene: &FlatScene, materials: &[u32; 8]) -> F::Mask {
    let mut bits = 0;
    for (lane, &row) in materials.iter().enumerate().take(F::LANES) {
        bits |= u32::from(scene.materials.flags[row as usize] & flags::DELTA != 0) << lane;
    }
    F::Mask::from_bits(bits)
}

/// Lanes in which a camera path that is scattered at its first surface with this density leaves light to the emitters.
#[inline(always)]
pub fn seldom<F: Real>(pdf: F) -> F::Mask {
    pdf.le(F::splat(SELDOM))
}

/// `eta_scale` after a scattering, with the sign for the path so far.
#[inline(always)]
pub fn marked<F: Real>(
    scene: &FlatScene,
    materials: &[u32; 8],
    depth: &[u32; 8],
    before: F,
    surface: &Surface<F>,
    drawn: &Sampled<F>,
    eta_scale: F,
) -> F {
    let mut first = 0;
    depth.iter().enumerate().take(F::LANES).for_each(|(lane, &depth)| first |= u32::from(depth == 0) << lane);
    let first = F::Mask::from_bits(first);
    let delta = drawn.delta;
    let mut invertible = !(surface.is_lifted & !drawn.transmitted & !delta);
    if delta.any() {
        invertible = invertible & (!delta | (deltas::<F>(scene, materials) & !surface.bent));
    }
    let was = before.lt(F::zero()) & !first;
    let is = invertible & (was | (first & !delta & seldom(drawn.pdf)));
    let size = eta_scale.abs();
    F::select(is, -size, size)
}

/// True if light that a path with these numbers finds is brought by light paths.
#[inline]
pub fn is_one(scene: &FlatScene, eta_scale: f32, pdf: f32, hit: &Hit) -> bool {
    if !(eta_scale < 0.0 && pdf == 0.0) {
        return false;
    }
    let light = scene.light_of(hit.instance, hit.triangle);
    light != NONE && emits(scene, light)
}

/// True if what a path with so many scatterings sees of the sky is brought by light paths; `suns` is the luminance above which
/// texels are suns, nit.
#[inline(always)]
pub fn is_of_sun(suns: f32, eta_scale: f32, pdf: f32, depth: u32, radiance: [f32; 3]) -> bool {
    eta_scale < 0.0 && depth >= 2 && (pdf == 0.0 || pdf > NARROW) && V3::<f32>::from_array(radiance).luminance() > suns
}

/// True if light paths start at an emitter.
#[inline]
pub fn emits(scene: &FlatScene, light: u32) -> bool {
    let triangles = &scene.lights.triangles;
    let Some(&instance) = triangles.instance.get(light as usize) else { return false };
    let material = scene.material_of(instance, triangles.triangle[light as usize]);
    scene.materials.flags[material as usize] & (flags::MASK | flags::BLEND) == 0
}
