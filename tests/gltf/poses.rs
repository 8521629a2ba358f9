//! Skins and morph targets in the pose that the file stands in.

use glam::{DAffine3, DVec3, Vec3};
use serde_json::{Value, json};
use wavecast::world::{Geometry, LocalTransform, Name, Parent, PointLight};

use super::file::{File, I16, U8, U16, error_of, mesh_of, only_mesh, warnings};

#[track_caller]
fn check_close(got: &[Vec3], expected: &[[f32; 3]]) {
    assert_eq!(got.len(), expected.len());
    for (got, &expected) in got.iter().zip(expected) {
        assert!(got.distance(Vec3::from(expected)) < 1e-6, "got {got}, expected {expected:?}");
    }
}

/// Joint 0 at the origin; joint 1 at (0, 1, 0), turned by 90° about z, bound at (0, 1, 0) unturned.
///
/// A point p follows joint 1 to (0, 1, 0) + Rz(90°)(p − (0, 1, 0)), so (0, 2, 0) goes to (−1, 1, 0).
fn skinned(joint_type: u32, sets: usize) -> File {
    let mut file = File::new();
    let positions = file.floats("VEC3", &[0.0, 2.0, 0.0, 0.0, 2.0, 0.0, 0.0, 2.0, 0.0]);
    let normals = file.floats("VEC3", &[1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    // One vertex each: joint 0 alone, joint 1 alone, both alike; the second set repeats the first.
    let joints: [u8; 12] = [0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0];
    let joints = match joint_type {
        U8 => joints.to_vec(),
        _ => joints.iter().flat_map(|&x| [x, 0]).collect(),
    };
    let joints = file.accessor(joint_type, "VEC4", 3, &joints);
    let weights = file.accessor(U8, "VEC4", 3, &[255, 0, 0, 0, 255, 0, 0, 0, 100, 100, 0, 0]);
    file.json["accessors"][weights]["normalized"] = json!(true);
    let mut attributes = json!({"POSITION": positions, "NORMAL": normals});
    for set in 0..sets {
        attributes[format!("JOINTS_{set}")] = json!(joints);
        attributes[format!("WEIGHTS_{set}")] = json!(weights);
    }
    let mesh = file.push("meshes", json!({"primitives": [{"attributes": attributes}]}));
    let mut binds = vec![0.0f32; 32];
    for i in [0, 5, 10, 15] {
        (binds[i], binds[16 + i]) = (1.0, 1.0);
    }
    binds[16 + 13] = -1.0;
    let binds = file.floats("MAT4", &binds);
    file.push("skins", json!({"joints": [1, 2], "inverseBindMatrices": binds}));
    file.node(json!({"mesh": mesh, "skin": 0, "translation": [100, 0, 0], "name": "body"}));
    file.node(json!({"children": [2]}));
    let half = std::f64::consts::FRAC_1_SQRT_2;
    file.push("nodes", json!({"translation": [0, 1, 0], "rotation": [0, 0, half, half]}));
    file
}

#[test]
fn a_skin_bends_positions_and_normals_and_ignores_its_nodes_transform() {
    for joint_type in [U8, U16] {
        for sets in [1, 2] {
            let file = skinned(joint_type, sets);
            let loaded = file.load().unwrap();
            let mesh = only_mesh(&loaded);
            check_close(&mesh.positions, &[[0.0, 2.0, 0.0], [-1.0, 1.0, 0.0], [-0.5, 1.5, 0.0]]);
            let half = 0.5f32.sqrt();
            check_close(&mesh.normals, &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [half, half, 0.0]]);
            let key = loaded.scene.find("body").unwrap();
            let local = loaded.scene.get::<LocalTransform>(key).unwrap();
            assert_eq!(local.to_affine(), DAffine3::IDENTITY);
            assert!(loaded.warnings.is_empty());
        }
    }
}

/// Without inverse bind matrices they are identities: (0, 2, 0) goes to (0, 1, 0) + (−2, 0, 0).
#[test]
fn missing_inverse_bind_matrices_are_identities() {
    let mut file = skinned(U8, 1);
    file.json["skins"][0].as_object_mut().unwrap().remove("inverseBindMatrices");
    check_close(&file.mesh().positions, &[[0.0, 2.0, 0.0], [-2.0, 1.0, 0.0], [-1.0, 1.5, 0.0]]);
}

/// What else hangs on the node of a skinned mesh stays where the node is.
#[test]
fn a_skinned_node_with_children_keeps_its_place_beside_its_mesh() {
    let mut file = skinned(U8, 1);
    file.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point"}]}});
    let child = json!({"name": "child", "extensions": {"KHR_lights_punctual": {"light": 0}}});
    let child = file.push("nodes", child);
    file.json["nodes"][0]["children"] = json!([child]);
    let loaded = file.load().unwrap();
    let child = loaded.scene.find("child").unwrap();
    assert!(loaded.scene.get::<PointLight>(child).is_some());
    let parent = loaded.scene.get::<Parent>(child).unwrap().0;
    let moved = loaded.scene.get::<LocalTransform>(parent).unwrap().to_affine();
    assert_eq!(moved.translation, DVec3::new(100.0, 0.0, 0.0));
    assert!(loaded.scene.get::<Geometry>(parent).is_none());
    let shown = loaded.scene.keys_with::<Geometry>()[0];
    assert_eq!(loaded.scene.get::<LocalTransform>(shown), Some(LocalTransform::IDENTITY));
    assert!(loaded.scene.get::<Parent>(shown).is_none());
    assert_eq!(loaded.scene.get::<Name>(shown).unwrap().0.as_ref(), "body");
    check_close(&mesh_of(&loaded, shown).positions[1..2], &[[-1.0, 1.0, 0.0]]);
}

/// A joint that mirrors would turn the triangles inside out; they are turned back.
#[test]
fn a_mirroring_joint_keeps_the_front_outside() {
    let mut file = skinned(U8, 1);
    file.json["nodes"][1]["scale"] = json!([-1, 1, 1]);
    assert_eq!(file.mesh().triangles, [[0, 2, 1]]);
    assert_eq!(skinned(U8, 1).mesh().triangles, [[0, 1, 2]]);
}

#[test]
fn faults_of_skins_are_named() {
    let mut file = skinned(U8, 1);
    file.json["skins"][0]["joints"] = json!([1]);
    let message = error_of(file.load());
    assert!(message.ends_with("/meshes/0/primitives/0/attributes: refers to joint 1, there are 1"), "{message}");

    let mut file = skinned(U8, 1);
    file.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("WEIGHTS_0");
    assert!(error_of(file.load()).contains("/meshes/0/primitives/0/attributes: there is no WEIGHTS_0"));

    let mut file = skinned(U8, 1);
    let attributes = file.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap();
    attributes.remove("JOINTS_0");
    let loaded = file.load().unwrap();
    assert!(warnings(&loaded)[0].contains("it has no JOINTS_0 though its node has a skin"));
    check_close(&only_mesh(&loaded).positions[..1], &[[100.0, 2.0, 0.0]]);
}

/// The triangle (0,0,0), (1,0,0), (0,1,0) with two targets: up by (0, 0, 4) and all by (8, 0, 0).
fn morphed(mesh_weights: Value, node_weights: Value) -> File {
    let mut file = File::new();
    let positions = file.triangle();
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    // Quantised: 16-bit integers as they are.
    let deltas: Vec<u8> = [0i16, 0, 0, 0, 0, 0, 0, 0, 4].iter().flat_map(|x| x.to_le_bytes()).collect();
    let up = file.accessor(I16, "VEC3", 3, &deltas);
    let turn = file.floats("VEC3", &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0]);
    // Sparse over zeros, as exporters write targets.
    let (rows, values) = (file.view(&[0, 1, 2]), file.view(&super::file::le(&[8.0, 0.0, 0.0].repeat(3))));
    let aside = file.push(
        "accessors",
        json!({
            "componentType": 5126, "type": "VEC3", "count": 3,
            "sparse": {"count": 3, "indices": {"bufferView": rows, "componentType": U8}, "values": {"bufferView": values}},
        }),
    );
    let primitive = json!({
        "attributes": {"POSITION": positions, "NORMAL": normals},
        "targets": [{"POSITION": up, "NORMAL": turn}, {"POSITION": aside}],
    });
    let mut mesh = json!({"primitives": [primitive]});
    let mut node = json!({"mesh": 0, "translation": [0, 0, 0]});
    for (owner, weights) in [(&mut mesh, mesh_weights), (&mut node, node_weights)] {
        if !weights.is_null() {
            owner["weights"] = weights;
        }
    }
    file.push("meshes", mesh);
    file.node(node);
    file
}

