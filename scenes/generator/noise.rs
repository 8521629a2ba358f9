//! Repeatable randomness: numbers and smooth noise as pure functions of integers.

/// A number in [0, 1) that belongs to `key`.
pub fn uniform(key: u64) -> f32 {
    // Steele, Lea, Flood 2014, "Fast Splittable Pseudorandom Number Generators": the mixing of SplitMix64.
    let mut z = key.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 40) as f32 / (1u32 << 24) as f32
}

/// Numbers drawn one after the other.
pub struct Draws(u64);

impl Draws {
    /// The sequence of `seed`.
    pub fn new(seed: u64) -> Self {
        Self(seed << 32)
    }

    /// The next number, between `low` and `high`.
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        self.0 += 1;
        low + (high - low) * uniform(self.0)
    }

    /// The next number is below `probability`.
    pub fn chance(&mut self, probability: f32) -> bool {
        self.between(0.0, 1.0) < probability
    }
}

/// Smooth noise in [0, 1) whose bumps are one unit apart; with `period` > 0 it repeats after that many.
pub fn smooth(x: f32, y: f32, period: i64, seed: u64) -> f32 {
    let (i, j) = (x.floor(), y.floor());
    let fade = |t: f32| t * t * (3.0 - 2.0 * t);
    let (s, t) = (fade(x - i), fade(y - j));
    let corner = |di: i64, dj: i64| {
        let wrap = |k: i64| if period > 0 { k.rem_euclid(period) } else { k };
        let (i, j) = (wrap(i as i64 + di), wrap(j as i64 + dj));
        uniform((seed << 48) ^ ((i as u64 & 0xff_ffff) << 24) ^ (j as u64 & 0xff_ffff))
    };
    let low = corner(0, 0) * (1.0 - s) + corner(1, 0) * s;
    let high = corner(0, 1) * (1.0 - s) + corner(1, 1) * s;
    low * (1.0 - t) + high * t
}

/// Noise of several scales: each octave half as large and half as strong; in [0, 1).
pub fn layered(x: f32, y: f32, octaves: u32, seed: u64) -> f32 {
    let (mut sum, mut total) = (0.0, 0.0);
    for octave in 0..octaves {
        let scale = (1 << octave) as f32;
        sum += smooth(x * scale, y * scale, 0, seed + u64::from(octave)) / scale;
        total += 1.0 / scale;
    }
    sum / total
}
