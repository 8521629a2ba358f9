//! A room that gets its light round a door that stands ajar, after Veach 1997, figure 10.

use glam::{Quat, Vec3, vec3};

use super::{
    document::{Document, MaterialId, Place},
    material::Material,
    shape::Shape,
};

/// Half the width and depth of the room, and its height. The floor is at y = 0.
const X: f32 = 2.2;
const Z: f32 = 2.4;
const HEIGHT: f32 = 2.6;
/// The next room lies behind the wall at −z.
const WALL: f32 = 0.16;
const BEHIND: f32 = 3.0;
/// The doorway.
const LEFT: f32 = -1.45;
const RIGHT: f32 = -0.5;
const LINTEL: f32 = 2.05;

/// A room with a table, and a bright one next to it.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let plaster = scene.material(Material::lambert("plaster", [0.72, 0.70, 0.66]));
    let floor = scene.material(Material::lambert("floor", [0.45, 0.40, 0.34]));
    let paint = scene.material(Material::lambert("door", [0.62, 0.58, 0.52]));
    let lamp = scene.material(Material::emitter("lamp", [1.0, 0.93, 0.84], 620.0));

    // Both rooms in one, seen from inside, with the wall between them.
    let (low, high) = (vec3(-X, 0.0, -Z - WALL - BEHIND), vec3(X, HEIGHT, Z));
    let (x, y, z) = (Vec3::X * (high.x - low.x), Vec3::Y * HEIGHT, Vec3::Z * (high.z - low.z));
    scene.show_flat("floor", &Shape::quad(low + z, x, -z), floor);
    let walls = [(low, x, y), (low + z, -z, y), (low + x, z, y), (high - y, -x, y)];
    let walls = Shape::joined(walls.map(|(at, u, v)| Shape::quad(at, u, v)));
    scene.show_flat("walls", &walls, plaster);
    let light = Shape::quad(vec3(0.9, HEIGHT, -Z - WALL - 1.9), Vec3::X * 0.8, Vec3::Z * 0.9);
    scene.show_flat("ceiling", &Shape::frame(&Shape::quad(low + y, x, z), &light), plaster);
    scene.show_flat("lamp", &light, lamp);
    let part = |x: [f32; 2], y: [f32; 2]| Shape::cuboid(vec3(x[0], y[0], -Z - WALL), vec3(x[1], y[1], -Z));
    // They go on into the outer walls, so that no gap is left.
    let out = 0.05;
    let between = [
        part([-X - out, LEFT], [-out, HEIGHT + out]),
        part([RIGHT, X + out], [-out, HEIGHT + out]),
        part([LEFT, RIGHT], [LINTEL, HEIGHT + out]),
    ];
    scene.show_flat("wall between", &Shape::joined(between), plaster);

    // Hinged at the left, and open so far that the lamp, at the right, shines on its back and not past it. It goes a
    // little into the wall and the floor, so that no light comes through slits.
    let width = RIGHT - LEFT - 0.012;
    let leaf = Shape::cuboid(vec3(-0.02, -0.01, -0.04), vec3(width, LINTEL - 0.008, 0.0));
    let knob = |side: f32| {
        Shape::blob(3, |_| 0.032)
            .at(width - 0.08, 1.0, -0.02 + 0.065 * side)
            .with(Shape::block(vec3(width - 0.08, 1.0, -0.02 + 0.035 * side), vec3(0.018, 0.018, 0.05)))
    };
    let turn = Quat::from_rotation_y(-38f32.to_radians());
    let hinge = vec3(LEFT, 0.0, -Z - 0.03);
    scene.show_flat("door", &strip(leaf).placed(turn, hinge), paint);
    let brass = scene.material(Material::lambert("knob", [0.55, 0.42, 0.18]));
    scene.show_flat("knob", &strip(knob(1.0).with(knob(-1.0))).placed(turn, hinge), brass);

    furniture(&mut scene, plaster);
    scene.camera("camera", 46.0, 1.0, Place::looking(vec3(-1.45, 1.5, 2.25), vec3(0.0, 0.95, -1.2)));
    scene
}

/// A table in the middle, with a jug, a bowl, a box and a ball on it.
fn furniture(scene: &mut Document, white: MaterialId) {
    let wood = scene.material(Material::lambert("wood", [0.52, 0.34, 0.19]));
    let (top, half) = (0.74, vec3(0.75, 0.0, 0.42));
    let mut table = Shape::cuboid(vec3(-half.x, top - 0.04, -half.z), vec3(half.x, top, half.z));
    for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        let at = vec3(x * (half.x - 0.06), (top - 0.03) / 2.0, z * (half.z - 0.06));
        table.append(&Shape::block(at, vec3(0.06, top - 0.03, 0.06)));
    }
    let spot = vec3(-0.1, 0.0, -0.75);
    let put = |scene: &mut Document, name: &str, shape: Shape, degrees: f32, at: [f32; 3], material: MaterialId| {
        let turned = strip(shape).placed(Quat::from_rotation_y(degrees.to_radians()), Vec3::from(at));
        scene.show_flat(name, &turned.placed(Quat::from_rotation_y(0.2), spot), material);
    };
    put(scene, "table", table, 0.0, [0.0; 3], wood);
    let blue = scene.material(Material::lambert("blue glaze", [0.20, 0.34, 0.58]));
    let red = scene.material(Material::lambert("red glaze", [0.62, 0.13, 0.09]));
    let green = scene.material(Material::lambert("green", [0.26, 0.48, 0.22]));
    let jug = [
        [0.0, 0.0],
        [0.07, 0.0],
        [0.105, 0.05],
        [0.12, 0.11],
        [0.105, 0.18],
        [0.065, 0.24],
        [0.055, 0.28],
        [0.068, 0.32],
        [0.058, 0.32],
        [0.046, 0.28],
        [0.055, 0.24],
        [0.095, 0.18],
        [0.108, 0.11],
        [0.09, 0.05],
        [0.0, 0.02],
    ];
    let handle = Shape::torus(0.075, 0.013, 32, 10)
        .placed(Quat::from_rotation_x(std::f32::consts::FRAC_PI_2), vec3(0.105, 0.19, 0.0));
    put(scene, "jug", Shape::lathe(&jug, 48).with(handle), 0.0, [-0.4, top, 0.05], blue);
    let bowl = [
        [0.0, 0.0],
        [0.06, 0.0],
        [0.065, 0.015],
        [0.13, 0.05],
        [0.175, 0.11],
        [0.165, 0.11],
        [0.12, 0.058],
        [0.0, 0.025],
    ];
    put(scene, "bowl", Shape::lathe(&bowl, 48), 0.0, [0.12, top, -0.08], white);
    put(scene, "ball", Shape::blob(3, |_| 0.055), 0.0, [0.10, top + 0.084, -0.07], red);
    put(scene, "box", Shape::block(Vec3::Y * 0.07, vec3(0.22, 0.14, 0.16)), 30.0, [0.45, top, 0.12], green);
    put(scene, "book", Shape::block(Vec3::Y * 0.016, vec3(0.2, 0.032, 0.27)), -18.0, [-0.12, top, 0.24], red);
}

/// Positions and normals alone, as spheres and tori then fit together.
fn strip(shape: Shape) -> Shape {
    Shape { uvs: vec![], tangents: vec![], ..shape }
}
