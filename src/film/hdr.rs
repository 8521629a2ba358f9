//! Radiance HDR: scene-linear light with eight bits of mantissa and a shared exponent.

use std::io::{self, BufRead, Write};

use image::{
    Rgb,
    codecs::hdr::{HdrDecoder, HdrEncoder},
};

use super::{Picture, Referred, metadata};

/// What the encoder puts where the metadata goes.
const ENCODERS_COMMENT: &[u8] = b"# Rust HDR encoder\n";

/// Writes the beauty picture; the format has neither alpha nor layers nor negative light.
pub(super) fn encode(to: &mut impl Write, picture: &Picture) -> io::Result<()> {
    let rgb: Vec<_> = picture.rgb.iter().map(|rgb| Rgb(rgb.map(storable))).collect();
    let mut bytes = Vec::new();
    HdrEncoder::new(&mut bytes).encode(&rgb, picture.width, picture.height).map_err(io::Error::other)?;
    let header = format!("SOFTWARE={}\n", metadata::SOFTWARE);
    let lines = picture.metadata.iter().map(|(key, value)| {
        // A line ends a value, and an equals sign the key.
        let key = metadata::to_file(key).replace(['\n', '\r', '=', ' '], "_");
        format!("{key}={}\n", value.replace(['\n', '\r'], " "))
    });
    let header: String = std::iter::once(header).chain(lines).collect();
    let at = bytes.windows(ENCODERS_COMMENT.len()).position(|window| window == ENCODERS_COMMENT);
    match at {
        Some(at) => {
            to.write_all(&bytes[..at])?;
            to.write_all(header.as_bytes())?;
            to.write_all(&bytes[at + ENCODERS_COMMENT.len()..])
        }
        None => to.write_all(&bytes),
    }
}

/// The nearest light that a shared exponent can hold: 0 for what is negative or not a number.
fn storable(light: f32) -> f32 {
    if light > 0.0 { light.min(1.7e38) } else { 0.0 }
}

/// Reads any Radiance file of RGBE pixels.
pub(super) fn decode(from: impl BufRead) -> Result<(Picture, Referred), String> {
    use image::{DynamicImage, ImageDecoder};
    let decoder = HdrDecoder::new(from).map_err(|e| e.to_string())?;
    let header = decoder.metadata();
    let (width, height) = decoder.dimensions();
    let pixels = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?.into_rgb32f();
    // EXPOSURE lines say what the stored light has been multiplied by already.
    let scale = header.exposure.filter(|e| *e > 0.0).map_or(1.0, f32::recip);
    let picture = Picture {
        width: width as usize,
        height: height as usize,
        rgb: pixels.pixels().map(|p| p.0.map(|c| c * scale)).collect(),
        metadata: header
            .custom_attributes
            .iter()
            .filter(|(key, _)| !matches!(key.as_str(), "" | "FORMAT" | "EXPOSURE"))
            .map(|(key, value)| (metadata::from_file(key), value.clone()))
            .collect(),
        ..Picture::default()
    };
    Ok((picture, Referred::Scene))
}
