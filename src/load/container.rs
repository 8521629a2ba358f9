//! The two shapes a scene file comes in: JSON text, or a GLB with JSON and one binary chunk.

use std::{fs, path::Path};

use serde_json::Value;

use super::error::{LoadError, Place};

/// A scene file taken apart.
pub(super) struct Container {
    pub(super) json: Value,
    /// The binary chunk of a GLB.
    pub(super) binary: Option<Vec<u8>>,
}

const JSON: u32 = u32::from_le_bytes(*b"JSON");
const BIN: u32 = u32::from_le_bytes(*b"BIN\0");

/// Reads a whole regular file; devices and pipes, which may never end, are refused.
pub(super) fn read_file(path: &Path, at: Option<&Place>) -> Result<Vec<u8>, LoadError> {
    let read = || {
        if !fs::metadata(path)?.is_file() {
            return Err(std::io::Error::other("not a regular file"));
        }
        fs::read(path)
    };
    read().map_err(|source| LoadError::Read { path: path.to_owned(), at: at.cloned(), source })
}

/// Takes a file apart; what it is shows in its first bytes, not in its name.
pub(super) fn open(path: &Path) -> Result<Container, LoadError> {
    let bytes = read_file(path, None)?;
    let place = Place::file(path);
    if bytes.starts_with(b"glTF") {
        let (json, binary) = split_glb(&bytes, &place)?;
        return Ok(Container { json: parse(json, &place)?, binary: binary.map(<[u8]>::to_vec) });
    }
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    Ok(Container { json: parse(text, &place)?, binary: None })
}

fn parse(text: &[u8], place: &Place) -> Result<Value, LoadError> {
    let value: Value = serde_json::from_slice(text).map_err(|error| {
        let message = error.to_string();
        let reason = message.split(" at line ").next().unwrap_or(&message);
        let at = place.with_part(format!("line {} column {}", error.line(), error.column()));
        LoadError::Syntax { at, reason: format!("not JSON: {reason}") }
    })?;
    if value.is_object() {
        return Ok(value);
    }
    Err(LoadError::Syntax { at: place.with_part("line 1 column 1".to_owned()), reason: "not a JSON object".to_owned() })
}

/// The JSON chunk and the binary chunk, as glTF 2.0 section 4.4 lays them out.
fn split_glb<'a>(bytes: &'a [u8], place: &Place) -> Result<(&'a [u8], Option<&'a [u8]>), LoadError> {
    let broken =
        |offset: usize, reason: String| LoadError::Syntax { at: place.with_part(format!("byte {offset}")), reason };
    let word = |offset: usize| -> Result<u32, LoadError> {
        let found = bytes.get(offset..).and_then(|rest| rest.first_chunk::<4>());
        found
            .map(|word| u32::from_le_bytes(*word))
            .ok_or_else(|| broken(offset, format!("the GLB ends here, after {} bytes", bytes.len())))
    };
    let (version, length) = (word(4)?, word(8)? as usize);
    if version != 2 {
        return Err(broken(4, format!("GLB version {version}, only 2 is supported")));
    }
    if length > bytes.len() || length < 20 {
        return Err(broken(8, format!("the GLB says it has {length} bytes, the file has {}", bytes.len())));
    }
    let chunk = |offset: usize| -> Result<(u32, &'a [u8]), LoadError> {
        let (size, kind) = (word(offset)? as usize, word(offset + 4)?);
        let body = bytes[..length].get(offset + 8..).and_then(|rest| rest.get(..size));
        let body = body.ok_or_else(|| {
            broken(offset, format!("a chunk of {size} bytes, {} are left", length.saturating_sub(offset + 8)))
        })?;
        Ok((kind, body))
    };
    let (kind, json) = chunk(12)?;
    if kind != JSON {
        return Err(broken(16, "the first chunk is not JSON".to_owned()));
    }
    let mut offset = 20 + json.len();
    // Chunks of other kinds are to be skipped; up to three bytes may follow the last one as padding.
    while offset + 8 <= length {
        let (kind, body) = chunk(offset)?;
        if kind == BIN {
            return Ok((json, Some(body)));
        }
        offset += 8 + body.len();
    }
    Ok((json, None))
}
