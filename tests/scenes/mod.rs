//! The scenes shipped in `scenes/` are those that their generator writes, and make pictures.

use std::{fs, path::Path, sync::Arc};

use serde_json::{Value, json};
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
    for file in generator::files().iter().filter(|file| !file.name.ends_with(".hdr")) {
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

/// The scenes that are rendered by other programs as well.
const SHARED: [&str; 6] = ["plates.gltf", "caustic.glb", "lights.glb", "outdoor.gltf", "door.gltf", "million.glb"];

/// The JSON of a scene file of either form.
fn json_of(bytes: &[u8]) -> Value {
    if !bytes.starts_with(b"glTF") {
        return serde_json::from_slice(bytes).unwrap();
    }
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).unwrap()
}

/// Exactly Lambertian, white metal with a GGX alpha of 0.001 to 0.1, or clear solid glass.
#[track_caller]
fn check_material(material: &Value) {
    let (pbr, extensions) = (&material["pbrMetallicRoughness"], &material["extensions"]);
    let white = pbr["baseColorFactor"] == json!([1.0, 1.0, 1.0, 1]);
    let alpha = pbr["roughnessFactor"].as_f64().unwrap().powi(2);
    let lambert = pbr["metallicFactor"] == 0 && extensions["KHR_materials_specular"] == json!({"specularFactor": 0});
    // The factor is rounded to five digits.
    let metal = pbr["metallicFactor"] == 1 && white && (0.001..0.10001).contains(&alpha) && extensions.is_null();
    let solid = extensions["KHR_materials_volume"]["thicknessFactor"].as_f64().is_some_and(|metres| metres > 0.0);
    let clear = extensions["KHR_materials_volume"]["attenuationDistance"].is_null();
    let glass = extensions["KHR_materials_transmission"] == json!({"transmissionFactor": 1})
        && pbr["metallicFactor"] == 0
        && white
        && alpha == 0.0
        && solid
        && clear;
    assert!(lambert || metal || glass, "{material}");
    let keys = ["name", "pbrMetallicRoughness", "extensions", "emissiveFactor"];
    assert!(material.as_object().unwrap().keys().all(|key| keys.contains(&key.as_str())), "{material}");
}

/// Flat triangles, no textures, no light besides emission, and materials that mean the same to everyone.
#[test]
fn shared_scenes_hold_only_what_other_renderers_can_say() {
    for name in SHARED {
        let document = json_of(&fs::read(root().join("scenes").join(name)).unwrap());
        assert!(document["textures"].is_null() && document["extensions"].is_null(), "{name}");
        document["materials"].as_array().unwrap().iter().for_each(check_material);
        for primitive in document["meshes"].as_array().unwrap().iter().flat_map(|m| m["primitives"].as_array().unwrap())
        {
            let attributes = primitive["attributes"].as_object().unwrap();
            assert!(attributes.keys().eq(["POSITION"]), "{name}: {primitive}");
        }
    }
}
