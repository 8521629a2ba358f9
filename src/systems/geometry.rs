//! Meshes to flat meshes, each with its tree; cached by identity. Shapes become flat meshes without triangles.

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
    world::{Shape, TriMesh},
};

/// Flat meshes by the identity of their source, which the cache keeps alive so that no other can take its place.
#[derive(Default)]
pub struct MeshCache {
    meshes: HashMap<FormId, (Form, Kept)>,
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

/// What an entity shows.
#[derive(Clone, Debug)]
pub enum Form {
    /// Triangles.
    Mesh(Arc<TriMesh>),
    /// A formula.
    Shape(Shape),
}

/// Which form it is: equal for those that share a flat mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FormId {
    /// By its address, only ever compared.
    Mesh(usize),
    /// By its kind and the bits of its sizes.
    Shape([u32; 3]),
}

impl Form {
    /// Its identity.
    pub fn id(&self) -> FormId {
        match self {
            Self::Mesh(mesh) => FormId::Mesh(Arc::as_ptr(mesh) as usize),
            Self::Shape(shape) => FormId::Shape(match *shape {
                Shape::Plane => [0; 3],
                Shape::Sphere { radius } => [1, radius.to_bits(), 0],
                Shape::Disc { radius } => [2, radius.to_bits(), 0],
                Shape::Cylinder { radius, half_height } => [3, radius.to_bits(), half_height.to_bits()],
            }),
        }
    }

    /// Says what is wrong with it, if anything.
    pub fn check(&self) -> Result<(), String> {
        match self {
            Self::Mesh(mesh) => mesh.check(),
            Self::Shape(shape) => shape.check(),
        }
    }

    /// Material slots that it uses: one more than the largest.
    pub fn slot_count(&self) -> u32 {
        match self {
            Self::Mesh(mesh) => mesh.slots.iter().copied().max().map_or(1, |slot| u32::from(slot) + 1),
            Self::Shape(_) => 1,
        }
    }

    /// It has vertex colours.
    pub fn is_colored(&self) -> bool {
        matches!(self, Self::Mesh(mesh) if !mesh.colors.is_empty())
    }
}

impl MeshCache {
    /// True if [`MeshCache::sync`] would have nothing to write into the structures of meshes that it has.
    pub fn has(&self, sources: &[(Form, MeshOpacity)]) -> bool {
        sources
            .iter()
            .all(|(source, opacity)| self.meshes.get(&source.id()).is_none_or(|(_, kept)| kept.opacity == *opacity))
    }

    /// The flat form of each mesh, in order. Meshes not asked for are forgotten.
    ///
    /// Nobody else should hold flat meshes of an earlier call, or structures of them: those that do are left with copies.
    pub fn sync(&mut self, sources: Vec<(Form, MeshOpacity)>, accel: AccelKind) -> (Vec<Arc<FlatMesh>>, Synced) {
        let restructured = std::mem::replace(&mut self.accel, accel) != accel;
        let mut old = std::mem::take(&mut self.meshes);
        let kept: Vec<Option<Kept>> =
            sources.iter().map(|(source, _)| old.remove(&source.id()).map(|(_, kept)| kept)).collect();
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
            .map(|((source, opacity), mesh)| (source.id(), (source, Kept { mesh: Arc::clone(mesh), opacity })))
            .collect();
        let count = |of: &[bool]| of.iter().filter(|one| **one).count();
        (meshes, Synced { built: count(&build), marked: count(&mark), time })
    }
}

fn blas_of(mesh: &FlatMesh, accel: AccelKind) -> Blas {
    if let Some(shape) = mesh.shape {
        return Blas::of_shape(shape);
    }
    let corners: Vec<[[f32; 3]; 3]> = (0..mesh.triangles.len() as u32).map(|row| mesh.corners(row)).collect();
    Blas::build_as(accel, &corners)
}

/// All but the tree.
fn flatten(form: &Form) -> FlatMesh {
    let mesh = match form {
        Form::Mesh(mesh) => mesh,
        Form::Shape(shape) => return FlatMesh { shape: Some(*shape), slot_count: 1, ..FlatMesh::default() },
    };
    FlatMesh {
        blas: Arc::default(),
        shape: None,
        positions: mesh.positions.iter().map(|p| p.to_array()).collect(),
        triangles: mesh.triangles.clone(),
        normals: mesh.normals.iter().map(|n| n.to_array()).collect(),
        tangents: mesh.tangents.iter().map(|t| t.to_array()).collect(),
        uvs: mesh.uvs.iter().map(|set| set.iter().map(|uv| uv.to_array()).collect()).collect(),
        colors: mesh.colors.iter().map(|c| c.to_array()).collect(),
        slots: mesh.slots.clone(),
        slot_count: form.slot_count(),
    }
}
