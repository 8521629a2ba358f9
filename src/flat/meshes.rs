//! A mesh ready for rays: attributes by vertex row, and its own tree.

use std::sync::Arc;

use crate::accel::Blas;

/// Triangles in local space with what shading interpolates.
///
/// Attribute columns are empty or have one element per vertex.
#[derive(Clone, Debug, Default)]
pub struct FlatMesh {
    /// Vertex positions, m.
    pub positions: Vec<[f32; 3]>,
    /// Vertex rows of each triangle; degenerate triangles are kept, they are never hit.
    pub triangles: Vec<[u32; 3]>,
    /// Unit shading normals; zero where the geometric normal is meant.
    pub normals: Vec<[f32; 3]>,
    /// Unit tangents, the bitangent's sign in `w`; zero where there is none.
    pub tangents: Vec<[f32; 4]>,
    /// Texture coordinate sets.
    pub uvs: Vec<Vec<[f32; 2]>>,
    /// Linear vertex colours.
    pub colors: Vec<[f32; 4]>,
    /// Material slot of each triangle; empty when all use slot 0.
    pub slots: Vec<u16>,
    /// Number of slots: one more than the largest.
    pub slot_count: u32,
    /// Rays against the triangles.
    pub blas: Arc<Blas>,
}

impl FlatMesh {
    /// The three corners of a triangle, m.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [[f32; 3]; 3] {
        self.triangles[triangle as usize].map(|vertex| self.positions[vertex as usize])
    }
}
