//! Vertex attributes of primitives, made sound.

use glam::{Vec2, Vec3, Vec4};

use super::{
    accessors::{Accessor, Component, Rows},
    buffers::Buffers,
    document::{ACCESSORS, Document},
    error::{LoadError, Warnings},
    json::Json,
};

/// Sets of texture coordinates that are read; more are ignored with a warning.
pub(super) const MAX_UV_SETS: usize = 8;

/// Four joints and their weights per vertex.
pub(super) type Influences = (Vec<[u32; 4]>, Vec<[f32; 4]>);

/// The vertices and triangles of the primitives of a mesh that share their attributes.
///
/// Attribute vectors are empty or have one element per position, as in `TriMesh`.
#[derive(Clone, Debug, Default)]
pub(super) struct Part {
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) tangents: Vec<Vec4>,
    pub(super) uvs: Vec<Vec<Vec2>>,
    pub(super) colors: Vec<Vec4>,
    /// Joints and weights, by set.
    pub(super) influences: Vec<Influences>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) slots: Vec<u16>,
}

/// Gives access to the attributes of one primitive or morph target.
pub(super) struct Attributes<'a, 'b> {
    pub(super) json: Json<'a>,
    pub(super) document: &'b Document<'a>,
    pub(super) buffers: &'b Buffers<'a>,
    /// Vertices, which every attribute must have.
    pub(super) count: usize,
}

impl<'a, 'b> Attributes<'a, 'b> {
    /// The accessor of an attribute, if the primitive has it.
    pub(super) fn accessor(&self, key: &str) -> Result<Option<Accessor<'a, 'b>>, LoadError> {
        let Some(reference) = self.json.get(key)? else { return Ok(None) };
        let (_, json) = self.document.follow(&reference, ACCESSORS)?;
        let accessor = Accessor::new(json, self.buffers)?;
        if accessor.count != self.count {
            let (expected, actual) = (self.count, accessor.count);
            return Err(LoadError::AttributeLength { at: reference.at, expected, actual });
        }
        Ok(Some(accessor))
    }

    /// The rows of an attribute, charged to the file's allowance.
    pub(super) fn floats<const N: usize>(&self, key: &str, rows: &[u32]) -> Result<Option<Vec<[f32; N]>>, LoadError> {
        let Some(accessor) = self.accessor(key)? else { return Ok(None) };
        self.check_component(key, &accessor)?;
        self.buffers.charge(&self.json.at.join(key), rows.len() as u64)?;
        accessor.floats::<N>(Rows::Some(rows)).map(Some)
    }

    fn check_component(&self, key: &str, accessor: &Accessor<'_, '_>) -> Result<(), LoadError> {
        if accessor.component == Component::U32 {
            return Err(accessor.expected(&format!("floats or small integers, as {key} takes")));
        }
        let weighs = key.starts_with("COLOR_") || key.starts_with("WEIGHTS_");
        if weighs && accessor.component != Component::F32 && !accessor.normalized {
            return Err(accessor.expected(&format!("floats or normalised integers, as {key} takes")));
        }
        Ok(())
    }
}

/// Reads the given rows of all attributes.
///
/// # Errors
/// If an attribute has another length than the positions, a wrong type, or a
/// position is not finite. Other numbers that are not finite are replaced by
/// "none", with a warning.
pub(super) fn read_vertices(
    attributes: &Attributes<'_, '_>,
    rows: &[u32],
    skinned: bool,
    warnings: &mut Warnings,
) -> Result<Part, LoadError> {
    let mut part = Part::default();
    let at = &attributes.json.at;
    let positions = attributes.floats::<3>("POSITION", rows)?;
    part.positions = positions.unwrap_or_default().into_iter().map(Vec3::from).collect();
    if let Some(row) = part.positions.iter().position(|p| !p.is_finite()) {
        return Err(LoadError::Value {
            at: at.join("POSITION"),
            expected: "finite positions".to_owned(),
            found: format!("{} at vertex {}", part.positions[row], rows[row]),
        });
    }
    if let Some(normals) = attributes.floats::<3>("NORMAL", rows)? {
        part.normals = normals.into_iter().map(Vec3::from).collect();
        let bad = part.normals.iter().filter(|n| !n.is_finite()).count();
        part.normals.iter_mut().for_each(|n| *n = unit(*n));
        say_replaced(bad, "normals", &at.join("NORMAL"), warnings);
        // Tangents without normals are to be ignored, glTF 2.0 section 3.7.2.1.
        if let Some(tangents) = attributes.floats::<4>("TANGENT", rows)? {
            part.tangents = tangents.into_iter().map(Vec4::from).collect();
            let bad = part.tangents.iter().filter(|t| !t.is_finite()).count();
            part.tangents.iter_mut().for_each(|t| *t = unit_tangent(*t));
            say_replaced(bad, "tangents", &at.join("TANGENT"), warnings);
        }
    }
    part.uvs = read_uvs(attributes, rows, warnings)?;
    part.colors = read_colors(attributes, rows, warnings)?;
    if skinned {
        part.influences = read_influences(attributes, rows)?;
    }
    Ok(part)
}

