//! The editable scene: a hecs world of entities with geometry, material and emitter components.
//!
//! In flow edits: from the loader, the library's user or a script. Out flows a
//! picture of the world that the [systems](crate::systems) turn into tables. Each
//! entity carries a [`SceneKey`], because hecs recycles its own ids; relations
//! between entities are written with keys.

mod camera;
mod emitter;
pub mod generated;
mod geometry;
mod material;
mod shape;
mod texture;
mod transform;
pub mod units;

use std::{collections::HashMap, sync::Arc};

use hecs::{DynamicBundle, Entity, World};

pub(crate) use self::shape::cofactors;
pub use self::{
    camera::{Camera, Environment, EnvironmentMap, Projection, Sky},
    emitter::{DirectionalLight, EmissiveSurface, PointLight, SpotLight},
    geometry::{Geometry, MaterialSlots, TriMesh},
    material::{AlphaMode, Material},
    shape::Shape,
    texture::{Filter, Image, Texels, Texture, UvTransform, Wrap},
    transform::{LocalTransform, Parent, Visibility, WorldTransform, WorldVisibility},
};
use crate::systems::Watches;

/// What an entity is called in its file; need not be unique.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Name(pub Arc<str>);

/// Identifies an entity for the life of its scene; never used twice.
///
/// Tables are in the order of keys, so the same scene gives the same tables
/// whatever edits led to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SceneKey(pub u64);

/// A hecs world with its persistent keys and change watches.
#[derive(Default)]
pub struct Scene {
    world: World,
    entities: HashMap<SceneKey, Entity>,
    next_key: u64,
    pub(crate) watches: Watches,
    /// The camera to look through; `None` takes the one of the lowest key, or frames the scene.
    pub active_camera: Option<SceneKey>,
}

impl Scene {
    /// An empty scene.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds an entity with the given components and returns its key.
    pub fn spawn(&mut self, components: impl DynamicBundle) -> SceneKey {
        let key = SceneKey(self.next_key);
        self.next_key += 1;
        let entity = self.world.spawn(components);
        self.world.insert_one(entity, key).expect("the entity was spawned a line above");
        self.entities.insert(key, entity);
        key
    }

    /// Removes an entity; false if there is none of this key.
    pub fn despawn(&mut self, key: SceneKey) -> bool {
        self.entities.remove(&key).is_some_and(|entity| self.world.despawn(entity).is_ok())
    }

    /// The hecs entity behind a key.
    pub fn entity(&self, key: SceneKey) -> Option<Entity> {
        self.entities.get(&key).copied().filter(|&entity| self.world.contains(entity))
    }

    /// The world, to query.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The world, to edit. Entities spawned here get their key at the next sync.
    pub fn world_mut(&mut self) -> &mut World {
        &mut self.world
    }

    /// Sets a component of an entity; false if there is none of this key.
    pub fn insert(&mut self, key: SceneKey, component: impl hecs::Component) -> bool {
        match self.entity(key) {
            Some(entity) => self.world.insert_one(entity, component).is_ok(),
            None => false,
        }
    }

    /// A copy of an entity's component.
    pub fn get<T: hecs::Component + Clone>(&self, key: SceneKey) -> Option<T> {
        self.world.get::<&T>(self.entity(key)?).ok().map(|component| (*component).clone())
    }

    /// Takes away all that shines or is seen, but for an entity and what hangs below it. Cameras and transforms stay.
    pub fn keep_only(&mut self, key: SceneKey) {
        let mut all: Vec<SceneKey> = self.entities.keys().copied().collect();
        all.sort_unstable();
        let is_below = |mut at: SceneKey| {
            // As many steps as there are entities, should parents go round in a circle.
            for _ in 0..=self.entities.len() {
                if at == key {
                    return true;
                }
                match self.get::<Parent>(at) {
                    Some(parent) => at = parent.0,
                    None => return false,
                }
            }
            false
        };
        let others: Vec<Entity> =
            all.into_iter().filter(|&at| !is_below(at)).filter_map(|at| self.entity(at)).collect();
        for entity in others {
            // That it has none of them is no failure.
            let _ = self.world.remove_one::<Geometry>(entity);
            let _ = self.world.remove_one::<Shape>(entity);
            let _ = self.world.remove_one::<PointLight>(entity);
            let _ = self.world.remove_one::<SpotLight>(entity);
            let _ = self.world.remove_one::<DirectionalLight>(entity);
            let _ = self.world.remove_one::<Environment>(entity);
        }
    }

    /// The first entity, by key, that has this name.
    pub fn find(&self, name: &str) -> Option<SceneKey> {
        let mut query = self.world.query::<(&SceneKey, &Name)>();
        query.iter().filter(|(_, n)| &*n.0 == name).map(|(key, _)| *key).min()
    }

    /// Keys of all entities with a `T`, ascending.
    pub fn keys_with<T: hecs::Component>(&self) -> Vec<SceneKey> {
        let mut query = self.world.query::<(&SceneKey, &T)>();
        let mut keys: Vec<_> = query.iter().map(|(key, _)| *key).collect();
        keys.sort_unstable();
        keys
    }

    /// World and watches at once, for the systems.
    pub(crate) fn parts(&mut self) -> (&mut World, &mut Watches, &HashMap<SceneKey, Entity>) {
        (&mut self.world, &mut self.watches, &self.entities)
    }

    /// Gives a key to every entity that was spawned straight into the world and forgets the dead.
    pub(crate) fn assign_keys(&mut self) {
        let unkeyed: Vec<Entity> = self.world.query_mut::<hecs::Without<Entity, &SceneKey>>().into_iter().collect();
        for entity in unkeyed {
            let key = SceneKey(self.next_key);
            self.next_key += 1;
            self.world.insert_one(entity, key).expect("the entity was just met in a query");
            self.entities.insert(key, entity);
        }
        if self.entities.len() != self.world.len() as usize {
            let world = &self.world;
            self.entities.retain(|_, &mut entity| world.contains(entity));
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn keys_are_never_used_twice_though_hecs_recycles_ids() {
        let mut scene = Scene::new();
        let first = scene.spawn((Material::default(),));
        assert!(scene.despawn(first));
        let second = scene.spawn((Material::default(),));
        assert_ne!(first, second);
        assert!(scene.entity(first).is_none());
        assert!(!scene.despawn(first), "dead keys stay dead");
    }

    #[test]
    fn entities_spawned_into_the_bare_world_get_keys() {
        let mut scene = Scene::new();
        let entity = scene.world_mut().spawn((Material::default(),));
        scene.assign_keys();
        let key = *scene.world().get::<&SceneKey>(entity).unwrap();
        assert_eq!(scene.entity(key), Some(entity));
    }

    #[test]
    fn procedural_meshes_are_sound_and_face_outwards() {
        for mesh in [TriMesh::sphere(Vec3::ZERO, 2.0, 8), TriMesh::cuboid(-Vec3::ONE, Vec3::ONE)] {
            mesh.check().unwrap();
            for &[a, b, c] in &mesh.triangles {
                let [a, b, c] = [a, b, c].map(|i| mesh.positions[i as usize]);
                let n = (b - a).cross(c - a);
                assert!(n.length() > 0.0 && n.dot(a + b + c) > 0.0, "{a} {b} {c}");
            }
        }
        let disc = TriMesh::disc(Vec3::ZERO, 1.0, 12);
        for &[a, b, c] in &disc.triangles {
            let [a, b, c] = [a, b, c].map(|i| disc.positions[i as usize]);
            assert!((b - a).cross(c - a).y > 0.0);
        }
    }
}
