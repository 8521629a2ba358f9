//! Ten thousand instances of a few meshes: a valley with woods, rocks, a village and a colonnade.

use glam::{Quat, Vec2, Vec3, vec2, vec3};

use super::{
    document::{Attributes, Document, MaterialId, MeshId, NodeId, Place},
    images,
    material::{Color, Material},
    noise::{Draws, layered},
    shape::Shape,
};

const SIZE: f32 = 240.0;
const TOTAL: usize = 10_000;
const LAKE: Vec2 = vec2(4.0, 14.0);
const VILLAGE: Vec2 = vec2(-31.0, -12.0);
const KNOLL: Vec2 = vec2(40.0, -22.0);

fn smoothstep(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The ground's height: a lake at 0, meadows around it, hills towards the edge.
fn height(x: f32, z: f32) -> f32 {
    let p = vec2(x, z);
    let shore = (p - LAKE) * vec2(0.75, 1.0);
    let far = shore.length() + 9.0 * (layered(x / 38.0 + 9.0, z / 38.0, 2, 5) - 0.5);
    let hills = 30.0 * smoothstep(35.0, 125.0, far) * (0.45 + 0.9 * layered(x / 55.0, z / 55.0 + 3.0, 3, 21));
    let meadow = -3.0 + 5.5 * smoothstep(13.0, 32.0, far) + 1.2 * layered(x / 14.0, z / 14.0, 2, 33);
    let rough = meadow + hills;
    let level = |at: Vec2, radius: f32, height: f32, y: f32| {
        y + (height - y) * smoothstep(radius, 0.55 * radius, p.distance(at))
    };
    level(KNOLL, 22.0, 9.5, level(VILLAGE, 24.0, 4.0, rough))
}

fn color_of(scene: &mut Document, name: &str, color: Color) -> MaterialId {
    scene.material(Material::lambert(name, color))
}

/// The shared meshes.
struct Kinds {
    pines: [MeshId; 2],
    broad: [MeshId; 3],
    rocks: [MeshId; 2],
    houses: [MeshId; 2],
    pillar: MeshId,
}

fn kinds(scene: &mut Document) -> Kinds {
    let bark = color_of(scene, "bark", [0.13, 0.085, 0.055]);
    let trunk = scene.shape(&Shape::frustum(0.2, 0.12, 1.6, 7), Attributes::Plain);
    let tier = |y: f32, radius: f32, height: f32| {
        let skirt = [
            [0.25 * radius, y + 0.12 * height],
            [radius, y],
            [radius, y],
            [0.42 * radius, y + 0.5 * height],
            [0.0, y + height],
        ];
        Shape::lathe(&skirt, 9)
    };
    let needles = tier(1.0, 1.5, 2.6).with(tier(2.5, 1.15, 2.3)).with(tier(4.0, 0.8, 2.4));
    let needles = scene.shape(&needles, Attributes::Plain);
    let pines = [("pine", [0.035, 0.10, 0.045]), ("old pine", [0.055, 0.12, 0.04])].map(|(name, color)| {
        let green = color_of(scene, name, color);
        scene.mesh(name, &[(&trunk, bark), (&needles, green)])
    });
    let lump =
        |d: Vec3| 1.0 + 0.22 * (5.1 * d.x + 1.0).sin() * (4.3 * d.y).cos() + 0.15 * (6.2 * d.z + 3.0 * d.x).sin();
    let mut crown = Shape::blob(2, lump);
    crown.positions.iter_mut().for_each(|p| *p = *p * vec3(1.7, 1.55, 1.7) + Vec3::Y * 2.75);
    let crown = scene.shape(&crown.smooth(), Attributes::Plain);
    let tints = [("oak", [0.10, 0.19, 0.035]), ("linden", [0.21, 0.26, 0.045]), ("maple", [0.42, 0.13, 0.03])];
    let broad = tints.map(|(name, color)| {
        let leaves = color_of(scene, name, color);
        scene.mesh(name, &[(&trunk, bark), (&crown, leaves)])
    });
    let stones = [("granite", [0.33, 0.32, 0.31], 1.0), ("basalt", [0.17, 0.17, 0.18], 2.0)];
    let rocks = stones.map(|(name, color, k)| {
        let stone = color_of(scene, name, color);
        let rock =
            Shape::blob(1, |d| 0.8 + 0.25 * (3.7 * d.x * k + d.y).sin() + 0.2 * (5.0 * d.z - 2.0 * d.y * k).cos());
        let rock = scene.shape(&rock.faceted(), Attributes::Plain);
        scene.mesh(name, &[(&rock, stone)])
    });
    let (walls, roof, chimney) = house();
    let [walls, roof, chimney] = [walls, roof, chimney].map(|shape| scene.shape(&shape, Attributes::Plain));
    let [lime, brick] =
        [("lime", [0.70, 0.66, 0.58]), ("brick", [0.34, 0.13, 0.09])].map(|(name, c)| color_of(scene, name, c));
    let tiles = [("tile", [0.42, 0.13, 0.07]), ("slate", [0.16, 0.17, 0.20])].map(|(name, c)| color_of(scene, name, c));
    let houses = [("cottage", lime, tiles[0]), ("barn", brick, tiles[1])]
        .map(|(name, wall, top)| scene.mesh(name, &[(&walls, wall), (&roof, top), (&chimney, brick)]));
    let marble = scene.material(Material::dielectric("marble", [0.74, 0.72, 0.68], 0.4));
    let shaft = [[0.36, 0.35], [0.36, 0.35], [0.38, 1.4], [0.30, 4.2], [0.30, 4.2], [0.45, 4.5], [0.45, 4.5]];
    let pillar = Shape::block(Vec3::Y * 0.175, vec3(1.0, 0.35, 1.0))
        .with(Shape::lathe(&shaft, 14))
        .with(Shape::block(Vec3::Y * 4.6, vec3(1.0, 0.22, 1.0)));
    let pillar = scene.shape(&pillar, Attributes::Plain);
    Kinds { pines, broad, rocks, houses, pillar: scene.mesh("pillar", &[(&pillar, marble)]) }
}

/// Walls with gables, a roof that stands over, a chimney off the middle (so that a mirror image differs).
fn house() -> (Shape, Shape, Shape) {
    let (x, z, eaves, ridge) = (1.6, 2.4, 1.9, 3.5);
    let triangle = |a: Vec3, b: Vec3, c: Vec3| {
        Shape { positions: vec![a, b, c], triangles: vec![[0, 1, 2]], ..Shape::default() }.smooth()
    };
    let strip = |s: &Shape| Shape { uvs: vec![], tangents: vec![], ..s.clone() };
    let gable = |side: f32| {
        triangle(vec3(-x * side, eaves, z * side), vec3(x * side, eaves, z * side), vec3(0.0, ridge, z * side))
    };
    let walls = strip(&Shape::cuboid(vec3(-x, -1.5, -z), vec3(x, eaves, z))).with(gable(1.0)).with(gable(-1.0));
    let slope = (ridge - eaves) / x;
    let out = 0.3;
    let half = |side: f32| {
        let foot = vec3(side * (x + out), eaves - slope * out + 0.02, side * (z + out));
        let along = vec3(0.0, 0.0, -2.0 * side * (z + out));
        let up = vec3(-side * (x + out), slope * (x + out), 0.0);
        let top = Shape::quad(foot + Vec3::Y * 0.1, along, up);
        let bottom = Shape::quad(foot, up, along);
        let edge = |from: Vec3, d: Vec3| Shape::quad(from, d, Vec3::Y * 0.1);
        top.with(bottom).with(edge(foot, along)).with(edge(foot + along, up)).with(edge(foot + up, -up))
    };
    let chimney = Shape::block(vec3(0.75, 3.2, 1.1), vec3(0.45, 1.7, 0.45));
    (walls, half(1.0).with(half(-1.0)), chimney)
}

/// Keeps things apart: a grid of what stands where.
struct Crowd {
    cells: std::collections::BTreeMap<(i32, i32), Vec<(Vec2, f32)>>,
}

impl Crowd {
    /// Takes the circle if it is free.
    fn take(&mut self, p: Vec2, radius: f32) -> bool {
        let cell = (p / 4.5).floor();
        let (i, j) = (cell.x as i32, cell.y as i32);
        let near = (i - 1..=i + 1).flat_map(|i| (j - 1..=j + 1).map(move |j| (i, j)));
        if near.filter_map(|key| self.cells.get(&key)).flatten().any(|&(q, r)| p.distance(q) < r + radius) {
            return false;
        }
        self.cells.entry((i, j)).or_default().push((p, radius));
        true
    }
}

/// With as many digits as anyone can see, to keep the file small.
fn brief(place: Place) -> Place {
    let hundredths = |v: Vec3| (v * 100.0).round() / 100.0;
    Place { translation: hundredths(place.translation), scale: hundredths(place.scale), ..place }
}

/// The landscape with all of its instances, a sun of some size and a dome of sky.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let kinds = kinds(&mut scene);
    let mut crowd = Crowd { cells: Default::default() };
    let mut draws = Draws::new(3);
    let mut left = TOTAL;
    let ground = |p: Vec2, sink: f32| vec3(p.x, height(p.x, p.y) - sink, p.y);

    let mut stones: Vec<NodeId> = Vec::new();
    for (count, radius, tall) in [(28, 13.0, 1.15), (16, 7.0, 0.8)] {
        for k in 0..count {
            let turn = std::f32::consts::TAU * k as f32 / count as f32;
            let p = KNOLL + radius * Vec2::from_angle(turn);
            crowd.take(p, 0.8);
            let place = Place {
                scale: vec3(1.0, tall, 1.0),
                translation: ground(p, 0.1),
                rotation: Quat::from_rotation_y(-turn),
            };
            stones.push(scene.child(&format!("c{}", stones.len()), kinds.pillar, brief(place)));
        }
    }
    let mut houses = Vec::new();
    while houses.len() < 40 {
        let p = VILLAGE + draws.between(3.0, 25.0) * Vec2::from_angle(draws.between(0.0, std::f32::consts::TAU));
        if height(p.x, p.y) < 1.5 || !crowd.take(p, 2.2) {
            continue;
        }
        let mirrored = if houses.len() % 4 == 3 { -1.0 } else { 1.0 };
        let scale = vec3(mirrored * draws.between(0.8, 1.1), draws.between(0.8, 1.15), draws.between(0.75, 1.25));
        let towards = (VILLAGE - p).to_angle() + draws.between(-0.3, 0.3);
        let mesh = kinds.houses[usize::from(draws.chance(0.3))];
        let place = Place { translation: ground(p, 0.0), rotation: Quat::from_rotation_y(-towards), scale };
        houses.push(scene.child(&format!("h{}", houses.len()), mesh, brief(place)));
    }
    left -= stones.len() + houses.len();

    let (mut trees, mut rocks) = (Vec::new(), Vec::new());
    while trees.len() + rocks.len() < left {
        let p = vec2(draws.between(-0.49, 0.49), draws.between(-0.49, 0.49)) * SIZE;
        let y = height(p.x, p.y);
        let steep = (height(p.x + 1.0, p.y) - y).abs() + (height(p.x, p.y + 1.0) - y).abs();
        let open = p.distance(VILLAGE) < 25.0 || p.distance(KNOLL) < 16.0;
        let wood = layered(p.x / 30.0 + 50.0, p.y / 30.0, 3, 77);
        let turn = Quat::from_rotation_y(draws.between(0.0, std::f32::consts::TAU));
        let mirrored = if draws.chance(0.1) { -1.0 } else { 1.0 };
        if draws.chance(0.16) {
            let size = draws.between(0.25, 0.8) + 0.9 * draws.between(0.0, 1.0).powi(4);
            if y < -0.8 || open || !crowd.take(p, 0.8 * size) {
                continue;
            }
            let scale =
                size * vec3(mirrored * draws.between(0.8, 1.5), draws.between(0.5, 0.9), draws.between(0.8, 1.3));
            let tilt = Quat::from_rotation_x(draws.between(-0.3, 0.3));
            let place = Place { translation: ground(p, 0.15 * size), rotation: turn * tilt, scale };
            let mesh = kinds.rocks[usize::from(draws.chance(0.4))];
            rocks.push(scene.child(&format!("r{}", rocks.len()), mesh, brief(place)));
            continue;
        }
        let lone = draws.chance(0.04);
        if y < 0.8 || steep > 1.6 || (open && !draws.chance(0.03)) || (wood < 0.5 && !lone) || !crowd.take(p, 0.6) {
            continue;
        }
        let size = draws.between(0.6, 1.2);
        let scale = vec3(mirrored * size * draws.between(0.85, 1.15), size * draws.between(0.9, 1.3), size);
        let high = smoothstep(7.0, 17.0, y + 8.0 * (layered(p.x / 18.0, p.y / 18.0, 2, 91) - 0.5));
        let mesh = if draws.chance(0.1 + 0.85 * high) {
            kinds.pines[usize::from(draws.chance(0.4))]
        } else {
            let hue = draws.between(0.0, 1.0);
            kinds.broad[if hue < 0.55 {
                0
            } else if hue < 0.87 {
                1
            } else {
                2
            }]
        };
        let place = Place { translation: ground(p, 0.1), rotation: turn, scale };
        trees.push(scene.child(&format!("t{}", trees.len()), mesh, brief(place)));
    }
    for (name, children) in [("colonnade", &stones), ("village", &houses), ("woods", &trees), ("rocks", &rocks)] {
        scene.group(name, Place::ORIGIN, children);
    }
    surroundings(&mut scene);
    scene.camera("camera", 36.0, 16.0 / 9.0, Place::looking(vec3(6.0, 31.0, 99.0), vec3(1.0, 2.0, -4.0)));
    scene
}

