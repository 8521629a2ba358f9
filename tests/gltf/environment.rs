//! Environment maps.

use std::{fs, panic::catch_unwind};

use wavecast::load::load_environment;

fn hdr(width: usize, height: usize, texels: &[[f32; 3]]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let texels: Vec<_> = texels.iter().map(|&t| image::Rgb(t)).collect();
    image::codecs::hdr::HdrEncoder::new(&mut bytes).encode(&texels, width, height).unwrap();
    bytes
}

fn exr(width: usize, texels: &[[f32; 3]]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.exr");
    exr::prelude::write_rgb_file(&path, width, texels.len() / width, |x, y| texels[y * width + x].into()).unwrap();
    fs::read(path).unwrap()
}

fn load_bytes(bytes: &[u8]) -> Result<(wavecast::world::EnvironmentMap, Vec<String>), String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky");
    fs::write(&path, bytes).unwrap();
    let (map, warnings) = load_environment(&path).map_err(|error| error.to_string())?;
    Ok((map, warnings.iter().map(ToString::to_string).collect()))
}

/// Powers of two survive the eight-bit mantissa of Radiance's format.
const SKY: [[f32; 3]; 4] = [[1.0, 2.0, 4.0], [0.5, 0.5, 0.25], [0.0, 0.0, 0.0], [64.0, 128.0, 128.0]];

#[test]
fn both_formats_give_their_texels_from_the_top() {
    for bytes in [hdr(2, 2, &SKY), exr(2, &SKY)] {
        let (map, warnings) = load_bytes(&bytes).unwrap();
        assert_eq!((map.width, map.height, map.name.as_str()), (2, 2, "sky"));
        assert_eq!(map.texels, SKY);
        assert!(warnings.is_empty());
    }
}

#[test]
fn negative_texels_become_zero_and_those_without_a_number_are_refused() {
    let mut sky = SKY;
    sky[1][2] = -0.5;
    let (map, warnings) = load_bytes(&exr(2, &sky)).unwrap();
    assert_eq!(map.texels[1], [0.5, 0.5, 0.0]);
    assert!(warnings.len() == 1 && warnings[0].contains("1 texels are negative"), "{warnings:?}");
    for bad in [f32::NAN, f32::INFINITY] {
        sky[2][0] = bad;
        let message = load_bytes(&exr(2, &sky)).unwrap_err();
        assert!(message.contains("expected finite texels") && message.contains("column 0, row 1"), "{message}");
    }
}

#[test]
fn absurd_sizes_are_refused() {
    let text = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 30000 +X 30000\n";
    let message = load_bytes(text).unwrap_err();
    assert!(message.contains("900000000 texels"), "{message}");
}

/// Every prefix and every byte flipped, of both formats: an error of one line or a map without NaN.
#[test]
fn broken_environments_never_panic() {
    let (mut errors, mut maps) = (0, 0);
    for good in [hdr(2, 2, &SKY), exr(2, &SKY)] {
        let prefixes = (0..good.len()).map(|length| good[..length].to_vec());
        let flips = (0..good.len()).map(|i| {
            let mut bytes = good.clone();
            bytes[i] ^= 0x81;
            bytes
        });
        for bytes in prefixes.chain(flips) {
            match catch_unwind(|| load_bytes(&bytes)).expect("loading must not panic") {
                Ok((map, _)) => {
                    assert!(map.texels.iter().flatten().all(|x| x.is_finite() && *x >= 0.0));
                    maps += 1;
                }
                Err(message) => {
                    assert_eq!(message.lines().count(), 1, "{message}");
                    errors += 1;
                }
            }
        }
    }
    println!("{errors} errors and {maps} maps from broken environments");
    assert!(errors > 300);
}
