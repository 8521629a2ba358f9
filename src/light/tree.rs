//! Which of many lights: a tree that is walked down by what each part could bring to a point.
//!
//! Of each part is known where its lights are on average and how far they are spread, the same of their normals, and what they
//! shine with together; from these follows about what it brings. Bounds say only where it brings nothing (Conty Estevez, Kulla
//! 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting", have them say all, and so take each part for as
//! bright as its best placed light would be). A node has eight children, which are looked at at once: fewer steps than with
//! two, and each is chosen among more.

mod build;

use wide::f32x8;

pub use self::build::Emitter;
use super::{Receiver, Receivers};
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

/// One drawn for each lane.
#[derive(Clone, Copy, Debug)]
pub struct Choices {
    /// As of [`Chosen`].
    pub row: [u32; LANES],
    /// As of [`Chosen`].
    pub pmf: f32x8,
    /// As of [`Chosen`].
    pub rest: [f64; LANES],
    /// Lanes that have one.
    pub lanes: u32,
}

impl Choices {
    /// The one in a lane.
    #[inline]
    pub fn lane(&self, lane: usize) -> Option<Chosen> {
        let chosen = Chosen { row: self.row[lane], pmf: self.pmf.to_array()[lane], rest: self.rest[lane] };
        (self.lanes >> lane & 1 == 1).then_some(chosen)
    }
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
        self.nodes.first().map_or(0.0, |root| all_of(root.brings(at)).unwrap_or(0.0))
    }

    /// A light, with a probability by what it could bring.
    #[inline]
    pub fn sample(&self, at: &Receiver, u: f64) -> Option<Chosen> {
        self.sample_each(&(*at).into(), [u; LANES], 1).lane(0)
    }

    /// As [`LightTree::sample`] for several places, those of `lanes`, a level of the tree at a time: of each lane's node
    /// all children are looked at together, then of all lanes one is chosen together.
    #[inline]
    pub fn sample_each(&self, at: &Receivers, u: [f64; LANES], lanes: u32) -> Choices {
        let row = [self.alone.unwrap_or(0); LANES];
        let mut chosen = Choices { row, pmf: f32x8::ONE, rest: u, lanes: if self.is_empty() { 0 } else { lanes } };
        let mut walking = if self.alone.is_some() { 0 } else { chosen.lanes };
        while walking != 0 {
            let mut shares = [f32x8::ZERO; LANES];
            let mut children = [&self.nodes[0].child; LANES];
            for lane in 0..LANES {
                if walking >> lane & 1 == 1 {
                    // The row is that of a node until a light is met.
                    let node = &self.nodes[chosen.row[lane] as usize];
                    shares[lane] = node.brings(&at.lane(lane));
                    children[lane] = &node.child;
                }
            }
            let (child, stays) = chosen.step(&f32x8::transpose(shares), walking);
            chosen.lanes &= !walking | stays;
            walking &= stays;
            for lane in 0..LANES {
                if walking >> lane & 1 == 1 {
                    let row = children[lane][child[lane] as usize % LANES];
                    chosen.row[lane] = row & !LIGHT;
                    walking &= !(row >> 31 << lane);
                }
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
            let Some(all) = all_of(shares) else { return 0.0 };
            pmf *= shares.to_array()[lane] / all;
            place = node.parent;
        }
        if self.places[row as usize] == NOBODY { 0.0 } else { pmf }
    }
}

/// The sum of the shares of all children, one after the other, if it is more than nothing and finite.
#[inline(always)]
fn all_of(shares: f32x8) -> Option<f32> {
    let [first, rest @ ..] = shares.to_array();
    let all = rest.into_iter().fold(first, |sum, share| sum + share);
    (all > 0.0 && all < f32::INFINITY).then_some(all)
}

impl Choices {
    /// Chooses a child of each node by the children's shares, one vector for each child, and says which, and of which of the
    /// `walking` lanes; nobody is chosen where nothing is brought.
    #[inline(always)]
    fn step(&mut self, shares: &[f32x8; LANES], walking: u32) -> ([u32; LANES], u32) {
        let mut upto = *shares;
        (1..LANES).for_each(|child| upto[child] = upto[child - 1] + upto[child]);
        let all = upto[LANES - 1];
        let (mut x, mut rounded, wide) = ([0.0; LANES], [0.0; LANES], all.to_array());
        for lane in 0..LANES {
            x[lane] = self.rest[lane] * f64::from(wide[lane]);
            rounded[lane] = x[lane] as f32;
        }
        // Rounding must not lead past the last with a share.
        let below = Real::min(f32x8::new(rounded), all * f32x8::splat(1.0 - f32::EPSILON));
        let (mut child, mut share, mut end) = (f32x8::splat((LANES - 1) as f32), shares[LANES - 1], all);
        for earlier in (0..LANES - 1).rev() {
            let beyond = Real::gt(upto[earlier], below);
            child = Real::select(beyond, f32x8::splat(earlier as f32), child);
            share = Real::select(beyond, shares[earlier], share);
            end = Real::select(beyond, upto[earlier], end);
        }
        let some = Real::gt(share, f32x8::ZERO) & Real::lt(all, f32x8::splat(f32::INFINITY));
        let stays = walking & some.bits();
        let chosen = <f32x8 as Real>::Mask::from_bits(stays);
        self.pmf = Real::select(chosen, self.pmf * (share / all), self.pmf);
        let (share, end) = (share.masked(chosen).to_array(), end.to_array());
        for lane in 0..LANES {
            let share = f64::from(share[lane]);
            let rest = ((x[lane] - f64::from(end[lane])) / share + 1.0).clamp(0.0, 1.0 - f64::EPSILON / 2.0);
            self.rest[lane] = if share > 0.0 { rest } else { self.rest[lane] };
        }
        (bytemuck::cast(child.fast_trunc_int()), stays)
    }
}

impl Node {
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
