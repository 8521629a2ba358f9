//! The binary tree that the eight-wide one is collapsed from.
//!
//! obvhs pairs neighbours along a Morton curve (Meister, Bittner 2018, "Parallel Locally-Ordered Clustering for Bounding
//! Volume Hierarchy Construction") and then puts subtrees elsewhere where that lowers the surface area heuristic
//! (Meister, Bittner 2018, "Parallel Reinsertion for Bounding Volume Hierarchy Optimization").

use obvhs::{
    aabb::Aabb,
    bvh2::{Bvh2, node::Bvh2Node, reinsertion::ReinsertionOptimizer},
    ploc::{PlocBuilder, SortPrecision},
};
use rayon::prelude::*;

use super::bvh8::Quality;

/// Boxes that a thread takes at a time. Fixed, so that sums of parts do not depend on the number of threads.
pub(super) const SHARE: usize = 1 << 13;

/// Nodes over the boxes of `rows`, of which there is at least one; the root first, the children of a node side by side. A leaf is of one box, whose row is its
/// `first_index`. The boxes of nodes are a little too large.
pub(super) fn pair(boxes: &[Aabb], rows: &[u32], quality: Quality) -> Vec<Bvh2Node> {
    let mut builder = PlocBuilder::with_capacity(rows.len());
    let leaf = |(place, &row): (usize, &u32)| Bvh2Node::new(uneven(place, &boxes[row as usize]), 1, row);
    rows.par_iter().enumerate().with_min_len(SHARE).map(leaf).collect_into_vec(&mut builder.current_nodes);
    let parts = builder.current_nodes.par_chunks(SHARE);
    let parts: Vec<Aabb> = parts.map(|part| union(part.iter().map(|leaf| *leaf.aabb()))).collect();
    let whole = union(parts.into_iter());
    let mut tree = Bvh2::zeroed(rows.len());
    match quality {
        Quality::Fast => builder.build_ploc_from_leaves::<2, false>(&mut tree, whole, SortPrecision::U64, 0),
        Quality::Good => builder.build_ploc_from_leaves::<24, false>(&mut tree, whole, SortPrecision::U64, 2),
        Quality::Best => builder.build_ploc_from_leaves::<24, false>(&mut tree, whole, SortPrecision::U128, 2),
    }
    drop(builder);
    let mut optimizer = ReinsertionOptimizer::default();
    let ratios: &[f32] = match quality {
        Quality::Fast => &[0.01],
        Quality::Good => &[0.02, 0.06],
        Quality::Best => &[0.2, 0.4],
    };
    for &ratio in ratios {
        optimizer.run(&mut tree, ratio, None);
    }
    tree.nodes
}

/// The box around boxes.
pub(super) fn union(boxes: impl Iterator<Item = Aabb>) -> Aabb {
    boxes.fold(Aabb::empty(), |all, one| all.union(&one))
}

/// A box made a little larger, each in its own way.
///
/// obvhs pairs neighbours, and where all are equally near it takes n² time and n levels; the trees of regular meshes are
/// better for it too.
fn uneven(place: usize, one: &Aabb) -> Aabb {
    let mixed = (place as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let number = ((mixed ^ mixed >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f32 / 16_777_216.0;
    let more = one.diagonal() * (UNEVEN * number);
    Aabb::new(one.min - more, one.max + more)
}

/// By what part of their size boxes are made uneven for obvhs. Of 0, 1e-5, 1e-4 and 1e-3 this made rays among tori 15 %
/// faster than none, and those in an interior no slower, as ten times as much does.
const UNEVEN: f32 = 1e-4;
