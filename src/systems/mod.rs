//! Scene to FlatScene: one file per system, in the order they run.
//!
//! In flow changes of the world; out, tables. A system runs only if a component that
//! it reads changed, or a system before it rebuilt what it reads; what ran is in the
//! report. Meshes and images are immutable and their flat forms are kept by identity;
//! all else is rebuilt whole, in the order of keys, so that the tables do not depend on
//! the edits that led to them.

// In the order they run; blank lines keep the formatter from sorting them.
mod transforms;

mod textures;

mod materials;

mod opacity;

mod least_alpha;

mod geometry;

mod instances;

mod lights;

mod camera;

mod needs;

// What tells them that they must.
mod watch;

use std::{collections::HashMap, sync::Arc};

pub use self::watch::{Watch, Watches};
use self::{
    geometry::{Form, MeshCache},
    instances::Shown,
    lights::EnvironmentCache,
    opacity::{AlphaCache, MeshOpacity},
    textures::ImageCache,
};
use crate::{
    accel::{Accel, AccelKind},
    flat::{EnvironmentLight, FlatScene, flags},
    render::SyncReport,
    world::{Camera, EmissiveSurface, Material, MaterialSlots, Scene, SceneKey, WorldTransform},
};

/// What the systems keep between syncs.
#[derive(Default)]
pub struct Systems {
    meshes: MeshCache,
    images: ImageCache,
    alphas: AlphaCache,
    environment: EnvironmentCache,
    shown: Vec<Shown>,
    camera: Option<SceneKey>,
    accel: AccelKind,
    synced: bool,
}

impl Systems {
    /// Brings the tables up to date with the scene, meshes in the structure `accel`.
    pub fn sync(&mut self, scene: &mut Scene, flat: &mut FlatScene, accel: AccelKind) -> SyncReport {
        scene.assign_keys();
        let active_camera = scene.active_camera;
        let first = !std::mem::replace(&mut self.synced, true);
        let restructured = std::mem::replace(&mut self.accel, accel) != accel;
        let mut report = SyncReport::default();
        let (world, watches, entities) = scene.parts();

        if let Some(rows) = transforms::sync_transforms(world, watches, entities, &mut report.warnings) {
            report.rebuilt.push(("transforms", rows));
        }
        // Every watch is asked every time, or it would report an old change later.
        let moved = watches.world_transform.changed(world);
        let hidden = watches.world_visibility.changed(world);
        let meshes_changed = watches.geometry.changed(world);
        let shapes_changed = watches.shape.changed(world);
        let slots_changed = watches.slots.changed(world);
        let materials_changed = watches.material.changed(world);
        let surfaces_changed = watches.emissive.changed(world);
        let lamps_changed =
            [watches.point.changed(world), watches.spot.changed(world), watches.directional.changed(world)];
        let sky_changed = watches.environment.changed(world);
        let cameras_changed = watches.camera.changed(world);

        let mut placement_changed = first;
        let (mut meshes_synced, mut materials_rebuilt) = (false, false);
        if first || moved || hidden || meshes_changed || shapes_changed || slots_changed || surfaces_changed {
            let before = std::mem::replace(&mut self.shown, instances::shown(world, &mut report.warnings));
            let same_meshes = same(&before, &self.shown, |a, b| a.key == b.key && a.form.id() == b.form.id());
            meshes_synced = first || !same_meshes;
            placement_changed |=
                !same_meshes || !same(&before, &self.shown, |a, b| a.world_from_local == b.world_from_local);
            materials_rebuilt =
                !same_meshes || !same(&before, &self.shown, |a, b| a.slots == b.slots && a.emissive == b.emissive);
        }
        let emission_before = (flat.materials.emissive.clone(), flat.materials.emissive_texture.clone());
        let flags_before = flat.materials.flags.clone();
        let materials_synced = first || materials_rebuilt || materials_changed || surfaces_changed;
        if materials_synced {
            let images = self.sync_materials(world, flat);
            report.rebuilt.push(("textures", images));
            report.rebuilt.push(("materials", flat.materials.len()));
        }
        let sources = if meshes_synced || restructured || materials_synced { self.sources(flat) } else { Vec::new() };
        if meshes_synced || restructured || !self.meshes.has(&sources) {
            // So that the cache alone has them.
            flat.meshes.clear();
            flat.accel = Accel::default();
            let (meshes, synced) = self.meshes.sync(sources, self.accel);
            flat.meshes = meshes;
            if meshes_synced || restructured {
                report.rebuilt.push(("geometry", synced.built));
                report.build_time = synced.time;
            } else {
                report.rebuilt.push(("opacity", synced.marked));
            }
            placement_changed = true;
        }
        let emission_changed = materials_rebuilt
            || emission_before != (flat.materials.emissive.clone(), flat.materials.emissive_texture.clone())
            || flags_before != flat.materials.flags;
        if placement_changed {
            self.sync_instances(flat);
            report.rebuilt.push(("instances", flat.instances.len()));
        } else if materials_rebuilt {
            self.renumber_materials(flat);
        }

        // A lamp moves with its entity; only a moved entity that is a lamp matters, but lamps are few.
        let lights_changed = first
            || placement_changed
            || emission_changed
            || moved
            || hidden
            || lamps_changed.contains(&true)
            || sky_changed;
        if lights_changed {
            let before = flat.lights.clone();
            self.sync_lights(world, flat);
            if first || !same_lights(&before, &flat.lights) {
                report.rebuilt.push(("lights", flat.lights.choice.len()));
            }
        }

        let chosen = active_camera.or_else(|| first_camera(world));
        if first || cameras_changed || moved || self.camera != chosen || (chosen.is_none() && placement_changed) {
            let view = chosen.and_then(|key| entities.get(&key)).and_then(|&entity| {
                let camera = world.get::<&Camera>(entity).ok()?;
                let transform = world.get::<&WorldTransform>(entity).map_or(glam::DAffine3::IDENTITY, |t| t.0);
                Some(camera::view_of(&camera, &transform))
            });
            let view = view.unwrap_or_else(|| camera::framing(flat.accel.bounds()));
            if first || view != flat.camera || self.camera != chosen {
                report.rebuilt.push(("camera", 1));
            }
            flat.camera = view;
            self.camera = chosen;
        }
        if !report.rebuilt.is_empty() {
            flat.needs = needs::of(flat);
        }
        report
    }

