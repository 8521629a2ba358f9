//! Appearance by rows.

use crate::soa;

/// Bits of [`Materials::flags`].
pub mod flags {
    /// Back faces exist.
    pub const DOUBLE_SIDED: u32 = 1;
    /// Shown as emission, scatters nothing.
    pub const UNLIT: u32 = 1 << 1;
    /// Coverage by comparing alpha with `alpha_cutoff`.
    pub const MASK: u32 = 1 << 2;
    /// Coverage with probability alpha.
    pub const BLEND: u32 = 1 << 3;
    /// Lets light through (transmission > 0).
    pub const TRANSMISSION: u32 = 1 << 4;
    /// Bounds a solid: light refracts and is absorbed inside.
    pub const SOLID: u32 = 1 << 5;
    /// Refers to a texture or vertex colours in any shading slot.
    pub const TEXTURED: u32 = 1 << 6;
    /// Emits.
    pub const EMISSIVE: u32 = 1 << 7;
    /// Has a lobe that is a mirror or clear glass, wherever it is met.
    pub const DELTA: u32 = 1 << 8;
    /// May have a lobe so narrow that some direction is drawn with a density above 2/sr.
    pub const SHINY: u32 = 1 << 9;
}

/// Alpha from which on a blended surface covers wholly: one, less what rounding may take from it, and above all else that
/// sixteen bits can say.
pub const COVERS: f32 = 1.0 - 4e-6;

/// Which compiled version of `shade` a material runs through.
///
/// Few on purpose: the sort before shading makes long runs of one class.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum ShadingClass {
    /// Emits and ends the path; `unlit`.
    Unlit = 0,
    /// Exactly Lambertian, no textures.
    Lambert = 1,
    /// Metallic-roughness, no textures, opaque to light.
    Opaque = 2,
    /// As `Opaque`, with textures or vertex colours.
    OpaqueTextured = 3,
    /// Anything that lets light through, no textures.
    Transmissive = 4,
    /// As `Transmissive`, with textures or vertex colours.
    TransmissiveTextured = 5,
}

impl ShadingClass {
    /// Number of classes.
    pub const COUNT: usize = 6;

    /// The classes that paths go on from.
    pub const SCATTERING: [Self; 5] =
        [Self::Lambert, Self::Opaque, Self::OpaqueTextured, Self::Transmissive, Self::TransmissiveTextured];
}

soa! {
    /// glTF's metallic-roughness parameters, factors before textures; see `world::Material`.
    ///
    /// A texture column holds a row of `TextureSlots` or `NONE`.
    pub struct Materials of MaterialRow {
        /// See `flags`.
        flags: u32,
        /// A `ShadingClass` as a number.
        class: u32,
        /// Linear albedo or reflectance.
        base_color: [f32; 3],
        /// Coverage.
        base_alpha: f32,
        /// For `flags::MASK`.
        alpha_cutoff: f32,
        /// 0 dielectric, 1 metal.
        metallic: f32,
        /// Perceptual; the GGX width is its square.
        roughness: f32,
        /// Emitted radiance, nit.
        emissive: [f32; 3],
        /// Strength of dielectric reflection.
        specular: f32,
        /// Tint of dielectric reflection.
        specular_color: [f32; 3],
        /// Index of refraction; 0 stands for infinite.
        ior: f32,
        /// Share of the diffuse part that is let through.
        transmission: f32,
        /// Absorption of the solid's interior, 1/m: −ln(attenuation colour) / attenuation distance.
        absorption: [f32; 3],
        /// Multiplies x and y of a sampled normal.
        normal_scale: f32,
        /// sRGB colour, linear alpha.
        base_color_texture: u32,
        /// Roughness in G, metalness in B.
        metallic_roughness_texture: u32,
        /// Tangent-space normals.
        normal_texture: u32,
        /// sRGB.
        emissive_texture: u32,
        /// Strength in A.
        specular_texture: u32,
        /// sRGB.
        specular_color_texture: u32,
        /// Share in R.
        transmission_texture: u32,
        /// Persistent key of the material's entity; `u64::MAX` for the default material.
        key: u64,
    }
}
