//! Surfaces given by a formula: against closed forms, against fine meshes, and against themselves from elsewhere.

use std::{f64::consts::PI, sync::Arc};

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use wavecast::{
    film::{Layer, LayerData},
    flat::NONE,
    render::{AccelKind, LayerKind, RenderSettings, Rendered, Renderer},
    wavefront,
    world::{
        AlphaMode, EmissiveSurface, Environment, Filter, Image, LocalTransform, Material, Scene, SceneKey, Shape,
        Texels, Texture, TriMesh, units::Lumens,
    },
};

use crate::common::{look, mean, picture, settings, show, show_shape};

/// A texture of so many texels a side, no two alike.
fn map(size: u32, seed: u32) -> Texture {
    let mut state = seed.wrapping_mul(0x9e37_79b9) | 1;
    let texels = (0..size * size)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            let [r, g, b, _] = state.to_le_bytes();
            [64 + r / 2, 64 + g / 2, 64 + b / 2, 255]
        })
        .collect();
    let image = Image { name: "map".to_owned(), width: size, height: size, texels: Texels::Rgba8(texels) };
    Texture { filter: Filter::Linear, ..Texture::new(Arc::new(image)) }
}

fn paint(color: [f32; 3]) -> Material {
    Material { base_color: Vec3::from(color), roughness: 0.4, metallic: 0.2, ..Material::default() }
}

fn lamp(radiance: f32) -> Material {
    Material { emissive: Vec3::splat(radiance), ..Material::lambert(Vec3::splat(0.3)) }
}

/// Everything that a shape can be: on a plane without end a glass ball that absorbs, a tube seen into, a disc with holes,
/// an ellipsoid, one that shines and one that is mirrored, with textures, under a weak sky.
pub fn varied() -> Scene {
    let mut scene = Scene::new();
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 0.4, -0.3).normalize(), 0.8);
    let place = |scale: DVec3, at: DVec3| DAffine3::from_scale_rotation_translation(scale, turn, at);
    let moved = |x: f64, y: f64, z: f64| DAffine3::from_translation(DVec3::new(x, y, z));
    let checks = Material { base_color_texture: Some(map(2, 3)), ..Material::lambert(Vec3::splat(0.8)) };
    show_shape(&mut scene, Shape::Plane, checks, DAffine3::IDENTITY);
    let mut glass = Material::glass(1.5);
    (glass.attenuation_distance, glass.attenuation_color) = (0.5, Vec3::new(0.5, 0.9, 0.6));
    show_shape(&mut scene, Shape::Sphere { radius: 0.6 }, glass, moved(1.1, 0.6, 1.0));
    let tube = Material { double_sided: true, base_color_texture: Some(map(8, 5)), ..paint([0.9, 0.5, 0.3]) };
    let upright = Shape::Cylinder { radius: 0.4, half_height: 0.6 };
    show_shape(&mut scene, upright, tube, place(DVec3::new(1.0, 1.0, 0.7), DVec3::new(-1.4, 0.7, 0.4)));
    let holes = Material {
        alpha_mode: AlphaMode::Blend,
        base_alpha: 0.6,
        double_sided: true,
        base_color_texture: Some(map(4, 7)),
        ..paint([0.4, 0.6, 0.9])
    };
    show_shape(&mut scene, Shape::Disc { radius: 0.7 }, holes, place(DVec3::ONE, DVec3::new(0.1, 0.9, 0.2)));
    let mapped = Material { normal_texture: Some(map(4, 11)), normal_scale: 0.5, ..paint([0.7, 0.7, 0.3]) };
    let stretched = place(DVec3::new(0.9, 0.4, 0.6), DVec3::new(0.0, 0.5, 1.8));
    show_shape(&mut scene, Shape::Sphere { radius: 0.7 }, mapped, stretched);
    let glow = Material { emissive_texture: Some(map(4, 13)), double_sided: true, ..lamp(12.0) };
    let mirrored = place(DVec3::new(-0.5, 0.3, 0.7), DVec3::new(-0.6, 2.4, 0.8));
    show_shape(&mut scene, Shape::Sphere { radius: 0.5 }, glow, mirrored);
    show_shape(&mut scene, Shape::Disc { radius: 0.4 }, lamp(9.0), moved(-2.0, 0.2, 1.4));
    let veil = Material { alpha_mode: AlphaMode::Blend, base_alpha: 0.4, double_sided: true, ..paint([0.9, 0.9, 0.4]) };
    show_shape(&mut scene, Shape::Sphere { radius: 0.45 }, veil, moved(-2.3, 1.0, 0.6));
    let ring = Shape::Cylinder { radius: 0.15, half_height: 0.3 };
    show_shape(&mut scene, ring, lamp(6.0), place(DVec3::new(1.0, 1.6, 1.0), DVec3::new(1.8, 1.5, 0.2)));
    show(&mut scene, TriMesh::cuboid(Vec3::new(0.4, 0.0, -1.2), Vec3::new(1.4, 1.0, -0.4)), paint([0.8, 0.1, 0.1]));
    scene.spawn((Environment::constant(Vec3::new(0.1, 0.15, 0.2)),));
    look(&mut scene, DVec3::new(0.4, 1.9, 5.0), DVec3::new(0.0, 0.8, 0.0), 42.0);
    scene
}

