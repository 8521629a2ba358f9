//! Light sources other than emissive materials and the environment.

use glam::Vec3;

use super::units::{Candela, Lux};

/// A light of no size that shines evenly in all directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointLight {
    /// Tint in linear sRGB; white is 1, 1, 1.
    pub color: Vec3,
    /// Intensity in every direction.
    pub intensity: Candela,
}

/// A light of no size that shines along the entity's local −Z axis within a cone.
///
/// Between the two angles it falls off as glTF `KHR_lights_punctual` recommends:
/// the square of a ramp linear in the cosine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpotLight {
    /// Tint in linear sRGB; white is 1, 1, 1.
    pub color: Vec3,
    /// Intensity within the inner cone.
    pub intensity: Candela,
    /// Half angle of full intensity, rad; less than `outer`.
    pub inner: f32,
    /// Half angle where light ends, rad; at most π/2.
    pub outer: f32,
}

/// A light so far away that its rays are parallel, such as the sun.
///
/// It shines along the entity's local −Z axis, and the entity's position and
/// scale do not change it (glTF `KHR_lights_punctual`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionalLight {
    /// Tint in linear sRGB; white is 1, 1, 1.
    pub color: Vec3,
    /// Illuminance of a surface that faces the light.
    pub illuminance: Lux,
}

/// Makes the whole surface of the entity emit, in place of its material's emission.
///
/// Both sides emit if the material is double-sided, else the front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmissiveSurface {
    /// Emitted radiance, nit, the same in all directions.
    pub radiance: Vec3,
}
