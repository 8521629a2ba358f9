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

    /// The light row of a triangle, or [`NONE`].
    #[inline]
    pub fn light_of(&self, instance: u32, triangle: u32) -> u32 {
        match self.instances.light_base[instance as usize] {
            NONE => NONE,
            base => self.light_rows[(base + triangle) as usize],
        }
    }
}
