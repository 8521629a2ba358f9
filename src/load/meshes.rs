//! Meshes: primitives merged into one `TriMesh`, shared by all nodes that show the same.

use std::{
    collections::{HashMap, HashSet},
    fmt::Write,
    sync::Arc,
};

use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::{
    buffers::Buffers,
    document::{ACCESSORS, Document, MATERIALS},
    error::{LoadError, Warning, Warnings},
    json::Json,
    materials::Draft,
    morph,
    primitives::{Topology, read_topology, read_triangles},
    skins::{self, Skin},
    tangents::{self, Along},
    vertices::{Attributes, Part, read_vertices},
};
use crate::world::TriMesh;

/// A primitive of triangles, with what decides how it is read.
struct Primitive<'a> {
    json: Json<'a>,
    attributes: Json<'a>,
    vertices: usize,
    topology: Topology,
    slot: u16,
    /// What to make tangents along, where they are needed and missing.
    tangents: Option<Along>,
}

/// How one node, or several alike, shows a mesh.
pub(super) struct Job<'a> {
    primitives: Vec<Primitive<'a>>,
    weights: Vec<f32>,
    skin: Option<Skin>,
    /// Material of each slot, by index into the file's materials.
    pub(super) slots: Vec<Option<usize>>,
    /// Equal keys give equal triangles.
    key: String,
}

/// Which materials a mesh uses, in the order of first use.
pub(super) fn read_slots(mesh: &Json<'_>, document: &Document<'_>) -> Result<Vec<Option<usize>>, LoadError> {
    let (mut slots, mut seen) = (Vec::new(), HashSet::new());
    for primitive in mesh.list("primitives")? {
        let material = document.follow_key(&primitive, "material", MATERIALS)?.map(|(index, _)| index);
        if read_topology(&primitive)?.is_some() && seen.insert(material) {
            slots.push(material);
        }
    }
    Ok(slots)
}

impl<'a> Job<'a> {
    /// Looks at a mesh without reading its vertices.
    pub(super) fn new(
        mesh: &Json<'a>,
        weights: Vec<f32>,
        skin: Option<Skin>,
        document: &Document<'a>,
        drafts: &[Option<Draft>],
        warnings: &mut Warnings,
    ) -> Result<Self, LoadError> {
        let slots = read_slots(mesh, document)?;
        if slots.len() > usize::from(u16::MAX) {
            return Err(mesh.expected("at most 65535 materials"));
        }
        let places: HashMap<_, _> = slots.iter().zip(0u16..).collect();
        let mut primitives = Vec::new();
        for json in mesh.required("primitives")?.items()? {
            let Some(topology) = read_topology(&json)? else {
                warnings.push(&document.root.at, "points and lines are left out: they have no surface");
                continue;
            };
            let attributes = json.required("attributes")?;
            let Some((_, positions)) = document.follow_key(&attributes, "POSITION", ACCESSORS)? else {
                warnings.push(&json.at, "it has no POSITION and is left out");
                continue;
            };
            let vertices = positions.required("count")?.unsigned()?;
            if vertices > u64::from(u32::MAX) {
                return Err(positions.expected("at most 2³² vertices"));
            }
            let material = document.follow_key(&json, "material", MATERIALS)?.map(|(index, _)| index);
            let slot = places.get(&material).copied().unwrap_or(0);
            let along = material.and_then(|index| drafts[index].as_ref()?.normal_along);
            let given = attributes.get("NORMAL")?.is_some() && attributes.get("TANGENT")?.is_some();
            let tangents = along.filter(|_| !given);
            primitives.push(Primitive { json, attributes, vertices: vertices as usize, topology, slot, tangents });
        }
        let mut job = Self { primitives, weights, skin, slots, key: String::new() };
        job.key = job.describe();
        Ok(job)
    }

