//! The structure that rays are traced through changes no bit of a picture.

use std::fs;

use wavecast::render::{AccelKind, Quality, RenderSettings, Renderer};

use crate::common::{load_scene, root, settings};

/// Scenes of `scenes/`, with the height of a picture that brute force renders in a second or so.
const SCENES: [(&str, u32); 16] = [
    ("alpha.gltf", 6),
    ("caustic.glb", 4),
    ("cornell.gltf", 24),
    ("door.gltf", 8),
    ("emitters.gltf", 4),
    ("gallery.glb", 2),
    ("instances.glb", 2),
    ("kajiya.glb", 4),
    ("led.glb", 8),
    ("lights.glb", 4),
    ("million.glb", 2),
    ("outdoor.gltf", 2),
    ("plates.gltf", 8),
    ("punctual.gltf", 4),
    ("seasons.glb", 4),
    ("window.gltf", 4),
];

/// Renders a scene file through one structure after the other, brute force last and in a smaller picture.
#[track_caller]
fn check_scene(name: &str, height: u32) {
    let mut scene = load_scene(&root().join("scenes").join(name));
    let mut renderer = Renderer::new();
    renderer.sync(&mut scene);
    let ordinary = RenderSettings { width: 36, ..settings(24, 4) };
    let small = RenderSettings { width: 3 * height / 2, ..settings(height, 1) };
    let [want, want_small] = [&ordinary, &small].map(|settings| renderer.render(settings, &()).picture);
    assert!(want.rgb.iter().flatten().any(|light| *light > 0.0));
    let others = AccelKind::ALL.into_iter().filter(|kind| *kind != AccelKind::default());
    for kind in others.chain([Quality::Fast, Quality::Best].map(AccelKind::Bvh8)) {
        renderer.accel = kind;
        let meshes = renderer.sync(&mut scene).rebuilt[0];
        assert_eq!(meshes, ("geometry", renderer.scene().meshes.len()));
        let brute = kind == AccelKind::Brute;
        let (settings, want) = if brute { (&small, &want_small) } else { (&ordinary, &want) };
        assert!(renderer.render(settings, &()).picture == *want, "{name}, {kind:?}");
    }
}

#[test]
fn every_structure_renders_every_scene_to_the_same_bits() {
    for (name, height) in SCENES {
        let start = std::time::Instant::now();
        check_scene(name, height);
        println!("{name}: {:.1} s", start.elapsed().as_secs_f64());
    }
}

#[test]
fn every_scene_file_is_among_them() {
    for entry in fs::read_dir(root().join("scenes")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let is_scene = name.ends_with(".gltf") || name.ends_with(".glb");
        assert!(!is_scene || SCENES.iter().any(|(scene, _)| *scene == name), "{name}");
    }
}
