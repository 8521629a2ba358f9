//! Shape: triangle meshes, shared between the entities that show them.

use std::sync::Arc;

use glam::{Vec2, Vec3, Vec4};

use super::SceneKey;

/// Triangles in local space, metres, counter-clockwise seen from the front.
///
/// Attribute vectors are empty or have one element per position. Every number
/// is finite; [`TriMesh::check`] says what must hold.
#[derive(Clone, Debug, Default)]
pub struct TriMesh {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Unit shading normals, or empty for flat shading. A zero vector means
    /// "the geometric normal", for meshes of which only some parts are smooth.
    pub normals: Vec<Vec3>,
    /// Unit tangents with the bitangent's sign in `w`, or empty. A zero vector means "none".
    pub tangents: Vec<Vec4>,
    /// Texture coordinate sets; each empty or one per position.
    pub uvs: Vec<Vec<Vec2>>,
    /// Linear vertex colours, or empty.
    pub colors: Vec<Vec4>,
    /// Vertex rows of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Material slot of each triangle, or empty when all use slot 0.
    pub slots: Vec<u16>,
}

impl TriMesh {
    /// A mesh of positions and triangles alone: flat shading, slot 0.
    pub fn new(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        Self { positions, triangles, ..Self::default() }
    }

    /// An axis-aligned box from `min` to `max`, faces outwards.
    pub fn cuboid(min: Vec3, max: Vec3) -> Self {
        let corner = |i: u32| {
            Vec3::new(
                if i & 1 == 0 { min.x } else { max.x },
                if i & 2 == 0 { min.y } else { max.y },
                if i & 4 == 0 { min.z } else { max.z },
            )
        };
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        Self::new((0..8).map(corner).collect(), triangles)
    }

    /// The parallelogram `origin`, `origin + u`, `origin + u + v`, `origin + v`, facing `u × v`.
    ///
    /// Texture coordinates run from 0 to 1 along `u` and, downwards, along `v`.
    pub fn quad(origin: Vec3, u: Vec3, v: Vec3) -> Self {
        let uv = [Vec2::new(0.0, 1.0), Vec2::new(1.0, 1.0), Vec2::new(1.0, 0.0), Vec2::new(0.0, 0.0)];
        Self {
            positions: vec![origin, origin + u, origin + u + v, origin + v],
            uvs: vec![uv.to_vec()],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Self::default()
        }
    }

    /// A sphere of `rings × 2·rings` patches with exact normals, faces outwards.
    pub fn sphere(center: Vec3, radius: f32, rings: u32) -> Self {
        let (rows, columns) = (rings.max(2), 2 * rings.max(2));
        let mut mesh = Self::default();
        let mut uvs = Vec::new();
        for row in 0..=rows {
            let theta = std::f64::consts::PI * f64::from(row) / f64::from(rows);
            for column in 0..=columns {
                let phi = std::f64::consts::TAU * f64::from(column % columns) / f64::from(columns);
                // The poles' sine is set to zero by hand so that their triangles close exactly.
                let sin = if row == 0 || row == rows { 0.0 } else { theta.sin() };
                let n = Vec3::new(
                    (sin * phi.cos()) as f32,
                    if row == 0 {
                        1.0
                    } else if row == rows {
                        -1.0
                    } else {
                        theta.cos() as f32
                    },
                    (sin * phi.sin()) as f32,
                );
                mesh.positions.push(center + radius * n);
                mesh.normals.push(n.normalize());
                uvs.push(Vec2::new(column as f32 / columns as f32, row as f32 / rows as f32));
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let a = row * (columns + 1) + column;
                let (b, c, d) = (a + 1, a + columns + 1, a + columns + 2);
                if row > 0 {
                    mesh.triangles.push([a, b, d]);
                }
                if row + 1 < rows {
                    mesh.triangles.push([a, d, c]);
                }
            }
        }
        mesh.uvs = vec![uvs];
        mesh
    }

    /// A flat disc facing `+Y` about `center`, as a fan of `segments` triangles inscribed in the circle.
    pub fn disc(center: Vec3, radius: f32, segments: u32) -> Self {
        let mut positions = vec![center];
        for i in 0..segments {
            let phi = std::f64::consts::TAU * f64::from(i) / f64::from(segments);
            positions.push(center + radius * Vec3::new(phi.cos() as f32, 0.0, -phi.sin() as f32));
        }
        let triangles = (0..segments).map(|i| [0, 1 + i, 1 + (i + 1) % segments]).collect();
        Self::new(positions, triangles)
    }

    /// Says what is wrong with the mesh, if anything: lengths, row bounds, finiteness.
    ///
    /// # Errors
    /// One sentence that names the attribute, the row and both numbers.
    pub fn check(&self) -> Result<(), String> {
        let vertices = self.positions.len();
        let lengths =
            [("normals", self.normals.len()), ("tangents", self.tangents.len()), ("colors", self.colors.len())];
        let uv_lengths = self.uvs.iter().map(|set| ("uvs", set.len()));
        for (name, length) in lengths.into_iter().chain(uv_lengths) {
            if length != 0 && length != vertices {
                return Err(format!("{name} has {length} elements, positions has {vertices}"));
            }
        }
        if !self.slots.is_empty() && self.slots.len() != self.triangles.len() {
            return Err(format!("slots has {} elements, triangles has {}", self.slots.len(), self.triangles.len()));
        }
        for (row, triangle) in self.triangles.iter().enumerate() {
            if let Some(index) = triangle.iter().find(|&&index| index as usize >= vertices) {
                return Err(format!("triangle {row} refers to vertex {index} of {vertices}"));
            }
        }
        let finite = self.positions.iter().all(|p| p.is_finite())
            && self.normals.iter().all(|n| n.is_finite())
            && self.tangents.iter().all(|t| t.is_finite())
            && self.uvs.iter().flatten().all(|uv| uv.is_finite())
            && self.colors.iter().all(|c| c.is_finite());
        if finite { Ok(()) } else { Err("a vertex attribute is not finite".to_owned()) }
    }
}

/// The triangles an entity shows, shared with every other entity that shows them.
///
/// Meshes are immutable: an edit replaces the `Arc`. Equality is identity, so
/// change detection costs one pointer comparison per entity.
#[derive(Clone, Debug)]
pub struct Geometry(pub Arc<TriMesh>);

impl PartialEq for Geometry {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// The entities whose [`Material`](super::Material) each slot of the mesh uses.
///
/// A slot without an entry, or whose key has no material, gets glTF's default material.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaterialSlots(pub Arc<[SceneKey]>);

impl From<SceneKey> for MaterialSlots {
    fn from(key: SceneKey) -> Self {
        Self(Arc::new([key]))
    }
}
