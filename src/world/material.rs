//! Surface appearance, in glTF's terms.

use glam::Vec3;

use super::Texture;

/// How coverage follows from alpha.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Covers fully; alpha is ignored.
    #[default]
    Opaque,
    /// Covers where alpha is at least the cutoff.
    Mask {
        /// glTF's default is 0.5.
        cutoff: f32,
    },
    /// Covers a share of the light: a surface is met with probability alpha.
    Blend,
}

/// glTF's metallic-roughness material with the extensions read so far.
///
/// Factors multiply their texture. Colours are linear Rec.709. The occlusion
/// texture is not read: a path tracer finds occlusion itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Albedo of the dielectric, reflectance at normal incidence of the metal; 0 to 1.
    pub base_color: Vec3,
    /// Coverage; see [`AlphaMode`].
    pub base_alpha: f32,
    /// sRGB colour and linear alpha.
    pub base_color_texture: Option<Texture>,
    /// 0 dielectric, 1 metal.
    pub metallic: f32,
    /// Perceptual roughness; the GGX width is its square. 0 is an exact mirror.
    pub roughness: f32,
    /// Roughness in G, metalness in B.
    pub metallic_roughness_texture: Option<Texture>,
    /// Tangent-space normals.
    pub normal_texture: Option<Texture>,
    /// Multiplies x and y of the sampled normal.
    pub normal_scale: f32,
    /// Emitted radiance, nit (factor times `KHR_materials_emissive_strength`), from front faces
    /// only unless `double_sided`.
    pub emissive: Vec3,
    /// sRGB.
    pub emissive_texture: Option<Texture>,
    /// Coverage rule.
    pub alpha_mode: AlphaMode,
    /// False: back faces do not exist, for any ray (glTF: back-face culling). Transmissive
    /// surfaces are seen from both sides regardless.
    pub double_sided: bool,
    /// `KHR_materials_unlit`: the base colour is shown as it is, as emission in nit; the surface
    /// scatters nothing.
    pub unlit: bool,
    /// `KHR_materials_specular`: strength of dielectric reflection; 0 leaves exact Lambert.
    pub specular: f32,
    /// Strength in A.
    pub specular_texture: Option<Texture>,
    /// Tint of dielectric reflection at normal incidence; may exceed 1.
    pub specular_color: Vec3,
    /// sRGB.
    pub specular_color_texture: Option<Texture>,
    /// Index of refraction; 0 means "infinite": everything is reflected.
    pub ior: f32,
    /// `KHR_materials_transmission`: share of the diffuse part that is let through instead.
    pub transmission: f32,
    /// Share in R.
    pub transmission_texture: Option<Texture>,
    /// `KHR_materials_volume`: 0 is a thin wall; anything else makes the mesh the boundary of a
    /// solid. Only its being zero matters: the real path length is traced.
    pub thickness: f32,
    /// Distance after which white light has the attenuation colour, m; infinite for none.
    pub attenuation_distance: f32,
    /// Colour of white light after that distance; 0 to 1.
    pub attenuation_color: Vec3,
}

impl Default for Material {
    /// glTF's defaults.
    fn default() -> Self {
        Self {
            base_color: Vec3::ONE,
            base_alpha: 1.0,
            base_color_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            unlit: false,
            specular: 1.0,
            specular_texture: None,
            specular_color: Vec3::ONE,
            specular_color_texture: None,
            ior: 1.5,
            transmission: 0.0,
            transmission_texture: None,
            thickness: 0.0,
            attenuation_distance: f32::INFINITY,
            attenuation_color: Vec3::ONE,
        }
    }
}

impl Material {
    /// Exactly Lambertian, of the given albedo.
    pub fn lambert(albedo: Vec3) -> Self {
        Self { base_color: albedo, metallic: 0.0, specular: 0.0, double_sided: true, ..Self::default() }
    }

    /// A solid of clear glass with exact mirror and refraction.
    pub fn glass(ior: f32) -> Self {
        Self { metallic: 0.0, roughness: 0.0, transmission: 1.0, thickness: 1.0, ior, ..Self::default() }
    }

    /// True if the material bounds a solid that light travels through.
    pub fn is_solid(&self) -> bool {
        self.transmission > 0.0 && self.thickness > 0.0 && !self.unlit
    }
}
