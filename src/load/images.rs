//! Images decoded to texels: PNG and JPEG, 8 and 16 bits a channel.

use std::{io::Cursor, sync::Arc};

use image::{DynamicImage, ImageFormat, ImageReader};
use rayon::prelude::*;

use super::{
    buffers::Buffers,
    document::{Document, IMAGES},
    error::{LoadError, Place, Warnings},
    json::Json,
    uri,
};
use crate::world::{Image, Texels};

/// Most texels of one image: 16384 × 8192, half a gigabyte of eight-bit texels.
const MAX_TEXELS: u64 = 1 << 27;

/// Longest side of an image.
const MAX_SIDE: u64 = 1 << 15;

/// Most texels a byte of a compressed file can stand for: deflate gives 1032 bytes
/// for one, and a palette of two colours puts eight texels into each of them.
const MAX_TEXELS_PER_BYTE: u64 = 8 * 1032;

/// Refuses sizes that no honest file of this length has.
pub(super) fn check_size(at: &Place, width: u64, height: u64, bytes: usize) -> Result<(), LoadError> {
    if width == 0 || height == 0 {
        return Err(LoadError::Value {
            at: at.clone(),
            expected: "an image with texels".to_owned(),
            found: format!("{width} × {height} of them"),
        });
    }
    let too_large = |what, needed, limit| Err(LoadError::TooLarge { at: at.clone(), what, needed, limit });
    if width.max(height) > MAX_SIDE {
        return too_large("texels to a side", width.max(height), MAX_SIDE);
    }
    let limit = MAX_TEXELS.min(MAX_TEXELS_PER_BYTE * bytes as u64);
    if width * height > limit {
        return too_large("texels", width * height, limit);
    }
    Ok(())
}

/// Decodes the images of the given indices, in parallel; the others stay `None`.
///
/// So do, with a warning, those in a format that an unsupported extension brings.
///
/// # Errors
/// That of the first image, in file order, that cannot be decoded.
pub(super) fn decode_all(
    document: &Document<'_>,
    buffers: &Buffers<'_>,
    wanted: &[bool],
    warnings: &mut Warnings,
) -> Result<Vec<Option<Arc<Image>>>, LoadError> {
    let results: Vec<_> = (0..document.count(IMAGES))
        .into_par_iter()
        .map(|index| wanted[index].then(|| decode(&document.element(IMAGES, index), index, buffers)).transpose())
        .collect();
    let mut images = Vec::with_capacity(results.len());
    for (index, result) in results.into_iter().enumerate() {
        images.push(match result? {
            Some(Decoded::Texels(image)) => Some(Arc::new(image)),
            Some(Decoded::Foreign(extension)) => {
                let at = document.root.at.join(IMAGES.key).join(index);
                warnings.push(&at, format!("its format needs {extension}, which is not supported; left out"));
                None
            }
            None => None,
        });
    }
    Ok(images)
}

/// What became of an image.
enum Decoded {
    Texels(Image),
    /// In the format of this extension.
    Foreign(&'static str),
}

/// The extension that brings a format, by the first bytes of the file.
fn foreign_format(bytes: &[u8]) -> Option<&'static str> {
    if bytes.starts_with(b"\xabKTX 20\xbb") {
        Some("KHR_texture_basisu")
    } else if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        Some("EXT_texture_webp")
    } else if bytes.starts_with(b"DDS ") {
        Some("MSFT_texture_dds")
    } else if bytes.get(4..12) == Some(b"ftypavif") {
        Some("EXT_texture_avif")
    } else {
        None
    }
}

fn decode(json: &Json<'_>, index: usize, buffers: &Buffers<'_>) -> Result<Decoded, LoadError> {
    let uri = json.get("uri")?;
    let name = match (json.get("name")?, &uri) {
        (Some(name), _) => name.string()?.to_owned(),
        (None, Some(uri)) if !uri.string()?.starts_with("data:") => uri.string()?.to_owned(),
        _ => format!("image {index}"),
    };
    let decode = |bytes: &[u8]| match foreign_format(bytes) {
        Some(extension) => Ok(Decoded::Foreign(extension)),
        None => decode_bytes(json, name, bytes).map(Decoded::Texels),
    };
    match uri {
        Some(uri) => decode(&uri::resolve(&uri, buffers.folder())?.read(&uri)?),
        None => match buffers.view_of(json)? {
            Some(view) => decode(view.bytes),
            None => Err(LoadError::Missing { at: json.at.clone(), key: "uri or bufferView".to_owned() }),
        },
    }
}

fn decode_bytes(json: &Json<'_>, name: String, bytes: &[u8]) -> Result<Image, LoadError> {
    let fail = |reason: String| LoadError::Image { at: json.at.clone(), name: name.clone(), reason };
    // The bytes decide, as mime types in the wild are wrong.
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg)) => format,
        Ok(other) => return Err(fail(format!("it is {other:?}, only PNG and JPEG are read"))),
        Err(_) => return Err(fail("it is neither PNG nor JPEG".to_owned())),
    };
    let reader = || ImageReader::with_format(Cursor::new(bytes), format);
    let message = |error: image::ImageError| fail(super::error::one_line(&error.to_string()));
    let (width, height) = reader().into_dimensions().map_err(message)?;
    check_size(&json.at, width.into(), height.into(), bytes.len())?;
    let mut reader = reader();
    // The size has been checked; 16-bit RGBA takes eight bytes a texel, and decoders need room to work.
    let mut limits = image::Limits::no_limits();
    limits.max_alloc = Some(32 * MAX_TEXELS);
    reader.limits(limits);
    let decoded = reader.decode().map_err(message)?;
    let texels = match decoded {
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => Texels::Rgba16(decoded.into_rgba16().as_chunks::<4>().0.to_vec()),
        _ => Texels::Rgba8(decoded.into_rgba8().as_chunks::<4>().0.to_vec()),
    };
    Ok(Image { name, width, height, texels })
}
