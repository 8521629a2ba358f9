//! Ray against geometry: nearest hits and occlusion for queues of rays.
//!
//! In flow columns of rays in world space; out, columns of hits. [`Blas`] holds one
//! mesh, [`Accel`] places many in the world. What of a surface a ray goes through (no
//! back, no coverage) is decided by a [`Coverage`], a type that compiles to nothing
//! for scenes that are solid throughout.
//!
//! A mesh is put into one of a family of structures ([`AccelKind`]). Some divide its
//! triangles and let boxes overlap: `bvh8`, eight boxes to a node, through which waves
//! of rays go (`queue`; those of a camera together, `packet`), and its textbook form [`Bvh2`]. Others divide space, and refer
//! to a triangle from every cell that it is in: [`Grid`] into equal cells, [`Octree`]
//! into halves across all axes at once, [`KdTree`] by planes across one axis, [`Bsp`] by
//! planes of any direction. [`Brute`] does neither, and is the truth for all others:
//! they find candidates, but whether one is hit is decided by [`intersect`] alone, so
//! that pictures do not depend on the structure by a single bit.
//!
//! A surface given by a formula ([`Shape`](crate::world::Shape)) is a [`Blas`] of its own, and the same in every structure.

mod arena;
mod binary;
mod brute;
mod bsp;
mod bvh2;
mod bvh8;
mod closed;
mod cluster;
mod collapse;
#[cfg(test)]
mod family;
mod grid;
mod kdtree;
mod leaf;
mod merge;
mod mesh;
mod obb;
mod octree;
mod opacity;
mod open;
mod packet;
mod plan;
mod polytope;
mod queue;
mod refit;
mod shape;
pub mod slab;
pub mod slanted;
mod slot;
mod space;
mod structure;
pub mod textbook;
mod triangle;
mod two_level;
pub mod watertight;
mod way;

pub use self::{
    brute::Brute,
    bsp::Bsp,
    bvh2::Bvh2,
    bvh8::Quality,
    grid::Grid,
    kdtree::KdTree,
    leaf::{Leaf, NO_ROW, TriangleBlock, TriangleQuad},
    mesh::{AccelKind, Blas},
    obb::Obb,
    octree::Octree,
    opacity::Opacity,
    queue::{RayList, Rays, Segment, SideBySide},
    shape::ShapeHit,
    structure::{Cell, Counters, Nearest, Shape, Structure, Work},
    triangle::{Ray, TriangleHit, intersect},
    two_level::{Accel, Hit, InstanceRef, NO_HIT, Stacks},
};

#[cfg(test)]
pub(crate) use self::packet::tests::TOGETHER;

/// Decides whether a surface is there for a ray that meets it.
pub trait Coverage {
    /// True if everything covers; what is known of the triangles' [`Opacity`] is then not even read.
    const TRIVIAL: bool;

    /// True if surfaces without a back stop rays there all the same.
    const BACKS: bool = false;

    /// True if the ray `ray_id` stops at this hit. It must agree with what is known of the triangle: it is asked of those that
    /// are [`Opacity::Asked`], and outside the eight-wide tree of all in a mesh of which some are not solid.
    fn covers(&self, ray_id: u32, hit: &Hit) -> bool;
}

/// Everything stops every ray.
#[derive(Clone, Copy, Debug)]
pub struct Solid;

impl Coverage for Solid {
    const TRIVIAL: bool = true;

