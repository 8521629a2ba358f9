//! The command line: one file per subcommand.
//!
//! stdout carries results only; notes, warnings, errors and progress go to stderr. Exit codes: 0
//! done, 1 bad input, 2 bad usage, 130 after Ctrl-C.

mod args;
mod bench;
mod compare;
mod console;
mod error;
mod info;
mod interrupt;
mod label;
mod measure;
mod memory;
mod plot;
mod progress;
mod render;
mod scene;
mod series;
mod stats;
mod structure;

use std::{num::NonZeroUsize, process::ExitCode};

use clap::{Args, Parser, Subcommand};

use self::{console::Console, error::CliError};

/// Path tracer for glTF 2.0 scenes, in physical units, on the CPU.
#[derive(Parser)]
#[command(
    name = "wavecast",
    version,
    arg_required_else_help = true,
    after_help = "Example:\n  wavecast render scenes/cornell.gltf -o cornell.png --spp 256"
)]
struct Cli {
    #[command(flatten)]
    common: Common,
    #[command(subcommand)]
    command: Command,
}

/// What works with every subcommand.
#[derive(Args)]
struct Common {
    /// No progress, notes, warnings or summary; errors are still shown
    #[arg(long, global = true)]
    quiet: bool,
    /// The result on stdout as JSON
    #[arg(long, global = true)]
    json: bool,
    /// Worker threads [default: one per core]
    #[arg(long, global = true, value_name = "N")]
    threads: Option<NonZeroUsize>,
}

#[derive(Subcommand)]
enum Command {
    Render(Box<render::Args>),
    Series(Box<series::Args>),
    Measure(Box<measure::Args>),
    Info(info::Args),
    Compare(compare::Args),
    Bench(Box<bench::Args>),
}

/// How a subcommand ended, if not with an error.
#[derive(Debug)]
enum Outcome {
    Done,
    Interrupted,
}

/// Reads the arguments, does what they say, and tells how it went.
///
/// Never inlined, so that nothing of it runs before `main` has asked the processor.
#[inline(never)]
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    let mut console = Console::new(cli.common.quiet, cli.common.json);
    if cfg!(all(target_arch = "x86_64", not(target_feature = "avx2"))) {
        console.note(
            "this build is slow: it was compiled without AVX2, most likely because RUSTFLAGS replaced the setting in \
             .cargo/config.toml; add -C target-cpu=x86-64-v3 to it",
        );
    }
    let ended = start(&cli.common).and_then(|()| match cli.command {
        Command::Render(args) => render::run(*args, &cli.common, &mut console),
        Command::Series(args) => series::run(&args, &cli.common, &mut console),
        Command::Measure(args) => measure::run(&args, &cli.common, &mut console),
        Command::Info(args) => info::run(&args, &mut console),
        Command::Compare(args) => compare::run(&args, &mut console),
        Command::Bench(args) => bench::run(&args, &mut console),
    });
    console.finish();
    match ended {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Interrupted) => ExitCode::from(interrupt::EXIT_CODE),
        Err(error) => {
            eprintln!("error: {}", error.with_sources());
            ExitCode::from(error.exit_code())
        }
    }
}

/// Threads and Ctrl-C.
fn start(common: &Common) -> Result<(), CliError> {
    interrupt::install();
    let threads = common.threads.map_or(0, NonZeroUsize::get);
    // This thread is one of them. Were it to hand its work to another and sleep, the system could take milliseconds to
    // find a third a core, as the first of them has only just left one: a top level of 10,000 instances then took twice
    // as long.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).use_current_thread();
    pool.build_global().map_err(|error| CliError::Usage(format!("cannot start threads: {error}")))
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::Cli;

    #[test]
    fn the_parser_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_subcommand_shows_an_example() {
        for command in Cli::command().get_subcommands_mut() {
            let help = command.render_long_help().to_string();
            assert!(help.contains("Example:\n  wavecast "), "{}", command.get_name());
        }
    }
}
