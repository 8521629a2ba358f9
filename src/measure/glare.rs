//! Glare of lamps by the Unified Glare Rating (CIE 117:1995, "Discomfort Glare in Interior Lighting"):
//!
//! ```text
//! UGR = 8 log₁₀( 0.25 / L_b · Σ L² ω / p² )
//! ```
//!
//! with the mean luminance L of each lamp's luminous parts towards the eye, nit, the solid angle ω that they fill there, sr, Guth's
//! position index p, and the background luminance L_b: the vertical illuminance at the eye without what comes straight from the
//! lamps, over π. 10 is hardly noticed, 19 the limit for offices (EN 12464-1), 28 unbearable.
//!
//! It is defined for lamps that fill 0.0003 to 0.1 sr.

use std::f64::consts::PI;

use glam::DVec3;

use super::{
    meter::{Effort, Meters, Reading, read},
    student::Estimate,
};
use crate::{
    accel::Stacks,
    film::luminance,
    flat::FlatScene,
    render::{Observer, SamplerKind},
    sampling::{Sampler, warp},
    simd::{Bits, V3},
    wavefront::{SceneCoverage, emitted},
};

/// Solid angles that UGR is defined for, sr.
pub const DEFINED: [f64; 2] = [3e-4, 0.1];

/// A lamp as the eye sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct GlareSource {
    /// Persistent key of the entity.
    pub key: u64,
    /// Mean luminance, nit.
    pub luminance: f64,
    /// Solid angle, sr.
    pub solid_angle: f64,
    /// Guth's position index, at its middle.
    pub position_index: f64,
    /// What comes straight from it onto a plane that faces along the line of sight, lx.
    pub illuminance: f64,
}

/// How much lamps dazzle.
#[derive(Clone, Debug, PartialEq)]
pub struct Glare {
    /// Unified Glare Rating; minus infinity without a lamp in sight.
    pub ugr: f64,
    /// Where it is with a probability of 95 %, by that of the background luminance.
    pub interval: [f64; 2],
    /// Background luminance, nit.
    pub background: Estimate,
    /// Vertical illuminance at the eye, lx.
    pub vertical: Reading,
    /// Lamps in sight, the worst one first.
    pub sources: Vec<GlareSource>,
    /// Lamps without extent, which UGR knows nothing of.
    pub without_extent: usize,
    /// Samples of the illuminance.
    pub samples: u64,
    /// Wall time.
    pub seconds: f64,
    /// The error that was asked for was reached, by the illuminance.
    pub reached: bool,
}

/// Directions towards each lamp.
const DIRECTIONS: u32 = 1 << 16;

/// Guth's position index of a direction, the line of sight and the up direction being at right angles (CIE 117, by Levin 1975, "Position
/// Index in VCP Calculations", above the line of sight; Iwata, Tokura 1997, "Position Index for a Glare Source Located Below the
/// Line of Vision", below it).
pub fn position_index(to: DVec3, forward: DVec3, up: DVec3) -> f64 {
    let right = forward.cross(up);
    let (ahead, above, aside) = (to.dot(forward), to.dot(up), to.dot(right));
    if above < 0.0 {
        let r = aside.hypot(above) / ahead.max(1e-9);
        let steep = if r > 0.6 { 1.2 } else { 0.8 };
        return (1.0 + steep * r.min(3.0)).min(16.0);
    }
    // τ: from the vertical, around the line of sight; σ: from the line of sight.
    let tau = aside.abs().atan2(above).to_degrees();
    let sigma = aside.hypot(above).atan2(ahead).to_degrees();
    let linear = 35.2 - 0.31889 * tau - 1.22 * (-2.0 * tau / 9.0).exp();
    let square = 21.0 + 0.26667 * tau - 0.002963 * tau * tau;
    (linear * 1e-3 * sigma + square * 1e-5 * sigma * sigma).exp().min(16.0)
}

