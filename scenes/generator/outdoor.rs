//! Things of chalk and of polished metal on a ground, for a sky from a file.

use glam::{Quat, Vec3, vec3};

use super::{
    document::{Attributes, Document, MaterialId, Place},
    material::{Color, Material},
    shape::Shape,
};

/// Diffuse and glossy things; all light is that of `sky.hdr`.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let ground = scene.material(Material::lambert("ground", [0.47, 0.41, 0.32]));
    scene.show_flat("ground", &Shape::quad(vec3(-200.0, 0.0, 200.0), Vec3::X * 400.0, Vec3::NEG_Z * 400.0), ground);
    let mut lambert = |name: &str, color: Color| scene.material(Material::lambert(name, color));
    let [chalk, terracotta, ochre, teal] = [
        lambert("chalk", [0.75, 0.74, 0.71]),
        lambert("terracotta", [0.58, 0.22, 0.12]),
        lambert("ochre", [0.66, 0.46, 0.14]),
        lambert("teal", [0.09, 0.34, 0.36]),
    ];
    // GGX alpha is the square.
    let mut metal =
        |name: &str, alpha: f64| scene.material(Material::metal(name, [1.0; 3], (1e4 * alpha.sqrt()).round() / 1e4));
    let [polished, brushed, matt] = [metal("polished", 0.03), metal("brushed", 0.06), metal("matt", 0.1)];

    let ball = scene.shape(&Shape::blob(5, |_| 1.0), Attributes::Flat);
    let balls: [(&str, MaterialId, f32, [f32; 2]); 7] = [
        ("large ball", polished, 1.0, [0.15, -0.3]),
        ("chalk ball", chalk, 0.55, [-1.75, 0.75]),
        ("matt ball", matt, 0.42, [1.75, 1.1]),
        ("teal ball", teal, 0.3, [0.75, 1.75]),
        ("brushed ball", brushed, 0.24, [-0.55, 1.75]),
        ("ochre ball", ochre, 0.18, [0.12, 2.35]),
        ("small ball", polished, 0.14, [-1.25, 2.2]),
    ];
    for (name, material, radius, [x, z]) in balls {
        let mesh = scene.mesh(name, &[(&ball, material)]);
        scene.place(name, mesh, Place { scale: Vec3::splat(radius), ..Place::at(x, radius, z) });
    }
    let turned = |shape: Shape, degrees: f32, at: Vec3| shape.placed(Quat::from_rotation_y(degrees.to_radians()), at);
    let block = |size: Vec3| Shape::block(Vec3::Y * size.y / 2.0, size);
    scene.show_flat("tower", &turned(block(vec3(0.9, 2.6, 0.9)), 24.0, vec3(-2.1, 0.0, -1.4)), terracotta);
    scene.show_flat("slab", &turned(block(vec3(1.5, 1.1, 0.5)), -28.0, vec3(2.25, 0.0, -0.7)), brushed);
    scene.show_flat("column", &Shape::cylinder(0.3, 1.9, 96).at(1.5, 0.0, -2.2), chalk);
    scene.show_flat("cone", &Shape::frustum(0.42, 0.0, 1.0, 96).at(-0.95, 0.0, -2.0), ochre);
    let hoop = Shape::torus(0.42, 0.11, 96, 40).placed(Quat::from_rotation_x(1.35), vec3(2.28, 1.62, -0.72));
    scene.show_flat("hoop", &hoop, matt);
    scene.camera("camera", 36.0, 1.0, Place::looking(vec3(0.7, 2.6, 8.6), vec3(0.25, 0.9, 0.0)));
    scene
}
