//! Eight lanes, or one: the arithmetic that the shading kernels are written in.
//!
//! A kernel is generic over [`Real`]. With [`wide::f32x8`] it is the SIMD kernel of
//! the wavefront; with `f32` it is its scalar twin, which the one-path-at-a-time
//! mode runs. A condition is a [`Mask`]; work that few lanes need is guarded by
//! [`Mask::any`], which in the scalar twin is an ordinary `if`.

mod compress;
mod lanes8;
mod prefetch;
mod scalar;
mod vec3;

use std::fmt::Debug;
use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Shl, Shr, Sub};

pub use self::compress::Compress;
pub use self::prefetch::prefetch;
pub use self::vec3::{Frame, Rgb, V3};

/// Lanes of a block.
pub const LANES: usize = 8;

/// A truth value per lane.
pub trait Mask: Copy + Debug + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> {
    /// The same in all lanes.
    fn splat(value: bool) -> Self;
    /// True if any lane is.
    fn any(self) -> bool;
    /// Lane `i` in bit `i`.
    fn bits(self) -> u32;
    /// The inverse of [`Mask::bits`].
    fn from_bits(bits: u32) -> Self;
    /// True if all lanes are.
    fn all(self) -> bool {
        !(!self).any()
    }
}

/// 32 bits per lane, arithmetic modulo 2³².
pub trait Bits:
    Copy
    + Debug
    + Add<Output = Self>
    + Mul<Output = Self>
    + BitXor<Output = Self>
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
    + Not<Output = Self>
    + Shl<usize, Output = Self>
    + Shr<usize, Output = Self>
{
    /// The same in all lanes.
    fn splat(value: u32) -> Self;
    /// Lane `i` from `f(i)`.
    fn from_fn(f: impl FnMut(usize) -> u32) -> Self;
    /// The value in lane `i`.
    fn lane(self, i: usize) -> u32;
    /// The most significant bit becomes the least, and so on.
    fn reverse_bits(self) -> Self;
}

/// A single-precision number per lane.
pub trait Real:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + 'static
{
    /// Lanes in a value.
    const LANES: usize;
    /// Truth values.
    type Mask: Mask;
    /// Integers.
    type Bits: Bits;

    /// The same in all lanes.
    fn splat(value: f32) -> Self;
    /// Lane `i` from `f(i)`.
    fn from_fn(f: impl FnMut(usize) -> f32) -> Self;
    /// From the start of a slice of at least `LANES` numbers.
    fn load(values: &[f32]) -> Self;
    /// To the start of a slice of at least `LANES` numbers.
    fn store(self, values: &mut [f32]);
    /// The value in lane `i`.
    fn lane(self, i: usize) -> f32;
    /// `self` < `other`.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self` ≤ `other`.
    fn le(self, other: Self) -> Self::Mask;
    /// `self` = `other`.
    fn eq(self, other: Self) -> Self::Mask;
    /// `self` > `other`.
    fn gt(self, other: Self) -> Self::Mask {
        other.lt(self)
    }
    /// `self` ≥ `other`.
    fn ge(self, other: Self) -> Self::Mask {
        other.le(self)
    }
    /// `yes` where `mask` holds, `no` elsewhere.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// The smaller; the second if either is NaN.
    fn min(self, other: Self) -> Self;
    /// The larger; the second if either is NaN.
    fn max(self, other: Self) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// `self · a + b`, rounded once where the target does so quickly.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// eˣ.
    fn exp(self) -> Self;
    /// Sine and cosine.
    fn sin_cos(self) -> (Self, Self);
    /// The upper 24 bits as a number in [0, 1).
    fn unit(bits: Self::Bits) -> Self;
    /// The whole part of a number of at least 0 and below 2³¹.
    fn truncate(self) -> Self::Bits;
    /// A whole number below 2³¹.
    fn whole(bits: Self::Bits) -> Self;
    /// Column by column, rows of four numbers, one for each lane.
    fn columns_of_four(row: impl FnMut(usize) -> [f32; 4]) -> [Self; 4];
    /// Column by column, rows of eight numbers, one for each lane.
    fn columns_of_eight(row: impl FnMut(usize) -> [f32; 8]) -> [Self; 8];

    /// 0 in all lanes.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(0.0)
    }
    /// 1 in all lanes.
    #[inline(always)]
    fn one() -> Self {
        Self::splat(1.0)
    }
    /// Clamped to [0, 1].
    #[inline(always)]
    fn saturate(self) -> Self {
        self.max(Self::zero()).min(Self::one())
    }
    /// Square root of the positive part.
    #[inline(always)]
    fn safe_sqrt(self) -> Self {
        self.max(Self::zero()).sqrt()
    }
    /// The square.
    #[inline(always)]
    fn sqr(self) -> Self {
        self * self
    }
    /// `self` where `mask` holds, 0 elsewhere.
    #[inline(always)]
    fn masked(self, mask: Self::Mask) -> Self {
        Self::select(mask, self, Self::zero())
    }
    /// The magnitude of `self` with the sign of `sign`.
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        let magnitude = self.abs();
        Self::select(sign.lt(Self::zero()), -magnitude, magnitude)
    }
}

