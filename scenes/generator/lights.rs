//! Two thousand little lamps in a room.

use glam::{Mat3, Quat, Vec3, vec3};

use super::{
    document::{Document, Place},
    material::Material,
    noise::Draws,
    shape::Shape,
};

const X: f32 = 2.6;
const Z: f32 = 2.6;
const HEIGHT: f32 = 2.8;
const LAMPS: usize = 2000;
/// Lamps of one radiance and tint share a mesh and a material.
const KINDS: usize = 20;
const STRINGS: usize = 17;

/// A lamp: a box, dark but for the square at its top (+Y); half a side long, and as deep.
fn lamp(half: f32, rotation: Quat, at: Vec3) -> (Shape, Shape) {
    let corner = |x: f32, y: f32, z: f32| at + rotation * (half * vec3(x, y, z));
    let [a, b, c, d] = [corner(-1.0, 0.0, 1.0), corner(1.0, 0.0, 1.0), corner(1.0, 0.0, -1.0), corner(-1.0, 0.0, -1.0)];
    let [e, f, g, h] =
        [corner(-1.0, -1.0, 1.0), corner(1.0, -1.0, 1.0), corner(1.0, -1.0, -1.0), corner(-1.0, -1.0, -1.0)];
    let face = Shape { positions: vec![a, b, c, d], triangles: vec![[0, 1, 2], [0, 2, 3]], ..Shape::default() };
    let quads = [[4u32, 5, 1, 0], [5, 6, 2, 1], [6, 7, 3, 2], [7, 4, 0, 3], [7, 6, 5, 4]];
    let triangles = quads.iter().flat_map(|&[i, j, k, l]| [[i, j, k], [i, k, l]]).collect();
    (face, Shape { positions: vec![a, b, c, d, e, f, g, h], triangles, ..Shape::default() })
}

/// Where a lamp is and which way it shines, so that its back is at a wall or it hangs on a string.
fn spot(draws: &mut Draws, i: usize) -> (Vec3, Vec3) {
    let mut within = |half: f32| draws.between(-half, half);
    match i % 10 {
        // Strings from wall to wall, lamps turned at random.
        0..=5 => {
            let line = (i / 10) % STRINGS;
            let t = within(0.97);
            let (from, to) = (vec3(-X, 2.45, -2.2 + 0.25 * line as f32), vec3(X, 2.6, -2.35 + 0.26 * line as f32));
            let hang = 0.12 + 0.05 * ((line * 7) % 5) as f32;
            let at = from.lerp(to, 0.5 + 0.5 * t) - Vec3::Y * (hang * (1.0 - t * t) + 0.05 + within(0.05));
            let d = vec3(within(1.0), within(1.0) - 0.35, within(1.0));
            (at, d.normalize())
        }
        // Above and beside what stands at the walls.
        6 => (vec3(within(1.8) - 0.7, 1.85 + within(0.85), -Z + 0.05), Vec3::Z),
        7 => (vec3(-X + 0.05, 1.85 + within(0.85), within(Z - 0.1)), Vec3::X),
        8 => (vec3(X - 0.05, 1.5 + within(1.2), 0.2 + within(2.2)), Vec3::NEG_X),
        _ => (vec3(within(X - 0.1), HEIGHT - 0.05, within(Z - 0.1)), Vec3::NEG_Y),
    }
}

/// A room with chairs, a table, a bed and shelves, and lamps of many powers everywhere.
pub fn scene() -> Document {
    let mut scene = Document::default();
    room(&mut scene);
    furniture(&mut scene);
    let dark = scene.material(Material::lambert("casing", [0.45, 0.45, 0.45]));
    let mut draws = Draws::new(19);
    let mut faces = vec![Shape::default(); KINDS];
    let mut casings = Shape::default();
    let mut placed = Vec::new();
    for i in 0..LAMPS {
        // Few are large.
        let half = 0.006 * 3.2f32.powf(draws.between(0.0, 1.0).powi(2));
        // None shines into another.
        let (at, towards) = loop {
            let (at, towards) = spot(&mut draws, i);
            if placed.iter().all(|&(other, size): &(Vec3, f32)| at.distance(other) > 2.0 * (half + size)) {
                break (at, towards);
            }
        };
        placed.push((at, half));
        let lean = Quat::from_rotation_arc(Vec3::Y, towards) * Quat::from_rotation_y(draws.between(0.0, 1.5));
        let (face, casing) = lamp(half, lean, at);
        faces[(draws.between(0.0, 1.0) * KINDS as f32) as usize].append(&face);
        casings.append(&casing);
    }
    scene.show_flat("casings", &casings, dark);
    let tints = [[1.0, 0.72, 0.42], [1.0, 0.85, 0.65], [0.70, 0.85, 1.0], [1.0, 0.40, 0.30], [0.45, 1.0, 0.60]];
    for (kind, face) in faces.iter().enumerate() {
        let name = format!("lamps {kind}");
        // From the dimmest to the brightest a hundredfold.
        let nit = (1.0 * 100f64.powf(kind as f64 / (KINDS - 1) as f64) * 100.0).round() / 100.0;
        let glow = scene.material(Material::emitter(&name, tints[kind % tints.len()], nit));
        scene.show_flat(&name, face, glow);
    }
    scene.camera("camera", 62.0, 1.0, Place::looking(vec3(0.35, 1.55, 2.5), vec3(-0.05, 1.15, -1.0)));
    scene
}

