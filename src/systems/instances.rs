//! Entities with geometry or a shape to instances, their materials, and the top-level tree.

use std::{collections::HashSet, sync::Arc};

use glam::DAffine3;
use hecs::World;

use super::geometry::Form;
use crate::{
    accel::InstanceRef,
    flat::{FlatMesh, Instance, NONE},
    world::{EmissiveSurface, Geometry, MaterialSlots, SceneKey, Shape, WorldTransform, WorldVisibility},
};

/// A visible entity with geometry or a shape.
pub struct Shown {
    /// Of the entity.
    pub key: SceneKey,
    /// What it shows.
    pub form: Form,
    /// Where.
    pub world_from_local: DAffine3,
    /// Material of each slot.
    pub slots: Option<MaterialSlots>,
    /// True if it has an [`EmissiveSurface`].
    pub emissive: bool,
}

/// Visible entities with a `T` that has a form.
fn showing<T: hecs::Component>(world: &mut World, form: impl Fn(&T) -> Option<Form>) -> Vec<Shown> {
    type Row<'a, T> = (
        &'a SceneKey,
        &'a T,
        Option<&'a WorldTransform>,
        Option<&'a WorldVisibility>,
        Option<&'a MaterialSlots>,
        Option<&'a EmissiveSurface>,
    );
    world
        .query_mut::<Row<T>>()
        .into_iter()
        .filter(|(_, _, _, visibility, ..)| visibility.is_none_or(|v| v.0))
        .filter_map(|(key, component, transform, _, slots, emissive)| {
            Some(Shown {
                key: *key,
                form: form(component)?,
                world_from_local: transform.map_or(DAffine3::IDENTITY, |t| t.0),
                slots: slots.cloned(),
                emissive: emissive.is_some(),
            })
        })
        .collect()
}

/// Visible entities with geometry or a shape in the order of their keys; what cannot be placed is warned of and left out.
pub fn shown(world: &mut World, warnings: &mut Vec<String>) -> Vec<Shown> {
    let mut shown = showing(world, |Geometry(mesh)| (!mesh.triangles.is_empty()).then(|| Form::Mesh(Arc::clone(mesh))));
    let shapes = showing(world, |shape: &Shape| Some(Form::Shape(*shape)));
    if !shapes.is_empty() {
        let keys: HashSet<SceneKey> = shapes.iter().map(|one| one.key).collect();
        shown.retain(|one| {
            let alone = !keys.contains(&one.key);
            if !alone {
                warnings.push(format!("entity {} has a shape and triangles: the shape is shown", one.key.0));
            }
            alone
        });
        shown.extend(shapes);
    }
    shown.sort_unstable_by_key(|one| one.key);
    shown.retain(|one| {
        let problem = if let Err(problem) = one.form.check() {
            problem
        } else if !invertible(&one.world_from_local) {
            "its transform has no inverse in single precision".to_owned()
        } else {
            return true;
        };
        warnings.push(format!("entity {} is left out: {problem}", one.key.0));
        false
    });
    shown
}

fn invertible(transform: &DAffine3) -> bool {
    let fits = |m: &DAffine3| rows(m).iter().all(|x| x.is_finite());
    transform.matrix3.determinant() != 0.0 && fits(transform) && fits(&transform.inverse())
}

/// A 3×4 matrix by rows, rounded to single precision.
pub fn rows(m: &DAffine3) -> [f32; 12] {
    let [x, y, z, w] = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis, m.translation];
    std::array::from_fn(|i| [x, y, z, w][i % 4][i / 4] as f32)
}

/// The table row and the tree's reference for one shown entity.
pub fn place(shown: &Shown, mesh_row: u32, mesh: &FlatMesh, material_base: u32) -> (Instance, InstanceRef) {
    let identity = shown.world_from_local == DAffine3::IDENTITY;
    let world_from_local = rows(&shown.world_from_local);
    let local_from_world = rows(&shown.world_from_local.inverse());
    let row = Instance {
        mesh: mesh_row,
        material_base,
        light_base: NONE,
        mirrored: u32::from(shown.world_from_local.matrix3.determinant() < 0.0),
        identity: u32::from(identity),
        key: shown.key.0,
        world_from_local,
        local_from_world,
    };
    let reference = InstanceRef { blas: Arc::clone(&mesh.blas), world_from_local, local_from_world, identity };
    (row, reference)
}
