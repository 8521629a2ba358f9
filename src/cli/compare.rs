//! `wavecast compare`: how far two pictures are apart.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use wavecast::{
    film::{self, Exposure, Format, Picture, Referred, ToneMap, WriteOptions},
    measure::{
        flip, heat,
        metrics::{self, TRIMMED},
        ssim::ssim,
    },
};

use super::{Outcome, args::DisplayArgs, console::Console, error::CliError};

/// Compare picture A with the reference B: MSE, RMSE, relMSE, PSNR, SSIM, FLIP
///
/// MSE, RMSE and relMSE are of linear light. PSNR and SSIM are of display values in [0, 1]: a PNG's
/// own, or for EXR and HDR those after exposure and tone mapping. FLIP is LDR-FLIP for PNG and
/// HDR-FLIP, the worst over a range of exposures, for EXR and HDR.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  wavecast compare test.exr reference.exr --diff diff.png --max-relmse 1e-3")]
pub struct Args {
    /// The picture under test
    a: PathBuf,
    /// The reference
    b: PathBuf,
    /// Write a picture of the differences
    #[arg(long, value_name = "OUT.png")]
    diff: Option<PathBuf>,
    /// What the picture of the differences shows: FLIP (magma), or (A − B)/(B + mean of B), blue to red for −1 to 1
    #[arg(long, value_name = "KIND", value_enum, default_value_t = DiffKind::Flip)]
    diff_kind: DiffKind,
    /// Exit with code 1 if relmse (the plain one) is above X
    #[arg(long, value_name = "X", value_parser = bound)]
    max_relmse: Option<f64>,
    /// How EXR and HDR are shown for PSNR and SSIM; exposure is auto, by the reference, if not given
    #[command(flatten)]
    display: DisplayArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum DiffKind {
    Flip,
    Signed,
}

/// All numbers, and the map that FLIP is the mean of.
struct Comparison {
    mse: f64,
    relmse: f64,
    relmse_trimmed: f64,
    psnr: f64,
    ssim: Option<f64>,
    flip: f64,
    flip_kind: &'static str,
    flip_map: Vec<f32>,
    shown: String,
    non_finite: [usize; 2],
}

/// Compares, tells, and fails if the pictures are too far apart.
pub fn run(args: &Args, console: &mut Console) -> Result<Outcome, CliError> {
    if let Some(diff) = &args.diff {
        if Format::of(diff)? != Format::Png {
            return Err(CliError::Usage(format!("--diff {} is not a .png", diff.display())));
        }
        film::check_writable(diff)?;
    }
    let (a, a_referred) = film::read(&args.a)?;
    let (b, b_referred) = film::read(&args.b)?;
    let [a_size, b_size] = [&a, &b].map(|picture| [picture.width, picture.height]);
    if a_size != b_size {
        return Err(CliError::Sizes { a: args.a.clone(), a_size, b: args.b.clone(), b_size });
    }
    match (a_referred, b_referred) {
        (Referred::Display, Referred::Scene) => return Err(referred(&args.a, &args.b)),
        (Referred::Scene, Referred::Display) => return Err(referred(&args.b, &args.a)),
        _ => {}
    }
    if b_referred == Referred::Display && args.display.is_given() {
        console.warn("--exposure, --ev100 and --tonemap have no effect: PNG files are exposed already");
    }
    let result = compare(&a, &b, b_referred, &args.display.options(Exposure::Auto));
    for (path, count) in [&args.a, &args.b].into_iter().zip(result.non_finite).filter(|(_, count)| *count > 0) {
        console.warn(format_args!("{}: {count} pixels are not finite", path.display()));
    }
    if let Some(diff) = &args.diff {
        let rgb = match args.diff_kind {
            DiffKind::Flip => result.flip_map.iter().map(|&v| heat::magma(v)).collect(),
            DiffKind::Signed => signed(&a, &b),
        };
        write_codes(diff, &a, rgb)?;
    }
    console.result(&text(args, &result), || to_json(args, &result));
    match args.max_relmse {
        // A relMSE that is not a number is not below any bound.
        Some(allowed) if result.relmse.is_nan() || result.relmse > allowed => {
            Err(CliError::Exceeded { actual: result.relmse, allowed })
        }
        _ => Ok(Outcome::Done),
    }
}

fn bound(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|&bound: &f64| bound >= 0.0).ok_or_else(|| "expected a number of at least 0".into())
}

fn referred(display: &Path, scene: &Path) -> CliError {
    CliError::Referred { display: display.into(), scene: scene.into() }
}

