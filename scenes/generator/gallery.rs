//! Spheres of every kind of material on four steps, under soft lights.

use glam::Vec3;

use super::{
    document::{Attributes, Document, MaterialId, Place},
    images,
    material::{Color, Material},
    shape::Shape,
};

const RADIUS: f32 = 0.5;
const PITCH: f32 = 1.25;
const RISE: f32 = 0.42;
const GOLD: Color = [1.0, 0.71, 0.29];
const COPPER: Color = [0.955, 0.638, 0.538];
const SILVER: Color = [0.972, 0.96, 0.915];
const SWEEP: [f64; 7] = [0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0];

fn rows(scene: &mut Document) -> [Vec<(String, MaterialId)>; 4] {
    let named = |scene: &mut Document, list: Vec<(String, Material)>| {
        list.into_iter().map(|(name, material)| (name, scene.material(material))).collect::<Vec<_>>()
    };
    let sweep = |kind: &str, make: &dyn Fn(&str, f64) -> Material| -> Vec<(String, Material)> {
        SWEEP
            .map(|roughness| format!("{kind} {roughness}"))
            .iter()
            .zip(SWEEP)
            .map(|(name, r)| (name.clone(), make(name, r)))
            .collect()
    };
    let metals = sweep("gold", &|name, r| Material::metal(name, GOLD, r));
    let plastics = sweep("plastic", &|name, r| Material::dielectric(name, [0.55, 0.035, 0.03], r));

    let squares = scene.texture("checker", &images::checker([0.09, 0.22, 0.36], [0.90, 0.88, 0.80]));
    let dimples = scene.texture("dimple", &images::dimple());
    let mixed = [
        ("white", Material::lambert("white", [0.8, 0.8, 0.8])),
        ("terracotta", Material::lambert("terracotta", [0.52, 0.19, 0.095])),
        ("checker", Material::dielectric("checker", [1.0; 3], 0.35).textured(squares, [8.0, 4.0])),
        ("golf ball", Material::dielectric("golf ball", [0.78, 0.79, 0.76], 0.3).bumpy(dimples, [22.0, 11.0])),
        ("hammered copper", Material::metal("hammered copper", COPPER, 0.18).bumpy(dimples, [16.0, 8.0])),
        ("silver", Material::metal("silver", SILVER, 0.0)),
        ("copper", Material::metal("copper", COPPER, 0.25)),
    ];
    let clear = |name: &str, roughness: f64| Material::glass(name, 1.5, roughness, 1.0);
    let glasses = [
        ("glass", clear("glass", 0.0)),
        ("frosted glass", clear("frosted glass", 0.22)),
        ("rough glass", clear("rough glass", 0.5)),
        ("bubble", Material::glass("bubble", 1.33, 0.0, 0.0)),
        ("amber", clear("amber", 0.0).absorbing([0.95, 0.42, 0.06], 0.5)),
        ("emerald", clear("emerald", 0.0).absorbing([0.10, 0.62, 0.28], 0.5)),
        ("sapphire", clear("sapphire", 0.0).absorbing([0.12, 0.30, 0.85], 0.5)),
    ];
    let owned =
        |list: [(&str, Material); 7]| list.into_iter().map(|(name, m)| (name.to_owned(), m)).collect::<Vec<_>>();
    let (mixed, glasses) = (owned(mixed), owned(glasses));
    [named(scene, metals), named(scene, plastics), named(scene, mixed), named(scene, glasses)]
}

/// From the back: metals, plastics, a mixed row, glasses.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let rows = rows(&mut scene);
    let sphere = Shape::sphere(RADIUS, 48);
    let bumpy = scene.shape(&sphere, Attributes::Bumpy);
    let (textured, smooth) = (bumpy.only(Attributes::Textured), bumpy.only(Attributes::Plain));
    for (i, row) in rows.iter().enumerate() {
        let depth = (i as f32 - 1.5) * PITCH;
        for (j, (name, material)) in row.iter().enumerate() {
            let shape = match name.as_str() {
                "checker" => &textured,
                "golf ball" | "hammered copper" => &bumpy,
                _ => &smooth,
            };
            let mesh = scene.mesh(name, &[(shape, *material)]);
            let height = RADIUS + RISE * (3 - i) as f32;
            scene.place(name, mesh, Place::at((j as f32 - 3.0) * PITCH, height, depth).turned(-20.0));
        }
    }

    let ground = scene.material(Material::dielectric("ground", [0.42, 0.43, 0.44], 0.6));
    let step = scene.material(Material::dielectric("step", [0.33, 0.34, 0.36], 0.45));
    for i in 0..3 {
        let front = (i as f32 - 1.0) * PITCH;
        let (low, high) = (Vec3::new(-4.7, 0.0, front - PITCH), Vec3::new(4.7, RISE * (3 - i) as f32, front));
        scene.show(&format!("step {i}"), &Shape::cuboid(low, high), step);
    }
    // Floor and backdrop are one sheet, bent with a radius of 3 m.
    let mut sweep = vec![[9.0f32, 0.0f32]];
    sweep.extend((0..=16).map(|k| {
        let (sin, cos) = (f32::to_radians(90.0) * k as f32 / 16.0).sin_cos();
        [-5.0 - 3.0 * sin, 3.0 - 3.0 * cos]
    }));
    sweep.push([-8.0, 11.0]);
    let mut sheet = Shape::default();
    let mut row = 0;
    for (k, &[z, y]) in sweep.iter().enumerate() {
        for x in [-22.0, 22.0] {
            sheet.positions.push(Vec3::new(x, y, z));
        }
        if k > 0 {
            sheet.triangles.extend([[row - 2, row - 1, row + 1], [row - 2, row + 1, row]]);
        }
        row += 2;
    }
    scene.show("backdrop", &sheet.smooth(), ground);

    let key = scene.material(Material::emitter("key light", [1.0, 0.93, 0.84], 15.0));
    let fill = scene.material(Material::emitter("fill light", [0.72, 0.86, 1.0], 8.0));
    let strip = scene.material(Material::emitter("strip light", [1.0, 0.97, 0.93], 18.0));
    scene.show("key light", &facing(Vec3::new(-5.5, 8.5, 4.0), Vec3::ZERO, 5.0, 3.6), key);
    scene.show("fill light", &facing(Vec3::new(9.5, 4.5, 3.5), Vec3::new(0.0, 0.5, 0.0), 4.0, 4.0), fill);
    scene.show("strip light", &facing(Vec3::new(1.5, 8.0, -3.5), Vec3::new(0.0, 0.5, 0.0), 9.0, 0.7), strip);
    scene.camera("camera", 23.5, 16.0 / 10.0, Place::looking(Vec3::new(0.0, 5.6, 14.6), Vec3::new(0.0, 0.82, 0.0)));
    scene
}

/// A rectangle about `center` that faces `target`.
pub fn facing(center: Vec3, target: Vec3, width: f32, height: f32) -> Shape {
    let place = Place::looking(target, center);
    // A camera at the target that looks here sees the sheet's front.
    let (right, up) = (place.rotation * Vec3::X * width, place.rotation * Vec3::Y * height);
    Shape::quad(center - right / 2.0 - up / 2.0, right, up)
}