fn say_replaced(bad: usize, what: &str, at: &super::error::Place, warnings: &mut Warnings) {
    if bad > 0 {
        warnings.push(at, format!("{bad} {what} are not finite and left out"));
    }
}

/// The vector at length one; zero, which stands for none, if it has no direction.
pub(super) fn unit(v: Vec3) -> Vec3 {
    // By the largest component first, so that the squares neither overflow nor vanish.
    let largest = v.abs().max_element();
    if largest > 0.0 && largest.is_finite() { (v / largest).normalize_or_zero() } else { Vec3::ZERO }
}

/// A tangent at length one with a sign of ±1; zero if it has no direction.
pub(super) fn unit_tangent(t: Vec4) -> Vec4 {
    let direction = if t.is_finite() { unit(t.truncate()) } else { Vec3::ZERO };
    if direction == Vec3::ZERO {
        return Vec4::ZERO;
    }
    direction.extend(if t.w < 0.0 { -1.0 } else { 1.0 })
}

fn read_uvs(
    attributes: &Attributes<'_, '_>,
    rows: &[u32],
    warnings: &mut Warnings,
) -> Result<Vec<Vec<Vec2>>, LoadError> {
    let mut sets = Vec::new();
    for set in 0..MAX_UV_SETS {
        let key = format!("TEXCOORD_{set}");
        let Some(uvs) = attributes.floats::<2>(&key, rows)? else { continue };
        let bad = uvs.iter().flatten().filter(|x| !x.is_finite()).count();
        say_replaced(bad, "coordinates", &attributes.json.at.join(&key), warnings);
        let sound = |uv: [f32; 2]| Vec2::from(uv.map(|x| if x.is_finite() { x } else { 0.0 }));
        sets.resize(set + 1, Vec::new());
        sets[set] = uvs.into_iter().map(sound).collect();
    }
    let beyond = format!("TEXCOORD_{MAX_UV_SETS}");
    if attributes.json.get(&beyond)?.is_some() {
        let text = format!("only {MAX_UV_SETS} sets of texture coordinates are read");
        warnings.push(&attributes.json.at.join(&beyond), text);
    }
    Ok(sets)
}

fn read_colors(attributes: &Attributes<'_, '_>, rows: &[u32], warnings: &mut Warnings) -> Result<Vec<Vec4>, LoadError> {
    let key = "COLOR_0";
    let Some(accessor) = attributes.accessor(key)? else { return Ok(Vec::new()) };
    let colors: Vec<Vec4> = if accessor.width() == 3 {
        let colors = attributes.floats::<3>(key, rows)?.unwrap_or_default();
        colors.into_iter().map(|c| Vec3::from(c).extend(1.0)).collect()
    } else {
        attributes.floats::<4>(key, rows)?.unwrap_or_default().into_iter().map(Vec4::from).collect()
    };
    let outside = |x: f32| !(0.0..=1.0).contains(&x);
    let bad = colors.iter().filter(|c| c.to_array().into_iter().any(outside)).count();
    if bad > 0 {
        warnings.push(&attributes.json.at.join(key), format!("{bad} colours are outside 0 to 1 and clamped"));
    }
    let sound = |x: f32| if x.is_nan() { 1.0 } else { x.clamp(0.0, 1.0) };
    Ok(colors.into_iter().map(|c| Vec4::from_array(c.to_array().map(sound))).collect())
}

fn read_influences(attributes: &Attributes<'_, '_>, rows: &[u32]) -> Result<Vec<Influences>, LoadError> {
    let mut sets = Vec::new();
    loop {
        let (joints_key, weights_key) = (format!("JOINTS_{}", sets.len()), format!("WEIGHTS_{}", sets.len()));
        let Some(joints) = attributes.accessor(&joints_key)? else { return Ok(sets) };
        attributes.buffers.charge(&attributes.json.at.join(&joints_key), rows.len() as u64)?;
        let joints = joints.integers::<4>(Rows::Some(rows))?;
        let weights = attributes.floats::<4>(&weights_key, rows)?;
        let weights =
            weights.ok_or_else(|| LoadError::Missing { at: attributes.json.at.clone(), key: weights_key.clone() })?;
        if let Some(bad) = weights.iter().flatten().find(|w| !(w.is_finite() && **w >= 0.0)) {
            return Err(LoadError::Value {
                at: attributes.json.at.join(&weights_key),
                expected: "finite weights, not negative".to_owned(),
                found: bad.to_string(),
            });
        }
        sets.push((joints, weights));
    }
}
