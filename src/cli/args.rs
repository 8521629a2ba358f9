//! Values of options and how they are written.

use std::{ops::Range, path::PathBuf, time::Duration};

use clap::ValueEnum;
use wavecast::{
    film::{Exposure, ExpressionError, PathLayer, Split, ToneMap, WriteOptions},
    render::{LayerKind, PixelFilter, SamplerKind},
};

/// Most pixels of a picture: beyond this, f32 columns no longer fit into the memory of most machines.
const MOST_PIXELS: u64 = 1 << 28;

/// How light becomes a display's: shared by all that shows light.
#[derive(clap::Args, Clone, Copy, Debug)]
pub struct DisplayArgs {
    /// Exposure in stops (0: a nit is 1), or `auto` for a log-average of 0.18
    #[arg(long, value_name = "STOPS|auto", value_parser = exposure, allow_hyphen_values = true)]
    pub exposure: Option<Exposure>,
    /// Exposure value at ISO 100: 1.2 · 2^X nit become 1
    #[arg(long, value_name = "X", value_parser = ev100, allow_hyphen_values = true, conflicts_with = "exposure")]
    pub ev100: Option<Exposure>,
    /// Tone curve: neutral, agx, aces, srgb or none [default: neutral]
    #[arg(long, value_name = "CURVE")]
    pub tonemap: Option<ToneMap>,
}

impl DisplayArgs {
    /// With the program's defaults where nothing was said.
    pub fn options(&self, default: Exposure) -> WriteOptions {
        WriteOptions {
            exposure: self.exposure.or(self.ev100).unwrap_or(default),
            tone_map: self.tonemap.unwrap_or_default(),
        }
    }

    /// True if something was said.
    pub fn is_given(&self) -> bool {
        self.exposure.is_some() || self.ev100.is_some() || self.tonemap.is_some()
    }
}

fn exposure(text: &str) -> Result<Exposure, String> {
    if text == "auto" { Ok(Exposure::Auto) } else { finite(text).map(Exposure::Stops) }
}

fn ev100(text: &str) -> Result<Exposure, String> {
    finite(text).map(Exposure::Ev100)
}

/// A number that is one.
pub fn finite(text: &str) -> Result<f32, String> {
    let value: f32 = text.trim().parse().map_err(|_| "expected a number".to_owned())?;
    if value.is_finite() { Ok(value) } else { Err("expected a finite number".into()) }
}

/// A number of at least 0.
pub fn not_negative(text: &str) -> Result<f32, String> {
    finite(text).and_then(|value| if value >= 0.0 { Ok(value) } else { Err("expected a number of at least 0".into()) })
}

/// Width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size(pub [u32; 2]);

/// Such as `1280x720`.
pub fn size(text: &str) -> Result<Size, String> {
    let parse = || {
        let (width, height) = text.split_once(['x', 'X'])?;
        Some([width.trim().parse().ok()?, height.trim().parse().ok()?])
    };
    let size: [u32; 2] = parse().ok_or("expected WIDTHxHEIGHT, such as 1280x720")?;
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    match pixels {
        0 => Err("expected at least one pixel each way".into()),
        1..=MOST_PIXELS => Ok(Size(size)),
        _ => Err(format!("{pixels} pixels are more than the {MOST_PIXELS} that are supported")),
    }
}

/// A part of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop(pub [u32; 4]);

/// Such as `100,50,320,200`: left, top, width, height.
pub fn crop(text: &str) -> Result<Crop, String> {
    let parts: Result<Vec<u32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match parts.ok().and_then(|parts| <[u32; 4]>::try_from(parts).ok()) {
        Some([_, _, 0, _] | [_, _, _, 0]) => Err("expected at least one pixel each way".into()),
        Some(crop) => Ok(Crop(crop)),
        None => Err("expected X,Y,WIDTH,HEIGHT in pixels, such as 100,50,320,200".into()),
    }
}

/// Light from everywhere.
#[derive(Clone, Debug, PartialEq)]
pub enum EnvArg {
    /// The same radiance, nit.
    Constant([f32; 3]),
    /// A lat-long picture.
    File(PathBuf),
}

/// `R,G,B` in nit, or a file.
pub fn env(text: &str) -> Result<EnvArg, String> {
    let parts: Vec<_> = text.split(',').map(|part| part.trim().parse::<f32>()).collect();
    if parts.len() == 3 && parts.iter().all(Result::is_ok) {
        let numbers: Vec<_> = text.split(',').map(not_negative).collect::<Result<_, _>>()?;
        return Ok(EnvArg::Constant([numbers[0], numbers[1], numbers[2]]));
    }
    let path = PathBuf::from(text);
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "hdr" | "exr" => Ok(EnvArg::File(path)),
        _ => Err("expected a .hdr or .exr file, or R,G,B in nit, such as 1,1,1".into()),
    }
}

