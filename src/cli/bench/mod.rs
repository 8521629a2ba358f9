//! `wavecast bench`: measurements that anyone can repeat.

mod accel;
mod boxes;
mod kernels;
mod rays;

use std::path::PathBuf;

use super::{Outcome, console::Console, error::CliError};

/// Measure parts of the program on this machine
#[derive(clap::Args)]
#[command(after_help = "Example:\n  wavecast bench accel scenes/gallery.glb -o results")]
pub struct Args {
    /// What is measured
    #[arg(value_name = "WHAT")]
    what: What,
    /// Scenes, .gltf or .glb; kernels are measured without
    #[arg(value_name = "SCENE", required_if_eq("what", "accel"))]
    scenes: Vec<PathBuf>,
    /// Folder for tables (CSV); made if it is not there
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Times each figure is taken; the median counts
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    runs: u32,
    /// Structures, by name [default: all but brute force, which is what the others are checked against]
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    accel: Vec<String>,
    /// accel: rays of the first kind, from the camera; the others are about as many. kernels: rays at vertices and rays at
    /// edges, for each structure and place
    #[arg(long, value_name = "N", default_value_t = 65_536, value_parser = clap::value_parser!(u32).range(64..))]
    rays: u32,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum What {
    /// Acceleration structures: rays per second, build time, memory, work per ray
    Accel,
    /// Ray-triangle tests: their cost, and whether rays slip through between triangles
    Kernels,
}

/// Measures.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    match args.what {
        What::Accel => accel::run(args, console),
        What::Kernels => kernels::run(args, console),
    }
}
