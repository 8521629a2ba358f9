//! Picture files come back, to be compared.

use std::{fs::File, io::BufReader, path::Path};

use super::{FilmError, Format, Picture, exr, hdr, png};

/// What the numbers of a picture file stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Referred {
    /// Light in the scene: EXR and HDR.
    Scene,
    /// Light of a display, after exposure and tone mapping: PNG. The picture holds it decoded to linear.
    Display,
}

/// Reads a picture; the extension says how.
///
/// # Errors
///
/// If the extension is unknown, or the file missing or malformed.
pub fn read(path: &Path) -> Result<(Picture, Referred), FilmError> {
    let format = Format::of(path)?;
    let file = File::open(path).map_err(|source| FilmError::Read { path: path.into(), source })?;
    let reader = BufReader::new(file);
    let (name, decoded) = match format {
        Format::Exr => ("OpenEXR", exr::decode(reader)),
        Format::Png => ("PNG", png::decode(reader)),
        Format::Hdr => ("Radiance", hdr::decode(reader)),
    };
    decoded.map_err(|message| FilmError::Decode { path: path.into(), format: name, message })
}
