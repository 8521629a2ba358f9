//! Where light is looked for.

use std::num::Wrapping;

use crate::simd::{Bits, LANES, Real, V3};

/// A point that light may arrive at, and the side of the surface there.
///
/// The same whether a light is drawn from there or found by a scattered ray that left there, bit for bit: so both know the
/// density of the other. A path carries its normal in 32 bits, so that both use what these say.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Receiver {
    /// Where rays start, m.
    pub p: [f32; 3],
    /// Unit normal on the side that rays leave to.
    pub n: [f32; 3],
    /// Light might as well have been looked for on the other side: one of the two was chosen at even odds.
    pub halved: bool,
}

/// Steps of a coordinate of a normal.
const STEPS: f32 = 32767.0;

impl Receiver {
    /// Of a point and a packed side.
    #[inline]
    pub fn new(p: [f32; 3], side: u32) -> Self {
        let n: V3<f32> = unpack(Wrapping(side));
        Self { p, n: [n.x, n.y, n.z], halved: side & 1 == 1 }
    }
}

/// A [`Receiver`] per lane, by columns.
#[derive(Clone, Copy, Debug, Default)]
pub struct Receivers {
    /// As of a [`Receiver`], axis by axis.
    pub p: [[f32; LANES]; 3],
    /// As of a [`Receiver`], axis by axis.
    pub n: [[f32; LANES]; 3],
    /// As of a [`Receiver`], lane by lane.
    pub halved: u32,
}

impl Receivers {
    /// Of points and packed sides.
    #[inline(always)]
    pub fn new<F: Real>(p: V3<F>, sides: F::Bits) -> Self {
        let columns = |v: V3<F>| {
            let mut columns = [[0.0; LANES]; 3];
            [v.x, v.y, v.z].into_iter().zip(&mut columns).for_each(|(v, column)| v.store(column));
            columns
        };
        let mut halved = 0;
        (0..F::LANES).for_each(|lane| halved |= (sides.lane(lane) & 1) << lane);
        Self { p: columns(p), n: columns(unpack(sides)), halved }
    }

    /// The one in a lane.
    #[inline(always)]
    pub fn lane(&self, lane: usize) -> Receiver {
        Receiver {
            p: [0, 1, 2].map(|axis: usize| self.p[axis][lane]),
            n: [0, 1, 2].map(|axis: usize| self.n[axis][lane]),
            halved: self.halved >> lane & 1 == 1,
        }
    }
}

impl From<Receiver> for Receivers {
    /// The same in all lanes.
    fn from(Receiver { p, n, halved }: Receiver) -> Self {
        Self { p: p.map(|x| [x; LANES]), n: n.map(|x| [x; LANES]), halved: if halved { 0xff } else { 0 } }
    }
}

/// Unit normals, and whether their sides were chosen at even odds, in 32 bits (Cigolle et al. 2014, "A Survey of Efficient
/// Representations for Independent Unit Vectors", oct32 with a bit less). They come back within 1.6e-4 rad.
#[inline(always)]
pub fn pack<F: Real>(n: V3<F>, halved: bool) -> F::Bits {
    let (one, zero) = (F::one(), F::zero());
    let n = n * (one / (n.x.abs() + n.y.abs() + n.z.abs()));
    let below = n.z.lt(zero);
    let x = F::select(below, (one - n.y.abs()).copysign(n.x), n.x);
    let y = F::select(below, (one - n.x.abs()).copysign(n.y), n.y);
    let step = |v: F| v.mul_add(F::splat(STEPS), F::splat(STEPS + 0.5)).truncate();
    step(x) << 16 | step(y) & F::Bits::splat(0xfffe) | F::Bits::splat(halved.into())
}

#[inline(always)]
fn unpack<F: Real>(side: F::Bits) -> V3<F> {
    let number = |bits: F::Bits| (F::whole(bits) - F::splat(STEPS)) * F::splat(1.0 / STEPS);
    let (x, y) = (number(side >> 16), number(side & F::Bits::splat(0xfffe)));
    let z = F::one() - x.abs() - y.abs();
    let fold = (-z).max(F::zero());
    V3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::packed;
    use crate::sampling::warp::uniform_sphere;

    #[test]
    fn normals_come_back() {
        for i in 0..100_000_u32 {
            let u = (i as f32 / 100_000.0, (i as f32 * 0.618_034).fract());
            let n: [f32; 3] = uniform_sphere::<f32>(u).lane(0);
            let side = packed(n, i & 1 == 1);
            let back = Receiver::new([0.0; 3], side);
            let apart: f32 = (0..3).map(|k| (back.n[k] - n[k]).powi(2)).sum::<f32>().sqrt();
            assert!(apart < 1.6e-4, "{n:?} {back:?}");
            assert_eq!(back.halved, i & 1 == 1);
        }
        for axis in 0..6 {
            let n = std::array::from_fn(|k| if k == axis / 2 { [1.0, -1.0][axis % 2] } else { 0.0 });
            assert!((0..3).all(|k| (Receiver::new([0.0; 3], packed(n, false)).n[k] - n[k]).abs() < 1e-4));
        }
    }
}
