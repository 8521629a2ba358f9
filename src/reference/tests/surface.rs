//! What a ray meets and how it is shaded: culling, coverage, normals, textures.

use std::f64::consts::PI;

use glam::{DAffine3, DQuat, DVec3, Vec3, Vec4};

use super::scene::*;
use crate::{
    flat::{NONE, TextureSlot},
    reference::{
        ReferenceSettings, geometry,
        surface::{Place, valid_normal},
    },
    world::{AlphaMode, Material, TriMesh},
};

const ABOVE: Vec3 = Vec3::new(0.1, 1.0, 0.2);
const BELOW: Vec3 = Vec3::new(0.1, -1.0, 0.2);

fn glow(radiance: f32) -> Material {
    Material { emissive: Vec3::splat(radiance), ..Material::lambert(Vec3::ZERO) }
}

/// A back that is culled is not there for any ray; a mirroring transform turns neither front nor back.
#[test]
fn back_without_double_sides_is_not_there() {
    for scale in [DVec3::ONE, DVec3::new(-1.0, 1.0, 1.0), DVec3::new(1.0, 2.0, -3.0)] {
        let mut scene = TestScene::new();
        let one_sided = Material { double_sided: false, ..glow(3.0) };
        scene.instance(floor(Vec3::ZERO, 1.0), &one_sided, DAffine3::from_scale(scale));
        scene.sky(1.0);
        scene.check(ABOVE, Vec3::NEG_Y, &samples(1, None), 3.0);
        scene.check(BELOW, Vec3::Y, &samples(1, None), 1.0);
    }
    // Shadow rays pass a roof that turns its culled back to the floor, and stop at its front.
    let mut scene = TestScene::new();
    scene.mesh(floor(Vec3::ZERO, 1.0), &lambert(1.0));
    let roof = Material { double_sided: false, ..lambert(0.0) };
    scene.mesh(floor(Vec3::new(0.0, 0.5, 0.0), 1.0), &roof);
    scene.point_light(Vec3::new(0.1, 1.0, 0.2), 5.0);
    scene.check(Vec3::new(0.1, 0.3, 0.2), Vec3::NEG_Y, &samples(1, 1), 5.0 / PI);
    let mut scene = TestScene::new();
    scene.mesh(floor(Vec3::ZERO, 1.0), &lambert(1.0));
    scene.mesh(turned_inside_out(floor(Vec3::new(0.0, 0.5, 0.0), 1.0)), &roof);
    scene.point_light(Vec3::new(0.1, 1.0, 0.2), 5.0);
    scene.check(Vec3::new(0.1, 0.3, 0.2), Vec3::NEG_Y, &samples(1, 1), 0.0);
}

/// MASK compares with the cutoff, BLEND lets 1 − a through, of views, shadows and lights alike.
#[test]
fn coverage_masks_and_blends() {
    for (mode, alpha, covered) in [
        (AlphaMode::Opaque, 0.1f32, 1.0),
        (AlphaMode::Mask { cutoff: 0.5 }, 0.5, 1.0),
        (AlphaMode::Mask { cutoff: 0.5 }, 0.49, 0.0),
        (AlphaMode::Blend, 0.25, 0.25),
    ] {
        let with = |material: Material| Material { alpha_mode: mode, base_alpha: alpha, ..material };
        let mut scene = TestScene::new();
        scene.mesh(floor(Vec3::ZERO, 1.0), &with(glow(3.0)));
        scene.sky(1.0);
        scene.check(ABOVE, Vec3::NEG_Y, &samples(100_000, 0), 3.0 * covered + 1.0 - covered);

        let mut shadow = TestScene::new();
        shadow.mesh(floor(Vec3::ZERO, 1.0), &lambert(1.0));
        shadow.mesh(floor(Vec3::new(0.0, 0.5, 0.0), 1.0), &with(lambert(0.0)));
        shadow.point_light(Vec3::new(0.1, 1.0, 0.2), 5.0);
        shadow.check(Vec3::new(0.1, 0.3, 0.2), Vec3::NEG_Y, &samples(100_000, 1), 5.0 / PI * (1.0 - covered));

        // A large light close by: E = πL a, to (h/half)².
        let mut light = TestScene::new();
        light.mesh(floor(Vec3::ZERO, 1.0), &lambert(1.0));
        light.mesh(floor(Vec3::new(0.0, 0.01, 0.0), 50.0), &with(glow(2.0)));
        let (mean, error) = light.look(Vec3::new(0.1, 0.005, 0.2), Vec3::NEG_Y, &samples(40_000, 1));
        assert!((mean.y - 2.0 * covered).abs() < 4.0 * error + 1e-3, "{mode:?} {alpha}: {mean} ± {error}");
    }
}