/// Rates the glare at an eye that looks along `forward`, with its head upright by `up`; both are unit vectors.
pub fn glare(
    scene: &FlatScene,
    eye: DVec3,
    forward: DVec3,
    up: DVec3,
    effort: &Effort,
    observer: &dyn Observer,
) -> Glare {
    let up = (up - forward * up.dot(forward)).normalize_or(forward.any_orthonormal_vector());
    let lights = &scene.lights;
    let mut keys: Vec<u64> = lights
        .triangles
        .instance
        .iter()
        .chain(&lights.shapes.instance)
        .map(|&instance| scene.instances.key[instance as usize])
        .collect();
    keys.sort_unstable();
    keys.dedup();
    let mut sources: Vec<GlareSource> =
        keys.into_iter().filter_map(|key| source(scene, key, eye, forward, up)).collect();
    let strength = |s: &GlareSource| s.luminance * s.luminance * s.solid_angle / (s.position_index * s.position_index);
    sources.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
    let planes = Meters::Planes(vec![(eye, forward)]);
    let readings = read(scene, &planes, effort, observer);
    let direct: f64 = sources.iter().map(|source| source.illuminance).sum();
    let vertical = readings.mean;
    let background = Estimate {
        value: ((vertical.value.value - direct) / PI).max(0.0),
        variance: vertical.value.variance / (PI * PI),
        ..vertical.value
    };
    let sum: f64 = sources.iter().map(strength).sum();
    let ugr = |background: f64| 8.0 * (0.25 / background.max(f64::MIN_POSITIVE) * sum).log10();
    let [least, most] = background.interval(0.95);
    Glare {
        ugr: ugr(background.value),
        interval: [ugr(most), ugr(least)],
        background,
        vertical,
        sources,
        without_extent: lights.local.len(),
        samples: readings.samples,
        seconds: readings.seconds,
        reached: readings.reached,
    }
}

/// What of a lamp is in sight; none if nothing is.
fn source(scene: &FlatScene, key: u64, eye: DVec3, forward: DVec3, up: DVec3) -> Option<GlareSource> {
    type Integer = <f32 as crate::simd::Real>::Bits;
    let (towards, one_minus_cos) = cone(scene, key, eye);
    let (x, y) = towards.any_orthonormal_pair();
    let sampler = Sampler::new(SamplerKind::Sobol, key);
    let hash = sampler.pixel_hash(0, 0);
    let coverage = SceneCoverage::new(scene);
    let (mut stacks, mut lookups) = (Stacks::default(), 0);
    let (mut seen, mut light, mut facing, mut middle) = (0.0, 0.0, 0.0, DVec3::ZERO);
    for index in 0..DIRECTIONS {
        let u = sampler.pair::<f32>(Integer::splat(hash), Integer::splat(index), Integer::splat(0));
        let V3 { x: a, y: b, z: c } = warp::uniform_cone(u, one_minus_cos as f32);
        let to = (x * f64::from(a) + y * f64::from(b) + towards * f64::from(c)).normalize();
        let cos = to.dot(forward);
        if cos <= 0.0 {
            continue;
        }
        let (from, direction) = (eye.as_vec3().to_array(), to.as_vec3().to_array());
        let hit = scene.accel.nearest(from, direction, f32::INFINITY, index, &coverage, &mut stacks);
        if hit.instance == crate::flat::NONE || scene.instances.key[hit.instance as usize] != key {
            continue;
        }
        let material = scene.material_of(hit.instance, hit.triangle);
        let value = luminance(emitted(scene, material, &hit, &mut lookups).map(f64::from));
        if value > 0.0 {
            seen += 1.0;
            light += value;
            facing += value * cos;
            middle += to;
        }
    }
    if seen == 0.0 {
        return None;
    }
    let each = 2.0 * PI * one_minus_cos / f64::from(DIRECTIONS);
    Some(GlareSource {
        key,
        luminance: light / seen,
        solid_angle: seen * each,
        position_index: position_index(middle.normalize_or(forward), forward, up),
        illuminance: facing * each,
    })
}

/// Directions in which a lamp may be seen: axis and 1 − cos of the half-angle.
fn cone(scene: &FlatScene, key: u64, eye: DVec3) -> (DVec3, f64) {
    let everywhere = (DVec3::Y, 2.0);
    let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for row in (0..scene.instances.len()).filter(|&row| scene.instances.key[row] == key) {
        let (lower, upper) = scene.box_of(row);
        (least, most) = (least.min(lower.as_dvec3()), most.max(upper.as_dvec3()));
    }
    let (center, radius) = (0.5 * (least + most), 0.5 * (most - least).length() * 1.0001);
    let distance = center.distance(eye);
    if !distance.is_finite() || distance <= radius {
        return everywhere;
    }
    let sin2 = (radius / distance).powi(2);
    ((center - eye) / distance, sin2 / (1.0 + (1.0 - sin2).sqrt()))
}
