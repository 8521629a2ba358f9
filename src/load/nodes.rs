//! The node hierarchy: who hangs below whom, and where each node is.

use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::{
    Selector,
    document::{Document, NODES, SCENES},
    error::{LoadError, Warnings},
    json::Json,
};
use crate::world::LocalTransform;

/// All nodes of the file, known to form trees.
#[derive(Debug)]
pub(super) struct Nodes {
    pub(super) parents: Vec<Option<usize>>,
    pub(super) children: Vec<Vec<usize>>,
    pub(super) locals: Vec<LocalTransform>,
    pub(super) worlds: Vec<DAffine3>,
}

/// Reads hierarchy and transforms.
///
/// # Errors
/// If a node has two parents, is its own ancestor, or lands beyond single precision.
pub(super) fn read_nodes(document: &Document<'_>, warnings: &mut Warnings) -> Result<Nodes, LoadError> {
    let count = document.count(NODES);
    let mut parents: Vec<Option<usize>> = vec![None; count];
    let mut children = vec![Vec::new(); count];
    let mut locals = Vec::with_capacity(count);
    for (parent, node) in document.elements(NODES).enumerate() {
        for child in node.list("children")? {
            let index = child.index(NODES.what, count)?;
            if let Some(other) = parents[index].replace(parent) {
                let reason = format!("node {index} is a child of node {other} already; a node has one parent");
                return Err(LoadError::Hierarchy { at: child.at, reason });
            }
            children[parent].push(index);
        }
        locals.push(read_transform(&node, warnings)?);
    }
    let roots: Vec<usize> = (0..count).filter(|&node| parents[node].is_none()).collect();
    let mut worlds: Vec<Option<DAffine3>> = vec![None; count];
    for node in depth_first(&roots, &children) {
        let above = parents[node].and_then(|parent| worlds[parent]).unwrap_or(DAffine3::IDENTITY);
        let world = above * locals[node].to_affine();
        if !world.to_cols_array().iter().all(|&x| (x as f32).is_finite()) {
            let reason = "its place in the world is beyond single precision".to_owned();
            return Err(LoadError::Hierarchy { at: document.element(NODES, node).at, reason });
        }
        worlds[node] = Some(world);
    }
    // Every node has at most one parent, so what no root leads to hangs in a circle.
    if let Some(lost) = worlds.iter().position(Option::is_none) {
        let reason = "the node is its own ancestor, or hangs below one that is".to_owned();
        return Err(LoadError::Hierarchy { at: document.element(NODES, lost).at, reason });
    }
    Ok(Nodes { parents, children, locals, worlds: worlds.into_iter().flatten().collect() })
}

/// The nodes below `roots`, each before its children, in file order.
pub(super) fn depth_first(roots: &[usize], children: &[Vec<usize>]) -> Vec<usize> {
    let mut order = Vec::new();
    let mut stack: Vec<usize> = roots.iter().rev().copied().collect();
    while let Some(node) = stack.pop() {
        order.push(node);
        stack.extend(children[node].iter().rev());
    }
    order
}

fn read_transform(node: &Json<'_>, warnings: &mut Warnings) -> Result<LocalTransform, LoadError> {
    let part = |key: &str| node.get(key);
    let (translation, rotation, scale) = (part("translation")?, part("rotation")?, part("scale")?);
    if let Some(matrix) = part("matrix")? {
        if translation.is_some() || rotation.is_some() || scale.is_some() {
            warnings.push(&node.at, "it has a matrix besides translation, rotation or scale; the matrix is taken");
        }
        let m = matrix.numbers::<16>()?;
        if [m[3], m[7], m[11], m[15] - 1.0].iter().any(|x| x.abs() > 1e-5) {
            return Err(matrix.expected("an affine matrix, whose last row is 0 0 0 1"));
        }
        return Ok(LocalTransform::Matrix(DAffine3::from_mat4(DMat4::from_cols_array(&m))));
    }
    let rotation = match rotation {
        None => DQuat::IDENTITY,
        Some(json) => {
            let q = DQuat::from_array(json.numbers::<4>()?);
            let length = q.length();
            if !(length > 0.0 && length.is_finite()) {
                return Err(json.expected("a unit quaternion"));
            }
            DQuat::from_array(q.to_array().map(|x| x / length))
        }
    };
    let vector =
        |json: Option<Json<'_>>, default: DVec3| json.map_or(Ok(default), |json| json.numbers::<3>().map(DVec3::from));
    let (translation, scale) = (vector(translation, DVec3::ZERO)?, vector(scale, DVec3::ONE)?);
    Ok(LocalTransform::Trs { translation, rotation, scale })
}

/// The scene to show: its index, if the file has scenes, and its root nodes.
pub(super) fn choose_scene(
    document: &Document<'_>,
    nodes: &Nodes,
    wanted: Option<&Selector>,
) -> Result<(Option<usize>, Vec<usize>), LoadError> {
    let count = document.count(SCENES);
    let chosen = match wanted {
        Some(selector) => Some(find_scene(document, selector)?),
        None => match document.follow_key(&document.root, "scene", SCENES)? {
            Some((index, _)) => Some(index),
            None => (count > 0).then_some(0),
        },
    };
    let Some(index) = chosen else {
        return Ok((None, (0..nodes.parents.len()).filter(|&node| nodes.parents[node].is_none()).collect()));
    };
    let mut roots = Vec::new();
    let mut listed = vec![false; nodes.parents.len()];
    for entry in document.element(SCENES, index).list("nodes")? {
        let node = entry.index(NODES.what, nodes.parents.len())?;
        if let Some(parent) = nodes.parents[node] {
            let reason = format!("node {node} is a child of node {parent}; a scene lists roots only");
            return Err(LoadError::Hierarchy { at: entry.at, reason });
        }
        if std::mem::replace(&mut listed[node], true) {
            let reason = format!("node {node} is listed twice");
            return Err(LoadError::Hierarchy { at: entry.at, reason });
        }
        roots.push(node);
    }
    Ok((Some(index), roots))
}

fn find_scene(document: &Document<'_>, selector: &Selector) -> Result<usize, LoadError> {
    let names = scene_names(document)?;
    let by_name = |wanted: &str| names.iter().position(|name| name == wanted);
    let (found, wanted) = match selector {
        Selector::Name(name) => (by_name(name), name.clone()),
        Selector::Index(index) => (Some(*index).filter(|&index| index < names.len()), index.to_string()),
        Selector::Either(text) => {
            let index = || text.parse().ok().filter(|&index: &usize| index < names.len());
            (by_name(text).or_else(index), text.clone())
        }
    };
    found.ok_or_else(|| {
        let listed: Vec<String> = names.iter().enumerate().map(|(i, name)| format!("{i} {name:?}")).collect();
        let available = if listed.is_empty() { "none".to_owned() } else { listed.join(", ") };
        LoadError::NoSuchScene { at: document.root.at.clone(), wanted, available }
    })
}

/// Names of the file's scenes, made up where they have none.
pub(super) fn scene_names(document: &Document<'_>) -> Result<Vec<String>, LoadError> {
    document.elements(SCENES).enumerate().map(|(index, scene)| scene.name_or("scene", index)).collect()
}
