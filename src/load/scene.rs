//! The chosen scene: what it needs is read, then spawned in an order that depends on the file alone.

use std::{
    collections::{HashMap, hash_map::Entry},
    sync::Arc,
};

use hecs::EntityBuilder;

use super::{
    LoadOptions,
    buffers::Buffers,
    cameras::read_camera,
    document::{CAMERAS, Document, IMAGES, MATERIALS, MESHES, NODES, SKINS},
    error::{LoadError, Warnings},
    images,
    info::FileInfo,
    json::Json,
    lights::{self, Light},
    materials::{Draft, read_material},
    meshes::{self, Job, read_slots},
    morph,
    nodes::{self, Nodes},
    skins::read_skin,
};
use crate::world::{Camera, Geometry, LocalTransform, MaterialSlots, Name, Parent, Scene, SceneKey, TriMesh};

/// No entity has this key, which makes a slot fall back to glTF's default material.
const NO_MATERIAL: SceneKey = SceneKey(u64::MAX);

/// What a node shows.
#[derive(Default)]
struct Content {
    name: String,
    /// Index of its job, and whether the mesh is in world space already.
    mesh: Option<(usize, bool)>,
    camera: Option<(usize, Camera)>,
    light: Option<Light>,
}

/// Reads and spawns the scene; notes in `info` what only it can tell.
pub(super) fn read(
    document: &Document<'_>,
    buffers: &Buffers<'_>,
    options: &LoadOptions,
    info: &mut FileInfo,
    warnings: &mut Warnings,
) -> Result<Scene, LoadError> {
    let nodes = nodes::read_nodes(document, warnings)?;
    let (index, roots) = nodes::choose_scene(document, &nodes, options.scene.as_ref())?;
    info.scene = index;
    let order = nodes::depth_first(&roots, &nodes.children);

    let drafts = read_materials(document, &order, warnings)?;
    let (contents, jobs) = read_contents(document, buffers, &nodes, &order, &drafts, warnings)?;
    let mut wanted = vec![false; document.count(IMAGES)];
    drafts.iter().flatten().for_each(|draft| draft.mark_images(&mut wanted));
    let images = images::decode_all(document, buffers, &wanted, warnings)?;
    let meshes = meshes::read_all(&jobs, document, buffers, warnings)?;

    let mut scene = Scene::new();
    let spawn_material = |draft: &Option<Draft>| {
        let draft = draft.as_ref()?;
        Some(scene.spawn((Name(draft.name.as_str().into()), draft.finish(&images))))
    };
    let materials: Vec<Option<SceneKey>> = drafts.iter().map(spawn_material).collect();
    spawn_nodes(&mut scene, &nodes, &order, &contents, &jobs, &meshes, &materials, info);
    Ok(scene)
}

/// The materials that the nodes' meshes use; the others stay `None`.
fn read_materials(
    document: &Document<'_>,
    order: &[usize],
    warnings: &mut Warnings,
) -> Result<Vec<Option<Draft>>, LoadError> {
    let mut used = vec![false; document.count(MATERIALS)];
    let mut seen = vec![false; document.count(MESHES)];
    for &node in order {
        let Some((index, mesh)) = document.follow_key(&document.element(NODES, node), "mesh", MESHES)? else {
            continue;
        };
        if !std::mem::replace(&mut seen[index], true) {
            read_slots(&mesh, document)?.into_iter().flatten().for_each(|material| used[material] = true);
        }
    }
    let read = |(index, used): (usize, bool)| {
        used.then(|| read_material(&document.element(MATERIALS, index), index, document, warnings)).transpose()
    };
    used.into_iter().enumerate().map(read).collect()
}

