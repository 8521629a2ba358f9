//! SSIM, PSNR and FLIP held to the published programs' numbers.
//!
//! The pair of pictures is made by arithmetic on integers, so that Rust and Python make the same.
//! Numbers are from scikit-image 0.26.0 (numpy 2.4.6) and NVIDIA's flip-evaluator 1.7, by
//!
//! ```python
//! import numpy as np, flip_evaluator as flip
//! from skimage.metrics import structural_similarity, peak_signal_noise_ratio
//! W, H = 48, 40
//! def h(x, y, c):
//!     n = (x * 374761393 + y * 668265263 + c * 2246822519 + 3266489917) & 0xFFFFFFFF
//!     n = ((n ^ (n >> 13)) * 1274126177) & 0xFFFFFFFF
//!     return (n ^ (n >> 16)) & 0xFF
//! ref = np.zeros((H, W, 3), np.uint8); test = ref.copy()
//! for y in range(H):
//!     for x in range(W):
//!         for c in range(3):
//!             base = (x * 5 + y * 3 + c * 40) % 256
//!             if (x // 8 + y // 8) % 2: base = 255 - base
//!             ref[y, x, c] = base
//!             t = base + (h(x, y, c) - 128) // 8 + (20 if x > 30 and y < 15 else 0)
//!             test[y, x, c] = min(255, max(0, t))
//! R, T = ref / 255, test / 255
//! luma = lambda v: v @ np.array([0.2126, 0.7152, 0.0722])
//! print(ref.sum(), test.sum(), peak_signal_noise_ratio(R, T, data_range=1))
//! print(structural_similarity(luma(R), luma(T), gaussian_weights=True, sigma=1.5,
//!                             use_sample_covariance=False, data_range=1))
//! m, e, p = flip.evaluate(R.astype(np.float32), T.astype(np.float32), "LDR", applyMagma=False)
//! print(e, p, m[0, 0], m[20, 24], m[39, 47], m[10, 35])
//! hdr = lambda a: np.exp2(a.astype(np.float32) / np.float32(16)) * np.float32(0.01)
//! m, e, p = flip.evaluate(hdr(ref), hdr(test), "HDR", applyMagma=False)
//! print(e, p, m[0, 0], m[20, 24], m[10, 35])
//! ```

use super::{flip, metrics, ssim};

const WIDTH: usize = 48;
const HEIGHT: usize = 40;

fn hash(x: u32, y: u32, c: u32) -> u32 {
    let n = x
        .wrapping_mul(374_761_393)
        .wrapping_add(y.wrapping_mul(668_265_263))
        .wrapping_add(c.wrapping_mul(2_246_822_519))
        .wrapping_add(3_266_489_917);
    let n = (n ^ (n >> 13)).wrapping_mul(1_274_126_177);
    (n ^ (n >> 16)) & 0xff
}

/// Codes of the reference and of the picture under test.
fn codes() -> (Vec<[u8; 3]>, Vec<[u8; 3]>) {
    let pixel = |i: usize| {
        let (x, y) = ((i % WIDTH) as u32, (i / WIDTH) as u32);
        let reference = [0, 1, 2].map(|c| {
            let base = (x * 5 + y * 3 + c * 40) % 256;
            (if (x / 8 + y / 8) % 2 == 1 { 255 - base } else { base }) as u8
        });
        let shift = if x > 30 && y < 15 { 20 } else { 0 };
        let test = [0, 1, 2].map(|c| {
            let noise = (hash(x, y, c) as i32 - 128).div_euclid(8);
            (i32::from(reference[c as usize]) + noise + shift).clamp(0, 255) as u8
        });
        (reference, test)
    };
    (0..WIDTH * HEIGHT).map(pixel).unzip()
}

fn pair(value: impl Fn(u8) -> f32) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
    let (reference, test) = codes();
    let map = |codes: Vec<[u8; 3]>| codes.into_iter().map(|rgb| rgb.map(&value)).collect();
    (map(reference), map(test))
}

#[track_caller]
fn check_near(got: f64, want: f64, tolerance: f64) {
    assert!((got - want).abs() <= tolerance, "got {got}, published {want}");
}

#[test]
fn the_pictures_are_those_of_the_script() {
    let (reference, test) = codes();
    let sum = |codes: &[[u8; 3]]| codes.iter().flatten().map(|&c| u64::from(c)).sum::<u64>();
    assert_eq!((sum(&reference), sum(&test)), (732_608, 742_794));
}

#[test]
fn psnr_and_ssim_are_those_of_scikit_image() {
    let (reference, test) = pair(|code| f32::from(code) / 255.0);
    let mse = metrics::mse(&test, &reference);
    check_near(mse, 0.001_923_795_335_127_515, 1e-9);
    check_near(metrics::psnr(mse, 1.0), 27.158_411_326_893_92, 1e-5);
    check_near(ssim::ssim(&test, &reference, WIDTH).unwrap(), 0.966_673_670_716_191_3, 1e-6);
}

#[test]
fn ldr_flip_is_that_of_nvidia() {
    let (reference, test) = pair(|code| f32::from(code) / 255.0);
    check_near(flip::DEFAULT_PPD.into(), 67.020_645_141_601_56, 1e-5);
    let map = flip::ldr_flip(&test, &reference, WIDTH, flip::DEFAULT_PPD);
    check_near(flip::mean(&map), 0.124_111_369_252_204_9, 1e-5);
    for ((y, x), want) in
        [((0, 0), 0.065_628_29), ((20, 24), 0.062_595_03), ((39, 47), 0.255_046_8), ((10, 35), 0.329_473_58)]
    {
        check_near(map[y * WIDTH + x].into(), want, 3e-5);
    }
}

#[test]
fn hdr_flip_is_that_of_nvidia() {
    let (reference, test) = pair(|code| (f32::from(code) / 16.0).exp2() * 0.01);
    let flip = flip::hdr_flip(&test, &reference, WIDTH, flip::DEFAULT_PPD);
    check_near(flip.stops[0].into(), -7.800_663_948_059_082, 1e-4);
    check_near(flip.stops[1].into(), -2.909_403_562_545_776_4, 1e-4);
    assert_eq!(flip.exposures, 5);
    check_near(flip::mean(&flip.map), 0.217_149_898_409_844_3, 2e-5);
    for ((y, x), want) in [((0, 0), 0.049_354_777), ((20, 24), 0.168_391_64), ((10, 35), 0.360_802_26)] {
        check_near(flip.map[y * WIDTH + x].into(), want, 5e-5);
    }
}
