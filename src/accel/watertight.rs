//! The evidence that no ray slips through: rays from inside closed meshes, aimed at their vertices and edges.
//!
//! Whatever the rounding, each must hit something.

pub use super::closed::{Closed, OFFSETS};
use super::{Accel, Nearest, Ray, RayList, Solid, Structure, closed::mix, textbook};

/// What rays are aimed at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// A corner of a triangle.
    Vertex,
    /// A random point of an edge, as near as rounding lets it.
    Edge,
}

impl Target {
    /// Both, with their names.
    pub const ALL: [(&'static str, Self); 2] = [("vertex", Self::Vertex), ("edge", Self::Edge)];
}

/// splitmix64.
struct Numbers(u64);

impl Numbers {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    fn below(&mut self, count: usize) -> usize {
        (((self.bits() >> 32) * count as u64) >> 32) as usize
    }

    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / 9_007_199_254_740_992.0
    }
}

impl Closed {
    /// Rays from inside. The same `seed` gives the same rays.
    pub fn rays(&self, target: Target, count: usize, seed: u64) -> RayList {
        let mut numbers = Numbers(seed);
        let ray = |_| {
            let heart = self.hearts[numbers.below(self.hearts.len())];
            let origin = heart.map(|x| (x + self.room * (2.0 * numbers.unit() - 1.0)) as f32);
            let corners = self.triangles[numbers.below(self.triangles.len())].map(|corner| corner.map(f64::from));
            let first = numbers.below(3);
            let aim = match target {
                Target::Vertex => corners[first],
                Target::Edge => mix(corners[first], corners[(first + 1) % 3], numbers.unit()),
            };
            let direction = std::array::from_fn(|axis| (aim[axis] - f64::from(origin[axis])) as f32);
            (origin, direction, f32::INFINITY)
        };
        RayList((0..count).map(ray).collect())
    }
}

/// Rays that hit nothing, or are said not to be blocked.
pub fn misses(structure: &impl Structure, rays: &RayList) -> usize {
    let missed = |&&(origin, direction, t_max): &&([f32; 3], [f32; 3], f32)| {
        let ray = Ray::new(origin, direction);
        let mut best = Nearest::none(t_max);
        structure.nearest(&ray, &mut best, |_, _| true, &mut ());
        best.triangle == u32::MAX || !structure.occluded(&ray, t_max, |_, _| true, &mut ())
    };
    rays.0.iter().filter(missed).count()
}

/// [`misses`] of waves of rays through the eight-wide tree.
pub fn misses_of_waves(accel: &Accel, rays: &RayList) -> usize {
    let mut met = vec![0_u8; rays.0.len()];
    accel.nearest_of(rays, &Solid, |index, hit| met[index] += u8::from(hit.t < f32::INFINITY));
    accel.occluded_of(rays, &Solid, |index, occluded| met[index] += u8::from(occluded));
    met.iter().filter(|&&times| times < 2).count()
}

/// A ray-triangle test, to be tried on all triangles of a mesh.
pub type Test = fn([f32; 3], [f32; 3], &[[f32; 3]; 3]) -> bool;

/// The tests by name.
pub const TESTS: [(&str, Test); 3] = [
    ("plane", |origin, direction, corners| {
        textbook::plane_and_inside(origin, direction, corners, f32::INFINITY).is_some()
    }),
    ("moller-trumbore", |origin, direction, corners| {
        textbook::moller_trumbore_corners(origin, direction, corners, f32::INFINITY).is_some()
    }),
    ("watertight", |origin, direction, corners| {
        super::intersect(&Ray::new(origin, direction), corners, f32::INFINITY).is_some()
    }),
];

/// Rays that hit none of the triangles by a test.
pub fn misses_of_test(test: Test, triangles: &[[[f32; 3]; 3]], rays: &RayList) -> usize {
    let missed = |&&(origin, direction, _): &&([f32; 3], [f32; 3], f32)| {
        !triangles.iter().any(|corners| test(origin, direction, corners))
    };
    rays.0.iter().filter(missed).count()
}

#[cfg(test)]
mod tests {
    use std::{collections::HashMap, sync::Arc};

    use rayon::prelude::*;

