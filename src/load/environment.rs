//! Environment maps: Radiance `.hdr` and OpenEXR.

use std::{ffi::OsStr, io::Cursor, path::Path};

use exr::prelude::{ReadChannels, ReadLayers};
use image::{ImageDecoder, codecs::hdr::HdrDecoder};

use super::{
    container::read_file,
    error::{LoadError, Place, Warning, Warnings, one_line},
    images::check_size,
};
use crate::world::EnvironmentMap;

/// First bytes of an OpenEXR file.
const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// Reads a latitude–longitude picture of the sky, nit, from a `.hdr` or `.exr` file.
///
/// Negative texels, which filters leave behind, are taken as zero with a warning.
///
/// # Errors
/// If the file cannot be read, has an absurd size, or a texel is not finite.
pub fn load_environment(path: &Path) -> Result<(EnvironmentMap, Vec<Warning>), LoadError> {
    let bytes = read_file(path, None)?;
    let at = Place::file(path);
    let (width, height, mut texels) =
        if bytes.starts_with(&EXR_MAGIC) { read_exr(&bytes, &at)? } else { read_hdr(&bytes, &at)? };
    if let Some(row) = texels.iter().flatten().position(|x| !x.is_finite()) {
        let (x, y) = (row / 3 % width as usize, row / 3 / width as usize);
        let (expected, found) = ("finite texels".to_owned(), format!("{:?} at column {x}, row {y}", texels[row / 3]));
        return Err(LoadError::Value { at, expected, found });
    }
    let mut warnings = Warnings::default();
    let negative = texels.iter().filter(|texel| texel.iter().any(|&x| x < 0.0)).count();
    if negative > 0 {
        texels.iter_mut().flatten().for_each(|x| *x = x.max(0.0));
        warnings.push(&at, format!("{negative} texels are negative, taken as zero"));
    }
    let name = path.file_name().unwrap_or(OsStr::new("environment")).to_string_lossy().into_owned();
    Ok((EnvironmentMap { name, width, height, texels }, warnings.list))
}

type Pixels = (u32, u32, Vec<[f32; 3]>);

fn read_hdr(bytes: &[u8], at: &Place) -> Result<Pixels, LoadError> {
    let fail = |error: image::ImageError| LoadError::Syntax {
        at: at.clone(),
        reason: format!("neither a Radiance nor an OpenEXR picture: {}", one_line(&error.to_string())),
    };
    let decoder = HdrDecoder::new(Cursor::new(bytes)).map_err(fail)?;
    let (width, height) = decoder.dimensions();
    check_size(at, width.into(), height.into(), bytes.len())?;
    let picture = image::DynamicImage::from_decoder(decoder).map_err(fail)?.into_rgb32f();
    Ok((width, height, picture.as_chunks::<3>().0.to_vec()))
}

fn read_exr(bytes: &[u8], at: &Place) -> Result<Pixels, LoadError> {
    let fail = |error: exr::error::Error| LoadError::Syntax {
        at: at.clone(),
        reason: format!("not an RGB OpenEXR picture: {}", one_line(&error.to_string())),
    };
    let header = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), true).map_err(fail)?;
    for part in &header.headers {
        check_size(at, part.layer_size.width() as u64, part.layer_size.height() as u64, bytes.len())?;
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size, _| (size.width(), vec![[0.0f32; 3]; size.area()]),
            |(width, texels), position, (r, g, b): (f32, f32, f32)| {
                texels[position.y() * *width + position.x()] = [r, g, b];
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(fail)?;
    let size = image.layer_data.size;
    Ok((size.width() as u32, size.height() as u32, image.layer_data.channel_data.pixels.1))
}
