//! Which of many lights: a tree that is walked down by what each part could bring to a point.
//!
//! Of each part is known where its lights are on average and how far they are spread, the same of their normals, and what they
//! shine with together; from these follows about what it brings. Bounds say only where it brings nothing (Conty Estevez, Kulla
//! 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting", have them say all, and so take each part for as
//! bright as its best placed light would be). A node has eight children, which are looked at at once: fewer steps than with
//! two, and each is chosen among more.

mod build;

use wide::{f32x4, f32x8, i8x32};

pub use self::build::Emitter;
use super::Receiver;
use crate::simd::{LANES, Mask, Real};

/// Marks a child as a light.
const LIGHT: u32 = 1 << 31;
/// There is no child.
const NOBODY: u32 = u32::MAX;

/// A cosine below which it is not said how much less is received or emitted, squared: rounding, and that of a packed normal.
const SLACK2: f32 = 1e-6;

/// Eight parts, each a subtree or a light.
#[derive(Clone, Debug, PartialEq)]
struct Node {
    /// Mean of the places of its lights by intensity, m.
    middle: [f32x8; 3],
    /// All is within so much of the middle, m.
    radius: f32x8,
    /// Mean square of the distance from the middle, by intensity, m².
    spread2: f32x8,
    /// Mean normal, of unit length.
    axis: [f32x8; 3],
    /// Length that the mean of the normals has: 1 where all are the same.
    bundled: f32x8,
    /// How far normals are from the mean, see [`Node::brings`].
    scattered: f32x8,
    /// Share of the light that leaves on both sides.
    two_sided: f32x8,
    /// Of the angle to the axis beyond which nothing is emitted.
    cos_edge: f32x8,
    sin_edge: f32x8,
    /// How far what shines may be off the plane through the middle across the axis, m.
    depth: f32x8,
    /// Of all lights together along their normals, cd.
    intensity: f32x8,
    /// Another node, a light, or nobody.
    child: [u32; LANES],
    /// Node above, and which of its children this is.
    parent: u32,
}

/// All lights that are somewhere.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightTree {
    /// The root first.
    nodes: Vec<Node>,
    /// Of each light: its node and which child it is; [`NOBODY`] for one that shines on nothing.
    places: Vec<u32>,
    /// The light, if it is alone: then there is nothing to walk.
    alone: Option<u32>,
}

/// One that was drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chosen {
    /// Its row.
    pub row: u32,
    /// With which probability.
    pub pmf: f32,
    /// What is left of the number that chose.
    pub rest: f64,
}

impl LightTree {
    /// Over lights, by rows; those without intensity are never drawn.
    pub fn new(emitters: &[Emitter]) -> Self {
        build::build(emitters)
    }

    /// True if there is nothing to be drawn.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The only one that can be drawn.
    pub fn alone(&self) -> Option<u32> {
        self.alone
    }

    /// How many can be drawn: none, one, or more, which counts as two.
    pub fn lights(&self) -> usize {
        match (self.alone, self.nodes.is_empty()) {
            (Some(_), _) => 1,
            (None, true) => 0,
            (None, false) => 2,
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..]) + size_of_val(&self.places[..])
    }

    /// About what all of them bring, lx, if nothing is in the way.
    #[inline]
    pub fn illuminance(&self, at: &Receiver) -> f32 {
        self.nodes.first().map_or(0.0, |root| all_of(sums(root.brings(at))).unwrap_or(0.0))
    }

    /// A light, with a probability by what it could bring.
    #[inline]
    pub fn sample(&self, at: &Receiver, u: f64) -> Option<Chosen> {
        self.sample_each(&[*at], [u], 1)[0]
    }

    /// As [`LightTree::sample`] for several places, those of `lanes`, a level of the tree at a time: while one waits for a
    /// quotient, the next goes on.
    #[inline]
    pub fn sample_each<const N: usize>(&self, at: &[Receiver; N], u: [f64; N], lanes: u32) -> [Option<Chosen>; N] {
        // The row is that of a node until a light is met.
        let first = Chosen { row: self.alone.unwrap_or(0), pmf: 1.0, rest: 0.0 };
        let here = |lane: usize| !self.nodes.is_empty() && lanes >> lane & 1 == 1;
        let mut chosen = std::array::from_fn(|lane| here(lane).then_some(Chosen { rest: u[lane], ..first }));
        if self.alone.is_some() || self.nodes.is_empty() {
            return chosen;
        }
        let mut walking = lanes;
        while walking != 0 {
            let mut left = walking;
            while left != 0 {
                let lane = left.trailing_zeros() as usize % N;
                left &= left - 1;
                chosen[lane] = chosen[lane].and_then(|walk| self.nodes[walk.row as usize].step(&at[lane], walk));
                let done = chosen[lane].is_none_or(|walk| walk.row & LIGHT != 0);
                walking &= !(u32::from(done) << lane);
                chosen[lane] = chosen[lane].map(|walk| Chosen { row: walk.row & !LIGHT, ..walk });
            }
        }
        chosen
    }

    /// Probability with which [`LightTree::sample`] draws a light.
    #[inline]
    pub fn pmf(&self, row: u32, at: &Receiver) -> f32 {
        if let Some(alone) = self.alone {
            return if alone == row { 1.0 } else { 0.0 };
        }
        let mut place = self.places[row as usize];
        let mut pmf = 1.0;
        while place != NOBODY {
            let (node, lane) = (&self.nodes[(place / LANES as u32) as usize], place as usize % LANES);
            let shares = node.brings(at);
            let Some(all) = all_of(sums(shares)) else { return 0.0 };
            pmf *= shares.to_array()[lane] / all;
            place = node.parent;
        }
        if self.places[row as usize] == NOBODY { 0.0 } else { pmf }
    }
}