/// The picture of the wavefront, of one path at a time, with one thread and with two, and with meshes and shapes in any
/// structure: the same bits.
#[test]
fn no_bit_depends_on_who_traces_a_shape() {
    let mut scene = varied();
    let mut renderer = Renderer::new();
    let report = renderer.sync(&mut scene);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let base = settings(40, 8);
    let want = renderer.render(&base, &()).picture;
    let lit = want.rgb.iter().filter(|rgb| rgb[0] > 0.01).count();
    assert!(lit > 1200, "{lit}");
    assert!(wavefront::render_one_path(renderer.scene(), &base, &()).picture.rgb == want.rgb, "one path");
    for variant in [
        RenderSettings { threads: 1, ..base.clone() },
        RenderSettings { threads: 2, tile_size: 7, ..base.clone() },
        RenderSettings { wave_size: 9, ..base.clone() },
        RenderSettings { sort: false, ..base.clone() },
    ] {
        assert!(renderer.render(&variant, &()).picture == want, "{variant:?}");
    }
    for kind in [AccelKind::Bvh2, AccelKind::Grid, AccelKind::KdTree, AccelKind::Brute] {
        renderer.accel = kind;
        renderer.sync(&mut scene);
        assert!(renderer.render(&base, &()).picture == want, "{kind:?}");
    }
}

fn quick(size: u32, spp: u32) -> RenderSettings {
    settings(size, spp)
}

/// A sphere that emits `L` inside and reflects ρ: L / (1 − ρ) in every pixel, and L (1 − ρⁿ) / (1 − ρ) after n surfaces.
/// An ellipsoid, which its transform mirrors, is as closed.
#[test]
fn a_shell_that_emits_shows_the_geometric_series() {
    let stretch = DMat3::from_quat(DQuat::from_rotation_x(0.5)) * DMat3::from_diagonal(DVec3::new(-1.5, 0.6, 1.0));
    for place in [DAffine3::IDENTITY, DAffine3::from_mat3_translation(stretch, DVec3::new(30.0, -20.0, 10.0))] {
        for (rho, depth) in [(0.0, 4), (0.5, 7), (0.8, 30)] {
            let mut scene = Scene::new();
            let material = Material { emissive: Vec3::splat(2.0), ..Material::lambert(Vec3::splat(rho)) };
            let material = Material { double_sided: true, ..material };
            show_shape(&mut scene, Shape::Sphere { radius: 1.0 }, material, place);
            let at = |p: DVec3| place.transform_point3(p);
            look(&mut scene, at(DVec3::new(0.3, 0.2, 0.1)), at(DVec3::new(-0.5, -0.5, 0.0)), 90.0);
            let settings = RenderSettings { max_depth: Some(depth), ..quick(8, 4096) };
            let got = mean(&picture(&mut scene, &settings))[0];
            let want = 2.0 * (1.0 - f64::from(rho).powi(depth as i32 + 1)) / (1.0 - f64::from(rho));
            assert!((got / want - 1.0).abs() < 2e-3, "albedo {rho}: {got}, want {want}");
        }
    }
}

