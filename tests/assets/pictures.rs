//! Every file of the pack gives a picture of finite numbers, or an error that names the extension it cannot do without.

use std::{collections::BTreeMap, path::Path, sync::Arc};

use serde_json::Value;
use wavecast::{
    load::{LoadError, LoadOptions, load, load_environment},
    render::{RenderSettings, Renderer},
    world::{Environment, Sky},
};

use super::{pack, scenes};
use crate::common::settings;

/// The JSON of a file, by the shortest way.
fn json_of(path: &Path) -> Value {
    let bytes = std::fs::read(path).unwrap();
    if bytes.starts_with(b"glTF") {
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        return serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    }
    serde_json::from_slice(&bytes).unwrap()
}

fn lists(json: &Value, key: &str, name: &str) -> bool {
    json[key].as_array().into_iter().flatten().any(|entry| entry.as_str() == Some(name))
}

/// True if the file gives the reason for a warning.
fn is_explained(text: &str, json: &Value) -> bool {
    if text == "animations are not played: all stands in its rest pose" {
        return !json["animations"].as_array().unwrap().is_empty();
    }
    if text == "points and lines are left out: they have no surface" {
        let primitives = json["meshes"].as_array().unwrap().iter().flat_map(|m| m["primitives"].as_array().unwrap());
        return primitives.into_iter().any(|p| p["mode"].as_u64().is_some_and(|mode| mode < 4));
    }
    if text == "a light's range is not read: light falls off with the square alone" {
        let lights = json["extensions"]["KHR_lights_punctual"]["lights"].as_array().unwrap();
        return lights.iter().any(|light| light.get("range").is_some());
    }
    if let Some(name) = text.strip_prefix("its format needs ").and_then(|rest| rest.split(',').next()) {
        return lists(json, "extensionsUsed", name);
    }
    let named = text.split(" is ignored: ").next().unwrap().split(" is not supported: ").next().unwrap();
    named != text && lists(json, "extensionsUsed", named)
}

/// Pixels with a channel that is not finite, and the greatest channel.
fn judge(renderer: &Renderer, settings: &RenderSettings, path: &Path) -> (usize, f32) {
    let rendered = renderer.render(settings, &());
    assert_eq!(rendered.stats.discarded, [], "{}", path.display());
    assert!(!rendered.stats.cancelled);
    let pixels = rendered.picture.rgb;
    let bad = pixels.iter().filter(|rgb| rgb.iter().any(|x| !x.is_finite() || *x < 0.0)).count();
    (bad, pixels.into_iter().flatten().fold(0.0, f32::max))
}

#[test]
fn every_asset_gives_a_finite_picture_or_names_the_extension_it_requires() {
    let Some(folder) = pack() else { return };
    let (map, _) = load_environment(&folder.join("_hdr/studio_small_08_1k.hdr")).unwrap();
    let sky = Sky::Map(Arc::new(map));
    let settings = settings(256, 16);
    let (mut shown, mut bad, mut warned) = (0, 0, 0);
    let mut refused = BTreeMap::<String, usize>::new();
    let paths = scenes(&folder);
    for path in &paths {
        let json = json_of(path);
        let mut loaded = match load(path, &LoadOptions::default()) {
            Ok(loaded) => loaded,
            Err(error) => {
                let text = error.to_string();
                let LoadError::RequiredExtension { name, .. } = error else { panic!("{text}") };
                assert!(
                    text.contains(&name) && !text.contains('\n') && text.contains("/extensionsRequired/"),
                    "{text}"
                );
                assert!(lists(&json, "extensionsRequired", &name), "{text}");
                *refused.entry(name).or_default() += 1;
                continue;
            }
        };
        for warning in &loaded.warnings {
            assert!(is_explained(&warning.text, &json), "unexplained: {warning}");
            assert!(!warning.to_string().contains('\n'), "{warning}");
            warned += 1;
        }
        let mut renderer = Renderer::new();
        for lit in [false, true] {
            if lit {
                let environment = Environment { sky: sky.clone(), rotation_degrees: 30.0, scale: 1.0 };
                loaded.scene.spawn((environment,));
            }
            let report = renderer.sync(&mut loaded.scene);
            assert!(report.warnings.is_empty(), "{}: {:?}", path.display(), report.warnings);
            bad += judge(&renderer, &settings, path).0;
        }
        shown += 1;
    }
    println!(
        "{shown} of {} assets shown at 256×256, 16 spp, {bad} pixels not finite; {warned} warnings; refused: {refused:?}",
        paths.len()
    );
    assert_eq!(shown + refused.values().sum::<usize>(), paths.len());
    assert!(shown >= 82, "{shown}");
    assert_eq!(bad, 0);
}

/// Its 224 triangles of three corners in a line must not be hit: they have no normal.
#[test]
fn the_coffee_maker_has_no_samples_to_leave_out() {
    let Some(folder) = pack() else { return };
    let path = folder.join("CoffeeMaker/coffee.gltf");
    let mut loaded = load(&path, &LoadOptions::default()).unwrap();
    let mut renderer = Renderer::new();
    assert!(renderer.sync(&mut loaded.scene).warnings.is_empty());
    let (bad, most) = judge(&renderer, &settings(96, 16), &path);
    assert_eq!(bad, 0);
    assert!(most < 1e3, "lights of 2 nit cannot make a pixel of {most}");
}
