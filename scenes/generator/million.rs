//! Two million triangles of few meshes: a slope with trees, ferns and rocks, for a sky of one colour.

use glam::{Quat, Vec2, Vec3, vec2, vec3};

use super::{
    document::{Attributes, Document, MaterialId, MeshId, NodeId, Place},
    material::Material,
    noise::{Draws, layered},
    shape::Shape,
};

const SIZE: f32 = 80.0;
const TREES: usize = 120;
const FERNS: usize = 340;
const ROCKS: usize = 220;

fn height(x: f32, z: f32) -> f32 {
    let hill = 0.0045 * (z - 30.0) * (z - 30.0) * if z < 30.0 { 1.0 } else { 0.0 };
    let brook = -1.3 * (-((x - 5.0 * (z / 11.0).sin()) / 3.2).powi(2)).exp();
    hill + brook + 2.4 * (layered(x / 17.0, z / 17.0, 3, 5) - 0.5)
}

/// A closed spindle of few sides from one point to another, thickest `at` of the way.
fn spindle(from: Vec3, to: Vec3, thick: Vec2, sides: u32, at: f32) -> Shape {
    let along = (to - from).normalize();
    let across = along.any_orthonormal_vector();
    let other = along.cross(across);
    let middle = from.lerp(to, at);
    let mut shape = Shape { positions: vec![from, to], ..Shape::default() };
    for k in 0..sides {
        let (sin, cos) = (std::f32::consts::TAU * k as f32 / sides as f32).sin_cos();
        shape.positions.push(middle + across * cos * thick.x + other * sin * thick.y);
    }
    for k in 0..sides {
        let (a, b) = (2 + k, 2 + (k + 1) % sides);
        shape.triangles.extend([[0, b, a], [1, a, b]]);
    }
    shape
}

/// A direction that leaves `along` by an angle, turned about it.
fn leaving(along: Vec3, angle: f32, turn: f32) -> Vec3 {
    let across = along.any_orthonormal_vector();
    let out = across * turn.cos() + along.cross(across) * turn.sin();
    (along * angle.cos() + out * angle.sin()).normalize()
}

const GOLDEN: f32 = 2.399_963;

/// Bark and leaves of a tree: a trunk, boughs, twigs, and flat leaves along the twigs.
fn broad(seed: u64) -> [Shape; 2] {
    let mut draws = Draws::new(seed);
    let (mut bark, mut leaves) = (Shape::default(), Shape::default());
    let tall = 5.2;
    bark.append(&spindle(vec3(0.0, -0.5, 0.0), vec3(0.15, tall, 0.1), vec2(0.2, 0.2), 7, 0.12));
    for i in 0..11 {
        let t = 0.3 + 0.68 * i as f32 / 10.0;
        let foot = vec3(0.15 * t, tall * t, 0.1 * t);
        let d = leaving(Vec3::Y, 1.15 - 0.75 * t + draws.between(-0.1, 0.1), GOLDEN * i as f32);
        let long = 2.5 - 1.3 * t + draws.between(-0.2, 0.2);
        bark.append(&spindle(foot, foot + d * long, vec2(0.06, 0.06), 5, 0.1));
        for j in 0..7 {
            let s = 0.3 + 0.7 * j as f32 / 6.0;
            let knot = foot + d * long * s;
            let twig = leaving(d, 0.75 + draws.between(-0.25, 0.25), GOLDEN * j as f32 + i as f32);
            let reach = 0.95 * draws.between(0.7, 1.1);
            bark.append(&spindle(knot, knot + twig * reach, vec2(0.018, 0.018), 4, 0.1));
            for k in 0..12 {
                let base = knot + twig * reach * (0.15 + 0.85 * k as f32 / 11.0);
                let leaf = leaving(twig, 1.0 + draws.between(-0.3, 0.3), GOLDEN * k as f32);
                let size = draws.between(0.2, 0.32);
                leaves.append(&spindle(base, base + leaf * size, vec2(0.36 * size, 0.03 * size), 4, 0.45));
            }
        }
    }
    [bark, leaves]
}