/// Light of flux Φ at the middle of a sphere of albedo ρ: ρ/(1 − ρ) · Φ/(πA) everywhere, in every pixel, as the irradiance
/// is the same all over and each surface returns the share ρ of it evenly.
#[test]
fn a_sphere_with_a_light_in_its_middle_is_evenly_lit() {
    use wavecast::world::{PointLight, units::Candela};
    let mut scene = Scene::new();
    show_shape(
        &mut scene,
        Shape::Sphere { radius: 2.0 },
        Material { double_sided: true, ..Material::lambert(Vec3::splat(0.5)) },
        DAffine3::IDENTITY,
    );
    scene.spawn((PointLight { color: Vec3::ONE, intensity: Candela(10.0) }, LocalTransform::IDENTITY));
    look(&mut scene, DVec3::new(0.2, -0.4, 0.3), DVec3::new(1.0, 0.3, 0.4), 100.0);
    let want = 4.0 * 10.0 / (4.0 * PI * 4.0);
    let got = mean(&picture(&mut scene, &quick(8, 4096)))[0];
    assert!((got / want - 1.0).abs() < 1e-3, "{got} {want}");
    // Without interreflection it is known exactly, up to the rounding of the point.
    let one = picture(&mut scene, &RenderSettings { max_depth: Some(1), ..quick(16, 4) });
    for rgb in &one.picture.rgb {
        assert!((f64::from(rgb[0]) / (0.5 * want) - 1.0).abs() < 1e-5, "{rgb:?} {want}");
    }
}

/// White diffuse shapes reflect what they hide of a uniform sky, and clear glass shows it: in every pixel.
#[test]
fn white_shapes_and_clear_glass_vanish_in_a_uniform_sky() {
    let radiance = Vec3::new(0.8, 0.5, 0.3);
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 0.4, -0.3).normalize(), 0.8);
    let place = DAffine3::from_scale_rotation_translation(DVec3::new(0.9, 0.5, -0.7), turn, DVec3::new(0.2, 0.1, 3.0));
    let white = Material { double_sided: true, ..Material::lambert(Vec3::ONE) };
    let ball = Shape::Sphere { radius: 1.0 };
    let cases = [
        (ball, white.clone(), 16),
        (Shape::Disc { radius: 1.0 }, white.clone(), 16),
        (Shape::Plane, white.clone(), 16),
        (ball, Material::glass(1.5), 64),
        (ball, Material::glass(2.4), 64),
        (ball, Material { thickness: 0.0, ..Material::glass(1.5) }, 64),
        (ball, Material { roughness: 0.0, ..Material::default() }, 16),
    ];
    for (shape, material, spp) in cases {
        // Of glass not the rim, where light goes around inside until roulette has its say.
        let degrees = if material.transmission > 0.0 { 5.0 } else { 25.0 };
        for place in [DAffine3::from_translation(DVec3::Z * 3.0), place] {
            let mut scene = Scene::new();
            show_shape(&mut scene, shape, material.clone(), place);
            scene.spawn((Environment::constant(radiance),));
            look(&mut scene, DVec3::new(0.3, 2.5, 8.0), DVec3::new(0.2, 0.1, 3.0), degrees);
            let rendered = picture(&mut scene, &quick(24, spp));
            let off = |rgb: &&[f32; 3]| (Vec3::from(**rgb) / radiance - 1.0).abs().max_element() > 1e-4;
            let pixels: Vec<_> = rendered.picture.rgb.iter().filter(off).collect();
            assert!(pixels.len() <= 1, "{shape:?}, transmission {}: {pixels:?}", material.transmission);
        }
    }
}

/// A diffuse floor of albedo 0.75 seen at the origin, for light from above.
fn floor(scene: &mut Scene) {
    show_shape(scene, Shape::Plane, Material::lambert(Vec3::splat(0.75)), DAffine3::IDENTITY);
    look(scene, DVec3::new(-1.5, 2.0, 1.0), DVec3::ZERO, 0.02);
}

/// Black, and emits from its front.
fn black_lamp(radiance: f32) -> Material {
    Material {
        base_color: Vec3::ZERO,
        specular: 0.0,
        metallic: 0.0,
        emissive: Vec3::splat(radiance),
        ..Material::default()
    }
}

