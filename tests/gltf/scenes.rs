//! Nodes, scenes, cameras, lights, files and what is said about them.

use std::{f32::consts::FRAC_PI_4, fs};

use glam::{DAffine3, DVec3, Vec3};
use serde_json::json;
use wavecast::{
    load::{ExtensionStatus, LoadOptions, Selector, load},
    world::{
        Camera, DirectionalLight, Geometry, LocalTransform, Name, Parent, PointLight, Projection, SceneKey, SpotLight,
        units::{Candela, Lux},
    },
};

use super::file::{File, error_of, load_bytes, warnings};

/// Three scenes of one named node each.
fn three_scenes() -> File {
    let mut file = File::new();
    for name in ["a", "b", "c"] {
        let node = file.push("nodes", json!({"name": format!("node {name}")}));
        file.push("scenes", json!({"name": name, "nodes": [node]}));
    }
    file
}

#[track_caller]
fn check_scene(file: &File, scene: Option<Selector>, expected: Result<&str, &str>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file.gltf");
    fs::write(&path, file.text()).unwrap();
    match (load(&path, &LoadOptions { scene }), expected) {
        (Ok(loaded), Ok(name)) => {
            let keys = loaded.scene.keys_with::<Name>();
            assert_eq!(keys.len(), 1);
            assert_eq!(loaded.scene.get::<Name>(keys[0]).unwrap().0.as_ref(), name);
        }
        (Err(error), Err(message)) => assert!(error.to_string().ends_with(message), "{error}"),
        (Ok(_), Err(_)) => panic!("loading must fail"),
        (Err(error), Ok(_)) => panic!("{error}"),
    }
}

