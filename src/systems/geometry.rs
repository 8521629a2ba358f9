//! Meshes to flat meshes, each with its tree; cached by identity.

use std::{
    collections::HashMap,
    sync::Arc,
    time::{Duration, Instant},
};

use rayon::prelude::*;

use crate::{
    accel::{AccelKind, Blas},
    flat::FlatMesh,
    world::TriMesh,
};

/// Flat meshes by the identity of their source, which the cache keeps alive so that no other can take its place.
#[derive(Default)]
pub struct MeshCache {
    meshes: HashMap<usize, (Arc<TriMesh>, Arc<FlatMesh>)>,
    /// What the meshes are in.
    accel: AccelKind,
}

/// The identity of a mesh: its address, only ever compared.
pub fn id(mesh: &Arc<TriMesh>) -> usize {
    Arc::as_ptr(mesh) as usize
}

impl MeshCache {
    /// The flat form of each mesh, in order; how many had to be put into a structure, because they are new or in another;
    /// and the time that this took. Meshes not asked for are forgotten.
    ///
    /// Nobody else should hold flat meshes of an earlier call: those that do are left with copies.
    pub fn sync(&mut self, sources: &[Arc<TriMesh>], accel: AccelKind) -> (Vec<Arc<FlatMesh>>, usize, Duration) {
        let restructured = std::mem::replace(&mut self.accel, accel) != accel;
        let mut old = std::mem::take(&mut self.meshes);
        let kept: Vec<_> = sources.iter().map(|source| old.remove(&id(source))).collect();
        let wanting: Vec<bool> = kept.iter().map(|entry| restructured || entry.is_none()).collect();
        let mut meshes: Vec<Arc<FlatMesh>> = kept
            .into_par_iter()
            .zip(sources)
            .map(|(entry, source)| entry.map_or_else(|| Arc::new(flatten(source)), |(_, mesh)| mesh))
            .collect();
        let start = Instant::now();
        meshes.par_iter_mut().zip(&wanting).filter(|(_, wanting)| **wanting).for_each(|(mesh, _)| {
            let mesh = Arc::make_mut(mesh);
            mesh.blas = Arc::new(blas_of(mesh, accel));
        });
        let time = start.elapsed();
        self.meshes = sources
            .iter()
            .zip(&meshes)
            .map(|(source, mesh)| (id(source), (Arc::clone(source), Arc::clone(mesh))))
            .collect();
        (meshes, wanting.into_iter().filter(|wanting| *wanting).count(), time)
    }
}

fn blas_of(mesh: &FlatMesh, accel: AccelKind) -> Blas {
    let corners: Vec<[[f32; 3]; 3]> = (0..mesh.triangles.len() as u32).map(|row| mesh.corners(row)).collect();
    Blas::build_as(accel, &corners)
}

/// All but the tree.
fn flatten(mesh: &TriMesh) -> FlatMesh {
    FlatMesh {
        blas: Arc::default(),
        positions: mesh.positions.iter().map(|p| p.to_array()).collect(),
        triangles: mesh.triangles.clone(),
        normals: mesh.normals.iter().map(|n| n.to_array()).collect(),
        tangents: mesh.tangents.iter().map(|t| t.to_array()).collect(),
        uvs: mesh.uvs.iter().map(|set| set.iter().map(|uv| uv.to_array()).collect()).collect(),
        colors: mesh.colors.iter().map(|c| c.to_array()).collect(),
        slots: mesh.slots.clone(),
        slot_count: mesh.slots.iter().copied().max().map_or(1, |slot| u32::from(slot) + 1),
    }
}
