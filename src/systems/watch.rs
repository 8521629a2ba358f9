//! Change detection by comparison.

use hecs::{ChangeTracker, Component, World};

use crate::world::{
    Camera, DirectionalLight, EmissiveSurface, Environment, Geometry, LocalTransform, Material, MaterialSlots, Parent,
    PointLight, Shape, SpotLight, Visibility, WorldTransform, WorldVisibility,
};

/// Tells whether any `T` in the world changed since it was last asked.
pub struct Watch<T: Component> {
    tracker: ChangeTracker<T>,
    count: usize,
}

impl<T: Component> Default for Watch<T> {
    fn default() -> Self {
        Self { tracker: ChangeTracker::new(), count: 0 }
    }
}

impl<T: Component + Clone + PartialEq> Watch<T> {
    /// True if a `T` was added, removed, despawned or given another value.
    pub fn changed(&mut self, world: &mut World) -> bool {
        let mut changes = self.tracker.track(world);
        let removed = changes.removed().len();
        let added = changes.added().len();
        let edited = changes.changed().count();
        drop(changes);
        // The tracker says nothing of despawned entities; the count does.
        let count = world.query_mut::<&T>().into_iter().len();
        let despawned = self.count + added - removed - count;
        self.count = count;
        added + removed + edited + despawned > 0
    }
}

/// One watch for each kind of component that a system reads; a scene owns them, because hecs
/// allows one tracker for each type and world.
#[derive(Default)]
pub struct Watches {
    pub(super) local_transform: Watch<LocalTransform>,
    pub(super) parent: Watch<Parent>,
    pub(super) visibility: Watch<Visibility>,
    pub(super) world_transform: Watch<WorldTransform>,
    pub(super) world_visibility: Watch<WorldVisibility>,
    pub(super) geometry: Watch<Geometry>,
    pub(super) shape: Watch<Shape>,
    pub(super) slots: Watch<MaterialSlots>,
    pub(super) material: Watch<Material>,
    pub(super) emissive: Watch<EmissiveSurface>,
    pub(super) point: Watch<PointLight>,
    pub(super) spot: Watch<SpotLight>,
    pub(super) directional: Watch<DirectionalLight>,
    pub(super) environment: Watch<Environment>,
    pub(super) camera: Watch<Camera>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_watch_sees_every_kind_of_change_once() {
        let mut world = World::new();
        let [a, b] = [0.2, 0.0].map(|roughness| world.spawn((Material { roughness, ..Material::default() },)));
        let mut watch = Watch::<Material>::default();
        assert!(watch.changed(&mut world), "first look");
        assert!(!watch.changed(&mut world), "no edit");
        world.get::<&mut Material>(a).unwrap().roughness = 0.2;
        assert!(!watch.changed(&mut world), "written, but with the value it had");
        world.get::<&mut Material>(a).unwrap().roughness = 0.3;
        assert!(watch.changed(&mut world), "edited");
        world.despawn(b).unwrap();
        world.spawn((Material::default(),));
        assert!(watch.changed(&mut world), "one out, one in");
        world.despawn(a).unwrap();
        assert!(watch.changed(&mut world), "one out");
        let c = world.spawn((Material::default(),));
        assert!(watch.changed(&mut world), "one in");
        world.remove_one::<Material>(c).unwrap();
        assert!(watch.changed(&mut world), "removed from its entity");
        assert!(!watch.changed(&mut world));
    }
}