    #[inline(always)]
    fn covers(&self, _: u32, _: &Hit) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    /// xorshift: enough to scatter test triangles.
    pub(super) fn numbers(mut state: u64) -> impl FnMut() -> f32 {
        move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 40) as f32 / 16_777_216.0
        }
    }

    const IDENTITY: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

    pub(super) fn placed(blas: &Arc<Blas>, scale: f32, shift: f32) -> InstanceRef {
        let mut local_from_world = IDENTITY;
        let mut world_from_local = IDENTITY;
        for axis in 0..3 {
            world_from_local[axis * 5] = scale;
            local_from_world[axis * 5] = 1.0 / scale;
            world_from_local[axis * 4 + 3] = shift;
            local_from_world[axis * 4 + 3] = -shift / scale;
        }
        InstanceRef {
            blas: Arc::clone(blas),
            world_from_local,
            local_from_world,
            identity: scale == 1.0 && shift == 0.0,
        }
    }

    /// Missing children are boxes that what is not a number would meet, and lead back to the root: walks that never end.
    #[test]
    fn rays_from_nowhere_hit_nothing_and_come_to_an_end() {
        for count in [3, 11, 20, 300] {
            let mut u = numbers(count);
            let triangles: Vec<[[f32; 3]; 3]> = (0..count).map(|_| [0; 3].map(|_| [u(), u(), u()])).collect();
            let blas = Arc::new(Blas::build(&triangles));
            let one = placed(&blas, 0.5, 0.1);
            for instances in [vec![placed(&blas, 1.0, 0.0)], vec![one.clone()], vec![one.clone(), one]] {
                let accel = Accel::build(instances);
                let endless = RayList(vec![([0.5; 3], [0.3, -0.8, 0.1], f32::NAN); 3]);
                accel.nearest_of(&endless, &Solid, |_, hit| assert_eq!(*hit, NO_HIT));
                accel.occluded_of(&endless, &Solid, |_, hit| assert!(!hit));
                for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e38] {
                    for place in 0..7 {
                        let mut ray = [0.5, 0.5, 0.5, 0.3, -0.8, 3e38];
                        if place < 6 {
                            ray[place] = bad;
                        } else {
                            ray[..3].fill(bad);
                        }
                        let ([ox, oy, oz], [dx, dy, dz]) = ([ray[0], ray[1], ray[2]], [ray[3], ray[4], ray[5]]);
                        let rays = RayList(vec![([ox, oy, oz], [dx, dy, dz], f32::INFINITY); 3]);
                        let finite = bad == 1e38;
                        accel.nearest_of(&rays, &Solid, |_, hit| assert!(finite || *hit == NO_HIT));
                        accel.occluded_of(&rays, &Solid, |_, hit| assert!(finite || !hit));
                        let stacks = &mut Stacks::default();
                        let hit = accel.nearest(rays.0[0].0, rays.0[0].1, f32::INFINITY, 0, &Solid, stacks);
                        assert!(finite || hit == NO_HIT);
                        accel.occluded(rays.0[0].0, rays.0[0].1, f32::INFINITY, 0, &Solid, stacks);
                    }
                }
            }
        }
    }

    /// 2,000 rays through 300 triangles, placed once, then three times: the same hit as testing every triangle.
    #[test]
    fn the_trees_find_what_brute_force_finds() {
        let mut u = numbers(7);
        let mut point = |spread: f32| [u() * spread, u() * spread, u() * spread];
        let triangles: Vec<[[f32; 3]; 3]> = (0..300)
            .map(|_| {
                let base = point(4.0);
                [0, 1, 2].map(|_| {
                    let offset = point(1.0);
                    std::array::from_fn(|axis| base[axis] + offset[axis])
                })
            })
            .collect();
        let blas = Arc::new(Blas::build(&triangles));
        for places in [vec![(1.0, 0.0)], vec![(1.0, 0.0), (2.0, 8.0), (-0.5, -2.0)]] {
            let instances = places.iter().map(|&(scale, shift)| placed(&blas, scale, shift)).collect();
            let accel = Accel::build(instances);
            let mut hits = 0;
            for id in 0..2000 {
                let (origin, target) = (point(20.0).map(|x| x - 5.0), point(5.0));
                let direction = std::array::from_fn(|axis| target[axis] - origin[axis]);
                let mut want = NO_HIT;
                for (instance, &(scale, shift)) in places.iter().enumerate() {
                    let local = Ray::new(origin.map(|x| x / scale - shift / scale), direction.map(|x| x / scale));
                    for (triangle, corners) in triangles.iter().enumerate() {
                        if let Some(hit) = intersect(&local, corners, f32::INFINITY)
                            && hit.t < want.t
                        {
                            want = Hit {
                                t: hit.t,
                                instance: instance as u32,
                                triangle: triangle as u32,
                                b1: hit.b1,
                                b2: hit.b2,
                                back: hit.back,
                            };
                        }
                    }
                }
                let got = accel.nearest(origin, direction, f32::INFINITY, id, &Solid, &mut Stacks::default());
                assert_eq!((got.instance, got.triangle), (want.instance, want.triangle), "ray {id}");
                assert!((got.t - want.t).abs() <= 1e-5 * want.t || got.t == want.t);
                let occluded = |t_max| accel.occluded(origin, direction, t_max, id, &Solid, &mut Stacks::default());
                assert_eq!(occluded(f32::INFINITY), want.t < f32::INFINITY);
                if want.t < f32::INFINITY {
                    hits += 1;
                    assert!(!occluded(want.t * 0.999) && occluded(want.t * 1.001));
                }
            }
            assert!(hits > 500, "{hits} of 2000 rays hit: too few to mean anything");
        }
    }

    /// Rays with their ends, for a wave; unlike those of a [`RayList`], each has a name of its own.
    pub(super) struct Wave(pub(super) Vec<([f32; 3], [f32; 3], f32)>);

    impl Rays for Wave {
        fn count(&self) -> usize {
            self.0.len()
        }
        fn ray(&self, index: usize) -> ([f32; 3], [f32; 3], f32) {
            self.0[index]
        }
        fn id(&self, index: usize) -> u32 {
            index as u32
        }
    }

    /// Of each three triangles one is solid, one has no back, and one and a ray meet by a coin of their own.
    pub(super) struct Sieve;

    impl Sieve {
        fn opacity(triangle: u32) -> Opacity {
            [Opacity::Solid, Opacity::FrontOnly, Opacity::Asked][triangle as usize % 3]
        }
    }

    /// A mesh for it.
    pub(super) fn sieved_as(kind: AccelKind, triangles: &[[[f32; 3]; 3]]) -> Arc<Blas> {
        let mut blas = Blas::build_as(kind, triangles);
        blas.set_opacity(Sieve::opacity);
        Arc::new(blas)
    }

    /// [`sieved_as`], in the default structure.
    pub(super) fn sieved(triangles: &[[[f32; 3]; 3]]) -> Arc<Blas> {
        sieved_as(AccelKind::default(), triangles)
    }

    impl Coverage for Sieve {
        const TRIVIAL: bool = false;
        fn covers(&self, ray_id: u32, hit: &Hit) -> bool {
            match Self::opacity(hit.triangle) {
                Opacity::Solid => true,
                Opacity::FrontOnly => !hit.back,
                Opacity::Asked => !(ray_id ^ hit.triangle.wrapping_mul(0x9e37_79b9) ^ hit.instance).is_multiple_of(3),
            }
        }
    }

    /// A wave finds, ray by ray and bit for bit, what each ray finds alone.
    #[track_caller]
    pub(super) fn check_wave<C: Coverage>(accel: &Accel, wave: &Wave, coverage: &C) {
        let mut stacks = Stacks::default();
        let mut got = vec![None; wave.count()];
        accel.nearest_of(wave, coverage, |index, hit| assert!(got[index].replace(*hit).is_none(), "twice"));
        let mut dark = vec![None; wave.count()];
        accel.occluded_of(wave, coverage, |index, occluded| assert!(dark[index].replace(occluded).is_none(), "twice"));
        let mut hits = 0;
        for (index, &(origin, direction, t_max)) in wave.0.iter().enumerate() {
            let id = index as u32;
            let want = accel.nearest(origin, direction, t_max, id, coverage, &mut stacks);
            assert_eq!(got[index], Some(want), "ray {index}");
            assert_eq!(dark[index], Some(accel.occluded(origin, direction, t_max, id, coverage, &mut stacks)));
            assert_eq!(dark[index], Some(want != NO_HIT));
            hits += u32::from(want != NO_HIT);
        }
        assert!(hits as usize * 10 > wave.count(), "{hits} of {} rays hit: too few to mean anything", wave.count());
    }

    /// Rays that start among and outside of points in [0, 5]³, some of them axis-parallel, some short.
    pub(super) fn wave(count: usize, seed: u64) -> Wave {
        let mut u = numbers(seed);
        let mut point = |spread: f32| [u() * spread, u() * spread, u() * spread];
        let rays = (0..count).map(|i| {
            let (origin, target) = (point(if i % 2 == 0 { 20.0 } else { 5.0 }), point(5.0));
            let mut direction: [f32; 3] = std::array::from_fn(|axis| target[axis] - origin[axis]);
            if i % 7 == 0 {
                direction[i % 3] = 0.0;
                direction[(i + 1) % 3] = 0.0;
            }
            (origin, direction, if i % 5 == 0 { 0.7 } else { f32::INFINITY })
        });
        Wave(rays.collect())
    }

    #[test]
    fn a_wave_finds_what_its_rays_find_alone() {
        let mut u = numbers(11);
        let triangles: Vec<[[f32; 3]; 3]> = (0..3000)
            .map(|_| {
                let base = [u() * 5.0, u() * 5.0, u() * 5.0];
                let size = 0.05 + u();
                [0, 1, 2].map(|_| base.map(|x| x + size * u()))
            })
            .collect();
        let few = Arc::new(Blas::build(&triangles[..3]));
        let many = sieved(&triangles);
        let empty = Arc::new(Blas::build(&[]));
        let scenes = [
            vec![placed(&many, 1.0, 0.0)],
            vec![placed(&many, 0.5, 1.0)],
            vec![placed(&few, 1.0, 0.0), placed(&empty, 1.0, 0.0), placed(&many, 0.5, 1.0), placed(&many, -1.0, 5.0)],
            (0..100).map(|i| placed(if i % 3 == 0 { &few } else { &many }, 0.3, i as f32 * 0.05)).collect(),
        ];
        for instances in &scenes {
            let accel = Accel::build(instances.clone());
            assert!(!accel.deep);
            // Waves smaller than the rays in flight, as large, and larger.
            for count in [1, 31, 32, 33, 2000] {
                check_wave(&accel, &wave(count.max(40), count as u64), &Solid);
            }
            check_wave(&accel, &wave(2000, 3), &Sieve);
            let mut alone = 0;
            accel.nearest_of(&wave(1, 5), &Solid, |_, _| alone += 1);
            accel.nearest_of(&wave(0, 5), &Solid, |_, _| alone += 1);
            assert_eq!(alone, 1);
        }
    }

    /// Triangles across a corner, each a little smaller than the one before: the best that a tree can do is to put each
    /// beside all that are smaller, and no limit of depth helps.
    #[test]
    fn trees_too_deep_for_a_queue_are_walked_ray_by_ray() {
        let nested = |count: i32| -> Vec<[[f32; 3]; 3]> {
            let sizes = (0..count).map(|i| 5.0 * 0.85_f32.powi(i));
            sizes.map(|size| [[size, 0.0, 0.0], [0.0, size, 0.0], [0.0, 0.0, size]]).collect()
        };
        let wave = wave(2000, 9);
        for (count, deep) in [(40, false), (260, true)] {
            let blas = sieved(&nested(count));
            let accel = Accel::build(vec![placed(&blas, 1.0, 0.0), placed(&blas, -0.5, 5.0)]);
            assert_eq!(accel.deep, deep, "{count} put off {} subtrees", blas.tree.stack);
            check_wave(&accel, &wave, &Solid);
            check_wave(&accel, &wave, &Sieve);
        }
    }

    /// Of two triangles in the same place the one of the smaller row is hit, in whatever order they come.
    #[test]
    fn at_equal_distance_the_smaller_row_wins() {
        let triangle = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
        let blas = Arc::new(Blas::build(&[triangle; 9]));
        let accel = Accel::build(vec![placed(&blas, 1.0, 0.0), placed(&blas, 1.0, 0.0)]);
        let hit = accel.nearest([0.0, 0.0, 3.0], [0.0, 0.0, -1.0], f32::INFINITY, 0, &Solid, &mut Stacks::default());
        assert_eq!((hit.instance, hit.triangle, hit.t), (0, 0, 3.0));
    }

    #[test]
    fn nothing_is_hit_in_an_empty_world() {
        let accel = Accel::build(Vec::new());
        assert_eq!(accel.nearest([0.0; 3], [0.0, 0.0, 1.0], 1.0, 0, &Solid, &mut Stacks::default()), NO_HIT);
        assert!(!accel.occluded([0.0; 3], [0.0, 0.0, 1.0], 1.0, 0, &Solid, &mut Stacks::default()));
    }
}
