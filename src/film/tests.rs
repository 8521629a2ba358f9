//! Round trips through files.

use std::path::Path;

use super::*;

const SIZE: (usize, usize) = (5, 3);

/// Every kind of layer, light over many decades, and text that Latin-1 does not have.
fn sample() -> Picture {
    let (width, height) = SIZE;
    let pixels = width * height;
    let rgb: Vec<[f32; 3]> =
        (0..pixels).map(|i| [(i as f32 - 7.0).exp2(), i as f32 * 0.1, 1e4 / (i + 1) as f32]).collect();
    let layer = |name: &str, data| Layer { name: name.into(), data };
    Picture {
        width,
        height,
        rgb: rgb.clone(),
        alpha: Some((0..pixels).map(|i| i as f32 / (pixels - 1) as f32).collect()),
        layers: vec![
            layer("normal", LayerData::Xyz(rgb.iter().map(|v| v.map(|c| -c)).collect())),
            layer("albedo", LayerData::Rgb(rgb)),
            layer("depth", LayerData::Scalar((0..pixels).map(|i| if i == 0 { f32::INFINITY } else { 0.5 }).collect())),
            layer("uv", LayerData::Uv((0..pixels).map(|i| [i as f32, 0.25]).collect())),
            layer("entity-id", LayerData::Id((0..pixels).map(|i| u32::MAX - i as u32).collect())),
            layer("light.Lampe.001 ö", LayerData::Rgb(vec![[1.0, 2.0, 3.0]; pixels])),
        ],
        metadata: vec![("scene".into(), "Straße/東京.glb".into()), ("seed".into(), "42".into())],
    }
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[track_caller]
fn check_metadata(read: &Picture) {
    for pair in &sample().metadata {
        assert!(read.metadata.contains(pair), "{pair:?} is not in {:?}", read.metadata);
    }
    let software = format!("wavecast {}", env!("CARGO_PKG_VERSION"));
    assert!(read.metadata.iter().any(|(_, value)| *value == software), "no version in {:?}", read.metadata);
}

#[test]
fn exr_gives_every_bit_back_with_layers_in_their_order() {
    let folder = folder();
    let path = folder.path().join("a.exr");
    write(&path, &sample(), &WriteOptions::default()).unwrap();
    let (back, referred) = read(&path).unwrap();
    assert_eq!(referred, Referred::Scene);
    check_metadata(&back);
    assert_eq!(Picture { metadata: sample().metadata, ..back }, sample());
    assert_eq!(names(folder.path()), ["a.exr"], "the temporary file is gone");
}

/// The contract: `<layer>.R/G/B` for all float layers, in one part, lines from the top.
#[test]
fn exr_channels_are_named_as_promised() {
    let folder = folder();
    let path = folder.path().join("a.exr");
    write(&path, &sample(), &WriteOptions::default()).unwrap();
    let meta = ::exr::meta::MetaData::read_from_file(&path, true).unwrap();
    assert_eq!(meta.headers.len(), 1);
    assert_eq!(meta.headers[0].line_order, ::exr::meta::attribute::LineOrder::Increasing);
    let channels: Vec<_> = meta.headers[0].channels.list.iter().map(|c| c.name.as_slice().to_vec()).collect();
    let has = |name: &str| channels.iter().any(|c| c == name.as_bytes());
    for layer in ["", "normal.", "albedo.", "depth.", "uv.", "light.Lampe.001 ö."] {
        for letter in ["R", "G", "B"] {
            assert!(has(&format!("{layer}{letter}")), "{layer}{letter}");
        }
    }
    assert!(has("A") && has("entity-id.Y"));
}

/// The shared exponent leaves eight bits to the brightest channel: an error of at most 1/256 of it.
#[test]
fn hdr_keeps_light_to_one_part_in_256() {
    let folder = folder();
    let path = folder.path().join("a.hdr");
    write(&path, &sample(), &WriteOptions::default()).unwrap();
    let (back, referred) = read(&path).unwrap();
    assert_eq!(referred, Referred::Scene);
    check_metadata(&back);
    for (got, want) in back.rgb.iter().zip(&sample().rgb) {
        let peak = want.iter().copied().fold(0.0, f32::max);
        for c in 0..3 {
            assert!((got[c] - want[c]).abs() <= peak / 127.0, "{got:?} {want:?}");
        }
    }
}

/// With plain sRGB, what comes back is the light divided by and multiplied with its coverage:
/// within half a step of the code, whose slope in light is at most 2.3 (at white).
#[test]
fn png_keeps_clipped_light_to_half_a_step_of_its_code() {
    let folder = folder();
    let path = folder.path().join("a.png");
    let options = WriteOptions { exposure: Exposure::Stops(-2.0), tone_map: ToneMap::Srgb };
    write(&path, &sample(), &options).unwrap();
    let (back, referred) = read(&path).unwrap();
    assert_eq!(referred, Referred::Display);
    check_metadata(&back);
    let (alpha, want_alpha) = (back.alpha.unwrap(), sample().alpha.unwrap());
    for i in 0..back.rgb.len() {
        assert!((alpha[i] - want_alpha[i]).abs() <= 0.501 / 255.0);
        if want_alpha[i] == 0.0 {
            continue;
        }
        for c in 0..3 {
            let want = (sample().rgb[i][c] / 4.0 / want_alpha[i]).min(1.0) * want_alpha[i];
            assert!((back.rgb[i][c] - want).abs() <= 2.0 * 2.3 / 255.0, "{} {want}", back.rgb[i][c]);
        }
    }
}

/// 8-bit codes 0, 1, … survive the way through linear light; linear PNGs say gamma 1 and come back as they were.
#[test]
fn png_codes_are_those_of_the_transfer_function() {
    let folder = folder();
    let path = folder.path().join("a.png");
    let rgb: Vec<_> = (0..=255).map(|i| [srgb_decode(i as f32 / 255.0); 3]).collect();
    let picture = Picture { width: 256, height: 1, rgb, ..Picture::default() };
    for tone_map in [ToneMap::Srgb, ToneMap::None] {
        write(&path, &picture, &WriteOptions { tone_map, ..WriteOptions::default() }).unwrap();
        let (back, _) = read(&path).unwrap();
        let tolerance = if tone_map == ToneMap::Srgb { 1e-6 } else { 0.51 / 255.0 };
        for (got, want) in back.rgb.iter().zip(&picture.rgb) {
            assert!((got[1] - want[1]).abs() < tolerance, "{got:?} {want:?}");
        }
    }
}

#[test]
fn what_cannot_be_written_is_an_error_with_the_path_and_leaves_nothing() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("folder.png")).unwrap();
    let error = |path: &Path, picture: &Picture| {
        let error = write(path, picture, &WriteOptions::default()).unwrap_err().to_string();
        assert!(error.starts_with(&path.display().to_string()), "{error}");
        error
    };
    assert!(error(&at("a.tga"), &sample()).contains(".exr, .png or .hdr"));
    assert!(error(&at("none/a.exr"), &sample()).contains("no folder"));
    assert!(error(&at("folder.png"), &sample()).contains("is a folder"));
    assert!(error(&at("a.exr"), &Picture::default()).contains("no pixels"));
    let short = Picture { alpha: Some(vec![1.0]), ..sample() };
    assert!(error(&at("a.exr"), &short).contains("alpha has 1 values, the picture 15 pixels"));
    let twice = Picture { layers: [sample().layers, sample().layers].concat(), ..sample() };
    assert!(error(&at("a.exr"), &twice).contains("two layers"));
    assert!(check_writable(&at("none/a.exr")).is_err());
    assert!(check_writable(&at("folder.png")).is_err());
    assert!(check_writable(&at("fine.exr")).is_ok());
    let failed = write_file(&at("half.png"), |_| Err(std::io::Error::other("disc full")));
    assert!(matches!(failed, Err(FilmError::Write { .. })));
    assert_eq!(names(folder.path()), ["folder.png"], "nothing else is left");
}

#[test]
fn a_written_file_replaces_the_old_one_and_can_be_read_by_others() {
    let folder = folder();
    let path = folder.path().join("a.png");
    std::fs::write(&path, "old").unwrap();
    write(&path, &sample(), &WriteOptions::default()).unwrap();
    assert!(read(&path).is_ok());
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let ordinary = folder.path().join("ordinary");
        std::fs::write(&ordinary, "").unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&path), mode(&ordinary));
    }
}

#[test]
fn what_is_no_picture_is_an_error_not_a_panic() {
    let folder = folder();
    for name in ["a.exr", "a.png", "a.hdr"] {
        let path = folder.path().join(name);
        assert!(matches!(read(&path), Err(FilmError::Read { .. })), "{name} is missing");
        std::fs::write(&path, b"not a picture").unwrap();
        assert!(matches!(read(&path), Err(FilmError::Decode { .. })), "{name} is text");
        write(&path, &sample(), &WriteOptions::default()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for length in (0..whole.len()).step_by(7) {
            std::fs::write(&path, &whole[..length]).unwrap();
            let _ = read(&path);
        }
    }
}
