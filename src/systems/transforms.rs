//! Local transforms and visibility, combined along the parents.

use std::collections::HashMap;

use glam::DAffine3;
use hecs::{Entity, World};

use super::Watches;
use crate::world::{LocalTransform, Parent, SceneKey, Visibility, WorldTransform, WorldVisibility};

struct Link {
    entity: Entity,
    parent: Option<SceneKey>,
    local: DAffine3,
    visible: bool,
    placed: bool,
}

/// Writes [`WorldTransform`] and [`WorldVisibility`] of every entity that has a [`LocalTransform`],
/// a [`Parent`] or a [`Visibility`]; returns how many if any of those changed, else nothing.
///
/// A parent that does not exist, or a cycle of parents, counts as no parent, and is warned of.
pub fn sync_transforms(
    world: &mut World,
    watches: &mut Watches,
    entities: &HashMap<SceneKey, Entity>,
    warnings: &mut Vec<String>,
) -> Option<usize> {
    let changed =
        [watches.local_transform.changed(world), watches.parent.changed(world), watches.visibility.changed(world)];
    if !changed.contains(&true) {
        return None;
    }
    type Row<'a> = (Entity, &'a SceneKey, Option<&'a LocalTransform>, Option<&'a Parent>, Option<&'a Visibility>);
    let links: HashMap<SceneKey, Link> = world
        .query_mut::<Row>()
        .into_iter()
        .map(|(entity, key, local, parent, visibility)| {
            // Materials and the like have no place; they are spared the components.
            let placed = local.is_some() || parent.is_some() || visibility.is_some();
            let local = local.copied().unwrap_or_default().to_affine();
            let visible = visibility.is_none_or(|v| v.0);
            (*key, Link { entity, parent: parent.map(|p| p.0), local, visible, placed })
        })
        .collect();

    let mut keys: Vec<SceneKey> = links.keys().copied().collect();
    keys.retain(|key| links[key].placed);
    keys.sort_unstable();
    let mut done: HashMap<SceneKey, (DAffine3, bool)> = HashMap::with_capacity(links.len());
    let mut chain = Vec::new();
    for &key in &keys {
        // Up to the first ancestor that is done, then down again: no recursion, whatever the depth.
        let mut next = Some(key);
        chain.clear();
        while let Some(at) = next.filter(|at| !done.contains_key(at)) {
            if chain.contains(&at) {
                warnings.push(format!("entity {}: its parents form a cycle; it is taken as having none", at.0));
                next = None;
                break;
            }
            chain.push(at);
            next = links[&at].parent.filter(|parent| {
                let exists = entities.contains_key(parent);
                if !exists {
                    warnings.push(format!("entity {}: parent {} does not exist", at.0, parent.0));
                }
                exists
            });
        }
        let (mut transform, mut visible) =
            next.and_then(|at| done.get(&at)).copied().unwrap_or((DAffine3::IDENTITY, true));
        for &at in chain.iter().rev() {
            let link = &links[&at];
            transform *= link.local;
            visible &= link.visible;
            done.insert(at, (transform, visible));
        }
    }
    for key in &keys {
        let (transform, visible) = done[key];
        world
            .insert(links[key].entity, (WorldTransform(transform), WorldVisibility(visible)))
            .expect("the entity was met in a query above");
    }
    Some(keys.len())
}