#[test]
fn the_chosen_scene_is_the_named_one_else_the_default_else_the_first() {
    let mut file = three_scenes();
    check_scene(&file, None, Ok("node a"));
    file.json["scene"] = json!(1);
    check_scene(&file, None, Ok("node b"));
    check_scene(&file, Some(Selector::Index(2)), Ok("node c"));
    check_scene(&file, Some(Selector::Name("a".to_owned())), Ok("node a"));
    check_scene(&file, Some("c".into()), Ok("node c"));
    check_scene(&file, Some("0".into()), Ok("node a"));
    let message = r#"there is no scene "d"; there are 0 "a", 1 "b", 2 "c""#;
    check_scene(&file, Some("d".into()), Err(message));
    check_scene(&file, Some(Selector::Index(3)), Err(r#"there is no scene "3"; there are 0 "a", 1 "b", 2 "c""#));
}

#[test]
fn a_file_without_scenes_shows_all_its_root_nodes() {
    let mut file = File::new();
    file.push("nodes", json!({"name": "child"}));
    file.push("nodes", json!({"name": "parent", "children": [0]}));
    file.push("nodes", json!({"name": "other"}));
    let loaded = load_bytes(file.text().as_bytes()).unwrap();
    let [parent, child, other] = ["parent", "child", "other"].map(|name| loaded.scene.find(name).unwrap());
    assert_eq!([parent, child, other], [0, 1, 2].map(SceneKey));
    assert_eq!(loaded.scene.get::<Parent>(child), Some(Parent(parent)));
    assert_eq!(loaded.info.scene, None);
}

/// Keys follow the file: materials by index, then nodes depth first.
#[test]
fn keys_go_to_used_materials_first_then_to_nodes_depth_first() {
    let mut file = File::new();
    for name in ["m0", "m1", "m2"] {
        file.push("materials", json!({"name": name}));
    }
    let positions = file.triangle();
    for material in [2, 0] {
        let primitive = json!({"attributes": {"POSITION": positions}, "material": material});
        file.push("meshes", json!({"primitives": [primitive]}));
    }
    file.node(json!({"name": "root", "children": [1, 2], "mesh": 0}));
    file.push("nodes", json!({"name": "left", "children": [3]}));
    file.push("nodes", json!({"name": "right"}));
    file.push("nodes", json!({"name": "leaf", "mesh": 1}));
    let loaded = file.load().unwrap();
    let names: Vec<String> = (0..6).map(|key| loaded.scene.get::<Name>(SceneKey(key)).unwrap().0.to_string()).collect();
    assert_eq!(names, ["m0", "m2", "root", "left", "leaf", "right"]);
    assert!(loaded.scene.find("m1").is_none());
}

#[test]
fn transforms_are_kept_as_the_file_has_them() {
    let mut file = File::new();
    file.node(json!({"name": "trs", "translation": [1, 2, 3], "rotation": [0, 0, 3, 4], "scale": [-1, 2, 0.5]}));
    file.node(json!({"name": "matrix", "matrix": [1, 2, 3, 0, 4, 5, 6, 0, 7, 8, 10, 0, 11, 12, 13, 1]}));
    let loaded = file.load().unwrap();
    let local = |name: &str| loaded.scene.get::<LocalTransform>(loaded.scene.find(name).unwrap()).unwrap();
    let LocalTransform::Trs { translation, rotation, scale } = local("trs") else { panic!("not TRS") };
    assert_eq!((translation, scale), (DVec3::new(1.0, 2.0, 3.0), DVec3::new(-1.0, 2.0, 0.5)));
    assert!((rotation.to_array()[2] - 0.6).abs() < 1e-15 && (rotation.w - 0.8).abs() < 1e-15);
    let columns = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 11.0, 12.0, 13.0];
    assert_eq!(local("matrix"), LocalTransform::Matrix(DAffine3::from_cols_array(&columns)));
}

#[test]
fn a_chain_of_fifty_thousand_nodes_loads() {
    let count = 50_000;
    let nodes: Vec<_> =
        (0..count).map(|i| if i + 1 < count { json!({"children": [i + 1]}) } else { json!({}) }).collect();
    let json = json!({"asset": {"version": "2.0"}, "nodes": nodes, "scenes": [{"nodes": [0]}]});
    let loaded = load_bytes(json.to_string().as_bytes()).unwrap();
    assert_eq!(loaded.scene.keys_with::<Parent>().len(), count - 1);
}

#[test]
fn cameras_keep_their_numbers_and_are_listed_with_their_entities() {
    let mut file = File::new();
    file.push("cameras", json!({"type": "perspective", "perspective": {"yfov": 0.5, "aspectRatio": 2, "znear": 0.1}}));
    let ortho = json!({"xmag": 2, "ymag": 1, "znear": 0, "zfar": 10});
    file.push("cameras", json!({"name": "flat", "type": "orthographic", "orthographic": ortho}));
    file.push("cameras", json!({"type": "perspective", "perspective": {"yfov": 1, "znear": 1, "zfar": 5}}));
    file.node(json!({"name": "left", "camera": 0}));
    file.node(json!({"name": "right", "camera": 0}));
    file.node(json!({"camera": 1}));
    let loaded = file.load().unwrap();
    let names: Vec<_> = loaded.info.cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["left", "flat", "camera 2"]);
    let keys: Vec<_> = loaded.info.cameras.iter().map(|camera| camera.keys.clone()).collect();
    assert_eq!(keys, [vec![SceneKey(0), SceneKey(1)], vec![SceneKey(2)], vec![]]);
    let projection = Projection::Perspective { yfov: 0.5, aspect: Some(2.0) };
    let expected = Camera { projection, znear: 0.1, zfar: f32::INFINITY };
    assert_eq!(loaded.scene.get::<Camera>(SceneKey(1)), Some(expected));
    let projection = Projection::Orthographic { xmag: 2.0, ymag: 1.0 };
    assert_eq!(loaded.scene.get::<Camera>(SceneKey(2)), Some(Camera { projection, znear: 0.0, zfar: 10.0 }));
}

