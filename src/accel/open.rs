//! Where the top level ends and the trees of meshes begin.

use bytemuck::zeroed_vec;
use glam::Vec3A;
use obvhs::aabb::Aabb;
use rayon::prelude::*;

use super::{
    InstanceRef,
    bvh8::{KIND, Node},
    merge::Merged,
    two_level::Part,
};
use crate::simd::LANES;

/// Instances that a thread looks at at a time.
pub(super) const SHARE: usize = 1 << 10;

/// What is seen of all instances by looking once at each.
#[derive(Default)]
pub(super) struct Seen {
    /// Of each, a box in the world and its whole mesh; both count for nothing if there is nothing in it.
    boxes: Vec<Aabb>,
    parts: Vec<Part>,
    /// Some have nothing in them.
    hollow: bool,
    /// Around everything.
    pub all: Aabb,
    /// Half the area of the largest box: of those that stand where they were made, and of others.
    largest: [f32; 2],
    /// How many stand where they were made.
    pub unmoved: usize,
    /// Rows of those that are in no box.
    pub unbounded: Vec<u32>,
    /// The most subtrees that a walk through one of the meshes puts off.
    pub deepest: usize,
    /// Some are given by a formula.
    pub shapes: bool,
    /// Some mesh is in another structure than the eight-wide tree.
    pub others: bool,
}

impl Seen {
    pub fn of(instances: &[InstanceRef]) -> Self {
        let mut boxes: Vec<Aabb> = zeroed_vec(instances.len());
        let mut parts = vec![Part { instance: 0, root: 0 }; instances.len()];
        let mut all = match instances.len() {
            ..=SHARE => Self::share(0, instances, &mut boxes, &mut parts),
            _ => {
                let places = boxes.par_chunks_mut(SHARE).zip(parts.par_chunks_mut(SHARE));
                let shares = instances.par_chunks(SHARE).enumerate().zip(places);
                let shares: Vec<Self> = shares
                    .map(|((share, instances), (boxes, parts))| Self::share(share * SHARE, instances, boxes, parts))
                    .collect();
                shares.into_iter().reduce(Self::and).unwrap_or_default()
            }
        };
        (all.boxes, all.parts) = (boxes, parts);
        all
    }

    /// Of those from a row on, whose boxes and parts are written.
    fn share(start: usize, instances: &[InstanceRef], boxes: &mut [Aabb], parts: &mut [Part]) -> Self {
        let mut seen = Self { all: Aabb::empty(), ..Self::default() };
        for (((bounds, part), row), one) in boxes.iter_mut().zip(parts).zip(start as u32..).zip(instances) {
            (*bounds, *part) = seen.look(row, one);
        }
        seen
    }

    /// With what was seen of those that follow.
    fn and(mut self, mut next: Self) -> Self {
        self.hollow |= next.hollow;
        self.all = self.all.union(&next.all);
        self.largest = [0, 1].map(|kind| self.largest[kind].max(next.largest[kind]));
        self.unmoved += next.unmoved;
        self.unbounded.append(&mut next.unbounded);
        self.deepest = self.deepest.max(next.deepest);
        self.shapes |= next.shapes;
        self.others |= next.others;
        self
    }

    /// Adds another, of the next row.
    pub fn add(&mut self, row: u32, one: &InstanceRef) {
        let (bounds, part) = self.look(row, one);
        self.boxes.push(bounds);
        self.parts.push(part);
    }

    fn look(&mut self, row: u32, one: &InstanceRef) -> (Aabb, Part) {
        let (blas, bounds) = (&*one.blas, world_bounds(one, &one.blas.bounds));
        let root = blas.root();
        self.hollow |= root.is_none();
        if bounds.valid() {
            self.all = self.all.union(&bounds);
            let largest = &mut self.largest[usize::from(!one.identity)];
            *largest = largest.max(bounds.half_area());
        }
        self.unmoved += usize::from(one.identity);
        if blas.is_unbounded() {
            self.unbounded.push(row);
        }
        self.deepest = self.deepest.max(blas.tree.stack);
        self.shapes |= blas.is_shape();
        self.others |= blas.other.is_some() && !blas.is_shape();
        (bounds, Part { instance: row, root: root.unwrap_or_default() })
    }
}

/// What the top level leads to, with boxes in the world: whole meshes, but of large ones the subtrees.
///
/// Meshes overlap, and the box of a large one says little of where its triangles are; opened, the top level can lead a
/// ray past what it would have had to enter (Benthin et al. 2017, "Improved Two-Level BVHs using Partial
/// Re-Braiding"). A part that has a transform of its own costs more to enter, so fewer of those are made.
pub(super) fn open(instances: &[InstanceRef], merged: &Merged, seen: Seen, scene_area: f32) -> (Vec<Part>, Vec<Aabb>) {
    let Seen { mut parts, boxes: mut bounds, hollow, largest, .. } = seen;
    if hollow || !merged.is_empty() {
        let kept: Vec<bool> = parts
            .iter()
            .map(|part| {
                instances[part.instance as usize].blas.root().is_some() && !merged.holds(part.instance as usize)
            })
            .collect();
        let [mut of_parts, mut of_bounds] = [kept.iter(), kept.iter()];
        parts.retain(|_| *of_parts.next().expect("one for each"));
        bounds.retain(|_| *of_bounds.next().expect("one for each"));
    }
    let least = [OPEN_IDENTITY, OPEN_PLACED].map(|share| share * scene_area);
    if parts.len() == 1 || (0..2).all(|kind| largest[kind] <= least[kind]) {
        return (parts, bounds);
    }
    let most = 4 * instances.len() + 2048;
    // Breadth first, so that the largest come before the budget is spent.
    let mut next = 0;
    while next < parts.len() && parts.len() + LANES <= most {
        let Part { instance: row, root } = parts[next];
        let instance = &instances[row as usize];
        if root & KIND != 0 || bounds[next].half_area() <= least[usize::from(!instance.identity)] {
            next += 1;
            continue;
        }
        let mut children = Node::at(instance.blas.tree.arena.granules(), root).boxes();
        let (first, child) = children.next().expect("a node has children");
        parts[next] = Part { instance: row, root: child };
        bounds[next] = world_bounds(instance, &first);
        for (local, root) in children {
            parts.push(Part { instance: row, root });
            bounds.push(world_bounds(instance, &local));
        }
        // The first child is looked at again in its turn: now.
    }
    (parts, bounds)
}

