//! A ball of glass that gathers the light of a lamp on the floor.

use glam::{Vec3, vec3};

use super::{
    document::{Document, Place},
    material::Material,
    shape::Shape,
};

/// Height of the box, and half its width and depth.
const HEIGHT: f32 = 1.0;
const HALF: f32 = 0.5;
const RADIUS: f32 = 0.2;

/// A box of a metre with a lamp let into its ceiling, and in it a glass ball on three pegs, so high that the floor is in its focus.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let white = scene.material(Material::lambert("white", [0.73, 0.73, 0.73]));
    let red = scene.material(Material::lambert("red", [0.63, 0.065, 0.05]));
    let green = scene.material(Material::lambert("green", [0.14, 0.45, 0.091]));
    let slate = scene.material(Material::lambert("slate", [0.16, 0.17, 0.20]));
    let glass = scene.material(Material::glass("glass", 1.5, 0.0, 2.0 * f64::from(RADIUS)));
    let glow = scene.material(Material::emitter("light", [1.0, 0.87, 0.63], 17.0));

    let (x, y, z) = (Vec3::X * 2.0 * HALF, Vec3::Y * HEIGHT, Vec3::Z * 2.0 * HALF);
    let low = vec3(-HALF, 0.0, -HALF);
    scene.show_flat("floor", &Shape::quad(low + z, x, -z), white);
    scene.show_flat("back wall", &Shape::quad(low, x, y), white);
    scene.show_flat("left wall", &Shape::quad(low + z, -z, y), red);
    scene.show_flat("right wall", &Shape::quad(low + x, z, y), green);
    let lamp = Shape::quad(vec3(-0.12, HEIGHT, -0.1), Vec3::X * 0.24, Vec3::Z * 0.2);
    scene.show_flat("ceiling", &Shape::frame(&Shape::quad(low + y, x, z), &lamp), white);
    scene.show_flat("light", &lamp, glow);

    let middle = vec3(0.07, 0.31, 0.08);
    scene.show_flat("ball", &Shape::blob(6, |_| RADIUS).at(middle.x, middle.y, middle.z), glass);
    // They end a hair below the ball.
    let (out, thick) = (0.13, 0.009);
    let tall = middle.y - (RADIUS * RADIUS - (out - thick) * (out - thick)).sqrt() - 0.0005;
    let pegs = [30f32, 150.0, 270.0].map(|degrees| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Shape::cylinder(thick, tall, 24).at(middle.x + out * cos, 0.0, middle.z + out * sin)
    });
    scene.show_flat("pegs", &Shape::joined(pegs), slate);
    scene.camera("camera", 39.6, 1.0, Place::at(0.0, HEIGHT / 2.0, HALF + 1.38));
    scene
}
