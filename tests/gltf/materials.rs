//! Materials, textures and images.

use std::sync::Arc;

use glam::Vec3;
use png::{BitDepth, ColorType};
use serde_json::{Value, json};
use wavecast::{
    load::Loaded,
    world::{AlphaMode, Filter, Material, SceneKey, Texels, UvTransform, Wrap},
};

use super::file::{File, error_of, png, warnings};

/// A file that shows one triangle in the given material.
fn painted(material: Value) -> File {
    let mut file = File::new();
    file.push("materials", material);
    let positions = file.triangle();
    file.show(json!({"attributes": {"POSITION": positions}, "material": 0}));
    file
}

fn material_of(loaded: &Loaded) -> Material {
    loaded.scene.get(SceneKey(0)).expect("key 0 is the material")
}

#[test]
fn an_empty_material_has_gltfs_defaults() {
    let loaded = painted(json!({})).load().unwrap();
    assert_eq!(material_of(&loaded), Material::default());
    let empty = json!({"extensions": {
        "KHR_materials_ior": {}, "KHR_materials_specular": {}, "KHR_materials_transmission": {},
        "KHR_materials_volume": {}, "KHR_materials_emissive_strength": {},
    }, "pbrMetallicRoughness": {}});
    assert_eq!(material_of(&painted(empty).load().unwrap()), Material::default());
}

#[test]
fn every_factor_lands_in_its_field() {
    let loaded = painted(json!({
        "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.5, "roughnessFactor": 0.6},
        "emissiveFactor": [0.25, 0.5, 1.0], "alphaMode": "MASK", "alphaCutoff": 0.75, "doubleSided": true,
        "extensions": {
            "KHR_materials_emissive_strength": {"emissiveStrength": 8},
            "KHR_materials_ior": {"ior": 1.25},
            "KHR_materials_specular": {"specularFactor": 0.7, "specularColorFactor": [2, 1, 0]},
            "KHR_materials_transmission": {"transmissionFactor": 0.8},
            "KHR_materials_volume": {"thicknessFactor": 3, "attenuationDistance": 4, "attenuationColor": [0.9, 0.8, 0.7]},
            "KHR_materials_unlit": {},
        },
    }))
    .load()
    .unwrap();
    let expected = Material {
        base_color: Vec3::new(0.1, 0.2, 0.3),
        base_alpha: 0.4,
        metallic: 0.5,
        roughness: 0.6,
        emissive: Vec3::new(2.0, 4.0, 8.0),
        alpha_mode: AlphaMode::Mask { cutoff: 0.75 },
        double_sided: true,
        unlit: true,
        specular: 0.7,
        specular_color: Vec3::new(2.0, 1.0, 0.0),
        ior: 1.25,
        transmission: 0.8,
        thickness: 3.0,
        attenuation_distance: 4.0,
        attenuation_color: Vec3::new(0.9, 0.8, 0.7),
        ..Material::default()
    };
    assert_eq!(material_of(&loaded), expected);
    assert!(loaded.warnings.is_empty());
}

#[test]
fn factors_out_of_range_are_clamped_with_a_warning_each() {
    let loaded = painted(json!({
        "pbrMetallicRoughness": {"baseColorFactor": [2, 0, 0, 1], "metallicFactor": -1, "roughnessFactor": 1.5},
        "emissiveFactor": [3, 0, 0],
        "extensions": {"KHR_materials_ior": {"ior": 0.5}, "KHR_materials_volume": {"attenuationDistance": 0}},
    }))
    .load()
    .unwrap();
    let material = material_of(&loaded);
    assert_eq!((material.base_color, material.metallic, material.roughness), (Vec3::X, 0.0, 1.0));
    assert_eq!((material.emissive, material.ior), (Vec3::X, 1.0));
    assert!(material.attenuation_distance > 0.0);
    let said = warnings(&loaded).join("\n");
    for place in [
        "/materials/0/pbrMetallicRoughness/baseColorFactor:",
        "/materials/0/pbrMetallicRoughness/metallicFactor:",
        "/materials/0/pbrMetallicRoughness/roughnessFactor:",
        "/materials/0/emissiveFactor:",
        "/materials/0/extensions/KHR_materials_ior/ior:",
        "/materials/0/extensions/KHR_materials_volume/attenuationDistance:",
    ] {
        assert!(said.contains(place), "{place} in {said}");
    }
    assert_eq!(loaded.warnings.len(), 6);
    let zero = painted(json!({"extensions": {"KHR_materials_ior": {"ior": 0}}})).load().unwrap();
    assert_eq!((material_of(&zero).ior, zero.warnings.len()), (0.0, 0));
}

