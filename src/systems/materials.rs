//! Materials to rows.

use std::collections::HashMap;

use super::textures::TextureTable;
use crate::{
    bsdf::DELTA_ALPHA,
    flat::{Decode, MaterialRow, Materials, NONE, ShadingClass, flags},
    world::{AlphaMode, EmissiveSurface, Material, SceneKey},
};

/// Roughness from which on no lobe of a surface is narrow: 1/2πα³ is below 2 there.
const LEAST_MATT_ROUGHNESS: f32 = 0.66;

/// Which material, and which emission put in its place, a row stands for.
pub type MaterialUse = (Option<SceneKey>, Option<SceneKey>);

/// Rows for the materials in `uses`, which must be sorted; textures are entered into `textures`.
///
/// A use without a key, or whose key has no material, is glTF's default material.
pub fn material_rows(
    uses: &[MaterialUse],
    materials: &HashMap<SceneKey, &Material>,
    emissive: &HashMap<SceneKey, EmissiveSurface>,
    vertex_colors: &dyn Fn(&MaterialUse) -> bool,
    textures: &mut TextureTable,
) -> Materials {
    let default = Material::default();
    let mut table = Materials::default();
    for material_use in uses {
        let (key, emitter) = *material_use;
        let material = key.and_then(|key| materials.get(&key).copied()).unwrap_or(&default);
        let mut row = row_of(material, key, vertex_colors(material_use), textures);
        if let Some(surface) = emitter.and_then(|key| emissive.get(&key)) {
            row.emissive = surface.radiance.to_array();
            row.emissive_texture = NONE;
            row.flags = row.flags & !flags::EMISSIVE | if row.emissive == [0.0; 3] { 0 } else { flags::EMISSIVE };
        }
        table.push(row);
    }
    table
}

fn row_of(m: &Material, key: Option<SceneKey>, vertex_colors: bool, textures: &mut TextureTable) -> MaterialRow {
    let base_color_texture = textures.slot(m.base_color_texture.as_ref(), Decode::Srgb);
    // An unlit surface shows its base colour and nothing else; a factor of zero needs no texture.
    let lit = |needed: bool, texture, decode, textures: &mut TextureTable| {
        if needed && !m.unlit { textures.slot(texture, decode) } else { NONE }
    };
    let metal_or_rough = m.metallic > 0.0 || m.roughness > 0.0;
    let metallic_roughness_texture =
        lit(metal_or_rough, m.metallic_roughness_texture.as_ref(), Decode::Linear, textures);
    let normal_texture = lit(true, m.normal_texture.as_ref(), Decode::Linear, textures);
    let emits = m.emissive.max_element() > 0.0 && !m.unlit;
    let emissive_texture = lit(emits, m.emissive_texture.as_ref(), Decode::Srgb, textures);
    let dielectric = m.specular > 0.0;
    let specular_texture = lit(dielectric, m.specular_texture.as_ref(), Decode::Linear, textures);
    let specular_color_texture = lit(dielectric, m.specular_color_texture.as_ref(), Decode::Srgb, textures);
    let transmissive = m.transmission > 0.0 && !m.unlit;
    let transmission_texture = lit(transmissive, m.transmission_texture.as_ref(), Decode::Linear, textures);

    // Emission alone does not need the textured version: it is looked up for emissive rows only.
    let shading = [
        base_color_texture,
        metallic_roughness_texture,
        normal_texture,
        specular_texture,
        specular_color_texture,
        transmission_texture,
    ];
    let textured = vertex_colors || shading.iter().any(|&slot| slot != NONE);
    let class = match (m.unlit, transmissive, textured) {
        (true, ..) => ShadingClass::Unlit,
        (_, true, false) => ShadingClass::Transmissive,
        (_, true, true) => ShadingClass::TransmissiveTextured,
        (_, false, true) => ShadingClass::OpaqueTextured,
        _ if m.metallic == 0.0 && m.specular == 0.0 => ShadingClass::Lambert,
        _ => ShadingClass::Opaque,
    };
    let mut bits = 0;
    let mut add_if = |flag, condition: bool| bits |= if condition { flag } else { 0 };
    add_if(flags::DOUBLE_SIDED, m.double_sided);
    add_if(flags::UNLIT, m.unlit);
    add_if(flags::MASK, matches!(m.alpha_mode, AlphaMode::Mask { .. }));
    add_if(flags::BLEND, m.alpha_mode == AlphaMode::Blend);
    add_if(flags::TRANSMISSION, transmissive);
    add_if(flags::SOLID, m.is_solid());
    add_if(flags::TEXTURED, textured);
    add_if(flags::EMISSIVE, emits);
    // Where a texture has a say, few of its texels are smooth enough; paths find what those do.
    let smooth = metallic_roughness_texture == NONE && m.roughness * m.roughness < DELTA_ALPHA;
    add_if(flags::DELTA, smooth && !m.unlit && (m.metallic > 0.0 || m.specular > 0.0 || transmissive));
    // Facets of width α are drawn with a density of 1/2πα³ at most.
    let narrow = metallic_roughness_texture != NONE || m.roughness < LEAST_MATT_ROUGHNESS || transmissive;
    add_if(flags::SHINY, narrow && !m.unlit && (m.metallic > 0.0 || m.specular > 0.0 || transmissive));
    let absorption = m.attenuation_color.to_array().map(|color| {
        // Black would be absorbed at once; the smallest positive colour is near enough and stays finite.
        if m.is_solid() && m.attenuation_distance.is_finite() {
            -color.clamp(f32::MIN_POSITIVE, 1.0).ln() / m.attenuation_distance.max(f32::MIN_POSITIVE)
        } else {
            0.0
        }
    });
    MaterialRow {
        flags: bits,
        class: class as u32,
        base_color: m.base_color.to_array(),
        base_alpha: m.base_alpha,
        alpha_cutoff: if let AlphaMode::Mask { cutoff } = m.alpha_mode { cutoff } else { 0.0 },
        metallic: m.metallic,
        roughness: m.roughness,
        emissive: if m.unlit { [0.0; 3] } else { m.emissive.to_array() },
        specular: m.specular,
        specular_color: m.specular_color.to_array(),
        ior: m.ior,
        transmission: if transmissive { m.transmission } else { 0.0 },
        absorption: absorption.map(|a| a.min(f32::MAX)),
        normal_scale: m.normal_scale,
        base_color_texture,
        metallic_roughness_texture,
        normal_texture,
        emissive_texture,
        specular_texture,
        specular_color_texture,
        transmission_texture,
        key: key.map_or(u64::MAX, |key| key.0),
    }
}
