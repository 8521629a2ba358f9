//! The program as scripts see it: exit codes, streams, files.

mod bench;
mod compare;
mod error;
mod measure;
mod render;
mod usage;

use std::{
    ffi::OsStr,
    path::{Path, PathBuf},
    process::Command,
};

use wavecast::film::{self, Picture, WriteOptions};

/// What a run of the program left.
struct Run {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

impl Run {
    /// Fails the test unless the run ended with this exit code.
    #[track_caller]
    fn expect(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "stdout: {}\nstderr: {}", self.stdout, self.stderr);
        self
    }

    /// Fails the test unless stderr has this text.
    #[track_caller]
    fn says(self, text: &str) -> Self {
        assert!(self.stderr.contains(text), "{text:?} is not in {}", self.stderr);
        self
    }
}

/// Runs the program to its end.
fn wavecast<S: AsRef<OsStr>>(args: impl IntoIterator<Item = S>) -> Run {
    let output = Command::new(env!("CARGO_BIN_EXE_wavecast")).args(args).output().unwrap();
    // What a build without AVX2 says first is true of the build, not of the run.
    let text = |bytes| {
        let text = String::from_utf8(bytes).unwrap();
        text.split_inclusive('\n').filter(|line| !line.starts_with("note: this build is slow")).collect()
    };
    Run { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

/// Runs the program on words without spaces in them.
fn line(words: &str) -> Run {
    wavecast(words.split_whitespace())
}

/// A folder that vanishes after the test.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Names of what is in it, sorted.
    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

/// Writes a picture with the library.
fn write(path: &Path, width: usize, rgb: Vec<[f32; 3]>, options: &WriteOptions) {
    let picture = Picture { width, height: rgb.len() / width, rgb, ..Picture::default() };
    film::write(path, &picture, options).unwrap();
}
