//! A room that gets its light through one window, from the sun and a sheet of sky.

use glam::{Quat, Vec3, vec3};

use super::{
    document::{Attributes, Document, MaterialId, Place},
    images,
    material::Material,
    shape::Shape,
};

/// Half the room's width and depth, and its height; the floor is at y = 0.
const HALF: Vec3 = vec3(2.4, 0.0, 2.2);
const HEIGHT: f32 = 2.7;
const WALL: f32 = 0.3;
/// The opening in the wall at −x: its sill, lintel and sides.
const SILL: f32 = 0.85;
const LINTEL: f32 = 2.25;
const SIDES: [f32; 2] = [-1.15, 0.75];

/// An interior of about five metres with a table, a shelf, a chair and what stands on them.
pub fn scene() -> Document {
    let mut scene = Document::default();
    shell(&mut scene);
    table(&mut scene);
    shelf(&mut scene);
    outside(&mut scene);
    scene.camera("camera", 50.0, 3.0 / 2.0, Place::looking(vec3(1.75, 1.4, 1.95), vec3(-0.72, 0.95, -0.75)));
    scene
}

fn shell(scene: &mut Document) {
    let plaster = scene.material(Material::lambert("plaster", [0.80, 0.78, 0.74]));
    let accent = scene.material(Material::lambert("blue plaster", [0.24, 0.36, 0.42]));
    let boards = scene.texture("boards", &images::boards());
    let boards = scene.material(Material::dielectric("boards", [1.0; 3], 0.38).textured(boards, [1.0, 1.0]));
    let paint = scene.material(Material::dielectric("white paint", [0.82, 0.82, 0.80], 0.35));

    let (low, high) = (-HALF - vec3(WALL, 0.0, WALL), HALF + vec3(WALL, HEIGHT, WALL));
    let floor = Shape::cuboid(vec3(low.x, -WALL, low.z), vec3(high.x, 0.0, high.z));
    scene.show_with("floor", &floor, Attributes::Textured, boards);
    scene.show("ceiling", &Shape::cuboid(vec3(low.x, HEIGHT, low.z), vec3(high.x, HEIGHT + WALL, high.z)), plaster);
    scene.show("back wall", &Shape::cuboid(vec3(low.x, 0.0, low.z), vec3(high.x, HEIGHT, -HALF.z)), accent);
    scene.show("front wall", &Shape::cuboid(vec3(low.x, 0.0, HALF.z), vec3(high.x, HEIGHT, high.z)), plaster);
    scene.show("right wall", &Shape::cuboid(vec3(HALF.x, 0.0, -HALF.z), vec3(high.x, HEIGHT, HALF.z)), plaster);
    let pane = |y: [f32; 2], z: [f32; 2]| Shape::cuboid(vec3(low.x, y[0], z[0]), vec3(-HALF.x, y[1], z[1]));
    let around = [
        pane([0.0, SILL], [-HALF.z, HALF.z]),
        pane([LINTEL, HEIGHT], [-HALF.z, HALF.z]),
        pane([SILL, LINTEL], [-HALF.z, SIDES[0]]),
        pane([SILL, LINTEL], [SIDES[1], HALF.z]),
    ];
    scene.show("window wall", &Shape::joined(around), plaster);

    let bar = |y: [f32; 2], z: [f32; 2]| Shape::cuboid(vec3(-2.58, y[0], z[0]), vec3(-2.52, y[1], z[1]));
    let (middle, cross) = ((SIDES[0] + SIDES[1]) / 2.0, LINTEL - 0.42);
    let frame = [
        bar([SILL, SILL + 0.06], SIDES),
        bar([LINTEL - 0.06, LINTEL], SIDES),
        bar([SILL + 0.06, LINTEL - 0.06], [SIDES[0], SIDES[0] + 0.06]),
        bar([SILL + 0.06, LINTEL - 0.06], [SIDES[1] - 0.06, SIDES[1]]),
        bar([SILL + 0.06, LINTEL - 0.06], [middle - 0.035, middle + 0.035]),
        bar([cross - 0.025, cross + 0.025], [SIDES[0] + 0.06, middle - 0.035]),
        bar([cross - 0.025, cross + 0.025], [middle + 0.035, SIDES[1] - 0.06]),
        Shape::cuboid(vec3(-2.50, SILL, SIDES[0] - 0.06), vec3(-2.28, SILL + 0.03, SIDES[1] + 0.06)),
    ];
    scene.show("window frame", &Shape::joined(frame), paint);
    let skirting = [
        Shape::cuboid(vec3(-HALF.x, 0.0, -HALF.z), vec3(HALF.x, 0.09, -HALF.z + 0.018)),
        Shape::cuboid(vec3(-HALF.x, 0.0, -HALF.z + 0.018), vec3(-HALF.x + 0.018, 0.09, HALF.z)),
    ];
    scene.show("skirting", &Shape::joined(skirting), paint);
}