    /// Everything that the triangles depend on, as text.
    fn describe(&self) -> String {
        let mut key = String::new();
        for p in &self.primitives {
            let part = |name: &str| p.json.value.get(name).map(ToString::to_string).unwrap_or_default();
            let (topology, slot) = (p.topology, p.slot);
            let (attributes, indices) = (part("attributes"), part("indices"));
            let _ = write!(key, "{topology:?} {slot} {:?} {attributes} {indices};", p.tangents);
            if !self.weights.is_empty() {
                key += &part("targets");
            }
        }
        let _ = write!(key, "{:?} {:?}", self.weights, self.skin.as_ref().map(|skin| skin.identity));
        key
    }

    fn read(&self, document: &Document<'_>, buffers: &Buffers<'_>) -> Result<(TriMesh, Vec<Warning>), LoadError> {
        let mut warnings = Warnings::default();
        let mut parts = Vec::new();
        for group in self.groups() {
            let primitives: Vec<_> = group.iter().map(|&index| &self.primitives[index]).collect();
            parts.push(self.read_part(&primitives, document, buffers, &mut warnings)?);
        }
        let mesh = merge(parts);
        if let Err(problem) = mesh.check() {
            let at = self.primitives.first().map_or(document.root.at.clone(), |p| p.json.at.clone());
            return Err(LoadError::Value { at, expected: "a sound mesh".to_owned(), found: problem });
        }
        Ok((mesh, warnings.list))
    }

    /// Primitives that can share their vertices, in the order of the first of each.
    fn groups(&self) -> Vec<Vec<usize>> {
        let mut groups: Vec<Vec<usize>> = Vec::new();
        let mut by_key = HashMap::new();
        for (index, p) in self.primitives.iter().enumerate() {
            let key =
                (p.attributes.value.to_string(), p.json.value.get("targets").map(ToString::to_string), p.tangents);
            let group = *by_key.entry(key).or_insert(groups.len());
            if group == groups.len() {
                groups.push(Vec::new());
            }
            groups[group].push(index);
        }
        groups
    }