fn compare(a: &Picture, b: &Picture, referred: Referred, options: &WriteOptions) -> Comparison {
    let (tone_map, factor, shown) = match referred {
        Referred::Display => (ToneMap::Srgb, 1.0, "display values as stored".to_owned()),
        Referred::Scene => {
            let factor = options.exposure.factor(b);
            let name = options.tone_map.name();
            (options.tone_map, factor, format!("display values, light × {factor:.4e} through {name}"))
        }
    };
    let display = |picture: &Picture| -> Vec<[f32; 3]> {
        picture.rgb.iter().map(|rgb| tone_map.encode(rgb.map(|c| c * factor))).collect()
    };
    let (da, db) = (display(a), display(b));
    let (flip_kind, flip_map) = match referred {
        Referred::Display => ("LDR-FLIP", flip::ldr_flip(&da, &db, a.width, flip::DEFAULT_PPD)),
        Referred::Scene => ("HDR-FLIP", flip::hdr_flip(&a.rgb, &b.rgb, a.width, flip::DEFAULT_PPD).map),
    };
    Comparison {
        mse: metrics::mse(&a.rgb, &b.rgb),
        relmse: metrics::rel_mse(&a.rgb, &b.rgb),
        relmse_trimmed: metrics::rel_mse_trimmed(&a.rgb, &b.rgb, TRIMMED),
        psnr: metrics::psnr(metrics::mse(&da, &db), 1.0),
        ssim: ssim(&da, &db, a.width),
        flip: flip::mean(&flip_map),
        flip_kind,
        flip_map,
        shown,
        non_finite: [a, b].map(|picture| metrics::non_finite(&picture.rgb)),
    }
}

fn text(args: &Args, c: &Comparison) -> String {
    let ssim = c.ssim.map_or("none: smaller than the window of 11 × 11".into(), |ssim| format!("{ssim:.6}"));
    format!(
        "{} against the reference {}\n\
         mse             {:.6e}  (linear light)\n\
         rmse            {:.6e}  (linear light)\n\
         relmse          {:.6e}  (linear light, all pixels)\n\
         relmse_trimmed  {:.6e}  (linear light, worst 0.1 % of pixels left out)\n\
         psnr            {:.3} dB  ({})\n\
         ssim            {ssim}  (luma of the same)\n\
         flip            {:.6}  ({}, mean)",
        args.a.display(),
        args.b.display(),
        c.mse,
        c.mse.sqrt(),
        c.relmse,
        c.relmse_trimmed,
        c.psnr,
        c.shown,
        c.flip,
        c.flip_kind,
    )
}

/// JSON has no infinity: the PSNR of equal pictures is null.
fn to_json(args: &Args, c: &Comparison) -> Value {
    json!({
        "a": args.a.display().to_string(),
        "reference": args.b.display().to_string(),
        "mse": c.mse,
        "rmse": c.mse.sqrt(),
        "relmse": c.relmse,
        "relmse_trimmed": c.relmse_trimmed,
        "psnr": c.psnr,
        "ssim": c.ssim,
        "flip": c.flip,
        "flip_kind": c.flip_kind,
        "shown": c.shown,
        "non_finite_pixels": { "a": c.non_finite[0], "reference": c.non_finite[1] },
    })
}

/// Differences by sign, relative to the reference's channel and its mean.
fn signed(a: &Picture, b: &Picture) -> Vec<[f32; 3]> {
    let luma = |[r, g, b]: [f32; 3]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
    let mean = b.rgb.iter().map(|&rgb| f64::from(luma(rgb))).sum::<f64>() / b.rgb.len() as f64;
    let error = |(a, b): (&[f32; 3], &[f32; 3])| {
        let (a, b) = (luma(*a), luma(*b));
        if a == b { 0.0 } else { (a - b) / (b + mean as f32) }
    };
    a.rgb.iter().zip(&b.rgb).map(|pair| heat::signed(error(pair))).collect()
}

/// Writes sRGB numbers as they are.
fn write_codes(path: &Path, like: &Picture, codes: Vec<[f32; 3]>) -> Result<(), CliError> {
    let rgb = codes.into_iter().map(|code| code.map(film::srgb_decode)).collect();
    let picture = Picture { width: like.width, height: like.height, rgb, ..Picture::default() };
    Ok(film::write(path, &picture, &WriteOptions { tone_map: ToneMap::Srgb, ..WriteOptions::default() })?)
}
