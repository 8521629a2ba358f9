//! What can go wrong with picture files.

use std::{io, path::PathBuf};

/// Why a picture could not be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FilmError {
    /// The name does not say which format.
    #[error("{}: unknown kind of picture; use .exr, .png or .hdr", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
    },
    /// The folder to write to is missing.
    #[error("{}: there is no folder {}; create it first", path.display(), folder.display())]
    Folder {
        /// The file.
        path: PathBuf,
        /// Its folder.
        folder: PathBuf,
    },
    /// A folder has the name that the file should get.
    #[error("{}: is a folder; name a file in it", path.display())]
    IsFolder {
        /// The file.
        path: PathBuf,
    },
    /// The file could not be written.
    #[error("{}: cannot write; check the folder's permissions and free space", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// There is no pixel to write.
    #[error("{}: the picture has no pixels", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A layer has another number of values than the picture has pixels.
    #[error("{}: {what} has {actual} values, the picture {expected} pixels", path.display())]
    Length {
        /// The file.
        path: PathBuf,
        /// Name of the layer.
        what: String,
        /// Pixels.
        expected: usize,
        /// Values.
        actual: usize,
    },
    /// Two layers would share their channels.
    #[error("{}: two layers are called {name}", path.display())]
    Duplicate {
        /// The file.
        path: PathBuf,
        /// Of both layers.
        name: String,
    },
    /// The file could not be read.
    #[error("{}: cannot read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file is not what its extension says, or of a kind that is not read.
    #[error("{}: not a readable {format} file: {message}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// By extension.
        format: &'static str,
        /// What the decoder said.
        message: String,
    },
}