    use super::*;
    use crate::accel::closed::{SHORTEST, add, distance};
    use crate::accel::{Blas, Bsp, Bvh2, Grid, InstanceRef, KdTree, Obb, Octree};

    /// Each edge belongs to two triangles, and the shortest is at least 64 units in the last place long.
    #[test]
    fn the_meshes_are_closed_and_their_edges_are_not_too_short() {
        for offset in OFFSETS {
            for Closed { name, triangles, .. } in Closed::all(offset) {
                let mut uses = HashMap::new();
                let farthest = triangles.iter().flatten().flatten().fold(0.0, |most: f32, x| most.max(x.abs()));
                let unit = f64::from(farthest.next_up() - farthest);
                for corners in &triangles {
                    for i in 0..3 {
                        let (a, b) = (corners[i], corners[(i + 1) % 3]);
                        let edge = distance(a.map(f64::from), b.map(f64::from));
                        assert!(edge >= SHORTEST * unit, "{name} at {offset:?}: {edge}");
                        let [a, b] = [a, b].map(|p| p.map(f32::to_bits));
                        *uses.entry((a.min(b), a.max(b))).or_insert(0) += 1;
                    }
                }
                assert!(uses.values().all(|&count| count == 2), "{name} {offset:?}");
            }
        }
    }

    /// Rays per structure, shared out among meshes, offsets and targets.
    const RAYS: usize = 200_000;

    fn check(name: &str, misses: impl Fn(&Closed, &RayList) -> usize + Sync) {
        let cases: Vec<_> =
            OFFSETS.into_iter().flat_map(|offset| Closed::all(offset).map(|mesh| (offset, mesh))).collect();
        cases.par_iter().for_each(|(offset, mesh)| {
            for (what, target) in Target::ALL {
                let rays = mesh.rays(target, RAYS.div_ceil(cases.len() * 2), 1);
                let missed = misses(mesh, &rays);
                assert_eq!(
                    missed,
                    0,
                    "{name}: {missed} of {} rays at a {what} of the {} at {offset:?}",
                    rays.0.len(),
                    mesh.name
                );
            }
        });
    }

    fn check_structure<S: Structure>() {
        check(S::NAME, |mesh, rays| misses(&S::build(&mesh.triangles), rays));
    }

    #[test]
    fn no_ray_aimed_at_an_edge_or_vertex_slips_through_any_structure() {
        check_structure::<Bvh2>();
        check_structure::<KdTree>();
        check_structure::<Octree>();
        check_structure::<Bsp>();
        check_structure::<Grid>();
        check_structure::<Obb>();
    }

    #[test]
    fn no_ray_aimed_at_an_edge_or_vertex_slips_through_waves() {
        check("waves", |mesh, rays| {
            let only = InstanceRef::unmoved(Arc::new(Blas::build(&mesh.triangles)));
            misses_of_waves(&Accel::build(vec![only]), rays)
        });
    }

    /// Rays through the top level, whose boxes they meet in the world and whose triangles in the mesh's space: the mesh they
    /// start in is turned, enlarged and far away, and two others stand beside it.
    #[test]
    fn no_ray_slips_through_a_placed_mesh() {
        let rows = [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]];
        let turned = |v: [f64; 3]| rows.map(|row: [f64; 3]| (0..3).map(|i| row[i] * v[i]).sum::<f64>());
        for mesh in Closed::all([0.0; 3]) {
            let blas = Arc::new(Blas::build(&mesh.triangles));
            for (offset, scale) in OFFSETS.into_iter().flat_map(|offset| [(offset, 1.0), (offset, 30.0)]) {
                let placed = |beside: f64| {
                    let at = add(offset, [3.0 * beside * scale, 0.0, 0.0]);
                    let by_place = |f: &dyn Fn(usize, usize) -> f64| std::array::from_fn(|k| f(k / 4, k % 4) as f32);
                    let there = by_place(&|i, j| if j == 3 { at[i] } else { scale * rows[i][j] });
                    let back = by_place(&|i, j| match j {
                        3 => -(0..3).map(|k| rows[k][i] * at[k]).sum::<f64>() / scale,
                        _ => rows[j][i] / scale,
                    });
                    let blas = Arc::clone(&blas);
                    InstanceRef { blas, world_from_local: there, local_from_world: back, identity: false }
                };
                let accel = Accel::build([0.0, 1.0, -1.0].map(placed).into());
                for (what, target) in Target::ALL {
                    let local = mesh.rays(target, 5_000, 5);
                    let in_world = |(origin, direction, t_max): ([f32; 3], [f32; 3], f32)| {
                        let origin = turned(origin.map(f64::from)).map(|x| x * scale);
                        let direction = turned(direction.map(f64::from)).map(|x| (x * scale) as f32);
                        (add(origin, offset).map(|x| x as f32), direction, t_max)
                    };
                    let rays = RayList(local.0.into_iter().map(in_world).collect());
                    let missed = misses_of_waves(&accel, &rays);
                    assert_eq!(missed, 0, "{what}s of the {} at {offset:?}, {scale} times as large", mesh.name);
                    accel.nearest_of(&rays, &Solid, |_, hit| assert_eq!(hit.instance, 0));
                }
            }
        }
    }

