//! The tree over lights, from lights.
//!
//! From the top down: halved where the sum over both halves of intensity, area of the box and spread of normals is least,
//! of twelve places along each axis (Conty Estevez, Kulla 2018, section 4.1). Then the halves of halves become children of
//! one node, those first that have most to gain.

use std::f64::consts::PI;

use glam::{DVec3, Vec3, Vec3A, Vec4};
use rayon::prelude::*;
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
    /// Mean of its points, m; a flat light lies in the plane through it.
    pub middle: Vec3,
    /// Mean square of the distance of its points from there, m².
    pub spread2: f32,
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

/// Squared length that normals would have of a light that shines all around as much as another along its normal: half the
/// root of a quarter of it is 1, see [`Node::brings`].
const ALL_AROUND: f64 = 16.0;

/// Lights together.
#[derive(Clone, Copy)]
struct Cluster {
    lower: Vec3,
    upper: Vec3,
    axis: DVec3,
    /// Half-angles, rad.
    cone: f64,
    edge: f64,
    intensity: f64,
    /// Means by intensity: of places, of the squared distance from there, of normals and their squared length, and of what leaves
    /// on both sides.
    middle: DVec3,
    spread2: f64,
    normal: DVec3,
    length2: f64,
    two_sided: f64,
    /// A light of one normal, in the plane across it through its middle.
    flat: bool,
}

impl Cluster {
    fn of(light: &Emitter) -> Self {
        let angle = |cos: f32| f64::from(cos.clamp(-1.0, 1.0)).acos();
        let axis = light.axis.as_dvec3().normalize_or(DVec3::Y);
        let flat = light.cos_cone >= 1.0 && light.cos_edge <= 0.0;
        Self {
            lower: light.lower,
            upper: light.upper,
            axis,
            cone: angle(light.cos_cone),
            edge: angle(light.cos_edge),
            intensity: light.intensity.into(),
            middle: light.middle.as_dvec3(),
            spread2: light.spread2.into(),
            normal: if flat { axis } else { DVec3::ZERO },
            length2: if light.cos_edge <= 0.0 { 1.0 } else { ALL_AROUND },
            two_sided: f64::from(u8::from(light.two_sided)),
            flat,
        }
    }

