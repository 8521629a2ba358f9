//! A tree over triangles that have moved: the same nodes and leaves, around where the triangles are now.
//!
//! Boxes go up the tree. It is divided into subtrees that are gone through side by side, and then what is above them.

use glam::Vec3A;
use obvhs::aabb::Aabb;
use rayon::prelude::*;

use super::{
    arena::Granule,
    bvh8::{Bvh8, KIND, NODE},
    collapse::leaf_cost,
    leaf::{Block, QUAD},
};
use crate::simd::LANES;

/// What is gone through by one thread, in granules, about: some thousand triangles.
const TASK: usize = 1 << 14;

/// A node with all below it: part of an arena.
struct Subtree<'a> {
    /// Where it starts.
    place: usize,
    granules: &'a mut [Granule],
}

impl Bvh8 {
    /// Writes all leaves and boxes again, and returns the box around everything. `leaf` does so with a leaf at the front of some granules, given the bit that says
    /// which kind it is, and returns its box.
    pub fn refit(&mut self, leaf: &(impl Fn(&mut [Granule], u32) -> Aabb + Sync)) -> Aabb {
        let Some(root) = self.root else { return Aabb::empty() };
        let arena = self.arena.granules_mut();
        if root & KIND != 0 {
            let block = &mut arena[(root & !KIND & !QUAD) as usize..];
            let bounds = leaf(block, root & QUAD);
            self.cost = cost_of_leaf(block, root & QUAD, &bounds);
            return bounds;
        }
        let (mut above, mut tasks) = (Vec::new(), Vec::new());
        let mut large = vec![Subtree { place: root as usize, granules: &mut *arena }];
        while let Some(subtree) = large.pop() {
            if subtree.granules.len() < TASK {
                tasks.push(subtree);
            } else {
                above.push(subtree.place);
                divide(subtree, &mut large);
            }
        }
        let refit = |Subtree { place, granules }: Subtree| {
            let nodes = nodes(granules, place);
            nodes.into_iter().rev().map(|node| f64::from(renew(granules, place, node, leaf))).sum::<f64>()
        };
        let costs: Vec<f64> = tasks.into_par_iter().map(refit).collect();
        let above = above.into_iter().rev().map(|node| f64::from(renew(arena, 0, node, leaf)));
        self.cost = (costs.into_iter().sum::<f64>() + above.sum::<f64>()) as f32;
        around(arena, root as usize)
    }
}

/// Children that there are: lanes and references.
fn children(granules: &[Granule], node: usize) -> impl DoubleEndedIterator<Item = (usize, u32)> + use<> {
    let (lower, upper) = (granules[node].values(), granules[node + 1].values());
    let references = granules[node + NODE - 1].0;
    // Missing children are boxes of which the lower side is above the upper one.
    (0..LANES).filter(move |&lane| lower[lane] <= upper[lane]).map(move |lane| (lane, references[lane]))
}

/// Adds what is below a node, child by child. A child's memory ends where that of another begins.
fn divide<'a>(Subtree { place, granules }: Subtree<'a>, into: &mut Vec<Subtree<'a>>) {
    let inner = children(granules, 0).map(|(_, child)| child).filter(|child| child & KIND == 0);
    let mut places: Vec<usize> = inner.map(|child| child as usize).collect();
    places.sort_unstable();
    let mut rest = granules;
    for child in places.into_iter().rev() {
        let (others, own) = rest.split_at_mut(child - place);
        into.push(Subtree { place: child, granules: own });
        rest = others;
    }
}

/// Nodes of a subtree that starts at `place`, parents before children.
fn nodes(granules: &[Granule], place: usize) -> Vec<usize> {
    let (mut all, mut pending) = (Vec::new(), vec![place]);
    while let Some(node) = pending.pop() {
        all.push(node);
        let inner = children(granules, node - place).map(|(_, child)| child).filter(|child| child & KIND == 0);
        pending.extend(inner.map(|child| child as usize));
    }
    all
}

/// Writes the boxes of a node, of which the inner children have been renewed, and returns its cost and that of its leaves.
/// The granules given start at `start` of the arena.
fn renew(granules: &mut [Granule], start: usize, node: usize, leaf: &impl Fn(&mut [Granule], u32) -> Aabb) -> f32 {
    let node = node - start;
    let mut planes = [[[f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]]; 3];
    let (mut whole, mut cost) = (Aabb::empty(), 0.0);
    for (lane, child) in children(granules, node) {
        let place = (child & !KIND & !QUAD) as usize - start;
        let bounds = if child & KIND == 0 {
            around(granules, place)
        } else {
            let block = &mut granules[place..];
            let bounds = leaf(block, child & QUAD);
            cost += cost_of_leaf(block, child & QUAD, &bounds);
            bounds
        };
        for (axis, planes) in planes.iter_mut().enumerate() {
            (planes[0][lane], planes[1][lane]) = (bounds.min[axis], bounds.max[axis]);
        }
        whole = whole.union(&bounds);
    }
    for (granule, plane) in granules[node..].iter_mut().zip(planes.as_flattened()) {
        *granule = Granule::of(*plane);
    }
    cost + whole.half_area()
}

