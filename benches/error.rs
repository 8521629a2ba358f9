//! How much error is left after how much time, and is that better than before?
//!
//! `cargo bench --bench error` runs `wavecast bench error` over the scenes of `scenes/`, or over those named after `--`,
//! and writes tables and plots to `benches/results/error`. Converged pictures are kept in the user's cache. What else
//! follows `--` is added to the command line of the program.
//!
//! It fails if a scene lost efficiency since a table was written (`-- --compare OLD.csv`) or against another build
//! (`-- --against PROGRAM`, an absolute path), which takes turns with this one: where a machine is shared, only that says
//! something about time.

use std::{
    env, fs,
    path::Path,
    process::{Command, ExitCode},
};

/// Where tables go.
const RESULTS: &str = "benches/results/error";
/// Rounds of two builds in turn.
const SEEDS: u32 = 5;

/// Scenes of the folder, sorted by name.
fn all_scenes(folder: &Path) -> Vec<String> {
    let is_scene = |name: &String| name.ends_with(".gltf") || name.ends_with(".glb");
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.retain(is_scene);
    names.sort();
    names.into_iter().map(|name| format!("scenes/{name}")).collect()
}

/// Runs a program from the folder of the crate, so that tables do not tell where that is; false if it fails.
fn run(program: &str, arguments: &[&[String]]) -> bool {
    let mut program = Command::new(program);
    program.current_dir(env!("CARGO_MANIFEST_DIR")).args(["bench", "error"]).args(arguments.concat());
    program.status().inspect_err(|error| eprintln!("error: {error}")).is_ok_and(|status| status.success())
}

/// Both programs in turn, a seed each time, then what their tables say together.
fn in_turn(programs: [&str; 2], scenes: &[String], asked: &[String]) -> bool {
    let mut tables = [vec!["--compare".to_owned()], vec!["--measured".to_owned()]];
    for round in 0..SEEDS {
        for ((program, name), tables) in programs.iter().zip(["old", "new"]).zip(&mut tables) {
            let folder = format!("{RESULTS}/{name}-{round}");
            let more = ["--rounds", &format!("{round}..{}", round + 1), "-o", &folder].map(str::to_owned);
            if !run(program, &[scenes, asked, &more]) {
                return false;
            }
            tables.push(format!("{folder}/error.csv"));
        }
    }
    run(programs[1], &[&tables[0], &tables[1]])
}

fn main() -> ExitCode {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    // Cargo says `--bench` to everything that it runs as a bench.
    let mut asked: Vec<String> = env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let old = asked.iter().position(|argument| argument == "--against").map(|place| {
        asked.remove(place);
        if place < asked.len() { asked.remove(place) } else { String::new() }
    });
    let named = asked.iter().take_while(|argument| !argument.starts_with('-')).count();
    let options = asked.split_off(named);
    let scenes = if asked.is_empty() { all_scenes(&root.join("scenes")) } else { asked };
    let new = env!("CARGO_BIN_EXE_wavecast");
    let well = match old {
        Some(old) => in_turn([&old, new], &scenes, &options),
        None => run(new, &[&scenes, &options, &["-o".to_owned(), RESULTS.to_owned()]]),
    };
    if well { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
