//! Writes the scenes of this folder again: `cargo run --release --example generate_scenes [FOLDER]`.

use std::{env, fs, io, path::PathBuf};

mod generator;

fn main() -> io::Result<()> {
    let here = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes"));
    let folder = env::args_os().nth(1).map_or(here, PathBuf::from);
    fs::create_dir_all(&folder)?;
    for file in generator::files() {
        fs::write(folder.join(file.name), &file.bytes)?;
        let env = file.env.map_or(String::new(), |env| format!(", needs --env {env}"));
        println!("{:<16}{:>9} bytes  {}{env}", file.name, file.bytes.len(), file.counts);
    }
    Ok(())
}
