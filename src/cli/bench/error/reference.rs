//! Converged pictures, made once and kept.
//!
//! A reference is a file named for all that decides the picture that renders converge to, so that it is found again as
//! long as that is so, and by other builds of the program: it is the mean of several pictures, with the standard error of
//! that mean as a layer. More time than it has had continues it.

use std::{
    fs,
    path::Path,
    time::{Duration, Instant},
};

use sha2::{Digest, Sha256};
use wavecast::{
    film::{self, Layer, LayerData, Picture, WriteOptions},
    load::{self, LoadError},
    measure::{
        converged::{Converged, Replicas},
        metrics::TRIMMED,
    },
    render::{RenderSettings, Renderer, SamplerKind},
};

use super::super::{
    Args,
    subject::{Source, Subject},
};
use crate::cli::{
    args::{EnvArg, Size},
    console::Console,
    error::CliError,
};

/// What scenes mean: to be raised when pictures change on purpose, or references would call the change an error.
const MODEL: u32 = 1;
/// Pictures that a reference is made of, about: enough to know its noise to a few percent even where few pixels have most
/// of it.
const REPLICAS: u32 = 8;
/// Fewest pictures, however long one takes.
const FEWEST: u32 = 4;
/// Seeds from here on are those of references; renders that are measured have others.
const SEEDS: u64 = 1 << 63;
/// Name of the layer.
const STANDARD_ERROR: &str = "standard-error";

/// How good a reference is to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effort {
    /// Samples per pixel, in all.
    Samples(u32),
    /// Render time.
    Time(Duration),
}

/// A converged picture and what it took.
pub struct Reference {
    /// The picture with its noise.
    pub converged: Converged,
    /// Samples per pixel of each picture that it is the mean of.
    pub spp_each: u32,
    /// How many those are.
    pub replicas: u32,
    /// Render time of all.
    pub seconds: f64,
    /// Its own relMSE, plain and trimmed.
    pub noise: [f64; 2],
}

impl Reference {
    fn new(converged: Converged, spp_each: u32, replicas: u32, seconds: f64) -> Self {
        let noise = [0.0, TRIMMED].map(|share| converged.noise(share));
        Self { converged, spp_each, replicas, seconds, noise }
    }

    /// Samples per pixel, in all.
    pub fn spp(&self) -> u64 {
        u64::from(self.spp_each) * u64::from(self.replicas)
    }

    fn is_enough(&self, effort: Effort) -> bool {
        is_enough(effort, self.replicas, self.spp_each, self.seconds)
    }
}

fn is_enough(effort: Effort, replicas: u32, spp_each: u32, seconds: f64) -> bool {
    replicas >= FEWEST
        && match effort {
            Effort::Samples(spp) => u64::from(replicas) * u64::from(spp_each) >= spp.into(),
            Effort::Time(time) => seconds >= time.as_secs_f64(),
        }
}

/// A name for the picture that renders of a scene converge to: 16 hexadecimal digits of a hash of the scene with all the
/// files that it is made of, and of the settings that matter. Sampler, seed and threads do not.
pub fn key(source: &Source, args: &Args, Size([width, height]): Size) -> Result<String, CliError> {
    let mut digest = Sha256::new();
    let mut add = |bytes: &[u8]| {
        // So that no two lists of parts run into the same bytes.
        digest.update((bytes.len() as u64).to_le_bytes());
        digest.update(bytes);
    };
    let depth = args.error.max_depth;
    add(format!("model {MODEL}, {width}×{height}, box filter, depth {depth:?}, view {:?}", args.view).as_bytes());
    match source {
        Source::Generated(..) => add(source.to_string().as_bytes()),
        Source::File(path) => {
            for file in load::files(path)? {
                add(&bytes(&file)?);
            }
        }
    }
    match &args.env {
        None => {}
        Some(EnvArg::Constant(radiance)) => add(format!("{radiance:?}").as_bytes()),
        Some(EnvArg::File(path)) => add(&bytes(path)?),
    }
    Ok(digest.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect())
}

fn bytes(path: &Path) -> Result<Vec<u8>, CliError> {
    let failed = |source| LoadError::Read { path: path.to_owned(), at: None, source };
    Ok(fs::read(path).map_err(failed)?)
}