fn read_contents<'a>(
    document: &Document<'a>,
    buffers: &Buffers<'a>,
    nodes: &Nodes,
    order: &[usize],
    drafts: &[Option<Draft>],
    warnings: &mut Warnings,
) -> Result<(Vec<Content>, Vec<Job<'a>>), LoadError> {
    let lights = lights::all(document)?;
    let (mut contents, mut jobs) = (Vec::with_capacity(order.len()), Vec::new());
    let mut known = HashMap::new();
    for &index in order {
        let node = document.element(NODES, index);
        let mut content = Content { name: node.name_or("node", index)?, ..Content::default() };
        if let Some((mesh_index, mesh)) = document.follow_key(&node, "mesh", MESHES)? {
            let weights = morph::read_weights(&node, &mesh)?;
            let skin = document.follow_key(&node, "skin", SKINS)?;
            let identity = skin.as_ref().map(|(skin, _)| skin_identity(*skin, index, &mesh)).transpose()?;
            let bits: Vec<u32> = weights.iter().map(|weight| weight.to_bits()).collect();
            let job = match known.entry((mesh_index, bits, identity)) {
                Entry::Occupied(job) => *job.get(),
                Entry::Vacant(place) => {
                    let skin = skin.zip(identity).map(|((_, skin), identity)| {
                        read_skin(identity, &skin, nodes.worlds[index], document, nodes, buffers)
                    });
                    let skin = skin.transpose()?;
                    jobs.push(Job::new(&mesh, weights, skin, document, drafts, warnings)?);
                    *place.insert(jobs.len() - 1)
                }
            };
            content.mesh = Some((job, identity.is_some()));
        }
        if let Some((camera, json)) = document.follow_key(&node, "camera", CAMERAS)? {
            content.camera = Some((camera, read_camera(&json)?));
        }
        content.light = lights::light_of(&node, &lights, warnings)?;
        contents.push(content);
    }
    Ok((contents, jobs))
}

/// What decides how a skin bends a mesh: the skin and, for vertices without joints, the node they stay with.
fn skin_identity(skin: usize, node: usize, mesh: &Json<'_>) -> Result<(usize, Option<usize>), LoadError> {
    for primitive in mesh.list("primitives")? {
        if primitive.required("attributes")?.get("JOINTS_0")?.is_none() {
            return Ok((skin, Some(node)));
        }
    }
    Ok((skin, None))
}

fn spawn_nodes(
    scene: &mut Scene,
    nodes: &Nodes,
    order: &[usize],
    contents: &[Content],
    jobs: &[Job<'_>],
    meshes: &[Arc<TriMesh>],
    materials: &[Option<SceneKey>],
    info: &mut FileInfo,
) {
    let mut keys: Vec<Option<SceneKey>> = vec![None; nodes.parents.len()];
    for (&node, content) in order.iter().zip(contents) {
        let name = Name(content.name.as_str().into());
        let shown = content.mesh.filter(|&(job, _)| !meshes[job].triangles.is_empty()).map(|(job, in_world)| {
            info.counts.instanced_triangles += meshes[job].triangles.len() as u64;
            let key = |slot: &Option<usize>| slot.and_then(|index| materials[index]).unwrap_or(NO_MATERIAL);
            let slots: Arc<[SceneKey]> = jobs[job].slots.iter().map(key).collect();
            (Geometry(meshes[job].clone()), MaterialSlots(slots), in_world)
        });
        let carries = content.camera.is_some() || content.light.is_some() || !nodes.children[node].is_empty();
        let mut builder = EntityBuilder::new();
        builder.add(name.clone());
        match content.light {
            None => {}
            Some(Light::Point(light)) => _ = builder.add(light),
            Some(Light::Spot(light)) => _ = builder.add(light),
            Some(Light::Directional(light)) => _ = builder.add(light),
        }
        if let Some((_, camera)) = content.camera {
            builder.add(camera);
        }
        // A skinned mesh is where its joints are: it takes no part in the hierarchy, what else its node carries does.
        let mut apart = None;
        let mut placed = true;
        match shown {
            Some((geometry, slots, true)) if carries => apart = Some((name, LocalTransform::IDENTITY, geometry, slots)),
            Some((geometry, slots, in_world)) => {
                builder.add_bundle((geometry, slots));
                placed = !in_world;
            }
            None => {}
        }
        builder.add(if placed { nodes.locals[node] } else { LocalTransform::IDENTITY });
        if let Some(parent) = nodes.parents[node].and_then(|parent| keys[parent]).filter(|_| placed) {
            builder.add(Parent(parent));
        }
        let key = scene.spawn(builder.build());
        keys[node] = Some(key);
        if let Some((camera, _)) = content.camera {
            info.cameras[camera].keys.push(key);
        }
        if let Some(bundle) = apart {
            scene.spawn(bundle);
        }
    }
}