/// The box around a node's boxes.
fn around(granules: &[Granule], node: usize) -> Aabb {
    let side = |plane: usize, of: fn(f32, f32) -> f32| {
        Vec3A::from_array([0, 2, 4].map(|axis| {
            let [first, others @ ..] = granules[node + axis + plane].values();
            others.into_iter().fold(first, of)
        }))
    };
    Aabb::new(side(0, f32::min), side(1, f32::max))
}

fn cost_of_leaf(block: &[Granule], kind: u32, bounds: &Aabb) -> f32 {
    leaf_cost(Block::at(block, kind).marked_rows().count() as u32) * bounds.half_area()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use crate::accel::{AccelKind, Blas, Brute, Nearest, Structure, family, tests::sieved};

    type Triangles = Vec<[[f32; 3]; 3]>;

    /// Every corner somewhere else by up to `far`, corners in the same place alike.
    fn moved(triangles: &Triangles, far: f32) -> Triangles {
        let wave = |p: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|axis| p[axis] + far * (3.0 * p[(axis + 1) % 3] + 5.0 * p[(axis + 2) % 3] + 0.3).sin())
        };
        triangles.iter().map(|corners| corners.map(wave)).collect()
    }

    /// All hits of a tree are those of brute force, bit for bit, and its box is that of a tree built there.
    #[track_caller]
    fn check(tree: &Blas, triangles: &Triangles) {
        let truth = Brute::build(triangles);
        let mut hits = 0;
        for ray in family::rays(triangles, 3000, 5) {
            let [want, got] = [Nearest::none(f32::INFINITY); 2];
            let (mut want, mut got) = (want, got);
            truth.nearest(&ray, &mut want, |_, _| true, &mut ());
            tree.nearest(&ray, &mut got, |_, _| true, &mut ());
            assert_eq!(got, want);
            let occluded = tree.occluded(&ray, f32::INFINITY, |_, _| true, &mut ());
            assert_eq!(occluded, want.t < f32::INFINITY);
            hits += u32::from(occluded);
        }
        assert!(hits > 300, "{hits}");
        assert_eq!(tree.bounds(), Blas::build(triangles).bounds());
    }

    #[test]
    fn a_refitted_tree_finds_what_brute_force_finds() {
        // Enough for several subtrees, one node, one leaf of either kind, one triangle.
        for triangles in [
            family::soup(9000, 0.2, 1),
            family::torus(60, 50),
            family::torus(4, 4),
            family::soup(7, 0.9, 2),
            family::soup(3, 0.9, 2),
            family::soup(1, 1.0, 4),
        ] {
            // What is known of the triangles' opacity stays.
            let mut tree = Arc::unwrap_or_clone(sieved(&triangles));
            let before = tree.clone();
            for far in [0.05, 0.4] {
                let there = moved(&triangles, far);
                assert!(tree.refit(&there));
                check(&tree, &there);
                assert!(tree.tree.arena.granules() != before.tree.arena.granules());
            }
            assert!(tree.refit(&triangles));
            check(&tree, &triangles);
            assert!(tree.tree.arena.granules() == before.tree.arena.granules(), "there and back");
            assert!((tree.cost() / before.cost() - 1.0).abs() < 1e-4, "{} {}", tree.cost(), before.cost());
        }
        let mut nothing = Blas::build(&[]);
        assert!(nothing.refit(&[]) && nothing.cost() == 0.0);
    }

    /// A triangle that gets or loses an area would be missing or too many; nothing is changed by the attempt.
    #[test]
    fn a_refit_is_refused_where_the_tree_holds_other_triangles() {
        let mut flat = family::soup(500, 0.2, 1);
        (flat[7][1], flat[400][2]) = (flat[7][0], flat[400][0]);
        let mut tree = Blas::build(&flat);
        let before = tree.clone();
        let changed = |row: usize, corner: usize, to: [f32; 3]| {
            let mut other = moved(&flat, 0.1);
            other[row][corner] = to;
            other
        };
        let gained = changed(7, 1, [5.0; 3]);
        let lost = changed(8, 1, moved(&flat, 0.1)[8][0]);
        let mut exchanged = lost.clone();
        exchanged[7][1] = [5.0; 3];
        for other in [gained, lost, exchanged, flat[1..].to_vec(), [flat.clone(), flat[..1].to_vec()].concat()] {
            assert!(!tree.refit(&other));
            assert!(tree.tree.arena.granules() == before.tree.arena.granules() && tree.bounds() == before.bounds());
        }
        assert!(tree.refit(&moved(&flat, 0.1)));
        check(&tree, &moved(&flat, 0.1));
        assert!(!Blas::build_as(AccelKind::Bvh2, &flat).refit(&flat));
    }

    /// Triangles that have changed places are found, though by a far longer way, and the cost says so.
    #[test]
    fn a_shuffled_mesh_is_found_at_a_cost() {
        let triangles = family::soup(2000, 0.05, 1);
        let mut tree = Blas::build(&triangles);
        let built = tree.cost();
        let mut shuffled = triangles.clone();
        (0..2000).for_each(|row| shuffled.swap(row, row * 7919 % 2000));
        assert!(tree.refit(&shuffled));
        check(&tree, &shuffled);
        assert!(tree.cost() > 5.0 * built, "{built} {}", tree.cost());
        assert!((Blas::build(&shuffled).cost() / built - 1.0).abs() < 0.05);
    }
}
