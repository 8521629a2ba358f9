//! PNG: eight bits, display-referred, settings in text chunks.
//!
//! Pixels are exposed, tone-mapped and sRGB-encoded (an sRGB chunk says so; with
//! [`ToneMap::None`] a gAMA chunk says 1). Light in a [`Picture`] is already
//! multiplied by its coverage, a PNG's is not, so alpha is divided out before the curve.

use std::io::{self, BufRead, Seek, Write};

use super::{Picture, Referred, ToneMap, WriteOptions, metadata, tonemap};

/// Gamma 1, in the chunk's units.
const LINEAR_GAMMA: u32 = 100_000;

/// Writes the beauty picture and its alpha; layers have no place here.
pub(super) fn encode(to: &mut impl Write, picture: &Picture, options: &WriteOptions) -> io::Result<()> {
    let mut encoder = png::Encoder::new(to, side(picture.width)?, side(picture.height)?);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_color(if picture.alpha.is_some() { png::ColorType::Rgba } else { png::ColorType::Rgb });
    if options.tone_map == ToneMap::None {
        encoder.set_source_gamma(png::ScaledFloat::from_scaled(LINEAR_GAMMA));
    } else {
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    }
    let factor = options.exposure.factor(picture);
    add_text(&mut encoder, "Software", metadata::SOFTWARE)?;
    let exposure = format!("{factor}");
    let own = [("exposure-factor", exposure.as_str()), ("tonemap", options.tone_map.name())];
    let given = picture.metadata.iter().map(|(key, value)| (key.as_str(), value.as_str()));
    for (key, value) in given.chain(own) {
        add_text(&mut encoder, &metadata::to_file(key), value)?;
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&pixels(picture, factor, options.tone_map))?;
    writer.finish()?;
    Ok(())
}

fn side(pixels: usize) -> io::Result<u32> {
    u32::try_from(pixels).map_err(|_| io::Error::other("too large for a PNG"))
}

/// tEXt where Latin-1 has the characters, iTXt where not.
fn add_text<W: Write>(encoder: &mut png::Encoder<'_, W>, key: &str, value: &str) -> io::Result<()> {
    // The format allows 79 Latin-1 characters.
    let key: String = key.chars().map(|c| if c.is_ascii_graphic() { c } else { '_' }).take(79).collect();
    if value.chars().all(|c| u32::from(c) < 256 && c != '\0') {
        encoder.add_text_chunk(key, value.into())?;
    } else {
        encoder.add_itxt_chunk(key, value.replace('\0', " "))?;
    }
    Ok(())
}

fn pixels(picture: &Picture, factor: f32, tone_map: ToneMap) -> Vec<u8> {
    let byte = |v: f32| (v * 255.0).round() as u8;
    match &picture.alpha {
        None => picture.rgb.iter().flat_map(|rgb| tone_map.encode(rgb.map(|c| c * factor)).map(byte)).collect(),
        Some(alpha) => picture
            .rgb
            .iter()
            .zip(alpha)
            .flat_map(|(rgb, &alpha)| {
                let cover = alpha.clamp(0.0, 1.0);
                let scale = if cover > 0.0 { factor / cover } else { 0.0 };
                let [r, g, b] = tone_map.encode(rgb.map(|c| c * scale)).map(byte);
                [r, g, b, byte(cover)]
            })
            .collect(),
    }
}

/// Reads any PNG as display light: stored values are decoded to linear and multiplied by alpha.
pub(super) fn decode(from: impl BufRead + Seek) -> Result<(Picture, Referred), String> {
    let mut decoder = png::Decoder::new(from);
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(|e| e.to_string())?;
    let bytes = reader.output_buffer_size().ok_or("too large for memory")?;
    let mut buffer = vec![0; bytes];
    let frame = reader.next_frame(&mut buffer).map_err(|e| e.to_string())?;
    reader.finish().map_err(|e| e.to_string())?;
    let info = reader.info();
    let linear = info.srgb.is_none() && info.gamma().is_some_and(|gamma| gamma.into_scaled() == LINEAR_GAMMA);
    let stored: Vec<f32> = match frame.bit_depth {
        png::BitDepth::Sixteen => {
            let (values, _) = buffer[..frame.buffer_size()].as_chunks::<2>();
            values.iter().map(|&b| f32::from(u16::from_be_bytes(b)) / 65535.0).collect()
        }
        _ => buffer[..frame.buffer_size()].iter().map(|&b| f32::from(b) / 255.0).collect(),
    };
    let channels = frame.color_type.samples();
    let light = |v: f32| if linear { v } else { tonemap::srgb_decode(v) };
    let has_alpha = matches!(channels, 2 | 4);
    let mut picture = Picture {
        width: frame.width as usize,
        height: frame.height as usize,
        alpha: has_alpha.then(Vec::new),
        metadata: text_of(info),
        ..Picture::default()
    };
    for pixel in stored.chunks_exact(channels) {
        let rgb = if channels < 3 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] };
        let cover = if has_alpha { pixel[channels - 1] } else { 1.0 };
        picture.rgb.push(rgb.map(|v| light(v) * cover));
        if let Some(alpha) = &mut picture.alpha {
            alpha.push(cover);
        }
    }
    Ok((picture, Referred::Display))
}

fn text_of(info: &png::Info<'_>) -> Vec<(String, String)> {
    let latin = info.uncompressed_latin1_text.iter().map(|chunk| (chunk.keyword.clone(), chunk.text.clone()));
    let international = info.utf8_text.iter().filter_map(|chunk| Some((chunk.keyword.clone(), chunk.get_text().ok()?)));
    latin.chain(international).map(|(key, value)| (metadata::from_file(&key), value)).collect()
}