#[test]
fn lights_have_the_extensions_defaults() {
    let mut file = File::new();
    let lights = json!([
        {"type": "point"},
        {"type": "spot"},
        {"type": "directional", "color": [1, 0.5, 0], "intensity": 100},
        {"type": "spot", "intensity": 7, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.4}},
        {"type": "spot", "spot": {"innerConeAngle": 0.9, "outerConeAngle": 0.5}},
        {"type": "point", "intensity": -3},
    ]);
    file.json["extensions"] = json!({"KHR_lights_punctual": {"lights": lights}});
    for light in 0..6 {
        file.node(json!({"extensions": {"KHR_lights_punctual": {"light": light}}}));
    }
    let loaded = file.load().unwrap();
    let point = |key| loaded.scene.get::<PointLight>(SceneKey(key));
    let spot = |key| loaded.scene.get::<SpotLight>(SceneKey(key)).unwrap();
    assert_eq!(point(0), Some(PointLight { color: Vec3::ONE, intensity: Candela(1.0) }));
    let expected = SpotLight { color: Vec3::ONE, intensity: Candela(1.0), inner: 0.0, outer: FRAC_PI_4 };
    assert_eq!(spot(1), expected);
    let expected = DirectionalLight { color: Vec3::new(1.0, 0.5, 0.0), illuminance: Lux(100.0) };
    assert_eq!(loaded.scene.get::<DirectionalLight>(SceneKey(2)), Some(expected));
    assert_eq!((spot(3).intensity, spot(3).inner, spot(3).outer), (Candela(7.0), 0.2, 0.4));
    assert!(spot(4).inner < 0.5 && spot(4).outer == 0.5);
    assert_eq!(point(5).unwrap().intensity, Candela(0.0));
    let said = warnings(&loaded);
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said[0].contains("/extensions/KHR_lights_punctual/lights/4/spot/innerConeAngle"), "{said:?}");
    assert!(said[1].contains("/extensions/KHR_lights_punctual/lights/5/intensity"), "{said:?}");
    assert_eq!(loaded.info.counts.lights, 6);
}

#[test]
fn buffers_are_found_beside_the_file_under_escaped_names_and_nowhere_else() {
    let mut file = File::new();
    let positions = file.triangle();
    file.show(json!({"attributes": {"POSITION": positions}}));
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir_all(folder.path().join("scene/sub folder")).unwrap();
    for name in ["outside.bin", "scene/sub folder/größe ❤.bin", "scene/100%.bin", "scene/a+b.bin"] {
        fs::write(folder.path().join(name), &file.bin).unwrap();
    }
    let path = folder.path().join("scene/file.gltf");
    let mut load_uri = |uri: &str| {
        file.json["buffers"] = json!([{"byteLength": 36, "uri": uri}]);
        fs::write(&path, file.json.to_string()).unwrap();
        load(&path, &LoadOptions::default())
    };
    for uri in [
        "sub%20folder/gr%C3%B6%C3%9Fe%20%E2%9D%A4.bin",
        "sub folder/größe ❤.bin",
        "./a+b.bin",
        "100%.bin",
        "100%25.bin",
    ] {
        let loaded = load_uri(uri).unwrap_or_else(|error| panic!("{uri}: {error}"));
        assert_eq!(loaded.scene.keys_with::<Geometry>().len(), 1);
    }
    let absolute = folder.path().join("outside.bin").display().to_string();
    for uri in
        ["../outside.bin", "sub folder/../../outside.bin", "%2e%2e/outside.bin", "..\\outside.bin", &absolute, ""]
    {
        let message = error_of(load_uri(uri));
        assert!(
            message.contains("/buffers/0/uri: cannot follow") && message.contains("leaves the folder"),
            "{message}"
        );
    }
    for uri in ["https://example.com/a.bin", "file:///etc/passwd", "C:a.bin"] {
        assert!(error_of(load_uri(uri)).contains("only files beside the scene are read"));
    }
    let message = error_of(load_uri("missing.bin"));
    assert!(message.contains("missing.bin: cannot read it, which") && message.contains("/buffers/0/uri"), "{message}");
    assert!(error_of(load_uri("sub folder")).contains("cannot read it"));
}

