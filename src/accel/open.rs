//! Where the top level ends and the trees of meshes begin.

use obvhs::aabb::Aabb;

use super::{
    InstanceRef,
    bvh8::{KIND, Node, bounds_of},
    merge::Merged,
    two_level::{Part, transform_point},
};
use crate::simd::LANES;

/// What the top level leads to, with boxes in the world: whole meshes, but of large ones the subtrees.
///
/// Meshes overlap, and the box of a large one says little of where its triangles are; opened, the top level can lead a
/// ray past what it would have had to enter (Benthin et al. 2017, "Improved Two-Level BVHs using Partial
/// Re-Braiding"). A part that has a transform of its own costs more to enter, so fewer of those are made.
pub(super) fn open(
    instances: &[InstanceRef],
    merged: &Merged,
    boxes: Vec<Aabb>,
    scene_area: f32,
) -> (Vec<Part>, Vec<Aabb>) {
    let most = 4 * instances.len() + 2048;
    let (mut parts, mut bounds) = (Vec::new(), Vec::new());
    for (row, (instance, whole)) in instances.iter().zip(boxes).enumerate() {
        let Some(root) = instance.blas.root().filter(|_| !merged.holds(row)) else { continue };
        parts.push(Part { instance: row as u32, root });
        bounds.push(whole);
    }
    if parts.len() == 1 {
        return (parts, bounds);
    }
    // Breadth first, so that the largest come before the budget is spent.
    let mut next = 0;
    while next < parts.len() && parts.len() + LANES <= most {
        let Part { instance: row, root } = parts[next];
        let instance = &instances[row as usize];
        let least = scene_area * if instance.identity { OPEN_IDENTITY } else { OPEN_PLACED };
        if root & KIND != 0 || bounds[next].half_area() <= least {
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
    let (lo, hi) = (local.min.to_array(), local.max.to_array());
    let m = &instance.world_from_local;
    let corner =
        |i: u32| -> [f32; 3] { std::array::from_fn(|axis| if i >> axis & 1 == 0 { lo[axis] } else { hi[axis] }) };
    let mut bounds = bounds_of((0..8).map(|i| transform_point(m, corner(i))));
    for row in 0..3 {
        let size = |axis: usize| lo[axis].abs().max(hi[axis].abs());
        let scale = (0..3).map(|axis| m[row * 4 + axis].abs() * size(axis)).sum::<f32>() + m[row * 4 + 3].abs();
        // The transform there and the ray's way back round a few times each.
        let grow = 16.0 * f32::EPSILON * scale;
        bounds.min[row] -= grow;
        bounds.max[row] += grow;
    }
    bounds
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::accel::{Accel, AccelKind, Blas, family, tests::placed};

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
