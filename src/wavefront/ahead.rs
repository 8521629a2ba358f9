//! Memory that shading is going to need, asked for ahead of time.
//!
//! A hit leads all over memory: to a triangle's row, from there to its vertices, from their texture coordinates to texels. In a
//! scene of many megabytes each of these steps waits for memory, one lane after the other. Here the rows are asked
//! for when hits are sorted, the vertices a few blocks before they are shaded, and the texels when the vertices have come.

use super::queues::HitQueue;
use crate::{
    flat::{FlatImage, FlatScene, NONE},
    simd::prefetch,
};

/// Blocks from the request for vertices to their use; twice as many, and of texels too, is as fast.
pub const VERTICES: usize = 4;
/// Blocks from the request for texels to their use.
pub const TEXELS: usize = 2;

/// Tables of this many bytes are far from a core: larger than what stays in its second-level cache beside the queues.
const FAR: usize = 1 << 19;

/// True if asking ahead pays: a scene that is near is only slowed by it.
pub fn pays(scene: &FlatScene) -> bool {
    let texels = |image: &FlatImage| 4 * image.width as usize * image.height as usize;
    let images: usize = scene.textures.images.iter().map(|image| texels(image)).sum();
    // Indices, positions, normals, texture coordinates, tangents.
    let vertices: usize = scene.meshes.iter().map(|mesh| 12 * mesh.triangles.len() + 48 * mesh.positions.len()).sum();
    images + vertices > FAR
}

/// Asks for the triangles of all hits of a wave.
pub fn rows(scene: &FlatScene, hits: &HitQueue) {
    for (&instance, &triangle) in hits.instance.iter().zip(&hits.triangle) {
        if instance != NONE {
            let mesh = &scene.meshes[scene.instances.mesh[instance as usize] as usize];
            prefetch::<1, _>(&mesh.triangles, triangle as usize);
        }
    }
}

/// Asks for the vertices of hits.
#[inline(always)]
pub fn vertices(scene: &FlatScene, rows: &[u32], hits: &HitQueue) {
    for &row in rows {
        let (instance, triangle) = (hits.instance[row as usize], hits.triangle[row as usize]);
        let mesh = &scene.meshes[scene.instances.mesh[instance as usize] as usize];
        // Shapes have none.
        for &vertex in mesh.triangles.get(triangle as usize).into_iter().flatten() {
            let vertex = vertex as usize;
            prefetch::<1, _>(&mesh.positions, vertex);
            if !mesh.normals.is_empty() {
                prefetch::<1, _>(&mesh.normals, vertex);
            }
            if let Some(uvs) = mesh.uvs.first() {
                prefetch::<1, _>(uvs, vertex);
            }
            if !mesh.tangents.is_empty() {
                prefetch::<1, _>(&mesh.tangents, vertex);
            }
        }
    }
}

/// Asks for the texels of hits whose vertices have come, in the textures that most materials have.
#[inline(always)]
pub fn texels(scene: &FlatScene, rows: &[u32], materials: &[u32], hits: &HitQueue) {
    let (table, textures) = (&scene.materials, &scene.textures);
    for &row in rows {
        let row = row as usize;
        let mesh = &scene.meshes[scene.instances.mesh[hits.instance[row] as usize] as usize];
        let material = materials[row] as usize;
        let slots = [
            table.base_color_texture[material],
            table.metallic_roughness_texture[material],
            table.normal_texture[material],
        ];
        for slot in slots {
            if slot != NONE {
                let vertices = mesh.vertices(hits.triangle[row]);
                let set = textures.slots.tex_coord[slot as usize];
                textures.ask_for(slot, mesh.uv_at(set, vertices, hits.b1[row], hits.b2[row]));
            }
        }
    }
}
