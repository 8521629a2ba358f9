//! Whole renders of a small scene.

use base64::Engine;
use serde_json::{Value, json};
use wavecast::film::{self, LayerData, Referred};

use super::{Folder, Run, wavecast};

/// A triangle before a camera, without any light.
fn scene(folder: &Folder) -> String {
    let corners: [f32; 9] = [-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0, 0.0];
    let bytes: Vec<u8> = corners.iter().flat_map(|c| c.to_le_bytes()).collect();
    let uri = format!("data:application/octet-stream;base64,{}", base64::prelude::BASE64_STANDARD.encode(bytes));
    let file = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 1] }],
        "nodes": [{ "mesh": 0 }, { "name": "eye", "camera": 0, "translation": [0, 0, 3] }],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 1.0, "aspectRatio": 1.5, "znear": 0.1 } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{
            "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
            "min": [-1, -1, 0], "max": [1, 1, 0],
        }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "buffers": [{ "byteLength": 36, "uri": uri }],
    });
    let path = folder.at("scene.gltf");
    std::fs::write(&path, file.to_string()).unwrap();
    path.display().to_string()
}

fn render(scene: &str, outputs: &[&std::path::Path], options: &str) -> Run {
    let mut words = vec!["render".to_owned(), scene.to_owned()];
    for output in outputs {
        words.extend(["-o".to_owned(), output.display().to_string()]);
    }
    wavecast(words.into_iter().chain(options.split_whitespace().map(str::to_owned)))
}

#[test]
fn one_render_writes_every_format_and_tells_what_it_did() {
    let folder = Folder::new();
    let outputs = ["a.exr", "a.png", "a.hdr"].map(|name| folder.at(name));
    let stats = folder.at("stats.json");
    let options = format!(
        "--size 16x12 --spp 2 --seed 9 --camera eye --layers albedo,normal,depth,samples --transparent --json --stats {}",
        stats.display()
    );
    let run = render(&scene(&folder), &outputs.each_ref().map(|p| p.as_path()), &options).expect(0);
    assert_eq!(run.stderr.matches("no light in the scene").count(), 1, "{}", run.stderr);
    assert_eq!(folder.names(), ["a.exr", "a.hdr", "a.png", "scene.gltf", "stats.json"]);

    let (exr, referred) = film::read(&outputs[0]).unwrap();
    assert_eq!((exr.width, exr.height, referred), (16, 12, Referred::Scene));
    let names: Vec<_> = exr.layers.iter().map(|layer| layer.name.as_str()).collect();
    assert_eq!(names, ["albedo", "normal", "depth", "samples"]);
    assert!(exr.alpha.is_some());
    assert!(matches!(&exr.layers[3].data, LayerData::Id(counts) if counts.iter().all(|&count| count == 2)));
    assert!(exr.metadata.contains(&("seed".into(), "9".into())), "{:?}", exr.metadata);
    assert_eq!(film::read(&outputs[1]).unwrap().1, Referred::Display);
    assert_eq!(film::read(&outputs[2]).unwrap().0.rgb.len(), 16 * 12);

    let read: Value = serde_json::from_slice(&std::fs::read(&stats).unwrap()).unwrap();
    assert_eq!(read["spp"], 2.0);
    assert_eq!(read["seed"], 9);
    assert_eq!(read["error"]["upper95"], Value::Null);
    for key in ["seconds", "paths", "rays", "mrays_per_second", "stages", "skipped", "discarded_samples", "threads"] {
        assert!(!read[key].is_null(), "{key}");
    }
    assert_eq!(read["warnings"].as_array().unwrap().len(), run.stderr.matches("warning: ").count());
    assert_eq!(serde_json::from_str::<Value>(&run.stdout).unwrap()["outputs"], read["outputs"]);
}

