//! Morph targets, baked at the default weights.

use glam::Vec3;
use serde_json::Value;

use super::{
    error::LoadError,
    json::Json,
    vertices::{Attributes, Part, unit},
};

/// The weights a node shows its mesh with; empty if the mesh has no targets or none has a weight.
pub(super) fn read_weights(node: &Json<'_>, mesh: &Json<'_>) -> Result<Vec<f32>, LoadError> {
    let found = match node.get("weights")? {
        Some(weights) => Some(weights),
        None => mesh.get("weights")?,
    };
    let Some(json) = found else { return Ok(Vec::new()) };
    // All primitives of a mesh have as many targets; each is compared when it is read.
    let targets = mesh.value.pointer("/primitives/0/targets").and_then(Value::as_array).map_or(0, Vec::len);
    let weights =
        json.items()?.iter().map(|weight| weight.number().map(|w| w as f32)).collect::<Result<Vec<_>, _>>()?;
    if weights.len() != targets {
        return Err(json.expected(format!("{targets} weights, one per morph target")));
    }
    Ok(if weights.iter().all(|&weight| weight == 0.0) { Vec::new() } else { weights })
}

/// Adds the weighted targets of a primitive to the given rows of its vertices.
///
/// # Errors
/// If a target is malformed or a result is not finite.
pub(super) fn apply(
    part: &mut Part,
    primitive: &Json<'_>,
    attributes: &Attributes<'_, '_>,
    weights: &[f32],
    rows: &[u32],
) -> Result<(), LoadError> {
    let targets = primitive.list("targets")?;
    if targets.len() != weights.len() {
        let at = primitive.at.join("targets");
        let (expected, found) = (format!("{} targets, one per weight", weights.len()), targets.len().to_string());
        return Err(LoadError::Value { at, expected, found });
    }
    for (target, &weight) in targets.into_iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
        let at = target.at.clone();
        let target = Attributes {
            json: target,
            document: attributes.document,
            buffers: attributes.buffers,
            count: attributes.count,
        };
        let deltas = |key: &str, wanted: bool| if wanted { target.floats::<3>(key, rows) } else { Ok(None) };
        add(&mut part.positions, deltas("POSITION", true)?, weight);
        let normals = deltas("NORMAL", !part.normals.is_empty())?;
        add(&mut part.normals, normals, weight);
        if let Some(deltas) = deltas("TANGENT", !part.tangents.is_empty())? {
            for (tangent, delta) in part.tangents.iter_mut().zip(deltas) {
                *tangent += (weight * Vec3::from(delta)).extend(0.0);
            }
        }
        if let Some(row) = part.positions.iter().position(|p| !p.is_finite()) {
            return Err(LoadError::Value {
                at,
                expected: "finite positions".to_owned(),
                found: format!("{} at vertex {}", part.positions[row], rows[row]),
            });
        }
    }
    part.normals.iter_mut().for_each(|n| *n = unit(*n));
    part.tangents.iter_mut().for_each(|t| *t = super::vertices::unit_tangent(*t));
    Ok(())
}

fn add(values: &mut [Vec3], deltas: Option<Vec<[f32; 3]>>, weight: f32) {
    for (value, delta) in values.iter_mut().zip(deltas.unwrap_or_default()) {
        *value += weight * Vec3::from(delta);
    }
}
