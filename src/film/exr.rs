//! OpenEXR: scene-linear radiance in nit, 32-bit float, all layers in one part.
//!
//! The beauty picture is `R`, `G`, `B` and, where asked for, `A`, with light multiplied by
//! coverage as the format has it. A layer is `<layer>.R/G/B`, so that every reader shows
//! it: one number per pixel is written three times, texture coordinates have a B of 0. Ids and
//! counts are one channel of unsigned integers, `<layer>.Y`. An attribute `wavecast.layers`
//! lists the layers in the order they were asked for, with their kinds. `whiteLuminance` is 1:
//! one nit.

use std::io::{self, BufRead, Seek, Write};

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer as Part, LayerAttributes, ReadChannels, ReadLayers,
    Text, Vec2, WritableImage,
    attribute::{AttributeValue, Chromaticities, LineOrder},
};
use serde_json::{Value, json};

use super::{Layer, LayerData, Picture, Referred, metadata};

/// Attribute that lists the layers with their kinds.
const LAYERS: &str = "layers";

/// Writes everything that the picture has.
pub(super) fn encode(to: &mut (impl Write + Seek), picture: &Picture) -> io::Result<()> {
    let mut channels = Vec::new();
    rgb_channels(&mut channels, "", &picture.rgb);
    if let Some(alpha) = &picture.alpha {
        channels.push(channel("A", FlatSamples::F32(alpha.clone())));
    }
    for layer in &picture.layers {
        let prefix = format!("{}.", layer.name);
        match &layer.data {
            LayerData::Scalar(values) => {
                let rgb: Vec<_> = values.iter().map(|&v| [v; 3]).collect();
                rgb_channels(&mut channels, &prefix, &rgb);
            }
            LayerData::Uv(values) => {
                let rgb: Vec<_> = values.iter().map(|&[u, v]| [u, v, 0.0]).collect();
                rgb_channels(&mut channels, &prefix, &rgb);
            }
            LayerData::Rgb(values) | LayerData::Xyz(values) => rgb_channels(&mut channels, &prefix, values),
            LayerData::Id(values) => channels.push(channel(&format!("{prefix}Y"), FlatSamples::U32(values.clone()))),
        }
    }
    let encoding = Encoding { line_order: LineOrder::Increasing, ..Encoding::SMALL_LOSSLESS };
    let encoding = Encoding { compression: exr::compression::Compression::ZIP16, ..encoding };
    let part = Part::new(
        (picture.width, picture.height),
        attributes(picture),
        encoding,
        AnyChannels::sort(channels.into_iter().collect()),
    );
    let mut image = Image::from_layer(part);
    image.attributes.chromaticities = Some(Chromaticities {
        red: Vec2(0.64, 0.33),
        green: Vec2(0.30, 0.60),
        blue: Vec2(0.15, 0.06),
        white: Vec2(0.3127, 0.3290),
    });
    image.write().to_buffered(to).map_err(|error| match error {
        exr::error::Error::Io(error) => error,
        error => io::Error::other(error.to_string()),
    })
}

fn attributes(picture: &Picture) -> LayerAttributes {
    let kinds: Vec<_> = picture.layers.iter().map(|layer| json!([layer.name, kind_name(&layer.data)])).collect();
    let layers = (metadata::to_file(LAYERS), Value::from(kinds).to_string());
    let given = picture.metadata.iter().map(|(key, value)| (metadata::to_file(key), value.clone()));
    LayerAttributes {
        software_name: Some(text(metadata::SOFTWARE)),
        white_luminance: Some(1.0),
        other: given.chain([layers]).map(|(key, value)| (text(&key), AttributeValue::Text(text(&value)))).collect(),
        ..LayerAttributes::default()
    }
}

/// UTF-8, as the format's documentation recommends; the crate's own conversion knows only Latin-1.
fn text(value: &str) -> Text {
    Text::from_slice_unchecked(value.as_bytes())
}

fn channel(name: &str, samples: FlatSamples) -> AnyChannel<FlatSamples> {
    AnyChannel::new(text(name), samples)
}

fn rgb_channels(channels: &mut Vec<AnyChannel<FlatSamples>>, prefix: &str, rgb: &[[f32; 3]]) {
    for (c, letter) in ["R", "G", "B"].iter().enumerate() {
        let values = rgb.iter().map(|v| v[c]).collect();
        channels.push(channel(&format!("{prefix}{letter}"), FlatSamples::F32(values)));
    }
}

fn kind_name(data: &LayerData) -> &'static str {
    match data {
        LayerData::Scalar(_) => "scalar",
        LayerData::Uv(_) => "uv",
        LayerData::Rgb(_) => "rgb",
        LayerData::Xyz(_) => "xyz",
        LayerData::Id(_) => "id",
    }
}

/// Channels of one layer, by the part of their names after the last dot.
struct Group {
    name: String,
    channels: Vec<(String, FlatSamples)>,
}

