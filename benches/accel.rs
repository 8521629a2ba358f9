//! How fast is each acceleration structure, and what does it cost?
//!
//! `cargo bench --bench accel` runs `wavecast bench accel` over the two large scenes that need no file, and over the
//! inside of Sponza where the assets are there, and writes tables and plots to `benches/results/accel` and
//! `accel-sponza`. What follows `--` is added to the command lines of the program, which checks all hits before it takes
//! a time. With Embree as well: `cargo bench --bench accel --features embree -- --embree FOLDER`.

use std::{
    path::{Path, PathBuf},
    process::{Command, ExitCode},
};

/// Runs the program; false if it fails.
fn measure(scenes: &[&str], folder: &Path) -> bool {
    let mut program = Command::new(env!("CARGO_BIN_EXE_wavecast"));
    program.args(["bench", "accel"]).args(scenes).arg("-o").arg(folder);
    // Cargo says `--bench` to everything that it runs as a bench.
    program.args(std::env::args_os().skip(1).filter(|arg| arg != "--bench"));
    program.status().inspect_err(|error| eprintln!("error: {error}")).is_ok_and(|status| status.success())
}

fn main() -> ExitCode {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let results = root.join("benches/results");
    let mut well = measure(&["hall", "foliage"], &results.join("accel"));
    let sponza = root.join("../shared/assets/Sponza/Sponza.glb");
    if sponza.exists() {
        let inside = ["--view", "0,1,0,1,1.1,0.05"];
        well &= measure(&[&sponza.to_string_lossy(), inside[0], inside[1]], &results.join("accel-sponza"));
    } else {
        println!("SKIPPED: {} is not there", sponza.display());
    }
    if well { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
