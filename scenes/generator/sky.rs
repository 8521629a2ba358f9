//! A clear sky with a small sun, as lat-long texels.

use glam::{Vec3, vec3};
use image::{Rgb, codecs::hdr::HdrEncoder};

const WIDTH: usize = 512;
const HEIGHT: usize = 256;
/// First column and row of the sun, and how many texels it takes each way.
const SUN: [usize; 2] = [336, 66];
const SUN_TEXELS: usize = 2;
/// The sun gives a level surface as much light as all of the sky.
const SUN_SHARE: f32 = 1.0;
/// Illuminance of a level surface by the sky alone, lx.
const SKY_LUX: f32 = 0.55;

/// Where the centre of a texel, or any other point of the picture, is in the sky.
fn direction(column: f32, row: f32) -> Vec3 {
    let phi = (column / WIDTH as f32 - 0.5) * std::f32::consts::TAU;
    let (sin, cos) = (row / HEIGHT as f32 * std::f32::consts::PI).sin_cos();
    vec3(sin * phi.cos(), cos, sin * phi.sin())
}

/// Towards the middle of the sun.
pub fn sun() -> Vec3 {
    let middle = SUN.map(|first| first as f32 + SUN_TEXELS as f32 / 2.0);
    direction(middle[0], middle[1])
}

/// Bright and pale at the horizon and around the sun, blue above; the ground below.
fn gradient(d: Vec3) -> Vec3 {
    let zenith = vec3(0.17, 0.36, 0.82);
    let horizon = vec3(0.70, 0.88, 1.08);
    if d.y < 0.0 {
        // The haze goes on for a little where a ground ends.
        return horizon.lerp(vec3(0.40, 0.38, 0.34), (-20.0 * d.y).min(1.0));
    }
    let haze = (-4.0 * d.y).exp();
    let glow = d.dot(sun()).max(0.0);
    zenith.lerp(horizon, haze) + vec3(1.0, 0.85, 0.62) * (0.9 * glow.powi(60) + 0.25 * glow.powi(6))
}

/// As a Radiance file.
pub fn file() -> Vec<u8> {
    let mut texels: Vec<Vec3> =
        (0..WIDTH * HEIGHT).map(|i| gradient(direction((i % WIDTH) as f32 + 0.5, (i / WIDTH) as f32 + 0.5))).collect();
    // Exact over a texel: the integral of cos θ sin θ over its rows.
    let level = |row: usize| {
        let half = |row: usize| (row as f32 / HEIGHT as f32 * std::f32::consts::PI).sin().powi(2) / 2.0;
        (half(row + 1) - half(row)) * std::f32::consts::TAU / WIDTH as f32
    };
    let luminance = |c: Vec3| c.dot(vec3(0.2126, 0.7152, 0.0722));
    let upper = HEIGHT / 2;
    let lux: f32 = (0..upper)
        .map(|row| level(row) * texels[row * WIDTH..][..WIDTH].iter().map(|&c| luminance(c)).sum::<f32>())
        .sum();
    texels.iter_mut().for_each(|c| *c *= SKY_LUX / lux);
    let rows = SUN[1]..SUN[1] + SUN_TEXELS;
    let tint = vec3(1.0, 0.87, 0.66);
    let weight: f32 = rows.clone().map(|row| level(row) * SUN_TEXELS as f32).sum();
    let disc = tint * SUN_SHARE * SKY_LUX / (weight * luminance(tint));
    for row in rows {
        texels[row * WIDTH + SUN[0]..][..SUN_TEXELS].fill(disc);
    }
    let rgb: Vec<_> = texels.iter().map(|c| Rgb(c.to_array())).collect();
    let mut bytes = Vec::new();
    HdrEncoder::new(&mut bytes).encode(&rgb, WIDTH, HEIGHT).expect("writing to memory cannot fail");
    bytes
}
