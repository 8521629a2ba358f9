//! The eye.

use glam::DVec3;

/// From picture plane to ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewProjection {
    /// Rays leave the origin.
    Perspective {
        /// Tangent of half the vertical field of view.
        tan_half_yfov: f64,
    },
    /// Rays are parallel.
    Orthographic {
        /// Half the height of the view, m.
        half_height: f64,
    },
}

/// A camera in world space; the axes are of unit length and right-handed with `−forward`.
///
/// A film position (x, y) in pixels, y down, on a film of w × h pixels has view
/// coordinates s = (2x − w)/h and t = 1 − 2y/h. Perspective: the ray leaves `origin` along
/// `forward + tan·(s·right + t·up)`, normalised. Orthographic: it leaves
/// `origin + half_height·(s·right + t·up)` along `forward`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraView {
    /// m.
    pub origin: DVec3,
    /// Unit vector to the right.
    pub right: DVec3,
    /// Unit vector upwards.
    pub up: DVec3,
    /// Unit vector into the picture.
    pub forward: DVec3,
    /// Perspective or orthographic.
    pub projection: ViewProjection,
    /// Width over height that the camera asks for, if it does.
    pub aspect: Option<f32>,
    /// Depth along `forward` before which nothing is seen, m.
    pub znear: f32,
    /// Depth along `forward` beyond which nothing is seen, m.
    pub zfar: f32,
}

impl Default for CameraView {
    fn default() -> Self {
        Self {
            origin: DVec3::ZERO,
            right: DVec3::X,
            up: DVec3::Y,
            forward: DVec3::NEG_Z,
            projection: ViewProjection::Perspective { tan_half_yfov: 0.5 },
            aspect: None,
            znear: 0.0,
            zfar: f32::INFINITY,
        }
    }
}