fn table(scene: &mut Document) {
    let oak = scene.material(Material::dielectric("oak", [0.40, 0.23, 0.115], 0.42));
    let legs = |x: f32, z: f32, top: f32, side: f32| {
        [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
            .map(|[i, j]| Shape::block(vec3(i * x, top / 2.0, j * z), vec3(side, top, side)))
    };
    let board = Shape::block(vec3(0.0, 0.725, 0.0), vec3(1.5, 0.05, 0.85));
    let frame = Shape::joined(legs(0.68, 0.36, 0.70, 0.06));
    let (x, z) = (-0.85, -0.35);
    scene.show("table", &board.with(frame).at(x, 0.0, z), oak);
    let back = [0.62, 0.78, 0.94].map(|y| Shape::block(vec3(0.0, y, -0.2), vec3(0.36, 0.07, 0.02)));
    let posts = [-0.2, 0.2].map(|x| Shape::block(vec3(x, 0.73, -0.2), vec3(0.04, 0.54, 0.04)));
    let seat = Shape::block(vec3(0.0, 0.44, 0.0), vec3(0.46, 0.04, 0.44));
    let chair =
        seat.with(Shape::joined(legs(0.2, 0.19, 0.42, 0.04))).with(Shape::joined(back)).with(Shape::joined(posts));
    scene.show("chair", &chair.placed(Quat::from_rotation_y(200f32.to_radians()), vec3(-0.72, 0.0, 0.52)), oak);

    let top = 0.75;
    let glaze = scene.material(Material::dielectric("glaze", [0.09, 0.24, 0.30], 0.08));
    let vase = [
        [0.0, 0.0],
        [0.055, 0.0],
        [0.055, 0.0],
        [0.085, 0.05],
        [0.105, 0.11],
        [0.098, 0.17],
        [0.062, 0.235],
        [0.038, 0.28],
        [0.036, 0.305],
        [0.05, 0.335],
        [0.05, 0.335],
        [0.045, 0.335],
        [0.045, 0.335],
        [0.03, 0.305],
        [0.032, 0.28],
        [0.0, 0.1],
    ];
    scene.show("vase", &Shape::lathe(&vase, 40).at(x + 0.12, top, z - 0.08), glaze);
    let china = scene.material(Material::dielectric("china", [0.80, 0.79, 0.75], 0.15));
    let bowl = [
        [0.0, 0.0],
        [0.06, 0.0],
        [0.06, 0.0],
        [0.055, 0.015],
        [0.055, 0.015],
        [0.10, 0.03],
        [0.14, 0.06],
        [0.16, 0.095],
        [0.16, 0.095],
        [0.152, 0.095],
        [0.152, 0.095],
        [0.132, 0.066],
        [0.095, 0.038],
        [0.0, 0.025],
    ];
    scene.show("bowl", &Shape::lathe(&bowl, 40).at(x - 0.42, top, z + 0.08), china);
    let peel = scene.material(Material::dielectric("orange", [0.85, 0.28, 0.03], 0.4));
    let orange = Shape::sphere(0.042, 14);
    let fruit = [[-0.05, 0.075, 0.0], [0.045, 0.075, 0.04], [0.02, 0.078, -0.055], [-0.01, 0.135, 0.0]];
    let shape = scene.shape(&orange, Attributes::Plain);
    let mesh = scene.mesh("orange", &[(&shape, peel)]);
    for (i, [dx, dy, dz]) in fruit.into_iter().enumerate() {
        scene.place(&format!("orange {i}"), mesh, Place::at(x - 0.42 + dx, top + dy, z + 0.08 + dz));
    }
    let pane = scene.material(Material::glass("tumbler", 1.5, 0.0, 0.003));
    let tumbler = [
        [0.0, 0.0],
        [0.031, 0.0],
        [0.031, 0.0],
        [0.039, 0.115],
        [0.039, 0.115],
        [0.037, 0.115],
        [0.037, 0.115],
        [0.0285, 0.01],
        [0.0285, 0.01],
        [0.0, 0.01],
    ];
    scene.show("tumbler", &Shape::lathe(&tumbler, 32).at(x + 0.42, top + 0.001, z + 0.2), pane);
    books(scene, vec3(x + 0.5, top, z - 0.2), true);
}

/// Books, piled up or side by side from `at` along x.
fn books(scene: &mut Document, at: Vec3, piled: bool) {
    let cloth = [[0.45, 0.06, 0.05], [0.06, 0.15, 0.30], [0.62, 0.47, 0.19], [0.10, 0.24, 0.13], [0.56, 0.52, 0.46]];
    let count = if piled { 3 } else { 9 };
    let place = if piled { "pile" } else { "shelf" };
    let mut along = 0.0;
    for i in 0..count {
        let name = format!("{place} book {i}");
        let material: MaterialId = scene.material(Material::dielectric(&name, cloth[(3 * i + i / 5) % 5], 0.7));
        let thick = 0.026 + 0.009 * ((i * 7) % 4) as f32;
        let (height, depth) = (0.21 + 0.014 * ((i * 5) % 4) as f32, 0.155);
        let shape = if piled {
            let turn = Quat::from_rotation_y((14.0 - 17.0 * i as f32).to_radians());
            Shape::block(vec3(0.0, thick / 2.0, 0.0), vec3(height, thick, depth)).placed(turn, at + Vec3::Y * along)
        } else {
            Shape::block(vec3(thick / 2.0, height / 2.0, 0.0), vec3(thick, height, depth))
                .placed(Quat::IDENTITY, at + Vec3::X * along)
        };
        scene.show(&name, &shape, material);
        along += thick + if piled { 0.0 } else { 0.002 };
    }
}

fn shelf(scene: &mut Document) {
    let pine = scene.material(Material::dielectric("pine", [0.60, 0.43, 0.25], 0.5));
    let back = -HALF.z;
    for (i, y) in [1.25, 1.65].into_iter().enumerate() {
        let board = Shape::cuboid(vec3(0.75, y - 0.025, back), vec3(2.15, y, back + 0.23));
        scene.show(&format!("shelf {i}"), &board, pine);
    }
    books(scene, vec3(0.85, 1.25, back + 0.12), false);
    let brass = scene.material(Material::metal("brass", [0.91, 0.78, 0.42], 0.22));
    scene.show("brass ball", &Shape::sphere(0.085, 24).at(1.55, 1.25 + 0.085, back + 0.12), brass);
    let clay = scene.material(Material::lambert("clay", [0.50, 0.22, 0.13]));
    let pot = [
        [0.0, 0.0],
        [0.06, 0.0],
        [0.06, 0.0],
        [0.085, 0.12],
        [0.085, 0.12],
        [0.095, 0.12],
        [0.095, 0.12],
        [0.095, 0.15],
        [0.095, 0.15],
        [0.08, 0.15],
        [0.08, 0.15],
        [0.0, 0.13],
    ];
    scene.show("pot", &Shape::lathe(&pot, 32).at(1.05, 1.65, back + 0.12), clay);
    let mirror = scene.material(Material::metal("chrome", [0.9, 0.9, 0.92], 0.05));
    scene.show(
        "chrome ring",
        &Shape::torus(0.1, 0.018, 40, 14).placed(Quat::from_rotation_x(1.5), vec3(1.6, 1.768, back + 0.12)),
        mirror,
    );

    let hills = scene.texture("hills", &images::hills());
    let canvas = scene.material(Material::dielectric("canvas", [1.0; 3], 0.8).textured(hills, [1.0, 1.0]));
    let walnut = scene.material(Material::dielectric("walnut", [0.10, 0.055, 0.03], 0.35));
    let (low, size) = (vec3(-1.35, 1.25, back), vec3(1.2, 0.9, 0.0));
    let sheet = Shape::quad(low + Vec3::Z * 0.02, Vec3::X * size.x, Vec3::Y * size.y);
    scene.show_with("picture", &sheet, Attributes::Textured, canvas);
    let edge = 0.035;
    let strip = |a: Vec3, b: Vec3| Shape::cuboid(low + a, low + b + Vec3::Z * 0.035);
    let strips = [
        strip(vec3(-edge, -edge, 0.0), vec3(size.x + edge, 0.0, 0.0)),
        strip(vec3(-edge, size.y, 0.0), vec3(size.x + edge, size.y + edge, 0.0)),
        strip(vec3(-edge, 0.0, 0.0), vec3(0.0, size.y, 0.0)),
        strip(vec3(size.x, 0.0, 0.0), vec3(size.x + edge, size.y, 0.0)),
    ];
    scene.show("picture frame", &Shape::joined(strips), walnut);
}

/// The sky stands below the sun's rays to the window, so that it does not shade them.
fn outside(scene: &mut Document) {
    let sky = scene.material(Material::emitter("sky", [0.70, 0.85, 1.0], 10.0));
    scene.show("sky", &Shape::quad(vec3(-5.5, -0.3, 8.0), Vec3::NEG_Z * 16.0, Vec3::Y * 3.3), sky);
    let terrace = scene.material(Material::lambert("terrace", [0.50, 0.47, 0.42]));
    scene.show("terrace", &Shape::quad(vec3(-5.5, -0.3, 8.0), Vec3::X * 2.8, Vec3::NEG_Z * 16.0), terrace);
    let sun = Place::looking(vec3(-8.0, 6.4, 2.0), vec3(-2.4, 1.5, -0.2));
    scene.directional_light("sun", [1.0, 0.86, 0.66], 64.0, sun);
}
