//! Meshes to flat meshes, each with its tree; cached by identity.

use std::{
    collections::HashMap,
    sync::Arc,
    time::{Duration, Instant},
};

use rayon::prelude::*;

use super::opacity::MeshOpacity;
use crate::{
    accel::{AccelKind, Blas},
    flat::FlatMesh,
    world::TriMesh,
};

/// Flat meshes by the identity of their source, which the cache keeps alive so that no other can take its place.
#[derive(Default)]
pub struct MeshCache {
    meshes: HashMap<usize, (Arc<TriMesh>, Kept)>,
    /// What the meshes are in.
    accel: AccelKind,
}

struct Kept {
    mesh: Arc<FlatMesh>,
    opacity: MeshOpacity,
}

/// What [`MeshCache::sync`] did.
#[derive(Clone, Copy, Debug, Default)]
pub struct Synced {
    /// Meshes that were put into a structure, because they are new or in another.
    pub built: usize,
    /// Meshes of whose triangles something else is known now.
    pub marked: usize,
    /// Time that building took.
    pub time: Duration,
}

/// The identity of a mesh: its address, only ever compared.
pub fn id(mesh: &Arc<TriMesh>) -> usize {
    Arc::as_ptr(mesh) as usize
}

impl MeshCache {
    /// True if [`MeshCache::sync`] would have nothing to write into the structures of meshes that it has.
    pub fn has(&self, sources: &[(Arc<TriMesh>, MeshOpacity)]) -> bool {
        sources
            .iter()
            .all(|(source, opacity)| self.meshes.get(&id(source)).is_none_or(|(_, kept)| kept.opacity == *opacity))
    }

    /// The flat form of each mesh, in order. Meshes not asked for are forgotten.
    ///
    /// Nobody else should hold flat meshes of an earlier call, or structures of them: those that do are left with copies.
    pub fn sync(
        &mut self,
        sources: Vec<(Arc<TriMesh>, MeshOpacity)>,
        accel: AccelKind,
    ) -> (Vec<Arc<FlatMesh>>, Synced) {
        let restructured = std::mem::replace(&mut self.accel, accel) != accel;
        let mut old = std::mem::take(&mut self.meshes);
        let kept: Vec<Option<Kept>> =
            sources.iter().map(|(source, _)| old.remove(&id(source)).map(|(_, kept)| kept)).collect();
        let build: Vec<bool> = kept.iter().map(|entry| restructured || entry.is_none()).collect();
        let before = kept.iter().map(|entry| entry.as_ref().map(|kept| &kept.opacity));
        // A new structure says of all triangles that they are solid.
        let mark: Vec<bool> = before
            .zip(&build)
            .zip(&sources)
            .map(
                |((before, &build), (_, opacity))| {
                    if build { *opacity != MeshOpacity::default() } else { before != Some(opacity) }
                },
            )
            .collect();
        let mut meshes: Vec<Arc<FlatMesh>> = kept
            .into_par_iter()
            .zip(&sources)
            .map(|(entry, (source, _))| entry.map_or_else(|| Arc::new(flatten(source)), |kept| kept.mesh))
            .collect();
        let start = Instant::now();
        meshes.par_iter_mut().zip(&build).filter(|(_, build)| **build).for_each(|(mesh, _)| {
            let mesh = Arc::make_mut(mesh);
            mesh.blas = Arc::new(blas_of(mesh, accel));
        });
        let time = start.elapsed();
        meshes.par_iter_mut().zip(&mark).zip(&sources).filter(|((_, mark), _)| **mark).for_each(
            |((mesh, _), (_, opacity))| {
                let mesh = Arc::make_mut(mesh);
                Arc::make_mut(&mut mesh.blas).set_opacity(|row| opacity.of(&mesh.slots, row));
            },
        );
        self.meshes = sources
            .into_iter()
            .zip(&meshes)
            .map(|((source, opacity), mesh)| (id(&source), (source, Kept { mesh: Arc::clone(mesh), opacity })))
            .collect();
        let count = |of: &[bool]| of.iter().filter(|one| **one).count();
        (meshes, Synced { built: count(&build), marked: count(&mark), time })
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
