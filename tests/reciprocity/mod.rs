//! Light goes both ways: what a lamp sends to a receiver, the receiver as a lamp would send to it.

use glam::{DVec3, Vec3};
use wavecast::{
    measure::statistics::{Moments, normal_two_sided},
    render::{PixelFilter, RenderSettings, SamplerKind},
    world::{Camera, LocalTransform, Material, MaterialSlots, Projection, Scene, SceneKey, TriMesh},
};

use crate::common::{
    show,
    trials::{means, scaled},
};

/// A pedestal whose top is a patch; nothing can reach the back of the patch, so that its one side is all there is.
#[derive(Clone, Copy)]
struct Pedestal {
    min: Vec3,
    side: f32,
    top: f32,
}

const PEDESTALS: [Pedestal; 2] = [
    Pedestal { min: Vec3::new(-1.5, 0.0, -0.25), side: 0.5, top: 0.25 },
    Pedestal { min: Vec3::new(1.0, 0.0, 0.5), side: 0.75, top: 0.75 },
];

impl Pedestal {
    fn area(&self) -> f64 {
        f64::from(self.side).powi(2)
    }

    fn add(&self, scene: &mut Scene, radiance: f32) {
        let mut mesh = TriMesh::cuboid(self.min, self.min + Vec3::new(self.side, self.top, self.side));
        let corner = |i: u32| mesh.positions[i as usize].y == self.top;
        mesh.slots = mesh.triangles.iter().map(|t| u16::from(t.iter().all(|&i| corner(i)))).collect();
        assert_eq!(mesh.slots.iter().sum::<u16>(), 2, "the top has two triangles");
        let body = scene.spawn((Material::lambert(Vec3::splat(0.4)),));
        // Both patches have the albedo of the other, so that one scene serves both ways.
        let patch = Material { emissive: Vec3::splat(radiance), ..Material::lambert(Vec3::splat(0.5)) };
        let patch = scene.spawn((Material { double_sided: false, ..patch },));
        let slots: [SceneKey; 2] = [body, patch];
        scene.spawn((wavecast::world::Geometry(mesh.into()), MaterialSlots(slots.into())));
    }

    /// A camera that sees the patch and nothing else, from so near that nothing comes between.
    fn look(&self, scene: &mut Scene) {
        let half = f64::from(self.side) / 2.0;
        let center = self.min.as_dvec3() + DVec3::new(half, f64::from(self.top), half);
        let projection = Projection::Orthographic { xmag: half as f32, ymag: half as f32 };
        let camera = Camera { projection, znear: 0.0, zfar: f32::INFINITY };
        let eye = center + DVec3::Y / 64.0;
        scene.spawn((camera, LocalTransform::looking_at(eye, center, DVec3::NEG_Z)));
    }
}

/// A room of diffuse walls, a rough and a smooth metal, glossy paint and a screen between the two patches.
fn room(emitter: usize) -> Scene {
    let mut scene = Scene::new();
    let wall = |color: [f32; 3]| Material::lambert(Vec3::from(color));
    let room = TriMesh::cuboid(Vec3::new(-2.5, 0.0, -2.0), Vec3::new(2.5, 2.5, 2.0));
    show(&mut scene, room, wall([0.7, 0.6, 0.5]));
    let screen = TriMesh::cuboid(Vec3::new(-0.1, 0.0, -1.0), Vec3::new(0.1, 1.0, 1.25));
    show(&mut scene, screen, wall([0.3, 0.6, 0.8]));
    let plastic = Material { metallic: 0.0, roughness: 0.3, double_sided: true, ..Material::default() };
    let plastic = Material { base_color: Vec3::new(0.6, 0.2, 0.2), ..plastic };
    show(&mut scene, TriMesh::cuboid(Vec3::new(-1.0, 1.6, -0.5), Vec3::new(1.2, 1.8, 0.9)), plastic);
    let metal = Material { roughness: 0.4, double_sided: true, ..Material::default() };
    let gold = Material { base_color: Vec3::new(1.0, 0.8, 0.3), ..metal.clone() };
    let sphere = TriMesh::sphere(Vec3::new(0.2, 0.5, 1.6), 0.35, 6);
    show(&mut scene, TriMesh { normals: Vec::new(), ..sphere }, gold);
    let mirror = TriMesh::quad(Vec3::new(-2.0, 0.25, -1.75), Vec3::X * 4.0, Vec3::new(0.0, 2.0, -0.125));
    show(&mut scene, mirror, Material { roughness: 0.15, base_color: Vec3::splat(0.9), ..metal });
    for (i, pedestal) in PEDESTALS.iter().enumerate() {
        pedestal.add(&mut scene, if i == emitter { 10.0 } else { 0.0 });
    }
    PEDESTALS[1 - emitter].look(&mut scene);
    scene
}

/// Light that the other patch reflects, summed over its area, by channel.
fn transfer(emitter: usize, seeds: std::ops::Range<u64>, scale: f64) -> [Moments; 3] {
    let settings = RenderSettings {
        width: 8,
        height: 8,
        spp: Some(scaled(4096)),
        filter: PixelFilter::Box,
        sampler: SamplerKind::Sobol,
        ..RenderSettings::default()
    };
    let pictures = means(&mut room(emitter), &settings, seeds);
    let area = PEDESTALS[1 - emitter].area() * scale;
    std::array::from_fn(|channel| pictures.iter().map(|rgb| area * rgb[channel]).collect())
}

/// # Errors
/// If there is a channel in which the two ways differ by more than chance (1 % for the three) or one per cent, or
/// noise is too great to tell.
fn compare(there: &[Moments; 3], back: &[Moments; 3]) -> Result<String, String> {
    let mut lines = Vec::new();
    let mut alike = true;
    for (a, b) in there.iter().zip(back) {
        let noise = a.standard_error().hypot(b.standard_error()) / b.mean;
        let difference = a.mean / b.mean - 1.0;
        let p = normal_two_sided(difference / noise);
        alike &= p > 0.01 / 3.0 && noise < 0.004 && difference.abs() < 0.01;
        lines.push(format!("{:.6} and {:.6}: {:.3}% ± {:.3}%", a.mean, b.mean, 100.0 * difference, 100.0 * noise));
    }
    let table = lines.join("\n");
    if alike { Ok(table) } else { Err(table) }
}

/// A_B · (mean radiance of patch B while A emits) = A_A · (mean radiance of A while B emits), for the same albedo and
/// emission of both: the transfer is symmetric if each BSDF is, through any number of scatterings.
///
/// As a negative control, one way scaled by two per cent is found.
#[test]
fn emitter_and_receiver_can_be_exchanged() {
    let (there, back) = (transfer(0, 300..316, 1.0), transfer(1, 400..416, 1.0));
    match compare(&there, &back) {
        Ok(table) => println!("{table}"),
        Err(table) => panic!("{table}"),
    }
    assert!(compare(&transfer(0, 300..316, 1.02), &back).is_err());
}
