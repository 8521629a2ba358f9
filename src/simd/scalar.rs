//! One lane: the scalar twin.

use super::{Bits, Mask, Real};

impl Mask for bool {
    #[inline(always)]
    fn splat(value: bool) -> Self {
        value
    }
    #[inline(always)]
    fn any(self) -> bool {
        self
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self)
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        bits & 1 == 1
    }
}

/// One integer, arithmetic modulo 2³².
impl Bits for std::num::Wrapping<u32> {
    #[inline(always)]
    fn splat(value: u32) -> Self {
        Self(value)
    }
    #[inline(always)]
    fn from_fn(mut f: impl FnMut(usize) -> u32) -> Self {
        Self(f(0))
    }
    #[inline(always)]
    fn lane(self, _: usize) -> u32 {
        self.0
    }
    #[inline(always)]
    fn reverse_bits(self) -> Self {
        Self(self.0.reverse_bits())
    }
}

impl Real for f32 {
    const LANES: usize = 1;
    type Mask = bool;
    type Bits = std::num::Wrapping<u32>;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        value
    }
    #[inline(always)]
    fn from_fn(mut f: impl FnMut(usize) -> f32) -> Self {
        f(0)
    }
    #[inline(always)]
    fn load(values: &[f32]) -> Self {
        values[0]
    }
    #[inline(always)]
    fn store(self, values: &mut [f32]) {
        values[0] = self;
    }
    #[inline(always)]
    fn lane(self, _: usize) -> f32 {
        self
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self <= other
    }
    #[inline(always)]
    fn eq(self, other: Self) -> bool {
        self == other
    }
    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        // A fused multiply-add without the hardware instruction is a slow library call.
        if cfg!(target_feature = "fma") || cfg!(target_arch = "aarch64") { self.mul_add(a, b) } else { self * a + b }
    }
    #[inline(always)]
    fn exp(self) -> Self {
        self.exp()
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        self.sin_cos()
    }
    #[inline(always)]
    fn unit(bits: Self::Bits) -> Self {
        (bits.0 >> 8) as f32 * (1.0 / 16_777_216.0)
    }
    #[inline(always)]
    fn truncate(self) -> Self::Bits {
        std::num::Wrapping(self as u32)
    }
    #[inline(always)]
    fn whole(bits: Self::Bits) -> Self {
        bits.0 as f32
    }
    #[inline(always)]
    fn columns_of_four(mut row: impl FnMut(usize) -> [f32; 4]) -> [Self; 4] {
        row(0)
    }
    #[inline(always)]
    fn columns_of_eight(mut row: impl FnMut(usize) -> [f32; 8]) -> [Self; 8] {
        row(0)
    }
}
