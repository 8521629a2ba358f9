//! The scene as rays see it: tables, one column per field.
//!
//! In flow the [systems](crate::systems); out, shared and unchanging while a
//! picture is made, to the stages. No hecs, no names, no files: a row number is all
//! that one table knows of another. Rows follow the persistent keys, so that the
//! tables of a scene do not depend on the edits that led to it.

mod camera;
mod groups;
mod instances;
mod lights;
mod materials;
mod meshes;
mod needs;
pub mod soa;
mod textures;

use std::sync::Arc;

use glam::{BVec3, Vec3};

pub use self::{
    camera::{CameraView, ViewProjection},
    groups::{LightGroups, Source},
    instances::{Instance, Instances},
    lights::{
        Candidate, DistantLight, DistantLights, EmissiveShape, EmissiveShapes, EmissiveTriangle, EmissiveTriangles,
        EnvironmentLight, Lights, LocalLight, LocalLights,
    },
    materials::{COVERS, MaterialRow, Materials, ShadingClass, flags},
    meshes::FlatMesh,
    needs::SceneNeeds,
    textures::{Decode, FlatImage, ImageTexels, TextureSlot, TextureSlots, Textures},
};
use crate::accel::Accel;

/// "No row": the value of an optional reference into another table.
pub const NONE: u32 = u32::MAX;

/// Everything the stages read.
#[derive(Clone, Debug, Default)]
pub struct FlatScene {
    /// Shared meshes, in local space.
    pub meshes: Vec<Arc<FlatMesh>>,
    /// Placed meshes, one row per entity with geometry that is visible.
    pub instances: Instances,
    /// Rows of [`Self::materials`], for instance `i` and slot `s` at `instances.material_base[i] + s`.
    pub material_rows: Vec<u32>,
    /// For the emissive instances: the light row of each triangle, or [`NONE`]; triangle `t` of
    /// instance `i` at `instances.light_base[i] + t` unless that base is [`NONE`]. Of a shape every face has the row that
    /// [`Lights::shape_row`] gives.
    pub light_rows: Vec<u32>,
    /// Appearance.
    pub materials: Materials,
    /// Texels and how materials look into them.
    pub textures: Textures,
    /// Emitters and how to choose among them.
    pub lights: Lights,
    /// The eye.
    pub camera: CameraView,
    /// Rays against all of it.
    pub accel: Accel,
    /// What this scene needs; what it does not is not run.
    pub needs: SceneNeeds,
    /// Centre of a ball that holds all geometry, m.
    pub center: [f32; 3],
    /// Radius of that ball, m; 0 for an empty scene.
    pub radius: f32,
}

impl FlatScene {
    /// The material row of a triangle.
    #[inline]
    pub fn material_of(&self, instance: u32, triangle: u32) -> u32 {
        let mesh = &self.meshes[self.instances.mesh[instance as usize] as usize];
        let slot = mesh.slots.get(triangle as usize).copied().unwrap_or(0);
        self.material_rows[self.instances.material_base[instance as usize] as usize + slot as usize]
    }

    /// Least and greatest corner of an instance's box in the world, m; infinite for a plane.
    pub fn box_of(&self, instance: usize) -> (Vec3, Vec3) {
        let mesh = &self.meshes[self.instances.mesh[instance] as usize];
        let (least, most) = mesh.blas.bounds();
        let (least, most) = (Vec3::from(least), Vec3::from(most));
        if mesh.shape.is_some() && !least.cmple(most).all() {
            return (Vec3::NEG_INFINITY, Vec3::INFINITY);
        }
        let corners = (0..8).map(|i| {
            let high = |axis: u32| i >> axis & 1 == 1;
            let corner = Vec3::select(BVec3::new(high(0), high(1), high(2)), most, least);
            self.placed(instance, corner)
        });
        corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)))
    }

    /// A point of an instance's mesh in the world, m.
    pub fn placed(&self, instance: usize, p: Vec3) -> Vec3 {
        let m = &self.instances.world_from_local[instance];
        Vec3::from_array([0, 1, 2].map(|i| Vec3::new(m[4 * i], m[4 * i + 1], m[4 * i + 2]).dot(p) + m[4 * i + 3]))
    }

    /// The light row of a triangle, or [`NONE`].
    #[inline]
    pub fn light_of(&self, instance: u32, triangle: u32) -> u32 {
        match self.instances.light_base[instance as usize] {
            NONE => NONE,
            base => self.light_rows[(base + triangle) as usize],
        }
    }
}
