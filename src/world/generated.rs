//! Large scenes made by formula, so that measurements need no files: a hall of statues and a wood.

use std::{f64::consts::TAU, sync::Arc};

use glam::{DVec3, Vec3};

use super::{
    Camera, DirectionalLight, EmissiveSurface, Environment, Geometry, LocalTransform, Material, MaterialSlots, Scene,
    SceneKey, TriMesh, units::Lux,
};

/// Triangles of a [`hall`] if nothing else is wanted.
pub const HALL: usize = 1_100_000;

/// Triangles of [`foliage`] if nothing else is wanted.
pub const FOLIAGE: usize = 1_000_000;

/// Leaves of a tree, where there are enough triangles for whole trees.
const LEAVES: usize = 2000;

/// Vertical field of view of the cameras, rad.
const VIEW: f32 = 1.1;

/// A closed room with columns, lamps in its ceiling, and a knotted torus on every free place: about so many triangles,
/// much finer than the room where they are many, all of them joined to surfaces. The camera is inside.
pub fn hall(triangles: usize) -> Scene {
    let mut numbers = Numbers(5);
    // Fewer statues where each would be too coarse to be round.
    let across = ((triangles as f64 / 800.0).sqrt() as usize).clamp(2, 8);
    let (half, height) = (2.0 * across as f64 + 2.0, 6.0);
    let share = triangles / (across * across);
    let mut statues = TriMesh::default();
    let mut walls = TriMesh::default();
    for place in 0..across * across {
        let (i, j) = (place % across, place / across);
        let middle = |at: usize| 4.0 * at as f64 + 4.0 - half;
        let center = DVec3::new(middle(i), 1.5, middle(j));
        let (turns, knots) = ((2 + place % 3) as f64, (3 + place / across % 4) as f64);
        let (waves, phase) = (0.02 + 0.02 * numbers.next(), TAU * numbers.next());
        sheet(&mut statues, patches(share * 9 / 10, 2.0), |u, v| {
            let (u, v) = (TAU * u, TAU * v);
            let radius = 0.8 + 0.3 * (knots * u).cos();
            let (across, along) = ((turns * u).sin(), (turns * u).cos());
            let thick = 0.22 + waves * (9.0 * u + phase).sin() * (5.0 * v).cos();
            let around = DVec3::new(v.cos() * along, v.sin(), v.cos() * across);
            center + DVec3::new(radius * along, 0.9 * (knots * u).sin(), radius * across) + thick * around
        });
        let foot = DVec3::new(center.x + 2.0, 0.0, center.z + 2.0);
        sheet(&mut walls, patches(share / 20, 4.0), |u, v| {
            let radius = 0.3 + 0.03 * (12.0 * TAU * u).cos();
            foot + DVec3::new(radius * (TAU * u).cos(), height * v, radius * (TAU * u).sin())
        });
    }
    let (low, high) = (DVec3::new(-half, 0.0, -half), DVec3::new(half, height, half));
    let [x, y, z] = [DVec3::X * 2.0 * half, DVec3::Y * height, DVec3::Z * 2.0 * half];
    for (corner, along, up) in [(low, x, z), (high, -x, -z), (low, x, y), (high, -x, -y), (low, y, z), (high, -y, -z)] {
        sheet(&mut walls, patches(triangles / 120, 1.0), |u, v| corner + u * along + v * up);
    }
    let mut lamps = TriMesh::default();
    for place in 0..(across - 1) * (across - 1) {
        let middle = |at: usize| 4.0 * at as f64 + 4.0 - half;
        let corner = DVec3::new(middle(place % (across - 1)) + 1.0, height - 0.1, middle(place / (across - 1)) + 1.0);
        sheet(&mut lamps, [1, 1], |u, v| corner + DVec3::new(1.5 * u, 0.0, 1.5 * v));
    }
    let mut scene = Scene::new();
    show(&mut scene, walls, Vec3::new(0.7, 0.68, 0.62));
    show(&mut scene, statues, Vec3::new(0.6, 0.42, 0.3));
    let lamps = show(&mut scene, lamps, Vec3::ZERO);
    scene.insert(lamps, EmissiveSurface { radiance: Vec3::splat(12.0) });
    look(&mut scene, DVec3::new(2.0 - half, 2.5, 2.0 - half), DVec3::new(1.0, -0.05, 0.9));
    scene
}

