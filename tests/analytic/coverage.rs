//! Surfaces that are there in part, on one side or without light.

use std::sync::Arc;

use glam::{DVec3, Vec3, Vec4};
use wavecast::world::{
    AlphaMode, Camera, Environment, Filter, Image, LocalTransform, Material, PointLight, Projection, Scene, Texels,
    Texture, TriMesh, units::Candela,
};

use super::{Case, lambert, look_at_point, look_at_square, plane, unlit};
use crate::common::show;

/// A square of side 2 about (0, y, 0) that faces up, texture coordinates over it.
fn sheet(y: f32) -> TriMesh {
    TriMesh::quad(Vec3::new(-1.0, y, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0)
}

/// A sheet that shows 1 nit over a ground of 0.5 nit, seen from above.
fn over_ground(mesh: TriMesh, material: Material) -> Scene {
    let mut scene = Scene::new();
    show(&mut scene, plane(0.0), unlit(0.5));
    show(&mut scene, mesh, material);
    look_at_square(&mut scene, 4.0 * DVec3::Y, DVec3::ZERO, DVec3::NEG_Z, 1.0);
    scene
}

/// a · 1 + (1 − a) · 0.5.
fn blended() -> Case {
    let material = Material { alpha_mode: AlphaMode::Blend, base_alpha: 0.25, ..unlit(1.0) };
    Case::gray("BLEND, a quarter covers", over_ground(sheet(1.0), material), 0.25 + 0.75 * 0.5, 32_768)
}

/// Two sheets decide independently: a + (1 − a)(b + (1 − b)/2) with the same radiance on both.
fn blended_twice() -> Case {
    let material = |a| Material { alpha_mode: AlphaMode::Blend, base_alpha: a, ..unlit(1.0) };
    let mut scene = over_ground(sheet(1.0), material(0.25));
    show(&mut scene, sheet(2.0), material(0.5));
    Case::gray("BLEND, a quarter over a half", scene, 0.25 + 0.75 * (0.5 + 0.5 * 0.5), 32_768)
}

/// Alpha of the vertices from 0 to 1 across: the mean covers half.
fn blended_vertices() -> Case {
    let colors = [0.0, 1.0, 1.0, 0.0].map(|a| Vec4::new(1.0, 1.0, 1.0, a)).to_vec();
    let material = Material { alpha_mode: AlphaMode::Blend, ..unlit(1.0) };
    Case::gray("BLEND by vertex alpha", over_ground(TriMesh { colors, ..sheet(1.0) }, material), 0.75, 32_768)
}

/// Three of four texels, or the three quarters of a ramp of vertex alpha, pass the cutoff.
fn masked(by_texture: bool) -> Case {
    let material = Material { alpha_mode: AlphaMode::Mask { cutoff: 0.25 }, ..unlit(1.0) };
    let truth = 0.75 + 0.25 * 0.5;
    if by_texture {
        let texels = Texels::Rgba8([255, 64, 63, 128].map(|a| [255, 255, 255, a]).to_vec());
        let image = Image { name: "mask".to_owned(), width: 2, height: 2, texels };
        let texture = Texture { filter: Filter::Nearest, ..Texture::new(Arc::new(image)) };
        let material = Material { base_color_texture: Some(texture), ..material };
        Case::gray("MASK by texels", over_ground(sheet(1.0), material), truth, 1024)
    } else {
        let colors = [0.0, 1.0, 1.0, 0.0].map(|a| Vec4::new(1.0, 1.0, 1.0, a)).to_vec();
        Case::gray("MASK by vertex alpha", over_ground(TriMesh { colors, ..sheet(1.0) }, material), truth, 1024)
    }
}

/// Shadow rays pass a sheet like others: (1 − a) of a point light of 20 cd at 3 m arrives.
fn blended_shadow() -> Case {
    let mut scene = Scene::new();
    show(&mut scene, plane(0.0), Material::lambert(Vec3::splat(0.5)));
    let material = Material { alpha_mode: AlphaMode::Blend, base_alpha: 0.125, ..Material::lambert(Vec3::ZERO) };
    show(&mut scene, sheet(1.5), material);
    let light = PointLight { color: Vec3::ONE, intensity: Candela(20.0) };
    scene.spawn((light, LocalTransform::from_translation(3.0 * DVec3::Y)));
    look_at_point(&mut scene, DVec3::new(4.0, 1.0, 0.0), DVec3::ZERO);
    Case::gray("shadow through BLEND", scene, lambert(0.5, 0.875 * 20.0 / 9.0), 65_536)
}

/// From behind a single-sided sheet is not there, a double-sided one is.
fn culled(double_sided: bool) -> Case {
    let mut mesh = sheet(1.0);
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let scene = over_ground(mesh, Material { double_sided, ..unlit(1.0) });
    let (name, truth) = if double_sided { ("back of a double-sided sheet", 1.0) } else { ("culled back", 0.5) };
    Case::gray(name, scene, truth, 16)
}

/// What lies nearer than znear or beyond zfar is not seen; the sky is.
fn clipped() -> Case {
    let mut scene = Scene::new();
    show(&mut scene, plane(0.0), unlit(0.5));
    show(&mut scene, sheet(3.0), unlit(1.0));
    scene.spawn((Environment::constant(Vec3::splat(0.25)),));
    let projection = Projection::Perspective { yfov: 0.5, aspect: None };
    let camera = Camera { projection, znear: 1.5, zfar: 3.5 };
    scene.spawn((camera, LocalTransform::looking_at(4.0 * DVec3::Y, DVec3::ZERO, DVec3::X)));
    Case::gray("sky beyond znear and zfar", scene, 0.25, 16)
}

pub fn cases() -> Vec<Case> {
    vec![
        blended(),
        blended_twice(),
        blended_vertices(),
        masked(true),
        masked(false),
        blended_shadow(),
        culled(false),
        culled(true),
        clipped(),
    ]
}