/// Bark and needles of a conifer: whorls of hanging boughs with flat sprays.
fn conifer(seed: u64) -> [Shape; 2] {
    let mut draws = Draws::new(seed);
    let (mut bark, mut leaves) = (Shape::default(), Shape::default());
    let tall = 8.0;
    bark.append(&spindle(vec3(0.0, -0.5, 0.0), vec3(0.0, tall, 0.0), vec2(0.2, 0.2), 7, 0.1));
    for i in 0..72 {
        let t = 0.1 + 0.88 * i as f32 / 71.0;
        let foot = Vec3::Y * tall * t;
        let d = leaving(Vec3::Y, 1.85 - 0.75 * t + draws.between(-0.1, 0.1), GOLDEN * i as f32);
        let long = 2.1 * (1.0 - t).powf(0.8) + 0.15;
        bark.append(&spindle(foot, foot + d * long, vec2(0.025, 0.025), 4, 0.1));
        let sprays = 5 + (8.0 * (1.0 - t)) as u32;
        for j in 0..2 * sprays {
            let s = 0.2 + 0.8 * (j / 2) as f32 / (sprays - 1) as f32;
            let side = if j % 2 == 0 { 1.0 } else { -1.0 };
            let out = (d * 0.75 + d.cross(Vec3::Y).normalize() * side * 0.8 - Vec3::Y * 0.15).normalize();
            let size = (0.5 * (1.15 - s) + 0.16) * (0.4 + 0.6 * (1.0 - t)) * draws.between(0.8, 1.2);
            leaves.append(&spindle(
                foot + d * long * s,
                foot + d * long * s + out * size,
                vec2(0.17 * size, 0.06 * size),
                4,
                0.4,
            ));
        }
    }
    [bark, leaves]
}

/// Fronds in a circle, each a rib that bends down, with leaflets to both sides.
fn fern(seed: u64) -> Shape {
    let mut draws = Draws::new(seed);
    let mut shape = Shape::default();
    for i in 0..11 {
        let turn = std::f32::consts::TAU * i as f32 / 11.0 + draws.between(-0.2, 0.2);
        let out = vec3(turn.cos(), 0.0, turn.sin());
        let side = vec3(-turn.sin(), 0.0, turn.cos());
        let long = draws.between(0.8, 1.15);
        let rise = draws.between(0.6, 1.0);
        let rib = |t: f32| out * long * t + Vec3::Y * rise * (1.5 * t - 1.3 * t * t) - Vec3::Y * 0.05;
        for k in 0..13 {
            let (t, next) = (k as f32 / 13.0, (k + 1) as f32 / 13.0);
            if k % 3 == 0 {
                shape.append(&spindle(rib(t), rib((t + 0.3).min(1.0)), vec2(0.012, 0.012), 4, 0.3));
            }
            let size = 0.34 * (t * 1.25 + 0.12).min(1.0) * (1.08 - t);
            for sign in [-1.0, 1.0] {
                let leaflet = (side * sign + (rib(next) - rib(t)).normalize() * 0.45).normalize() * size;
                shape.append(&spindle(rib(t), rib(t) + leaflet, vec2(0.12 * size, 0.12 * size), 4, 0.4));
            }
        }
    }
    shape
}

/// With the fewest digits that show no difference, to keep the file small.
fn brief(place: Place) -> Place {
    let hundredths = |v: Vec3| (v * 100.0).round() / 100.0;
    Place { translation: hundredths(place.translation), scale: hundredths(place.scale), ..place }
}

struct Kinds {
    trees: [MeshId; 4],
    ferns: [MeshId; 2],
    rocks: [MeshId; 3],
}

