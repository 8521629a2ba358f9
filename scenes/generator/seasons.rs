//! Why summer is warm: the same sun on the earth in June and in December.

use glam::{Quat, Vec3, vec3};

use super::{
    document::{Document, Place},
    material::Material,
    shape::Shape,
};

/// Tilt of the earth's axis.
const TILT: f32 = 23.5;
/// Illuminance of what faces the sun, lx: so that a picture needs no exposure.
const SUN: f64 = 3.0;

/// Two balls of radius 1 with their axes, at (0, 0, 0) in June and at (0, -3, 0) in December, and a sun in the direction of +X.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let sea = scene.material(Material::lambert("sea", [0.25, 0.45, 0.75]));
    let axis = scene.material(Material::lambert("axis", [0.8, 0.3, 0.1]));
    for (name, degrees, y) in [("june", -TILT, 0.0), ("december", TILT, -3.0)] {
        let turned = Quat::from_rotation_z(degrees.to_radians());
        scene.show(name, &Shape::sphere(1.0, 64).smooth().placed(turned, vec3(0.0, y, 0.0)), sea);
        let pole = Shape::cylinder(0.02, 2.6, 24).at(0.0, -1.3, 0.0);
        scene.show(&format!("{name}'s axis"), &pole.placed(turned, vec3(0.0, y, 0.0)), axis);
    }
    scene.directional_light("sun", [1.0, 1.0, 1.0], SUN, Place::looking(Vec3::X, Vec3::ZERO));
    scene.camera("camera", 34.0, 0.75, Place::looking(vec3(3.0, -1.5, 10.5), vec3(0.0, -1.5, 0.0)));
    scene
}
