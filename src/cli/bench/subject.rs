//! Scenes to measure: files, and such as are made by formula.

use std::{fmt, path::PathBuf};

use wavecast::{
    flat::CameraView,
    load::{self, LoadOptions},
    render::Renderer,
    world::{
        Scene,
        generated::{self, FOLIAGE, HALL},
    },
};

use super::rays::{Corners, world_triangles};
use crate::cli::{console::Console, error::CliError, scene::View};

/// Fewest triangles of a scene made by formula: fewer do not show what it is.
pub const FEWEST: f64 = 1e3;
/// Most triangles of a scene made by formula: more do not fit into the memory of most machines in all structures at once.
pub const MOST: f64 = 1e7;

/// A `SCENE` of the command line.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// .gltf or .glb.
    File(PathBuf),
    /// Made by formula.
    Generated(Formula, usize),
}

/// What there is without a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Formula {
    /// [`generated::hall`].
    Hall,
    /// [`generated::foliage`].
    Foliage,
}

impl Formula {
    /// As the command line calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hall => "hall",
            Self::Foliage => "foliage",
        }
    }
}

/// A number of triangles, such as `1e6`.
pub fn triangles(text: &str) -> Result<usize, String> {
    match text.trim().parse::<f64>() {
        Ok(wanted) if (FEWEST..=MOST).contains(&wanted) => Ok(wanted.round() as usize),
        _ => Err(format!("expected a number of triangles from {FEWEST:e} to {MOST:e}")),
    }
}

/// A file, or `hall`, `foliage`, `hall:1e5`.
pub fn source(text: &str) -> Result<Source, String> {
    let (name, wanted) = text.split_once(':').map_or((text, None), |(name, wanted)| (name, Some(wanted)));
    let (formula, ordinary) = match name {
        "hall" => (Formula::Hall, HALL),
        "foliage" => (Formula::Foliage, FOLIAGE),
        _ => return Ok(Source::File(PathBuf::from(text))),
    };
    Ok(Source::Generated(formula, wanted.map_or(Ok(ordinary), triangles)?))
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) => write!(f, "{}", path.display()),
            Self::Generated(formula, triangles) => write!(f, "{}:{triangles}", formula.name()),
        }
    }
}

impl Source {
    /// The scene, with a word on what had to be left out.
    pub fn scene(&self, console: &mut Console) -> Result<Scene, CliError> {
        match self {
            Self::File(path) => {
                let loaded = load::load(path, &LoadOptions::default())?;
                loaded.warnings.iter().for_each(|warning| console.warn(warning));
                Ok(loaded.scene)
            }
            Self::Generated(Formula::Hall, triangles) => Ok(generated::hall(*triangles)),
            Self::Generated(Formula::Foliage, triangles) => Ok(generated::foliage(*triangles)),
        }
    }
}

/// A scene as rays see it.
pub struct Subject {
    /// As tables call it.
    pub name: String,
    /// All triangles, in world space.
    pub triangles: Vec<Corners>,
    /// From where it is looked at.
    pub view: CameraView,
}

impl Subject {
    /// Reads or makes the scene.
    pub fn new(source: &Source, view: Option<View>, console: &mut Console) -> Result<Self, CliError> {
        let mut scene = source.scene(console)?;
        if let Some(view) = view {
            view.take(&mut scene);
        }
        let mut renderer = Renderer::new();
        renderer.sync(&mut scene).warnings.iter().for_each(|warning| console.warn(warning));
        let scene = renderer.scene();
        Ok(Self { name: source.to_string(), triangles: world_triangles(scene), view: scene.camera })
    }

    /// The name as part of a file's.
    pub fn file_name(name: &str) -> String {
        let last = name.rsplit(['/', '\\']).next().unwrap_or(name);
        last.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_files_or_formulas_with_a_size() {
        assert_eq!(source("hall"), Ok(Source::Generated(Formula::Hall, HALL)));
        assert_eq!(source("foliage:1e4"), Ok(Source::Generated(Formula::Foliage, 10_000)));
        assert_eq!(source("halls.glb"), Ok(Source::File("halls.glb".into())));
        for text in ["hall:", "hall:many", "hall:10", "foliage:1e9", "hall:nan"] {
            assert!(source(text).is_err(), "{text}");
        }
        assert_eq!(Subject::file_name("../scenes/a b.glb"), "a-b-glb");
    }
}
