//! Primitives, and how they become one mesh.

use std::sync::Arc;

use glam::{Vec2, Vec3, Vec4};
use serde_json::{Value, json};
use wavecast::world::{Geometry, MaterialSlots, Name, SceneKey, TriMesh};

use super::file::{F32, File, error_of, le, mesh_of, warnings};

/// Five points along a bent strip.
const POINTS: [f32; 15] = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 2.0, 0.0, 0.0];

#[track_caller]
fn check_mode(mode: Option<u32>, indices: Option<&[u16]>, expected: &[[u32; 3]]) {
    let mut file = File::new();
    let positions = file.floats("VEC3", &POINTS);
    let mut primitive = json!({"attributes": {"POSITION": positions}});
    if let Some(mode) = mode {
        primitive["mode"] = json!(mode);
    }
    if let Some(indices) = indices {
        primitive["indices"] = json!(file.indices(indices));
    }
    file.show(primitive);
    assert_eq!(file.mesh().triangles, expected);
}

/// glTF 2.0 section 3.7.2.1: strip triangle i is (i, i + 1 + i % 2, i + 2 − i % 2), fan triangle i is
/// (i + 1, i + 2, 0).
#[test]
fn lists_strips_and_fans_make_their_triangles_with_and_without_indices() {
    check_mode(None, None, &[[0, 1, 2]]);
    check_mode(Some(4), Some(&[4, 3, 2, 2, 1, 0]), &[[4, 3, 2], [2, 1, 0]]);
    check_mode(Some(5), None, &[[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
    check_mode(Some(5), Some(&[4, 3, 2, 1, 0]), &[[4, 3, 2], [3, 1, 2], [2, 1, 0]]);
    check_mode(Some(6), None, &[[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
    check_mode(Some(6), Some(&[4, 0, 1, 2, 3]), &[[0, 1, 4], [1, 2, 4], [2, 3, 4]]);
}

#[test]
fn points_and_lines_are_left_out_with_one_warning() {
    let mut file = File::new();
    let positions = file.floats("VEC3", &POINTS);
    for mode in 0..4 {
        file.show(json!({"attributes": {"POSITION": positions}, "mode": mode}));
    }
    let loaded = file.load().unwrap();
    assert!(loaded.scene.keys_with::<Geometry>().is_empty());
    assert_eq!(loaded.scene.keys_with::<Name>().len(), 4);
    assert_eq!(loaded.warnings.len(), 1);
    assert!(warnings(&loaded)[0].contains("points and lines are left out"));
}

#[test]
fn an_incomplete_last_triangle_is_left_out_with_a_warning() {
    let mut file = File::new();
    let positions = file.floats("VEC3", &POINTS);
    file.show(json!({"attributes": {"POSITION": positions}}));
    let loaded = file.load().unwrap();
    assert!(warnings(&loaded)[0].contains("/meshes/0/primitives/0: 5 is not a multiple of 3"));
    assert_eq!(file.mesh().triangles.len(), 1);
}

#[test]
fn an_index_beyond_the_vertices_is_an_error() {
    let mut file = File::new();
    let positions = file.triangle();
    let indices = file.indices(&[0, 1, 3]);
    file.show(json!({"attributes": {"POSITION": positions}, "indices": indices}));
    let message = error_of(file.load());
    assert!(message.ends_with("/meshes/0/primitives/0/indices: refers to vertex 3, there are 3"), "{message}");
}

#[test]
fn vertices_that_no_triangle_uses_are_dropped() {
    let mut file = File::new();
    let positions = file.floats("VEC3", &POINTS);
    let indices = file.indices(&[4, 2, 1]);
    file.show(json!({"attributes": {"POSITION": positions}, "indices": indices}));
    let mesh = file.mesh();
    assert_eq!(mesh.positions, [Vec3::Y, Vec3::X, 2.0 * Vec3::X]);
    assert_eq!(mesh.triangles, [[2, 1, 0]]);
}

/// Two primitives with two materials and one with none: three slots, the last without a material.
#[test]
fn primitives_are_merged_with_a_slot_per_material() {
    let mut file = File::new();
    for name in ["unused", "red", "blue"] {
        file.push("materials", json!({"name": name}));
    }
    let positions = file.triangle();
    let normals = file.floats("VEC3", &[0.0, 0.0, 2.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0]);
    let colors = file.floats("VEC3", &[0.5; 9]);
    let uvs = file.floats("VEC2", &[0.25; 6]);
    let mesh = file.push(
        "meshes",
        json!({"primitives": [
            {"attributes": {"POSITION": positions}, "material": 2},
            {"attributes": {"POSITION": positions, "NORMAL": normals, "TEXCOORD_1": uvs}},
            {"attributes": {"POSITION": positions, "COLOR_0": colors}, "material": 1},
            {"attributes": {"POSITION": positions}, "material": 2},
        ]}),
    );
    file.node(json!({"mesh": mesh}));
    let loaded = file.load().unwrap();
    let key = loaded.scene.keys_with::<Geometry>()[0];
    let mesh = mesh_of(&loaded, key);
    // The first and the last share their vertices.
    assert_eq!(mesh.positions.len(), 9);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 1, 2], [3, 4, 5], [6, 7, 8]]);
    assert_eq!(mesh.slots, [0, 0, 1, 2]);
    let mut normals = [Vec3::ZERO; 9];
    (normals[3], normals[4]) = (Vec3::Z, Vec3::Y);
    assert_eq!(mesh.normals, normals);
    assert_eq!(mesh.colors[5..7], [Vec4::ONE, Vec4::new(0.5, 0.5, 0.5, 1.0)]);
    assert_eq!(mesh.uvs.len(), 2);
    assert!(mesh.uvs[0].is_empty());
    assert_eq!(mesh.uvs[1][2..4], [Vec2::ZERO, Vec2::splat(0.25)]);
    let slots = loaded.scene.get::<MaterialSlots>(key).unwrap();
    let name = |slot: usize| loaded.scene.get::<Name>(slots.0[slot]).map(|name| name.0.to_string());
    assert_eq!([0, 1, 2].map(name), [Some("blue".to_owned()), None, Some("red".to_owned())]);
    assert!(loaded.scene.find("unused").is_none());
}

#[test]
fn nodes_share_a_mesh_and_so_do_meshes_of_the_same_accessors() {
    let mut file = File::new();
    file.push("materials", json!({}));
    let positions = file.triangle();
    let plain = file.push("meshes", json!({"primitives": [{"attributes": {"POSITION": positions}}]}));
    let painted = json!({"primitives": [{"attributes": {"POSITION": positions}, "material": 0}]});
    let painted = file.push("meshes", painted);
    for mesh in [plain, plain, painted] {
        file.node(json!({"mesh": mesh}));
    }
    let loaded = file.load().unwrap();
    let keys = loaded.scene.keys_with::<Geometry>();
    let meshes: Vec<Arc<TriMesh>> = keys.iter().map(|&key| mesh_of(&loaded, key)).collect();
    assert!(Arc::ptr_eq(&meshes[0], &meshes[1]) && Arc::ptr_eq(&meshes[0], &meshes[2]));
    let slots = |key: SceneKey| loaded.scene.get::<MaterialSlots>(key).unwrap();
    assert_ne!(slots(keys[0]), slots(keys[2]));
    assert_eq!(loaded.info.counts.triangles, 2);
    assert_eq!(loaded.info.counts.instanced_triangles, 3);
}

#[test]
fn normals_come_out_at_length_one_and_tangents_only_beside_them() {
    let tangents = [2.0, 0.0, 0.0, -0.5, 0.0, 1.0, 0.0, 1.0, f32::NAN, 0.0, 0.0, 1.0];
    for with_normals in [true, false] {
        let mut file = File::new();
        let positions = file.triangle();
        let normals = file.floats("VEC3", &[0.0, 0.0, 1e-30, 0.0, 0.0, 1e30, 0.0, f32::INFINITY, 0.0]);
        let tangents = file.floats("VEC4", &tangents);
        let mut attributes = json!({"POSITION": positions, "TANGENT": tangents});
        if with_normals {
            attributes["NORMAL"] = json!(normals);
        }
        file.show(json!({"attributes": attributes}));
        let (mesh, loaded) = (file.mesh(), file.load().unwrap());
        if with_normals {
            assert_eq!(mesh.normals, [Vec3::Z, Vec3::Z, Vec3::ZERO]);
            assert_eq!(mesh.tangents, [Vec4::new(1.0, 0.0, 0.0, -1.0), Vec4::new(0.0, 1.0, 0.0, 1.0), Vec4::ZERO]);
            let said = warnings(&loaded);
            assert!(said[0].contains("/meshes/0/primitives/0/attributes/NORMAL: 1 normals are not finite"));
            assert!(said[1].contains("/attributes/TANGENT: 1 tangents are not finite"), "{said:?}");
        } else {
            assert!(mesh.normals.is_empty() && mesh.tangents.is_empty());
            assert!(loaded.warnings.is_empty());
        }
    }
}

#[test]
fn a_position_that_is_not_finite_is_an_error() {
    let mut file = File::new();
    let positions = file.accessor(F32, "VEC3", 3, &le(&[0.0, 0.0, 0.0, 1.0, f32::NAN, 0.0, 0.0, 1.0, 0.0]));
    file.show(json!({"attributes": {"POSITION": positions}}));
    let message = error_of(file.load());
    assert!(message.contains("/meshes/0/primitives/0/attributes/POSITION: expected finite positions"), "{message}");
    assert!(message.contains("at vertex 1"), "{message}");
}

#[test]
fn an_attribute_of_another_length_is_an_error() {
    let mut file = File::new();
    let positions = file.triangle();
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    file.show(json!({"attributes": {"POSITION": positions, "NORMAL": normals}}));
    let message = error_of(file.load());
    assert!(message.ends_with("/meshes/0/primitives/0/attributes/NORMAL: has 2 elements, POSITION has 3"), "{message}");
}

/// A mesh in the plane z = 0 with the given coordinates and a normal map along set `set`.
fn normal_mapped(positions: &[f32], uvs: &[f32], indices: &[u16], set: usize, normals: bool) -> File {
    let mut file = File::new();
    let image = super::file::png(1, 1, png::ColorType::Rgb, png::BitDepth::Eight, &[128, 128, 255]);
    let view = file.view(&image);
    file.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
    file.push("textures", json!({"source": 0}));
    file.push("materials", json!({"normalTexture": {"index": 0, "texCoord": set}}));
    let count = positions.len() / 3;
    let position = file.floats("VEC3", positions);
    let normal = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(count));
    let right = file.floats("VEC2", uvs);
    let wrong = file.floats("VEC2", &vec![0.5; 2 * count]);
    let mut attributes = json!({"POSITION": position});
    for other in 0..=set {
        attributes[format!("TEXCOORD_{other}")] = json!(if other == set { right } else { wrong });
    }
    if normals {
        attributes["NORMAL"] = json!(normal);
    }
    let indices = file.indices(indices);
    let primitive: Value = json!({"attributes": attributes, "indices": indices, "material": 0});
    file.show(primitive);
    file
}

const SQUARE: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0];

/// The tangent runs along growing u; the bitangent w·(n × t) runs against growing v, which is
/// up in the image. The square's triangles agree, so that it keeps its four vertices.
#[test]
fn missing_tangents_follow_the_texture_coordinates_of_the_normal_map() {
    let upright = [0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0];
    let mirrored = upright.chunks(2).flat_map(|uv| [1.0 - uv[0], uv[1]]).collect::<Vec<f32>>();
    for set in [0, 1] {
        for normals in [true, false] {
            let mesh = normal_mapped(&SQUARE, &upright, &[0, 1, 2, 0, 2, 3], set, normals).mesh();
            assert_eq!(mesh.tangents, [Vec4::new(1.0, 0.0, 0.0, 1.0); 4], "set {set}, normals {normals}");
            let mesh = normal_mapped(&SQUARE, &mirrored, &[0, 1, 2, 0, 2, 3], set, normals).mesh();
            assert_eq!(mesh.tangents, [Vec4::new(-1.0, 0.0, 0.0, -1.0); 4], "set {set}, normals {normals}");
            assert_eq!(mesh.normals.len(), if normals { 4 } else { 0 });
        }
    }
}

/// Two squares side by side, the texture mirrored between them: the two vertices on the seam
/// have a tangent to either side and become four.
#[test]
fn vertices_are_split_where_tangents_disagree() {
    let positions = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];
    let uvs = [1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mesh = normal_mapped(&positions, &uvs, &[0, 1, 4, 0, 4, 3, 1, 2, 5, 1, 5, 4], 0, true).mesh();
    mesh.check().unwrap();
    assert_eq!((mesh.positions.len(), mesh.normals.len(), mesh.uvs[0].len()), (8, 8, 8));
    for (row, triangle) in mesh.triangles.iter().enumerate() {
        let expected = if row < 2 { Vec4::new(-1.0, 0.0, 0.0, -1.0) } else { Vec4::new(1.0, 0.0, 0.0, 1.0) };
        for &vertex in triangle {
            assert_eq!(mesh.tangents[vertex as usize], expected, "triangle {row}");
        }
    }
}

#[test]
fn a_normal_map_without_its_coordinates_is_left_out_with_a_warning() {
    let mut file = normal_mapped(&SQUARE, &[0.0; 8], &[0, 1, 2], 0, true);
    file.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("TEXCOORD_0");
    assert!(warnings(&file.load().unwrap())[0].contains("its normal map needs TEXCOORD_0"));
    assert!(file.mesh().tangents.is_empty());
}
