//! Light in parts: layers by scatterings and by light add up to the picture, and each has what it says.

use std::collections::HashMap;

use rayon::prelude::*;
use wavecast::{
    film::{LayerData, PathLayer, Picture, Split},
    measure::{
        statistics::sidak,
        student::{Estimate, student_two_sided},
    },
    reference::{self, Lobe, ReferenceSettings},
    render::{Integrator, LayerKind, RenderSettings, Renderer, Sharing, name_lights},
    world::{Environment, Material, Name, PointLight, Scene},
};

use crate::common::{asset, load_scene, look, root, settings, show, trials::scaled, varied};

const SPLITS: [Split; 5] =
    [Split::Bounces, Split::Lights, Split::Direct, Split::LightsByBounces, Split::LightsByDirect];
/// A right renderer fails a check with this probability.
const FALSE_ALARM: f64 = 1e-4;
/// Pictures of each kind.
const SEEDS: u64 = 16;

fn rgb<'a>(picture: &'a Picture, name: &str) -> &'a [[f32; 3]] {
    match picture.layers.iter().find(|layer| layer.name == name).map(|layer| &layer.data) {
        Some(LayerData::Rgb(values)) => values,
        other => panic!("{name}: {other:?}"),
    }
}

/// Names of the layers of light, by what tells them apart.
fn groups(picture: &Picture) -> HashMap<&'static str, Vec<&str>> {
    let mut groups: HashMap<_, Vec<&str>> = HashMap::new();
    for name in picture.layers.iter().map(|layer| layer.name.as_str()).filter(|name| !name.ends_with(".error")) {
        let of_light = name.starts_with("light.");
        let last = name.rsplit('.').next().unwrap_or(name);
        let kind = match (of_light, last.starts_with("bounce"), ["direct", "indirect"].contains(&last)) {
            (false, true, _) => "bounces",
            (false, _, _) => "direct",
            (true, true, _) => "lights by bounces",
            (true, _, true) => "lights by direct",
            (true, ..) => "lights",
        };
        groups.entry(kind).or_default().push(name);
    }
    groups
}

/// Of real scenes with sky, textures, many lights, glass and thousands of triangles, the files' numbers add up but for the
/// rounding of each to 24 bits.
#[test]
fn layers_add_up_to_the_picture_to_rounding() {
    let mut files: Vec<_> =
        ["caustic.glb", "plates.gltf", "lights.glb"].iter().map(|name| root().join("scenes").join(name)).collect();
    files.extend(
        ["Sponza/Sponza.glb", "CornellBox/CornellBox.glb", "DamagedHelmet/glTF-Binary/DamagedHelmet.glb"]
            .into_iter()
            .filter_map(asset),
    );
    for file in files {
        let mut scene = load_scene(&file);
        let mut renderer = Renderer::new();
        renderer.sync(&mut scene);
        // Two thousand lights have two thousand layers.
        let many = renderer.scene().lights.triangles.len() > 100;
        let splits = if many { vec![Split::Bounces, Split::Direct, Split::Lights] } else { SPLITS.to_vec() };
        let plain = RenderSettings { width: 24, height: 16, spp: Some(8), ..RenderSettings::default() };
        let layers = splits.iter().map(|&split| LayerKind::Light(split)).collect();
        let mut rendered = renderer.render(&RenderSettings { layers, ..plain.clone() }, &());
        name_lights(&mut rendered, &scene);
        let picture = rendered.picture;
        assert_eq!(picture.rgb, renderer.render(&plain, &()).picture.rgb, "{}", file.display());
        let groups = groups(&picture);
        assert_eq!(groups.len(), splits.len(), "{groups:?}");
        for (kind, names) in groups {
            let layers: Vec<_> = names.iter().map(|name| rgb(&picture, name)).collect();
            for (i, want) in picture.rgb.iter().enumerate() {
                for c in 0..3 {
                    let sum: f64 = layers.iter().map(|layer| f64::from(layer[i][c])).sum();
                    let off = (sum - f64::from(want[c])).abs();
                    // Each is rounded once, and the picture as well.
                    let most = (names.len() + 1) as f64 * (2.0_f64).powi(-24) * f64::from(want[c]);
                    assert!(off <= most, "{} {kind} pixel {i}: {sum} {}", file.display(), want[c]);
                }
            }
        }
    }
}