#[test]
fn a_quiet_render_says_nothing_and_a_loud_one_ends_with_a_line() {
    let folder = Folder::new();
    let (scene, out) = (scene(&folder), folder.at("a.png"));
    let run = render(&scene, &[&out], "--size 8x8 --spp 1 --quiet").expect(0);
    assert_eq!((run.stdout.as_str(), run.stderr.as_str()), ("", ""));
    let run = render(&scene, &[&out], "--size 8x8 --spp 1 --env 1,1,1").expect(0);
    assert!(run.stdout.contains("a.png: 1.0000 samples per pixel"), "{}", run.stdout);
    assert_eq!(run.stderr, "", "a light was given, and a pipe is no terminal");
}

#[test]
fn a_crop_has_the_size_of_the_crop_and_must_lie_inside() {
    let folder = Folder::new();
    let (scene, out) = (scene(&folder), folder.at("a.exr"));
    render(&scene, &[&out], "--size 16x12 --spp 1 --crop 2,3,5,4").expect(0);
    let (picture, _) = film::read(&out).unwrap();
    assert_eq!((picture.width, picture.height), (5, 4));
    render(&scene, &[&out], "--size 16x12 --spp 1 --crop 12,0,5,4").expect(2).says("reaches beyond the picture");
}

#[test]
fn a_camera_that_is_not_there_is_bad_input_with_the_choice_of_those_that_are() {
    let folder = Folder::new();
    let (scene, out) = (scene(&folder), folder.at("a.png"));
    render(&scene, &[&out], "--camera ear").expect(1).says("no camera \"ear\"; there is 0 \"eye\"");
    assert_eq!(folder.names(), ["scene.gltf"]);
}

/// Any structure renders, and `--stats` and `info` say which it was and what it cost.
#[test]
fn the_structure_asked_for_is_the_one_that_renders() {
    let folder = Folder::new();
    let scene = scene(&folder);
    let pixels = |name: &str, options: &str| {
        let out = folder.at(&format!("{name}.exr"));
        let run = render(&scene, &[&out], &format!("--size 9x6 --spp 2 --json {options}")).expect(0);
        let accel = serde_json::from_str::<Value>(&run.stdout).unwrap()["accel"].clone();
        (film::read(&out).unwrap().0.rgb, accel)
    };
    let (want, accel) = pixels("default", "");
    assert_eq!((&accel["name"], &accel["quality"], &accel["triangles"]), (&json!("bvh8"), &json!("good"), &json!(1)));
    for key in ["build_seconds", "binary_seconds", "collapse_seconds", "bytes", "bytes_per_triangle"] {
        assert!(accel[key].is_number(), "{key}: {accel}");
    }
    assert_eq!(pixels("fast", "--build-quality fast").1["quality"], "fast");
    for name in ["bvh8", "bvh2", "kdtree", "octree", "bsp", "grid", "brute"] {
        let (got, accel) = pixels(name, &format!("--accel {name}"));
        assert!(got == want, "{name}");
        assert_eq!(accel["name"], name);
        assert_eq!(accel["bytes_per_triangle"], accel["bytes"].as_f64().unwrap(), "of one triangle");
        assert_eq!(accel["binary_seconds"].is_null(), name != "bvh8");
    }
    // Row and corners.
    assert_eq!(pixels("brute", "--accel brute").1["bytes"], 40);
    let info = wavecast(["info", &scene, "--accel", "brute", "--json"]).expect(0);
    assert_eq!(serde_json::from_str::<Value>(&info.stdout).unwrap()["accel"]["bytes"], 40);
    let text = wavecast(["info", &scene]).expect(0).stdout;
    assert!(text.contains("structure of meshes: bvh8 (good), built in "), "{text}");
}

