//! Materials: glTF's metallic-roughness model and the extensions that refine it.

use std::sync::Arc;

use glam::Vec3;

use super::{
    document::Document,
    error::{LoadError, Warnings},
    json::Json,
    tangents::Along,
    textures::{TextureUse, read_texture},
};
use crate::world::{AlphaMode, Image, Material, Texture};

/// Range of a share.
const UNIT: [f32; 2] = [0.0, 1.0];
/// Range of what has no upper bound; `f32::MAX` is let through.
const POSITIVE: [f32; 2] = [0.0, f32::MAX];
/// Absorption goes with the inverse, which must stay finite.
const SHORTEST_ATTENUATION: f32 = 1e-9;

/// Which texture of a material.
type Slot = fn(&mut Material) -> &mut Option<Texture>;

/// A material whose images are not decoded yet.
#[derive(Clone, Debug)]
pub(super) struct Draft {
    pub(super) name: String,
    material: Material,
    textures: Vec<(Slot, TextureUse)>,
    /// Texture coordinates of the normal map, if there is one.
    pub(super) normal_along: Option<Along>,
}

impl Draft {
    /// Marks the images that the material needs.
    pub(super) fn mark_images(&self, wanted: &mut [bool]) {
        for (_, texture) in &self.textures {
            wanted[texture.image] = true;
        }
    }

    /// The material, once its images are there.
    pub(super) fn finish(&self, images: &[Option<Arc<Image>>]) -> Material {
        let mut material = self.material.clone();
        for (slot, texture) in &self.textures {
            *slot(&mut material) = images[texture.image].clone().map(|image| texture.with_image(image));
        }
        material
    }
}

/// Reads one material.
pub(super) fn read_material(
    json: &Json<'_>,
    index: usize,
    document: &Document<'_>,
    warnings: &mut Warnings,
) -> Result<Draft, LoadError> {
    let mut draft = Draft {
        name: json.name_or("material", index)?,
        material: Material::default(),
        textures: Vec::new(),
        normal_along: None,
    };
    read_core(json, &mut draft, document, warnings)?;
    read_extensions(json, &mut draft, document, warnings)?;
    Ok(draft)
}

fn read_core(
    json: &Json<'_>,
    draft: &mut Draft,
    document: &Document<'_>,
    warnings: &mut Warnings,
) -> Result<(), LoadError> {
    let material = &mut draft.material;
    let mut texture = |owner: &Json<'_>, key: &str, slot: Slot, warnings: &mut Warnings| -> Result<_, LoadError> {
        let found = read_texture(owner, key, document, warnings)?;
        draft.textures.extend(found.clone().map(|found| (slot, found)));
        Ok(found)
    };
    if let Some(pbr) = json.get("pbrMetallicRoughness")? {
        let [r, g, b, a] = pbr.factors("baseColorFactor", [1.0; 4], UNIT, warnings)?;
        (material.base_color, material.base_alpha) = (Vec3::new(r, g, b), a);
        material.metallic = pbr.factor("metallicFactor", 1.0, UNIT, warnings)?;
        material.roughness = pbr.factor("roughnessFactor", 1.0, UNIT, warnings)?;
        texture(&pbr, "baseColorTexture", |m| &mut m.base_color_texture, warnings)?;
        texture(&pbr, "metallicRoughnessTexture", |m| &mut m.metallic_roughness_texture, warnings)?;
    }
    if let Some(normal) = texture(json, "normalTexture", |m| &mut m.normal_texture, warnings)? {
        draft.normal_along = Some(Along::new(normal.tex_coord, &normal.transform));
        let scale = json.required("normalTexture")?.get("scale")?;
        material.normal_scale = scale.map(|scale| scale.number()).transpose()?.unwrap_or(1.0) as f32;
    }
    texture(json, "emissiveTexture", |m| &mut m.emissive_texture, warnings)?;
    material.emissive = Vec3::from(json.factors("emissiveFactor", [0.0; 3], UNIT, warnings)?);
    material.double_sided = json.boolean_or("doubleSided", false)?;
    let cutoff = json.factor("alphaCutoff", 0.5, POSITIVE, warnings)?;
    if let Some(mode) = json.get("alphaMode")? {
        material.alpha_mode = match mode.string()? {
            "OPAQUE" => AlphaMode::Opaque,
            "MASK" => AlphaMode::Mask { cutoff },
            "BLEND" => AlphaMode::Blend,
            _ => return Err(mode.expected("OPAQUE, MASK or BLEND")),
        };
    }
    Ok(())
}

fn read_extensions(
    json: &Json<'_>,
    draft: &mut Draft,
    document: &Document<'_>,
    warnings: &mut Warnings,
) -> Result<(), LoadError> {
    let material = &mut draft.material;
    let mut texture = |owner: &Json<'_>, key: &str, slot: Slot, warnings: &mut Warnings| -> Result<(), LoadError> {
        draft.textures.extend(read_texture(owner, key, document, warnings)?.map(|found| (slot, found)));
        Ok(())
    };
    material.unlit = json.extension("KHR_materials_unlit")?.is_some();
    if let Some(strength) = json.extension("KHR_materials_emissive_strength")? {
        let factor = strength.factor("emissiveStrength", 1.0, POSITIVE, warnings)?;
        let emissive = material.emissive * factor;
        if !emissive.is_finite() {
            return Err(strength.expected("an emission within single precision"));
        }
        material.emissive = emissive;
    }
    if let Some(ior) = json.extension("KHR_materials_ior")? {
        let value = ior.factor("ior", 1.5, POSITIVE, warnings)?;
        material.ior = value;
        // Zero is the extension's way to say "reflects everything".
        if value != 0.0 && value < 1.0 {
            warnings.push(&ior.at.join("ior"), format!("{value} is neither 0 nor at least 1, taken as 1"));
            material.ior = 1.0;
        }
    }
    if let Some(specular) = json.extension("KHR_materials_specular")? {
        material.specular = specular.factor("specularFactor", 1.0, UNIT, warnings)?;
        material.specular_color = Vec3::from(specular.factors("specularColorFactor", [1.0; 3], POSITIVE, warnings)?);
        texture(&specular, "specularTexture", |m| &mut m.specular_texture, warnings)?;
        texture(&specular, "specularColorTexture", |m| &mut m.specular_color_texture, warnings)?;
    }
    if let Some(transmission) = json.extension("KHR_materials_transmission")? {
        material.transmission = transmission.factor("transmissionFactor", 0.0, UNIT, warnings)?;
        texture(&transmission, "transmissionTexture", |m| &mut m.transmission_texture, warnings)?;
    }
    if let Some(volume) = json.extension("KHR_materials_volume")? {
        material.thickness = volume.factor("thicknessFactor", 0.0, POSITIVE, warnings)?;
        material.attenuation_color = Vec3::from(volume.factors("attenuationColor", [1.0; 3], UNIT, warnings)?);
        // Absent means infinite, which a JSON number cannot say.
        if volume.get("attenuationDistance")?.is_some() {
            let range = [SHORTEST_ATTENUATION, f32::MAX];
            material.attenuation_distance = volume.factor("attenuationDistance", 1.0, range, warnings)?;
        }
    }
    Ok(())
}
