//! Placed meshes.

use crate::soa;

soa! {
    /// Meshes in the world, in order of their entities' keys.
    ///
    /// A 3×4 matrix is stored by rows: `x' = m[0]·x + m[1]·y + m[2]·z + m[3]`.
    pub struct Instances of Instance {
        /// Row of the mesh.
        mesh: u32,
        /// First of its material rows; see `FlatScene::material_rows`.
        material_base: u32,
        /// First of its light rows, or `NONE` if nothing of it emits.
        light_base: u32,
        /// 1 if the transform mirrors, which turns the front of a triangle to its back.
        mirrored: u32,
        /// 1 if the transform is exactly the identity.
        identity: u32,
        /// Persistent key of the entity.
        key: u64,
        /// World from local space.
        world_from_local: [f32; 12],
        /// Local from world space: the inverse, rounded from f64.
        local_from_world: [f32; 12],
    }
}