#[test]
fn info_tells_of_the_file_and_its_needs() {
    let folder = Folder::new();
    let run = wavecast(["info", &scene(&folder), "--json"]).expect(0);
    let info: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(info["contents"]["gltf"], "2.0");
    assert_eq!(info["contents"]["counts"]["triangles"], 1);
    assert_eq!(info["cameras"], json!(["eye"]));
    assert!(info["skips"].as_array().unwrap().contains(&"textures".into()));
    let memory = info["memory_bytes"].as_object().unwrap();
    let bytes = |name: &str| memory[name].as_u64().unwrap_or_else(|| panic!("{name} in {memory:?}"));
    assert!(bytes("trees of meshes") > 0 && bytes("tree of instances") > 0, "{memory:?}");
    let parts: u64 = memory.keys().filter(|name| *name != "total").map(|name| bytes(name)).sum();
    assert_eq!(bytes("total"), parts);
    let text = wavecast(["info", &scene(&folder)]).expect(0).stdout;
    assert!(text.contains("needs: ") && text.contains("skips: ") && text.contains("cameras: 0 \"eye\""), "{text}");
}

/// Ctrl-C ends a render that would take a minute, keeps the picture and gives the shell's exit code.
#[cfg(unix)]
#[test]
fn an_interrupted_render_writes_what_is_there_and_says_so() {
    use std::{
        process::{Command, Stdio},
        thread::sleep,
        time::{Duration, Instant},
    };

    let folder = Folder::new();
    let out = folder.at("a.exr");
    let start = Instant::now();
    let child = Command::new(env!("CARGO_BIN_EXE_wavecast"))
        .args(["render", &scene(&folder), "-o"])
        .arg(&out)
        .args(["--size", "16x12", "--time", "60s"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    sleep(Duration::from_secs(2));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(130), "{stderr}");
    assert!(stderr.contains("interrupted: writing what is there"), "{stderr}");
    assert!(start.elapsed() < Duration::from_secs(40), "it did not wait for its time to run out");
    assert_eq!(film::read(&out).unwrap().0.rgb.len(), 16 * 12);
}

/// Layers by paths are in the file under the names that they were given, with the expressions beside them; and what is wrong with
/// an expression is told with its place.
#[test]
fn layers_by_paths_have_the_names_that_they_were_given() {
    let folder = Folder::new();
    let (scene, exr) = (scene(&folder), folder.at("a.exr"));
    let options = "--size 16x12 --spp 4 --layers lobes --lpe shiny=CG[LB] --lpe on_glass=C.*<TS>L --env 1,1,1";
    render(&scene, &[&exr], options).expect(0);
    let (picture, _) = film::read(&exr).unwrap();
    let names: Vec<_> = picture.layers.iter().map(|layer| layer.name.as_str()).collect();
    for want in ["emission", "diffuse.direct", "transmission.indirect.error", "shiny", "shiny.error", "on_glass"] {
        assert!(names.contains(&want), "{want}: {names:?}");
    }
    let of = |name: &str| match &picture.layers.iter().find(|layer| layer.name == name).expect("checked above").data {
        LayerData::Rgb(values) => values.clone(),
        other => panic!("{name}: {other:?}"),
    };
    assert!(of("shiny") == of("specular.direct"));
    assert!(of("shiny").iter().flatten().any(|&c| c > 0.0));
    assert!(picture.metadata.contains(&("lpe.shiny".into(), "CG[LB]".into())), "{:?}", picture.metadata);

    for (options, problem) in [
        ("--lpe CDL", "NAME=EXPRESSION"),
        ("--lpe a=CXL", "character 2"),
        ("--lpe a=DL", "begin with C"),
        ("--lpe a.b=CDL", "letters, digits"),
        ("--lpe albedo=CDL", "another layer"),
        ("--lpe a=CDL --lpe a=CSL", "two layers a"),
        ("--lpe a=CDL --integrator whitted", "does not tell what happened to paths"),
        ("--layers lobes --integrator ao", "does not tell what happened to paths"),
    ] {
        render(&scene, &[&exr], options).expect(2).says(problem);
    }
    render(&scene, &[&exr], "--lpe a=CD<L.'moon'>").expect(1).says("no light \"moon\"").says("none");
}