/// Unlit shows its base colour from its front, or both sides, and reflects nothing.
#[test]
fn unlit_shows_its_base_color_alone() {
    for double_sided in [false, true] {
        let mut scene = TestScene::new();
        let unlit = Material { unlit: true, double_sided, base_color: Vec3::splat(0.3), ..Material::default() };
        scene.mesh(floor(Vec3::ZERO, 1.0), &unlit);
        scene.sky(1.0);
        scene.check(ABOVE, Vec3::NEG_Y, &samples(1, None), f64::from(0.3f32));
        scene.check(BELOW, Vec3::Y, &samples(1, None), if double_sided { f64::from(0.3f32) } else { 1.0 });
    }
}

/// A rotated, sheared-scaled instance of a unit square is lit as the square it is in the world.
#[test]
fn instances_are_lit_where_they_are() {
    let rotation = DQuat::from_rotation_x(0.5);
    let place =
        DAffine3::from_scale_rotation_translation(DVec3::new(3.0, 1.0, 0.5), rotation, DVec3::new(1.0, 2.0, 3.0));
    let mut scene = TestScene::new();
    scene.instance(floor(Vec3::ZERO, 1.0), &lambert(1.0), place);
    scene.distant_light(Vec3::Y, 10.0);
    scene.check(Vec3::new(1.1, 5.0, 3.05), Vec3::NEG_Y, &samples(1, 1), 10.0 / PI * 0.5f64.cos());
}

/// Vertex normals go by the inverse transpose: under a scale of (1, 1/k, 1) the slope of a normal grows k-fold.
#[test]
fn vertex_normals_go_by_the_inverse_transpose() {
    for mirror in [1.0, -1.0] {
        let mut mesh = floor(Vec3::ZERO, 1.0);
        mesh.normals = vec![Vec3::new(0.1, 1.0, 0.0).normalize(); 4];
        let mut scene = TestScene::new();
        scene.instance(mesh, &lambert(1.0), DAffine3::from_scale(DVec3::new(mirror, 0.25, 1.0)));
        scene.distant_light(Vec3::Y, 10.0);
        // n ∝ (0.1, 4): cos = 1/√(1 + 0.025²).
        let cos = 1.0 / (1.0f64 + 0.025 * 0.025).sqrt();
        scene.check(ABOVE, Vec3::NEG_Y, &samples(1, 1), 10.0 / PI * cos);
        scene.check(BELOW, Vec3::Y, &samples(1, 1), 0.0);
    }
}

/// A normal map's x tilts along the tangent, its y along w·(n × T); mirrored instances show the mirror image.
#[test]
fn normal_map_tilts_along_tangent_and_bitangent() {
    // Texel (0.8, 0, 0.6) or (0, 0.8, 0.6), to 8 bits.
    for (texel, tilt) in [([230, 128, 204, 255], DVec3::X), ([128, 230, 204, 255], DVec3::NEG_Z)] {
        for (mirror, from_below) in [(DVec3::ONE, false), (DVec3::new(-1.0, 1.0, 1.0), false), (DVec3::ONE, true)] {
            let mut mesh = floor(Vec3::ZERO, 1.0);
            mesh.tangents = vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4];
            let mut scene = TestScene::new();
            let slot = scene.texture(1, vec![texel], TextureSlot::default());
            scene.instance(mesh, &lambert(1.0), DAffine3::from_scale(mirror));
            scene.flat.materials.normal_texture[0] = slot;
            let v = DVec3::new(f64::from(texel[0]), f64::from(texel[1]), f64::from(texel[2])) / 255.0 * 2.0 - 1.0;
            let v = v.normalize();
            let n = mirror * (DVec3::X * v.x + DVec3::NEG_Z * v.y) + DVec3::Y * v.z;
            let n = if from_below { -n } else { n };
            assert!(n.dot(mirror * tilt).abs() > 0.7);
            let to_light = DVec3::new(0.3, if from_below { -1.0 } else { 1.0 }, -0.2).normalize();
            scene.distant_light(to_light.as_vec3(), 10.0);
            let (from, along) = if from_below { (BELOW, Vec3::Y) } else { (ABOVE, Vec3::NEG_Y) };
            // The view is straight on: the mirror direction, at 2·53°, would be below the surface.
            let n = valid_normal(-along.as_dvec3(), n, -along.as_dvec3());
            let to_light = DVec3::from_array(scene.flat.lights.distant.to_light[0].map(f64::from)).normalize();
            scene.check(from, along, &samples(1, 1), 10.0 / PI * n.dot(to_light).max(0.0));
        }
    }
}

