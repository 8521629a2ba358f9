//! `wavecast bench`: measurements that anyone can repeat.

mod accel;
mod boxes;
mod builds;
mod contender;
mod draw;
#[cfg(feature = "embree")]
mod embree;
mod error;
mod glb;
mod growth;
mod kernels;
mod leaks;
mod peers;
mod plot;
mod rays;
mod report;
mod subject;
mod truth;
mod wavefront;

use std::{num::NonZeroUsize, path::PathBuf};

use wavecast::{render::Renderer, world::Scene};

use self::{draw::Slice, subject::Source};
use super::{
    Outcome,
    args::{self, EnvArg, Size},
    console::Console,
    error::CliError,
    scene::{self, View},
    structure::QualityArg,
};

/// Measure parts of the program on this machine
#[derive(clap::Args)]
#[command(after_help = "Example:\n  wavecast bench accel hall foliage:1e5 scenes/gallery.glb -o results
  wavecast bench wavefront scenes/cornell.gltf --parts modes -o results
  wavecast bench error scenes/cornell.gltf -o before
  wavecast bench error scenes/cornell.gltf -o after --compare before/error.csv

SCENE is a .gltf or .glb file, or one that is made on the spot, of about N triangles (1e3 to 1e7):
  hall[:N]     a room with columns and statues; 1.1e6 if nothing is said
  foliage[:N]  hills and trees, whose leaves overlap; 1e6 if nothing is said

For times that can be trusted, let nothing else run, and pin the program to a core: taskset -c 0 wavecast bench …")]
pub struct Args {
    /// What is measured
    #[arg(value_name = "WHAT")]
    what: What,
    /// Scenes: .gltf, .glb, hall[:N], foliage[:N]; kernels are measured without
    #[arg(value_name = "SCENE", required_if_eq_any([("what", "accel"), ("what", "wavefront")]), value_parser = subject::source)]
    scenes: Vec<Source>,
    /// Look from one point to another, in metres, and not through the scene's camera
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = scene::view, allow_hyphen_values = true)]
    view: Option<View>,
    /// Folder for tables (CSV, Markdown) and plots (SVG); made if it is not there
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Times each figure is taken; the median counts [default: 5; wavefront: 7; in comparison with
    /// others 9]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    runs: Option<u32>,
    /// Structures, by name [default: all but brute force, which is what the others are checked against]
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    accel: Vec<String>,
    /// accel: time given to building bvh8; --builds measures all [default: good]
    #[arg(long, value_name = "QUALITY", value_enum, conflicts_with = "builds")]
    build_quality: Option<QualityArg>,
    /// accel: rays of each kind; fewer where most leave the scene. kernels: the rows of misses, each of so many rays at
    /// vertices or at edges (tests alone, without a structure: at most a million); no more than 65536 of them are timed
    /// for the rows of boxes, and none for those of tests
    #[arg(long, value_name = "N", default_value_t = 65_536, value_parser = clap::value_parser!(u32).range(64..))]
    rays: u32,
    /// Numbers of threads that the rays are divided between, measured one after the other; structures are built by
    /// --threads. wavefront measures all else with the first [default: 1; wavefront: 1, 2, 4, … up to
    /// --threads]
    #[arg(long, value_name = "N", value_delimiter = ',')]
    scaling: Vec<NonZeroUsize>,
    /// Pixels [default: wavefront: 256x256; error: 400x400]
    #[arg(long, value_name = "WxH", value_parser = args::size)]
    size: Option<Size>,
    /// wavefront: samples per pixel; the reference takes 2 of a fourth of the pixels [default: 8]. error: most samples per
    /// pixel [default: as many as fit into the budget]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    spp: Option<u32>,
    /// wavefront, error: environment, a lat-long picture in nit, or R,G,B in nit
    #[arg(long, value_name = "FILE|R,G,B", value_parser = args::env)]
    env: Option<EnvArg>,
    /// wavefront: what is measured [default: all]
    #[arg(long, value_name = "PART", value_enum, value_delimiter = ',')]
    parts: Vec<Part>,
    /// Measure generated scenes in several sizes, in triangles, one structure after the other; what is known is written
    /// after each [default: 1e3,1e4,1e5,1e6,1e7]
    #[arg(
        long,
        value_name = "N",
        value_delimiter = ',',
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "1e3,1e4,1e5,1e6,1e7",
        value_parser = subject::triangles,
    )]
    growth: Vec<usize>,
    /// With --growth: a structure stops before a build that would take longer
    #[arg(long, value_name = "SECONDS", default_value_t = 120.0, requires = "growth")]
    build_limit: f64,
    /// accel: measure how long trees take to build, to be refitted around moved triangles, and to be put over 10,000
    /// instances, and nothing else
    #[arg(long, conflicts_with_all = ["draw", "growth", "accel", "scaling"])]
    builds: bool,
    /// Draw the cells or boxes of each structure, cut by a plane, into this folder, and measure nothing
    #[arg(long, value_name = "DIR", conflicts_with_all = ["output", "growth"])]
    draw: Option<PathBuf>,
    /// accel: write the generated scenes as .glb into this folder, and copies of .glb files with the camera of --view, and
    /// measure nothing; all cameras are called "view"
    #[arg(long, value_name = "DIR", conflicts_with_all = ["output", "growth", "draw", "builds"])]
    write_scenes: Option<PathBuf>,
    /// Where --draw cuts: an axis, and the coordinate on it in metres, such as y=1.5 [default: the middle, across z]
    #[arg(long, value_name = "AXIS[=M]", value_parser = draw::slice, requires = "draw")]
    slice: Option<Slice>,
    #[command(flatten)]
    error: error::ErrorArgs,
    /// Compare with Embree 4: its library, or a folder that has it
    #[cfg(feature = "embree")]
    #[arg(long, value_name = "PATH")]
    embree: Option<PathBuf>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum What {
    /// Acceleration structures: rays per second, build time, memory, work per ray
    Accel,
    /// Ray-triangle tests: their cost, and whether rays slip through between triangles
    Kernels,
    /// The render loop: paths per second, in total and by stage, against one path at a time and the reference
    Wavefront,
    /// Error against time: relMSE of rising numbers of samples against a converged picture, and what became of it
    Error,
}

/// A part of `bench wavefront`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Part {
    /// The wavefront, one path at a time, the f64 reference
    Modes,
    /// Waves sorted by shading class, and as they are
    Sort,
    /// Numbers of threads
    Threads,
    /// Numbers of paths in a wave
    WaveSize,
}

impl Args {
    /// A scene with the light and the eye that were asked for, and its tables.
    fn open(&self, source: &Source, console: &mut Console) -> Result<(Scene, Renderer), CliError> {
        let mut scene = source.scene(console)?;
        if let Some(env) = &self.env {
            scene::set_environment(&mut scene, env, 0.0, 1.0, console)?;
        }
        if let Some(view) = self.view {
            view.take(&mut scene);
        }
        let mut renderer = Renderer::new();
        renderer.sync(&mut scene).warnings.iter().for_each(|warning| console.warn(warning));
        Ok((scene, renderer))
    }
}

/// Measures.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    match args.what {
        What::Accel => accel::run(args, console),
        What::Kernels => kernels::run(args, console),
        What::Wavefront => wavefront::run(args, console),
        What::Error => error::run(args, console),
    }
}
