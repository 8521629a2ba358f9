//! The partition against its cells: what lies in which, and how they share the space.

use super::*;
use crate::accel::{
    KdTree, Work,
    family::{numbers, scenes, soup, torus},
    polytope::{area_vector, tests::volume},
};

/// The leaf that a point is in.
fn locate(tree: &Bsp, p: &[f64; 3]) -> usize {
    let mut index = 0;
    loop {
        let node = &tree.nodes[index];
        if node.kind >= LEAF {
            return index;
        }
        index = if cut_of(tree, node).distance(&tree.center, p) < 0.0 { index + 1 } else { node.above as usize };
    }
}

fn cut_of(tree: &Bsp, node: &Node) -> Cut {
    if node.kind == ASKEW {
        Cut::Askew(tree.planes[node.at as usize])
    } else {
        Cut::Across(node.kind as usize, f32::from_bits(node.at))
    }
}

/// Cells of the leaves with their nodes.
fn leaves(tree: &Bsp) -> Vec<(Polytope, usize)> {
    let mut leaves = Vec::new();
    let mut pending = vec![(Polytope::of_box(&tree.soup.bounds), 0, 0)];
    while let Some((cell, index, depth)) = pending.pop() {
        assert!(depth <= DEPTH);
        let node = &tree.nodes[index];
        if node.kind >= LEAF {
            leaves.push((cell, index));
        } else {
            let [below, above] = cell.split(|p| cut_of(tree, node).distance(&tree.center, p));
            pending.extend([(below, index + 1, depth + 1), (above, node.above as usize, depth + 1)]);
        }
    }
    leaves
}

/// Volumes of the cells add up to that of the mesh's box, and a point is within the faces of one cell alone, which is
/// that which the planes lead to.
#[test]
fn leaves_divide_space() {
    for triangles in [soup(200, 0.2, 5), torus(12, 8)] {
        let tree = Bsp::build(&triangles);
        assert!(!tree.planes.is_empty());
        let leaves = leaves(&tree);
        let [x, y, z] = tree.soup.bounds.size();
        let sum: f64 = leaves.iter().map(|(cell, _)| volume(cell)).sum();
        assert!((sum / (x * y * z) - 1.0).abs() < 1e-6, "{sum}");
        let mut u = numbers(6);
        for _ in 0..300 {
            let p: [f64; 3] = std::array::from_fn(|axis| {
                f64::from(tree.soup.bounds.lower[axis]) + tree.soup.bounds.size()[axis] * f64::from(u())
            });
            let holds = |cell: &Polytope| cell.0.iter().all(|f| dot(&area_vector(f), &minus(&p, &f[0])) <= 1e-12);
            let holding: Vec<usize> = leaves.iter().filter(|(cell, _)| holds(cell)).map(|(_, at)| *at).collect();
            assert_eq!(holding, [locate(&tree, &p)]);
        }
    }
}

/// A point of a triangle is in a leaf that refers to it, or no further from one than planes tolerate.
#[test]
fn leaves_refer_to_what_is_in_them() {
    for (name, triangles) in scenes() {
        let tree = Bsp::build(&triangles);
        let mut u = numbers(7);
        let (mut beside, mut all) = (0, 0);
        let tolerance = 4e-7 * tree.soup.bounds.size().into_iter().fold(0.0, f64::max);
        for (index, (_, corners)) in tree.soup.triangles.iter().enumerate() {
            for _ in 0..20 {
                let (a, b) = (f64::from(u()), f64::from(u()));
                let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
                let [p, q, r] = corners.map(|corner| corner.map(f64::from));
                let p: [f64; 3] = std::array::from_fn(|i| p[i] + a * (q[i] - p[i]) + b * (r[i] - p[i]));
                let refers = |p: &[f64; 3]| {
                    let node = &tree.nodes[locate(&tree, p)];
                    let (first, count) = (node.at as usize, (node.kind - LEAF) as usize);
                    tree.references[first..first + count].contains(&(index as u32))
                };
                // Far from zero a plane across an axis is rounded.
                let step = |axis: usize| tolerance + p[axis].abs() * f64::from(f32::EPSILON);
                let near = (0..4 * 27).any(|i| {
                    let share = [1.0, 0.5, 0.25, 0.1][i / 27];
                    let sign = |axis: usize| [0.0, -1.0, 1.0][i / 3_usize.pow(axis as u32) % 3];
                    refers(&std::array::from_fn(|axis| p[axis] + share * sign(axis) * step(axis)))
                });
                assert!(near, "{name}: triangle {index} at {p:?}");
                (beside, all) = (beside + u32::from(!refers(&p)), all + 1);
            }
        }
        // Those in planes; boxes lie in their faces with all they have.
        assert!(beside * 2 <= all, "{name}: {beside} of {all}");
    }
}

/// Triangles with gaps between them that no plane across an axis fits into are told apart.
#[test]
fn planes_askew_save_tests() {
    let layers: Vec<_> = (0..400)
        .map(|i| {
            let (x, z) = ((i / 8) as f32, (i % 8) as f32 * 0.05);
            [[x, 0.0, z], [x + 1.0, 1.0, z], [x, 1.0, z + 1.0]]
        })
        .collect();
    fn tests<S: Structure>(triangles: &[[[f32; 3]; 3]]) -> u64 {
        let (structure, mut u, mut work) = (S::build(triangles), numbers(8), Work::default());
        for _ in 0..1000 {
            let ray = Ray::new([50.0 * u(), u(), -1.0], [u() - 0.5, u() - 0.5, 1.0]);
            structure.nearest(&ray, &mut Nearest::none(f32::INFINITY), |_, _| true, &mut work);
        }
        work.triangles
    }
    let (bsp, kdtree) = (tests::<Bsp>(&layers), tests::<KdTree>(&layers));
    assert!(bsp * 10 < kdtree * 9, "{bsp} {kdtree}");
}

#[test]
fn hard_meshes_have_bounded_memory() {
    let tree = Bsp::build(&soup(1000, 1.0, 8));
    assert!(tree.references() <= MOST_REFERENCES * 1000, "{}", tree.references());
    let tree = Bsp::build(&vec![soup(1, 1.0, 8)[0]; 5000]);
    assert!(tree.references() <= 2 * 5000, "{}", tree.references());
}