/// Afterwards the mirror direction is above the surface, wo above the shading normal's plane; good normals stay.
#[test]
fn valid_normals_reflect_above_the_surface() {
    let mut rng = crate::reference::Rng::new(4, 0);
    let mut bent = 0;
    for _ in 0..10_000 {
        let ng = DVec3::Z;
        let mut unit = || DVec3::new(rng.uniform(), rng.uniform(), rng.uniform()) * 2.0 - 1.0;
        let [wo, ns] = [unit().normalize(), unit().normalize()].map(|v| DVec3::new(v.x, v.y, v.z.abs()));
        let new = valid_normal(wo, ns, ng);
        let r = 2.0 * new.dot(wo) * new - wo;
        assert!(r.dot(ng) > 0.0 && new.dot(wo) > 0.0 && new.dot(ng) > 0.0, "{wo} {ns}");
        let before = 2.0 * ns.dot(wo) * ns - wo;
        if before.dot(ng) > 0.01 {
            assert_eq!(new, ns);
        } else {
            bent += 1;
        }
    }
    assert!(bent > 1000);
    assert_eq!(valid_normal(DVec3::new(0.8, 0.0, 0.6), DVec3::Z, DVec3::Z), DVec3::Z);
}

/// Texels sit at half-integers, row 0 at v = 0; sRGB is decoded before it is filtered; edges wrap three ways.
#[test]
fn textures_filter_and_wrap() {
    let texels = vec![[0, 0, 0, 255], [255, 255, 255, 255], [188, 188, 188, 255], [55, 55, 55, 255]];
    let srgb = |c: f64| ((c / 255.0 + 0.055) / 1.055f64).powf(2.4);
    let (c, d) = (srgb(188.0), srgb(55.0));
    let slot =
        |wrap: u8, nearest: u8| TextureSlot { wrap_u: wrap, wrap_v: wrap, nearest, srgb: 1, ..Default::default() };
    for (uv, slot, want) in [
        ([0.25, 0.25], slot(0, 0), 0.0),
        ([0.5, 0.25], slot(0, 0), 0.5),
        ([0.5, 0.5], slot(0, 0), (1.0 + c + d) / 4.0),
        ([0.0, 0.25], slot(0, 0), 0.5),
        ([0.0, 0.25], slot(1, 0), 0.0),
        ([0.0, 0.25], slot(2, 0), 0.0),
        ([1.0, 0.75], slot(1, 0), d),
        ([1.25, 0.25], slot(1, 1), 1.0),
        ([1.25, 0.25], slot(0, 1), 0.0),
        ([-0.25, 0.25], slot(1, 1), 0.0),
        ([-0.25, 0.25], slot(0, 1), 1.0),
        ([7.0, 7.0], slot(2, 1), d),
        ([0.49, 0.51], slot(2, 1), c),
    ] {
        let mut scene = TestScene::new();
        let row = scene.texture(2, texels.clone(), slot);
        let got = crate::reference::texture::look_up(&scene.flat, row, glam::DVec2::from_array(uv));
        assert!((got.x - want).abs() < 1e-12 && got.w == 1.0, "{uv:?} {slot:?}: got {got}, want {want}");
    }
}

/// Base colour is factor × texture × vertex colour; the texture's coordinates go through its transform.
#[test]
fn base_color_is_the_product_of_three() {
    let mut mesh = floor(Vec3::ZERO, 1.0);
    mesh.colors = vec![Vec4::new(0.5, 0.5, 0.5, 1.0); 4];
    let mut scene = TestScene::new();
    let slot = TextureSlot { nearest: 1, ..TextureSlot::default() };
    let row = scene.texture(2, vec![[0, 0, 0, 255], [51, 51, 51, 255]], slot);
    let unlit = Material { unlit: true, base_color: Vec3::splat(0.5), ..Material::default() };
    scene.mesh(mesh, &unlit);
    assert_eq!(scene.flat.materials.base_color_texture[0], NONE);
    scene.flat.materials.base_color_texture[0] = row;
    let left = Vec3::new(-0.5, 1.0, 0.1);
    scene.check(left, Vec3::NEG_Y, &samples(1, None), 0.0);
    scene.flat.textures.slots.transform[row as usize] = [1.0, 0.0, 0.5, 0.0, 1.0, 0.0];
    scene.check(left, Vec3::NEG_Y, &samples(1, None), 0.25 * 0.2);
}

