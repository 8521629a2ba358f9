//! Exact sums: light added as integers, so that no order of adding can change a bit.
//!
//! A contribution is rounded once to a multiple of a unit, a power of two fixed by
//! the scene's brightest emission, and added in 128 bits. The unit lies 2⁸⁸ below that
//! emission: a contribution of a 10¹²th of it still has all 24 bits of its mantissa,
//! and 2³⁹ contributions of its size fit.

use crate::world::units::Nit;

/// Power of two between the brightest emission and the unit.
const DEPTH: i32 = 88;

/// The size of one integer step, 2^log2 nit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit {
    /// Base-2 logarithm of the step.
    pub log2: i32,
}

impl Unit {
    /// For layers that do not hold light: steps of 2⁻⁶⁴, values up to 2⁶².
    pub const PLAIN: Self = Self { log2: -64 };

    /// For pictures whose brightest emission is about this.
    pub fn for_emission(brightest: Nit) -> Self {
        let exponent = if brightest.0 > 0.0 && brightest.0.is_finite() { brightest.0.log2().floor() as i32 } else { 0 };
        Self { log2: exponent - DEPTH }
    }

    /// `value` in steps, rounded towards zero, and whether it can be added up: it is finite and not too large.
    ///
    /// Without branches: channels of one colour differ in which would be taken.
    #[inline(always)]
    pub fn quantise(self, value: f32) -> (i128, bool) {
        let bits = value.to_bits();
        let exponent = (bits >> 23 & 0xff) as i32;
        // value = mantissa · 2^(exponent − 150), with the implicit bit where it is a normal number.
        let mantissa = bits & 0x7f_ffff | u32::from(exponent != 0) << 23;
        let shift = exponent.max(1) - 150 - self.log2;
        let whole = mantissa >> (-shift).clamp(0, 31);
        let magnitude = i128::from(whole) << (shift.max(0) & 127);
        let sign = -i128::from(bits >> 31);
        ((magnitude ^ sign) - sign, (exponent != 0xff) & (shift <= 92))
    }

    /// The number that a sum of steps stands for.
    pub fn value(self, sum: i128) -> f64 {
        sum as f64 * f64::from(self.log2).exp2()
    }
}

/// Sums of three channels for each pixel of a tile.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sums(pub Vec<[i128; 3]>);

impl Sums {
    /// Zeros for `pixels` pixels.
    pub fn new(pixels: usize) -> Self {
        Self(vec![[0; 3]; pixels])
    }

    /// Adds a contribution; false, and nothing added, if it is not finite or out of range.
    #[inline]
    pub fn add(&mut self, unit: Unit, pixel: usize, value: [f32; 3]) -> bool {
        let [(r, fits_r), (g, fits_g), (b, fits_b)] = value.map(|value| unit.quantise(value));
        if !(fits_r & fits_g & fits_b) {
            return false;
        }
        let sum = &mut self.0[pixel];
        sum[0] += r;
        sum[1] += g;
        sum[2] += b;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from 1e-12 to 1e6 times the emission, added forwards, backwards and by halves: the same bits.
    #[test]
    fn order_and_grouping_do_not_matter() {
        let unit = Unit::for_emission(Nit(17.0));
        let values: Vec<f32> = (0..2000).map(|i| ((i * 7919 % 2000) as f32 / 100.0 - 12.0).exp2() * 1.37).collect();
        let sum = |values: &mut dyn Iterator<Item = f32>| {
            let mut sums = Sums::new(1);
            values.for_each(|v| assert!(sums.add(unit, 0, [v, -v, 0.5 * v])));
            sums
        };
        let forwards = sum(&mut values.iter().copied());
        assert_eq!(forwards, sum(&mut values.iter().rev().copied()));
        let (a, b) = values.split_at(777);
        let (a, b) = (sum(&mut a.iter().copied()), sum(&mut b.iter().copied()));
        assert_eq!(forwards.0[0], std::array::from_fn(|i| a.0[0][i] + b.0[0][i]));
        let want: f64 = values.iter().map(|&v| f64::from(v)).sum();
        assert!((unit.value(forwards.0[0][0]) - want).abs() < 1e-12 * want);
        assert_eq!(forwards.0[0][1], -forwards.0[0][0]);
    }

    /// A million ones and a million 1e-12 beside each other: the mean is right to 1e-15.
    #[test]
    fn dim_light_is_not_lost_beside_bright_light() {
        let unit = Unit::for_emission(Nit(1e6));
        let mut sums = Sums::new(1);
        for _ in 0..100_000 {
            sums.add(unit, 0, [1e6, 1e-6, 0.0]);
            sums.add(unit, 0, [1e-6, 1e6, 0.0]);
        }
        let want = 1e5 * (f64::from(1e6_f32) + f64::from(1e-6_f32));
        for channel in 0..2 {
            assert!((unit.value(sums.0[0][channel]) - want).abs() < 1e-15 * want);
        }
    }

    #[test]
    fn what_is_not_finite_or_absurdly_bright_is_refused_whole() {
        let unit = Unit::for_emission(Nit(1e-30));
        let mut sums = Sums::new(1);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
            assert!(!sums.add(unit, 0, [1e-30, bad, 1e-30]), "{bad}");
        }
        assert_eq!(sums, Sums::new(1));
    }
}
