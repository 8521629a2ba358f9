//! Textures, drawn texel by texel and packed as PNG.

use glam::{Vec2, Vec3};

use super::noise::{layered, smooth, uniform};

/// A PNG of `width × height`; `texel` gives sRGB and alpha in [0, 1] at (u, v), v downwards.
fn png(width: u32, height: u32, alpha: bool, texel: impl Fn(f32, f32) -> [f32; 4]) -> Vec<u8> {
    let channels = if alpha { 4 } else { 3 };
    let mut data = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let color = texel((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
            data.extend(color[..channels].iter().map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8));
        }
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(if alpha { png::ColorType::Rgba } else { png::ColorType::Rgb });
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    let mut writer = encoder.write_header().expect("writing to memory cannot fail");
    writer.write_image_data(&data).expect("the data has the size the header says");
    writer.finish().expect("writing to memory cannot fail");
    bytes
}

fn opaque(color: Vec3) -> [f32; 4] {
    [color.x, color.y, color.z, 1.0]
}

fn step(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Two by two squares.
pub fn checker(dark: [f32; 3], light: [f32; 3]) -> Vec<u8> {
    png(64, 64, false, |u, v| {
        let color = if (u < 0.5) == (v < 0.5) { light } else { dark };
        opaque(color.into())
    })
}

/// A normal map of one round dimple, to be repeated.
pub fn dimple() -> Vec<u8> {
    let depth = |p: Vec2| {
        let r = p.length() / 0.46;
        if r < 1.0 { -0.16 * (1.0 - r * r).powi(2) } else { 0.0 }
    };
    png(64, 64, false, |u, v| {
        // Up in the image is +Y of the map.
        let p = Vec2::new(u - 0.5, 0.5 - v);
        let slope = |d: Vec2| (depth(p + d) - depth(p - d)) / (2.0 * d.length());
        let n = Vec3::new(-slope(Vec2::X * 0.004), -slope(Vec2::Y * 0.004), 1.0).normalize();
        opaque(n * 0.5 + 0.5)
    })
}

/// Floor boards: four across, running along u, with their ends shifted.
pub fn boards() -> Vec<u8> {
    png(192, 192, false, |u, v| {
        let board = (v * 4.0).floor();
        let shifted = u + uniform(board as u64 + 40);
        let piece = ((shifted * 2.0).floor() as i64).rem_euclid(2) as u64;
        let tone = 0.82 + 0.3 * uniform(100 + 2 * board as u64 + piece);
        let grain = smooth(u * 4.0, v * 48.0, 4, 7 + piece) * 0.11 + smooth(u * 2.0, v * 8.0, 2, 3) * 0.08;
        let along = (v * 4.0).fract();
        let across = (shifted * 2.0).fract();
        let gap = step(0.0, 0.035, along.min(1.0 - along)).min(step(0.0, 0.008, across.min(1.0 - across)));
        let color = Vec3::new(0.76, 0.57, 0.39) * (tone - grain) * (0.45 + 0.55 * gap);
        // Few tones keep the file small and cannot be told apart.
        opaque((color * 40.0).round() / 40.0)
    })
}

/// A picture to hang: hills under a low sun.
pub fn hills() -> Vec<u8> {
    png(128, 96, false, |u, v| {
        let mut color = Vec3::new(0.96, 0.66, 0.38).lerp(Vec3::new(0.30, 0.46, 0.66), step(0.65, 0.0, v));
        let sun = Vec2::new((u - 0.66) * 4.0 / 3.0, v - 0.36).length();
        color = color.lerp(Vec3::new(1.0, 0.93, 0.72), step(0.105, 0.095, sun));
        let tones = [[0.62, 0.45, 0.48], [0.40, 0.36, 0.44], [0.21, 0.28, 0.30], [0.10, 0.16, 0.15]];
        for (i, tone) in tones.into_iter().enumerate() {
            let ridge = 0.42 + 0.13 * i as f32 + 0.2 * (layered(u * (2.0 + i as f32), 0.0, 3, 60 + i as u64) - 0.5);
            color = color.lerp(tone.into(), step(ridge - 0.006, ridge + 0.006, v));
        }
        opaque((color * 48.0).round() / 48.0)
    })
}

/// A leaf, stem at the bottom: green with veins, transparent around.
pub fn leaf() -> Vec<u8> {
    png(96, 160, true, |u, v| {
        let (x, y) = (2.0 * (u - 0.5), 1.0 - v);
        let t = ((y - 0.14) / 0.83).clamp(0.0, 1.0);
        let half_width = 0.86 * (std::f32::consts::PI * t.powf(0.72)).sin().max(0.0).powf(0.85);
        // Teeth along the edge point to the tip.
        let tooth = 0.06 * (t * 22.0).fract() * step(0.0, 0.2, half_width);
        let blade = half_width - tooth - x.abs();
        let stem = if y < 0.2 { 0.035 - x.abs() } else { -1.0 };
        let coverage = step(-0.03, 0.03, blade.max(stem));
        let side = (t - 0.33 * x.abs()) * 9.0;
        let vein = step(0.10, 0.02, (side.fract() - 0.5).abs()).max(step(0.045, 0.015, x.abs()));
        let color = Vec3::new(0.24, 0.50, 0.13).lerp(Vec3::new(0.36, 0.58, 0.17), 0.7 * x.abs() + 0.3 * t);
        let color = color.lerp(Vec3::new(0.58, 0.72, 0.34), 0.75 * vein);
        let [r, g, b] = ((color * 32.0).round() / 32.0).to_array();
        [r, g, b, (coverage * 16.0).round() / 16.0]
    })
}

/// Cloth, seen from near: crossing threads with holes between them.
pub fn weave() -> Vec<u8> {
    png(32, 32, true, |u, v| {
        let thread = |x: f32| step(0.34, 0.24, (x - 0.5).abs());
        let over = (u * 2.0).floor() as i32 + (v * 2.0).floor() as i32;
        let (a, b) = (thread((u * 2.0).fract()), thread((v * 2.0).fract()));
        let front = if over % 2 == 0 { a } else { b };
        let tone = 0.78 + 0.18 * front;
        [tone, tone * 0.97, tone * 0.90, a.max(b)]
    })
}

/// White whose alpha grows from the top (0) to the middle of the bottom (1), with a soft wave.
pub fn mist() -> Vec<u8> {
    png(64, 64, true, |u, v| {
        let wave = 0.12 * (std::f32::consts::TAU * u).sin();
        let sides = step(0.0, 0.35, u.min(1.0 - u));
        [1.0, 1.0, 1.0, sides * step(0.12, 0.88, v + wave * (1.0 - (2.0 * v - 1.0).powi(2)))]
    })
}

/// A ring of petals, each of its own hue, on transparent ground.
pub fn rosette() -> Vec<u8> {
    png(160, 160, true, |u, v| {
        let p = Vec2::new(u - 0.5, 0.5 - v) * 2.0;
        let (r, turn) = (p.length(), p.y.atan2(p.x) / std::f32::consts::TAU + 0.5);
        let petal = (turn * 12.0).floor();
        let lobe = (1.0 - (2.0 * (turn * 12.0).fract() - 1.0).powi(2)).sqrt();
        let inside = step(0.0, 0.03, 0.62 + 0.3 * lobe - r) * step(0.0, 0.03, r - 0.34) * step(0.1, 0.3, lobe);
        let hub = step(0.0, 0.03, 0.26 - r) * step(0.0, 0.03, r - 0.12);
        let hue = |shift: f32| 0.55 + 0.45 * (std::f32::consts::TAU * (petal / 12.0 + shift)).cos();
        [hue(0.0), hue(0.67), hue(0.33), inside.max(hub)]
    })
}

/// What a screen shows: colour bars over a grey ramp.
pub fn bars() -> Vec<u8> {
    let colors = [7u8, 6, 3, 2, 5, 4, 1];
    png(112, 64, false, |u, v| {
        let frame = u.min(1.0 - u) * 112.0 < 2.0 || v.min(1.0 - v) * 64.0 < 2.0;
        if frame {
            return [0.02, 0.02, 0.02, 1.0];
        }
        if v > 0.78 {
            return opaque(Vec3::splat((u * 8.0).floor() / 7.0));
        }
        // Bit 2 is red, 1 green, 0 blue.
        let code = colors[((u * 7.0) as usize).min(6)];
        let channel = |bit: u8| if code >> bit & 1 == 1 { 0.92 } else { 0.08 };
        [channel(2), channel(1), channel(0), 1.0]
    })
}

/// A sheet of stained glass lit from behind: cells of colour between dark leads.
pub fn stained() -> Vec<u8> {
    let palette = [
        [0.95, 0.28, 0.12],
        [0.98, 0.70, 0.12],
        [0.13, 0.40, 0.85],
        [0.10, 0.62, 0.45],
        [0.65, 0.18, 0.62],
        [0.97, 0.92, 0.75],
    ];
    png(128, 192, false, |u, v| {
        let p = Vec2::new(u * 6.0, v * 9.0);
        let mut nearest = [(f32::INFINITY, 0u64); 2];
        for j in -1..=9i64 {
            for i in -1..=6i64 {
                let key = (j * 31 + i + 400) as u64;
                let seed = Vec2::new(i as f32 + uniform(key), j as f32 + uniform(key + 9000));
                let found = (p.distance(seed), key);
                if found.0 < nearest[0].0 {
                    nearest = [found, nearest[0]];
                } else if found.0 < nearest[1].0 {
                    nearest[1] = found;
                }
            }
        }
        let border = u.min(1.0 - u).min(1.5 * v.min(1.0 - v)) * 12.0;
        let lead = step(0.05, 0.13, (nearest[1].0 - nearest[0].0).min(border));
        let color = Vec3::from(palette[(uniform(nearest[0].1 + 77) * 6.0) as usize % 6]);
        opaque(color * lead)
    })
}

/// A clear sky from the zenith (top) to the horizon and the haze below it.
pub fn sky() -> Vec<u8> {
    png(4, 64, false, |_, v| {
        let horizon = step(0.05, 1.0, v);
        opaque(Vec3::new(0.30, 0.47, 0.78).lerp(Vec3::new(0.93, 0.86, 0.80), horizon))
    })
}
