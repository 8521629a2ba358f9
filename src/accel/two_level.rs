//! Meshes placed in the world: a tree over instances, each with the tree of its mesh.

use std::sync::Arc;

use obvhs::aabb::Aabb;
use rayon::prelude::*;

use super::{
    Blas, Coverage, Rays,
    bvh8::{Bvh8, INSTANCE, KIND, Node, Quality, Stack, bounds_of},
    mesh::Other,
    queue,
    structure::{Counters, Nearest},
    triangle::{BlockHit, Ray, TriangleBlock, TriangleHit},
};
use crate::{flat::NONE, simd::LANES};

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Along the ray; infinite for none.
    pub t: f32,
    /// Row of the instance, or `NONE`.
    pub instance: u32,
    /// Row of the triangle in its mesh.
    pub triangle: u32,
    /// Barycentric of the second corner.
    pub b1: f32,
    /// Barycentric of the third corner.
    pub b2: f32,
    /// True if the back is met.
    pub back: bool,
}

/// The ray met nothing.
pub const NO_HIT: Hit = Hit { t: f32::INFINITY, instance: NONE, triangle: NONE, b1: 0.0, b2: 0.0, back: false };

/// One placed mesh. Matrices are 3×4 by rows.
#[derive(Clone, Debug)]
pub struct InstanceRef {
    /// Its mesh.
    pub blas: Arc<Blas>,
    /// World from local space.
    pub world_from_local: [f32; 12],
    /// Local from world space.
    pub local_from_world: [f32; 12],
    /// True if the transform changes nothing.
    pub identity: bool,
    /// True if hits must be confirmed by a [`Coverage`].
    pub check: bool,
}

/// Scratch of a traversal: a stack for the top level and one for meshes.
#[derive(Clone, Debug, Default)]
pub struct Stacks {
    top: Stack,
    mesh: Stack,
}

/// A subtree of an instance's mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    /// Row of the instance.
    pub instance: u32,
    /// The subtree, in the arena of the mesh.
    pub root: u32,
}

/// Rays against the whole scene.
#[derive(Clone, Debug, Default)]
pub struct Accel {
    pub(super) tree: Bvh8,
    pub(super) instances: Vec<InstanceRef>,
    /// What the top level leads to.
    pub(super) parts: Vec<Part>,
    bounds: Option<([f32; 3], [f32; 3])>,
    /// The trees are deeper than a queue's slots, so that rays go one by one.
    pub(super) deep: bool,
    /// Some mesh is in another structure than the eight-wide tree, and rays go one by one for that.
    others: bool,
}

/// A 3×4 matrix, by rows, times a point.
#[inline(always)]
pub(crate) fn transform_point(m: &[f32; 12], p: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|row| {
        let m = &m[row * 4..row * 4 + 4];
        m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3]
    })
}

/// The linear part of a 3×4 matrix, by rows, times a vector.
#[inline(always)]
pub(crate) fn transform_vector(m: &[f32; 12], v: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|row| {
        let m = &m[row * 4..row * 4 + 4];
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2]
    })
}

impl Accel {
    /// Over placed meshes, in the order of their rows.
    pub fn build(instances: Vec<InstanceRef>) -> Self {
        let boxes: Vec<Aabb> = instances.par_iter().map(|one| world_bounds(one, &one.blas.bounds)).collect();
        let all = boxes.iter().filter(|one| one.valid()).fold(Aabb::empty(), |all, one| all.union(one));
        let (parts, boxes) = open(&instances, boxes, all.half_area());
        let tree = Bvh8::build(&boxes, Quality::Fast, 1, |rows, _| INSTANCE | rows[0]);
        let bounds = all.valid().then(|| (all.min.to_array(), all.max.to_array()));
        let deepest = instances.iter().map(|one| one.blas.tree.stack).max().unwrap_or(0);
        let deep = tree.stack + deepest + 1 > queue::STACK;
        let others = instances.iter().any(|one| one.blas.other.is_some());
        Self { tree, instances, parts, bounds, deep, others }
    }