/// Parts larger than this share of the scene's area are opened, if their mesh stands where it was made …
const OPEN_IDENTITY: f32 = 1.0 / 1024.0;
/// … and if it has been placed.
const OPEN_PLACED: f32 = 1.0 / 16.0;

/// A box in the world that holds a box of an instance, grown by the rounding of its transform.
pub(super) fn world_bounds(instance: &InstanceRef, local: &Aabb) -> Aabb {
    if !local.valid() {
        return Aabb::empty();
    }
    if instance.identity {
        return *local;
    }
    let m = &instance.world_from_local;
    let [x, y, z, offset] = [0, 1, 2, 3].map(|column| Vec3A::new(m[column], m[4 + column], m[8 + column]));
    let (lo, hi) = (local.min, local.max);
    // Rounding keeps order, so that the least sum of products is the sum of the least, bit for bit that of a corner.
    let [lower, upper] = [Vec3A::min, Vec3A::max].map(|end: fn(Vec3A, Vec3A) -> Vec3A| {
        end(x * lo.x, x * hi.x) + end(y * lo.y, y * hi.y) + end(z * lo.z, z * hi.z) + offset
    });
    let size = lo.abs().max(hi.abs());
    let scale = x.abs() * size.x + y.abs() * size.y + z.abs() * size.z + offset.abs();
    // The transform there and the ray's way back round a few times each.
    let grow = 16.0 * f32::EPSILON * scale;
    Aabb::new(lower - grow, upper + grow)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::accel::{Accel, AccelKind, Blas, bvh8::bounds_of, family, tests::placed, way::transform_point};

    /// The box is that of the eight corners, each transformed as a ray's start is, and grown.
    #[test]
    fn boxes_in_the_world_hold_the_transformed_corners() {
        let mut random = crate::accel::tests::numbers(5);
        for _ in 0..2000 {
            let mut some = |size: f32| -> [f32; 12] { std::array::from_fn(|_| size * (random() - 0.5)) };
            let [a, b] = [some(10.0), some(1e3)];
            let corners = [[a[0], a[1], a[2]], [a[3], a[4], a[5]]];
            let local = bounds_of(corners);
            let instance =
                InstanceRef { world_from_local: b, identity: false, ..InstanceRef::unmoved(Arc::new(Blas::default())) };
            let bounds = world_bounds(&instance, &local);
            let corner = |i: usize| std::array::from_fn(|axis| [local.min, local.max][i >> axis & 1][axis]);
            let tight = bounds_of((0..8).map(|i| transform_point(&b, corner(i))));
            let grown = [tight.min - bounds.min, bounds.max - tight.max];
            let most = 16.0 * f32::EPSILON * 4.0 * 5000.0;
            assert!(grown.iter().all(|by| by.min_element() > 0.0 && by.max_element() < most), "{grown:?}");
        }
    }

    /// A floor of 20,000 triangles stands among small things: the top level sees its parts, but those whole.
    #[test]
    fn large_meshes_are_opened_and_small_ones_are_not() {
        let (floor, small) = (family::floor(1, 100), family::torus(24, 16));
        let [floor, small] = [floor, small].map(|triangles| Arc::new(Blas::build(&triangles)));
        let mut instances = vec![placed(&floor, 1.0, 0.0)];
        instances.extend((0..10).map(|i| placed(&small, 0.01, 0.1 * i as f32)));
        let parts = |instances: &[InstanceRef], row: u32| {
            let accel = Accel::build(instances.to_vec());
            accel.parts.iter().filter(|part| part.instance == row).count()
        };
        assert!(parts(&instances, 0) > 100, "{}", parts(&instances, 0));
        assert!((1..=10).all(|row| parts(&instances, row) == 1));
        // Placed elsewhere each part costs a transform, so that they are fewer.
        let moved = [placed(&floor, 1.0, 0.5), instances[1].clone()];
        assert!((8..100).contains(&parts(&moved, 0)), "{}", parts(&moved, 0));
        // Alone there is nothing that it could overlap.
        assert_eq!(parts(&instances[..1], 0), 1);
        // Other structures cannot be opened.
        let closed = Arc::new(Blas::build_as(AccelKind::Bvh2, &family::floor(1, 100)));
        assert_eq!(parts(&[placed(&closed, 1.0, 0.0), instances[1].clone()], 0), 1);
    }
}
