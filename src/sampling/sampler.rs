//! Numbers in [0, 1) as a pure function of pixel, sample, dimension and seed.
//!
//! Nothing is stored between calls, so any path may ask for any number in any order and the picture does not depend
//! on how the work was cut.

use crate::{
    render::SamplerKind,
    simd::{Bits, Real},
};

/// A source of numbers in [0, 1).
///
/// A dimension is a pair of numbers that belong together, such as the two coordinates of a point on a light. With
/// [`SamplerKind::Sobol`] the pairs of one pixel and one dimension are a (0, 2)-sequence over the sample index: each
/// aligned run of 2ᵏ samples puts exactly one point into each of the 2ᵏ boxes of 2⁻ᵃ by 2⁻ᵇ, a + b = k, whatever a is.
/// Different pixels and dimensions are scrambled and shuffled apart from one another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampler {
    /// How the numbers are made.
    kind: SamplerKind,
    /// The seed, mixed, so that near seeds are as different as far ones.
    key: [u32; 2],
}

impl Sampler {
    /// The numbers of one seed.
    pub fn new(kind: SamplerKind, seed: u64) -> Self {
        // SplitMix64's output function (Steele, Lea, Flood 2014, "Fast Splittable Pseudorandom Number Generators").
        let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        Self { kind, key: [z as u32, (z >> 32) as u32] }
    }

    /// Stands for a pixel in [`Sampler::pair`]; different for all pixels of a picture up to 65536 by 65536.
    #[inline(always)]
    pub fn pixel_hash(&self, x: u32, y: u32) -> u32 {
        type Lane = <f32 as Real>::Bits;
        let h = mix(Lane::splat(y.rotate_left(16) ^ x ^ self.key[0]));
        mix(h + Lane::splat(self.key[1])).0
    }

    /// Two numbers in [0, 1) of 24 bits each, uniform on the unit square.
    #[inline(always)]
    pub fn pair<F: Real>(&self, pixel_hash: F::Bits, sample: F::Bits, dimension: F::Bits) -> (F, F) {
        match self.kind {
            SamplerKind::Sobol => {
                let key = SobolKey::new(pixel_hash, dimension);
                let i = key.shuffle(sample);
                (F::unit(scramble_reversed(i, key.x())), F::unit(scramble_reversed(second_dimension(i), key.y())))
            }
            SamplerKind::Independent => {
                let [x, y, _] = pcg3d([pixel_hash, sample, dimension]);
                (F::unit(x), F::unit(y))
            }
        }
    }

    /// The first number of [`Sampler::pair`], for two thirds of the work.
    #[inline(always)]
    pub fn one<F: Real>(&self, pixel_hash: F::Bits, sample: F::Bits, dimension: F::Bits) -> F {
        match self.kind {
            SamplerKind::Sobol => {
                let key = SobolKey::new(pixel_hash, dimension);
                F::unit(scramble_reversed(key.shuffle(sample), key.x()))
            }
            SamplerKind::Independent => F::unit(pcg3d([pixel_hash, sample, dimension])[0]),
        }
    }
}

/// What makes the sequence of one pixel and dimension unlike the others.
struct SobolKey<B>(B);

impl<B: Bits> SobolKey<B> {
    #[inline(always)]
    fn new(pixel_hash: B, dimension: B) -> Self {
        Self(mix(pixel_hash ^ (dimension * B::splat(0x9e37_79b9))))
    }
    /// The place in the sequence of sample `sample`: a permutation that keeps aligned runs of 2ᵏ together.
    #[inline(always)]
    fn shuffle(&self, sample: B) -> B {
        scramble_reversed(sample.reverse_bits(), self.0)
    }
    #[inline(always)]
    fn x(&self) -> B {
        let h = (self.0 ^ self.0 >> 15) * B::splat(0x2c1b_3c6d);
        h ^ h >> 12
    }
    #[inline(always)]
    fn y(&self) -> B {
        let h = (self.0 ^ self.0 >> 13) * B::splat(0x297a_2d39);
        h ^ h >> 15
    }
}

/// A permutation of the 32-bit numbers in which every bit depends on every other (Wellons 2018, "Prospecting for Hash
/// Functions", lowbias32).
#[inline(always)]
fn mix<B: Bits>(x: B) -> B {
    let x = (x ^ x >> 16) * B::splat(0x7feb_352d);
    let x = (x ^ x >> 15) * B::splat(0x846c_a68b);
    x ^ x >> 16
}

/// Owen's scramble of the number whose bits are `reversed` from last to first: each bit is flipped or not depending on
/// the more significant ones.
///
/// In the reversed number a bit may depend on lower ones only, which multiplication and addition see to (Burley 2020,
/// "Practical Hash-based Owen Scrambling", section 3; the constants of Vegdahl 2021, "Building a Better LK Hash").
#[inline(always)]
fn scramble_reversed<B: Bits>(reversed: B, seed: B) -> B {
    let x = reversed ^ (reversed * B::splat(0x3d20_adea));
    let x = (x + seed) * (seed >> 16 | B::splat(1));
    let x = x ^ (x * B::splat(0x0552_6c56));
    let x = x ^ (x * B::splat(0x53a2_2864));
    x.reverse_bits()
}

/// The reversed bits of the second Sobol' dimension's number `i`. (The first's are those of `i` itself.)
///
/// Its direction numbers are the rows of Pascal's triangle modulo 2: bit k of the result is the sum over j of
/// C(j, k)·bit j of i, and C(j, k) is odd exactly where the ones of k are among those of j (Lucas). So the sum over
/// supersets goes one bit of j at a time.
#[inline(always)]
fn second_dimension<B: Bits>(i: B) -> B {
    let i = i ^ (i >> 1 & B::splat(0x5555_5555));
    let i = i ^ (i >> 2 & B::splat(0x3333_3333));
    let i = i ^ (i >> 4 & B::splat(0x0f0f_0f0f));
    let i = i ^ (i >> 8 & B::splat(0x00ff_00ff));
    i ^ i >> 16
}

/// Three hashes of three numbers (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering", pcg3d).
#[inline(always)]
fn pcg3d<B: Bits>(v: [B; 3]) -> [B; 3] {
    let [mut x, mut y, mut z] = v.map(|v| v * B::splat(1_664_525) + B::splat(1_013_904_223));
    x = x + y * z;
    y = y + z * x;
    z = z + x * y;
    (x, y, z) = (x ^ x >> 16, y ^ y >> 16, z ^ z >> 16);
    x = x + y * z;
    y = y + z * x;
    z = z + x * y;
    [x, y, z]
}
