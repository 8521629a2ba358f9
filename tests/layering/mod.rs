//! Which module may use which: the invariants of the architecture, read off the `use` lines.

use std::{fs, path::Path};

use crate::common::root;

/// Source files under a folder of `src`, or the one file of that name, without their test modules.
fn sources(name: &str) -> Vec<(String, String)> {
    fn walk(path: &Path, out: &mut Vec<(String, String)>) {
        if path.is_dir() {
            for entry in fs::read_dir(path).unwrap() {
                walk(&entry.unwrap().path(), out);
            }
        } else if path.extension().is_some_and(|e| e == "rs") && !path.ends_with("tests.rs") {
            let text = fs::read_to_string(path).unwrap();
            let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default().to_owned();
            out.push((path.display().to_string(), code));
        }
    }
    let folder = root().join("src").join(name);
    let mut out = Vec::new();
    walk(&if folder.is_dir() { folder } else { folder.with_extension("rs") }, &mut out);
    out.retain(|(path, _)| !path.contains("/tests/"));
    assert!(!out.is_empty(), "src/{name} is not there");
    out
}

/// Lines that are code: comments may speak of anything.
fn code_lines(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter(|line| !line.trim_start().starts_with("//"))
}

#[track_caller]
fn check_absent(modules: &[&str], words: &[&str]) {
    for module in modules {
        for (path, text) in sources(module) {
            for line in code_lines(&text) {
                for word in words {
                    assert!(!line.contains(word), "{path} uses {word}: {line}");
                }
            }
        }
    }
}

const ALL: [&str; 15] = [
    "load",
    "world",
    "systems",
    "flat",
    "wavefront",
    "film",
    "accel",
    "bsdf",
    "light",
    "sampling",
    "simd",
    "reference",
    "measure",
    "cli",
    "render",
];

#[test]
fn hecs_is_known_to_load_world_and_systems_alone() {
    let others: Vec<&str> = ALL.into_iter().filter(|m| !["load", "world", "systems"].contains(m)).collect();
    check_absent(&others, &["hecs"]);
}

#[test]
fn what_stages_call_does_no_io() {
    let pure = ["flat", "accel", "bsdf", "light", "sampling", "simd", "wavefront"];
    check_absent(&pure, &["std::fs", "std::io", "println!", "File::", "std::env", "unwrap()"]);
}

#[test]
fn stages_do_not_know_one_another_or_the_world_they_come_from() {
    check_absent(&["wavefront"], &["systems::", "load::", "cli::", "reference::"]);
    let stages = ["generate", "intersect", "sort", "absorb", "layers", "sky", "emit", "shade", "connect", "bounce"];
    for stage in stages {
        // `shade` and the one-path mode share kernels; those are not stages.
        let others: Vec<String> =
            stages.iter().filter(|other| **other != stage).map(|other| format!("{other}::{other}(")).collect();
        let others: Vec<&str> = others.iter().map(String::as_str).collect();
        check_absent(&[&format!("wavefront/{stage}")], &others);
    }
}

#[test]
fn the_reference_shares_the_tables_and_nothing_else() {
    let shared = ["bsdf::", "light::", "sampling::", "accel::", "wavefront::", "simd::"];
    let shared: Vec<String> = shared.iter().map(|module| format!("crate::{module}")).collect();
    check_absent(&["reference"], &shared.iter().map(String::as_str).collect::<Vec<_>>());
    for (path, text) in sources("reference") {
        for line in code_lines(&text).filter(|line| line.trim_start().starts_with("use crate::")) {
            let allowed = [
                "use crate::flat",
                "use crate::render::PixelFilter",
                "use crate::{",
                "use crate::light::EnvironmentTable",
            ];
            assert!(allowed.iter().any(|a| line.trim_start().starts_with(a)), "{path}: {line}");
        }
    }
}

/// Those that have a reason, and give it: a prefetch, and the functions of a foreign library, in builds that ask for it.
const UNSAFE: [&str; 2] = ["simd/prefetch.rs", "cli/bench/embree/"];

#[test]
fn unsafe_code_appears_in_two_places() {
    for (path, text) in ALL.iter().flat_map(|module| sources(module)) {
        for word in ["unsafe {", "unsafe fn", "unsafe impl", "allow(unsafe_code)"] {
            let found = code_lines(&text).any(|line| line.contains(word));
            assert!(!found || UNSAFE.iter().any(|place| path.contains(place)), "{path} uses {word}");
        }
        let reasoned = text.matches("unsafe {").count() + text.matches("unsafe impl").count();
        assert_eq!(reasoned, text.matches("// SAFETY: ").count(), "{path}");
    }
}