    /// A cube of which a face's diagonal has a third corner, with a triangle without height to keep it closed: 200,000 rays
    /// from inside at the diagonal.
    fn misses_at_a_seam(structure: impl Fn(&[[[f32; 3]; 3]], &RayList) -> usize, at: [f64; 3]) -> usize {
        let corner = |bits: usize| [0, 1, 2].map(|axis| [-1.0, 1.0][bits >> axis & 1]);
        let mut triangles = Vec::new();
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        for (face, [a, b, c, d]) in faces.into_iter().map(|face| face.map(corner)).enumerate() {
            let middle = mix(a, c, 0.25);
            match face {
                0 => triangles.extend([[a, b, middle], [middle, b, c], [a, c, d], [a, middle, c]]),
                _ => triangles.extend([[a, b, c], [a, c, d]]),
            }
        }
        let place = |p: [f64; 3]| add(p.map(|x| 0.7 * x), at).map(|x| x as f32);
        let triangles: Vec<[[f32; 3]; 3]> = triangles.into_iter().map(|corners| corners.map(place)).collect();
        let [a, c] = [0, 3].map(|bits| place(corner(bits)).map(f64::from));
        let mut numbers = Numbers(7);
        let rays = (0..200_000).map(|_| {
            let origin = place([0; 3].map(|_| 1.6 * numbers.unit() - 0.8));
            let aim = mix(a, c, numbers.unit());
            (origin, std::array::from_fn(|i| (aim[i] - f64::from(origin[i])) as f32), f32::INFINITY)
        });
        structure(&triangles, &RayList(rays.collect()))
    }

    /// What is not held: where only a triangle without height closes a seam, rays slip through. Such triangles are left out
    /// if their area is lost to rounding (3 % of rays at the seam); if not, their edge functions are noise, and so is the
    /// distance those mix (20 in 200,000). This fails when they do no longer, and should then ask for zero.
    #[test]
    fn seams_that_a_triangle_without_height_closes_are_not_tight() {
        assert_ne!(misses_at_a_seam(|triangles, rays| misses(&Bvh2::build(triangles), rays), [0.0; 3]), 0);
        let alone = |triangles: &[[[f32; 3]; 3]], rays: &RayList| misses_of_test(TESTS[2].1, triangles, rays);
        assert_ne!(misses_at_a_seam(alone, [0.3, 0.1, -0.2]), 0);
    }

    /// The harness sees it when rays slip through: with Möller's and Trumbore's test many do, with that of the plane some
    /// (not at vertices far from zero, where the point it computes is rounded to the vertex).
    #[test]
    fn rays_slip_through_with_the_textbook_tests() {
        for offset in &OFFSETS[..2] {
            let mesh = Closed::small(*offset);
            let [plane, moller, watertight] = TESTS.map(|(_, test)| {
                Target::ALL.map(|(_, target)| misses_of_test(test, &mesh.triangles, &mesh.rays(target, 20_000, 3)))
            });
            println!("{offset:?}: {plane:?} {moller:?} {watertight:?}");
            assert!(moller[0] > 20 && moller[1] > 20 && plane[1] > 20, "{offset:?}: {moller:?} {plane:?}");
            assert_eq!(watertight, [0, 0], "{offset:?}");
        }
    }
}