fn surroundings(scene: &mut Document) {
    let grass = color_of(scene, "grass", [0.17, 0.21, 0.07]);
    let water = scene.material(Material::dielectric("water", [0.012, 0.035, 0.04], 0.06));
    scene.show("ground", &Shape::terrain(SIZE, 68, height), grass);
    scene.show(
        "water",
        &Shape::quad(vec3(LAKE.x - 60.0, 0.0, LAKE.y + 50.0), Vec3::X * 120.0, Vec3::NEG_Z * 100.0),
        water,
    );

    let sky = scene.clamped_texture("sky", &images::sky());
    let sky = scene.material(Material::emitter("sky", [1.0; 3], 2.3).emission_textured(sky));
    let radius = 420.0;
    // From a little below the horizon to the zenith, seen from inside.
    let arc = |k: u32| {
        let (sin, cos) = (-8.0 + 98.0 * k as f32 / 12.0).to_radians().sin_cos();
        [if k == 12 { 0.0 } else { radius * cos }, radius * sin]
    };
    let dome = Shape::lathe(&(0..=12).map(arc).collect::<Vec<_>>(), 32).inside_out();
    scene.show_with("sky", &dome, Attributes::Textured, sky);
    let sun = scene.material(Material::emitter("sun", [1.0, 0.82, 0.58], 5800.0));
    let towards = vec3(-0.72, 0.52, 0.18).normalize();
    let disc = Shape::lathe(&[[8.0, 0.0], [0.0, 0.0]], 24);
    let turn = Quat::from_rotation_arc(Vec3::Y, -towards);
    scene.show("sun", &disc.placed(turn, 380.0 * towards), sun);
}
