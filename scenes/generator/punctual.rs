//! Point, spot and directional lights over a stage of blocks and spheres.

use glam::{Quat, Vec3, vec3};

use super::{
    document::{Attributes, Document, Place},
    material::Material,
    shape::Shape,
};

/// One warm point light, two spot lights (soft and sharp), moonlight.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let floor = scene.material(Material::dielectric("floor", [0.52, 0.52, 0.52], 0.55));
    let wall = scene.material(Material::lambert("wall", [0.55, 0.54, 0.52]));
    let chalk = scene.material(Material::lambert("chalk", [0.75, 0.74, 0.71]));
    let slate = scene.material(Material::dielectric("slate", [0.12, 0.14, 0.17], 0.35));
    let coral = scene.material(Material::dielectric("coral", [0.70, 0.17, 0.10], 0.25));
    let steel = scene.material(Material::metal("steel", [0.56, 0.57, 0.58], 0.3));
    let gold = scene.material(Material::metal("gold", [1.0, 0.71, 0.29], 0.2));

    scene.show("floor", &Shape::quad(vec3(-9.0, 0.0, 7.0), Vec3::X * 18.0, Vec3::NEG_Z * 11.0), floor);
    scene.show("wall", &Shape::quad(vec3(-9.0, 0.0, -4.0), Vec3::X * 18.0, Vec3::Y * 7.0), wall);
    let turned = |degrees: f32, x: f32, z: f32, shape: Shape| {
        shape.placed(Quat::from_rotation_y(degrees.to_radians()), vec3(x, 0.0, z))
    };
    let block = |size: Vec3| Shape::block(Vec3::Y * size.y / 2.0, size);
    scene.show("tower", &turned(24.0, -2.9, -1.7, block(vec3(0.9, 2.6, 0.9))), chalk);
    scene.show("slab", &turned(-14.0, 2.9, -1.5, block(vec3(1.7, 0.5, 1.3))), slate);
    scene.show("step", &turned(9.0, -0.1, -2.2, block(vec3(1.5, 0.9, 1.0))), chalk);
    scene.show("small block", &turned(38.0, -1.75, 1.25, block(Vec3::splat(0.55))), slate);
    scene.show("column", &Shape::cylinder(0.32, 1.9, 48).at(1.25, 0.0, -2.4), chalk);
    scene.show("cone", &Shape::frustum(0.5, 0.0, 1.15, 48).at(4.0, 0.0, 0.45), coral);
    scene.show(
        "hoop",
        &Shape::torus(0.42, 0.1, 56, 20).placed(Quat::from_rotation_x(1.35), vec3(-0.1, 1.42, -2.2)),
        gold,
    );
    let ball = scene.shape(&Shape::sphere(1.0, 40), Attributes::Plain);
    let balls = [
        ("chalk ball", chalk, 0.7, [-0.55, 0.0, 0.35]),
        ("steel ball", steel, 0.55, [2.85, 0.5, -1.5]),
        ("coral ball", coral, 0.42, [1.35, 0.0, 1.2]),
        ("gold ball", gold, 0.3, [-3.6, 0.0, 0.7]),
    ];
    for (name, material, radius, [x, y, z]) in balls {
        let mesh = scene.mesh(name, &[(&ball, material)]);
        scene.place(name, mesh, Place { scale: Vec3::splat(radius), ..Place::at(x, y + radius, z) });
    }

    scene.point_light("lamp", [1.0, 0.62, 0.30], 13.0, vec3(-1.55, 1.25, -0.75));
    let soft = Place::looking(vec3(3.4, 5.2, 3.2), vec3(1.6, 0.4, -0.9));
    scene.spot_light("soft spot", [1.0, 0.93, 0.82], 230.0, [9.0, 24.0], soft);
    let sharp = Place::looking(vec3(-5.2, 4.6, 2.4), vec3(-0.7, 0.6, 0.0));
    scene.spot_light("sharp spot", [0.62, 0.82, 1.0], 260.0, [12.0, 12.8], sharp);
    scene.directional_light("moon", [0.55, 0.70, 1.0], 0.9, Place::looking(vec3(4.0, 6.0, 5.0), Vec3::ZERO));
    scene.camera("camera", 34.0, 16.0 / 9.0, Place::looking(vec3(0.4, 2.9, 9.2), vec3(0.15, 0.95, -0.6)));
    scene
}