/// Irradiance at the origin, by the lit floor's luminance, of a shape that shines with 3 nit, by both strategies: what
/// light sampling and scattering find, weighed against each other.
#[track_caller]
fn check_irradiance(name: &str, shape: Shape, place: DAffine3, want: f64) {
    let mut scene = Scene::new();
    floor(&mut scene);
    show_shape(&mut scene, shape, black_lamp(3.0), place);
    let got = mean(&picture(&mut scene, &RenderSettings { max_depth: Some(1), ..quick(4, 65_536) }))[0];
    let want = 0.75 / PI * 3.0 * want;
    assert!((got / want - 1.0).abs() < 1e-3, "{name}: {got}, want {want}");
}

/// E = πL (R/d)² cosθ of a sphere that is all above the horizon; E = πL sin²θ of a disc whose rim is at the angle θ from the
/// zenith above; E = πL c/√(tan²… ) of what is known of an ellipsoid: that it is seen as a sphere is, where space is
/// scaled evenly, so that a sphere of half the radius scaled by two is the same.
#[test]
fn shapes_that_shine_light_a_floor_as_formulas_say() {
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    for (p, radius) in [(at(0.5, 1.5), 0.75_f32), (at(0.0, 2.0), 0.5), (at(3.0, 1.0), 0.9)] {
        let sine = f64::from(radius) / p.length();
        let want = PI * sine * sine * p.y / p.length();
        let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 1.0);
        check_irradiance("sphere", Shape::Sphere { radius }, DAffine3::from_translation(p), want);
        let doubled = DAffine3::from_scale_rotation_translation(DVec3::new(2.0, 2.0, -2.0), turn, p);
        check_irradiance("sphere, scaled", Shape::Sphere { radius: 0.5 * radius }, doubled, want);
    }
    for (height, radius) in [(1.0, 1.0_f32), (0.5, 2.0), (2.0, 0.3)] {
        let sine2 = f64::from(radius).powi(2) / (f64::from(radius).powi(2) + height * height);
        let down = DAffine3::from_rotation_translation(DQuat::from_rotation_x(PI), at(0.0, height));
        check_irradiance("disc", Shape::Disc { radius }, down, PI * sine2);
        // A half of the height mirrored upside down.
        let mirrored =
            DAffine3::from_scale_rotation_translation(DVec3::new(2.0, -1.0, 2.0), DQuat::IDENTITY, at(0.0, height));
        check_irradiance("disc, mirrored", Shape::Disc { radius: 0.5 * radius }, mirrored, PI * sine2);
    }
}

/// Shape and finely divided mesh of the same surface.
fn twins() -> [(Shape, TriMesh); 3] {
    let segments = 512;
    let mut tube = TriMesh::default();
    for i in 0..=segments {
        let phi = 2.0 * PI * f64::from(i % segments) / f64::from(segments);
        let n = Vec3::new(phi.cos() as f32, 0.0, phi.sin() as f32);
        for y in [0.75, -0.75] {
            tube.positions.push(0.5 * n + Vec3::Y * y);
            tube.normals.push(n);
        }
    }
    tube.uvs =
        vec![(0..=segments).flat_map(|i| [0.0, 1.0].map(|v| glam::Vec2::new(i as f32 / segments as f32, v))).collect()];
    tube.triangles =
        (0..segments).flat_map(|i| [[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]]).collect();
    let mut disc = TriMesh::disc(Vec3::ZERO, 0.8, segments);
    disc.uvs = vec![disc.positions.iter().map(|p| 0.5 + 0.5 * glam::Vec2::new(p.x, p.z) / 0.8).collect()];
    [
        (Shape::Sphere { radius: 0.7 }, TriMesh::sphere(Vec3::ZERO, 0.7, 192)),
        (Shape::Cylinder { radius: 0.5, half_height: 0.75 }, tube),
        (Shape::Disc { radius: 0.8 }, disc),
    ]
}

/// Where a shape and its mesh are placed: moved, turned and stretched, mirrored.
fn places() -> [DAffine3; 3] {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 0.4, -0.3).normalize(), 0.8);
    let at = DVec3::new(0.1, 1.0, 0.2);
    [
        DAffine3::from_translation(at),
        DAffine3::from_scale_rotation_translation(DVec3::new(1.3, 0.6, 0.9), turn, at),
        DAffine3::from_scale_rotation_translation(DVec3::new(-1.0, 0.8, 1.2), turn, at),
    ]
}

fn with_mesh(scene: &mut Scene, mesh: &TriMesh, material: Material, place: DAffine3) -> SceneKey {
    let (key, _) = show(scene, mesh.clone(), material);
    scene.insert(key, LocalTransform::Matrix(place));
    key
}

