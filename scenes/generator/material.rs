//! glTF materials, built property by property.

use serde_json::{Map, Value, json};

use super::document::TextureId;

/// A colour in linear Rec.709.
pub type Color = [f64; 3];

/// A material under construction.
pub struct Material(Value);

impl Material {
    /// Exactly Lambertian.
    pub fn lambert(name: &str, color: Color) -> Self {
        Self::dielectric(name, color, 1.0).extension("KHR_materials_specular", json!({"specularFactor": 0}))
    }

    /// Colour under a clear coat of the given roughness, reflecting 4 % at normal incidence.
    pub fn dielectric(name: &str, color: Color, roughness: f64) -> Self {
        let [r, g, b] = color;
        Self(json!({
            "name": name,
            "pbrMetallicRoughness": {"baseColorFactor": [r, g, b, 1], "metallicFactor": 0, "roughnessFactor": roughness}
        }))
    }

    /// A bare metal with the given reflectance at normal incidence.
    pub fn metal(name: &str, color: Color, roughness: f64) -> Self {
        let mut material = Self::dielectric(name, color, roughness);
        material.0["pbrMetallicRoughness"]["metallicFactor"] = json!(1);
        material
    }

    /// A solid of clear glass; a pane or film if `thickness` (m) is 0.
    pub fn glass(name: &str, ior: f64, roughness: f64, thickness: f64) -> Self {
        let glass = Self::dielectric(name, [1.0; 3], roughness)
            .extension("KHR_materials_transmission", json!({"transmissionFactor": 1}))
            .extension("KHR_materials_ior", json!({"ior": ior}));
        if thickness == 0.0 {
            return glass;
        }
        glass.extension("KHR_materials_volume", json!({"thicknessFactor": thickness}))
    }

    /// Black but for its light, `color` × `nit` from the front.
    pub fn emitter(name: &str, color: Color, nit: f64) -> Self {
        let mut material = Self::lambert(name, [0.0; 3])
            .extension("KHR_materials_emissive_strength", json!({"emissiveStrength": nit}));
        material.0["emissiveFactor"] = json!(color);
        material
    }

    /// Lets a colour through, reached after `distance` m, instead of white.
    pub fn absorbing(mut self, color: Color, distance: f64) -> Self {
        let volume = &mut self.0["extensions"]["KHR_materials_volume"];
        volume["attenuationColor"] = json!(color);
        volume["attenuationDistance"] = json!(distance);
        self
    }

    /// The base colour times a texture, repeated `repeats` times along u and v.
    pub fn textured(mut self, texture: TextureId, repeats: [f64; 2]) -> Self {
        self.0["pbrMetallicRoughness"]["baseColorTexture"] = tiled(texture, repeats);
        self
    }

    /// The emission times a texture.
    pub fn emission_textured(mut self, texture: TextureId) -> Self {
        self.0["emissiveTexture"] = tiled(texture, [1.0; 2]);
        self
    }

    /// With a normal map.
    pub fn bumpy(mut self, texture: TextureId, repeats: [f64; 2]) -> Self {
        self.0["normalTexture"] = tiled(texture, repeats);
        self
    }

    /// Has a back.
    pub fn double_sided(mut self) -> Self {
        self.0["doubleSided"] = json!(true);
        self
    }

    /// Cut out where alpha is below the cutoff.
    pub fn masked(mut self, cutoff: f64) -> Self {
        self.0["alphaMode"] = json!("MASK");
        self.0["alphaCutoff"] = json!(cutoff);
        self
    }

    /// Covers a share of the light: `alpha` times the texture's.
    pub fn blended(mut self, alpha: f64) -> Self {
        self.0["alphaMode"] = json!("BLEND");
        self.0["pbrMetallicRoughness"]["baseColorFactor"][3] = json!(alpha);
        self
    }

    /// As JSON.
    pub fn into_value(self) -> Value {
        self.0
    }

    fn extension(mut self, name: &str, value: Value) -> Self {
        if self.0.get("extensions").is_none() {
            self.0["extensions"] = Value::Object(Map::new());
        }
        self.0["extensions"][name] = value;
        self
    }
}

fn tiled(texture: TextureId, repeats: [f64; 2]) -> Value {
    let mut info = json!({"index": texture.0});
    if repeats != [1.0; 2] {
        info["extensions"] = json!({"KHR_texture_transform": {"scale": repeats}});
    }
    info
}
