//! The scenes shipped in `scenes/` are those that their generator writes, and make pictures.

use std::{fs, path::Path, sync::Arc};

use wavecast::{
    load,
    world::{Environment, Sky},
};

use crate::common::{load_scene, mean, picture, root, settings};

#[path = "../../scenes/generator/mod.rs"]
mod generator;

/// Bit for bit; where they differ, `cargo run --release --example generate_scenes` writes them again.
///
/// Sines and powers differ by their last bit between platforms, so only the one that wrote the files compares.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn committed_scenes_are_what_the_generator_writes() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let fresh = tempfile::tempdir().unwrap();
    for file in generator::files() {
        let written = fresh.path().join(file.name);
        fs::write(&written, &file.bytes).unwrap();
        let committed = fs::read(folder.join(file.name)).unwrap_or_default();
        assert!(
            committed == fs::read(written).unwrap(),
            "scenes/{} ({} bytes) is not what its generator writes ({} bytes): \
             run `cargo run --release --example generate_scenes`",
            file.name,
            committed.len(),
            file.bytes.len(),
        );
        println!("{}: {}", file.name, file.counts);
    }
}

/// Every scene file has a line in the folder's README, and a generator.
#[test]
fn every_scene_file_is_described_and_generated() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let readme = fs::read_to_string(folder.join("README.md")).unwrap();
    let generated: Vec<&str> = generator::files().iter().map(|file| file.name).collect();
    for entry in fs::read_dir(folder).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if [".gltf", ".glb", ".hdr"].iter().any(|end| name.ends_with(end)) {
            assert!(readme.contains(&format!("`{name}`")), "{name} has no line in scenes/README.md");
            assert!(generated.contains(&name.as_str()), "{name} has no generator");
        }
    }
}

/// What `--env` makes of a word.
fn environment(env: &str) -> Environment {
    if env.ends_with(".hdr") {
        let (map, warnings) = load::load_environment(&root().join("scenes").join(env)).unwrap();
        assert!(warnings.is_empty(), "{warnings:?}");
        return Environment { sky: Sky::Map(Arc::new(map)), rotation_degrees: 0.0, scale: 1.0 };
    }
    let numbers: Vec<f32> = env.split(',').map(|number| number.parse().unwrap()).collect();
    Environment::constant(glam::Vec3::from_slice(&numbers))
}

/// Exposed for a PNG without correction, so the mean lies between a hundredth of a nit and one.
#[test]
fn every_scene_makes_a_picture_that_needs_no_exposure() {
    for file in generator::files().iter().filter(|file| file.is_scene()) {
        let mut scene = load_scene(&root().join("scenes").join(file.name));
        if let Some(env) = file.env {
            scene.spawn((environment(env),));
        }
        let rendered = picture(&mut scene, &settings(24, 8));
        let pixels = &rendered.picture.rgb;
        assert!(pixels.iter().flatten().all(|light| light.is_finite() && *light >= 0.0), "{}", file.name);
        let mean = mean(&rendered);
        assert!(mean.iter().all(|light| (0.01..1.0).contains(light)), "{}: {mean:?}", file.name);
    }
}
