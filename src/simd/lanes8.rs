//! Eight lanes over `wide`.

use std::ops::{Add, BitAnd, BitOr, BitXor, Mul, Not, Shl, Shr};

use wide::{f32x4, f32x8, i8x32, i32x8, u32x8};

use super::{Bits, Mask, Real};

/// Eight truth values, as all-ones or all-zero lanes.
#[derive(Clone, Copy, Debug)]
pub struct Mask8(f32x8);

impl BitAnd for Mask8 {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl BitOr for Mask8 {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Not for Mask8 {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

impl Mask for Mask8 {
    #[inline(always)]
    fn splat(value: bool) -> Self {
        Self(bytemuck::cast(u32x8::splat(if value { u32::MAX } else { 0 })))
    }
    #[inline(always)]
    fn any(self) -> bool {
        self.0.to_bitmask() != 0
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        self.0.to_bitmask()
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        const LANE: u32x8 = u32x8::new([1, 2, 4, 8, 16, 32, 64, 128]);
        Self(bytemuck::cast((u32x8::splat(bits) & LANE).simd_eq(LANE)))
    }
}

/// Eight integers.
#[derive(Clone, Copy, Debug)]
pub struct Bits8(u32x8);

macro_rules! bits_op {
    ($trait:ident, $method:ident, $op:tt) => {
        impl $trait for Bits8 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0 $op other.0)
            }
        }
    };
}

bits_op!(Add, add, +);
bits_op!(Mul, mul, *);
bits_op!(BitXor, bitxor, ^);
bits_op!(BitAnd, bitand, &);
bits_op!(BitOr, bitor, |);

impl Not for Bits8 {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

impl Shl<usize> for Bits8 {
    type Output = Self;
    #[inline(always)]
    fn shl(self, by: usize) -> Self {
        Self(self.0 << by as u32)
    }
}

impl Shr<usize> for Bits8 {
    type Output = Self;
    #[inline(always)]
    fn shr(self, by: usize) -> Self {
        Self(self.0 >> by as u32)
    }
}

/// Where byte `i` of each half of a register comes from when 32-bit lanes change byte order.
const BYTE_ORDER: [u8; 32] = {
    let mut order = [0; 32];
    let mut i = 0;
    while i < 32 {
        order[i] = (i as u8 % 16) ^ 3;
        i += 1;
    }
    order
};

/// The four bits of each number below 16 in reverse, twice.
const REVERSED: [u8; 32] = reversed(4);

/// As [`REVERSED`], in the upper half of the byte.
const REVERSED_UPPER: [u8; 32] = reversed(0);

const fn reversed(shift: u32) -> [u8; 32] {
    let mut table = [0; 32];
    let mut i = 0;
    while i < 32 {
        table[i] = (i as u8 % 16).reverse_bits() >> shift;
        i += 1;
    }
    table
}

impl Bits for Bits8 {
    #[inline(always)]
    fn splat(value: u32) -> Self {
        Self(u32x8::splat(value))
    }
    #[inline(always)]
    fn from_fn(f: impl FnMut(usize) -> u32) -> Self {
        Self(u32x8::new(std::array::from_fn(f)))
    }
    #[inline(always)]
    fn lane(self, i: usize) -> u32 {
        self.0.to_array()[i]
    }
    #[inline(always)]
    fn reverse_bits(self) -> Self {
        // The bytes of each lane are reversed, then the halves of each byte looked up and exchanged.
        let bytes: i8x32 = bytemuck::cast(self.0);
        let bytes: u32x8 = bytemuck::cast(bytes.swizzle_half_relaxed(bytemuck::cast(BYTE_ORDER)));
        let half = u32x8::splat(0x0f0f_0f0f);
        let lower: i8x32 = bytemuck::cast(bytes & half);
        let upper: i8x32 = bytemuck::cast((bytes >> 4) & half);
        let reversed: i8x32 = bytemuck::cast(REVERSED);
        let reversed_upper: i8x32 = bytemuck::cast(REVERSED_UPPER);
        let lower: u32x8 = bytemuck::cast(reversed_upper.swizzle_half_relaxed(lower));
        let upper: u32x8 = bytemuck::cast(reversed.swizzle_half_relaxed(upper));
        Self(lower | upper)
    }
}

impl Real for f32x8 {
    const LANES: usize = 8;
    type Mask = Mask8;
    type Bits = Bits8;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self::splat(value)
    }
    #[inline(always)]
    fn from_fn(f: impl FnMut(usize) -> f32) -> Self {
        Self::new(std::array::from_fn(f))
    }
    #[inline(always)]
    fn load(values: &[f32]) -> Self {
        Self::new(*values.first_chunk::<8>().expect("columns are padded to whole blocks"))
    }
    #[inline(always)]
    fn store(self, values: &mut [f32]) {
        *values.first_chunk_mut::<8>().expect("columns are padded to whole blocks") = self.to_array();
    }
    #[inline(always)]
    fn lane(self, i: usize) -> f32 {
        self.to_array()[i]
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Mask8 {
        Mask8(self.simd_lt(other))
    }
    #[inline(always)]
    fn le(self, other: Self) -> Mask8 {
        Mask8(self.simd_le(other))
    }
    #[inline(always)]
    fn eq(self, other: Self) -> Mask8 {
        Mask8(self.simd_eq(other))
    }
    #[inline(always)]
    fn select(mask: Mask8, yes: Self, no: Self) -> Self {
        mask.0.bitselect(yes, no)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.fast_min(other)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.fast_max(other)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self::abs(self)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self::sqrt(self)
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Self::mul_add(self, a, b)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        Self::exp(self)
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        Self::sin_cos(self)
    }
    #[inline(always)]
    fn unit(bits: Bits8) -> Self {
        let upper: i32x8 = bytemuck::cast(bits.0 >> 8);
        Self::from_i32x8(upper) * Self::splat(1.0 / 16_777_216.0)
    }
    #[inline(always)]
    fn truncate(self) -> Bits8 {
        Bits8(bytemuck::cast(self.fast_trunc_int()))
    }
    #[inline(always)]
    fn whole(bits: Bits8) -> Self {
        Self::from_i32x8(bytemuck::cast(bits.0))
    }
    #[inline(always)]
    fn columns_of_four(mut row: impl FnMut(usize) -> [f32; 4]) -> [Self; 4] {
        let mut rows = [Self::ZERO; 8];
        for (lane, both) in rows.iter_mut().enumerate().take(4) {
            *both = bytemuck::cast([row(lane), row(lane + 4)]);
        }
        // Each half of a register is transposed by itself.
        let columns = Self::transpose(rows).map(|column| bytemuck::cast::<_, [f32x4; 2]>(column)[0]);
        std::array::from_fn(|i| bytemuck::cast([columns[i], columns[i + 4]]))
    }
    #[inline(always)]
    fn columns_of_eight(row: impl FnMut(usize) -> [f32; 8]) -> [Self; 8] {
        Self::transpose(std::array::from_fn(row).map(Self::new))
    }
}
