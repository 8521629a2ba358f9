//! What ends the program early.

use std::{error::Error, path::PathBuf};

use wavecast::{film::FilmError, load::LoadError};

/// Why a subcommand did not do what was asked.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// Options that contradict each other or the scene.
    #[error("{0}; see --help")]
    Usage(String),
    /// Scene or environment.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Picture files.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// No camera of this name or index.
    #[error("{}: no camera {wanted:?}; there is {available}", scene.display())]
    NoCamera { scene: PathBuf, wanted: String, available: String },
    /// No entity of this name.
    #[error("{}: no entity {wanted:?} with a surface or a light; there is {available}", scene.display())]
    NoEntity { scene: PathBuf, wanted: String, available: String },
    /// The entity is no light that has a flux.
    #[error("{}: {wanted:?} sends off no light of its own, or shines from infinitely far away; there is {available}",
        scene.display())]
    NoLight { scene: PathBuf, wanted: String, available: String },
    /// An expression names a light that is not there.
    #[error("--lpe: {} has no light {wanted:?}; there is {available}", scene.display())]
    NoNamedLight { scene: PathBuf, wanted: String, available: String },
    /// Pictures that have no pixels in common.
    #[error("{} is {} × {} pixels and {} is {} × {}; only pictures of one size can be compared",
        a.display(), a_size[0], a_size[1], b.display(), b_size[0], b_size[1])]
    Sizes { a: PathBuf, a_size: [usize; 2], b: PathBuf, b_size: [usize; 2] },
    /// Light of a scene and light of a display.
    #[error("{} holds light of a display and {} light of a scene; compare two PNGs, or two of EXR and HDR",
        display.display(), scene.display())]
    Referred { display: PathBuf, scene: PathBuf },
    /// A folder or table that cannot be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Output { path: PathBuf, source: std::io::Error },
    /// A plot or drawing that did not come about.
    #[error("{}: cannot be drawn: {problem}", path.display())]
    Drawing { path: PathBuf, problem: String },
    /// The answer of `bench accel` if a structure does not find what is there.
    #[error("{scene}: {accel} gave a wrong answer to {mismatches} of {checked} {rays} rays; its times mean nothing")]
    WrongHits { scene: String, accel: &'static str, rays: &'static str, mismatches: usize, checked: usize },
    /// The answer of `bench kernels` if rays slip through what is meant to be tight.
    #[error("{subject}: {misses} of {trials} rays slipped through a closed mesh")]
    Leaks { subject: String, misses: usize, trials: usize },
    /// The answer of `bench wavefront` if what is measured does not make the same picture.
    #[error("{scene}: {variant} makes another picture: {pixels} pixels differ; its times mean nothing")]
    WrongPicture { scene: String, variant: String, pixels: usize },
    /// A table that `bench error` did not write, or that is not all there.
    #[error("{}: not a table of renders by wavecast bench error: {problem}", path.display())]
    Table { path: PathBuf, problem: String },
    /// A picture that is in the place of a reference.
    #[error("{}: not a reference that wavecast bench error made; remove it, and it is made again", path.display())]
    NoReference { path: PathBuf },
    /// The answer of `bench error --compare` if a scene takes longer to the same error.
    #[error("less efficient than {}, beyond the noise: {}", than.display(), scenes.join(", "))]
    Lost { than: PathBuf, scenes: Vec<String> },
    /// Nothing in one table can be held against the other.
    #[error("nothing to compare with {}: {reason}", with.display())]
    Incomparable { with: PathBuf, reason: String },
    /// A library that cannot be used.
    #[cfg(feature = "embree")]
    #[error("{}: {problem}", path.display())]
    Library { path: PathBuf, problem: String },
    /// The answer of `compare --max-relmse`.
    #[error("relmse {actual:.6e} exceeds {allowed:.6e} (--max-relmse)")]
    Exceeded { actual: f64, allowed: f64 },
}

impl CliError {
    /// 2 for bad usage, 1 for all else.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Usage(_) => 2,
            _ => 1,
        }
    }

    /// The error and what led to it, on one line.
    pub fn with_sources(&self) -> String {
        let mut text = self.to_string();
        let mut source = self.source();
        while let Some(error) = source {
            text.push_str(": ");
            text.push_str(&error.to_string());
            source = error.source();
        }
        text
    }
}
