//! URIs of buffers and images: data in place, or a file in the scene's folder.

use std::path::{Component, Path, PathBuf};

use base64::{
    Engine,
    alphabet::STANDARD,
    engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig},
};
use percent_encoding::percent_decode_str;

use super::{container::read_file, error::LoadError, json::Json};

/// Files in the wild leave padding out; the specification is silent about it.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// What a URI names, not yet read.
pub(super) enum Target<'a> {
    /// The part of a data URI after the comma, and whether it is base64.
    Data { text: &'a str, base64: bool },
    /// A file below the scene's folder.
    File(PathBuf),
}

/// Where a URI leads.
///
/// # Errors
/// If it has another scheme than `data`, is absolute, or leaves `folder`.
pub(super) fn resolve<'a>(uri: &Json<'a>, folder: &Path) -> Result<Target<'a>, LoadError> {
    let text = uri.string()?;
    let refuse = |reason| LoadError::Uri { at: uri.at.clone(), uri: text.to_owned(), reason };
    if let Some(data) = text.strip_prefix("data:") {
        let (header, text) = data.split_once(',').ok_or_else(|| refuse("a data URI has a comma before its data"))?;
        return Ok(Target::Data { text, base64: header.ends_with(";base64") });
    }
    let scheme = text.split_once(':').map(|(scheme, _)| scheme);
    if scheme.is_some_and(|s| !s.is_empty() && s.chars().all(|c| c.is_ascii_alphanumeric() || "+.-".contains(c))) {
        return Err(refuse("only files beside the scene are read; save it there"));
    }
    let decoded = percent_decode_str(text).decode_utf8().map_err(|_| refuse("it is not UTF-8"))?;
    let file = below(folder, &decoded).ok_or_else(|| refuse("it leaves the folder of the scene"))?;
    // A name with a bare percent sign is not a URI, but exporters write it.
    match below(folder, text) {
        Some(raw) if !file.exists() && raw.exists() => Ok(Target::File(raw)),
        _ => Ok(Target::File(file)),
    }
}

fn below(folder: &Path, relative: &str) -> Option<PathBuf> {
    let leaves = relative.is_empty()
        || relative.starts_with(['/', '\\'])
        || relative.contains('\0')
        || relative.split(['/', '\\']).any(|part| part == "..")
        || Path::new(relative).components().any(|c| !matches!(c, Component::Normal(_) | Component::CurDir));
    (!leaves).then(|| folder.join(relative))
}

impl Target<'_> {
    /// At least as many bytes as reading will give, without reading; 0 if there is nothing to read.
    pub(super) fn size_hint(&self) -> u64 {
        match self {
            Self::Data { text, .. } => text.len() as u64,
            Self::File(path) => std::fs::metadata(path).map_or(0, |data| data.len()),
        }
    }

    /// # Errors
    /// If the file cannot be read or the data is not base64.
    pub(super) fn read(&self, uri: &Json<'_>) -> Result<Vec<u8>, LoadError> {
        match self {
            Self::File(path) => read_file(path, Some(&uri.at)),
            Self::Data { text, base64: false } => Ok(percent_decode_str(text).collect()),
            Self::Data { text, base64: true } => BASE64.decode(text).map_err(|_| LoadError::Uri {
                at: uri.at.clone(),
                uri: text.chars().take(40).collect(),
                reason: "its data is not base64",
            }),
        }
    }
}