/// p = base + Σ w·delta; the node's weights go before the mesh's.
#[test]
fn morph_targets_are_added_by_their_weights() {
    let rest = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    check_close(&morphed(Value::Null, Value::Null).mesh().positions, &rest);
    check_close(&morphed(json!([0, 0]), Value::Null).mesh().positions, &rest);
    let half = morphed(json!([0.5, 0]), Value::Null).mesh();
    check_close(&half.positions, &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 2.0]]);
    // Normal (0, 0, 1) + ½·(0, 2, 0), at length one.
    check_close(&half.normals, &[[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.5f32.sqrt(), 0.5f32.sqrt()]]);
    let node = morphed(json!([0.5, 0]), json!([1, -0.25])).mesh();
    check_close(&node.positions, &[[-2.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [-2.0, 1.0, 4.0]]);
}

#[test]
fn nodes_that_morph_a_mesh_otherwise_do_not_share_it() {
    let mut file = morphed(json!([1, 0]), Value::Null);
    file.node(json!({"mesh": 0, "weights": [0, 0]}));
    file.node(json!({"mesh": 0, "weights": [1, 0]}));
    let loaded = file.load().unwrap();
    let keys = loaded.scene.keys_with::<Geometry>();
    let heights = [0, 1, 2].map(|i| mesh_of(&loaded, keys[i]).positions[2].z);
    assert_eq!(heights, [4.0, 0.0, 4.0]);
    assert!(std::sync::Arc::ptr_eq(&mesh_of(&loaded, keys[0]), &mesh_of(&loaded, keys[2])));
}

#[test]
fn weights_that_do_not_match_the_targets_are_an_error() {
    let message = error_of(morphed(json!([1]), Value::Null).load());
    assert!(message.contains("/meshes/0/weights: expected 2 weights, one per morph target"), "{message}");
}