/// What is seen of a shape and of its fine mesh: the layers of first hits agree but along outlines and seams.
#[test]
fn shapes_are_seen_as_their_fine_meshes_are() {
    use LayerKind::{Albedo, Depth, EntityId, Normal, Position, Uv};
    let kinds = [Depth, Normal, Position, Uv, Albedo, EntityId];
    for (shape, mesh) in twins() {
        for place in places() {
            let material = || Material { double_sided: true, base_color_texture: Some(map(16, 3)), ..paint([0.9; 3]) };
            let render = |as_shape: bool| -> Rendered {
                let mut scene = Scene::new();
                if as_shape {
                    show_shape(&mut scene, shape, material(), place);
                } else {
                    with_mesh(&mut scene, &mesh, material(), place);
                }
                look(&mut scene, DVec3::new(0.5, 2.0, 4.0), DVec3::new(0.1, 1.0, 0.2), 30.0);
                picture(&mut scene, &RenderSettings { layers: kinds.to_vec(), ..quick(64, 1) })
            };
            let [a, b] = [render(true), render(false)];
            let (layers, others) = (&a.picture.layers, &b.picture.layers);
            let (mut seen, mut alike) = (0, 0);
            for pixel in 0..64 * 64 {
                let value = |layers: &[Layer], i: usize| match &layers[i].data {
                    LayerData::Scalar(x) => Vec3::splat(x[pixel]),
                    LayerData::Uv(uv) => Vec3::new(uv[pixel][0], uv[pixel][1], 0.0),
                    LayerData::Rgb(v) | LayerData::Xyz(v) => Vec3::from(v[pixel]),
                    LayerData::Id(id) => Vec3::splat(id[pixel] as f32),
                };
                let there = value(layers, 0).x > 0.0 || value(others, 0).x > 0.0;
                seen += usize::from(there);
                let near = |i: usize, most: f32| (value(layers, i) - value(others, i)).abs().max_element() < most;
                alike += usize::from(
                    there && near(0, 2e-3) && near(1, 2e-3) && near(2, 2e-3) && near(3, 2e-3) && near(4, 0.05),
                );
            }
            assert!(seen > 250 && alike * 100 >= seen * 97, "{shape:?} {place:?}: {alike} of {seen}");
        }
    }
}