/// From each lane's four neighbours to the lane, those `BY` below; zero where there are none.
#[inline(always)]
fn from_below<const BY: usize>(v: f32x8) -> f32x8 {
    const fn places(by: usize) -> ([u8; 32], [u8; 32]) {
        let (mut from, mut keep) = ([0; 32], [0; 32]);
        let mut i = 0;
        while i < 32 {
            if i % 16 >= 4 * by {
                (from[i], keep[i]) = ((i % 16 - 4 * by) as u8, u8::MAX);
            }
            i += 1;
        }
        (from, keep)
    }
    let (from, keep) = const { places(BY) };
    let moved: i8x32 = bytemuck::cast::<_, i8x32>(v).swizzle_half_relaxed(bytemuck::cast(from));
    bytemuck::cast(moved & bytemuck::cast::<_, i8x32>(keep))
}

/// Of each lane, the sum up to and with it.
#[inline(always)]
fn sums(shares: f32x8) -> f32x8 {
    let two = shares + from_below::<1>(shares);
    let [low, high]: [f32x4; 2] = bytemuck::cast(two + from_below::<2>(two));
    bytemuck::cast([low, high + f32x4::splat(low.to_array()[3])])
}

/// The sum of all lanes, if it is more than nothing and finite; as [`sums`] has it.
#[inline(always)]
fn all_of(sums: f32x8) -> Option<f32> {
    let all = sums.to_array()[LANES - 1];
    (all > 0.0 && all < f32::INFINITY).then_some(all)
}

impl Node {
    /// On to a child, whose row it gives; none if nothing is brought.
    #[inline(always)]
    fn step(&self, at: &Receiver, Chosen { pmf, rest, .. }: Chosen) -> Option<Chosen> {
        let shares = self.brings(at);
        let upto = sums(shares);
        let all = all_of(upto)?;
        let x = rest * f64::from(all);
        let some = Real::gt(shares, f32x8::ZERO).bits();
        let beyond = Real::gt(upto, f32x8::splat(x as f32)).bits() & some;
        // The last with a share, if rounding leads past it.
        let lane = if beyond == 0 { some.ilog2() } else { beyond.trailing_zeros() } as usize % LANES;
        let (share, upto) = (shares.to_array()[lane], upto.to_array()[lane]);
        let rest = ((x - f64::from(upto)) / f64::from(share) + 1.0).clamp(0.0, 1.0 - f64::EPSILON / 2.0);
        Some(Chosen { row: self.child[lane], pmf: pmf * (share / all), rest })
    }

    /// About what each child brings, lx; zero only where nothing does.
    ///
    /// The mean of the positive part of a number with mean a and variance b is near (a + √(a² + ¾b)) / 2: right for a single
    /// number, and for one spread evenly around zero. The cosines at both ends are such numbers, of places and normals
    /// spread around their means; each axis has a third of the spread.
    #[inline(always)]
    fn brings(&self, at: &Receiver) -> f32x8 {
        let [p, n] = [at.p, at.n].map(|v| v.map(f32x8::splat));
        let to: [f32x8; 3] = [0, 1, 2].map(|i| self.middle[i] - p[i]);
        let dot = |a: &[f32x8; 3], b: &[f32x8; 3]| Real::mul_add(a[0], b[0], Real::mul_add(a[1], b[1], a[2] * b[2]));
        let d2 = dot(&to, &to);
        let slack = d2 * f32x8::splat(SLACK2);
        let near = Real::mul_add(self.spread2, f32x8::splat(0.25), slack);
        let c = dot(&n, &to);
        let c2 = c * c;
        // Twice the cosine, times the distance.
        let received = c + (c2 + near).sqrt();
        let faced = Real::gt(c + self.radius, f32x8::ZERO) | Real::lt(c2, slack);
        let along = -dot(&self.axis, &to);
        let e = along * self.bundled;
        let size = Real::mul_add(e, e, Real::mul_add(self.scattered, d2, near)).sqrt();
        let emitted = Real::mul_add(self.two_sided, size - e, e + size);
        let across = (d2 - along * along).safe_sqrt();
        let shines = Real::le(across * self.cos_edge - along * self.sin_edge, self.depth);
        let m = Real::max(Real::mul_add(self.spread2, f32x8::splat(0.5), d2), f32x8::splat(1e-30));
        let per = f32x8::HALF / m;
        let brings = (self.intensity * per) * ((received * per) * emitted);
        brings.masked(faced & shines)
    }
}

#[cfg(test)]
mod tests;
