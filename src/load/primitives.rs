//! Primitives: which vertices make which triangles.

use gltf::json::mesh as gl;

use super::{
    accessors::{Accessor, Rows},
    buffers::Buffers,
    document::{ACCESSORS, Document},
    error::{LoadError, Warnings},
    json::Json,
};

/// How vertices make triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Topology {
    /// Three each.
    List,
    /// Each with the two before it.
    Strip,
    /// Each with the one before it and the first.
    Fan,
}

/// The topology of a primitive; none for points and lines.
pub(super) fn read_topology(primitive: &Json<'_>) -> Result<Option<Topology>, LoadError> {
    let Some(mode) = primitive.get("mode")? else { return Ok(Some(Topology::List)) };
    match u32::try_from(mode.unsigned()?).unwrap_or(u32::MAX) {
        gl::TRIANGLES => Ok(Some(Topology::List)),
        gl::TRIANGLE_STRIP => Ok(Some(Topology::Strip)),
        gl::TRIANGLE_FAN => Ok(Some(Topology::Fan)),
        gl::POINTS | gl::LINES | gl::LINE_LOOP | gl::LINE_STRIP => Ok(None),
        _ => Err(mode.expected("a mode from 0 to 6")),
    }
}

/// The number of triangles that `vertices` in this topology make.
pub(super) fn triangle_count(topology: Topology, vertices: u64) -> u64 {
    match topology {
        Topology::List => vertices / 3,
        Topology::Strip | Topology::Fan => vertices.saturating_sub(2),
    }
}

/// The triangles of a primitive, as rows of its `vertices` vertices.
///
/// # Errors
/// If an index is out of range.
pub(super) fn read_triangles(
    primitive: &Json<'_>,
    topology: Topology,
    vertices: usize,
    document: &Document<'_>,
    buffers: &Buffers<'_>,
    warnings: &mut Warnings,
) -> Result<Vec<[u32; 3]>, LoadError> {
    let indices = match primitive.get("indices")? {
        None => None,
        Some(reference) => {
            let (_, json) = document.follow(&reference, ACCESSORS)?;
            let accessor = Accessor::new(json, buffers)?;
            buffers.charge(&reference.at, accessor.count as u64)?;
            let indices = accessor.integers::<1>(Rows::All)?;
            if let Some([index]) = indices.iter().find(|[index]| *index as usize >= vertices) {
                let index = u64::from(*index);
                return Err(LoadError::Reference { at: reference.at, what: "vertex", index, count: vertices });
            }
            Some(indices)
        }
    };
    let count = indices.as_ref().map_or(vertices, Vec::len);
    buffers.charge(&primitive.at, count as u64)?;
    if topology == Topology::List && !count.is_multiple_of(3) {
        warnings.push(&primitive.at, format!("{count} is not a multiple of 3 vertices; the last triangle is left out"));
    }
    let vertex = |i: usize| indices.as_ref().map_or(i as u32, |indices| indices[i][0]);
    let triangles = 0..triangle_count(topology, count as u64) as usize;
    // glTF 2.0 section 3.7.2.1: the orders that keep the winding.
    Ok(match topology {
        Topology::List => triangles.map(|i| [3 * i, 3 * i + 1, 3 * i + 2].map(vertex)).collect(),
        Topology::Strip => triangles.map(|i| [i, i + 1 + i % 2, i + 2 - i % 2].map(vertex)).collect(),
        Topology::Fan => triangles.map(|i| [i + 1, i + 2, 0].map(vertex)).collect(),
    })
}