    fn with(&self, other: &Self) -> Self {
        let (axis, cone) = both(self, other);
        let share = other.intensity / (self.intensity + other.intensity);
        let of = |a: f64, b: f64| a + (b - a) * share;
        let middle = self.middle + (other.middle - self.middle) * share;
        Self {
            lower: self.lower.min(other.lower),
            upper: self.upper.max(other.upper),
            axis,
            cone,
            edge: self.edge.max(other.edge),
            intensity: self.intensity + other.intensity,
            middle,
            spread2: of(self.spread2, other.spread2)
                + of(self.middle.distance_squared(middle), other.middle.distance_squared(middle)),
            normal: self.normal + (other.normal - self.normal) * share,
            length2: of(self.length2, other.length2),
            two_sided: of(self.two_sided, other.two_sided),
            flat: false,
        }
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

/// A light, as far as it matters to where lights are halved.
#[derive(Clone, Copy)]
struct Item {
    lower: Vec3A,
    upper: Vec3A,
    /// Times intensity: the mean direction of normals, and 1.
    weight: Vec4,
    /// Some light leaves at right angles to the normals.
    wide: bool,
    row: u32,
}

impl Item {
    fn new(row: u32, light: &Emitter) -> Self {
        // Of directions even within a cone; those of both sides cancel.
        let bundled = if light.two_sided { 0.0 } else { 0.5 + 0.5 * light.cos_cone };
        Self {
            lower: light.lower.into(),
            upper: light.upper.into(),
            weight: (light.axis * bundled).extend(1.0) * light.intensity,
            wide: light.cos_edge < 0.5,
            row,
        }
    }

    fn with(self, other: Self) -> Self {
        Self {
            lower: self.lower.min(other.lower),
            upper: self.upper.max(other.upper),
            weight: self.weight + other.weight,
            wide: self.wide | other.wide,
            row: self.row,
        }
    }

    fn middle(&self) -> Vec3A {
        0.5 * self.lower + 0.5 * self.upper
    }

    /// What it costs to have these together: intensity, area of the box, and measure of the directions that it shines in (Conty
    /// Estevez, Kulla 2018, equation 1, of the cone in which even directions have that mean; cubed it is right to 2 %).
    fn cost(&self, least: f32) -> f32 {
        let size = self.upper - self.lower;
        // Lights along a line, or in one place, still take room.
        let area = (size.x * size.y + size.y * size.z + size.z * size.x).max(least);
        let intensity = self.weight.w;
        let bundled = (self.weight.truncate().length() / intensity).min(1.0);
        let spread = if self.wide { 4.0 - 3.0 * bundled.powi(3) } else { 4.0 - 3.99 * bundled };
        intensity * area * spread
    }
}

/// A node of two halves, each another or, marked, a light.
#[derive(Clone, Copy)]
struct Halves {
    children: [u32; 2],
    /// Of both.
    cluster: Cluster,
    cost: f32,
    lights: u32,
}

/// Places to halve at along an axis.
const BINS: usize = 12;

/// Items that one thread halves alone.
const SHARE: usize = 1 << 12;

/// Halvings after which lights are halved by number alone: they stand in a pattern that costs do not resolve.
const MOST_LEVELS: u32 = 64;

/// Halves items; of so many items as many nodes but one are written, the root first, which is `place`.
fn halve(
    emitters: &[Emitter],
    items: &mut [Item],
    place: u32,
    into: &mut [Halves],
    level: u32,
) -> (u32, Item, Cluster) {
    if let [one] = items {
        return (one.row | LIGHT, *one, Cluster::of(&emitters[one.row as usize]));
    }
    let (at, lights) = (split(items, level), items.len() as u32);
    let (first, second) = items.split_at_mut(at);
    let (own, rest) = into.split_first_mut().expect("one less than items");
    let (of_first, of_second) = rest.split_at_mut(first.len() - 1);
    let places = [place + 1, place + first.len() as u32];
    let left = |first: &mut [Item], into: &mut [Halves]| halve(emitters, first, places[0], into, level + 1);
    let right = |second: &mut [Item], into: &mut [Halves]| halve(emitters, second, places[1], into, level + 1);
    let [a, b] = if first.len() + second.len() > SHARE {
        <[_; 2]>::from(rayon::join(|| left(first, of_first), || right(second, of_second)))
    } else {
        [left(first, of_first), right(second, of_second)]
    };
    let (all, cluster) = (a.1.with(b.1), a.2.with(&b.2));
    let length = (all.upper - all.lower).length();
    let cost = all.cost(1e-12 * length * length) * length.max(f32::MIN_POSITIVE);
    *own = Halves { children: [a.0, b.0], cluster, cost, lights };
    (place, all, cluster)
}

/// Puts items in order, and returns where to halve them.
fn split(items: &mut [Item], level: u32) -> usize {
    let count = items.len();
    let (mut lower, mut upper) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
    for item in &*items {
        (lower, upper) = (lower.min(item.middle()), upper.max(item.middle()));
    }
    let extent = upper - lower;
    let longest = extent.max_element();
    let by_number = |items: &mut [Item]| {
        let axis = extent.max_position();
        items.sort_unstable_by(|a, b| a.middle()[axis].total_cmp(&b.middle()[axis]).then(a.row.cmp(&b.row)));
        count / 2
    };
    if count == 2 || longest <= 0.0 || !longest.is_finite() || level > MOST_LEVELS {
        return by_number(items);
    }
    let bin = |item: &Item| {
        let place = (item.middle() - lower) * (BINS as f32 / extent.max(Vec3A::splat(f32::MIN_POSITIVE)));
        place.to_array().map(|place| (place as usize).min(BINS - 1))
    };
    let mut bins: [[Option<Item>; BINS]; 3] = [[None; BINS]; 3];
    for item in &*items {
        for (bins, place) in bins.iter_mut().zip(bin(item)) {
            bins[place] = Some(bins[place].map_or(*item, |bin| bin.with(*item)));
        }
    }
    let mut best = (f32::INFINITY, 0, 0);
    for axis in (0..3).filter(|&axis| extent[axis] > 0.0) {
        // Thin slices say little.
        let regular = (longest / extent[axis]).min(1e6);
        // What comes before a place and what after, where something is added to both.
        let mut above = [f32::INFINITY; BINS];
        let mut sum: Option<Item> = None;
        let least = 1e-12 * longest * longest;
        for place in (1..BINS).rev() {
            let Some(bin) = bins[axis][place] else { continue };
            let with = sum.map_or(bin, |sum| sum.with(bin));
            (sum, above[place]) = (Some(with), with.cost(least));
        }
        let mut sum: Option<Item> = None;
        let mut below = f32::INFINITY;
        for place in 0..BINS {
            let Some(bin) = bins[axis][place] else { continue };
            let cost = (below + above[place]) * regular;
            if cost < best.0 {
                best = (cost, axis, place);
            }
            let with = sum.map_or(bin, |sum| sum.with(bin));
            (sum, below) = (Some(with), with.cost(least));
        }
    }
    let (cost, axis, at) = best;
    if cost == f32::INFINITY {
        return by_number(items);
    }
    // In place; the order within the halves depends on nothing but the items.
    let mut first = 0;
    for i in 0..count {
        if bin(&items[i])[axis] < at {
            items.swap(first, i);
            first += 1;
        }
    }
    first
}

/// The tree over all lights.
pub(super) fn build(emitters: &[Emitter]) -> LightTree {
    let mut places = vec![NOBODY; emitters.len()];
    let mut items: Vec<Item> = (0..)
        .zip(emitters)
        .filter(|(_, light)| light.intensity > 0.0 && light.intensity.is_finite())
        .map(|(row, light)| Item::new(row, light))
        .collect();
    if let [] | [_] = items[..] {
        let alone = items.first().map(|item| item.row);
        let of = |row: u32| Node::of(&[(row | LIGHT, Cluster::of(&emitters[row as usize]))], NOBODY);
        let nodes = alone.into_iter().map(of).collect();
        places.iter_mut().zip(0..).filter(|(_, row)| Some(*row) == alone).for_each(|(place, _)| *place = 0);
        return LightTree { nodes, places, alone };
    }
    let empty =
        Halves { children: [0; 2], cluster: Cluster::of(&emitters[items[0].row as usize]), cost: 0.0, lights: 0 };
    let mut halves = vec![empty; items.len() - 1];
    halve(emitters, &mut items, 0, &mut halves, 0);
    // Of each node the halves or lights that become its children, and its parent; of each of the halves the node.
    let mut links: Vec<([u32; LANES], u32)> = Vec::new();
    let mut node_of = vec![NOBODY; halves.len()];
    let mut pending = vec![(0_u32, NOBODY)];
    while let Some((root, parent)) = pending.pop() {
        let place = links.len() as u32;
        node_of[root as usize] = place;
        let children = open(&halves, root);
        for (lane, child) in (place * LANES as u32..).zip(children).filter(|(_, child)| *child != NOBODY) {
            if child & LIGHT != 0 {
                places[(child & !LIGHT) as usize] = lane;
            } else {
                pending.push((child, lane));
            }
        }
        links.push((children, parent));
    }
    let node = |(children, parent): &([u32; LANES], u32)| {
        let of = |child: u32| match child & LIGHT {
            0 => (node_of[child as usize], halves[child as usize].cluster),
            _ => (child, Cluster::of(&emitters[(child & !LIGHT) as usize])),
        };
        let count = children.iter().take_while(|&&child| child != NOBODY).count();
        let clusters: [_; LANES] = std::array::from_fn(|lane| of(children[lane.min(count - 1)]));
        Node::of(&clusters[..count], *parent)
    };
    LightTree { nodes: links.par_iter().map(node).collect(), places, alone: None }
}

/// Up to eight parts of a subtree: of large ones those first that have most to gain, then such of few lights as fit in whole, so
/// that hardly any node is left with two or three.
fn open(halves: &[Halves], root: u32) -> [u32; LANES] {
    let mut children = [NOBODY; LANES];
    [children[0], children[1]] = halves[root as usize].children;
    let mut count = 2;
    loop {
        let mut dearest: Option<(bool, f32, usize)> = None;
        for (place, &child) in children[..count].iter().enumerate().filter(|(_, child)| *child & LIGHT == 0) {
            let Halves { lights, cost, .. } = halves[child as usize];
            let large = lights as usize > LANES;
            let fits = count < LANES && (large || count - 1 + lights as usize <= LANES);
            if fits && dearest.is_none_or(|best| (large, cost) > (best.0, best.1)) {
                dearest = Some((large, cost, place));
            }
        }
        let Some((_, _, place)) = dearest else { return children };
        [children[place], children[count]] = halves[children[place] as usize].children;
        count += 1;
    }
}

/// A value for each child, another where there is none.
fn each<T: Copy>(children: &[(u32, Cluster)], none: T, f: &dyn Fn(&Cluster) -> T) -> [T; LANES] {
    std::array::from_fn(|lane| children.get(lane).map_or(none, |(_, one)| f(one)))
}

impl Node {
    /// Of up to eight children.
    fn of(children: &[(u32, Cluster)], parent: u32) -> Self {
        // Around the mean of the normals.
        let axis: [DVec3; LANES] = each(children, DVec3::ZERO, &|one| one.normal.try_normalize().unwrap_or(one.axis));
        let number = |f: &dyn Fn(&Cluster) -> f64| f32x8::new(each(children, 0.0, f).map(|x| x as f32));
        let radius = |one: &Cluster| {
            let far = (one.lower.as_dvec3() - one.middle).abs().max((one.upper.as_dvec3() - one.middle).abs());
            far.length() * (1.0 + 1e-6)
        };
        let edge: [f64; LANES] = std::array::from_fn(|lane| {
            let Some((_, one)) = children.get(lane) else { return 0.0 };
            let turned = if one.flat { 0.0 } else { axis[lane].dot(one.axis).clamp(-1.0, 1.0).acos() };
            let edge = if one.two_sided > 0.0 { PI } else { one.cone + one.edge + turned };
            // What is too wide by rounding is safe.
            (edge + 5e-4).min(PI)
        });
        let same = |f: &dyn Fn(usize) -> f64| f32x8::new(std::array::from_fn(|lane| f(lane) as f32));
        Self {
            middle: [0, 1, 2].map(|i| number(&|one| one.middle[i])),
            radius: number(&radius),
            spread2: number(&|one| one.spread2),
            axis: [0, 1, 2].map(|i| same(&|lane| axis[lane][i])),
            bundled: number(&|one| one.normal.length().min(1.0)),
            scattered: number(&|one| (0.25 * (one.length2 - one.normal.length_squared())).max(1e-6)),
            two_sided: number(&|one| one.two_sided),
            cos_edge: same(&|lane| edge[lane].cos()),
            sin_edge: same(&|lane| edge[lane].sin()),
            depth: number(&|one| if one.flat { 0.0 } else { radius(one) }),
            intensity: number(&|one| one.intensity),
            child: std::array::from_fn(|lane| children.get(lane).map_or(NOBODY, |(child, _)| *child)),
            parent,
        }
    }
}
