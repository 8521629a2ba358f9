//! Skins, baked in the pose that the file's nodes stand in.

use glam::{DAffine3, DMat3, DMat4, Vec3, Vec4};

use super::{
    accessors::{Accessor, Rows},
    buffers::Buffers,
    document::{ACCESSORS, Document, NODES},
    error::{LoadError, Place, Warnings},
    json::Json,
    nodes::Nodes,
    vertices::{Part, unit, unit_tangent},
};

/// A skin in a pose.
#[derive(Debug)]
pub(super) struct Skin {
    /// Skin and, where some vertices have no joints, node: equal ones bend a mesh alike.
    pub(super) identity: (usize, Option<usize>),
    /// World space from the space of the mesh, per joint.
    joints: Vec<DAffine3>,
    /// The node that shows the mesh: where vertices without joints stay.
    world_from_node: DAffine3,
}

/// Reads a skin in the rest pose of its joints.
pub(super) fn read_skin(
    identity: (usize, Option<usize>),
    skin: &Json<'_>,
    world_from_node: DAffine3,
    document: &Document<'_>,
    nodes: &Nodes,
    buffers: &Buffers<'_>,
) -> Result<Skin, LoadError> {
    let joints = skin.required("joints")?.items()?;
    let inverse_binds: Option<Vec<[f32; 16]>> = match document.follow_key(skin, "inverseBindMatrices", ACCESSORS)? {
        None => None,
        Some((_, json)) => {
            let accessor = Accessor::new(json, buffers)?;
            if accessor.count < joints.len() {
                return Err(accessor.expected(&format!("a matrix for each of the {} joints", joints.len())));
            }
            buffers.charge(&skin.at, accessor.count as u64)?;
            Some(accessor.floats(Rows::All)?)
        }
    };
    let mut matrices = Vec::with_capacity(joints.len());
    for (row, joint) in joints.iter().enumerate() {
        let world = nodes.worlds[joint.index(NODES.what, document.count(NODES))?];
        let inverse_bind = match &inverse_binds {
            None => DAffine3::IDENTITY,
            Some(all) => DAffine3::from_mat4(DMat4::from_cols_array(&all[row].map(f64::from))),
        };
        let matrix = world * inverse_bind;
        if !matrix.is_finite() {
            return Err(joint.expected("a joint with a finite inverse bind matrix"));
        }
        matrices.push(matrix);
    }
    Ok(Skin { identity, joints: matrices, world_from_node })
}

/// Takes a part from the space of its mesh to world space.
///
/// Weights are scaled to sum to one. Triangles that a mirroring joint turns
/// inside out are turned back, as a mirroring node would do.
///
/// # Errors
/// If a vertex refers to a joint that the skin does not have, or lands nowhere.
pub(super) fn apply(
    part: &mut Part,
    skin: &Skin,
    primitive: &Json<'_>,
    warnings: &mut Warnings,
) -> Result<(), LoadError> {
    if part.influences.is_empty() {
        warnings.push(&primitive.at, "it has no JOINTS_0 though its node has a skin; it stays with the node");
    }
    let at = primitive.at.join("attributes");
    let mut mirrored = vec![false; part.positions.len()];
    for (row, mirrored) in mirrored.iter_mut().enumerate() {
        let matrix = blend(part, skin, row, &at)?;
        let p = matrix.transform_point3(part.positions[row].as_dvec3()).as_vec3();
        if !p.is_finite() {
            let (expected, found) = ("a finite position once skinned".to_owned(), format!("{p} at vertex {row}"));
            return Err(LoadError::Value { at, expected, found });
        }
        part.positions[row] = p;
        *mirrored = matrix.matrix3.determinant() < 0.0;
        let sign = if *mirrored { -1.0 } else { 1.0 };
        if let Some(n) = part.normals.get_mut(row) {
            *n = unit(sound(sign * (cofactors(matrix.matrix3) * n.as_dvec3()).as_vec3()));
        }
        if let Some(t) = part.tangents.get_mut(row) {
            let direction = sound((matrix.matrix3 * t.truncate().as_dvec3()).as_vec3());
            *t = unit_tangent(Vec4::from((direction, sign * t.w)));
        }
    }
    for triangle in part.triangles.iter_mut().filter(|triangle| mirrored[triangle[0] as usize]) {
        triangle.swap(1, 2);
    }
    Ok(())
}

fn sound(v: Vec3) -> Vec3 {
    if v.is_finite() { v } else { Vec3::ZERO }
}

/// The inverse transpose times the determinant, which needs no inverse to exist.
fn cofactors(m: DMat3) -> DMat3 {
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

fn blend(part: &Part, skin: &Skin, row: usize, at: &Place) -> Result<DAffine3, LoadError> {
    if part.influences.is_empty() {
        return Ok(skin.world_from_node);
    }
    let mut sum = [0.0; 12];
    let mut total = 0.0;
    let influences = || part.influences.iter().flat_map(|(joints, weights)| joints[row].into_iter().zip(weights[row]));
    for (joint, weight) in influences() {
        let index = joint as usize;
        let Some(matrix) = skin.joints.get(index) else {
            let (index, count) = (joint.into(), skin.joints.len());
            return Err(LoadError::Reference { at: at.clone(), what: "joint", index, count });
        };
        if weight > 0.0 {
            total += f64::from(weight);
            let weighted = matrix.to_cols_array().map(|x| x * f64::from(weight));
            sum.iter_mut().zip(weighted).for_each(|(sum, x)| *sum += x);
        }
    }
    if total > 0.0 {
        return Ok(DAffine3::from_cols_array(&sum.map(|x| x / total)));
    }
    // Without any weight the first joint carries the vertex, as common viewers have it.
    Ok(influences().next().map_or(skin.world_from_node, |(joint, _)| skin.joints[joint as usize]))
}
