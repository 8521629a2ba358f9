//! Meshes to flat meshes, each with its tree; cached by identity.

use std::{collections::HashMap, sync::Arc};

use rayon::prelude::*;

use crate::{accel::Blas, flat::FlatMesh, world::TriMesh};

/// Flat meshes by the identity of their source, which the cache keeps alive so that no other can take its place.
#[derive(Default)]
pub struct MeshCache {
    meshes: HashMap<usize, (Arc<TriMesh>, Arc<FlatMesh>)>,
}

/// The identity of a mesh: its address, only ever compared.
pub fn id(mesh: &Arc<TriMesh>) -> usize {
    Arc::as_ptr(mesh) as usize
}

impl MeshCache {
    /// The flat form of each mesh, in order, and how many had to be built. Others are forgotten.
    pub fn sync(&mut self, sources: &[Arc<TriMesh>]) -> (Vec<Arc<FlatMesh>>, usize) {
        let mut old = std::mem::take(&mut self.meshes);
        let kept: Vec<_> = sources.iter().map(|source| old.remove(&id(source))).collect();
        let built = kept.iter().filter(|entry| entry.is_none()).count();
        let meshes: Vec<Arc<FlatMesh>> = kept
            .into_par_iter()
            .zip(sources)
            .map(|(entry, source)| entry.map_or_else(|| Arc::new(flatten(source)), |(_, mesh)| mesh))
            .collect();
        self.meshes = sources
            .iter()
            .zip(&meshes)
            .map(|(source, mesh)| (id(source), (Arc::clone(source), Arc::clone(mesh))))
            .collect();
        (meshes, built)
    }
}

fn flatten(mesh: &TriMesh) -> FlatMesh {
    let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.to_array()).collect();
    let corners: Vec<[[f32; 3]; 3]> =
        mesh.triangles.iter().map(|triangle| triangle.map(|vertex| positions[vertex as usize])).collect();
    FlatMesh {
        blas: Arc::new(Blas::build(&corners)),
        positions,
        triangles: mesh.triangles.clone(),
        normals: mesh.normals.iter().map(|n| n.to_array()).collect(),
        tangents: mesh.tangents.iter().map(|t| t.to_array()).collect(),
        uvs: mesh.uvs.iter().map(|set| set.iter().map(|uv| uv.to_array()).collect()).collect(),
        colors: mesh.colors.iter().map(|c| c.to_array()).collect(),
        slots: mesh.slots.clone(),
        slot_count: mesh.slots.iter().copied().max().map_or(1, |slot| u32::from(slot) + 1),
    }
}
