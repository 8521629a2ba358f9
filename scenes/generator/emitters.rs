//! Surfaces that shine: large and tiny, textured, seen from both sides.

use glam::{Quat, Vec3, vec3};

use super::{
    document::{Attributes, Document, Place},
    gallery::facing,
    images,
    material::Material,
    shape::Shape,
};

/// A dim room with a screen, stained glass, neon rings, a panel shining both ways, and a string of bulbs.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let floor = scene.material(Material::dielectric("floor", [0.22, 0.22, 0.235], 0.28));
    let wall = scene.material(Material::lambert("wall", [0.58, 0.56, 0.54]));
    let chalk = scene.material(Material::lambert("chalk", [0.76, 0.75, 0.73]));
    let dark = scene.material(Material::dielectric("dark", [0.03, 0.03, 0.035], 0.4));
    let steel = scene.material(Material::metal("steel", [0.62, 0.62, 0.63], 0.16));
    let lacquer = scene.material(Material::dielectric("lacquer", [0.10, 0.12, 0.42], 0.06));
    scene.show("floor", &Shape::quad(vec3(-5.0, 0.0, 6.0), Vec3::X * 10.0, Vec3::NEG_Z * 9.0), floor);
    scene.show("back wall", &Shape::quad(vec3(-5.0, 0.0, -3.0), Vec3::X * 10.0, Vec3::Y * 6.5), wall);
    scene.show("left wall", &Shape::quad(vec3(-5.0, 0.0, 6.0), Vec3::NEG_Z * 9.0, Vec3::Y * 6.5), wall);
    scene.show("right wall", &Shape::quad(vec3(5.0, 0.0, -3.0), Vec3::Z * 9.0, Vec3::Y * 6.5), wall);

    let bars = scene.clamped_texture("bars", &images::bars());
    let screen = scene.material(Material::emitter("screen", [1.0; 3], 2.2).emission_textured(bars));
    let (low, size) = (vec3(-1.35, 1.45, -2.9), vec3(2.8, 1.6, 0.0));
    scene.show_with("screen", &Shape::quad(low, Vec3::X * size.x, Vec3::Y * size.y), Attributes::Textured, screen);
    let case = Shape::cuboid(low - vec3(0.05, 0.05, 0.08), low + size + vec3(0.05, 0.05, -0.01));
    scene.show("screen case", &case, dark);

    let stained = scene.clamped_texture("stained glass", &images::stained());
    let stained =
        scene.material(Material::emitter("stained glass", [1.0; 3], 1.9).emission_textured(stained).double_sided());
    let lean = Quat::from_rotation_y(38f32.to_radians());
    let sheet = Shape::quad(vec3(-0.75, 0.06, 0.0), Vec3::X * 1.5, Vec3::Y * 2.25);
    scene.show_with("stained glass", &sheet.placed(lean, vec3(-3.35, 0.0, -1.3)), Attributes::Textured, stained);
    let foot = Shape::block(vec3(0.0, 0.03, 0.0), vec3(1.6, 0.06, 0.3)).placed(lean, vec3(-3.35, 0.0, -1.3));
    scene.show("stained glass foot", &foot, dark);

    let blade = scene.material(Material::emitter("blade", [1.0, 0.72, 0.42], 5.0).double_sided());
    let turn = Quat::from_rotation_y(72f32.to_radians());
    let panel = Shape::quad(vec3(-0.5, 0.02, 0.0), Vec3::X, Vec3::Y * 1.3).placed(turn, vec3(1.1, 0.0, -0.5));
    scene.show("double-sided blade", &panel, blade);

    let pink = scene.material(Material::emitter("pink neon", [1.0, 0.16, 0.42], 11.0));
    let cyan = scene.material(Material::emitter("cyan neon", [0.12, 0.78, 1.0], 8.0));
    let ring = |radius: f32, x: f32, y: f32| {
        Shape::torus(radius, 0.035, 56, 10).placed(Quat::from_rotation_x(std::f32::consts::FRAC_PI_2), vec3(x, y, -2.9))
    };
    scene.show("large ring", &ring(0.62, 3.25, 2.45), pink);
    scene.show("small ring", &ring(0.36, 3.25, 2.45), cyan);

    // A chain that hangs between two points of the back wall, nearly a parabola.
    let warm = scene.material(Material::emitter("bulb", [1.0, 0.68, 0.34], 480.0));
    let bulb = scene.shape(&Shape::sphere(0.022, 8), Attributes::Plain);
    let bulb = scene.mesh("bulb", &[(&bulb, warm)]);
    for i in 0..17 {
        let t = (i as f32 + 0.5) / 17.0 * 2.0 - 1.0;
        scene.place(&format!("bulb {i}"), bulb, Place::at(4.7 * t, 3.45 + 0.5 * t * t, -2.6 + 0.25 * t * t));
    }
    let spark = scene.material(Material::emitter("spark", [1.0, 0.85, 0.65], 20000.0));
    scene.show("spark", &Shape::sphere(0.004, 6).at(2.4, 0.62, 0.9), spark);
    let stand = Shape::cylinder(0.11, 0.02, 32).with(Shape::cylinder(0.008, 0.6, 12).at(0.0, 0.02, 0.0));
    scene.show("spark stand", &stand.at(2.4, 0.0, 0.9), dark);
    let soft = scene.material(Material::emitter("soft box", [0.82, 0.90, 1.0], 1.6));
    scene.show("soft box", &facing(vec3(0.0, 5.9, 4.5), vec3(0.0, 0.5, -1.0), 5.0, 3.0), soft);

    let ball = scene.shape(&Shape::sphere(1.0, 36), Attributes::Plain);
    let balls = [
        ("chalk ball", chalk, 0.55, [-0.55, -0.6]),
        ("steel ball", steel, 0.45, [-1.85, 0.35]),
        ("lacquer ball", lacquer, 0.34, [0.35, 0.95]),
    ];
    for (name, material, radius, [x, z]) in balls {
        let mesh = scene.mesh(name, &[(&ball, material)]);
        scene.place(name, mesh, Place { scale: Vec3::splat(radius), ..Place::at(x, radius, z) });
    }
    let plinth = Shape::block(vec3(0.0, 0.45, 0.0), vec3(0.7, 0.9, 0.7));
    scene.show("plinth", &plinth.placed(Quat::from_rotation_y(0.5), vec3(3.15, 0.0, -1.3)), chalk);
    scene.show(
        "steel hoop",
        &Shape::torus(0.26, 0.07, 44, 16).placed(Quat::from_rotation_x(1.3), vec3(3.15, 1.23, -1.3)),
        steel,
    );
    scene.camera("camera", 38.0, 16.0 / 9.0, Place::looking(vec3(0.0, 1.95, 8.6), vec3(0.0, 1.55, -1.0)));
    scene
}