/// The reference from the folder, or a new one, which is put there; if it is not as good as asked for, it is made better.
///
/// `settings` are those of the renders that are to be measured.
pub fn obtain(
    renderer: &Renderer,
    settings: &RenderSettings,
    [name, key]: [&str; 2],
    folder: &Path,
    effort: Effort,
    console: &mut Console,
) -> Result<Reference, CliError> {
    let path = folder.join(format!("{}-{}x{}-{key}.exr", Subject::file_name(name), settings.width, settings.height));
    let known = if path.exists() { Some(read(&path, settings)?) } else { None };
    let known = match known {
        Some(reference) if reference.is_enough(effort) => {
            console.note(format_args!("{name}: the reference is {}", path.display()));
            return Ok(reference);
        }
        known => known,
    };
    fs::create_dir_all(folder).map_err(|source| CliError::Output { path: folder.to_owned(), source })?;
    film::check_writable(&path)?;
    let what = if known.is_some() { "making the reference better" } else { "making a reference" };
    console.note(format_args!("{name}: {what}, {}: {}", told(effort), path.display()));
    let settings = RenderSettings { sampler: SamplerKind::default(), ..settings.clone() };
    let reference = make(renderer, &settings, known, effort);
    let picture = Picture {
        width: settings.width as usize,
        height: settings.height as usize,
        rgb: reference.converged.mean.clone(),
        layers: vec![Layer {
            name: STANDARD_ERROR.into(),
            data: LayerData::Rgb(reference.converged.standard_error.clone()),
        }],
        metadata: vec![
            ("scene".into(), name.into()),
            ("replicas".into(), reference.replicas.to_string()),
            ("spp".into(), reference.spp_each.to_string()),
            ("seconds".into(), reference.seconds.to_string()),
        ],
        ..Picture::default()
    };
    film::write(&path, &picture, &WriteOptions::default())?;
    Ok(reference)
}

fn told(effort: Effort) -> String {
    match effort {
        Effort::Samples(spp) => format!("{spp} samples per pixel"),
        Effort::Time(time) => format!("{:.3} s", time.as_secs_f64()),
    }
}

fn make(renderer: &Renderer, settings: &RenderSettings, known: Option<Reference>, effort: Effort) -> Reference {
    let render = |spp: u32, seed: u64| {
        let start = Instant::now();
        let settings = RenderSettings { spp: Some(spp), seed, ..settings.clone() };
        let rgb = renderer.render(&settings, &()).picture.rgb;
        (rgb, start.elapsed().as_secs_f64())
    };
    let (mut replicas, spp, mut seconds) = match known {
        Some(known) => (Replicas::resume(&known.converged, known.replicas), known.spp_each, known.seconds),
        None => {
            let spp = match effort {
                Effort::Samples(spp) => spp.div_ceil(REPLICAS),
                // A seed that is none of theirs.
                Effort::Time(time) => spp_for(time.as_secs_f64() / f64::from(REPLICAS), |spp| render(spp, SEEDS - 1).1),
            };
            (Replicas::default(), spp, 0.0)
        }
    };
    while !is_enough(effort, replicas.count, spp, seconds) {
        let (rgb, time) = render(spp, SEEDS + u64::from(replicas.count));
        replicas.push(&rgb);
        seconds += time;
    }
    Reference::new(replicas.converged(), spp, replicas.count, seconds)
}

/// The greatest power of two of samples whose render does not take longer; at least 1.
///
/// Powers of two are what the points of the sampler are evenest for.
fn spp_for(seconds: f64, mut time: impl FnMut(u32) -> f64) -> u32 {
    let mut spp = 1;
    loop {
        let fits = seconds / time(spp) * f64::from(spp);
        // From a tenth of it on, what is measured is the samples and no longer the start.
        if f64::from(spp) >= 0.1 * fits || spp >= 1 << 24 {
            return 1 << (fits.clamp(1.0, f64::from(1 << 24)).log2() as u32);
        }
        spp *= 4;
    }
}

fn read(path: &Path, settings: &RenderSettings) -> Result<Reference, CliError> {
    let (picture, _) = film::read(path)?;
    let number = |key: &str| -> Option<f64> {
        let (_, text) = picture.metadata.iter().find(|(name, _)| name == key)?;
        text.parse().ok().filter(|&x: &f64| x > 0.0)
    };
    let same_size = [picture.width, picture.height] == [settings.width, settings.height].map(|n| n as usize);
    let spread = picture.layers.iter().find_map(|layer| match &layer.data {
        LayerData::Rgb(values) if layer.name == STANDARD_ERROR && same_size => Some(values.clone()),
        _ => None,
    });
    match (number("replicas"), number("spp"), number("seconds"), spread) {
        (Some(replicas), Some(spp), Some(seconds), Some(standard_error)) => {
            let converged = Converged { mean: picture.rgb, standard_error };
            Ok(Reference::new(converged, spp as u32, replicas as u32, seconds))
        }
        _ => Err(CliError::NoReference { path: path.to_owned() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A renderer that starts in 10 ms and takes 1 ms a sample.
    #[test]
    fn references_take_powers_of_two_of_samples() {
        let time = |spp: u32| 0.01 + 1e-3 * f64::from(spp);
        for (seconds, want) in [(1e-4, 1), (0.1, 8), (1.0, 512), (60.0, 32_768)] {
            assert_eq!(spp_for(seconds, time), want, "{seconds}");
        }
        assert_eq!(spp_for(1.0, |_| 0.0), 1 << 24, "no time at all");
    }
}
