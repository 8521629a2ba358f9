//! Light from the emitters and light found by camera paths: what one of them leaves out the other brings.
//!
//! Each scene is made with light paths and without, by many seeds. Expected values must not differ: not over the picture, and
//! not over any of its blocks. Emitters and glass are large, so that paths from the camera find caustics too.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3, Vec3};
use rayon::prelude::*;
use wavecast::{
    measure::{
        statistics::{Moments, sidak},
        student::student_two_sided,
    },
    render::{PixelFilter, RenderSettings, Renderer, Sharing},
    wavefront,
    world::{
        AlphaMode, Camera, Environment, EnvironmentMap, Geometry, Image, LocalTransform, Material, MaterialSlots,
        Projection, Scene, Sky, Texels, Texture, TriMesh,
    },
};

use crate::common::{look, settings, show, trials::scaled};

/// Blocks along an edge of a picture.
const BLOCKS: usize = 3;
const SEEDS: u64 = 24;

/// Mean of the picture, then of its blocks, all channels.
fn blocks(rgb: &[[f32; 3]], width: usize) -> Vec<f64> {
    let height = rgb.len() / width;
    let mut sums = vec![0.0; (BLOCKS * BLOCKS + 1) * 3];
    for (pixel, color) in rgb.iter().enumerate() {
        let (x, y) = (pixel % width, pixel / width);
        let block = 1 + y * BLOCKS / height * BLOCKS + x * BLOCKS / width;
        for (channel, value) in color.iter().enumerate() {
            sums[channel] += f64::from(*value) / rgb.len() as f64;
            sums[block * 3 + channel] += f64::from(*value) * (BLOCKS * BLOCKS) as f64 / rgb.len() as f64;
        }
    }
    sums
}

/// With light paths less without, over seeds: 0 within chance, at a level of one in a thousand over all blocks; that of the
/// picture by 0.3 % at most, beyond three standard errors.
#[track_caller]
fn check_same(name: &str, scene: &mut Scene, settings: &RenderSettings) {
    let mut renderer = Renderer::new();
    let report = renderer.sync(scene);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let pairs: Vec<[Vec<f64>; 2]> = (0..SEEDS)
        .into_par_iter()
        .map(|seed| {
            [true, false].map(|caustics| {
                let settings = RenderSettings { seed, caustics, threads: 1, ..settings.clone() };
                let rendered = renderer.render(&settings, &());
                assert_eq!(rendered.stats.discarded, []);
                let ran = rendered.stats.stages.iter().any(|stage| stage.name == "caustics");
                assert_eq!(ran, caustics, "{name}: light paths");
                blocks(&rendered.picture.rgb, rendered.picture.width)
            })
        })
        .collect();
    let count = pairs[0][0].len();
    let level = sidak(1e-3, count);
    let (mut failed, mut report) = (false, String::new());
    for i in 0..count {
        let difference: Moments = pairs.iter().map(|[with, without]| with[i] - without[i]).collect();
        let [with, without]: [Moments; 2] = [0, 1].map(|j: usize| pairs.iter().map(|pair| pair[j][i]).collect());
        let truth = without.mean;
        let error = difference.standard_error().hypot(1e-6 * truth);
        let p = student_two_sided(difference.mean / error, (SEEDS - 1) as f64);
        let far = i < 3 && difference.mean.abs() > 3e-3 * truth + 3.0 * error;
        let line = format!(
            "{name} {i:3}: {truth:9.5} {:+.3} % ± {:.3} %, p {p:.4}, variance {:.3} of without\n",
            100.0 * difference.mean / truth,
            100.0 * error / truth,
            with.variance() / without.variance(),
        );
        if i < 3 {
            report.push_str(&line);
        }
        if p < level || far {
            failed = true;
            report.push_str(&format!("FAILED {line}"));
        }
    }
    println!("{report}");
    assert!(!failed, "{report}");
}

fn small() -> RenderSettings {
    settings(18, scaled(256))
}

/// A floor, a back wall and a large lamp above, facing down.
fn room() -> Scene {
    let mut scene = Scene::new();
    let floor = TriMesh::quad(Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0);
    show(&mut scene, floor, Material::lambert(Vec3::new(0.7, 0.6, 0.5)));
    let wall = TriMesh::quad(Vec3::new(-2.0, 0.0, -2.0), Vec3::X * 4.0, Vec3::Y * 3.0);
    show(&mut scene, wall, Material::lambert(Vec3::new(0.4, 0.6, 0.7)));
    look(&mut scene, DVec3::new(0.3, 1.6, 4.5), DVec3::new(0.0, 0.6, 0.0), 40.0);
    scene
}

