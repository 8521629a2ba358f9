//! Where light is looked for.

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
        Self { p, n: unpack(side), halved: side & 1 == 1 }
    }
}

/// A unit normal, and whether its side was chosen at even odds, in 32 bits (Cigolle et al. 2014, "A Survey of Efficient
/// Representations for Independent Unit Vectors", oct32 with a bit less). It comes back within 1.6e-4 rad.
#[inline]
pub fn pack(n: [f32; 3], halved: bool) -> u32 {
    let scale = 1.0 / (n[0].abs() + n[1].abs() + n[2].abs());
    let [x, y, z] = n.map(|v| v * scale);
    let folded = [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)];
    let [x, y] = if z < 0.0 { folded } else { [x, y] };
    let step = |v: f32| (v.mul_add(STEPS, STEPS + 0.5)) as u32;
    (step(x) << 16 | step(y) << 1 >> 1) & !1 | u32::from(halved)
}

#[inline]
fn unpack(side: u32) -> [f32; 3] {
    let number = |bits: u32| (bits as f32 - STEPS) * (1.0 / STEPS);
    let (x, y) = (number(side >> 16), number(side & 0xfffe));
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    let n = [x - fold.copysign(x), y - fold.copysign(y), z];
    let scale = 1.0 / (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
    n.map(|v| v * scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::warp::uniform_sphere;

    #[test]
    fn normals_come_back() {
        for i in 0..100_000_u32 {
            let u = (i as f32 / 100_000.0, (i as f32 * 0.618_034).fract());
            let n: [f32; 3] = uniform_sphere::<f32>(u).lane(0);
            let side = pack(n, i & 1 == 1);
            let back = Receiver::new([0.0; 3], side);
            let apart: f32 = (0..3).map(|k| (back.n[k] - n[k]).powi(2)).sum::<f32>().sqrt();
            assert!(apart < 1.6e-4, "{n:?} {back:?}");
            assert_eq!(back.halved, i & 1 == 1);
        }
        for axis in 0..6 {
            let n = std::array::from_fn(|k| if k == axis / 2 { [1.0, -1.0][axis % 2] } else { 0.0 });
            assert!((0..3).all(|k| (Receiver::new([0.0; 3], pack(n, false)).n[k] - n[k]).abs() < 1e-4));
        }
    }
}