/// Reads the first part that has a picture, with all its layers; its size is that of the data window.
pub(super) fn decode(from: impl BufRead + Seek) -> Result<(Picture, Referred), String> {
    let file = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(from)
        .map_err(|e| e.to_string())?;
    for part in file.layer_data {
        let Vec2(width, height) = part.size;
        if let Some(list) = part.channel_data.list.iter().find(|c| c.sampling != Vec2(1, 1)) {
            return Err(format!("channel {} has fewer samples than pixels, which is not supported", list.name));
        }
        let kinds = layer_kinds(&part.attributes);
        let mut groups = grouped(part.channel_data.list.into_iter().map(|c| (name_of(&c.name), c.sample_data)));
        let Some(mut beauty) = groups.iter().position(|g| g.name.is_empty()).map(|i| groups.remove(i)) else {
            continue;
        };
        let Some(rgb) = beauty.take_rgb() else { continue };
        let mut layers: Vec<_> = groups.into_iter().filter_map(|group| group.into_layer(&kinds)).collect();
        layers.sort_by_key(|layer| kinds.iter().position(|(name, _)| *name == layer.name));
        let picture = Picture {
            width,
            height,
            rgb,
            alpha: beauty.take("A").map(|samples| samples.values_as_f32().collect()),
            layers,
            metadata: metadata_of(&part.attributes),
        };
        return Ok((picture, Referred::Scene));
    }
    Err("it has neither channels R, G, B nor Y".into())
}

fn name_of(text: &Text) -> String {
    String::from_utf8_lossy(text.as_slice()).into_owned()
}

fn grouped(channels: impl Iterator<Item = (String, FlatSamples)>) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for (name, samples) in channels {
        let (layer, letter) = name.rsplit_once('.').unwrap_or(("", &name));
        match groups.iter_mut().find(|g| g.name == layer) {
            Some(group) => group.channels.push((letter.into(), samples)),
            None => groups.push(Group { name: layer.into(), channels: vec![(letter.into(), samples)] }),
        }
    }
    groups
}

impl Group {
    fn take(&mut self, letter: &str) -> Option<FlatSamples> {
        let at = self.channels.iter().position(|(l, _)| l == letter)?;
        Some(self.channels.remove(at).1)
    }

    fn take_three(&mut self, letters: [&str; 3]) -> Option<Vec<[f32; 3]>> {
        if !letters.iter().all(|letter| self.channels.iter().any(|(l, _)| l == letter)) {
            return None;
        }
        let [x, y, z] = letters.map(|letter| self.take(letter));
        let (x, y, z) = (x?, y?, z?);
        Some(x.values_as_f32().zip(y.values_as_f32()).zip(z.values_as_f32()).map(|((x, y), z)| [x, y, z]).collect())
    }

    /// R, G and B, or grey from Y alone.
    fn take_rgb(&mut self) -> Option<Vec<[f32; 3]>> {
        self.take_three(["R", "G", "B"])
            .or_else(|| self.take("Y").map(|samples| samples.values_as_f32().map(|v| [v; 3]).collect()))
    }

    /// By the kind on record, else by the letters.
    fn into_layer(mut self, kinds: &[(String, String)]) -> Option<Layer> {
        let kind = kinds.iter().find(|(name, _)| *name == self.name).map(|(_, kind)| kind.as_str());
        let data = match self.take_three(["R", "G", "B"]) {
            Some(rgb) => match kind {
                Some("scalar") => LayerData::Scalar(rgb.iter().map(|v| v[0]).collect()),
                Some("uv") => LayerData::Uv(rgb.iter().map(|v| [v[0], v[1]]).collect()),
                Some("xyz") => LayerData::Xyz(rgb),
                _ => LayerData::Rgb(rgb),
            },
            None => match self.take_three(["X", "Y", "Z"]) {
                Some(xyz) => LayerData::Xyz(xyz),
                None => match self.channels.pop()?.1 {
                    FlatSamples::U32(values) => LayerData::Id(values),
                    samples => LayerData::Scalar(samples.values_as_f32().collect()),
                },
            },
        };
        Some(Layer { name: self.name, data })
    }
}

/// Names and kinds of the layers, if the file is one of ours.
fn layer_kinds(attributes: &LayerAttributes) -> Vec<(String, String)> {
    let Some(AttributeValue::Text(list)) = attributes.other.get(metadata::to_file(LAYERS).as_bytes()) else {
        return Vec::new();
    };
    serde_json::from_slice::<Vec<(String, String)>>(list.as_slice()).unwrap_or_default()
}

/// Text attributes in order of their names, which is the only one that the format keeps.
fn metadata_of(attributes: &LayerAttributes) -> Vec<(String, String)> {
    let mut found: Vec<_> = attributes
        .other
        .iter()
        .filter_map(|(key, value)| match value {
            AttributeValue::Text(value) => Some((metadata::from_file(&name_of(key)), name_of(value))),
            _ => None,
        })
        .filter(|(key, _)| key != LAYERS)
        .collect();
    found.extend(attributes.software_name.as_ref().map(|name| ("Software".into(), name_of(name))));
    found.sort();
    found
}
