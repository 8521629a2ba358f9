//! How much does the wavefront gain over one path at a time, where does its time go, and which queue size suits it?
//!
//! `cargo bench --bench wavefront` runs `wavecast bench wavefront` over the Cornell box and, where the assets are there,
//! over DamagedHelmet and the inside of Sponza, both under a sky, and writes tables and plots to `wavefront-cornell`,
//! `wavefront-helmet` and `wavefront-sponza` in `benches/results/`. The program checks that all that it measures makes
//! the same picture before it takes a time.
//!
//! After `--`: `modes` (only the wavefront, one path at a time, the reference; into folders that end in `-modes`) or
//! `sweep` (only paths in a wave; `-sweep`); else all that the program measures. What is left is added to the command
//! lines of the program.

use std::{
    path::{Path, PathBuf},
    process::{Command, ExitCode},
};

/// Runs the program; false if it fails.
fn measure(scene: &Path, more: &[&str], asked: &[String], folder: &Path) -> bool {
    let mut program = Command::new(env!("CARGO_BIN_EXE_wavecast"));
    // What was asked for goes before what is the rule.
    let rule = more.iter().filter(|rule| !(rule.starts_with("--spp") && asked.iter().any(|a| a.starts_with("--spp"))));
    program
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["bench", "wavefront"])
        .arg(scene)
        .args(rule)
        .args(asked)
        .arg("-o")
        .arg(folder);
    program.status().inspect_err(|error| eprintln!("error: {error}")).is_ok_and(|status| status.success())
}

fn main() -> ExitCode {
    let (mut asked, mut part) = (Vec::new(), "");
    // Cargo says `--bench` to everything that it runs as a bench.
    for argument in std::env::args().skip(1).filter(|arg| arg != "--bench") {
        match argument.as_str() {
            "modes" => part = "modes",
            "sweep" => part = "sweep",
            _ => asked.push(argument),
        }
    }
    match part {
        "modes" => asked.push("--parts=modes".into()),
        "sweep" => asked.push("--parts=wave-size".into()),
        _ => {}
    }
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    // As seen from there, so that tables do not tell where that is.
    let (assets, results) = (PathBuf::from("../shared/assets"), PathBuf::from("benches/results"));
    let sky = assets.join("_hdr/venice_sunset_1k.hdr");
    let sky = sky.to_string_lossy();
    let mut well = true;
    for (name, scene, more) in [
        ("cornell", PathBuf::from("scenes/cornell.gltf"), &["--spp=16"][..]),
        (
            "helmet",
            assets.join("DamagedHelmet/glTF-Binary/DamagedHelmet.glb"),
            &["--view=0,0,3,0,0,0", "--env", &sky, "--spp=16"],
        ),
        ("sponza", assets.join("Sponza/Sponza.glb"), &["--view=0,1,0,1,1,0", "--env", &sky, "--spp=8"]),
    ] {
        if root.join(&scene).exists() {
            well &= measure(
                &scene,
                more,
                &asked,
                &results.join(if part.is_empty() {
                    format!("wavefront-{name}")
                } else {
                    format!("wavefront-{name}-{part}")
                }),
            );
        } else {
            println!("SKIPPED: {} is not there", scene.display());
        }
    }
    if well { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