/// Means of a picture's squares of a quarter of its edge, without the worst of the noise that single pixels have.
fn squares(values: &[[f32; 3]], size: usize) -> Vec<f64> {
    let edge = size / 4;
    let mut means = vec![0.0; 16];
    for (i, rgb) in values.iter().enumerate() {
        let (x, y) = (i % size / edge, i / size / edge);
        means[4 * y + x] += rgb.iter().map(|&c| f64::from(c)).sum::<f64>() / (3 * edge * edge) as f64;
    }
    means
}

/// Means of squares, by picture.
type Pictures = Vec<Vec<f64>>;

/// Holds estimates against each other as one family.
#[track_caller]
fn check(what: &str, pairs: &[(String, Pictures, Pictures)]) {
    let level = sidak(FALSE_ALARM, pairs.len() * 16);
    let mut worst = (1.0, String::new());
    for (name, got, want) in pairs {
        for square in 0..16 {
            let of = |pictures: &[Vec<f64>]| Estimate::of(pictures.iter().map(|squares| squares[square]));
            let (got, want) = (of(got), of(want));
            let off = got.minus(want);
            // Where both are black there is nothing to compare.
            if off.variance == 0.0 {
                assert!(off.value.abs() < 1e-9, "{what} {name} square {square}: {got:?} {want:?}");
                continue;
            }
            let p = student_two_sided(off.value / off.variance.sqrt(), off.dof);
            if p < worst.0 {
                worst = (p, format!("{name} square {square}: {} against {}", got.value, want.value));
            }
        }
    }
    println!("{what}: least p of {} is {:.2e} ({level:.2e} would fail), {}", pairs.len() * 16, worst.0, worst.1);
    assert!(worst.0 >= level, "{what}: {worst:?}, {level}");
}

fn pictures(renderer: &Renderer, settings: &RenderSettings, first_seed: u64) -> Vec<Picture> {
    let of_seed = |seed| RenderSettings { seed: first_seed + seed, threads: 1, ..settings.clone() };
    (0..SEEDS).into_par_iter().map(|seed| renderer.render(&of_seed(seed), &()).picture).collect()
}

/// The light with n scatterings behind it is what one more scattering adds to a picture whose paths are cut off.
#[test]
fn each_bounce_is_what_one_more_scattering_brings() {
    const SIZE: u32 = 32;
    for (name, mut scene) in [
        ("varied", varied()),
        ("cornell", load_scene(&root().join("scenes/cornell.gltf"))),
        ("plates", load_scene(&root().join("scenes/plates.gltf"))),
        ("caustic", load_scene(&root().join("scenes/caustic.glb"))),
    ] {
        let mut renderer = Renderer::new();
        renderer.sync(&mut scene);
        for sharing in [Sharing::Always, Sharing::Off] {
            let plain = RenderSettings { sharing, ..settings(SIZE, scaled(32)) };
            let layers = vec![LayerKind::Light(Split::Bounces)];
            let all = pictures(&renderer, &RenderSettings { layers, ..plain.clone() }, 0);
            let cut = |depth: u32| {
                let settings = RenderSettings { max_depth: Some(depth), ..plain.clone() };
                let of = pictures(&renderer, &settings, 1000 * u64::from(depth + 1));
                of.iter().map(|picture| squares(&picture.rgb, SIZE as usize)).collect::<Vec<_>>()
            };
            let mut before = vec![vec![0.0; 16]; SEEDS as usize];
            let mut pairs = Vec::new();
            for depth in 0..5 {
                let now = cut(depth);
                let difference = |(now, before): (&Vec<f64>, &Vec<f64>)| {
                    now.iter().zip(before).map(|(now, before)| now - before).collect::<Vec<_>>()
                };
                let layer = format!("bounce{depth:02}");
                let got = all.iter().map(|picture| squares(rgb(picture, &layer), SIZE as usize)).collect();
                pairs.push((layer, got, now.iter().zip(&before).map(difference).collect()));
                before = now;
            }
            check(&format!("{name}, sharing {sharing:?}"), &pairs);
        }
    }
}

