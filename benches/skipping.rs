//! Does what a scene does not use cost it anything?
//!
//! `cargo bench --bench skipping` adds to the Cornell box, one at a time, what nothing shows: textures,
//! materials, animations, a second scene with meshes and lamps of its own. Each file is rendered under
//! `valgrind --tool=callgrind` at two sample counts; the difference of the instruction counts over the
//! difference of the paths is the cost of a path, free of loading and writing. It must not change by 0.5 %.
//! As a control, the same additions put to use must change it. Writes `benches/results/skipping.md`.

use std::{fmt::Write as _, fs, path::Path, process::Command};

use serde_json::{Value, json};

/// An 8×8 picture, as a data URI would hold it.
fn picture() -> String {
    use base64::Engine as _;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 8, 8);
    encoder.set_color(png::ColorType::Rgb);
    let texels: Vec<u8> = (0..192_u32).map(|i| (i * 37 % 251) as u8).collect();
    encoder.write_header().and_then(|mut w| w.write_image_data(&texels)).expect("a small picture can be encoded");
    format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

/// Appends to an array of the document and returns the new element's index.
fn push(document: &mut Value, array: &str, element: Value) -> usize {
    let object = document.as_object_mut().expect("a document is an object");
    let list = object.entry(array).or_insert_with(|| json!([])).as_array_mut().expect("an array");
    list.push(element);
    list.len() - 1
}

fn add_textures(document: &mut Value, used: bool) {
    for i in 0..16 {
        let image = push(document, "images", json!({ "uri": picture(), "name": format!("unused {i}") }));
        let texture = push(document, "textures", json!({ "source": image }));
        if used && i == 0 {
            let material = document.pointer_mut("/materials/0/pbrMetallicRoughness").expect("Cornell has materials");
            material["baseColorTexture"] = json!({ "index": texture });
        }
    }
}

fn add_materials(document: &mut Value, used: bool) {
    for _ in 0..64 {
        let material = json!({ "pbrMetallicRoughness": { "roughnessFactor": 0.2 }, "alphaMode": "BLEND", "emissiveFactor": [1, 1, 1] });
        let index = push(document, "materials", material);
        if used {
            let meshes = document["meshes"].as_array_mut().expect("Cornell has meshes");
            for primitive in meshes.iter_mut().flat_map(|mesh| mesh["primitives"].as_array_mut().expect("primitives")) {
                primitive["material"] = json!(index);
            }
        }
    }
}

fn add_animation(document: &mut Value) {
    let times: Vec<u8> = [0.0_f32, 1.0].into_iter().flat_map(f32::to_le_bytes).collect();
    let places: Vec<u8> = [0.0_f32, 0.0, 0.0, 0.0, 1.0, 0.0].into_iter().flat_map(f32::to_le_bytes).collect();
    use base64::Engine as _;
    let data = base64::engine::general_purpose::STANDARD.encode([times, places].concat());
    let uri = format!("data:application/octet-stream;base64,{data}");
    let buffer = push(document, "buffers", json!({ "uri": uri, "byteLength": 32 }));
    let first = push(document, "bufferViews", json!({ "buffer": buffer, "byteLength": 8 }));
    let second = push(document, "bufferViews", json!({ "buffer": buffer, "byteOffset": 8, "byteLength": 24 }));
    let time =
        json!({ "bufferView": first, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0.0], "max": [1.0] });
    let input = push(document, "accessors", time);
    let output =
        push(document, "accessors", json!({ "bufferView": second, "componentType": 5126, "count": 2, "type": "VEC3" }));
    for _ in 0..16 {
        let channel = json!({ "sampler": 0, "target": { "node": 0, "path": "translation" } });
        push(
            document,
            "animations",
            json!({ "samplers": [{ "input": input, "output": output }], "channels": [channel] }),
        );
    }
}

fn add_scene(document: &mut Value) {
    let meshes = document["meshes"].as_array().map_or(0, Vec::len);
    let nodes: Vec<usize> = (0..40)
        .map(|i| push(document, "nodes", json!({ "mesh": i % meshes, "translation": [i, 0, 0], "scale": [1, 2, -1] })))
        .collect();
    push(document, "scenes", json!({ "nodes": nodes }));
    if document.get("scene").is_none() {
        document["scene"] = json!(0);
    }
}

/// Instructions that a render of the file takes.
fn instructions(file: &Path, folder: &Path, spp: u32) -> f64 {
    let log = folder.join("callgrind.out");
    let output = Command::new("valgrind")
        .arg("--tool=callgrind")
        .arg(format!("--callgrind-out-file={}", log.display()))
        .arg(env!("CARGO_BIN_EXE_wavecast"))
        .arg("render")
        .arg(file)
        .args(["-o"])
        .arg(folder.join("out.hdr"))
        .args(["--size", "48x48", "--threads", "1", "--quiet", "--spp", &spp.to_string()])
        .output()
        .expect("valgrind is installed");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = fs::read_to_string(&log).expect("callgrind writes its file");
    let line = text.lines().rev().find_map(|line| line.strip_prefix("totals: ")).expect("a totals line");
    line.split_whitespace().next().and_then(|n| n.parse().ok()).expect("a number")
}

fn main() {
    if Command::new("valgrind").arg("--version").output().is_err() {
        println!("SKIPPED: valgrind is not installed");
        return;
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let source =
        fs::read_to_string(root.join("scenes/cornell.gltf")).expect("scenes/cornell.gltf is in the repository");
    let cornell: Value = serde_json::from_str(&source).expect("scenes/cornell.gltf is JSON");
    let folder = tempfile::tempdir().expect("a temporary folder");
    type Change = Box<dyn Fn(&mut Value)>;
    let cases: Vec<(&str, bool, Change)> = vec![
        ("as it is", true, Box::new(|_| ())),
        ("16 unused textures", true, Box::new(|d| add_textures(d, false))),
        ("64 unused materials", true, Box::new(|d| add_materials(d, false))),
        ("16 animations", true, Box::new(add_animation)),
        ("an unreferenced scene of 40 nodes", true, Box::new(add_scene)),
        ("control: a texture on one material", false, Box::new(|d| add_textures(d, true))),
        ("control: another material everywhere", false, Box::new(|d| add_materials(d, true))),
    ];
    let mut table = String::from("| Cornell box with | instructions per path | change |\n|---|---|---|\n");
    let mut base = 0.0;
    for (name, unused, change) in cases {
        let mut document = cornell.clone();
        change(&mut document);
        let file = folder.path().join("scene.gltf");
        fs::write(&file, document.to_string()).expect("the temporary folder is writable");
        let (few, many) = (16, 48);
        let cost = (instructions(&file, folder.path(), many) - instructions(&file, folder.path(), few))
            / f64::from((many - few) * 48 * 48);
        if base == 0.0 {
            base = cost;
        }
        let percent = 100.0 * (cost / base - 1.0);
        let line = format!("| {name} | {cost:.0} | {percent:+.3} % |");
        println!("{line}");
        let _ = writeln!(table, "{line}");
        assert_eq!(percent.abs() < 0.5, unused, "{name}: {percent:+.3} %");
    }
    let text = format!(
        "# What is not used costs nothing\n\n`cargo bench --bench skipping`: callgrind instructions per path, 48×48 pixels, one thread, \
         from 16 and 48 samples per pixel.\n\n{table}"
    );
    fs::write(root.join("benches/results/skipping.md"), text).expect("benches/results is writable");
}
