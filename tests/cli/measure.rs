//! Light meters as scripts see them.

use serde_json::Value;

use super::{Folder, Run, line, wavecast};
use crate::common::root;

fn measure(scene: &str, options: &[&str]) -> Run {
    let scene = root().join("scenes").join(scene).display().to_string();
    wavecast(["measure", &scene].into_iter().chain(options.iter().copied()))
}

fn meters(run: &Run) -> Vec<Value> {
    let value: Value = serde_json::from_str(&run.stdout).unwrap_or_else(|error| panic!("{error}: {}", run.stdout));
    value["meters"].as_array().expect("a list").clone()
}

#[test]
fn luminaires_are_written_for_lighting_programs_and_to_be_looked_at() {
    let folder = Folder::new();
    let paths = ["lamp.ies", "lamp.svg", "lamp.csv"].map(|name| folder.at(name).display().to_string());
    let outputs = paths.iter().flat_map(|path| ["-o", path.as_str()]);
    let options = ["--candela", "led", "--step", "30,90", "--spp", "8", "--json"].into_iter().chain(outputs);
    let run = measure("led.glb", &options.collect::<Vec<_>>()).expect(0);
    let meter = &meters(&run)[0];
    let close =
        |value: &Value, want: f64| assert!((value.as_f64().expect("a number") / want - 1.0).abs() < 1e-5, "{value}");
    assert_eq!((meter["kind"].as_str(), meter["unit"].as_str()), (Some("candela"), Some("cd")));
    close(&meter["flux"]["value"], 815.0);
    close(&meter["points"][3]["value"], 64.855637);
    assert_eq!(meter["grid"], serde_json::json!([7, 4]));
    assert_eq!(folder.names(), ["lamp.csv", "lamp.ies", "lamp.svg"]);
    let read = |name: &str| std::fs::read_to_string(folder.at(name)).expect("it was written");
    assert!(
        read("lamp.ies").starts_with("IESNA:LM-63-2002\n") && read("lamp.ies").contains("\n1 -1 1 7 5 1 2 0 0 0\n")
    );
    assert_eq!(read("lamp.csv").lines().count(), 1 + 7 * 4);
    assert!(read("lamp.svg").contains("Luminous intensity of led"));
}

#[test]
fn materials_and_glare_are_told_in_words_and_as_json() {
    let folder = Folder::new();
    let (svg, csv) = (folder.at("a.svg").display().to_string(), folder.at("a.csv").display().to_string());
    let options = ["--brdf", "plate, alpha 0.1", "--spp", "64", "-o", &svg, "-o", &csv];
    let run = measure("plates.gltf", &options).expect(0);
    assert!(run.stdout.contains("0°       7.957523  7.957522"), "{}", run.stdout);
    assert_eq!(folder.names(), ["a.csv", "a.svg"]);
    let run = measure("cornell.gltf", &["--glare", "--spp", "4096", "--json"]).expect(0);
    let meter = &meters(&run)[0];
    assert_eq!((meter["kind"].as_str(), meter["unit"].as_str()), (Some("glare"), Some("UGR")));
    assert!((meter["value"].as_f64().expect("a number") - 7.6).abs() < 0.5, "{meter}");
    assert_eq!(meter["lamps"][0]["name"], "light");
    // Looked at from below, there is nothing to be dazzled by.
    let view = ["--glare", "--view", "0,0.2,0,0,0,0.01", "--spp", "4096", "--json"];
    assert_eq!(meters(&measure("cornell.gltf", &view).expect(0))[0]["value"], Value::Null);
}

#[test]
fn what_cannot_be_measured_is_said() {
    for (scene, options, code, problem) in [
        ("cornell.gltf", &["--candela", "tall block"][..], 1, "sends off no light"),
        ("cornell.gltf", &["--candela", "nobody"], 1, "no entity"),
        ("cornell.gltf", &["--candela", "light", "--step", "7"], 2, "whole multiples"),
        ("cornell.gltf", &["--step", "5"], 2, "--candela"),
        ("cornell.gltf", &["--lumen", "light", "-o", "a.ies"], 2, "that is for --candela"),
        ("cornell.gltf", &["--lux", "0,0,0", "0,1,0", "-o", "a.exr"], 2, "that is for --bake"),
        ("cornell.gltf", &["--lux", "0,0,0", "0,1,0", "-o", "a.txt"], 2, "written as"),
        ("cornell.gltf", &["--brdf", "light:3"], 2, "it has one material"),
        ("cornell.gltf", &["--brdf", "light", "--candela", "light", "-o", "a.svg"], 2, "one of the two"),
        ("cornell.gltf", &["--on", "light", "--bake", "8x8"], 2, "no texture coordinates"),
        ("cornell.gltf", &["--bake", "8x8"], 2, "--on"),
    ] {
        measure(scene, options).expect(code).says(problem);
    }
    line("measure missing.glb --glare").expect(1).says("missing.glb");
}