/// The layer of a light is the picture of the scene in which it is the only one.
#[test]
fn each_light_is_what_it_brings_alone() {
    const SIZE: u32 = 32;
    let put_out = |scene: &mut Scene, keep: &str| {
        for key in scene.keys_with::<PointLight>().into_iter().filter(|_| keep != "point") {
            scene.despawn(key);
        }
        for key in scene.keys_with::<Environment>().into_iter().filter(|_| keep != "sky") {
            scene.despawn(key);
        }
        for key in scene.keys_with::<Material>().into_iter().filter(|_| keep != "lamp") {
            let material: Material = scene.get(key).expect("it has one");
            scene.insert(key, Material { emissive: glam::Vec3::ZERO, ..material });
        }
    };
    let mut scene = varied();
    let keys = [
        ("lamp", scene.keys_with::<wavecast::world::Geometry>()[1]),
        ("point", scene.keys_with::<PointLight>()[0]),
        ("sky", scene.keys_with::<Environment>()[0]),
    ];
    let mut renderer = Renderer::new();
    renderer.sync(&mut scene);
    for sharing in [Sharing::Always, Sharing::Off] {
        let plain = RenderSettings { sharing, ..settings(SIZE, scaled(32)) };
        let layers = [Split::Lights, Split::LightsByDirect].map(LayerKind::Light).to_vec();
        let all = pictures(&renderer, &RenderSettings { layers, ..plain.clone() }, 0);
        let mut pairs = Vec::new();
        for (number, (name, key)) in keys.iter().enumerate() {
            let mut alone = varied();
            put_out(&mut alone, name);
            let mut renderer = Renderer::new();
            renderer.sync(&mut alone);
            for (part, max_depth) in [("", None), (".direct", Some(1))] {
                let first_seed = 1000 + 100 * number as u64 + part.len() as u64;
                let want = pictures(&renderer, &RenderSettings { max_depth, ..plain.clone() }, first_seed);
                let label = if *name == "sky" { "sky".to_owned() } else { key.0.to_string() };
                let layer = format!("light.{label}{part}");
                let of = |values: &[[f32; 3]]| squares(values, SIZE as usize);
                pairs.push((
                    format!("{name}{part}"),
                    all.iter().map(|picture| of(rgb(picture, &layer))).collect(),
                    want.iter().map(|picture| of(&picture.rgb)).collect(),
                ));
            }
        }
        check(&format!("lights, sharing {sharing:?}"), &pairs);
    }
}