    /// Says again which instances need their hits confirmed.
    pub fn set_checks(&mut self, mut check: impl FnMut(usize) -> bool) {
        for (row, instance) in self.instances.iter_mut().enumerate() {
            instance.check = check(row);
        }
    }

    /// Lowest and highest corner of everything, if there is anything.
    pub fn bounds(&self) -> Option<([f32; 3], [f32; 3])> {
        self.bounds
    }

    /// Placed meshes.
    pub fn instances(&self) -> &[InstanceRef] {
        &self.instances
    }

    /// Bytes of the top level; meshes are counted by [`Blas::bytes`].
    pub fn bytes(&self) -> usize {
        self.tree.bytes() + self.instances.len() * size_of::<InstanceRef>() + self.parts.len() * size_of::<Part>()
    }

    /// The nearest hit with 0 < t ≤ `t_max`; at equal t that of the smaller (instance, triangle).
    #[inline]
    pub fn nearest<C: Coverage>(
        &self,
        origin: [f32; 3],
        direction: [f32; 3],
        t_max: f32,
        ray_id: u32,
        coverage: &C,
        Stacks { top, mesh }: &mut Stacks,
    ) -> Hit {
        let mut best = NO_HIT;
        let ray = Ray::new(origin, direction);
        let mut t_max = t_max;
        self.tree.walk::<true>(self.tree.root, &ray, &mut t_max, top, &mut (), |row, t_max| {
            let part = self.parts[row as usize];
            let instance = &self.instances[part.instance as usize];
            nearest_in(instance, part, &ray, t_max, &mut best, ray_id, coverage, mesh);
            false
        });
        best
    }

    /// [`Accel::nearest`] of all `rays`; `done` gets the index and the hit of each, in no particular order.
    pub fn nearest_of<C: Coverage>(&self, rays: &impl Rays, coverage: &C, done: impl FnMut(usize, &Hit)) {
        self.nearest_counted(rays, coverage, &mut (), done);
    }

    /// [`Accel::nearest_of`], counting its work, but only where rays go in waves: in eight-wide trees that are not too deep.
    pub fn nearest_counted<C: Coverage>(
        &self,
        rays: &impl Rays,
        coverage: &C,
        counters: &mut impl Counters,
        done: impl FnMut(usize, &Hit),
    ) {
        if self.deep || self.others {
            let mut stacks = Stacks::default();
            let mut done = done;
            for index in 0..rays.count() {
                let (origin, direction, t_max) = rays.ray(index);
                done(index, &self.nearest(origin, direction, t_max, rays.id(index), coverage, &mut stacks));
            }
        } else {
            queue::trace::<false, C>(self, rays, coverage, counters, done);
        }
    }

    /// [`Accel::occluded`] of all `rays`; `done` gets the index and the answer for each, in no particular order.
    pub fn occluded_of<C: Coverage>(&self, rays: &impl Rays, coverage: &C, done: impl FnMut(usize, bool)) {
        self.occluded_counted(rays, coverage, &mut (), done);
    }

    /// [`Accel::occluded_of`], counting its work, but only where rays go in waves: in eight-wide trees that are not too deep.
    pub fn occluded_counted<C: Coverage>(
        &self,
        rays: &impl Rays,
        coverage: &C,
        counters: &mut impl Counters,
        mut done: impl FnMut(usize, bool),
    ) {
        if self.deep || self.others {
            let mut stacks = Stacks::default();
            for index in 0..rays.count() {
                let (origin, direction, t_max) = rays.ray(index);
                done(index, self.occluded(origin, direction, t_max, rays.id(index), coverage, &mut stacks));
            }
        } else {
            queue::trace::<true, C>(self, rays, coverage, counters, |index, hit| done(index, hit.instance != NONE));
        }
    }

