//! Albedo, normals, ids and the like at the first hits. Runs only where a layer is asked for.

use super::{
    queues::{HitQueue, PathQueue},
    surface::{self, Incoming, Parts},
};
use crate::{
    film::{Tile, Unit},
    flat::{FlatScene, NONE, ShadingClass, flags},
    render::LayerKind,
    simd::V3,
};

/// Adds what the camera rays of a wave met to the tile's layers, and to its coverage.
pub fn layers(
    scene: &FlatScene,
    kinds: &[LayerKind],
    materials: &[u32],
    paths: &PathQueue,
    hits: &HitQueue,
    tile: &mut Tile,
) {
    for i in (0..paths.len()).filter(|&i| paths.depth[i] == 0 && hits.instance[i] != NONE) {
        let pixel = paths.slot[i] as usize;
        if !tile.covered.is_empty() {
            tile.covered[pixel] += 1;
        }
        if kinds.is_empty() {
            continue;
        }
        let material = materials[i];
        let direction = [paths.dx[i], paths.dy[i], paths.dz[i]];
        let one = Incoming::<f32> {
            direction: V3::new(direction[0], direction[1], direction[2]),
            b1: hits.b1[i],
            b2: hits.b2[i],
            back: hits.back[i] == 1,
            instance: [hits.instance[i]; 8],
            triangle: [hits.triangle[i]; 8],
            material: [material; 8],
        };
        let mut lookups = 0;
        let surface = if scene.materials.flags[material as usize] & flags::TEXTURED != 0 {
            surface::interact::<f32, true>(scene, &one, Parts::All, false, &mut lookups)
        } else {
            surface::interact::<f32, false>(scene, &one, Parts::All, false, &mut lookups)
        };
        for (layer, kind) in kinds.iter().enumerate() {
            let value = match kind {
                LayerKind::Albedo if scene.materials.class[material as usize] == ShadingClass::Unlit as u32 => {
                    surface.params.base_color.lane(0)
                }
                LayerKind::Albedo => surface.params.albedo().lane(0),
                LayerKind::Normal => surface.frame.n.lane(0),
                LayerKind::Position => surface.p.lane(0),
                LayerKind::Depth => [hits.t[i], 0.0, 0.0],
                LayerKind::Uv => {
                    let mesh = &scene.meshes[scene.instances.mesh[hits.instance[i] as usize] as usize];
                    let [u, v] = mesh.uv_at(0, mesh.vertices(hits.triangle[i]), hits.b1[i], hits.b2[i]);
                    [u, v, 0.0]
                }
                LayerKind::EntityId | LayerKind::MaterialId => {
                    if paths.sample[i] == 0 {
                        let row = if *kind == LayerKind::EntityId { hits.instance[i] } else { material };
                        tile.ids[layer][pixel] = row + 1;
                    }
                    continue;
                }
                LayerKind::SampleCount | LayerKind::Error | LayerKind::Light(_) => continue,
            };
            tile.layers[layer].add(Unit::PLAIN, pixel, value);
        }
    }
}