/// Such as `30s`, `1.5m`, `2h`, `500ms`; a bare number is seconds.
pub fn duration(text: &str) -> Result<Duration, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor = match &text[digits.len()..] {
        "" | "s" => 1.0,
        "ms" => 1e-3,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        unit => return Err(format!("unknown unit {unit:?}; use ms, s, m or h")),
    };
    let seconds: f64 = digits.trim().parse().map_err(|_| "expected a time such as 30s".to_owned())?;
    match Duration::try_from_secs_f64(seconds * factor) {
        Ok(time) if time > Duration::ZERO => Ok(time),
        _ => Err("expected a time above zero, such as 30s".into()),
    }
}

/// Such as `1%` or `0.01`.
pub fn error(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let (number, unit) = text.strip_suffix('%').map_or((text, 1.0), |number| (number.trim_end(), 0.01));
    let expected = || "expected an error above 0 and up to 100%, such as 1% or 0.01".to_owned();
    let error = number.parse::<f64>().map_err(|_| expected())? * unit;
    if error > 0.0 && error <= 1.0 { Ok(error) } else { Err(expected()) }
}

/// Such as `16..32`: from the first number up to but not including the second.
pub fn samples(text: &str) -> Result<Range<u32>, String> {
    let parse = || {
        let (first, end) = text.split_once("..")?;
        Some(first.trim().parse().ok()?..end.trim().parse().ok()?)
    };
    let range: Range<u32> = parse().ok_or("expected FIRST..END, such as 0..16")?;
    if range.is_empty() { Err("expected FIRST below END, such as 0..16".into()) } else { Ok(range) }
}

/// `--sampler`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SamplerArg {
    /// Owen-scrambled Sobol
    Sobol,
    /// The same in an order in which neighbouring pixels make up for one another's errors; not with --error
    BlueNoise,
    /// Hashes, for comparison
    Independent,
}

impl From<SamplerArg> for SamplerKind {
    fn from(sampler: SamplerArg) -> Self {
        match sampler {
            SamplerArg::Sobol => Self::Sobol,
            SamplerArg::BlueNoise => Self::BlueNoise,
            SamplerArg::Independent => Self::Independent,
        }
    }
}

/// `--filter`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FilterArg {
    BlackmanHarris,
    Gaussian,
    Box,
}

impl From<FilterArg> for PixelFilter {
    fn from(filter: FilterArg) -> Self {
        match filter {
            FilterArg::BlackmanHarris => Self::BlackmanHarris,
            FilterArg::Gaussian => Self::Gaussian,
            FilterArg::Box => Self::Box,
        }
    }
}

/// `--integrator`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum IntegratorArg {
    /// All light
    Path,
    /// E + KE: straight from lights, with soft shadows
    Direct,
    /// Mirrors and clear glass by recursion, lamps as points: hard shadows, nothing indirect
    Whitted,
    /// Ambient occlusion: how open surfaces lie
    Ao,
}

/// `--lpe NAME=EXPRESSION`.
pub fn path_layer(text: &str) -> Result<PathLayer, String> {
    let Some((name, expression)) = text.split_once('=') else {
        return Err("expected NAME=EXPRESSION, such as caustics=CD<T.>+L".into());
    };
    let name = name.trim();
    if name.is_empty() || !name.chars().all(|c| c.is_alphanumeric() || "-_".contains(c)) {
        return Err("a layer's name is letters, digits, - and _".into());
    }
    let is_taken = LayerArg::value_variants().iter().any(|&layer| value_name(layer) == name);
    if is_taken || ["emission", "indirect", "R", "G", "B", "A"].contains(&name) || name.starts_with("bounce") {
        return Err(format!("{name} is what another layer is called"));
    }
    let expression = expression.parse().map_err(|error: ExpressionError| error.to_string())?;
    Ok(PathLayer { name: name.to_owned(), expression })
}

