//! How fast is each acceleration structure, and what does it cost?
//!
//! `cargo bench --bench accel` runs `wavecast bench accel` over the two large scenes that need no file, and over Sponza
//! where the assets are there, and writes its tables and plots to `benches/results/accel/`. What follows `--` is added
//! to the command line of the program, which checks all hits before it takes a time. With Embree as well:
//! `cargo bench --bench accel --features embree -- --embree FOLDER`.

use std::{
    path::PathBuf,
    process::{Command, ExitCode},
};

fn main() -> ExitCode {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let sponza = root.join("../shared/assets/Sponza/Sponza.glb");
    let mut program = Command::new(env!("CARGO_BIN_EXE_wavecast"));
    program.args(["bench", "accel", "hall", "foliage"]);
    if sponza.exists() {
        program.arg(sponza);
    } else {
        println!("SKIPPED: {} is not there", sponza.display());
    }
    program.arg("-o").arg(root.join("benches/results/accel"));
    // Cargo says `--bench` to everything that it runs as a bench.
    program.args(std::env::args_os().skip(1).filter(|arg| arg != "--bench"));
    match program.status() {
        Ok(status) if status.success() => ExitCode::SUCCESS,
        Ok(_) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