    fn read_part(
        &self,
        primitives: &[&Primitive<'_>],
        document: &Document<'_>,
        buffers: &Buffers<'_>,
        warnings: &mut Warnings,
    ) -> Result<Part, LoadError> {
        let first = primitives[0];
        let attributes = Attributes { json: first.attributes.clone(), document, buffers, count: first.vertices };
        // The accessor bounds the count by the data there is, before anything is made per vertex.
        attributes.accessor("POSITION")?;
        let (mut triangles, mut slots) = (Vec::new(), Vec::new());
        for p in primitives {
            let read = read_triangles(&p.json, p.topology, p.vertices, document, buffers, warnings)?;
            slots.resize(slots.len() + read.len(), p.slot);
            triangles.extend(read);
        }
        let rows = compact(&mut triangles, first.vertices);
        let mut part = read_vertices(&attributes, &rows, self.skin.is_some(), warnings)?;
        (part.triangles, part.slots) = (triangles, slots);
        if !self.weights.is_empty() {
            morph::apply(&mut part, &first.json, &attributes, &self.weights, &rows)?;
        }
        if let Some(along) = first.tangents {
            let generated = tangents::generate(&mut part, along);
            if !generated && !part.triangles.is_empty() {
                let text =
                    format!("its normal map needs TEXCOORD_{}, which cannot be used; the map is left out", along.set);
                warnings.push(&first.json.at, text);
            }
        }
        if let Some(skin) = &self.skin {
            skins::apply(&mut part, skin, &first.json, warnings)?;
        }
        Ok(part)
    }
}

/// Renumbers the triangles to refer to used vertices only, and gives these in ascending order.
fn compact(triangles: &mut [[u32; 3]], vertices: usize) -> Vec<u32> {
    let mut used = vec![false; vertices];
    triangles.iter().flatten().for_each(|&row| used[row as usize] = true);
    let rows: Vec<u32> = (0..vertices as u32).filter(|&row| used[row as usize]).collect();
    if rows.len() < vertices {
        let mut place = vec![0u32; vertices];
        rows.iter().zip(0..).for_each(|(&row, new)| place[row as usize] = new);
        triangles.iter_mut().flatten().for_each(|row| *row = place[*row as usize]);
    }
    rows
}

/// Parts one after the other; what only some have is filled with what stands for "none" in the others.
fn merge(parts: Vec<Part>) -> TriMesh {
    let has = |present: fn(&Part) -> bool| parts.iter().any(present);
    let (normals, tangents) = (has(|p| !p.normals.is_empty()), has(|p| !p.tangents.is_empty()));
    let (colors, slots) = (has(|p| !p.colors.is_empty()), has(|p| p.slots.iter().any(|&slot| slot != 0)));
    let sets = parts.iter().map(|p| p.uvs.len()).max().unwrap_or(0);
    let has_set: Vec<bool> =
        (0..sets).map(|set| parts.iter().any(|p| p.uvs.get(set).is_some_and(|uvs| !uvs.is_empty()))).collect();
    let mut mesh = TriMesh { uvs: vec![Vec::new(); sets], ..TriMesh::default() };
    for mut part in parts {
        let (start, end) = (mesh.positions.len() as u32, mesh.positions.len() + part.positions.len());
        mesh.positions.append(&mut part.positions);
        append(&mut mesh.normals, part.normals, normals, end, Vec3::ZERO);
        append(&mut mesh.tangents, part.tangents, tangents, end, Vec4::ZERO);
        append(&mut mesh.colors, part.colors, colors, end, Vec4::ONE);
        let mut part_sets = part.uvs.into_iter();
        for (uvs, &has) in mesh.uvs.iter_mut().zip(&has_set) {
            append(uvs, part_sets.next().unwrap_or_default(), has, end, Vec2::ZERO);
        }
        mesh.triangles.extend(part.triangles.iter().map(|triangle| triangle.map(|row| row + start)));
        if slots {
            mesh.slots.append(&mut part.slots);
        }
    }
    mesh
}

fn append<T: Copy>(column: &mut Vec<T>, mut values: Vec<T>, wanted: bool, end: usize, none: T) {
    if wanted {
        column.append(&mut values);
        column.resize(end, none);
    }
}

/// Reads all jobs, in parallel; jobs with equal keys share their mesh.
///
/// # Errors
/// That of the first job that fails.
pub(super) fn read_all(
    jobs: &[Job<'_>],
    document: &Document<'_>,
    buffers: &Buffers<'_>,
    warnings: &mut Warnings,
) -> Result<Vec<Arc<TriMesh>>, LoadError> {
    let mut rows: HashMap<&str, usize> = HashMap::new();
    let mut unique: Vec<&Job<'_>> = Vec::new();
    for job in jobs {
        rows.entry(&job.key).or_insert_with(|| {
            unique.push(job);
            unique.len() - 1
        });
    }
    let results: Vec<_> = unique.par_iter().map(|job| job.read(document, buffers)).collect();
    let mut meshes = Vec::with_capacity(results.len());
    for result in results {
        let (mesh, said) = result?;
        said.iter().for_each(|warning| warnings.push(&warning.at, warning.text.clone()));
        meshes.push(Arc::new(mesh));
    }
    Ok(jobs.iter().map(|job| meshes[rows[&*job.key]].clone()).collect())
}

/// Triangles that a mesh of the file says it has, as far as it can be told without reading it.
pub(super) fn count_triangles(mesh: &Json<'_>, document: &Document<'_>) -> u64 {
    let count = |primitive: &Json<'_>| -> Result<u64, LoadError> {
        let Some(topology) = read_topology(primitive)? else { return Ok(0) };
        let accessor = match primitive.get("indices")? {
            Some(indices) => document.follow(&indices, ACCESSORS)?.1,
            None => document.follow(&primitive.required("attributes")?.required("POSITION")?, ACCESSORS)?.1,
        };
        Ok(super::primitives::triangle_count(topology, accessor.required("count")?.unsigned()?))
    };
    let primitives = mesh.list("primitives").unwrap_or_default();
    primitives.iter().map(|primitive| count(primitive).unwrap_or(0)).fold(0, u64::saturating_add)
}
