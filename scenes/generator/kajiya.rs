//! Grey things and green glass balls on a reddish base, after the sample image of the rendering equation.

use glam::{Quat, Vec3, vec3};

use super::{
    document::{Document, Place},
    material::Material,
    shape::Shape,
};

/// After Kajiya 1986, "The Rendering Equation", figure 6: all is a neutral grey but for the balls of green glass and the base, which
/// is slightly reddish; a lamp of small extent, so that the balls gather its light on the base.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let grey = scene.material(Material::lambert("grey", [0.6, 0.6, 0.6]));
    let base = scene.material(Material::lambert("base", [0.7, 0.42, 0.36]));
    let green = [0.25, 0.9, 0.35];
    let glass = scene.material(Material::glass("green glass", 1.5, 0.0, 0.5).absorbing(green, 0.4));
    let glow = scene.material(Material::emitter("light", [1.0, 1.0, 1.0], 200.0));

    scene.show_flat("base", &Shape::quad(vec3(-2.5, 0.0, 2.5), Vec3::X * 5.0, Vec3::NEG_Z * 5.0), base);
    let wall = Shape::block(vec3(0.0, 0.7, -1.7), vec3(2.6, 1.4, 0.2));
    scene.show_flat("wall", &wall, grey);
    let turned = |degrees: f32, x: f32, y: f32, z: f32, shape: Shape| {
        shape.placed(Quat::from_rotation_y(degrees.to_radians()), vec3(x, y, z))
    };
    scene.show_flat("block", &turned(25.0, -1.3, 0.35, -0.7, Shape::block(Vec3::ZERO, vec3(0.5, 0.7, 0.5))), grey);
    scene.show_flat("column", &Shape::cylinder(0.22, 1.0, 64).at(1.25, 0.0, -0.9), grey);
    scene.show("ball", &Shape::sphere(0.3, 48).smooth().at(0.15, 0.3, -0.9), grey);
    let ring = Shape::torus(0.34, 0.1, 64, 24).placed(Quat::IDENTITY, vec3(1.2, 0.1, 0.55));
    scene.show("ring", &ring.smooth(), grey);
    for (name, radius, x, z) in
        [("left glass", 0.32, -0.75, 0.5), ("middle glass", 0.26, 0.2, 0.75), ("small glass", 0.16, -0.2, 1.35)]
    {
        // A hair above the base.
        scene.show_flat(name, &Shape::blob(5, |_| radius).at(x, radius + 0.001, z), glass);
    }
    scene.show_flat("light", &Shape::quad(vec3(-0.95, 3.2, -0.15), Vec3::X * 0.3, Vec3::Z * 0.3), glow);
    scene.camera("camera", 27.0, 4.0 / 3.0, Place::looking(vec3(0.2, 2.1, 5.4), vec3(0.05, 0.45, 0.0)));
    scene
}
