//! The eye and the sky.

use std::sync::Arc;

use glam::Vec3;

/// How the picture plane maps to rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Rays leave one point.
    Perspective {
        /// Vertical field of view, rad.
        yfov: f32,
        /// Width over height, if the file says.
        aspect: Option<f32>,
    },
    /// Rays are parallel.
    Orthographic {
        /// Half the width of the view, m.
        xmag: f32,
        /// Half the height of the view, m.
        ymag: f32,
    },
}

/// A camera at the entity's origin that looks along its local −Z axis, +Y up.
///
/// The scale of its transform is ignored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Perspective or orthographic.
    pub projection: Projection,
    /// Nothing nearer is seen, m.
    pub znear: f32,
    /// Nothing farther is seen, m; infinite for none.
    pub zfar: f32,
}

impl Camera {
    /// A perspective camera of the vertical field of view `yfov`, rad.
    pub fn perspective(yfov: f32) -> Self {
        Self { projection: Projection::Perspective { yfov, aspect: None }, znear: 0.0, zfar: f32::INFINITY }
    }

    /// Width over height of the view, where the camera fixes it.
    pub fn aspect(&self) -> Option<f32> {
        match self.projection {
            Projection::Perspective { aspect, .. } => aspect,
            Projection::Orthographic { xmag, ymag } => Some((xmag / ymag).abs()),
        }
    }
}

/// A latitude–longitude picture of the sky, nit, rows from +Y down.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    /// File it came from, for messages.
    pub name: String,
    /// Texels around.
    pub width: u32,
    /// Texels from pole to pole.
    pub height: u32,
    /// Linear Rec.709 radiance, `width × height`; finite and not negative.
    pub texels: Vec<[f32; 3]>,
}

/// Where the light of the environment comes from.
#[derive(Clone, Debug)]
pub enum Sky {
    /// The same radiance everywhere, nit.
    Constant(Vec3),
    /// A picture.
    Map(Arc<EnvironmentMap>),
}

impl PartialEq for Sky {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Constant(a), Self::Constant(b)) => a == b,
            (Self::Map(a), Self::Map(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}

/// Light from infinitely far away, in every direction.
///
/// A world direction d reads the map at u = 0.5 + atan2(d.z, d.x) / 2π and
/// v = acos(d.y) / π. A texel's value holds for its whole area.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Constant or picture.
    pub sky: Sky,
    /// Turns the sky about +Y, degrees, counter-clockwise seen from above.
    pub rotation_degrees: f32,
    /// Multiplies the radiance.
    pub scale: f32,
}

impl Environment {
    /// The same radiance, nit, from everywhere.
    pub fn constant(radiance: Vec3) -> Self {
        Self { sky: Sky::Constant(radiance), rotation_degrees: 0.0, scale: 1.0 }
    }
}
