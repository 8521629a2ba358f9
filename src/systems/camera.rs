//! The active camera, or one that frames the scene.

use glam::{DAffine3, DVec3};

use crate::{
    flat::{CameraView, ViewProjection},
    world::{Camera, Projection},
};

/// A camera entity as rays need it.
pub fn view_of(camera: &Camera, world_from_local: &DAffine3) -> CameraView {
    let m = &world_from_local.matrix3;
    let back = m.z_axis.normalize_or(DVec3::Z);
    // Scale and shear of the node are not part of a view; the up axis is kept upright.
    let right = m.y_axis.cross(back).try_normalize().unwrap_or_else(|| back.any_orthonormal_vector());
    let projection = match camera.projection {
        Projection::Perspective { yfov, .. } => {
            ViewProjection::Perspective { tan_half_yfov: (0.5 * f64::from(yfov)).tan() }
        }
        Projection::Orthographic { ymag, .. } => ViewProjection::Orthographic { half_height: f64::from(ymag).abs() },
    };
    CameraView {
        origin: world_from_local.translation,
        right,
        up: back.cross(right),
        forward: -back,
        projection,
        aspect: camera.aspect(),
        znear: camera.znear,
        zfar: camera.zfar,
    }
}

/// A view of a box from a little right of and above its front (+Z), with a margin of 5 %.
pub fn framing(bounds: Option<([f32; 3], [f32; 3])>) -> CameraView {
    let (lo, hi) = bounds.unwrap_or(([-1.0; 3], [1.0; 3]));
    let [lo, hi] = [lo, hi].map(|corner| DVec3::from_array(corner.map(f64::from)));
    let center = 0.5 * (lo + hi);
    let (azimuth, elevation) = (20.0_f64.to_radians(), 15.0_f64.to_radians());
    let back = DVec3::new(elevation.cos() * azimuth.sin(), elevation.sin(), elevation.cos() * azimuth.cos());
    let right = DVec3::Y.cross(back).normalize();
    let up = back.cross(right);
    let tan = (0.5 * 40.0_f64.to_radians()).tan();
    // Fits a view at least as wide as high; the default is 16:9.
    let aspect = 1.0;
    let distance = (0..8)
        .map(|i| {
            let corner =
                DVec3::from_array(std::array::from_fn(|axis| if i >> axis & 1 == 0 { lo[axis] } else { hi[axis] }));
            let offset = corner - center;
            let (x, y, z) = (offset.dot(right).abs(), offset.dot(up).abs(), offset.dot(back));
            z + 1.05 * (x / (tan * aspect)).max(y / tan)
        })
        .fold(0.0, f64::max);
    let distance = if distance > 0.0 { distance } else { 1.0 };
    CameraView {
        origin: center + distance * back,
        right,
        up,
        forward: -back,
        projection: ViewProjection::Perspective { tan_half_yfov: tan },
        aspect: None,
        znear: 0.0,
        zfar: f32::INFINITY,
    }
}
