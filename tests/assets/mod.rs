//! Pictures of the open asset pack, where it is at hand: that each file gives one, and that it is the right one.
//!
//! `gltf` checks what the loader makes of the files; here it is what a camera sees.

mod judge;
mod models;
mod pictures;

use std::path::{Path, PathBuf};

/// The pack's folder, or a word about skipping.
fn pack() -> Option<PathBuf> {
    let folder = crate::common::root().join("../shared/assets");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("SKIPPED: there is no asset pack at {}", folder.display());
    None
}

/// All scenes below a folder, sorted.
fn scenes(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            found.extend(scenes(&path));
        } else if path.extension().is_some_and(|e| e == "gltf" || e == "glb") {
            found.push(path);
        }
    }
    found
}
