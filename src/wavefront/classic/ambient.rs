//! Ambient occlusion: how much of the hemisphere above a surface is open.
//!
//! The share, weighted by the cosine, of directions in which nothing is met within a distance (Zhukov, Iones, Kronin 1998, "An
//! Ambient Light Illumination Model"; Landis 2002, "Production-Ready Global Illumination"): that is what is left of direct light when
//! all surfaces are white and matt and the sky is white everywhere. So it is rendered as that, by the same stages.

use crate::{
    flat::{EnvironmentLight, FlatScene, Lights, NONE, ShadingClass, flags},
    light::LightChoice,
};

/// The scene with white matt surfaces and no other light than a sky of 1 nit. Coverage stays: what is not there stops no ray.
pub fn in_white_sky(scene: &FlatScene) -> FlatScene {
    let mut scene = scene.clone();
    let materials = &mut scene.materials;
    for row in 0..materials.len() {
        let cover = flags::MASK | flags::BLEND | flags::TEXTURED | flags::DOUBLE_SIDED;
        // What lets light through has a back.
        let has_back = materials.flags[row] & flags::TRANSMISSION != 0;
        let kept = materials.flags[row] & cover;
        materials.flags[row] = if has_back { kept | flags::DOUBLE_SIDED } else { kept };
        materials.class[row] = ShadingClass::Lambert as u32;
        materials.base_color[row] = [1.0; 3];
        materials.emissive[row] = [0.0; 3];
        materials.emissive_texture[row] = NONE;
        materials.absorption[row] = [0.0; 3];
        materials.normal_texture[row] = NONE;
    }
    scene.lights = Lights {
        environment: Some(EnvironmentLight::Constant([1.0; 3])),
        choice: LightChoice::default(),
        ..Lights::default()
    };
    scene.light_rows.clear();
    scene.instances.light_base.iter_mut().for_each(|base| *base = NONE);
    scene
}
