//! Every file of the open asset pack, where it is at hand.

use std::{
    collections::BTreeMap,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
};

use glam::{DMat4, Mat4, Quat};
use serde_json::Value;
use wavecast::{
    load::{LoadError, LoadOptions, Loaded, load, load_environment},
    world::{Camera, Geometry, LocalTransform, Material, Name, Projection},
};

use crate::common::asset;

/// The pack's folder, or a word about skipping.
fn pack() -> Option<PathBuf> {
    asset(".")
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

/// What the loader reads.
const SUPPORTED: [&str; 9] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
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
                assert!(beyond.contains(&&name), "{}: {name}", path.display());
                *refused.entry(name).or_default() += 1;
            }
            Err(error) => panic!("{error} ({error:?})"),
        }
    }
    println!("{loaded_files} of {} assets load; refused: {refused:?}", paths.len());
    assert!(loaded_files > 70);
}

/// The `gltf` crate's typed view, which shares no code with the loader, of files it can read.
fn oracle(path: &Path) -> Option<gltf::Document> {
    let mut json = json_of(path);
    // Its deserialiser refuses animations whose targets are pointers.
    json.as_object_mut()?.remove("animations");
    let root: gltf::json::Root = serde_json::from_value(json).ok()?;
    Some(gltf::Document::from_json_without_validation(root))
}

/// Node indices of a scene, depth first.
fn walk_nodes<'d>(nodes: impl Iterator<Item = gltf::Node<'d>>, found: &mut Vec<gltf::Node<'d>>) {
    for node in nodes {
        found.push(node.clone());
        walk_nodes(node.children(), found);
    }
}

#[test]
fn nodes_cameras_and_materials_are_as_the_gltf_crate_reads_them() {
    let Some(folder) = pack() else { return };
    let (mut compared, mut materials, mut cameras) = (0, 0, 0);
    for path in files(&folder, &["gltf", "glb"]) {
        let Ok(loaded) = load(&path, &LoadOptions::default()) else { continue };
        let Some(document) = oracle(&path) else { continue };
        let Some(scene) = document.default_scene().or_else(|| document.scenes().next()) else { continue };
        let mut nodes = Vec::new();
        walk_nodes(scene.nodes(), &mut nodes);
        if nodes.iter().all(|node| node.skin().is_none()) {
            check_nodes(&path, &loaded, &nodes, &mut cameras);
            compared += 1;
        }
        materials += check_materials(&path, &loaded, &nodes);
    }
    println!("{compared} hierarchies, {cameras} cameras, {materials} materials compared");
    assert!(compared > 70 && cameras > 10 && materials > 500, "{compared} {cameras} {materials}");
}

