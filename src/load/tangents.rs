//! Tangents where a normal map needs them and the file has none, by MikkTSpace.

use std::collections::HashMap;

use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use glam::{Vec2, Vec3, Vec4};

use super::vertices::{Part, unit, unit_tangent};
use crate::world::UvTransform;

/// Coordinates beyond this would overflow the products that MikkTSpace makes of them.
const LARGEST: f32 = 1e8;

/// The texture coordinates that a normal map is looked up with, as far as tangents depend on them: these are
/// the ones behind the texture's transform, so a map that is turned takes its tangents along.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Along {
    /// Set of texture coordinates.
    pub(super) set: u32,
    /// Rows of the linear part of the transform, as bits; lengths are left out where that turns nothing.
    linear: [u32; 4],
}

impl Along {
    pub(super) fn new(set: u32, transform: &UvTransform) -> Self {
        let turned = transform.rotation != 0.0;
        let scale = if turned { transform.scale } else { transform.scale.map(f32::signum) };
        let [[a, b, _], [c, d, _]] = UvTransform { scale, ..*transform }.rows();
        // Adding zero takes the sign off zeros.
        Self { set, linear: [a, b, c, d].map(|x| (x + 0.0).to_bits()) }
    }

    fn of(self, uv: Vec2) -> Vec2 {
        let [a, b, c, d] = self.linear.map(f32::from_bits);
        Vec2::new(a * uv.x + b * uv.y, c * uv.x + d * uv.y)
    }
}

/// A part seen as MikkTSpace wants it: every triangle with corners of its own.
struct Corners<'p> {
    part: &'p Part,
    uvs: Vec<Vec2>,
    tangents: Vec<[Vec4; 3]>,
}

impl Corners<'_> {
    fn row(&self, face: usize, corner: usize) -> usize {
        self.part.triangles[face][corner] as usize
    }
}

impl Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.part.triangles.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.part.positions[self.row(face, corner)].to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        let given = self.part.normals.get(self.row(face, corner)).copied().unwrap_or(Vec3::ZERO);
        if given != Vec3::ZERO {
            return given.to_array();
        }
        let [a, b, c] = self.part.triangles[face].map(|row| self.part.positions[row as usize]);
        unit((b - a).cross(c - a)).to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        self.uvs[self.row(face, corner)].to_array()
    }

    fn set_tangent(&mut self, space: Option<TangentSpace>, face: usize, corner: usize) {
        // The specification flips v, as its images have their origin at the top: the sign flips with it.
        let [x, y, z, w] = space.unwrap_or_default().tangent_encoded();
        self.tangents[face][corner] = unit_tangent(Vec4::new(x, y, z, -w));
    }
}

/// Gives a part tangents along some texture coordinates.
///
/// A vertex whose triangles disagree is split; triangles that agree go on
/// sharing it. False, and nothing done, if the part cannot have tangents.
pub(super) fn generate(part: &mut Part, along: Along) -> bool {
    let set = usize::try_from(along.set).ok().and_then(|set| part.uvs.get(set));
    let Some(uvs) = set.filter(|uvs| !uvs.is_empty()) else { return false };
    let uvs: Vec<Vec2> = uvs.iter().map(|&uv| along.of(uv)).collect();
    let sound = part.positions.iter().all(|p| p.abs().max_element() <= LARGEST)
        && uvs.iter().all(|uv| uv.is_finite() && uv.abs().max_element() <= LARGEST);
    if !sound {
        return false;
    }
    let tangents = vec![[Vec4::ZERO; 3]; part.triangles.len()];
    let mut corners = Corners { part, uvs, tangents };
    if generate_tangents(&mut corners).is_err() {
        return false;
    }
    let tangents = corners.tangents;
    weld(part, &tangents);
    true
}

/// Gives each vertex its tangent, with a copy of the vertex for each further one.
fn weld(part: &mut Part, corners: &[[Vec4; 3]]) {
    let mut first: Vec<Option<Vec4>> = vec![None; part.positions.len()];
    let mut copies: HashMap<(u32, [u32; 4]), u32> = HashMap::new();
    let mut sources: Vec<u32> = Vec::new();
    let mut copied: Vec<Vec4> = Vec::new();
    for (triangle, tangents) in part.triangles.iter_mut().zip(corners) {
        for (row, &tangent) in triangle.iter_mut().zip(tangents) {
            let held = first[*row as usize].get_or_insert(tangent);
            if *held == tangent {
                continue;
            }
            let next = (first.len() + sources.len()) as u32;
            let copy = *copies.entry((*row, tangent.to_array().map(f32::to_bits))).or_insert(next);
            if copy == next {
                sources.push(*row);
                copied.push(tangent);
            }
            *row = copy;
        }
    }
    part.tangents = first.into_iter().map(Option::unwrap_or_default).chain(copied).collect();
    extend(&mut part.positions, &sources);
    extend(&mut part.normals, &sources);
    extend(&mut part.colors, &sources);
    part.uvs.iter_mut().for_each(|uvs| extend(uvs, &sources));
    for (joints, weights) in &mut part.influences {
        extend(joints, &sources);
        extend(weights, &sources);
    }
}

fn extend<T: Copy>(column: &mut Vec<T>, sources: &[u32]) {
    if !column.is_empty() {
        column.reserve_exact(sources.len());
        for &source in sources {
            column.push(column[source as usize]);
        }
    }
}
