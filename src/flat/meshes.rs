//! A mesh ready for rays: attributes by vertex row, and its own tree. Or a surface given by a formula, without any.

use std::sync::Arc;

use crate::{accel::Blas, world::Shape};

/// Triangles in local space with what shading interpolates. Without triangles, it is a shape.
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
    /// A surface given by a formula, in place of triangles: hits then hold a place on it.
    pub shape: Option<Shape>,
    /// Rays against the triangles or the shape.
    pub blas: Arc<Blas>,
}

impl FlatMesh {
    /// The vertices of a triangle. A shape has none; in their place stands the face that was hit, as
    /// [`FlatMesh::uv_at`] takes it.
    #[inline(always)]
    pub fn vertices(&self, triangle: u32) -> [u32; 3] {
        self.triangles.get(triangle as usize).copied().unwrap_or([triangle, 0, 0])
    }

    /// Texture coordinates of a set at a point of a triangle given by its [`FlatMesh::vertices`]; 0 where the set is
    /// missing. A shape has the same in all sets.
    #[inline]
    pub fn uv_at(&self, set: u32, triangle: [u32; 3], b1: f32, b2: f32) -> [f32; 2] {
        match self.uvs.get(set as usize) {
            Some(uvs) if !uvs.is_empty() => {
                let [a, b, c] = triangle.map(|vertex| uvs[vertex as usize]);
                let b0 = 1.0 - b1 - b2;
                [b0 * a[0] + b1 * b[0] + b2 * c[0], b0 * a[1] + b1 * b[1] + b2 * c[1]]
            }
            _ => self.uv_of_shape(triangle[0], b1, b2),
        }
    }

    /// Texture coordinates of a place on a shape; 0 if it is none.
    #[cold]
    fn uv_of_shape(&self, face: u32, b1: f32, b2: f32) -> [f32; 2] {
        self.shape.map_or([0.0; 2], |shape| shape.uv(shape.point(face, b1, b2)))
    }

    /// The three corners of a triangle, m.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [[f32; 3]; 3] {
        self.triangles[triangle as usize].map(|vertex| self.positions[vertex as usize])
    }
}