/// Every texture slot looks into image 0 its own way.
#[test]
fn textures_keep_their_sampler_set_and_transform_and_share_their_image() {
    let transform =
        json!({"KHR_texture_transform": {"offset": [1, 2], "rotation": 0.5, "scale": [3, 4], "texCoord": 2}});
    let mut file = painted(json!({
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 0, "texCoord": 1, "extensions": transform},
            "metallicRoughnessTexture": {"index": 1},
        },
        "normalTexture": {"index": 2, "scale": -2, "extensions": transform},
        "emissiveTexture": {"index": 3, "texCoord": 1},
        "extensions": {
            "KHR_materials_specular": {"specularTexture": {"index": 4}, "specularColorTexture": {"index": 0}},
            "KHR_materials_transmission": {"transmissionTexture": {"index": 0}},
        },
    }));
    let view = file.view(&png(1, 1, ColorType::Rgb, BitDepth::Eight, &[1, 2, 3]));
    file.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
    file.push("images", json!({"uri": "never read because nothing uses it.png"}));
    for sampler in [
        json!({"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}),
        json!({"wrapS": 10497, "magFilter": 9729, "minFilter": 9728}),
        json!({"minFilter": 9986}),
        json!({"minFilter": 9985}),
    ] {
        let sampler = file.push("samplers", sampler);
        file.push("textures", json!({"source": 0, "sampler": sampler}));
    }
    file.push("textures", json!({"source": 0}));
    let loaded = file.load().unwrap();
    let m = material_of(&loaded);
    let base = m.base_color_texture.unwrap();
    assert_eq!((base.wrap_u, base.wrap_v, base.filter), (Wrap::ClampToEdge, Wrap::MirroredRepeat, Filter::Nearest));
    assert_eq!(base.tex_coord, 2);
    assert_eq!(base.transform, UvTransform { offset: [1.0, 2.0], rotation: 0.5, scale: [3.0, 4.0] });
    let rough = m.metallic_roughness_texture.unwrap();
    assert_eq!((rough.wrap_u, rough.filter, rough.tex_coord), (Wrap::Repeat, Filter::Linear, 0));
    let normal = m.normal_texture.unwrap();
    assert_eq!((normal.filter, normal.tex_coord, m.normal_scale), (Filter::Nearest, 2, -2.0));
    assert_eq!(normal.transform.scale, [3.0, 4.0]);
    let emissive = m.emissive_texture.unwrap();
    assert_eq!((emissive.filter, emissive.tex_coord), (Filter::Linear, 1));
    assert_eq!(emissive.transform, UvTransform::IDENTITY);
    let specular = m.specular_texture.unwrap();
    for other in
        [&rough, &normal, &emissive, &specular, &m.specular_color_texture.unwrap(), &m.transmission_texture.unwrap()]
    {
        assert!(Arc::ptr_eq(&base.image, &other.image));
    }
}

/// The texels of a file whose base colour is the given image.
fn texels_of(image: &[u8]) -> (u32, u32, Texels) {
    let mut file = painted(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    let view = file.view(image);
    file.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
    file.push("textures", json!({"source": 0}));
    let image = material_of(&file.load().unwrap()).base_color_texture.unwrap().image;
    (image.width, image.height, image.texels.clone())
}

#[test]
fn png_of_every_kind_expands_to_four_channels_at_its_own_depth() {
    let eight = |color, depth, data: &[u8]| texels_of(&png(2, 1, color, depth, data));
    let expect8 = |a: [u8; 4], b: [u8; 4]| (2, 1, Texels::Rgba8(vec![a, b]));
    let expect16 = |a: [u16; 4], b: [u16; 4]| (2, 1, Texels::Rgba16(vec![a, b]));
    use {BitDepth::*, ColorType::*};
    assert_eq!(eight(Grayscale, Eight, &[7, 200]), expect8([7, 7, 7, 255], [200, 200, 200, 255]));
    assert_eq!(eight(Grayscale, One, &[0b0100_0000]), expect8([0, 0, 0, 255], [255; 4]));
    assert_eq!(eight(GrayscaleAlpha, Eight, &[7, 8, 9, 10]), expect8([7, 7, 7, 8], [9, 9, 9, 10]));
    assert_eq!(eight(Indexed, Eight, &[1, 0]), expect8([0, 0, 255, 255], [255, 0, 0, 255]));
    assert_eq!(eight(Rgb, Eight, &[1, 2, 3, 4, 5, 6]), expect8([1, 2, 3, 255], [4, 5, 6, 255]));
    assert_eq!(eight(Rgba, Eight, &[1, 2, 3, 4, 5, 6, 7, 8]), expect8([1, 2, 3, 4], [5, 6, 7, 8]));
    let words = |words: &[u16]| words.iter().flat_map(|w| w.to_be_bytes()).collect::<Vec<_>>();
    let opaque = 65535;
    assert_eq!(eight(Grayscale, Sixteen, &words(&[258, 1])), expect16([258, 258, 258, opaque], [1, 1, 1, opaque]));
    assert_eq!(
        eight(Rgb, Sixteen, &words(&[1, 300, 3, 4, 5, 60000])),
        expect16([1, 300, 3, opaque], [4, 5, 60000, opaque])
    );
    let data = words(&[1, 2, 3, 4, 500, 6, 7, 8]);
    assert_eq!(eight(Rgba, Sixteen, &data), expect16([1, 2, 3, 4], [500, 6, 7, 8]));
}

#[test]
fn jpeg_is_read_whatever_the_file_calls_it() {
    let mut bytes = Vec::new();
    let grey = [128u8; 8 * 8 * 3];
    image::codecs::jpeg::JpegEncoder::new(&mut bytes).encode(&grey, 8, 8, image::ExtendedColorType::Rgb8).unwrap();
    let (width, height, Texels::Rgba8(texels)) = texels_of(&bytes) else { panic!("not eight bits") };
    assert_eq!((width, height, texels), (8, 8, vec![[128, 128, 128, 255]; 64]));
}

#[track_caller]
fn check_image_error(image: &[u8], expected: &str) {
    let mut file = painted(json!({"emissiveTexture": {"index": 0}}));
    let view = file.view(image);
    file.push("images", json!({"bufferView": view, "mimeType": "image/png", "name": "sky"}));
    file.push("textures", json!({"source": 0}));
    let message = error_of(file.load());
    assert!(message.contains("/images/0") && message.contains(expected), "{message}");
    assert_eq!(message.lines().count(), 1);
}

#[test]
fn images_that_are_broken_foreign_or_absurd_are_named() {
    check_image_error(b"not an image at all", r#"cannot decode image "sky": it is neither PNG nor JPEG"#);
    let good = png(64, 64, ColorType::Rgb, BitDepth::Eight, &[9; 64 * 64 * 3]);
    check_image_error(&good[..good.len() / 2], "cannot decode image \"sky\"");
    check_image_error(b"GIF89a\x01\0\x01\0\0\0\0;", "only PNG and JPEG are read");
    // The header of a huge picture over the data of a small one.
    for (width, height, expected) in [(60_000, 1, "60000 texels to a side"), (30_000, 30_000, "900000000 texels")] {
        let mut huge = good.clone();
        huge[16..20].copy_from_slice(&u32::to_be_bytes(width));
        huge[20..24].copy_from_slice(&u32::to_be_bytes(height));
        let crc = crc32(&huge[12..29]).to_be_bytes();
        huge[29..33].copy_from_slice(&crc);
        check_image_error(&huge, expected);
    }
}

/// CRC-32 as PNG has it (ISO 3309).
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 })
    })
}

