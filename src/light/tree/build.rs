//! The tree over lights, from lights.
//!
//! From the top down: halved where the sum over both halves of intensity, area of the box and extent of the cone of
//! normals is least, of twelve places along each axis (Conty Estevez, Kulla 2018, section 4.1). Then the halves of
//! halves become children of one node, those first that have most to gain.

use glam::{DVec3, Vec3};
use wide::f32x8;

use super::{LIGHT, LightTree, NOBODY, Node};
use crate::simd::LANES;

/// A light, as far as its choice is concerned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emitter {
    /// Lower corner of a box around it, m.
    pub lower: Vec3,
    /// Upper corner.
    pub upper: Vec3,
    /// Middle of the cone that holds its normals, of unit length.
    pub axis: Vec3,
    /// Cosine of the cone's half-angle: 1 for a flat light, −1 for one that shines all around.
    pub cos_cone: f32,
    /// Cosine of the angle to the nearest normal beyond which nothing is emitted: 0 for a surface, 1 where the cone
    /// holds all directions that it shines in.
    pub cos_edge: f32,
    /// The back shines as well.
    pub two_sided: bool,
    /// Along the normal, cd.
    pub intensity: f32,
}

/// Lights together.
#[derive(Clone, Copy)]
struct Cluster {
    lower: Vec3,
    upper: Vec3,
    axis: DVec3,
    /// Half-angles, rad.
    cone: f64,
    edge: f64,
    two_sided: bool,
    intensity: f64,
}

impl Cluster {
    fn of(light: &Emitter) -> Self {
        let angle = |cos: f32| f64::from(cos.clamp(-1.0, 1.0)).acos();
        Self {
            lower: light.lower,
            upper: light.upper,
            axis: light.axis.as_dvec3().normalize_or(DVec3::Y),
            cone: angle(light.cos_cone),
            edge: angle(light.cos_edge),
            two_sided: light.two_sided,
            intensity: light.intensity.into(),
        }
    }

    fn with(&self, other: &Self) -> Self {
        let (axis, cone) = both(self, other);
        Self {
            lower: self.lower.min(other.lower),
            upper: self.upper.max(other.upper),
            axis,
            cone,
            edge: self.edge.max(other.edge),
            two_sided: self.two_sided | other.two_sided,
            intensity: self.intensity + other.intensity,
        }
    }

    /// What it costs to have these together.
    fn cost(&self, longest: f32, extent: Vec3, axis: usize) -> f64 {
        let size = self.upper - self.lower;
        let area = f64::from(size.x * size.y + size.y * size.z + size.z * size.x);
        // Lights along a line, or in one place, still take room.
        let area = area.max(1e-12 * f64::from(longest).powi(2));
        // Thin slices say little.
        let regular = f64::from(longest / extent[axis].max(f32::MIN_POSITIVE));
        self.intensity * area * self.spread() * regular.min(1e6)
    }

    /// Measure of the directions that it shines in, by how much (Conty Estevez, Kulla 2018, equation 1).
    fn spread(&self) -> f64 {
        let pi = std::f64::consts::PI;
        let cone = if self.two_sided { pi } else { self.cone };
        let (sin, cos) = cone.sin_cos();
        let to = (cone + self.edge).min(pi);
        2.0 * pi * (1.0 - cos) + 0.5 * pi * (2.0 * (to - cone) * sin + cos - (cone - 2.0 * to).cos())
    }
}

/// The least cone around two.
fn both(a: &Cluster, b: &Cluster) -> (DVec3, f64) {
    let (wide, narrow) = if a.cone >= b.cone { (a, b) } else { (b, a) };
    let pi = std::f64::consts::PI;
    let between = wide.axis.dot(narrow.axis).clamp(-1.0, 1.0).acos();
    if (between + narrow.cone).min(pi) <= wide.cone {
        return (wide.axis, wide.cone);
    }
    let cone = 0.5 * (wide.cone + between + narrow.cone);
    let Some(turn) = wide.axis.cross(narrow.axis).try_normalize().filter(|_| cone < pi) else {
        return (wide.axis, pi);
    };
    let (sin, cos) = (cone - wide.cone).sin_cos();
    ((wide.axis * cos + turn.cross(wide.axis) * sin).normalize(), cone)
}

#[derive(Clone, Copy)]
struct Item {
    row: u32,
    cluster: Cluster,
}

