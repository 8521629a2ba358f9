//! Accessors of every kind, with the numbers they must give.

use glam::{Vec2, Vec3, Vec4};
use serde_json::json;

use super::file::{F32, File, I8, I16, U8, U16, U32, error_of, le};

/// A triangle whose POSITION holds nine numbers in the given form gives the `expected` ones.
#[track_caller]
fn check_positions(component: u32, normalized: bool, bytes: &[u8], expected: [f32; 9]) {
    let mut file = File::new();
    let accessor = file.accessor(component, "VEC3", 3, bytes);
    file.json["accessors"][accessor]["normalized"] = json!(normalized);
    file.show(json!({"attributes": {"POSITION": accessor}}));
    let got: Vec<f32> = file.mesh().positions.iter().flat_map(|p| p.to_array()).collect();
    assert_eq!(got, expected);
}

fn bytes16(values: [i16; 9]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// f = max(c / 127, −1) for signed bytes, c / 255 for unsigned, likewise 32767 and 65535
/// (glTF 2.0 section 3.6.2.2, KHR_mesh_quantization); else the number itself.
#[test]
fn every_component_type_gives_its_numbers_normalised_or_not() {
    let i8s = [-128i8, -127, -1, 0, 1, 127, 64, -64, 2];
    let bytes = i8s.map(|x| x as u8);
    check_positions(I8, false, &bytes, i8s.map(f32::from));
    let t = |x: f32| x / 127.0;
    check_positions(I8, true, &bytes, [-1.0, -1.0, t(-1.0), 0.0, t(1.0), 1.0, t(64.0), t(-64.0), t(2.0)]);

    let u8s = [0u8, 1, 2, 127, 128, 254, 255, 51, 102];
    check_positions(U8, false, &u8s, u8s.map(f32::from));
    let t = |x: f32| x / 255.0;
    check_positions(U8, true, &u8s, [0.0, t(1.0), t(2.0), t(127.0), t(128.0), t(254.0), 1.0, 0.2, 0.4]);

    let i16s = [-32768i16, -32767, -1, 0, 1, 32767, 256, -256, 258];
    check_positions(I16, false, &bytes16(i16s), i16s.map(f32::from));
    let t = |x: f32| x / 32767.0;
    let expected = [-1.0, -1.0, t(-1.0), 0.0, t(1.0), 1.0, t(256.0), t(-256.0), t(258.0)];
    check_positions(I16, true, &bytes16(i16s), expected);

    let u16s = [0u16, 1, 255, 256, 32768, 65534, 65535, 13107, 26214];
    let bytes = bytes16(u16s.map(|x| x as i16));
    check_positions(U16, false, &bytes, u16s.map(f32::from));
    let t = |x: f32| x / 65535.0;
    let expected = [0.0, t(1.0), t(255.0), t(256.0), t(32768.0), t(65534.0), 1.0, 0.2, 0.4];
    check_positions(U16, true, &bytes, expected);

    let floats = [0.0, -0.5, 1e-30, 1e30, 3.25, -1.0, 0.1, 7.0, 1e-3];
    check_positions(F32, false, &le(&floats), floats);
    check_positions(F32, true, &le(&floats), floats);
}

#[test]
fn positions_of_32_bit_integers_are_refused() {
    let mut file = File::new();
    let accessor = file.accessor(U32, "VEC3", 3, &[0; 36]);
    file.show(json!({"attributes": {"POSITION": accessor}}));
    let message = error_of(file.load());
    assert!(message.contains("/accessors/0: expected floats or small integers"), "{message}");
}

#[test]
fn indices_of_every_size_give_the_same_triangles() {
    for (component, bytes) in [
        (U8, vec![2u8, 1, 0, 0, 1, 3]),
        (U16, [2u16, 1, 0, 0, 1, 3].iter().flat_map(|x| x.to_le_bytes()).collect()),
        (U32, [2u32, 1, 0, 0, 1, 3].iter().flat_map(|x| x.to_le_bytes()).collect()),
    ] {
        let mut file = File::new();
        let positions = file.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        let indices = file.accessor(component, "SCALAR", 6, &bytes);
        file.show(json!({"attributes": {"POSITION": positions}, "indices": indices}));
        assert_eq!(file.mesh().triangles, [[2, 1, 0], [0, 1, 3]], "component type {component}");
    }
    let mut file = File::new();
    let positions = file.triangle();
    let indices = file.floats("SCALAR", &[0.0, 1.0, 2.0]);
    file.show(json!({"attributes": {"POSITION": positions}, "indices": indices}));
    assert!(error_of(file.load()).contains("/accessors/1: expected unsigned integers"));
}

/// Values 1 and 2 replace rows 1 and 3 of four; the rest comes from the base, or is zero.
#[test]
fn sparse_values_replace_those_of_the_base_or_zeros() {
    for (component, indices) in [(U8, vec![1u8, 3]), (U16, vec![1, 0, 3, 0]), (U32, vec![1, 0, 0, 0, 3, 0, 0, 0])] {
        for based in [true, false] {
            let mut file = File::new();
            let base = file.view(&le(&[9.0, 9.0, 9.0, 8.0, 8.0, 8.0, 7.0, 7.0, 7.0, 6.0, 6.0, 6.0]));
            let rows = file.view(&indices);
            let values = file.view(&le(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
            let mut accessor = json!({
                "componentType": F32, "type": "VEC3", "count": 4,
                "sparse": {
                    "count": 2,
                    "indices": {"bufferView": rows, "componentType": component},
                    "values": {"bufferView": values},
                },
            });
            if based {
                accessor["bufferView"] = json!(base);
            }
            let positions = file.push("accessors", accessor);
            let order = file.indices(&[0, 1, 2, 3, 2, 1]);
            file.show(json!({"attributes": {"POSITION": positions}, "indices": order}));
            let [first, third] = if based { [9.0, 7.0] } else { [0.0, 0.0] };
            let expected = [Vec3::splat(first), Vec3::new(1.0, 2.0, 3.0), Vec3::splat(third), Vec3::new(4.0, 5.0, 6.0)];
            assert_eq!(file.mesh().positions, expected, "{component} {based}");

            // The same with some rows unused, which reads them one by one.
            let order = file.indices(&[3, 2, 3]);
            file.json["meshes"][0]["primitives"][0]["indices"] = json!(order);
            let mesh = file.mesh();
            assert_eq!((&mesh.positions[..], &mesh.triangles[..]), (&expected[2..], &[[1, 0, 1]][..]));
        }
    }
}

#[test]
fn an_accessor_without_a_view_is_zero() {
    let mut file = File::new();
    let positions = file.triangle();
    let uvs = file.push("accessors", json!({"componentType": F32, "type": "VEC2", "count": 3}));
    file.show(json!({"attributes": {"POSITION": positions, "TEXCOORD_0": uvs}}));
    assert_eq!(file.mesh().uvs, [[Vec2::ZERO; 3]]);
}

/// Three vertices of 24 bytes: position, four bytes to skip, uv as normalised shorts, colour as bytes.
#[test]
fn interleaved_attributes_are_told_apart_by_stride_and_offset() {
    let mut bytes = vec![0xee; 8];
    for i in 0..3u8 {
        bytes.extend(le(&[f32::from(i), 10.0 + f32::from(i), 20.0]));
        bytes.extend([0xee; 4]);
        bytes.extend([255, 255, 51 * i, 51 * i]);
        bytes.extend([255 - 51 * i, 0, 51, 255]);
    }
    let mut file = File::new();
    let view = file.view(&bytes);
    file.json["bufferViews"][view]["byteStride"] = json!(24);
    let mut attribute = |offset: usize, component: u32, shape: &str, normalized: bool| {
        let accessor = json!({
            "bufferView": view, "byteOffset": 8 + offset, "componentType": component,
            "type": shape, "count": 3, "normalized": normalized,
        });
        file.push("accessors", accessor)
    };
    let positions = attribute(0, F32, "VEC3", false);
    let uvs = attribute(16, U16, "VEC2", true);
    let colors = attribute(20, U8, "VEC4", true);
    file.show(json!({"attributes": {"POSITION": positions, "TEXCOORD_0": uvs, "COLOR_0": colors}}));
    let mesh = file.mesh();
    assert_eq!(mesh.positions, [0.0, 1.0, 2.0].map(|i| Vec3::new(i, 10.0 + i, 20.0)));
    assert_eq!(mesh.uvs, [[Vec2::new(1.0, 0.0), Vec2::new(1.0, 0.2), Vec2::new(1.0, 0.4)]]);
    assert_eq!(mesh.colors, [1.0, 0.8, 0.6].map(|r| Vec4::new(r, 0.0, 0.2, 1.0)));
}

#[test]
fn vertex_colours_of_every_form_become_four_floats() {
    let expected = [[0.0, 0.2, 0.4], [0.6, 0.8, 1.0], [1.0, 0.0, 1.0]];
    let flat: Vec<f32> = expected.into_iter().flatten().collect();
    let bytes: Vec<u8> = flat.iter().map(|x| (x * 255.0).round() as u8).collect();
    let shorts: Vec<u8> = flat.iter().flat_map(|x| ((x * 65535.0).round() as u16).to_le_bytes()).collect();
    for (component, bytes) in [(F32, le(&flat)), (U8, bytes), (U16, shorts)] {
        let mut file = File::new();
        let positions = file.triangle();
        let colors = file.accessor(component, "VEC3", 3, &bytes);
        file.json["accessors"][colors]["normalized"] = json!(component != F32);
        file.show(json!({"attributes": {"POSITION": positions, "COLOR_0": colors}}));
        assert_eq!(file.mesh().colors, expected.map(|c| Vec3::from(c).extend(1.0)), "{component}");
    }
}

#[test]
fn counts_beyond_the_data_are_refused_before_memory_is_taken() {
    let mut file = File::new();
    let positions = file.triangle();
    file.show(json!({"attributes": {"POSITION": positions}}));
    file.json["accessors"][0]["count"] = json!(4_000_000_000u64);
    assert!(error_of(file.load()).contains("/accessors/0: needs 48000000000 bytes, there are 36"));
    // Without a view nothing bounds the count but the size of the file.
    file.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert!(error_of(file.load()).contains("/accessors/0: asks for 4000000000 elements"));
    file.json["accessors"][0]["count"] = json!(u64::MAX);
    assert!(error_of(file.load()).contains("at most 2³² vertices"));
}

/// Ten thousand primitives that each copy the same big accessor would fill any memory.
#[test]
fn the_same_data_may_not_be_multiplied_without_bound() {
    let mut file = File::new();
    let positions = file.accessor(U8, "VEC3", 30_000, &[7; 90_000]);
    for i in 0..2_000 {
        // Another material each time keeps them from being shared.
        file.push("materials", json!({}));
        file.push("materials", json!({}));
        let primitive =
            |material: usize| json!({"attributes": {"POSITION": positions, "_": material}, "material": material});
        let mesh = file.push("meshes", json!({"primitives": [primitive(2 * i), primitive(2 * i + 1)]}));
        file.node(json!({"mesh": mesh}));
    }
    let message = error_of(file.load());
    assert!(message.contains("elements, at most"), "{message}");
}