/// On a unit sphere a corner is its own normal, so p' = p + Σ bᵢ (1 − p·vᵢ) vᵢ: twice the way to the sphere,
/// to leading order. From the inside the surface is hollow and nothing is lifted.
#[test]
fn terminator_lift_follows_the_smooth_surface() {
    let mut scene = TestScene::new();
    scene.mesh(TriMesh::sphere(Vec3::ZERO, 1.0, 24), &lambert(1.0));
    let hit = geometry::Hit { t: 1.0, b1: 0.3, b2: 0.3, index: 0 };
    for triangle in geometry::world_triangles(&scene.flat) {
        let place = Place::new(&scene.flat, &triangle, &hit);
        let outside = place.shading(place.front, 0.0);
        let p = triangle.point(0.3, 0.3);
        assert_eq!(outside.p, p);
        let corners = [(0.4, triangle.p0), (0.3, triangle.p0 + triangle.e1), (0.3, triangle.p0 + triangle.e2)];
        let lift: DVec3 = corners.iter().map(|&(b, v)| b * (1.0 - p.dot(v)) * v).sum();
        assert!((outside.p_lifted - p - lift).length() < 1e-6, "corners are unit vectors to f32");
        let way = 1.0 - p.length();
        assert!((outside.p_lifted.length() - p.length() - 2.0 * way).abs() < 0.1 * way);
        assert_eq!(place.shading(-place.front, 0.0).p_lifted, p);
        assert_eq!(place.shading(place.front, f64::INFINITY).p_lifted, p);
    }
}

/// A facet that turns away from the light while the smooth surface does not is lit: on a coarse sphere the light
/// ends where it would on a round one. Without the lift such facets are black.
#[test]
fn terminator_of_a_coarse_sphere_is_where_the_smooth_one_is() {
    let mut scene = TestScene::new();
    scene.mesh(TriMesh::sphere(Vec3::ZERO, 1.0, 8), &lambert(1.0));
    let to_light = Vec3::new(1.0, 0.3, 0.0).normalize();
    scene.distant_light(to_light, PI as f32);
    let black = |terminator_fix: bool| {
        let settings = ReferenceSettings { terminator_fix, ..samples(1, 1) };
        let (mut black, mut lit) = (0, 0);
        for i in 0..60 * 60 {
            let (x, y) = ((i % 60) as f32 / 30.0 - 0.98, (i / 60) as f32 / 30.0 - 0.98);
            let n = Vec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt());
            // Within the outline of the mesh, near the terminator but on its light side.
            if x * x + y * y < 0.9 && (0.03..0.3).contains(&n.dot(to_light)) {
                let value = scene.look(Vec3::new(x, y, 5.0), Vec3::NEG_Z, &settings).0.y;
                black += usize::from(value == 0.0);
                lit += usize::from(value > 0.0);
            }
        }
        (black, lit)
    };
    assert_eq!(black(true).0, 0);
    let (without, lit) = black(false);
    assert!(without * 20 > lit, "the test sees the problem: {without} black, {lit} lit");
}

/// Where nothing is lifted but by rounding, light from below the facet is no light, however the normal map bends.
#[test]
fn light_from_below_a_flat_facet_stays_out() {
    for i in 0..20 {
        let mut mesh = floor(Vec3::ZERO, 1.0);
        mesh.tangents = vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4];
        if i > 0 {
            mesh.normals = vec![Vec3::Y; 4];
        }
        let mut scene = TestScene::new();
        let slot = scene.texture(1, vec![[230, 128, 204, 255]], TextureSlot::default());
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.7 * f64::from(i), 1.1 * f64::from(i), 0.3 * f64::from(i));
        let place = DAffine3::from_rotation_translation(turn, DVec3::splat(3.0 * f64::from(i)));
        scene.instance(mesh, &lambert(1.0), place);
        scene.flat.materials.normal_texture[0] = slot;
        scene.distant_light((turn * DVec3::new(1.0, -0.1, 0.0)).as_vec3(), 10.0);
        let from = place.transform_point3(DVec3::new(0.1, 1.0, 0.2)).as_vec3();
        scene.check(from, (turn * DVec3::NEG_Y).as_vec3(), &samples(1, 1), 0.0);
    }
}