    /// True if anything is hit with 0 < t ≤ `t_max`.
    #[inline]
    pub fn occluded<C: Coverage>(
        &self,
        origin: [f32; 3],
        direction: [f32; 3],
        t_max: f32,
        ray_id: u32,
        coverage: &C,
        Stacks { top, mesh }: &mut Stacks,
    ) -> bool {
        let ray = Ray::new(origin, direction);
        let mut t_max = t_max;
        let mut found = false;
        self.tree.walk::<false>(self.tree.root, &ray, &mut t_max, top, &mut (), |row, t_max| {
            let part = self.parts[row as usize];
            let instance = &self.instances[part.instance as usize];
            found = occluded_in(instance, part, &ray, *t_max, ray_id, coverage, mesh);
            found
        });
        found
    }
}

/// A ray as the instance's mesh sees it.
#[inline(always)]
pub(super) fn to_local(instance: &InstanceRef, origin: [f32; 3], direction: [f32; 3]) -> Ray {
    let m = &instance.local_from_world;
    Ray::new(transform_point(m, origin), transform_vector(m, direction))
}

/// Calls `look` with the ray as the instance's mesh sees it.
#[inline(always)]
fn in_local<T>(instance: &InstanceRef, ray: &Ray, look: impl FnOnce(&Ray) -> T) -> T {
    let local;
    look(if instance.identity {
        ray
    } else {
        local = to_local(instance, ray.origin, ray.direction);
        &local
    })
}

#[inline(always)]
fn nearest_in<C: Coverage>(
    instance: &InstanceRef,
    part: Part,
    ray: &Ray,
    t_max: &mut f32,
    best: &mut Hit,
    ray_id: u32,
    coverage: &C,
    stack: &mut Stack,
) {
    let blas = &*instance.blas;
    if let Some(other) = &blas.other {
        in_local(instance, ray, |local| nearest_in_other(other, instance, part, local, t_max, best, ray_id, coverage));
        return;
    }
    let arena = blas.tree.arena.granules();
    in_local(instance, ray, |local| {
        blas.tree.walk::<true>(Some(part.root), local, t_max, stack, &mut (), |block, t_max| {
            let block = TriangleBlock::at(arena, block);
            let met = block.intersect(local, *t_max);
            let mut lanes = met.hits;
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize & (LANES - 1);
                lanes &= lanes - 1;
                let found = hit_of(&met, block, part.instance, lane);
                let nearer = found.t < best.t
                    || found.t == best.t && (part.instance, found.triangle) < (best.instance, best.triangle);
                if nearer && (C::TRIVIAL || !instance.check || coverage.covers(ray_id, &found)) {
                    *best = found;
                    *t_max = found.t;
                }
            }
            false
        })
    });
}

/// As [`nearest_in`], where the triangles are not in an eight-wide tree.
fn nearest_in_other<C: Coverage>(
    other: &Other,
    instance: &InstanceRef,
    part: Part,
    local: &Ray,
    t_max: &mut f32,
    best: &mut Hit,
    ray_id: u32,
    coverage: &C,
) {
    let before = *best;
    let mut found = Nearest::none(*t_max);
    other.nearest(local, &mut found, |triangle, hit| {
        // An instance is entered once: of its own triangles the structure takes the smaller at equal t.
        (hit.t < before.t || part.instance < before.instance)
            && (C::TRIVIAL || !instance.check || coverage.covers(ray_id, &placed(part.instance, triangle, hit)))
    });
    if found.triangle != NONE {
        let Nearest { t, triangle, b1, b2, back } = found;
        *best = Hit { t, instance: part.instance, triangle, b1, b2, back };
        *t_max = t;
    }
}

/// A hit of a mesh as one of an instance.
#[inline(always)]
fn placed(instance: u32, triangle: u32, &TriangleHit { t, b1, b2, back }: &TriangleHit) -> Hit {
    Hit { t, instance, triangle, b1, b2, back }
}

#[inline(always)]
pub(super) fn hit_of(met: &BlockHit, block: &TriangleBlock, instance: u32, lane: usize) -> Hit {
    Hit {
        t: met.t[lane],
        instance,
        triangle: block.row(lane),
        b1: met.b1[lane],
        b2: met.b2[lane],
        back: met.back >> lane & 1 == 1,
    }
}