/// `--layers`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LayerArg {
    /// Share of light that the first surface reflects
    Albedo,
    /// Shading normal of the first surface
    Normal,
    /// Distance to it, m
    Depth,
    /// Where it is, m
    Position,
    /// Its texture coordinates
    Uv,
    /// Row of its instance + 1
    EntityId,
    /// Row of its material + 1
    MaterialId,
    /// Samples taken
    Samples,
    /// Standard error of the pixel, nit
    Error,
    /// Light by the scatterings behind it: bounce00 is E, bounce01 is KE, …; these and all below with the standard error
    /// of each, and they add up to the picture
    Bounces,
    /// Light by the entity that sent it off: light.NAME
    Lights,
    /// E + KE as direct, all else as indirect
    Direct,
    /// By both: light.NAME.bounce00, …
    #[value(name = "lights.bounces")]
    LightsByBounces,
    /// By both: light.NAME.direct and light.NAME.indirect
    #[value(name = "lights.direct")]
    LightsByDirect,
    /// By what the first surface does: emission, diffuse.direct, diffuse.indirect, specular.…, transmission.…
    Lobes,
    /// By both: diffuse.bounce01, …
    #[value(name = "lobes.bounces")]
    LobesByBounces,
}

impl From<LayerArg> for LayerKind {
    fn from(layer: LayerArg) -> Self {
        match layer {
            LayerArg::Albedo => Self::Albedo,
            LayerArg::Normal => Self::Normal,
            LayerArg::Depth => Self::Depth,
            LayerArg::Position => Self::Position,
            LayerArg::Uv => Self::Uv,
            LayerArg::EntityId => Self::EntityId,
            LayerArg::MaterialId => Self::MaterialId,
            LayerArg::Samples => Self::SampleCount,
            LayerArg::Error => Self::Error,
            LayerArg::Bounces => Self::Light(Split::Bounces),
            LayerArg::Lights => Self::Light(Split::Lights),
            LayerArg::Direct => Self::Light(Split::Direct),
            LayerArg::LightsByBounces => Self::Light(Split::LightsByBounces),
            LayerArg::LightsByDirect => Self::Light(Split::LightsByDirect),
            LayerArg::Lobes => Self::Light(Split::Lobes),
            LayerArg::LobesByBounces => Self::Light(Split::LobesByBounces),
        }
    }
}

/// The name of a value on the command line.
pub fn value_name(value: impl ValueEnum) -> String {
    value.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_as_the_help_writes_them() {
        assert_eq!(size("1280x720"), Ok(Size([1280, 720])));
        assert_eq!(crop("1, 2,3,4"), Ok(Crop([1, 2, 3, 4])));
        assert_eq!(samples("0..16"), Ok(0..16));
        assert_eq!(env("1,0.5,0"), Ok(EnvArg::Constant([1.0, 0.5, 0.0])));
        assert_eq!(env("a,b/sky.HDR"), Ok(EnvArg::File("a,b/sky.HDR".into())));
        assert_eq!([error("1%"), error("0.01"), error(" 2.5 %"), error("100%")], [0.01, 0.01, 0.025, 1.0].map(Ok));
        assert_eq!(exposure("-1.5"), Ok(Exposure::Stops(-1.5)));
        assert_eq!(exposure("auto"), Ok(Exposure::Auto));
        for (text, seconds) in [("30s", 30.0), ("500ms", 0.5), ("1.5m", 90.0), ("2h", 7200.0), ("7", 7.0)] {
            assert_eq!(duration(text), Ok(Duration::from_secs_f64(seconds)), "{text}");
        }
    }

    #[test]
    fn bad_values_are_told_what_was_expected() {
        for text in ["", "1280", "0x5", "5x-1", "axb", "99999x99999"] {
            assert!(size(text).is_err(), "{text}");
        }
        for text in ["", "1,2,3", "1,2,0,4", "1,2,3,4,5", "-1,2,3,4"] {
            assert!(crop(text).is_err(), "{text}");
        }
        for text in ["", "5", "5..5", "9..3", "a..b", "-1..3"] {
            assert!(samples(text).is_err(), "{text}");
        }
        for text in ["", "1,2", "-1,0,0", "nan,0,0", "inf,1,1", "sky.png"] {
            assert!(env(text).is_err(), "{text}");
        }
        for text in ["", "s", "0s", "-3s", "5y", "1e400s", "nan"] {
            assert!(duration(text).is_err(), "{text}");
        }
        for text in ["", "%", "0", "-1%", "5", "101%", "nan", "inf%", "1%%"] {
            assert!(error(text).is_err(), "{text}");
        }
        for text in ["", "nan", "inf", "x"] {
            assert!(exposure(text).is_err() && ev100(text).is_err(), "{text}");
        }
    }
}
