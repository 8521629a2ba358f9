//! Adds the light of emitting and unlit surfaces that paths arrived at.

use super::{
    caustic, direct,
    queues::{HitQueue, PathQueue},
    tally::Tally,
};
use crate::{
    accel::Hit,
    flat::{FlatScene, NONE, Source, flags},
    light::Receiver,
    sampling::mis,
};

/// The place of a hit row.
#[inline]
fn hit_at(hits: &HitQueue, i: usize) -> Hit {
    Hit {
        t: hits.t[i],
        instance: hits.instance[i],
        triangle: hits.triangle[i],
        b1: hits.b1[i],
        b2: hits.b2[i],
        back: hits.back[i] == 1,
    }
}

/// Radiance that a surface emits towards the ray that met it, nit.
#[inline]
pub fn emitted(scene: &FlatScene, material: u32, hit: &Hit, lookups: &mut u64) -> [f32; 3] {
    let materials = &scene.materials;
    let row = material as usize;
    if hit.back && materials.flags[row] & flags::DOUBLE_SIDED == 0 {
        return [0.0; 3];
    }
    let slot = materials.emissive_texture[row];
    scaled_by_texture(scene, materials.emissive[row], slot, hit, lookups)
}

/// Radiance of an unlit surface: its base colour as it is, nit.
#[inline]
pub fn unlit(scene: &FlatScene, material: u32, hit: &Hit, lookups: &mut u64) -> [f32; 3] {
    let materials = &scene.materials;
    let row = material as usize;
    let mesh = &scene.meshes[scene.instances.mesh[hit.instance as usize] as usize];
    let mut color = materials.base_color[row];
    if !mesh.colors.is_empty() {
        let [a, b, c] = mesh.triangles[hit.triangle as usize].map(|vertex| mesh.colors[vertex as usize]);
        let b0 = 1.0 - hit.b1 - hit.b2;
        color = std::array::from_fn(|i| color[i] * (b0 * a[i] + hit.b1 * b[i] + hit.b2 * c[i]));
    }
    scaled_by_texture(scene, color, materials.base_color_texture[row], hit, lookups)
}

#[inline]
fn scaled_by_texture(scene: &FlatScene, color: [f32; 3], slot: u32, hit: &Hit, lookups: &mut u64) -> [f32; 3] {
    if slot == NONE {
        return color;
    }
    *lookups += 1;
    let mesh = &scene.meshes[scene.instances.mesh[hit.instance as usize] as usize];
    let vertices = mesh.vertices(hit.triangle);
    let uv = mesh.uv_at(scene.textures.slots.tex_coord[slot as usize], vertices, hit.b1, hit.b2);
    let texel = scene.textures.sample(slot, uv);
    std::array::from_fn(|i| color[i] * texel[i])
}

/// Weight of light found by a ray that was scattered with density `pdf` (0: nothing else finds it) and left `at`, against light
/// sampling.
#[inline]
pub fn weight(scene: &FlatScene, pdf: f32, at: &Receiver, hit: &Hit, direction: [f32; 3]) -> f32 {
    let light = scene.light_of(hit.instance, hit.triangle);
    if pdf == 0.0 || light == NONE {
        return 1.0;
    }
    let Some(n) = scene.lights.triangles.n.get(light as usize) else {
        return mis::power(pdf, direct::shape_pdf(scene, light, at, hit, direction));
    };
    let cos = n[0] * direction[0] + n[1] * direction[1] + n[2] * direction[2];
    mis::power(pdf, direct::facet_pdf(scene, light, at, hit.t, cos))
}

/// Adds the emission of the hits in `rows`.
pub fn emit(
    scene: &FlatScene,
    rows: &[u32],
    materials: &[u32],
    paths: &PathQueue,
    hits: &HitQueue,
    tally: &mut Tally,
    lookups: &mut u64,
) {
    for &row in rows {
        let i = row as usize;
        let hit = hit_at(hits, i);
        let light = emitted(scene, materials[i], &hit, lookups);
        if light != [0.0; 3] && !caustic::is_one(scene, paths.eta_scale[i], paths.pdf[i], &hit) {
            let at = Receiver::new([paths.ox[i], paths.oy[i], paths.oz[i]], paths.side[i]);
            let weight = weight(scene, paths.pdf[i], &at, &hit, [paths.dx[i], paths.dy[i], paths.dz[i]]);
            add(scene, tally, paths, i, hit.instance, light, weight);
        }
    }
}

/// Adds the light of the unlit surfaces in `rows`, where their paths end.
pub fn show_unlit(
    scene: &FlatScene,
    rows: &[u32],
    materials: &[u32],
    paths: &PathQueue,
    hits: &HitQueue,
    tally: &mut Tally,
    lookups: &mut u64,
) {
    for &row in rows {
        let i = row as usize;
        let hit = hit_at(hits, i);
        let light = unlit(scene, materials[i], &hit, lookups);
        add(scene, tally, paths, i, hit.instance, light, 1.0);
    }
}

/// Adds `light · weight` of an instance along the path in row `i`.
#[inline]
fn add(scene: &FlatScene, tally: &mut Tally, paths: &PathQueue, i: usize, instance: u32, light: [f32; 3], weight: f32) {
    let throughput = [paths.throughput_r[i], paths.throughput_g[i], paths.throughput_b[i]];
    let light = std::array::from_fn(|c| throughput[c] * light[c] * weight);
    tally.add(paths.slot[i], paths.sample[i], light, |ledger| {
        ledger.label(scene, paths.depth[i], Source::Instance(instance))
    });
}
