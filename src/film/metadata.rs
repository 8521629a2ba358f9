//! Names of metadata in files.

/// The program and its version, as written into every file.
pub(super) const SOFTWARE: &str = concat!("wavecast ", env!("CARGO_PKG_VERSION"));

/// Keeps our names apart from those that a format gives a meaning.
const PREFIX: &str = "wavecast.";

/// The name of a picture's metadata in a file.
pub(super) fn to_file(key: &str) -> String {
    format!("{PREFIX}{key}")
}

/// The picture's name of metadata found in a file; foreign names stay as they are.
pub(super) fn from_file(name: &str) -> String {
    name.strip_prefix(PREFIX).unwrap_or(name).into()
}
