//! Flux that lights send off, from what the scene says of them.

use std::f64::consts::PI;

use super::{meter::Reading, student::Estimate};
use crate::{
    film::luminance,
    flat::{FlatScene, NONE},
    render::SamplerKind,
    sampling::{Sampler, warp},
    simd::Bits,
};

/// Independent estimates of what a texture makes of an emitter.
const REPLICAS: u32 = 16;
/// Points of a triangle in each of them.
const POINTS: u32 = 64;

/// Flux that an entity sends off, lm, whether it gets out or is met by something; `None` if it is not a light, or one that is
/// infinitely far away and has no flux.
///
/// Of a point light 4πI; of a spot I ∫ falloff dω = 2πI ((1 − cos αᵢ) + (cos αᵢ − cos αₒ)/3) with its inner and outer angle, since
/// the falloff is the square of a ramp in the cosine (`KHR_lights_punctual`); of a surface πLA for each side that emits. Where a
/// texture scales L, its mean is estimated.
pub fn flux(scene: &FlatScene, key: u64) -> Option<Reading> {
    let lights = &scene.lights;
    let mut exact = [0.0; 3];
    let mut found = false;
    let mut add = |of: [f32; 3], times: f64| {
        found = true;
        (0..3).for_each(|c| exact[c] += f64::from(of[c]) * times);
    };
    for row in (0..lights.local.len()).filter(|&row| lights.local.key[row] == key) {
        let light = lights.local.row(row);
        let scale = f64::from(light.cos_scale);
        let angle = if scale == 0.0 {
            4.0 * PI
        } else {
            let outer = -f64::from(light.cos_offset) / scale;
            let inner = (outer + 1.0 / scale).min(1.0);
            2.0 * PI * ((1.0 - inner) + (inner - outer) / 3.0)
        };
        add(light.intensity, angle);
    }
    let is_its = |instance: u32| scene.instances.key[instance as usize] == key;
    let sides = |two_sided: u32| f64::from(1 + two_sided);
    let triangles = &lights.triangles;
    let mut textured = Vec::new();
    for row in (0..triangles.len()).filter(|&row| is_its(triangles.instance[row])) {
        let power = PI * f64::from(triangles.area[row]) * sides(triangles.two_sided[row]);
        if triangles.texture[row] == NONE {
            add(triangles.radiance[row], power);
        } else {
            textured.push((row, power));
        }
    }
    let shapes = &lights.shapes;
    for row in (0..shapes.len()).filter(|&row| is_its(shapes.instance[row])) {
        let light = shapes.row(row);
        add(light.radiance, PI * f64::from(light.world_area) * sides(light.two_sided));
    }
    if !found && textured.is_empty() {
        return None;
    }
    let estimates: Vec<[f64; 3]> = if textured.is_empty() {
        vec![exact; 2]
    } else {
        (0..REPLICAS).map(|replica| with_textures(scene, &textured, exact, replica)).collect()
    };
    Some(Reading {
        rgb: std::array::from_fn(|c| Estimate::of(estimates.iter().map(|rgb| rgb[c]))),
        value: Estimate::of(estimates.iter().map(|&rgb| luminance(rgb))),
    })
}

fn with_textures(scene: &FlatScene, textured: &[(usize, f64)], exact: [f64; 3], replica: u32) -> [f64; 3] {
    type Integer = <f32 as crate::simd::Real>::Bits;
    let triangles = &scene.lights.triangles;
    let sampler = Sampler::new(SamplerKind::Sobol, u64::from(replica));
    let mut all = exact;
    for &(row, power) in textured {
        let hash = sampler.pixel_hash(row as u32, replica);
        let (instance, triangle, slot) = (triangles.instance[row], triangles.triangle[row], triangles.texture[row]);
        let mesh = &scene.meshes[scene.instances.mesh[instance as usize] as usize];
        let set = scene.textures.slots.tex_coord[slot as usize];
        for point in 0..POINTS {
            let u = sampler.pair::<f32>(Integer::splat(hash), Integer::splat(point), Integer::splat(0));
            let (b1, b2) = if triangles.four[row] == 1 { u } else { warp::triangle(u) };
            let texel = scene.textures.sample(slot, mesh.uv_at(set, mesh.vertices(triangle), b1, b2));
            let share = power / f64::from(POINTS);
            (0..3).for_each(|c| all[c] += f64::from(triangles.radiance[row][c] * texel[c]) * share);
        }
    }
    all
}