fn kinds(scene: &mut Document) -> Kinds {
    let mut color = |name: &str, c: [f64; 3]| scene.material(Material::lambert(name, c));
    let bark = color("bark", [0.22, 0.16, 0.11]);
    let greens: [MaterialId; 4] = [
        color("beech", [0.24, 0.40, 0.07]),
        color("maple", [0.62, 0.24, 0.05]),
        color("fir", [0.09, 0.24, 0.11]),
        color("larch", [0.48, 0.46, 0.09]),
    ];
    let ferns = [color("fern", [0.20, 0.46, 0.09]), color("dry fern", [0.55, 0.40, 0.14])];
    let stones = [color("granite", [0.50, 0.49, 0.47]), color("slate", [0.30, 0.31, 0.34])];
    let [beech, fir] = [broad(31), conifer(32)].map(|parts| parts.map(|part| scene.shape(&part, Attributes::Flat)));
    let trees = [("beech", &beech, 0), ("maple", &beech, 1), ("fir", &fir, 2), ("larch", &fir, 3)]
        .map(|(name, parts, green)| scene.mesh(name, &[(&parts[0], bark), (&parts[1], greens[green])]));
    let frond = scene.shape(&fern(33), Attributes::Flat);
    let ferns = [("fern", ferns[0]), ("dry fern", ferns[1])].map(|(name, m)| scene.mesh(name, &[(&frond, m)]));
    let rocks = [("boulder", 0, 1.0), ("stone", 1, 2.3), ("shard", 0, 3.1)].map(|(name, stone, k)| {
        let rough = |d: Vec3| {
            let wide = 0.8 + 0.2 * (2.7 * d.x * k + d.y).sin() + 0.16 * (3.0 * d.z - 2.0 * d.y * k).cos();
            wide + 0.16 * (layered(d.x * 3.0 + 9.0 + d.y, d.z * 3.0 + 2.0 * d.y, 3, 40) - 0.5)
        };
        let rock = scene.shape(&Shape::blob(3, rough), Attributes::Flat);
        scene.mesh(name, &[(&rock, stones[stone])])
    });
    Kinds { trees, ferns, rocks }
}

/// The slope; all light is that of a sky of one colour.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let kinds = kinds(&mut scene);
    let grass = scene.material(Material::lambert("ground", [0.42, 0.36, 0.20]));
    let ground = Shape::terrain(SIZE, 72, height);
    scene.show_flat("ground", &ground, grass);

    let mut draws = Draws::new(5);
    let mut taken: Vec<(Vec2, f32)> = vec![(vec2(0.0, 40.0), 14.0)];
    let mut groups: [Vec<NodeId>; 3] = Default::default();
    let wanted = [TREES, FERNS, ROCKS];
    for (kind, count) in wanted.into_iter().enumerate() {
        while groups[kind].len() < count {
            // What is small stands in front.
            let far = [-0.49, -0.25, -0.4][kind];
            let p = vec2(draws.between(-0.49, 0.49), draws.between(far, 0.49)) * SIZE;
            // Only what the camera may see.
            if p.x.abs() > 5.0 + 0.42 * (38.0 - p.y) {
                continue;
            }
            let apart = [1.4, 0.3, 0.3][kind];
            let turn = Quat::from_rotation_y(draws.between(0.0, std::f32::consts::TAU));
            let size =
                [draws.between(0.75, 1.25), draws.between(0.7, 1.5), 0.25 + draws.between(0.0, 1.0).powi(3)][kind];
            let hue = draws.between(0.0, 1.0);
            if taken.iter().any(|&(q, r)| p.distance(q) < r + apart * size) {
                continue;
            }
            taken.push((p, apart * size));
            let mesh = match kind {
                0 => kinds.trees[(hue * 3.99) as usize],
                1 => kinds.ferns[usize::from(hue > 0.75)],
                _ => kinds.rocks[(hue * 2.99) as usize],
            };
            let translation = vec3(p.x, height(p.x, p.y) - [0.1, 0.05, 0.2 * size][kind], p.y);
            let place = Place { translation, rotation: turn, scale: Vec3::splat(size) };
            let name = format!("{}{}", ["t", "f", "r"][kind], groups[kind].len());
            groups[kind].push(scene.child(&name, mesh, brief(place)));
        }
    }
    for (name, children) in ["trees", "ferns", "rocks"].into_iter().zip(&groups) {
        scene.group(name, Place::ORIGIN, children);
    }
    scene.camera("camera", 40.0, 1.0, Place::looking(vec3(0.0, 7.5, 38.0), vec3(0.0, 3.5, 0.0)));
    scene
}