#[inline(always)]
fn occluded_in<C: Coverage>(
    instance: &InstanceRef,
    part: Part,
    ray: &Ray,
    t_max: f32,
    ray_id: u32,
    coverage: &C,
    stack: &mut Stack,
) -> bool {
    let blas = &*instance.blas;
    if let Some(other) = &blas.other {
        let accept = |triangle: u32, hit: &TriangleHit| {
            C::TRIVIAL || !instance.check || coverage.covers(ray_id, &placed(part.instance, triangle, hit))
        };
        return in_local(instance, ray, |local| other.occluded(local, t_max, accept));
    }
    let arena = blas.tree.arena.granules();
    let mut found = false;
    let mut t_end = t_max;
    in_local(instance, ray, |local| {
        blas.tree.walk::<false>(Some(part.root), local, &mut t_end, stack, &mut (), |block, t_end| {
            let block = TriangleBlock::at(arena, block);
            let met = block.intersect(local, *t_end);
            found = met.hits != 0
                && (C::TRIVIAL
                    || !instance.check
                    || (0..LANES).any(|lane| {
                        met.hits >> lane & 1 == 1 && coverage.covers(ray_id, &hit_of(&met, block, part.instance, lane))
                    }));
            found
        })
    });
    found
}

/// What the top level leads to, with boxes in the world: whole meshes, but of large ones the subtrees.
///
/// Meshes overlap, and the box of a large one says little of where its triangles are; opened, the top level can lead a
/// ray past what it would have had to enter (Benthin et al. 2017, "Improved Two-Level BVHs using Partial
/// Re-Braiding"). A part that has a transform of its own costs more to enter, so fewer of those are made.
fn open(instances: &[InstanceRef], boxes: Vec<Aabb>, scene_area: f32) -> (Vec<Part>, Vec<Aabb>) {
    let most = 4 * instances.len() + 2048;
    let (mut parts, mut bounds) = (Vec::new(), Vec::new());
    for (row, (instance, whole)) in instances.iter().zip(boxes).enumerate() {
        let Some(root) = instance.blas.root() else { continue };
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
fn world_bounds(instance: &InstanceRef, local: &Aabb) -> Aabb {
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
    use glam::{DAffine3, DMat3, DQuat, DVec3};

    use super::*;
    use crate::accel::{
        AccelKind, Solid, family,
        tests::{Sieve, Wave, placed},
    };

    /// As [`placed`], but anyhow.
    fn turned(blas: &Arc<Blas>, world_from_local: DAffine3) -> InstanceRef {
        let rows = |m: DAffine3| -> [f32; 12] {
            let [x, y, z, w] = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis, m.translation];
            std::array::from_fn(|i| [x, y, z, w][i % 4][i / 4] as f32)
        };
        let [world_from_local, local_from_world] = [world_from_local, world_from_local.inverse()].map(rows);
        InstanceRef { blas: Arc::clone(blas), world_from_local, local_from_world, identity: false, check: false }
    }

    /// Meshes in a structure: where they were made, moved, turned and stretched, mirrored, in the same place twice, and
    /// one that is empty. Every other one is asked about its coverage.
    fn scene(kind: AccelKind) -> Vec<InstanceRef> {
        let [soup, torus, twice, none] = [
            family::soup(400, 0.3, 21),
            family::torus(24, 16),
            [family::soup(30, 0.5, 22), family::soup(30, 0.5, 22)].concat(),
            Vec::new(),
        ]
        .map(|triangles| Arc::new(Blas::build_as(kind, &triangles)));
        let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -3.0).normalize(), 0.7);
        let stretch = DMat3::from_quat(turn) * DMat3::from_diagonal(DVec3::new(1.5, 0.4, 0.9));
        let mirror = DMat3::from_quat(turn.inverse()) * DMat3::from_diagonal(DVec3::new(-1.0, 0.7, 1.1));
        let at = |linear: DMat3, x: f64, y: f64, z: f64| DAffine3 { matrix3: linear, translation: DVec3::new(x, y, z) };
        let mut instances = vec![
            placed(&torus, 1.0, 0.0),
            placed(&none, 1.0, 0.0),
            turned(&torus, at(stretch, 1.0, -0.5, 0.3)),
            turned(&soup, at(mirror, 0.5, 0.2, -1.0)),
            placed(&soup, -2.0, 0.5),
            placed(&twice, 1.0, 0.0),
            placed(&twice, 1.0, 0.0),
            turned(&twice, at(mirror, -1.0, 0.0, 0.0)),
            turned(&twice, at(mirror, -1.0, 0.0, 0.0)),
            placed(&torus, 1.0, 0.0),
        ];
        instances.iter_mut().step_by(2).for_each(|one| one.check = true);
        instances
    }

    /// Answers to all rays: what each meets, and whether it meets anything.
    fn answers<C: Coverage>(accel: &Accel, wave: &Wave, coverage: &C) -> Vec<(Hit, bool)> {
        let mut answers = vec![(NO_HIT, false); wave.0.len()];
        accel.nearest_of(wave, coverage, |index, hit| answers[index].0 = *hit);
        accel.occluded_of(wave, coverage, |index, occluded| answers[index].1 = occluded);
        answers
    }

    #[test]
    fn placed_meshes_are_hit_alike_in_every_structure() {
        // Rays through all of the scene, some of which end within it.
        let corners = [-3.0, 3.0].map(|x| [[x; 3], [x, x, -x], [x, -x, -x]]);
        let around = [family::torus(12, 8), corners.to_vec()].concat();
        let ends = [f32::INFINITY, 0.8, f32::INFINITY, 1.3];
        let rays = family::rays(&around, 6000, 23).into_iter().zip(ends.iter().cycle());
        let wave = Wave(rays.map(|(ray, end)| (ray.origin, ray.direction, *end)).collect());
        let accel = Accel::build(scene(AccelKind::default()));
        let (solid, sieved) = (answers(&accel, &wave, &Solid), answers(&accel, &wave, &Sieve));
        let hits = solid.iter().filter(|(hit, _)| hit.instance != NONE).count();
        let through = solid.iter().zip(&sieved).filter(|(a, b)| a != b).count();
        let instances = |row: u32| solid.iter().filter(|(hit, _)| hit.instance == row).count();
        assert!(hits > 2000 && through > 300 && (0..5).all(|row| row == 1 || instances(row) > 50), "{hits} {through}");
        assert_eq!(instances(6) + instances(8) + instances(9), 0, "of equal ones the first is hit");
        for kind in AccelKind::ALL {
            let other = Accel::build(scene(kind));
            assert_eq!(other.bounds(), accel.bounds());
            assert_eq!(other.others, kind != AccelKind::default(), "{}", kind.name());
            let got = [answers(&other, &wave, &Solid), answers(&other, &wave, &Sieve)];
            for (got, want) in got.iter().zip([&solid, &sieved]) {
                for (index, (got, want)) in got.iter().zip(want).enumerate() {
                    assert_eq!(got, want, "{}: ray {index} {:?}", kind.name(), wave.0[index]);
                }
            }
        }
    }

    /// Structures may even be mixed.
    #[test]
    fn each_mesh_may_be_in_another_structure() {
        let triangles = family::soup(300, 0.3, 24);
        let scene = |kinds: &[AccelKind]| {
            let place = |(i, kind): (usize, &AccelKind)| {
                placed(&Arc::new(Blas::build_as(*kind, &triangles)), 1.0 + i as f32, 0.3)
            };
            Accel::build(kinds.iter().enumerate().map(place).collect())
        };
        let rays = family::rays(&triangles, 2000, 25).into_iter();
        let wave = Wave(rays.map(|ray| (ray.origin, ray.direction, f32::INFINITY)).collect());
        let [mixed, plain] = [AccelKind::ALL, [AccelKind::default(); 7]].map(|kinds| scene(&kinds));
        assert!(answers(&mixed, &wave, &Sieve) == answers(&plain, &wave, &Sieve));
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
