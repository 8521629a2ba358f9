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
    /// Texture coordinates of a set at a point of a triangle given by its vertices; 0 where the set is missing.
    #[inline]
    pub fn uv_at(&self, set: u32, triangle: [u32; 3], b1: f32, b2: f32) -> [f32; 2] {
        match self.uvs.get(set as usize) {
            Some(uvs) if !uvs.is_empty() => {
                let [a, b, c] = triangle.map(|vertex| uvs[vertex as usize]);
                let b0 = 1.0 - b1 - b2;
                [b0 * a[0] + b1 * b[0] + b2 * c[0], b0 * a[1] + b1 * b[1] + b2 * c[1]]
            }
            _ => [0.0; 2],
        }
    }

    /// The three corners of a triangle, m.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [[f32; 3]; 3] {
        self.triangles[triangle as usize].map(|vertex| self.positions[vertex as usize])
    }
}