/// What happened to light is what a reference says, in which only certain lobes scatter at the first surfaces: with a coat on
/// all that is matt, so that near and far vertices divide their light, with metal and glass, from surfaces, a lamp and the sky.
#[test]
fn paths_are_what_a_reference_with_only_these_lobes_says() {
    const SIZE: u32 = 24;
    let mut scene = varied();
    for key in scene.keys_with::<Material>() {
        let material: Material = scene.get(key).expect("it has one");
        if material.specular == 0.0 {
            let coated = Material { specular: 1.0, roughness: 0.5, ..material };
            scene.insert(key, coated);
        }
    }
    let mut renderer = Renderer::new();
    renderer.sync(&mut scene);
    use wavecast::reference::Lobe::{Diffuse, Rough, Singular};
    let kinds: [(&str, &str, &[Lobe]); 8] = [
        ("D", "C([LB]|<RD>.*[LB])", &[Diffuse]),
        ("G", "C([LB]|<.G>.*[LB])", &[Rough]),
        ("S", "C([LB]|S.*[LB])", &[Singular]),
        ("DD", "C([LB]|D([LB]|D.*[LB]))", &[Diffuse, Diffuse]),
        ("DG", "C([LB]|D([LB]|G.*[LB]))", &[Diffuse, Rough]),
        ("GD", "C([LB]|G([LB]|D.*[LB]))", &[Rough, Diffuse]),
        ("GG", "C([LB]|G([LB]|G.*[LB]))", &[Rough, Rough]),
        ("DSS", "C([LB]|D([LB]|S([LB]|S.*[LB])))", &[Diffuse, Singular, Singular]),
    ];
    let references: Vec<Pictures> = kinds
        .iter()
        .map(|(_, _, lobes)| {
            let picture = |seed| {
                let settings = ReferenceSettings {
                    width: SIZE,
                    height: SIZE,
                    spp: scaled(64),
                    seed: 77 + seed,
                    filter: wavecast::render::PixelFilter::Box,
                    lobes: lobes.to_vec(),
                    ..ReferenceSettings::default()
                };
                let rgb = reference::render(renderer.scene(), &settings).rgb;
                squares(&rgb.iter().map(|rgb| rgb.as_vec3().to_array()).collect::<Vec<_>>(), SIZE as usize)
            };
            (0..SEEDS).map(picture).collect()
        })
        .collect();
    for sharing in [Sharing::Always, Sharing::Off] {
        let paths = kinds.map(|(name, text, _)| PathLayer {
            name: name.into(),
            expression: text.parse().unwrap_or_else(|error| panic!("{error}")),
        });
        let layers = vec![LayerKind::Light(Split::Paths)];
        let plain = RenderSettings { sharing, layers, paths: paths.to_vec(), ..settings(SIZE, scaled(32)) };
        let all = pictures(&renderer, &plain, 0);
        let pairs: Vec<_> = kinds
            .iter()
            .zip(&references)
            .map(|((name, ..), want)| {
                let got = all.iter().map(|picture| squares(rgb(picture, name), SIZE as usize)).collect();
                ((*name).to_owned(), got, want.clone())
            })
            .collect();
        check(&format!("paths, sharing {sharing:?}"), &pairs);
    }
}

/// A mirror reflects and a pane transmits; by the lobes of the first surface and by expressions.
#[test]
fn what_is_reflected_and_what_is_let_through_are_told_apart() {
    let mirror = Material { roughness: 0.0, ..Material::default() };
    let pane = Material { thickness: 0.0, specular: 0.0, ..Material::glass(1.5) };
    let frosted = Material { roughness: 0.5, ..pane.clone() };
    let metal = Material { roughness: 0.5, ..Material::default() };
    let all = ["RS", "RG", "TS", "TG"];
    for (material, own) in [(mirror, "RS"), (metal, "RG"), (pane, "TS"), (frosted, "TG")] {
        let mut scene = Scene::new();
        let quad = wavecast::world::TriMesh::quad(
            glam::Vec3::new(-9.0, -9.0, 0.0),
            18.0 * glam::Vec3::X,
            18.0 * glam::Vec3::Y,
        );
        show(&mut scene, quad, material);
        scene.spawn((Environment::constant(glam::Vec3::ONE),));
        look(&mut scene, glam::DVec3::Z * 2.0, glam::DVec3::ZERO, 40.0);
        let mut renderer = Renderer::new();
        renderer.sync(&mut scene);
        let path = |name: &str| PathLayer {
            name: name.into(),
            expression: format!("C<{name}>B").parse().expect("it is right"),
        };
        let layers = [Split::Lobes, Split::Paths].map(LayerKind::Light).to_vec();
        let settings = RenderSettings { layers, paths: all.map(path).to_vec(), ..settings(8, 16) };
        let picture = renderer.render(&settings, &()).picture;
        let lobe = if own.starts_with('R') { "specular.direct" } else { "transmission.direct" };
        assert!(picture.rgb.iter().all(|rgb| rgb[0] > 0.3), "{own}");
        for name in all.into_iter().chain(["specular.direct", "transmission.direct", "diffuse.direct", "emission"]) {
            let is_all = rgb(&picture, name) == picture.rgb;
            let is_black = rgb(&picture, name).iter().flatten().all(|&c| c == 0.0);
            assert!(if name == own || name == lobe { is_all } else { is_black }, "{own}: {name}");
        }
    }
}