fn room(scene: &mut Document) {
    let plaster = scene.material(Material::lambert("plaster", [0.76, 0.74, 0.71]));
    let blue = scene.material(Material::lambert("blue wall", [0.22, 0.33, 0.45]));
    let boards = scene.material(Material::lambert("floor", [0.44, 0.31, 0.20]));
    let (low, x, y, z) = (vec3(-X, 0.0, -Z), Vec3::X * 2.0 * X, Vec3::Y * HEIGHT, Vec3::Z * 2.0 * Z);
    scene.show_flat("floor", &Shape::quad(low + z, x, -z), boards);
    scene.show_flat("ceiling", &Shape::quad(low + y, x, z), plaster);
    scene.show_flat("back wall", &Shape::quad(low, x, y), blue);
    let rest = [(low + z, -z, y), (low + x, z, y), (low + x + z, -x, y)].map(|(at, u, v)| Shape::quad(at, u, v));
    scene.show_flat("walls", &Shape::joined(rest), plaster);
}

fn furniture(scene: &mut Document) {
    let wood = scene.material(Material::lambert("wood", [0.40, 0.24, 0.12]));
    let cloth = scene.material(Material::lambert("cloth", [0.55, 0.16, 0.12]));
    let linen = scene.material(Material::lambert("linen", [0.74, 0.72, 0.67]));
    let green = scene.material(Material::lambert("green", [0.16, 0.34, 0.20]));
    let between = |low: [f32; 3], high: [f32; 3]| Shape::cuboid(low.into(), high.into());
    let legs = |half: [f32; 2], tall: f32, thick: f32| {
        let corners = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
        Shape::joined(corners.map(|(x, z)| {
            Shape::block(vec3(x * (half[0] - thick), tall / 2.0, z * (half[1] - thick)), vec3(thick, tall, thick))
        }))
    };
    let table = between([-0.8, 0.70, -0.45], [0.8, 0.74, 0.45]).with(legs([0.8, 0.45], 0.71, 0.05));
    let chair = between([-0.21, 0.42, -0.21], [0.21, 0.46, 0.21])
        .with(legs([0.23, 0.23], 0.43, 0.035))
        .with(between([-0.21, 0.44, -0.21], [0.21, 0.92, -0.175]));
    let turned = |shape: &Shape, degrees: f32, x: f32, z: f32| {
        shape.clone().placed(Quat::from_mat3(&Mat3::from_rotation_y(degrees.to_radians())), vec3(x, 0.0, z))
    };
    scene.show_flat("table", &turned(&table, 8.0, 0.15, -0.35), wood);
    let chairs =
        [turned(&chair, 10.0, -0.2, -1.05), turned(&chair, 195.0, 0.45, 0.4), turned(&chair, 100.0, -1.0, -0.1)];
    scene.show_flat("chairs", &Shape::joined(chairs), wood);
    let sofa = between([-2.55, 0.0, -2.1], [-1.75, 0.42, -0.3])
        .with(between([-2.55, 0.40, -2.1], [-2.3, 0.85, -0.3]))
        .with(between([-2.5, 0.0, -2.3], [-1.75, 0.6, -2.1]))
        .with(between([-2.5, 0.0, -0.3], [-1.75, 0.6, -0.1]));
    scene.show_flat("sofa", &sofa, cloth);
    let mut shelf = between([1.2, 0.0, -2.58], [1.24, 2.0, -2.25]).with(between([2.4, 0.0, -2.58], [2.44, 2.0, -2.25]));
    for k in 0..5 {
        let y = 0.08 + 0.45 * k as f32;
        shelf.append(&between([1.23, y, -2.57], [2.41, y + 0.03, -2.26]));
    }
    scene.show_flat("shelf", &shelf, wood);
    let mut draws = Draws::new(23);
    let mut books = [Shape::default(), Shape::default(), Shape::default()];
    for k in 0..4 {
        let (mut x, y) = (1.27, 0.1101 + 0.45 * k as f32);
        while x < 2.2 {
            let (wide, tall) = (draws.between(0.025, 0.06), draws.between(0.2, 0.34));
            let book = between([x, y, -2.52], [x + wide, y + tall, -2.33]);
            books[(draws.between(0.0, 3.0)) as usize].append(&book);
            x += wide + if draws.chance(0.12) { 0.2 } else { 0.004 };
        }
    }
    for (name, shape, material) in [("red books", 0, cloth), ("white books", 1, linen), ("green books", 2, green)] {
        scene.show_flat(name, &books[shape], material);
    }
    let pot = Shape::frustum(0.14, 0.19, 0.34, 40).at(2.05, 0.0, 0.5);
    scene.show_flat("pot", &pot, linen);
    let lump = |d: Vec3| 0.33 + 0.06 * (7.0 * d.x).sin() * (6.0 * d.y + 1.0).cos() + 0.05 * (9.0 * d.z).sin();
    scene.show_flat("bush", &Shape::blob(4, lump).at(2.05, 0.58, 0.5), green);
    let bowl = [[0.0, 0.0], [0.07, 0.0], [0.16, 0.09], [0.15, 0.09], [0.065, 0.012], [0.0, 0.012]];
    scene.show_flat("bowl", &Shape::lathe(&bowl, 40).at(0.3, 0.7401, -0.3), linen);
    scene.show_flat("ball", &Shape::blob(3, |_| 0.07).at(-0.25, 0.811, -0.25), cloth);
    scene.show_flat("rug", &between([-1.3, 0.0005, -1.2], [1.3, 0.012, 0.7]), green);
}