    /// Meshes and shapes of everything shown, in the order of first use, with what the materials say of their opacity.
    fn sources(&mut self, flat: &FlatScene) -> Vec<(Form, MeshOpacity)> {
        let mut users: Vec<(&Form, Vec<&[u32]>)> = Vec::new();
        let mut seen = HashMap::new();
        let mut base = 0;
        for one in &self.shown {
            let row = *seen.entry(one.form.id()).or_insert_with(|| {
                users.push((&one.form, Vec::new()));
                users.len() - 1
            });
            let count = one.form.slot_count() as usize;
            users[row].1.push(&flat.material_rows[base..base + count]);
            base += count;
        }
        let images = &mut self.alphas;
        let mut opacity = |form: &Form, users: &[&[u32]]| MeshOpacity::of_users(form, users, flat, images);
        users.into_iter().map(|(form, users)| (form.clone(), opacity(form, &users))).collect()
    }

    /// Material rows of everything shown, with their textures; returns how many images were made anew.
    fn sync_materials(&mut self, world: &mut hecs::World, flat: &mut FlatScene) -> usize {
        let mut all = world.query::<(&SceneKey, &Material)>();
        let materials: HashMap<SceneKey, &Material> = all.iter().map(|(key, material)| (*key, material)).collect();
        let mut surfaces = world.query::<(&SceneKey, &EmissiveSurface)>();
        let emissive: HashMap<SceneKey, EmissiveSurface> =
            surfaces.iter().map(|(key, surface)| (*key, *surface)).collect();
        let mut uses: Vec<materials::MaterialUse> = Vec::new();
        let mut colored = std::collections::HashSet::new();
        for one in &self.shown {
            for slot in 0..one.form.slot_count() {
                let material_use = use_of(one, slot, &materials);
                uses.push(material_use);
                if one.form.is_colored() {
                    colored.insert(material_use);
                }
            }
        }
        uses.sort_unstable();
        uses.dedup();
        let mut textures = textures::TextureTable::new(&mut self.images);
        let has_colors = |material_use: &materials::MaterialUse| colored.contains(material_use);
        flat.materials = materials::material_rows(&uses, &materials, &emissive, &has_colors, &mut textures);
        let (table, built) = textures.finish();
        flat.textures = table;
        flat.material_rows.clear();
        for one in &self.shown {
            for slot in 0..one.form.slot_count() {
                let row = uses.binary_search(&use_of(one, slot, &materials)).expect("every use was entered above");
                flat.material_rows.push(row as u32);
            }
        }
        built
    }