/// Integrators that do not follow paths leave the layers by paths out, and so does what has too many states; others stay.
#[test]
fn layers_that_cannot_be_told_are_left_out() {
    let mut renderer = Renderer::new();
    renderer.sync(&mut varied());
    let layers = [Split::Lobes, Split::Bounces, Split::LobesByBounces].map(LayerKind::Light).to_vec();
    for integrator in [Integrator::Whitted, Integrator::Ambient { distance: 1.0 }] {
        let settings = RenderSettings { integrator, layers: layers.clone(), ..settings(8, 4) };
        let rendered = renderer.render(&settings, &());
        assert!(rendered.picture.layers.iter().all(|layer| layer.name.starts_with("bounce")));
        assert!(!rendered.picture.layers.is_empty() && rendered.stats.parts.len() * 2 == rendered.picture.layers.len());
    }
    // Each by itself is small enough.
    let path = |lobe: &str| PathLayer {
        name: lobe.into(),
        expression: format!("C.*{lobe}.{{9}}L").parse().expect("so it is"),
    };
    let layers = [Split::Paths, Split::Bounces].map(LayerKind::Light).to_vec();
    let many = RenderSettings { layers, paths: ["D", "G", "S"].map(path).to_vec(), ..settings(8, 4) };
    assert!(renderer.bytes_of_parts(&many).is_err());
    assert!(renderer.render(&many, &()).picture.layers.iter().all(|layer| layer.name.starts_with("bounce")));
}

/// Layers of lights have their entities' names, and a number where a name is taken.
#[test]
fn layers_of_lights_are_named_after_their_entities() {
    let mut scene = load_scene(&root().join("scenes/plates.gltf"));
    let balls = scene.keys_with::<wavecast::world::Geometry>();
    let first = balls.into_iter().find(|&key| scene.get::<Name>(key).is_some_and(|name| &*name.0 == "ball of 0.03 m"));
    scene.insert(first.expect("it is there"), Name("ball of 0.42 m".into()));
    let mut renderer = Renderer::new();
    renderer.sync(&mut scene);
    let layers = vec![LayerKind::Light(Split::LightsByDirect)];
    let mut rendered = renderer.render(&RenderSettings { layers, ..settings(8, 4) }, &());
    name_lights(&mut rendered, &scene);
    assert_eq!(rendered.stats.parts[0].layer, rendered.picture.layers[0].name);
    let names: Vec<&str> = rendered.picture.layers.iter().map(|layer| layer.name.as_str()).collect();
    assert_eq!(names.len(), 20);
    for want in ["light.ball of 0.42 m.direct", "light.ball of 0.42 m#2.indirect", "light.ball of 0.95 m.direct.error"]
    {
        assert!(names.contains(&want), "{want}: {names:?}");
    }
}

/// Pictures that are made from within a pool of threads, many at a time, do not wait for each other inside of each other.
#[test]
fn many_pictures_can_be_made_from_within_a_pool() {
    let mut renderer = Renderer::new();
    renderer.sync(&mut varied());
    let settings = RenderSettings { threads: 1, sharing: Sharing::Off, ..settings(4, 1) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).stack_size(1 << 20).build().expect("threads");
    let pictures: Vec<_> =
        pool.install(|| (0..3000).into_par_iter().map(|_| renderer.render(&settings, &()).picture.rgb).collect());
    assert!(pictures.iter().all(|picture: &Vec<[f32; 3]>| *picture == pictures[0]));
}