#[test]
fn text_with_data_uris_and_glb_give_the_same_mesh() {
    let mut file = File::new();
    let positions = file.triangle();
    file.show(json!({"attributes": {"POSITION": positions}}));
    let from_glb = super::file::only_mesh(&load_bytes(&file.glb()).unwrap());
    assert_eq!(from_glb.positions, file.mesh().positions);
    assert_eq!(from_glb.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
}

/// The second scene's mesh, image and buffer are broken or missing.
#[test]
fn what_the_scene_does_not_need_is_not_read() {
    let mut file = three_scenes();
    file.push("materials", json!({"normalTexture": {"index": 99}}));
    file.push("meshes", json!({"primitives": [{"attributes": {"POSITION": 7}, "material": 0}]}));
    file.json["buffers"] = json!([{"byteLength": 1, "uri": "missing.bin"}]);
    file.json["nodes"][1]["mesh"] = json!(0);
    let loaded = load_bytes(file.json.to_string().as_bytes()).unwrap();
    assert_eq!(loaded.info.counts.materials, 1);
    file.json["scene"] = json!(1);
    assert!(error_of(load_bytes(file.json.to_string().as_bytes())).contains("/materials/0/normalTexture/index"));
}

#[test]
fn extensions_are_read_ignored_with_a_warning_or_refused() {
    let mut file = File::new();
    file.json["extensionsUsed"] = json!([
        "KHR_lights_punctual",
        "KHR_materials_sheen",
        "KHR_xmp_json_ld",
        "EXT_texture_webp",
        "KHR_materials_sheen"
    ]);
    let loaded = file.load().unwrap();
    let said = warnings(&loaded);
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said[0].contains("/extensionsUsed/1: KHR_materials_sheen is ignored"));
    assert!(said[1].contains("/extensionsUsed/3: EXT_texture_webp is not supported"));
    let kinds: Vec<_> = loaded.info.extensions.iter().map(|e| std::mem::discriminant(&e.status)).collect();
    let [read, ignored, approximated] =
        [ExtensionStatus::Read, ExtensionStatus::Ignored(""), ExtensionStatus::Approximated("")]
            .map(|status| std::mem::discriminant(&status));
    assert_eq!(kinds, [read, ignored, ignored, approximated]);

    file.json["extensionsRequired"] = json!(["KHR_mesh_quantization", "KHR_xmp_json_ld"]);
    assert!(file.load().unwrap().info.extensions[0].required);
    file.json["extensionsRequired"] = json!(["two\nlines"]);
    assert!(error_of(file.load()).contains(r"the file requires two\u{a}lines, which"));
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "EXT_mesh_gpu_instancing", "ACME_x"] {
        file.json["extensionsRequired"] = json!(["KHR_texture_transform", name]);
        let message = error_of(file.load());
        assert!(message.contains(&format!("/extensionsRequired/1: the file requires {name}")), "{message}");
    }
}

#[test]
fn info_counts_what_is_in_the_file() {
    let mut file = three_scenes();
    file.json["asset"]["generator"] = json!("by hand");
    let positions = file.floats("VEC3", &[0.0; 18]);
    file.push("meshes", json!({"primitives": [{"attributes": {"POSITION": positions}}]}));
    file.push("animations", json!({"channels": [{"target": {"path": "pointer"}}], "samplers": []}));
    let loaded = file.load().unwrap();
    let counts = loaded.info.counts;
    assert_eq!((counts.meshes, counts.triangles, counts.instanced_triangles), (1, 2, 0));
    assert_eq!((counts.nodes, counts.scenes, counts.animations, counts.skins), (3, 3, 1, 0));
    assert_eq!((loaded.info.generator.as_deref(), loaded.info.version.as_str()), (Some("by hand"), "2.0"));
    assert_eq!(loaded.info.scenes, ["a", "b", "c"]);
    assert_eq!(warnings(&loaded).len(), 1);
}