/// Hills with trees whose crowns are clouds of leaves, each a triangle that overlaps its neighbours: about so many
/// triangles. With their number the wood grows, not the tree. The camera is among the trees, under a sunny sky.
pub fn foliage(triangles: usize) -> Scene {
    let mut numbers = Numbers(9);
    let trees = (triangles / 2500).clamp(4, 1 << 20);
    let leaves = triangles * 8 / 10 / trees;
    // As dense a wood whatever its size, and as dense a tree however few its leaves.
    let half = (trees as f64).sqrt().max(4.0);
    let leaf = (LEAVES as f64 / leaves.max(1) as f64).sqrt().max(1.0);
    let ground = |x: f64, z: f64| 0.8 * (x * 0.3).sin() * (z * 0.27).cos() + 0.1 * (3.0 * x).sin();
    let mut hills = TriMesh::default();
    sheet(&mut hills, patches(triangles / 5, 1.0), |u, v| {
        let (x, z) = (half * (2.0 * u - 1.0), half * (2.0 * v - 1.0));
        DVec3::new(x, ground(x, z), z)
    });
    let mut trunks = TriMesh::default();
    let mut crowns = TriMesh::default();
    for _ in 0..trees {
        let [x, z] = [0, 1].map(|_| 0.95 * half * (2.0 * numbers.next() - 1.0));
        let foot = DVec3::new(x, ground(x, z), z);
        sheet(&mut trunks, [8, 2], |u, v| {
            foot + DVec3::new(0.12 * (TAU * u).cos(), 2.2 * v - 0.2, 0.12 * (TAU * u).sin())
        });
        for _ in 0..leaves {
            // Denser towards the outside, as crowns are.
            let place = foot + 2.2 * DVec3::Y + 1.3 * numbers.next().powf(0.4) * numbers.direction();
            let first = crowns.positions.len() as u32;
            let edges = [DVec3::ZERO, 0.12 * leaf * numbers.direction(), 0.06 * leaf * numbers.direction()];
            crowns.positions.extend(edges.map(|edge| (place + edge).as_vec3()));
            crowns.triangles.push([first, first + 1, first + 2]);
        }
    }
    let mut scene = Scene::new();
    show(&mut scene, hills, Vec3::new(0.3, 0.25, 0.15));
    show(&mut scene, trunks, Vec3::new(0.25, 0.15, 0.1));
    show(&mut scene, crowns, Vec3::new(0.15, 0.4, 0.1));
    scene.spawn((Environment::constant(Vec3::new(0.35, 0.5, 0.8)),));
    let sun = DirectionalLight { color: Vec3::new(1.0, 0.95, 0.85), illuminance: Lux(3.0) };
    scene.spawn((sun, LocalTransform::looking_at(DVec3::new(0.5, 1.0, 0.2), DVec3::ZERO, DVec3::Y)));
    let [x, z] = [0.9 * -half; 2];
    look(&mut scene, DVec3::new(x, ground(x, z) + 3.0, z), DVec3::new(1.0, -0.1, 1.0));
    scene
}

/// Adds a mesh with a paint of its own.
fn show(scene: &mut Scene, mesh: TriMesh, albedo: Vec3) -> SceneKey {
    let paint = scene.spawn((Material::lambert(albedo),));
    scene.spawn((Geometry(Arc::new(mesh)), MaterialSlots::from(paint)))
}

/// Adds a camera.
fn look(scene: &mut Scene, eye: DVec3, along: DVec3) {
    scene.spawn((Camera::perspective(VIEW), LocalTransform::looking_at(eye, eye + along, DVec3::Y)));
}

/// Rows and columns of about so many triangles, so many times as many rows as columns.
fn patches(triangles: usize, ratio: f64) -> [usize; 2] {
    let quads = triangles as f64 / 2.0;
    let rows = (quads * ratio).sqrt().round().max(3.0);
    [rows as usize, (quads / rows).round().max(1.0) as usize]
}

/// Adds a surface over the unit square, as quads cut in two.
fn sheet(mesh: &mut TriMesh, [rows, columns]: [usize; 2], at: impl Fn(f64, f64) -> DVec3) {
    let first = mesh.positions.len() as u32;
    let width = columns as u32 + 1;
    for row in 0..=rows {
        let places = (0..=columns).map(|column| at(row as f64 / rows as f64, column as f64 / columns as f64).as_vec3());
        mesh.positions.extend(places);
    }
    for row in 0..rows as u32 {
        for column in 0..columns as u32 {
            let a = first + row * width + column;
            let [b, c, d] = [a + width, a + width + 1, a + 1];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
}

/// splitmix64: numbers in [0, 1) that are the same on every machine.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ z >> 31) as f64 / 2_f64.powi(64)
    }

    /// Uniform over the unit sphere.
    fn direction(&mut self) -> DVec3 {
        let y = 1.0 - 2.0 * self.next();
        let (sin, cos) = (TAU * self.next()).sin_cos();
        let radius = (1.0 - y * y).max(0.0).sqrt();
        DVec3::new(radius * cos, y, radius * sin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        render::{RenderSettings, Renderer},
        world::Geometry,
    };

    /// From 1e3 to 1e6, both scenes have the wanted number of triangles within 15 %, and sound meshes.
    #[test]
    fn scenes_have_about_the_wanted_number_of_triangles() {
        for make in [hall as fn(usize) -> Scene, foliage] {
            for wanted in [1_000, 10_000, 100_000, HALL, FOLIAGE] {
                let scene = make(wanted);
                let meshes: Vec<Geometry> =
                    scene.keys_with::<Geometry>().into_iter().filter_map(|key| scene.get(key)).collect();
                meshes.iter().for_each(|Geometry(mesh)| mesh.check().unwrap());
                let count: usize = meshes.iter().map(|Geometry(mesh)| mesh.triangles.len()).sum();
                let ratio = count as f64 / wanted as f64;
                assert!((0.85..1.15).contains(&ratio), "{count} of {wanted}");
            }
        }
    }

    /// Every pixel of a small picture has light, and not all the same.
    #[test]
    fn scenes_can_be_rendered() {
        for mut scene in [hall(5_000), foliage(5_000)] {
            let mut renderer = Renderer::new();
            let report = renderer.sync(&mut scene);
            assert!(report.warnings.is_empty(), "{:?}", report.warnings);
            let settings = RenderSettings { width: 16, height: 12, spp: Some(16), ..RenderSettings::default() };
            let picture = renderer.render(&settings, &()).picture;
            let lit = picture.rgb.iter().filter(|rgb| rgb[1] > 0.0).count();
            assert!(lit > 16 * 12 * 9 / 10, "{lit}");
            let (dark, bright) =
                picture.rgb.iter().fold((f32::MAX, 0_f32), |(a, b), rgb| (a.min(rgb[1]), b.max(rgb[1])));
            assert!(bright > 2.0 * dark, "{dark} to {bright}");
        }
    }
}
