//! Broken files: an error of one line with its place, or a sound scene; never a panic.

use std::panic::{AssertUnwindSafe, catch_unwind};

use serde_json::{Value, json};
use wavecast::{
    load::{LoadError, Loaded},
    world::{Camera, Geometry, LocalTransform, Material, PointLight, SpotLight},
};

use super::file::{File, U8, error_of, glb, load_bytes, png};

/// A file with something of everything the loader reads.
fn rich() -> File {
    let mut file = File::new();
    let positions = file.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.5]);
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(4));
    let tangents = file.floats("VEC4", &[1.0, 0.0, 0.0, 1.0].repeat(4));
    let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    let colors = file.accessor(U8, "VEC4", 4, &[200; 16]);
    file.json["accessors"][colors]["normalized"] = json!(true);
    let joints = file.accessor(U8, "VEC4", 4, &[0, 1, 0, 0].repeat(4));
    let weights = file.floats("VEC4", &[0.5, 0.5, 0.0, 0.0].repeat(4));
    let indices = file.indices(&[0, 1, 2, 3]);
    let mut binds = vec![0.0f32; 32];
    (0..8).for_each(|i| binds[16 * (i / 4) + 5 * (i % 4)] = 1.0);
    let binds = file.floats("MAT4", &binds);
    let (rows, values) = (file.view(&[1, 3]), file.view(&[0; 24]));
    let delta = file.push(
        "accessors",
        json!({
            "componentType": 5126, "type": "VEC3", "count": 4, "byteOffset": 0,
            "sparse": {
                "count": 2,
                "indices": {"bufferView": rows, "componentType": 5121, "byteOffset": 0},
                "values": {"bufferView": values, "byteOffset": 0},
            },
        }),
    );
    let image = file.view(&png(2, 2, png::ColorType::Rgb, png::BitDepth::Eight, &[90; 12]));
    file.push("images", json!({"bufferView": image, "mimeType": "image/png", "name": "checker"}));
    file.push("samplers", json!({"magFilter": 9728, "minFilter": 9987, "wrapS": 33071, "wrapT": 33648}));
    file.push("textures", json!({"source": 0, "sampler": 0}));
    let transform =
        json!({"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.3, "scale": [2, 2], "texCoord": 0}});
    file.push("materials", json!({
        "name": "all",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.5, 0.5, 1.0], "metallicFactor": 0.5, "roughnessFactor": 0.5,
            "baseColorTexture": {"index": 0, "texCoord": 0, "extensions": transform},
        },
        "normalTexture": {"index": 0, "scale": 0.5}, "emissiveFactor": [0.1, 0.2, 0.3],
        "alphaMode": "MASK", "alphaCutoff": 0.4, "doubleSided": true,
        "extensions": {
            "KHR_materials_emissive_strength": {"emissiveStrength": 5},
            "KHR_materials_ior": {"ior": 1.4},
            "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [1, 1, 1], "specularTexture": {"index": 0}},
            "KHR_materials_transmission": {"transmissionFactor": 0.5},
            "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [0.5, 0.5, 0.5]},
        },
    }));
    let attributes = json!({
        "POSITION": positions, "NORMAL": normals, "TANGENT": tangents, "TEXCOORD_0": uvs, "COLOR_0": colors,
        "JOINTS_0": joints, "WEIGHTS_0": weights,
    });
    let skinned = json!({
        "attributes": attributes, "indices": indices, "mode": 5, "material": 0, "targets": [{"POSITION": delta}],
    });
    file.push("meshes", json!({"primitives": [skinned], "weights": [0.5], "name": "body"}));
    let mapped = json!({"attributes": {"POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs}, "material": 0, "indices": indices, "mode": 6});
    file.push("meshes", json!({"primitives": [mapped]}));
    file.push("skins", json!({"joints": [2, 3], "inverseBindMatrices": binds, "skeleton": 2}));
    file.push(
        "cameras",
        json!({"type": "perspective", "perspective": {"yfov": 0.8, "aspectRatio": 1.5, "znear": 0.1, "zfar": 50}}),
    );
    file.push(
        "cameras",
        json!({"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0.1, "zfar": 50}}),
    );
    file.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "spot", "color": [1, 1, 1], "intensity": 3, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.5}},
        {"type": "point", "intensity": 2},
    ]}});
    file.json["extensionsUsed"] = json!(["KHR_lights_punctual", "KHR_materials_ior"]);
    file.json["scene"] = json!(0);
    file.node(json!({"name": "skinned", "mesh": 0, "skin": 0, "weights": [0.25]}));
    file.node(json!({"name": "root", "children": [2, 4], "translation": [1, 2, 3], "rotation": [0, 0, 0, 1], "scale": [1, 2, 1]}));
    file.push("nodes", json!({"children": [3], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}));
    file.push("nodes", json!({"camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}}));
    file.push("nodes", json!({"mesh": 1, "camera": 1, "extensions": {"KHR_lights_punctual": {"light": 1}}}));
    file
}

/// Asserts that nothing in a scene is out of bounds or not finite.
fn check_sound(loaded: &Loaded) {
    let scene = &loaded.scene;
    for key in scene.keys_with::<Geometry>() {
        scene.get::<Geometry>(key).unwrap().0.check().unwrap();
    }
    for key in scene.keys_with::<LocalTransform>() {
        assert!(scene.get::<LocalTransform>(key).unwrap().to_affine().is_finite());
    }
    for key in scene.keys_with::<Material>() {
        let m = scene.get::<Material>(key).unwrap();
        let colors = [m.base_color, m.emissive, m.specular_color, m.attenuation_color];
        assert!(colors.iter().all(|c| c.is_finite() && c.min_element() >= 0.0), "{m:?}");
        let shares = [m.base_alpha, m.metallic, m.roughness, m.specular, m.transmission];
        assert!(shares.iter().all(|x| (0.0..=1.0).contains(x)), "{m:?}");
        assert!(m.normal_scale.is_finite() && m.attenuation_distance > 0.0 && (m.ior == 0.0 || m.ior >= 1.0), "{m:?}");
    }
    for key in scene.keys_with::<SpotLight>() {
        let light = scene.get::<SpotLight>(key).unwrap();
        assert!(light.inner < light.outer && light.inner >= 0.0 && light.intensity.0 >= 0.0, "{light:?}");
    }
    for key in scene.keys_with::<PointLight>() {
        assert!(scene.get::<PointLight>(key).unwrap().intensity.0 >= 0.0);
    }
    for key in scene.keys_with::<Camera>() {
        let camera = scene.get::<Camera>(key).unwrap();
        assert!(camera.zfar > camera.znear && camera.znear >= 0.0, "{camera:?}");
    }
}

/// What came of a number of broken files.
#[derive(Debug, Default)]
struct Tally {
    errors: usize,
    scenes: usize,
}

impl Tally {
    /// Loads a broken file; what is wrong with how it goes wrong names `what`.
    #[track_caller]
    fn check(&mut self, bytes: &[u8], what: &str) {
        match catch_unwind(AssertUnwindSafe(|| load_bytes(bytes))) {
            Err(_) => panic!("{what}: panics"),
            Ok(Ok(loaded)) => {
                check_sound(&loaded);
                self.scenes += 1;
            }
            Ok(Err(error)) => {
                let message = error.to_string();
                assert_eq!(message.lines().count(), 1, "{what}: {message:?}");
                let (_, place) = message.split_once("file.gltf: ").unwrap_or_else(|| panic!("{what}: {message}"));
                let placed = place.starts_with('/')
                    || place.starts_with("line ")
                    || place.starts_with("byte ")
                    || place.starts_with("there is no asset");
                assert!(placed, "{what}: {message}");
                self.errors += 1;
            }
        }
    }
}

#[test]
fn the_rich_file_itself_loads_without_a_warning() {
    let loaded = rich().load().unwrap();
    check_sound(&loaded);
    assert_eq!(loaded.warnings, []);
    assert_eq!(loaded.scene.keys_with::<Geometry>().len(), 2);
    assert_eq!(loaded.scene.keys_with::<Camera>().len(), 2);
}

/// JSON pointers of every value below the root, containers included.
fn pointers(value: &Value, at: &str, found: &mut Vec<String>) {
    let mut step = |key: String, value: &Value| {
        let pointer = format!("{at}/{}", key.replace('~', "~0").replace('/', "~1"));
        found.push(pointer.clone());
        pointers(value, &pointer, found);
    };
    match value {
        Value::Object(map) => map.iter().for_each(|(key, value)| step(key.clone(), value)),
        Value::Array(list) => list.iter().enumerate().for_each(|(i, value)| step(i.to_string(), value)),
        _ => {}
    }
}

fn remove(json: &mut Value, pointer: &str) {
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match json.pointer_mut(parent).unwrap() {
        Value::Object(map) => _ = map.remove(key),
        Value::Array(list) => _ = list.remove(key.parse().unwrap()),
        _ => unreachable!("only containers have children"),
    }
}

#[test]
fn no_value_replaced_or_removed_makes_the_loader_panic() {
    let file = rich();
    let good: Value = serde_json::from_str(&file.text()).unwrap();
    let mut places = Vec::new();
    pointers(&good, "", &mut places);
    let replacements = [
        json!(-1),
        json!(0),
        json!(1),
        json!(3),
        json!(255),
        json!(1e9),
        json!(4294967296u64),
        json!(u64::MAX),
        json!(0.5),
        json!(1e39),
        json!(-1e300),
        json!(1e-320),
        Value::Null,
        json!("x"),
        json!(true),
        json!([]),
        json!({}),
        json!([[]]),
        json!([0, 0, 0]),
    ];
    let mut tally = Tally::default();
    for place in &places {
        for replacement in &replacements {
            let mut bad = good.clone();
            *bad.pointer_mut(place).unwrap() = replacement.clone();
            tally.check(bad.to_string().as_bytes(), &format!("{place} = {replacement}"));
        }
        let mut bad = good.clone();
        remove(&mut bad, place);
        tally.check(bad.to_string().as_bytes(), &format!("{place} removed"));
    }
    println!("{} places, {tally:?}", places.len());
    assert!(places.len() > 250 && tally.errors > 2000 && tally.scenes > 500, "{} {tally:?}", places.len());
}

#[test]
fn no_truncated_or_flipped_glb_makes_the_loader_panic() {
    let good = rich().glb();
    assert!(load_bytes(&good).is_ok());
    let mut tally = Tally::default();
    for length in (4..good.len()).step_by(7) {
        tally.check(&good[..length], &format!("cut to {length}"));
    }
    assert_eq!(tally.scenes, 0, "every cut is noticed");
    // Every bit of the header, one bit of every other byte.
    for bit in (0..20 * 8).chain((20..good.len()).map(|byte| 8 * byte + byte % 8)) {
        let mut bytes = good.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        tally.check(&bytes, &format!("bit {bit} flipped"));
    }
    println!("{tally:?}");
    assert!(tally.errors > 1000 && tally.scenes > 300, "{tally:?}");
}

/// Loading the rich file with one value changed ends in this message.
#[track_caller]
fn check_fault(place: &str, value: Value, expected: &str) {
    let file = rich();
    let mut json: Value = serde_json::from_str(&file.text()).unwrap();
    let (parent, key) = place.rsplit_once('/').unwrap();
    match json.pointer_mut(parent).unwrap_or_else(|| panic!("no {parent}")) {
        Value::Object(map) => _ = map.insert(key.to_owned(), value),
        Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
        _ => panic!("{parent} has no children"),
    }
    let message = error_of(load_bytes(json.to_string().as_bytes()));
    assert!(message.contains(expected), "{place}: {message}");
}

#[test]
fn faults_are_named_with_their_place() {
    check_fault("/asset", json!({}), ": /asset: there is no version");
    check_fault("/asset/version", json!("1.0"), ": /asset/version: expected version 2.x, found \"1.0\"");
    check_fault("/asset/minVersion", json!("2.1"), ": /asset/minVersion: expected at most 2.0");
    check_fault("/nodes", json!({}), ": /nodes: expected an array, found an object");
    check_fault("/nodes/3", json!(7), ": /nodes/3: expected an object, found 7");
    check_fault("/scene", json!(1), ": /scene: refers to scene 1, there are 1");
    check_fault("/scenes/0/nodes/0", json!(99), ": /scenes/0/nodes/0: refers to node 99, there are 5");
    check_fault("/scenes/0/nodes/0", json!(3), ": /scenes/0/nodes/0: node 3 is a child of node 2");
    check_fault("/scenes/0/nodes/0", json!(1), ": /scenes/0/nodes/1: node 1 is listed twice");
    check_fault("/nodes/0/children", json!([3]), ": /nodes/2/children/0: node 3 is a child of node 0 already");
    check_fault("/nodes/3/children", json!([1]), ": /nodes/1: the node is its own ancestor");
    check_fault("/nodes/0/children", json!([0]), ": /nodes/0: the node is its own ancestor");
    check_fault("/nodes/1/rotation", json!([0, 0, 0, 0]), ": /nodes/1/rotation: expected a unit quaternion");
    check_fault("/nodes/1/scale", json!([1, 2]), ": /nodes/1/scale: expected 3 numbers, found an array of 2");
    check_fault("/nodes/1/scale/0", json!("big"), ": /nodes/1/scale/0: expected a number");
    check_fault("/nodes/2/matrix/3", json!(1), ": /nodes/2/matrix: expected an affine matrix");
    check_fault("/nodes/1/translation/0", json!(1e39), ": /nodes/1/translation/0: expected a number within single");
    check_fault("/nodes/0/mesh", json!(2), ": /nodes/0/mesh: refers to mesh 2, there are 2");
    check_fault("/nodes/0/skin", json!(-1), ": /nodes/0/skin: expected a whole number, not negative, found -1");
    check_fault("/nodes/3/camera", json!(1.5), ": /nodes/3/camera: expected a whole number");
    check_fault("/nodes/3/extensions", json!([]), ": /nodes/3/extensions: expected an object");
    let light = "/nodes/3/extensions/KHR_lights_punctual/light";
    check_fault(light, json!(2), &format!(": {light}: refers to light 2, there are 2"));
    let light = "/extensions/KHR_lights_punctual/lights/0/type";
    check_fault(light, json!("sun"), &format!(": {light}: expected point, spot or directional, found \"sun\""));
    check_fault("/cameras/0/type", json!("fisheye"), ": /cameras/0/type: expected perspective or orthographic");
    check_fault("/cameras/0/perspective/yfov", json!(0), ": /cameras/0/perspective/yfov: expected a number greater");
    check_fault(
        "/cameras/0/perspective/yfov",
        json!(4),
        ": /cameras/0/perspective/yfov: expected an angle less than π",
    );
    check_fault(
        "/cameras/0/perspective/zfar",
        json!(0.05),
        ": /cameras/0/perspective/zfar: expected a distance greater",
    );
    check_fault("/cameras/1/orthographic/xmag", json!(0), ": /cameras/1/orthographic/xmag: expected a number other");
    check_fault("/meshes/0/primitives", json!(null), ": /meshes/0/primitives: expected an array, found null");
    check_fault("/meshes/1/primitives/0", json!({}), ": /meshes/1/primitives/0: there is no attributes");
    check_fault("/meshes/0/primitives/0/mode", json!(7), ": /meshes/0/primitives/0/mode: expected a mode from 0 to 6");
    check_fault("/meshes/0/primitives/0/material", json!(1), ": /meshes/0/primitives/0/material: refers to material 1");
    check_fault("/meshes/0/primitives/0/indices", json!(44), ": /meshes/0/primitives/0/indices: refers to accessor 44");
    check_fault(
        "/meshes/0/primitives/0/attributes/POSITION",
        json!(77),
        ": /meshes/0/primitives/0/attributes/POSITION: refers to accessor 77",
    );
    check_fault("/accessors/0/componentType", json!(5124), ": /accessors/0/componentType: expected a component type");
    check_fault("/accessors/0/type", json!("VEC5"), ": /accessors/0/type: expected SCALAR");
    check_fault("/accessors/0/type", json!("VEC4"), ": /accessors/0: needs 64 bytes, there are 48");
    check_fault("/accessors/0/byteOffset", json!(4), ": /accessors/0: needs 52 bytes, there are 48");
    check_fault("/accessors/1/type", json!("VEC2"), ": /accessors/1: expected 3 numbers to an element");
    check_fault("/accessors/1/count", json!(3), "/attributes/NORMAL: has 3 elements, POSITION has 4");
    check_fault("/accessors/0/bufferView", json!(50), ": /accessors/0/bufferView: refers to bufferView 50");
    check_fault("/accessors/9/sparse/count", json!(5), ": /accessors/9/sparse/count: expected at most the 4 elements");
    check_fault(
        "/accessors/9/sparse/indices/componentType",
        json!(5126),
        ": /accessors/9/sparse/indices: needs 8 bytes",
    );
    check_fault("/accessors/9/sparse/indices/byteOffset", json!(1), ": /accessors/9/sparse/indices: needs 3 bytes");
    check_fault("/accessors/9/count", json!(3), "refers to element 3, there are 3");
    check_fault("/bufferViews/0/byteLength", json!(100_000), ": /bufferViews/0: needs 100000 bytes");
    check_fault("/bufferViews/0/byteLength", json!(u64::MAX), ": /bufferViews/0: needs 18446744073709551615 bytes");
    check_fault("/bufferViews/0/byteStride", json!(8), ": /bufferViews/0/byteStride: expected at least the 12 bytes");
    check_fault("/bufferViews/0/byteStride", json!(-4), ": /bufferViews/0/byteStride: expected a whole number");
    check_fault("/bufferViews/0/byteStride", json!(256), ": /bufferViews/0/byteStride: expected a stride of 4 to 252");
    check_fault("/bufferViews/0/buffer", json!(1), ": /bufferViews/0/buffer: refers to buffer 1, there are 1");
    check_fault("/buffers/0/byteLength", json!(1_000_000), ": /buffers/0: needs 1000000 bytes");
    check_fault("/buffers/0/uri", json!("data:;base64,@@@"), ": /buffers/0/uri: cannot follow");
    check_fault("/buffers/0/uri", json!("data:nothing"), "a data URI has a comma before its data");
    check_fault("/textures/0/source", json!(1), ": /textures/0/source: refers to image 1, there are 1");
    check_fault("/textures/0/sampler", json!(1), ": /textures/0/sampler: refers to sampler 1, there are 1");
    check_fault("/samplers/0/wrapS", json!(1), ": /samplers/0/wrapS: expected 10497, 33071 or 33648, found 1");
    check_fault("/samplers/0/magFilter", json!(9984), ": /samplers/0/magFilter: expected one of [9728, 9729]");
    check_fault("/images/0", json!({}), ": /images/0: there is no uri or bufferView");
    check_fault("/materials/0/alphaMode", json!("SHINY"), ": /materials/0/alphaMode: expected OPAQUE, MASK or BLEND");
    check_fault(
        "/materials/0/normalTexture/index",
        json!(3),
        ": /materials/0/normalTexture/index: refers to texture 3",
    );
    check_fault("/materials/0/emissiveFactor", json!([1, 1]), ": /materials/0/emissiveFactor: expected 3 numbers");
    check_fault("/materials/0/doubleSided", json!(1), ": /materials/0/doubleSided: expected true or false, found 1");
    check_fault("/skins/0/joints/1", json!(12), ": /skins/0/joints/1: refers to node 12, there are 5");
    check_fault("/skins/0/joints", json!([2, 3, 4]), ": /accessors/8: expected a matrix for each of the 3 joints");
    check_fault("/extensionsRequired", json!(["ACME_fur"]), ": /extensionsRequired/0: the file requires ACME_fur");
    check_fault("/extensionsRequired", json!("ACME_fur"), ": /extensionsRequired: expected an array");
}

#[test]
fn containers_that_are_not_gltf_are_named_with_line_or_byte() {
    let valid = br#"{"asset":{"version":"2.0"}}"#;
    assert!(load_bytes(&glb(valid, &[])).is_ok());
    let with = |offset: usize, bytes: &[u8]| {
        let mut whole = glb(valid, &[1, 2, 3, 4]);
        whole[offset..offset + bytes.len()].copy_from_slice(bytes);
        whole
    };
    let deep = format!(r#"{{"asset":{}"#, "[".repeat(100_000));
    let cases: [(&[u8], &str); 14] = [
        (b"", "file.gltf: line 1 column 0: not JSON: EOF"),
        (b"[]", "file.gltf: line 1 column 1: not a JSON object"),
        (b"{\"asset\":\n{,}}", "file.gltf: line 2 column 2: not JSON: key must be a string"),
        (b"{\"asset\": {\"version\": \"2.0\"}} x", "not JSON: trailing characters"),
        (b"{\"asset\": 1e999}", "not JSON: number out of range"),
        (deep.as_bytes(), "not JSON: recursion limit exceeded"),
        (b"{}", "file.gltf: there is no asset"),
        (b"\xff\xfe{}", "not JSON"),
        (b"glTF", "file.gltf: byte 4: the GLB ends here, after 4 bytes"),
        (&with(4, &[1]), "byte 4: GLB version 1, only 2 is supported"),
        (&with(8, &[255, 255]), "byte 8: the GLB says it has 65535 bytes"),
        (&with(12, &[255, 255, 255, 255]), "byte 12: a chunk of 4294967295 bytes"),
        (&with(16, b"BIN\0"), "byte 16: the first chunk is not JSON"),
        (&with(48, &[200]), "byte 48: a chunk of 200 bytes, 4 are left"),
    ];
    for (bytes, expected) in cases {
        let message = error_of(load_bytes(bytes));
        assert!(message.contains(expected), "{message}, expected {expected}");
    }
    let missing = wavecast::load::load(std::path::Path::new("/nowhere/at all.gltf"), &Default::default());
    assert!(matches!(&missing, Err(LoadError::Read { .. })));
    assert!(error_of(missing).contains("/nowhere/at all.gltf: cannot read it"));
}