impl Item {
    fn middle(&self) -> Vec3 {
        0.5 * self.cluster.lower + 0.5 * self.cluster.upper
    }
}

/// A node of two halves, each another or, marked, a light.
#[derive(Clone, Copy)]
struct Halves {
    children: [u32; 2],
    clusters: [Cluster; 2],
    /// Of both.
    cost: f64,
}

/// Places to halve at along an axis.
const BINS: usize = 12;

/// Items that one thread halves alone.
const SHARE: usize = 1 << 12;

/// Halvings after which lights are halved by number alone: they stand in a pattern that costs do not resolve.
const MOST_LEVELS: u32 = 64;

/// Halves items; of so many items as many nodes but one are written, the root first, which is `place`.
fn halve(items: &mut [Item], place: u32, into: &mut [Halves], level: u32) -> (u32, Cluster) {
    if let [one] = items {
        return (one.row | LIGHT, one.cluster);
    }
    let at = split(items, level);
    let (first, second) = items.split_at_mut(at);
    let (own, rest) = into.split_first_mut().expect("one less than items");
    let (of_first, of_second) = rest.split_at_mut(first.len() - 1);
    let places = [place + 1, place + first.len() as u32];
    let left = |first: &mut [Item], into: &mut [Halves]| halve(first, places[0], into, level + 1);
    let right = |second: &mut [Item], into: &mut [Halves]| halve(second, places[1], into, level + 1);
    let halves = if first.len() + second.len() > SHARE {
        let (a, b) = rayon::join(|| left(first, of_first), || right(second, of_second));
        [a, b]
    } else {
        [left(first, of_first), right(second, of_second)]
    };
    let all = halves[0].1.with(&halves[1].1);
    let size = all.upper - all.lower;
    let cost = all.cost(1.0, Vec3::ONE, 0) * f64::from(size.length().max(f32::MIN_POSITIVE));
    *own = Halves { children: halves.map(|half| half.0), clusters: halves.map(|half| half.1), cost };
    (place, all)
}

/// Puts items in order, and returns where to halve them.
fn split(items: &mut [Item], level: u32) -> usize {
    let count = items.len();
    let (mut lower, mut upper) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for item in &*items {
        (lower, upper) = (lower.min(item.middle()), upper.max(item.middle()));
    }
    let extent = upper - lower;
    let longest = extent.max_element();
    if count == 2 || longest <= 0.0 || !longest.is_finite() || level > MOST_LEVELS {
        let axis = extent.max_position();
        items.sort_unstable_by(|a, b| a.middle()[axis].total_cmp(&b.middle()[axis]).then(a.row.cmp(&b.row)));
        return count / 2;
    }
    let mut best = (f64::INFINITY, 0, 0);
    for axis in (0..3).filter(|&axis| extent[axis] > 0.0) {
        let mut bins: [Option<Cluster>; BINS] = [None; BINS];
        for item in &*items {
            let bin = &mut bins[bin(item, lower, extent, axis)];
            *bin = Some(bin.map_or(item.cluster, |bin| bin.with(&item.cluster)));
        }
        let add = |sum: &mut Option<Cluster>, bin: &Option<Cluster>| {
            *sum = match (&*sum, bin) {
                (Some(a), Some(b)) => Some(a.with(b)),
                (a, b) => a.or(*b),
            };
            Some(sum.map_or(0.0, |sum| sum.cost(longest, extent, axis)))
        };
        let above: Vec<f64> = bins.iter().rev().scan(None, add).collect();
        for (at, below) in bins.iter().scan(None, add).enumerate().take(BINS - 1) {
            let above = above[BINS - 2 - at];
            if below > 0.0 && above > 0.0 && below + above < best.0 {
                best = (below + above, axis, at);
            }
        }
    }
    let (cost, axis, at) = best;
    if cost == f64::INFINITY {
        let axis = extent.max_position();
        items.sort_unstable_by(|a, b| a.middle()[axis].total_cmp(&b.middle()[axis]).then(a.row.cmp(&b.row)));
        return count / 2;
    }
    // In place; the order within the halves depends on nothing but the items.
    let mut first = 0;
    for i in 0..count {
        if bin(&items[i], lower, extent, axis) <= at {
            items.swap(first, i);
            first += 1;
        }
    }
    first
}

fn bin(item: &Item, lower: Vec3, extent: Vec3, axis: usize) -> usize {
    let place = (item.middle()[axis] - lower[axis]) / extent[axis];
    ((place * BINS as f32) as usize).min(BINS - 1)
}

