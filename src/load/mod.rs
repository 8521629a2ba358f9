//! glTF file to Scene.
//!
//! In flows a path to a `.gltf` or `.glb` file, out flow a [`Scene`] with
//! materials and nodes as entities, warnings about what had to be left out or
//! bent, and a [`FileInfo`] for people. What the chosen scene does not need is
//! not read.
//!
//! A file may hold anything, so nothing in it is believed: each value is read
//! through a cursor that knows its JSON pointer, each count is compared with
//! the bytes there are before memory is taken for it. The `gltf` crate lends
//! its names of constants only; its typed view rejects extensions it could skip,
//! drops texture transforms of normal maps, and its readers panic on quantised
//! positions and hostile counts. The tests hold the two against each other.

mod accessors;
mod buffers;
mod cameras;
mod container;
mod document;
mod environment;
mod error;
mod extensions;
mod images;
mod info;
mod json;
mod lights;
mod materials;
mod meshes;
mod morph;
mod nodes;
mod primitives;
mod scene;
mod skins;
mod tangents;
mod textures;
mod uri;
mod vertices;

use std::path::{Path, PathBuf};

use self::{buffers::Buffers, document::Document, error::Warnings};
pub use self::{
    environment::load_environment,
    error::{LoadError, Place, Warning},
    extensions::{ExtensionStatus, ExtensionUse},
    info::{CameraInfo, Counts, FileInfo},
};
use crate::world::Scene;

/// How to name one of several.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Selector {
    /// The first of this name.
    Name(String),
    /// The one at this place in the file, from 0.
    Index(usize),
    /// The first of this name or, if there is none, the one at this place.
    Either(String),
}

impl From<&str> for Selector {
    fn from(text: &str) -> Self {
        Self::Either(text.to_owned())
    }
}

/// What to load of a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// The scene; `None` takes the file's default scene, else the first, else all nodes.
    pub scene: Option<Selector>,
}

/// A loaded file.
pub struct Loaded {
    /// Materials in file order, then nodes depth first.
    pub scene: Scene,
    /// What the picture lacks or shows otherwise than the file says.
    pub warnings: Vec<Warning>,
    /// What is in the file.
    pub info: FileInfo,
}

/// Reads a scene from a glTF 2.0 file, text or binary.
///
/// # Errors
/// If the file, or what it refers to, cannot be read, is malformed, or requires
/// an extension that is not supported.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let container = container::open(path)?;
    let document = Document::new(&container.json, error::Place::file(path))?;
    let folder = path.parent().unwrap_or_else(|| Path::new(""));
    let mut warnings = Warnings::default();
    let mut info = FileInfo::read(&document)?;
    info.extensions = extensions::check(&document, &mut warnings)?;
    if info.counts.animations > 0 {
        let at = document.root.at.join("animations");
        warnings.push(&at, "animations are not played: all stands in its rest pose");
    }
    let buffers = Buffers::new(&document, folder, container.binary);
    let scene = scene::read(&document, &buffers, options, &mut info, &mut warnings)?;
    Ok(Loaded { scene, warnings: warnings.list, info })
}

/// The files that a scene is made of: its own, then the buffers and images beside it, in the order of the file.
///
/// What is not there, or must not be followed, is left out: whether the scene needs it, [`load`] finds out.
///
/// # Errors
/// If the scene file cannot be read or is not a glTF 2.0 file.
pub fn files(path: &Path) -> Result<Vec<PathBuf>, LoadError> {
    let container = container::open(path)?;
    let document = Document::new(&container.json, error::Place::file(path))?;
    let folder = path.parent().unwrap_or_else(|| Path::new(""));
    let mut all = vec![path.to_owned()];
    for kind in [document::BUFFERS, document::IMAGES] {
        for element in document.elements(kind) {
            let Some(uri) = element.get("uri")? else { continue };
            match uri::resolve(&uri, folder) {
                Ok(uri::Target::File(file)) if file.is_file() => all.push(file),
                _ => {}
            }
        }
    }
    Ok(all)
}
