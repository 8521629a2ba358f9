//! Which of many lights: a tree that is walked down by what each part could bring to a point.
//!
//! Each part has a box, a cone that holds the normals of its lights, and what they shine with together; from these follows
//! a bound on what it brings (Conty Estevez, Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree
//! Splitting"). A node has eight children, which are looked at at once: fewer steps than with two, and each is chosen among
//! more. What a child brings is a matter of its own box, not of those it is halved with.

mod build;

use wide::f32x8;

pub use self::build::Emitter;
use super::Receiver;
use crate::simd::{LANES, Real};

/// Marks a child as a light.
const LIGHT: u32 = 1 << 31;
/// There is no child.
const NOBODY: u32 = u32::MAX;

/// What is added to a cosine before it counts as zero: rounding, and that of a packed normal.
const SLACK: f32 = 2e-4;

/// Eight parts, each a subtree or a light.
#[derive(Clone, Debug, PartialEq)]
struct Node {
    center: [f32x8; 3],
    /// Of the sphere around the box, squared.
    radius2: f32x8,
    /// Middle of the cone of normals.
    axis: [f32x8; 3],
    /// Of the half-angle of the cone of normals.
    cos_cone: f32x8,
    sin_cone: f32x8,
    /// Nothing is emitted farther than this from all normals.
    cos_edge: f32x8,
    /// 1 if the backs shine as well, else 0.
    two_sided: f32x8,
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
        self.nodes.first().map_or(0.0, |root| sum(&root.brings(at)))
    }

    /// A light, with a probability by what it could bring.
    #[inline]
    pub fn sample(&self, at: &Receiver, mut u: f64) -> Option<Chosen> {
        if let Some(row) = self.alone {
            return Some(Chosen { row, pmf: 1.0, rest: u });
        }
        let mut node = self.nodes.first()?;
        let mut pmf = 1.0;
        loop {
            let shares = node.brings(at);
            let all = sum(&shares);
            if !(all > 0.0 && all < f32::INFINITY) {
                return None;
            }
            let x = u * f64::from(all);
            let (mut before, mut lane) = (0.0, 0);
            let mut below = 0.0_f32;
            for (i, share) in shares.into_iter().enumerate() {
                // The last with a share, if rounding leads past it.
                if share > 0.0 && f64::from(below) <= x {
                    (before, lane) = (f64::from(below), i);
                }
                below += share;
            }
            pmf *= shares[lane] / all;
            u = ((x - before) / f64::from(shares[lane])).min(1.0 - f64::EPSILON / 2.0);
            let child = node.child[lane];
            if child & LIGHT != 0 {
                return Some(Chosen { row: child & !LIGHT, pmf, rest: u });
            }
            node = &self.nodes[child as usize];
        }
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
            let all = sum(&shares);
            if !(all > 0.0 && all < f32::INFINITY) {
                return 0.0;
            }
            pmf *= shares[lane] / all;
            place = node.parent;
        }
        if self.places[row as usize] == NOBODY { 0.0 } else { pmf }
    }
}

/// In a fixed order.
#[inline(always)]
fn sum(shares: &[f32; LANES]) -> f32 {
    shares.iter().sum()
}

/// cos(max(0, a − b)) and the sine.
#[inline(always)]
fn minus((cos_a, sin_a): (f32x8, f32x8), (cos_b, sin_b): (f32x8, f32x8)) -> (f32x8, f32x8) {
    let within = Real::gt(cos_a, cos_b);
    let cos = Real::select(within, f32x8::ONE, cos_a * cos_b + sin_a * sin_b);
    (cos, (sin_a * cos_b - cos_a * sin_b).masked(!within))
}

impl Node {
    /// A bound on what each child brings, lx, but for how near its parts may come.
    #[inline(always)]
    fn brings(&self, at: &Receiver) -> [f32; LANES] {
        let one = f32x8::ONE;
        let [p, n] = [at.p, at.n].map(|v| v.map(f32x8::splat));
        let to: [f32x8; 3] = [0, 1, 2].map(|i| self.center[i] - p[i]);
        let dot = |a: &[f32x8; 3], b: &[f32x8; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let d2 = dot(&to, &to);
        let inside = Real::le(d2, self.radius2);
        let d2_safe = Real::max(d2, f32x8::splat(f32::MIN_POSITIVE));
        let per_d = one / d2_safe.sqrt();
        // Half the angle that the sphere takes.
        let sin2 = self.radius2 / d2_safe;
        let spread = (Real::select(inside, -one, (one - sin2).safe_sqrt()), Real::safe_sqrt(sin2).masked(!inside));
        let with_sin = |cos: f32x8| {
            let cos = Real::max(Real::min(cos, one), -one);
            (cos, (one - cos * cos).safe_sqrt())
        };
        let cos = -dot(&self.axis, &to) * per_d;
        let cos = Real::select(Real::gt(self.two_sided, f32x8::ZERO), Real::abs(cos), cos);
        let (emitted, _) = minus(minus(with_sin(cos), (self.cos_cone, self.sin_cone)), spread);
        let cos = dot(&n, &to) * per_d;
        let (received, _) = minus(with_sin(cos), spread);
        let slack = f32x8::splat(SLACK);
        let shines = Real::ge(emitted + slack, self.cos_edge);
        let cosines = Real::max(emitted + slack, f32x8::ZERO) * Real::max(received + slack, f32x8::ZERO);
        let brings = self.intensity * cosines / Real::max(d2_safe, self.radius2);
        brings.masked(shines).to_array()
    }
}

#[cfg(test)]
mod tests;