#[track_caller]
fn check_nodes(path: &Path, loaded: &Loaded, nodes: &[gltf::Node<'_>], cameras: &mut usize) {
    let keys = loaded.scene.keys_with::<LocalTransform>();
    assert_eq!(keys.len(), nodes.len(), "{}", path.display());
    for (&key, node) in keys.iter().zip(nodes) {
        let got = DMat4::from(loaded.scene.get::<LocalTransform>(key).unwrap().to_affine()).as_mat4();
        let want = match node.transform() {
            gltf::scene::Transform::Matrix { matrix } => Mat4::from_cols_array_2d(&matrix),
            // The crate takes quaternions as they are; some in the pack are not quite of unit length.
            gltf::scene::Transform::Decomposed { translation, rotation, scale } => {
                let rotation = Quat::from_array(rotation).normalize();
                Mat4::from_scale_rotation_translation(scale.into(), rotation, translation.into())
            }
        };
        let scale = want.to_cols_array().iter().fold(1.0f32, |m, x| m.max(x.abs()));
        assert!(got.abs_diff_eq(want, 1e-5 * scale), "{}: {} {got} {want}", path.display(), node.index());
        let camera = loaded.scene.get::<Camera>(key);
        assert_eq!(camera.is_some(), node.camera().is_some());
        if let (Some(camera), Some(want)) = (camera, node.camera()) {
            *cameras += 1;
            match (camera.projection, want.projection()) {
                (Projection::Perspective { yfov, aspect }, gltf::camera::Projection::Perspective(want)) => {
                    assert_eq!((yfov, aspect, camera.znear), (want.yfov(), want.aspect_ratio(), want.znear()));
                    assert_eq!(camera.zfar, want.zfar().unwrap_or(f32::INFINITY));
                }
                (Projection::Orthographic { xmag, ymag }, gltf::camera::Projection::Orthographic(want)) => {
                    assert_eq!((xmag, ymag), (want.xmag(), want.ymag()));
                    assert_eq!((camera.znear, camera.zfar), (want.znear(), want.zfar()));
                }
                _ => panic!("{}: another projection", path.display()),
            }
        }
    }
}

#[track_caller]
fn check_materials(path: &Path, loaded: &Loaded, nodes: &[gltf::Node<'_>]) -> usize {
    let mut used = BTreeMap::new();
    for mesh in nodes.iter().filter_map(gltf::Node::mesh) {
        for primitive in mesh.primitives().filter(|p| p.mode().as_gl_enum() >= 4) {
            if let Some(index) = primitive.material().index() {
                used.insert(index, primitive.material());
            }
        }
    }
    let keys = loaded.scene.keys_with::<Material>();
    assert_eq!(keys.len(), used.len(), "{}", path.display());
    for (&key, want) in keys.iter().zip(used.values()) {
        let got: Material = loaded.scene.get(key).unwrap();
        let pbr = want.pbr_metallic_roughness();
        let place = format!("{} {:?}", path.display(), want.name());
        if let Some(name) = want.name() {
            assert_eq!(loaded.scene.get::<Name>(key).unwrap().0.as_ref(), name);
        }
        assert_eq!(got.base_color.extend(got.base_alpha).to_array(), pbr.base_color_factor(), "{place}");
        assert_eq!((got.metallic, got.roughness), (pbr.metallic_factor(), pbr.roughness_factor()), "{place}");
        let strength = want.emissive_strength().unwrap_or(1.0);
        assert_eq!(got.emissive.to_array(), want.emissive_factor().map(|x| x * strength), "{place}");
        assert_eq!((got.double_sided, got.unlit), (want.double_sided(), want.unlit()), "{place}");
        assert_eq!(got.ior, want.ior().unwrap_or(1.5), "{place}");
        let transmission = want.transmission().map_or(0.0, |t| t.transmission_factor());
        assert_eq!(got.transmission, transmission, "{place}");
        let thickness = want.volume().map_or(0.0, |v| v.thickness_factor());
        assert_eq!(got.thickness, thickness, "{place}");
        let specular = want.specular().map_or(1.0, |s| s.specular_factor());
        assert_eq!(got.specular, specular, "{place}");
        if let (Some(got), Some(want)) = (&got.base_color_texture, pbr.base_color_texture()) {
            let transform = want.texture_transform();
            let set = transform.as_ref().and_then(|t| t.tex_coord()).unwrap_or(want.tex_coord());
            assert_eq!(got.tex_coord, set, "{place}");
            assert_eq!(got.transform.offset, transform.map_or([0.0; 2], |t| t.offset()), "{place}");
        }
    }
    keys.len()
}

#[test]
fn every_environment_of_the_pack_loads() {
    let Some(folder) = pack() else { return };
    let paths = files(&folder.join("_hdr"), &["hdr"]);
    assert!(paths.len() >= 4);
    for path in paths {
        let (map, warnings) = load_environment(&path).unwrap();
        assert_eq!(map.texels.len(), (map.width * map.height) as usize);
        assert!(warnings.is_empty() && map.texels.iter().flatten().any(|&x| x > 0.0), "{}", path.display());
    }
}

/// Buffers and images beside the scene; not what is inside it, is not there, or must not be followed.
#[test]
fn the_files_of_a_scene_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let json = serde_json::json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 1, "uri": "a%20b.bin"}, {"byteLength": 1, "uri": "data:;base64,AA=="}],
        "images": [{"uri": "c.png"}, {"uri": "gone.png"}, {"uri": "../c.png"}, {"uri": "https://example.com/c.png"}],
    });
    std::fs::write(at("scene.gltf"), json.to_string()).unwrap();
    for name in ["a b.bin", "c.png"] {
        std::fs::write(at(name), [0]).unwrap();
    }
    let files = wavecast::load::files(&at("scene.gltf")).unwrap();
    assert_eq!(files, ["scene.gltf", "a b.bin", "c.png"].map(at));
    assert!(wavecast::load::files(&at("c.png")).is_err());
}
