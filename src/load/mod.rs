//! glTF file to Scene.

use std::{fmt, path::Path};

use crate::world::{EnvironmentMap, Scene};

/// What to load of a file.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// Name or index of the scene; `None` for the default one.
    pub scene: Option<String>,
}

/// A scene and what was noticed on the way.
pub struct Loaded {
    /// Ready to sync.
    pub scene: Scene,
    /// What is drawn around.
    pub warnings: Vec<Warning>,
    /// What is in the file.
    pub info: FileInfo,
}

/// Something that is drawn around.
#[derive(Clone, Debug)]
pub struct Warning(String);

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// What is in a file.
#[derive(Clone, Debug, Default)]
pub struct FileInfo {}

/// Why a file could not be loaded.
#[derive(Debug, thiserror::Error)]
#[error("{0}: loading is not there yet")]
pub struct LoadError(String);

/// Loads a scene.
///
/// # Errors
///
/// Always.
pub fn load(path: &Path, _options: &LoadOptions) -> Result<Loaded, LoadError> {
    Err(LoadError(path.display().to_string()))
}

/// Loads an environment.
///
/// # Errors
///
/// Always.
pub fn load_environment(path: &Path) -> Result<(EnvironmentMap, Vec<Warning>), LoadError> {
    Err(LoadError(path.display().to_string()))
}