/// The tree over all lights.
pub(super) fn build(emitters: &[Emitter]) -> LightTree {
    let mut places = vec![NOBODY; emitters.len()];
    let mut items: Vec<Item> = (0..)
        .zip(emitters)
        .filter(|(_, light)| light.intensity > 0.0 && light.intensity.is_finite())
        .map(|(row, light)| Item { row, cluster: Cluster::of(light) })
        .collect();
    if let [] | [_] = items[..] {
        let alone = items.first().map(|item| item.row);
        let nodes = items.iter().map(|item| Node::of(&[(item.row | LIGHT, item.cluster)], NOBODY)).collect();
        places.iter_mut().zip(0..).filter(|(_, row)| Some(*row) == alone).for_each(|(place, _)| *place = 0);
        return LightTree { nodes, places, alone };
    }
    let nobody = Cluster {
        lower: Vec3::ZERO,
        upper: Vec3::ZERO,
        axis: DVec3::Y,
        cone: 0.0,
        edge: 0.0,
        two_sided: false,
        intensity: 0.0,
    };
    let mut halves = vec![Halves { children: [0; 2], clusters: [nobody; 2], cost: 0.0 }; items.len() - 1];
    halve(&mut items, 0, &mut halves, 0);
    let mut nodes: Vec<Node> = Vec::new();
    let mut pending = vec![(0_u32, NOBODY)];
    while let Some((root, parent)) = pending.pop() {
        let place = nodes.len() as u32;
        if parent != NOBODY {
            nodes[parent as usize / LANES].child[parent as usize % LANES] = place;
        }
        let children = open(&halves, root);
        let mut node = Node::of(&children, parent);
        for (lane, (child, _)) in (place * LANES as u32..).zip(&children) {
            if child & LIGHT != 0 {
                places[(child & !LIGHT) as usize] = lane;
            } else {
                pending.push((*child, lane));
            }
        }
        node.parent = parent;
        nodes.push(node);
    }
    LightTree { nodes, places, alone: None }
}

/// Up to eight parts of a subtree.
fn open(halves: &[Halves], root: u32) -> Vec<(u32, Cluster)> {
    let parts = |of: u32| {
        let Halves { children, clusters, .. } = halves[of as usize];
        [(children[0], clusters[0]), (children[1], clusters[1])]
    };
    let mut children = Vec::from(parts(root));
    while children.len() < LANES {
        let open = |&(place, (child, _)): &(usize, &(u32, Cluster))| {
            (child & LIGHT == 0).then(|| (halves[*child as usize].cost, std::cmp::Reverse(place)))
        };
        let Some((place, _)) = children
            .iter()
            .enumerate()
            .filter(|child| open(child).is_some())
            .max_by(|a, b| open(a).partial_cmp(&open(b)).unwrap_or(std::cmp::Ordering::Equal))
        else {
            break;
        };
        let (child, _) = children.swap_remove(place);
        children.extend(parts(child));
    }
    children
}

impl Node {
    fn of(children: &[(u32, Cluster)], parent: u32) -> Self {
        let number = |f: &dyn Fn(&Cluster) -> f32, none: f32| {
            f32x8::new(std::array::from_fn(|lane| children.get(lane).map_or(none, |(_, one)| f(one))))
        };
        let center = |axis: usize| number(&|one| (0.5 * one.lower + 0.5 * one.upper)[axis], 0.0);
        let axis = |axis: usize| number(&|one| one.axis[axis] as f32, 1.0);
        // What is too wide by rounding is safe.
        let widen = |angle: f64| (angle + 1e-6).min(std::f64::consts::PI);
        Self {
            center: [0, 1, 2].map(center),
            radius2: number(&|one| ((one.upper - one.lower) * (0.5 * (1.0 + 1e-6))).length_squared(), 0.0),
            axis: [0, 1, 2].map(axis),
            cos_cone: number(&|one| widen(one.cone).cos() as f32, 1.0),
            sin_cone: number(&|one| widen(one.cone).sin() as f32, 0.0),
            cos_edge: number(&|one| one.edge.cos() as f32, 1.0),
            two_sided: number(&|one| if one.two_sided { 1.0 } else { 0.0 }, 0.0),
            intensity: number(&|one| one.intensity as f32, 0.0),
            child: std::array::from_fn(|lane| children.get(lane).map_or(NOBODY, |(child, _)| *child)),
            parent,
        }
    }
}
