//! `compare` on files whose distance is known.

use serde_json::Value;
use wavecast::film::{self, ToneMap, WriteOptions, srgb_decode};

use super::{Folder, Run, wavecast, write};

const WIDTH: usize = 20;

fn flat(value: f32) -> Vec<[f32; 3]> {
    vec![[value; 3]; WIDTH * 15]
}

fn scene(folder: &Folder, name: &str, rgb: Vec<[f32; 3]>) -> String {
    write(&folder.at(name), WIDTH, rgb, &WriteOptions::default());
    folder.at(name).display().to_string()
}

fn compare(a: &str, b: &str, options: &str) -> Run {
    wavecast(["compare", a, b].into_iter().chain(options.split_whitespace()))
}

fn json(run: Run) -> Value {
    serde_json::from_str(&run.expect(0).stdout).unwrap()
}

#[track_caller]
fn check_near(got: &Value, want: f64, tolerance: f64) {
    let got = got.as_f64().unwrap();
    assert!((got - want).abs() <= tolerance, "got {got}, want {want}");
}

/// 3 against 2 everywhere: MSE 1, RMSE 1, relMSE 1/(4·1.01), at any scale.
#[test]
fn linear_errors_are_those_of_their_formulas() {
    let folder = Folder::new();
    for (a, b) in [("a.exr", "b.exr"), ("a.hdr", "b.hdr"), ("a.exr", "b.hdr")] {
        let (a, b) = (scene(&folder, a, flat(3.0)), scene(&folder, b, flat(2.0)));
        let got = json(compare(&a, &b, "--json"));
        check_near(&got["mse"], 1.0, 1e-9);
        check_near(&got["rmse"], 1.0, 1e-9);
        check_near(&got["relmse"], 1.0 / 4.04, 1e-9);
        check_near(&got["relmse_trimmed"], 1.0 / 4.04, 1e-9);
        assert_eq!(got["flip_kind"], "HDR-FLIP");
        assert_eq!((&got["a"], &got["reference"]), (&a.into(), &b.into()));
    }
}

/// Codes 102 and 153 of 255 are 0.2 apart: PSNR 20·log₁₀ 5 dB; SSIM (2·0.4·0.6 + C₁)/(0.16 + 0.36 + C₁).
#[test]
fn display_errors_are_of_the_stored_codes() {
    let folder = Folder::new();
    let png = |name: &str, code: f32| {
        let options = WriteOptions { tone_map: ToneMap::Srgb, ..WriteOptions::default() };
        write(&folder.at(name), WIDTH, flat(srgb_decode(code)), &options);
        folder.at(name).display().to_string()
    };
    let (a, b) = (png("a.png", 0.4), png("b.png", 0.6));
    let got = json(compare(&a, &b, "--json"));
    check_near(&got["psnr"], 20.0 * 5_f64.log10(), 1e-4);
    check_near(&got["ssim"], (0.48 + 1e-4) / (0.52 + 1e-4), 1e-6);
    let linear = f64::from(srgb_decode(0.6) - srgb_decode(0.4));
    check_near(&got["mse"], linear * linear, 1e-7);
    assert_eq!(got["flip_kind"], "LDR-FLIP");
    assert!(got["flip"].as_f64().unwrap() > 0.05);
}

#[test]
fn equal_pictures_have_no_error_and_the_text_says_which_relmse_is_which() {
    let folder = Folder::new();
    let a = scene(&folder, "a.exr", flat(2.0));
    let run = compare(&a, &a, "--max-relmse 0").expect(0);
    for line in ["mse  ", "rmse  ", "relmse  ", "relmse_trimmed  ", "psnr  ", "ssim  ", "flip  "] {
        assert!(run.stdout.lines().any(|l| l.starts_with(line)), "{line} in {}", run.stdout);
    }
    assert!(run.stdout.contains("all pixels") && run.stdout.contains("worst 0.1 % of pixels left out"));
    let got = json(compare(&a, &a, "--json"));
    check_near(&got["relmse"], 0.0, 0.0);
    check_near(&got["ssim"], 1.0, 1e-9);
    check_near(&got["flip"], 0.0, 0.0);
    assert_eq!(got["psnr"], Value::Null, "JSON has no infinity");
}

#[test]
fn a_bound_that_is_exceeded_is_exit_code_1_with_the_result_still_on_stdout() {
    let folder = Folder::new();
    let (a, b) = (scene(&folder, "a.exr", flat(3.0)), scene(&folder, "b.exr", flat(2.0)));
    compare(&a, &b, "--max-relmse 0.25").expect(0);
    let run = compare(&a, &b, "--max-relmse 0.24 --json").expect(1).says("error: relmse 2.475248e-1 exceeds 2.4");
    assert!(serde_json::from_str::<Value>(&run.stdout).is_ok());
    let mut bad = flat(2.0);
    bad[7][1] = f32::NAN;
    let bad = scene(&folder, "bad.exr", bad);
    compare(&bad, &b, "--max-relmse 1e9").expect(1).says("1 pixels are not finite").says("1 warning");
}

#[test]
fn pictures_that_cannot_be_compared_are_bad_input() {
    let folder = Folder::new();
    let (a, png) = (scene(&folder, "a.exr", flat(2.0)), scene(&folder, "a.png", flat(0.5)));
    let small = scene(&folder, "small.exr", flat(2.0)[..WIDTH * 5].to_vec());
    compare(&a, &small, "").expect(1).says("error: ").says("20 × 15").says("20 × 5");
    compare(&a, &png, "").expect(1).says("light of a display").says("compare two PNGs");
    compare(&a, "missing.exr", "").expect(1).says("missing.exr: cannot read");
    std::fs::write(folder.at("text.png"), "hello").unwrap();
    compare(&png, &folder.at("text.png").display().to_string(), "").expect(1).says("not a readable PNG");
}

#[test]
fn the_difference_is_a_picture_of_the_same_size() {
    let folder = Folder::new();
    let mut off = flat(2.0);
    off[0] = [9.0; 3];
    let (a, b) = (scene(&folder, "a.exr", off), scene(&folder, "b.exr", flat(2.0)));
    for kind in ["flip", "signed"] {
        let diff = folder.at("diff.png");
        let options = format!("--diff {} --diff-kind {kind} --quiet", diff.display());
        compare(&a, &b, &options).expect(0);
        let (picture, _) = film::read(&diff).unwrap();
        assert_eq!((picture.width, picture.height), (20, 15));
        assert_ne!(picture.rgb[0], picture.rgb[299], "{kind}: the wrong pixel shows");
    }
    compare(&a, &b, "--diff diff.exr").expect(2).says("not a .png");
    assert_eq!(folder.names(), ["a.exr", "b.exr", "diff.png"], "nothing is left behind");
}