fn lamp() -> Material {
    Material { emissive: Vec3::new(3.0, 2.0, 1.0), ..Material::lambert(Vec3::splat(0.3)) }
}

fn with_lamp(mut scene: Scene) -> Scene {
    let mesh = TriMesh::quad(Vec3::new(-1.0, 2.5, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0);
    show(&mut scene, mesh, Material { double_sided: false, ..lamp() });
    scene
}

fn mirror(double_sided: bool) -> Material {
    Material { base_color: Vec3::new(0.9, 0.8, 0.6), roughness: 0.0, double_sided, ..Material::default() }
}

fn mirror_box() -> TriMesh {
    TriMesh::cuboid(Vec3::new(-0.6, 0.0, -0.9), Vec3::new(0.2, 1.2, -0.2))
}

#[test]
fn mirrors_light_what_they_face() {
    let mut scene = with_lamp(room());
    show(&mut scene, mirror_box(), mirror(false));
    check_same("mirror", &mut scene, &small());
}

/// What a sky with a sun of eight texels throws off metal, coated and clear things, smooth and less so; some of it through glass first.
#[test]
fn suns_light_what_shines_on_others() {
    let (width, height) = (64, 32);
    let mut texels = vec![[0.1, 0.15, 0.3]; width * height];
    // Large, so that camera paths find it often enough to be believed.
    for (row, column) in (8..10).flat_map(|row| (22..26).map(move |column| (row, column))) {
        texels[row * width + column] = [75.0, 70.0, 60.0];
    }
    let map = EnvironmentMap { name: "sun".to_owned(), width: width as u32, height: height as u32, texels };
    let metal = |roughness| Material { base_color: Vec3::new(0.9, 0.7, 0.5), roughness, ..Material::default() };
    let coated = Material { metallic: 0.0, base_color: Vec3::new(0.2, 0.5, 0.3), ..metal(0.3) };
    let ball = |x: f32, z: f32| TriMesh::sphere(Vec3::new(x, 0.5, z), 0.45, 12);
    let mut flat = ball(0.3, 0.5);
    flat.normals.clear();
    let mut scene = room();
    let sky = Sky::Map(Arc::new(map));
    scene.spawn((Environment { sky, rotation_degrees: 20.0, scale: 0.5 },));
    show(&mut scene, mirror_box(), metal(0.4));
    show(&mut scene, flat, metal(0.25));
    show(&mut scene, ball(1.2, -0.4), coated);
    show(&mut scene, ball(-1.1, 0.6), Material::glass(1.5));
    check_same("suns", &mut scene, &small());
    check_same("suns, shared", &mut scene, &RenderSettings { sharing: Sharing::Always, ..small() });
}

/// Facets and smooth normals; one solid within another; something dull inside.
#[test]
fn glass_absorbs_and_bends_light() {
    let glass =
        Material { attenuation_distance: 0.4, attenuation_color: Vec3::new(0.4, 0.8, 0.6), ..Material::glass(1.5) };
    let mut flat = TriMesh::sphere(Vec3::new(0.0, 0.75, 0.2), 0.7, 12);
    flat.normals.clear();
    let mut scene = with_lamp(room());
    show(&mut scene, flat, glass.clone());
    check_same("flat glass", &mut scene, &small());
    let mut scene = with_lamp(room());
    show(&mut scene, TriMesh::sphere(Vec3::new(0.0, 0.75, 0.2), 0.7, 9), glass.clone());
    check_same("smooth glass", &mut scene, &small());
    let mut scene = with_lamp(room());
    show(&mut scene, TriMesh::cuboid(Vec3::new(-1.2, 0.01, -0.8), Vec3::new(1.2, 1.2, 1.0)), glass.clone());
    let other = Material { attenuation_color: Vec3::new(0.9, 0.3, 0.3), ..Material::glass(1.3) };
    show(&mut scene, TriMesh::sphere(Vec3::new(-0.5, 0.6, 0.3), 0.4, 9), other);
    let dull = Material::lambert(Vec3::splat(0.8));
    show(&mut scene, TriMesh::cuboid(Vec3::new(0.2, 0.1, -0.2), Vec3::new(0.8, 0.6, 0.4)), dull);
    check_same("glass in glass", &mut scene, &small());
}

/// The coat is a mirror, what is under it is not: which of the two a path met decides.
#[test]
fn coats_share_their_surface_with_what_is_under_them() {
    let coated =
        Material { metallic: 0.0, roughness: 0.0, base_color: Vec3::new(0.8, 0.3, 0.2), ..Material::default() };
    let mut scene = with_lamp(room());
    show(&mut scene, mirror_box(), Material { ior: 2.5, ..coated.clone() });
    show(
        &mut scene,
        TriMesh::sphere(Vec3::new(0.9, 0.5, 0.5), 0.5, 8),
        Material { transmission: 0.5, thickness: 1.0, ..coated },
    );
    check_same("coats", &mut scene, &small());
}

/// Smooth normals lift rays off the facets and are bent where they face away; a glossy floor finds light better by itself.
#[test]
fn what_has_no_inverse_is_left_to_camera_paths() {
    let mut scene = with_lamp(room());
    show(&mut scene, TriMesh::sphere(Vec3::new(-0.4, 0.6, -0.2), 0.6, 5), mirror(false));
    show(&mut scene, TriMesh::sphere(Vec3::new(0.8, 0.5, 0.5), 0.5, 5), Material::lambert(Vec3::splat(0.8)));
    let glossy = Material { roughness: 0.25, ..mirror(true) };
    show(&mut scene, TriMesh::quad(Vec3::new(-1.5, 0.01, 1.5), Vec3::X * 1.4, Vec3::NEG_Z * 2.0), glossy);
    check_same("coarse", &mut scene, &small());
    check_same("coarse, no fix", &mut scene, &RenderSettings { terminator_fix: false, ..small() });
}

/// A pane, rough glass, veils and holes; a screen without a back between lamp and glass.
#[test]
fn light_goes_through_what_camera_paths_go_through() {
    let mut scene = with_lamp(room());
    let pane = Material { thickness: 0.0, base_color: Vec3::new(0.9, 0.7, 0.8), ..Material::glass(1.5) };
    show(&mut scene, TriMesh::quad(Vec3::new(-1.4, 1.3, -1.2), Vec3::X * 1.6, Vec3::Z * 1.6), pane);
    show(&mut scene, mirror_box(), mirror(true));
    let rough = Material { roughness: 0.3, ..Material::glass(1.5) };
    show(&mut scene, TriMesh::sphere(Vec3::new(1.0, 0.5, 0.6), 0.45, 8), rough);
    let veil = |alpha_mode, base_alpha| Material { alpha_mode, base_alpha, ..Material::lambert(Vec3::splat(0.6)) };
    let blend = veil(AlphaMode::Blend, 0.4);
    show(&mut scene, TriMesh::quad(Vec3::new(-1.6, 0.5, 0.9), Vec3::X * 1.6, Vec3::Y * 0.7), blend.clone());
    show(
        &mut scene,
        TriMesh::quad(Vec3::new(-0.9, 1.8, -0.9), Vec3::X * 1.2, Vec3::Z * 0.9),
        Material { double_sided: false, ..blend },
    );
    check_same("pane and veils", &mut scene, &small());

    let mut scene = with_lamp(room());
    show(&mut scene, mirror_box(), mirror(false));
    let screen = |facing_up: bool, x: f32, y: f32| {
        let (u, v) = if facing_up { (Vec3::Z, Vec3::X) } else { (Vec3::X, Vec3::Z) };
        TriMesh::quad(Vec3::new(x, y, -1.0), u * 1.3, v * 1.3)
    };
    let dull = Material { double_sided: false, ..Material::lambert(Vec3::splat(0.7)) };
    show(&mut scene, screen(true, -1.0, 1.7), dull.clone());
    show(&mut scene, screen(false, 0.0, 1.4), dull.clone());
    let side = TriMesh::quad(Vec3::new(0.9, 0.0, -1.0), Vec3::Z * 2.0, Vec3::Y * 1.2);
    show(&mut scene, side, dull);
    check_same("no backs", &mut scene, &small());
}

#[test]
fn emitters_have_textures_and_two_sides() {
    let texels = Texels::Rgba8(vec![[255, 40, 0, 255], [0, 0, 0, 255], [20, 255, 90, 255], [200; 4]]);
    let image = Arc::new(Image { name: "lamp".to_owned(), width: 2, height: 2, texels });
    let mut scene = room();
    let textured = Material { emissive_texture: Some(Texture::new(image)), ..lamp() };
    let mesh = TriMesh::quad(Vec3::new(-1.2, 1.8, -1.2), Vec3::X * 1.6, Vec3::Z * 2.0);
    show(&mut scene, mesh, textured);
    let lone = TriMesh::new(
        vec![Vec3::new(1.0, 1.0, 0.0), Vec3::new(1.4, 1.9, 0.2), Vec3::new(0.8, 1.5, 0.6)],
        vec![[0, 1, 2]],
    );
    show(&mut scene, lone, Material { double_sided: false, ..lamp() });
    let veiled = Material { alpha_mode: AlphaMode::Blend, base_alpha: 0.5, ..lamp() };
    show(&mut scene, TriMesh::quad(Vec3::new(-1.6, 0.3, -0.8), Vec3::Z * 1.2, Vec3::Y * 0.8), veiled);
    show(&mut scene, TriMesh::quad(Vec3::new(-1.5, 2.6, -1.5), Vec3::X * 3.0, Vec3::Z * 3.0), mirror(true));
    show(&mut scene, mirror_box(), mirror(false));
    check_same("emitters", &mut scene, &small());
}

/// Placed, stretched and mirrored; two materials in a mesh.
#[test]
fn instances_are_aimed_at_where_they_are() {
    let mut scene = with_lamp(room());
    let mut mesh = mirror_box();
    mesh.slots = (0..mesh.triangles.len()).map(|triangle| u16::from(triangle % 4 < 2)).collect();
    let keys = [mirror(false), Material::lambert(Vec3::splat(0.5))].map(|material| scene.spawn((material,)));
    let mesh = Arc::new(mesh);
    for (scale, at) in
        [(DVec3::new(0.8, 1.0, -0.7), DVec3::new(0.9, 0.1, 0.2)), (DVec3::ONE, DVec3::new(-0.5, 0.0, 0.1))]
    {
        let place = DAffine3::from_scale_rotation_translation(scale, DQuat::from_rotation_y(0.5), at);
        scene.spawn((Geometry(Arc::clone(&mesh)), MaterialSlots(keys.to_vec().into()), LocalTransform::Matrix(place)));
    }
    check_same("instances", &mut scene, &small());
}

#[test]
fn cameras_and_filters_see_the_same() {
    let scene = || {
        let mut scene = with_lamp(room());
        show(&mut scene, mirror_box(), mirror(false));
        scene
    };
    let wide = RenderSettings { width: 31, height: 22, ..small() };
    for filter in [PixelFilter::Gaussian, PixelFilter::BlackmanHarris] {
        check_same("filter", &mut scene(), &RenderSettings { filter, ..small() });
    }
    check_same(
        "crop",
        &mut scene(),
        &RenderSettings { crop: Some([12, 9, 17, 11]), filter: PixelFilter::Gaussian, ..wide },
    );
    let mut flat = scene();
    for key in flat.keys_with::<Camera>() {
        let projection = Projection::Orthographic { xmag: 1.4, ymag: 1.2 };
        flat.insert(key, Camera { projection, znear: 3.1, zfar: 5.9 });
    }
    check_same("orthographic", &mut flat, &small());
    for max_depth in [2, 3] {
        check_same("depth", &mut scene(), &RenderSettings { max_depth: Some(max_depth), ..small() });
    }
}

/// Threads, tiles, waves and ranges of samples; and one path at a time.
#[test]
fn light_paths_give_the_same_bits_however_the_work_is_cut() {
    let mut scene = with_lamp(room());
    show(&mut scene, mirror_box(), mirror(false));
    let mut renderer = Renderer::new();
    renderer.sync(&mut scene);
    let base = RenderSettings { filter: PixelFilter::Gaussian, ..settings(40, 6) };
    let want = renderer.render(&base, &()).picture;
    assert!(want.rgb != renderer.render(&RenderSettings { caustics: false, ..base.clone() }, &()).picture.rgb);
    for variant in [
        RenderSettings { threads: 1, wave_size: 7, ..base.clone() },
        RenderSettings { threads: 7, tile_size: 5, ..base.clone() },
        RenderSettings { sort: false, wave_size: 5000, ..base.clone() },
        RenderSettings { spp: None, samples: Some(0..6), ..base.clone() },
    ] {
        assert!(renderer.render(&variant, &()).picture == want, "{variant:?}");
    }
    assert!(wavefront::render_one_path(renderer.scene(), &base, &()).picture == want);
    let [x, y, w, h] = [13, 7, 20, 11];
    let crop = renderer.render(&RenderSettings { crop: Some([x, y, w, h]), ..base.clone() }, &()).picture;
    for row in 0..h as usize {
        let start = (y as usize + row) * 40 + x as usize;
        assert_eq!(want.rgb[start..start + w as usize], crop.rgb[row * w as usize..(row + 1) * w as usize]);
    }
}
