//! Where entities are: transforms, their hierarchy, and visibility.

use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::SceneKey;

/// The entity's transform relative to its [`Parent`], in metres.
///
/// Kept in `f64`: products of long chains and positions far from the origin
/// stay exact to well below a micrometre, and rounding happens once, when the
/// instance table is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LocalTransform {
    /// Translation after rotation after scale, as animations drive it.
    Trs {
        /// Metres.
        translation: DVec3,
        /// Unit quaternion.
        rotation: DQuat,
        /// Per axis; negative mirrors.
        scale: DVec3,
    },
    /// Any affine map, shear included.
    Matrix(DAffine3),
}

impl LocalTransform {
    /// The transform that changes nothing.
    pub const IDENTITY: Self = Self::Trs { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE };

    /// A pure translation.
    pub fn from_translation(translation: DVec3) -> Self {
        Self::Trs { translation, rotation: DQuat::IDENTITY, scale: DVec3::ONE }
    }

    /// Places a camera or light at `eye` so that its −Z axis points at `target`.
    pub fn looking_at(eye: DVec3, target: DVec3, up: DVec3) -> Self {
        let back = (eye - target).normalize_or(DVec3::Z);
        let right = up.cross(back).try_normalize().unwrap_or_else(|| back.any_orthonormal_vector());
        Self::Matrix(DAffine3::from_cols(right, back.cross(right), back, eye))
    }

    /// The affine map from local to parent space.
    pub fn to_affine(self) -> DAffine3 {
        match self {
            Self::Trs { translation, rotation, scale } => {
                DAffine3::from_scale_rotation_translation(scale, rotation, translation)
            }
            Self::Matrix(matrix) => matrix,
        }
    }

    /// From a column-major 4×4 matrix whose last row is taken to be 0 0 0 1.
    pub fn from_columns(columns: &[f64; 16]) -> Self {
        Self::Matrix(DAffine3::from_mat4(DMat4::from_cols_array(columns)))
    }
}

impl Default for LocalTransform {
    fn default() -> Self {
        Self::IDENTITY
    }
}

/// The entity's transform to world space; written by the transforms system only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldTransform(pub DAffine3);

/// The entity whose space this one's [`LocalTransform`] is relative to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parent(pub SceneKey);

/// Whether the entity and what hangs below it takes part in the picture.
///
/// An entity without this component is visible if its parent is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Visibility(pub bool);

/// [`Visibility`] combined along the parents; written by the transforms system only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorldVisibility(pub bool);
