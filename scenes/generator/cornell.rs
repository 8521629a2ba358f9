//! The Cornell box in its measured size, with walls that scatter exactly as Lambert says.

use glam::Vec3;

use super::{
    document::{Document, Place},
    material::Material,
    shape::Shape,
};

const WIDTH: f32 = 0.556;
const HEIGHT: f32 = 0.5488;
const DEPTH: f32 = 0.5592;

/// From the published coordinates (mm, x to the left, z away) to metres about the floor's middle.
fn published(x: f32, y: f32, z: f32) -> Vec3 {
    Vec3::new(WIDTH / 2.0 - x / 1000.0, y / 1000.0, DEPTH / 2.0 - z / 1000.0)
}

/// A block over the four corners of its top, given counter-clockwise from above, without a bottom.
fn block(top: [[f32; 2]; 4], height: f32) -> Shape {
    let at = |i: usize, y: f32| published(top[i % 4][0], y, top[i % 4][1]);
    let lid = Shape::quad(at(0, height), at(1, height) - at(0, height), at(3, height) - at(0, height));
    // The published corners form no exact parallelogram.
    let lid = Shape { positions: (0..4).map(|i| at(i, height)).collect(), ..lid };
    let sides = (0..4).map(|i| Shape::quad(at(i, 0.0), at(i + 1, 0.0) - at(i, 0.0), Vec3::Y * height / 1000.0));
    lid.with(Shape::joined(sides))
}

/// Five walls, two blocks and a light.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let white = scene.material(Material::lambert("white", [0.73, 0.73, 0.73]));
    let red = scene.material(Material::lambert("red", [0.63, 0.065, 0.05]));
    let green = scene.material(Material::lambert("green", [0.14, 0.45, 0.091]));
    let glow = scene.material(Material::emitter("light", [1.0, 0.87, 0.63], 32.0));

    let (x, y, z) = (Vec3::X * WIDTH, Vec3::Y * HEIGHT, Vec3::Z * DEPTH);
    let low = Vec3::new(-WIDTH / 2.0, 0.0, -DEPTH / 2.0);
    scene.show("floor", &Shape::quad(low + z, x, -z), white);
    scene.show("ceiling", &Shape::quad(low + y, x, z), white);
    scene.show("back wall", &Shape::quad(low, x, y), white);
    scene.show("left wall", &Shape::quad(low + z, -z, y), red);
    scene.show("right wall", &Shape::quad(low + x, z, y), green);
    let short = [[130.0, 65.0], [290.0, 114.0], [240.0, 272.0], [82.0, 225.0]];
    let tall = [[423.0, 247.0], [472.0, 406.0], [314.0, 456.0], [265.0, 296.0]];
    // Seen from above, with x to the left and z away, these run clockwise; the other way round faces out.
    let turned = |mut corners: [[f32; 2]; 4]| {
        corners.reverse();
        corners
    };
    scene.show("short block", &block(turned(short), 165.0), white);
    scene.show("tall block", &block(turned(tall), 330.0), white);
    let light = Shape::quad(published(343.0, 547.8, 332.0), Vec3::X * 0.13, Vec3::Z * 0.105);
    scene.show("light", &light, glow);

    let eye = Vec3::new(0.0, HEIGHT / 2.0, DEPTH / 2.0 + 0.75);
    scene.camera("camera", 40.0, 16.0 / 9.0, Place { translation: eye, ..Place::ORIGIN });
    scene
}