#[cfg(test)]
mod tests {
    use std::num::Wrapping;

    use wide::f32x8;

    use super::*;

    /// Every operation gives in each lane what the scalar gives: exactly for those that IEEE 754 rounds,
    /// within four ulp for the transcendental ones.
    #[test]
    fn lanes_agree_with_the_scalar() {
        let a = [-2.5f32, -1.0, -0.0, 0.0, 1e-3, 0.7, 3.0, 1e5];
        let b = [1.5f32, -1.0, 2.0, 0.0, 7.0, 0.3, -4.0, 1e-5];
        let (x, y) = (f32x8::new(a), f32x8::new(b));
        let near = |got: f32, want: f32| (got - want).abs() <= 4.0 * f32::EPSILON * want.abs().max(1e-6);
        for i in 0..LANES {
            let (p, q) = (a[i], b[i]);
            assert_eq!(Real::lane(x + y, i), p + q);
            assert_eq!(Real::lane(Real::min(x, y), i), Real::min(p, q));
            assert_eq!(Real::lane(Real::max(x, y), i), Real::max(p, q));
            assert_eq!(Real::lane(Real::safe_sqrt(x), i), Real::safe_sqrt(p));
            assert_eq!(Real::lane(Real::copysign(x, y), i).abs(), p.abs());
            assert_eq!(Real::lt(x, y).bits() >> i & 1 == 1, p < q);
            assert_eq!(Real::le(x, y).bits() >> i & 1 == 1, p <= q);
            assert_eq!(Real::lane(Real::select(Real::lt(x, y), x, y), i), if p < q { p } else { q });
            let (sin, cos) = Real::sin_cos(x);
            if p.abs() < 10.0 {
                assert!((Real::lane(sin, i) - p.sin()).abs() < 1e-6 && (Real::lane(cos, i) - p.cos()).abs() < 1e-6);
                assert!(near(Real::lane(Real::exp(x), i), p.exp()), "exp {p}");
            }
        }
        let bits = <f32x8 as Real>::Bits::from_fn(|i| (i as u32).wrapping_mul(0x9e37_79b9));
        for i in 0..LANES {
            let n = (i as u32).wrapping_mul(0x9e37_79b9);
            assert_eq!(Real::lane(<f32x8 as Real>::unit(bits), i), <f32 as Real>::unit(Wrapping(n)));
            assert_eq!(
                Bits::lane((bits * Bits::splat(747_796_405)) ^ (bits >> 7), i),
                n.wrapping_mul(747_796_405) ^ (n >> 7)
            );
            assert_eq!(Bits::lane(bits.reverse_bits(), i), n.reverse_bits());
            assert_eq!(Bits::reverse_bits(Wrapping(n)).0, n.reverse_bits());
        }
        assert_eq!(<f32 as Real>::unit(Wrapping(u32::MAX)), 1.0 - f32::EPSILON / 2.0, "below one");
    }

    #[test]
    fn whole_numbers_and_columns_are_the_same_lane_by_lane() {
        let numbers = f32x8::new([0.0, 0.9, 1.0, 2.5, 65_534.99, 8_388_608.0, 1e9, 2_147_483_520.0]);
        let whole = Real::truncate(numbers);
        let number = |row: usize, column: usize| (100 * row + column) as f32;
        let eight = <f32x8 as Real>::columns_of_eight(|lane| std::array::from_fn(|column| number(lane, column)));
        let four = <f32x8 as Real>::columns_of_four(|lane| std::array::from_fn(|column| number(lane, column)));
        for lane in 0..LANES {
            let one = numbers.to_array()[lane];
            assert_eq!(whole.lane(lane), one as u32);
            assert_eq!(Real::truncate(one).0, one as u32);
            assert_eq!(Real::lane(<f32x8 as Real>::whole(whole), lane), one as u32 as f32);
            assert_eq!(<f32 as Real>::whole(Wrapping(one as u32)), one as u32 as f32);
            (0..8).for_each(|column| assert_eq!(eight[column].to_array()[lane], number(lane, column)));
            (0..4).for_each(|column| assert_eq!(four[column].to_array()[lane], number(lane, column)));
        }
        assert_eq!(<f32 as Real>::columns_of_four(|lane| [lane as f32, 1.0, 2.0, 3.0]), [0.0, 1.0, 2.0, 3.0]);
    }
}