#[test]
fn a_texture_falls_back_to_its_plain_source() {
    let base = || {
        let mut file = painted(json!({"emissiveTexture": {"index": 0}}));
        let view = file.view(&png(1, 1, ColorType::Rgb, BitDepth::Eight, &[1, 2, 3]));
        let webp = file.view(b"RIFF\0\0\0\0WEBPVP8 ");
        file.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
        file.push("images", json!({"bufferView": webp, "mimeType": "image/webp"}));
        file
    };
    let texture = |file: &mut File, source: Value| {
        file.push("textures", source);
    };
    let extension = json!({"EXT_texture_webp": {"source": 1}});

    let mut file = base();
    texture(&mut file, json!({"source": 0, "extensions": extension}));
    file.json["extensionsUsed"] = json!(["EXT_texture_webp"]);
    assert!(material_of(&file.load().unwrap()).emissive_texture.is_some());
    file.json["extensionsRequired"] = json!(["EXT_texture_webp"]);
    assert!(error_of(file.load()).contains("requires EXT_texture_webp"));

    // Without a plain one there is no texture; the same holds where the plain source is in the extension's format.
    for source in [json!({"extensions": extension}), json!({"source": 1})] {
        let mut file = base();
        texture(&mut file, source);
        file.json["extensionsUsed"] = json!(["EXT_texture_webp"]);
        let loaded = file.load().unwrap();
        assert!(material_of(&loaded).emissive_texture.is_none());
        assert!(warnings(&loaded)[1].contains("needs EXT_texture_webp"), "{:?}", warnings(&loaded));
    }
}
