//! Every file of the open asset pack, where it is at hand.

use std::{
    collections::BTreeMap,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
};

use glam::{DMat4, Mat4};
use serde_json::Value;
use wavecast::{
    load::{LoadError, LoadOptions, Loaded, load, load_environment},
    world::{Camera, Geometry, LocalTransform, Material, Name, Projection},
};

/// The pack's folder, or a word about skipping.
fn pack() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/assets");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("SKIPPED: there is no asset pack at {}", folder.display());
    None
}

fn walk(folder: &Path, extensions: &[&str], found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            walk(&path, extensions, found);
        } else if path.extension().is_some_and(|e| extensions.iter().any(|wanted| e == *wanted)) {
            found.push(path);
        }
    }
}

fn files(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    walk(folder, extensions, &mut found);
    found
}

/// The JSON of a file, by the shortest way.
fn json_of(path: &Path) -> Value {
    let bytes = std::fs::read(path).unwrap();
    if bytes.starts_with(b"glTF") {
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        return serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    }
    serde_json::from_slice(&bytes).unwrap()
}

fn list(json: &Value, key: &str) -> Vec<String> {
    let names = json.get(key).and_then(Value::as_array).into_iter().flatten();
    names.map(|name| name.as_str().unwrap().to_owned()).collect()
}

#[track_caller]
fn check_sound(path: &Path, loaded: &Loaded) {
    for key in loaded.scene.keys_with::<Geometry>() {
        let mesh = loaded.scene.get::<Geometry>(key).unwrap().0;
        mesh.check().unwrap_or_else(|problem| panic!("{}: {problem}", path.display()));
        assert!(!mesh.triangles.is_empty());
    }
}

/// What the loader reads; `EXT_texture_webp` has a plain PNG beside it in the file that requires it.
const SUPPORTED: [&str; 10] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "EXT_texture_webp",
];

#[test]
fn every_asset_loads_or_names_the_extension_it_requires() {
    let Some(folder) = pack() else { return };
    let (mut loaded_files, mut refused) = (0, BTreeMap::<String, usize>::new());
    let paths = files(&folder, &["gltf", "glb"]);
    assert!(paths.len() > 80, "{} files", paths.len());
    for path in &paths {
        let required = list(&json_of(path), "extensionsRequired");
        let beyond: Vec<_> = required.iter().filter(|name| !SUPPORTED.contains(&name.as_str())).collect();
        let outcome = catch_unwind(AssertUnwindSafe(|| load(path, &LoadOptions::default())));
        let outcome = outcome.unwrap_or_else(|_| panic!("{} panics", path.display()));
        match outcome {
            Ok(loaded) => {
                assert!(beyond.is_empty(), "{} requires {beyond:?}", path.display());
                check_sound(path, &loaded);
                for warning in &loaded.warnings {
                    println!("{warning}");
                }
                loaded_files += 1;
            }
            Err(LoadError::RequiredExtension { name, .. }) => {
                // The Sponza twin's textures have WebP alone; the rest is refused at once.
                assert!(beyond.contains(&&name) || name == "EXT_texture_webp", "{}: {name}", path.display());
                *refused.entry(name).or_default() += 1;
            }
            Err(error) => panic!("{error} ({error:?})"),
        }
    }
    println!("{loaded_files} of {} assets load; refused: {refused:?}", paths.len());
    assert!(loaded_files > 70);
}
