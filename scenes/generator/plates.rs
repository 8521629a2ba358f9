//! Five rough mirrors that tilt so as to show the eye five balls of light, after Veach 1997, figure 9.2.

use glam::{Vec3, vec3};

use super::{
    document::{Document, Place},
    material::Material,
    shape::Shape,
};

const EYE: Vec3 = vec3(0.0, 3.4, 15.0);
/// Power of each ball, lm.
const POWER: f64 = 20.0;

/// GGX alpha of each plate, with where its middle is (y, z).
const PLATES: [(f64, [f32; 2]); 5] =
    [(0.003, [-1.55, -1.4]), (0.008, [-2.25, -0.1]), (0.02, [-2.85, 1.2]), (0.045, [-3.35, 2.5]), (0.1, [-3.75, 3.8])];

/// Radius and x of each ball, and its tint.
const BALLS: [(f32, f32, [f64; 3]); 5] = [
    (0.03, -4.1, [1.0, 0.55, 0.40]),
    (0.075, -2.6, [1.0, 0.82, 0.45]),
    (0.19, -1.0, [0.62, 1.0, 0.62]),
    (0.42, 0.85, [0.50, 0.80, 1.0]),
    (0.95, 3.35, [0.78, 0.68, 1.0]),
];

/// Plates whose roughness grows towards the eye, balls of one power and very different size above them.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let stone = scene.material(Material::lambert("stone", [0.50, 0.50, 0.52]));
    scene.show_flat("floor", &Shape::quad(vec3(-20.0, -4.6, 20.0), Vec3::X * 40.0, Vec3::NEG_Z * 23.5), stone);
    scene.show_flat("back wall", &Shape::quad(vec3(-20.0, -4.6, -3.5), Vec3::X * 40.0, Vec3::Y * 20.0), stone);

    let balls = vec3(0.0, 1.25, -1.0);
    for (alpha, [y, z]) in PLATES {
        let name = format!("plate, alpha {alpha}");
        let metal = scene.material(Material::metal(&name, [1.0; 3], rounded(alpha.sqrt())));
        let middle = vec3(0.0, y, z);
        let n = ((EYE - middle).normalize() + (balls - middle).normalize()).normalize();
        let plate = Shape::block(Vec3::Y * -0.02, vec3(8.8, 0.04, 1.15));
        scene.show_flat(&name, &plate.placed(glam::Quat::from_rotation_arc(Vec3::Y, n), middle), metal);
    }
    for (radius, x, tint) in BALLS {
        let name = format!("ball of {radius} m");
        let ball = Shape::blob(3, |_| radius);
        let light = scene.material(Material::emitter(&name, tint, rounded(POWER / std::f64::consts::PI / ball.area())));
        scene.show_flat(&name, &ball.at(x, balls.y, balls.z), light);
    }
    scene.camera("camera", 36.0, 1.0, Place::looking(EYE, vec3(0.0, -1.35, 0.0)));
    scene
}

/// To five significant digits.
fn rounded(x: f64) -> f64 {
    let unit = 10f64.powi(x.log10().floor() as i32 - 4);
    (x / unit).round() * unit
}
