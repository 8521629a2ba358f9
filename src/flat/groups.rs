//! Which entity light comes from.

use super::{FlatScene, NONE, flags};

/// What sent a piece of light off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Source {
    /// The environment.
    #[default]
    Sky,
    /// A row of the instances, by its emitting or unlit surface.
    Instance(u32),
    /// A row that [`LightChoice`](crate::light::LightChoice) has chosen.
    Chosen(u32),
}

/// The entities of a scene that send off light, in the order of their keys; the sky last.
///
/// A number stands for each. Of an entity that is a lamp and has a surface that shines both have the same.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LightGroups {
    /// By instance, [`NONE`] for those without light.
    of_instance: Vec<u32>,
    of_local: Vec<u32>,
    of_distant: Vec<u32>,
    /// Persistent keys; `u64::MAX` is the sky's.
    pub keys: Vec<u64>,
}

impl LightGroups {
    /// Those of a scene.
    pub fn new(scene: &FlatScene) -> Self {
        let (lights, instances) = (&scene.lights, &scene.instances);
        let shines = |&row: &u32| scene.materials.flags[row as usize] & (flags::EMISSIVE | flags::UNLIT) != 0;
        let is_light = |instance: usize| {
            let base = instances.material_base[instance] as usize;
            let slots = scene.meshes[instances.mesh[instance] as usize].slot_count as usize;
            scene.material_rows[base..base + slots].iter().any(shines)
        };
        let shining: Vec<bool> = (0..instances.len()).map(is_light).collect();
        let surfaces = instances.key.iter().zip(&shining).filter(|(_, shines)| **shines).map(|(key, _)| key);
        let mut keys: Vec<u64> = surfaces.chain(&lights.local.key).chain(&lights.distant.key).copied().collect();
        keys.extend(lights.environment.as_ref().map(|_| u64::MAX));
        keys.sort_unstable();
        keys.dedup();
        let group = |key: &u64| keys.binary_search(key).map_or(NONE, |row| row as u32);
        Self {
            of_instance: instances
                .key
                .iter()
                .zip(shining)
                .map(|(key, on)| if on { group(key) } else { NONE })
                .collect(),
            of_local: lights.local.key.iter().map(group).collect(),
            of_distant: lights.distant.key.iter().map(group).collect(),
            keys,
        }
    }

    /// The number of what sent light off.
    #[inline]
    pub fn of(&self, scene: &FlatScene, source: Source) -> u32 {
        let lights = &scene.lights;
        let found = match source {
            Source::Sky => None,
            Source::Instance(row) => self.of_instance.get(row as usize),
            Source::Chosen(row) if row < lights.first_local() => {
                self.of_instance.get(lights.triangles.instance[row as usize] as usize)
            }
            Source::Chosen(row) if row < lights.first_shape() => {
                self.of_local.get((row - lights.first_local()) as usize)
            }
            Source::Chosen(row) if row < lights.first_distant() => {
                self.of_instance.get(lights.shapes.instance[(row - lights.first_shape()) as usize] as usize)
            }
            Source::Chosen(row) => self.of_distant.get((row - lights.first_distant()) as usize),
        };
        // The sky has the greatest key.
        found.copied().unwrap_or(self.keys.len().saturating_sub(1) as u32)
    }
}