/// The light of a shape that shines, textured and one- or two-sided, on what is around it is that of its fine mesh.
#[test]
fn shapes_shine_as_their_fine_meshes_do() {
    for (shape, mesh) in twins() {
        for (place, two_sided) in places().into_iter().zip([false, true, false]) {
            let light = || Material { double_sided: two_sided, emissive_texture: Some(map(8, 5)), ..black_lamp(3.0) };
            let render = |as_shape: bool| {
                let mut scene = Scene::new();
                let ground = TriMesh::quad(Vec3::new(-4.0, -0.2, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 8.0);
                show(&mut scene, ground, Material::lambert(Vec3::splat(0.8)));
                let wall = TriMesh::quad(Vec3::new(-4.0, -0.2, -2.0), Vec3::X * 8.0, Vec3::Y * 4.0);
                show(&mut scene, wall, paint([0.8, 0.7, 0.6]));
                if as_shape {
                    show_shape(&mut scene, shape, light(), place);
                } else {
                    with_mesh(&mut scene, &mesh, light(), place);
                }
                look(&mut scene, DVec3::new(0.5, 2.0, 5.0), DVec3::new(0.1, 0.8, 0.0), 40.0);
                mean(&picture(&mut scene, &RenderSettings { max_depth: Some(2), ..quick(32, 1024) }))
            };
            let [a, b] = [render(true), render(false)];
            for channel in 0..3 {
                assert!((a[channel] / b[channel] - 1.0).abs() < 5e-3, "{shape:?} {place:?}: {a:?} {b:?}");
            }
        }
    }
}

/// Of a white sphere of coverage a, black behind, in a white furnace: a ray past the middle or by the rim meets front and
/// back each with probability a, though both be on one face of it. What is met reflects all that it sees, so that with
/// black paint the pixel shows (1 − a)² of the sky.
#[test]
fn front_and_back_of_a_shape_are_there_independently() {
    for (alpha, aside) in [(0.5, 0.0), (0.5, 0.98), (0.25, 0.98)] {
        let mut scene = Scene::new();
        let veil = Material {
            alpha_mode: AlphaMode::Blend,
            base_alpha: alpha,
            double_sided: true,
            ..Material::lambert(Vec3::ZERO)
        };
        show_shape(&mut scene, Shape::Sphere { radius: 1.0 }, veil, DAffine3::IDENTITY);
        scene.spawn((Environment::constant(Vec3::ONE),));
        look(&mut scene, DVec3::new(aside, 0.0, 50.0), DVec3::new(aside, 0.0, 0.0), 0.01);
        let got = mean(&picture(&mut scene, &quick(16, 1024)))[0];
        let want = f64::from(1.0 - alpha).powi(2);
        // Five standard deviations of so many tosses.
        let deviation = (want * (1.0 - want) / (16.0 * 16.0 * 1024.0)).sqrt();
        assert!((got - want).abs() < 5.0 * deviation, "{alpha} {aside}: {got}, want {want}");
    }
}

/// A shape whose component gives its radiance shines like one whose material does; a flux gives the luminance by its area.
#[test]
fn an_emissive_surface_may_be_a_shape() {
    let shape = Shape::Cylinder { radius: 0.5, half_height: 0.75 };
    let luminance = Lumens(600.0).over_area(shape.area() as f32).0;
    assert!((f64::from(luminance) * PI * 2.0 * PI * 0.5 * 1.5 - 600.0).abs() < 1e-3);
    let render = |by_component: bool| {
        let mut scene = Scene::new();
        floor(&mut scene);
        let material = if by_component { black_lamp(0.0) } else { black_lamp(luminance) };
        let (key, _) = show_shape(&mut scene, shape, material, DAffine3::from_translation(DVec3::new(0.7, 2.0, 0.2)));
        if by_component {
            scene.insert(key, EmissiveSurface { radiance: Vec3::splat(luminance) });
        }
        picture(&mut scene, &quick(8, 64)).picture.rgb
    };
    let (lit, same) = (render(true), render(false));
    assert!(lit[0][0] > 0.1 && lit == same, "{:?} {:?}", lit[0], same[0]);
}

/// A plane that shines is found by scattered rays: E = πL on a floor below one. It is a light, so that no sky is put in,
/// and no light that is sampled.
#[test]
fn a_plane_that_shines_is_found_by_scattering_alone() {
    let mut scene = Scene::new();
    floor(&mut scene);
    let down = DAffine3::from_rotation_translation(DQuat::from_rotation_x(PI), DVec3::Y * 3.0);
    show_shape(&mut scene, Shape::Plane, black_lamp(3.0), down);
    let mut renderer = Renderer::new();
    assert_eq!(renderer.sync(&mut scene).warnings, [] as [&str; 0]);
    let flat = renderer.scene();
    assert!(flat.lights.choice.is_empty() && !flat.lights.default_sky && flat.radius == 0.0);
    assert!(flat.light_rows.iter().all(|&row| row == NONE));
    let rendered = renderer.render(&RenderSettings { max_depth: Some(1), ..quick(4, 256) }, &());
    let got = mean(&rendered)[0];
    assert!((got / (0.75 * 3.0) - 1.0).abs() < 1e-4, "{got}");
}

/// Wrong sizes and two forms at once are told of.
#[test]
fn what_cannot_be_shown_is_warned_of() {
    let mut scene = Scene::new();
    let (bad, _) = show_shape(&mut scene, Shape::Sphere { radius: f32::NAN }, paint([0.5; 3]), DAffine3::IDENTITY);
    let (both, _) = show(&mut scene, TriMesh::cuboid(-Vec3::ONE, Vec3::ONE), paint([0.5; 3]));
    scene.insert(both, Shape::Sphere { radius: 0.5 });
    let mut renderer = Renderer::new();
    let warnings = renderer.sync(&mut scene).warnings;
    assert_eq!(warnings.len(), 2, "{warnings:?}");
    assert!(warnings[0].contains(&format!("entity {} ", both.0)) && warnings[0].contains("the shape is shown"));
    assert!(warnings[1].contains(&format!("entity {} ", bad.0)) && warnings[1].contains("radius"));
    assert_eq!(renderer.scene().meshes.len(), 1);
    assert!(renderer.scene().meshes[0].shape.is_some());
}