    fn sync_instances(&mut self, flat: &mut FlatScene) {
        let rows = {
            let mut rows = HashMap::new();
            for one in &self.shown {
                let next = rows.len() as u32;
                rows.entry(one.form.id()).or_insert(next);
            }
            rows
        };
        flat.instances.clear();
        let mut references = Vec::with_capacity(self.shown.len());
        let mut base = 0;
        for one in &self.shown {
            let mesh_row: u32 = rows[&one.form.id()];
            let (row, reference) = instances::place(one, mesh_row, &flat.meshes[mesh_row as usize], base);
            flat.instances.push(row);
            references.push(reference);
            base += one.form.slot_count();
        }
        flat.accel = Accel::build(references);
        let (center, radius) = flat.accel.bounds().map_or(([0.0; 3], 0.0), |(lo, hi)| {
            let [lo, hi] = [glam::Vec3::from(lo), glam::Vec3::from(hi)];
            ((0.5 * (lo + hi)).to_array(), 0.5 * (hi - lo).length())
        });
        (flat.center, flat.radius) = (center, radius);
    }

    /// Slot counts follow the meshes, so bases stay as they are unless meshes changed.
    fn renumber_materials(&self, flat: &mut FlatScene) {
        let mut base = 0;
        for (row, one) in self.shown.iter().enumerate() {
            flat.instances.material_base[row] = base;
            base += one.form.slot_count();
        }
    }

    fn sync_lights(&mut self, world: &mut hecs::World, flat: &mut FlatScene) {
        (flat.lights.triangles, flat.light_rows) = lights::emissive_triangles(flat);
        flat.lights.facets =
            (0..flat.lights.triangles.len()).map(|row| flat.lights.triangles.row(row).into()).collect();
        flat.lights.shapes = lights::emissive_shapes(flat);
        flat.lights.local = lights::local_lights(world);
        flat.lights.distant = lights::distant_lights(world);
        flat.lights.environment = lights::environment(world, &mut self.environment);
        let unlit = flat.materials.flags.iter().any(|f| f & flags::UNLIT != 0);
        flat.lights.default_sky = flat.lights.environment.is_none()
            && flat.lights.triangles.is_empty()
            && flat.lights.shapes.is_empty()
            && !lights::any_unsampled(flat)
            && flat.lights.local.is_empty()
            && flat.lights.distant.is_empty()
            // A scene of unlit surfaces alone shows itself.
            && !(unlit && flat.materials.flags.iter().all(|f| f & flags::UNLIT != 0));
        if flat.lights.default_sky {
            flat.lights.environment = Some(EnvironmentLight::Constant([1.0; 3]));
        }
        flat.lights.choice = lights::choice(flat);
    }
}

/// The material that a slot of a shown entity uses, and whose emission replaces its own.
fn use_of(one: &Shown, slot: u32, materials: &HashMap<SceneKey, &Material>) -> materials::MaterialUse {
    let key = one.slots.as_ref().and_then(|MaterialSlots(keys)| keys.get(slot as usize)).copied();
    (key.filter(|key| materials.contains_key(key)), one.emissive.then_some(one.key))
}

fn same(a: &[Shown], b: &[Shown], equal: impl Fn(&Shown, &Shown) -> bool) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| equal(a, b))
}

fn same_lights(a: &crate::flat::Lights, b: &crate::flat::Lights) -> bool {
    let same_sky = match (&a.environment, &b.environment) {
        (None, None) => true,
        (Some(EnvironmentLight::Constant(a)), Some(EnvironmentLight::Constant(b))) => a == b,
        (Some(EnvironmentLight::Map(a)), Some(EnvironmentLight::Map(b))) => Arc::ptr_eq(a, b),
        _ => false,
    };
    same_sky
        && a.triangles == b.triangles
        && a.shapes == b.shapes
        && a.local == b.local
        && a.distant == b.distant
        && a.choice == b.choice
}

fn first_camera(world: &mut hecs::World) -> Option<SceneKey> {
    world.query_mut::<(&SceneKey, &Camera)>().into_iter().map(|(key, _)| *key).min()
}
