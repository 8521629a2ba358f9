//! The lecture's lamp: 815 lm to all sides, and what stands in its light.

use glam::{Quat, Vec3, vec3};

use super::{
    document::{Document, Place},
    material::Material,
    shape::Shape,
};

/// Its intensity, cd: 815 lm over 4π sr.
const CANDELA: f64 = 815.0 / (4.0 * std::f64::consts::PI);

/// A lamp at the origin; a metre below it a die whose top is turned away by 60°, two metres below it a floor; balls whose nearest
/// points are 1 m and 2 m from it.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let floor = scene.material(Material::lambert("floor", [0.12, 0.12, 0.12]));
    let chalk = scene.material(Material::lambert("chalk", [0.05, 0.05, 0.05]));
    let blue = scene.material(Material::lambert("blue", [0.03, 0.05, 0.12]));
    scene.show_flat("floor", &Shape::quad(vec3(-3.0, -2.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0), floor);
    // The middle of its top is 1 m below the lamp, wherever it is turned.
    let die = Shape::block(Vec3::NEG_Y * 0.125, Vec3::splat(0.25));
    let turned = Quat::from_rotation_z(60_f32.to_radians());
    scene.show_flat("die", &die.placed(turned, vec3(0.0, -1.0, 0.0)), blue);
    let ball = Shape::sphere(0.2, 32).smooth();
    scene.show("near ball", &ball.clone().at(1.2, 0.0, 0.0), chalk);
    scene.show("far ball", &ball.at(0.0, 0.0, -2.2), chalk);
    scene.point_light("led", [1.0, 1.0, 1.0], CANDELA, Vec3::ZERO);
    scene.camera("camera", 40.0, 1.5, Place::looking(vec3(0.9, 0.6, 5.6), vec3(0.3, -0.75, -0.6)));
    scene
}
