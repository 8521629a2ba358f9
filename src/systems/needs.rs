//! What the tables ask of the stages.

use crate::flat::{EnvironmentLight, FlatScene, NONE, SceneNeeds, ShadingClass, flags};

/// The needs of a scene: what visible things use, nothing that is merely there.
pub fn of(flat: &FlatScene) -> SceneNeeds {
    let mut needs = SceneNeeds::default();
    let materials = &flat.materials;
    let any_flag = |bit: u32| materials.flags.iter().any(|&bits| bits & bit != 0);
    let any_slot = |slots: &[u32]| slots.iter().any(|&slot| slot != NONE);
    needs.add_if(SceneNeeds::TEXTURES, !flat.textures.slots.is_empty());
    needs.add_if(SceneNeeds::NORMAL_MAPS, any_slot(&materials.normal_texture));
    needs.add_if(SceneNeeds::ALPHA, any_flag(flags::MASK | flags::BLEND));
    needs.add_if(
        SceneNeeds::CULLING,
        materials.flags.iter().any(|&bits| bits & (flags::DOUBLE_SIDED | flags::TRANSMISSION) == 0),
    );
    needs.add_if(SceneNeeds::TRANSMISSION, any_flag(flags::TRANSMISSION));
    needs.add_if(SceneNeeds::VOLUMES, materials.absorption.iter().any(|&a| a != [0.0; 3]));
    let area_lights = !flat.lights.triangles.is_empty() || !flat.lights.shapes.is_empty();
    needs.add_if(SceneNeeds::AREA_LIGHTS, area_lights);
    needs.add_if(SceneNeeds::CAUSTICS, area_lights && any_flag(flags::DELTA));
    needs.add_if(SceneNeeds::SHAPES, flat.meshes.iter().any(|mesh| mesh.shape.is_some()));
    needs.add_if(SceneNeeds::LOCAL_LIGHTS, !flat.lights.local.is_empty());
    needs.add_if(SceneNeeds::DISTANT_LIGHTS, !flat.lights.distant.is_empty());
    match &flat.lights.environment {
        Some(EnvironmentLight::Map(_)) => needs.add_if(SceneNeeds::ENVIRONMENT_MAP, true),
        Some(EnvironmentLight::Constant(radiance)) => {
            needs.add_if(SceneNeeds::CONSTANT_SKY, *radiance != [0.0; 3]);
        }
        None => {}
    }
    needs.add_if(SceneNeeds::SMOOTH_NORMALS, flat.meshes.iter().any(|mesh| !mesh.normals.is_empty()));
    needs.add_if(SceneNeeds::VERTEX_COLORS, flat.meshes.iter().any(|mesh| !mesh.colors.is_empty()));
    needs.add_if(SceneNeeds::UNLIT, materials.class.contains(&(ShadingClass::Unlit as u32)));
    let placed = flat.instances.identity.contains(&0);
    needs.add_if(SceneNeeds::INSTANCING, placed || flat.instances.len() > 1);
    needs
}
