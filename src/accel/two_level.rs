//! Meshes placed in the world: a tree over instances, each with the tree of its mesh.

use std::sync::Arc;

use obvhs::aabb::Aabb;
use rayon::prelude::*;

use super::{
    Coverage,
    bvh8::{Bvh8, Quality, Stack, bounds_of},
    triangle::{BlockHit, Ray, TriangleBlock},
};
use crate::{flat::NONE, simd::LANES};

/// Rays against the triangles of one mesh, in its local space.
#[derive(Clone, Debug)]
pub struct Blas {
    tree: Bvh8,
    /// One for each leaf.
    blocks: Vec<TriangleBlock>,
    bounds: Aabb,
}

impl Default for Blas {
    fn default() -> Self {
        Self { tree: Bvh8::default(), blocks: Vec::new(), bounds: Aabb::empty() }
    }
}

impl Blas {
    /// Over triangles given by their corners, which must be finite.
    pub fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        let boxes: Vec<Aabb> = triangles.par_iter().map(|&corners| bounds_of(corners)).collect();
        let bounds = boxes.iter().fold(Aabb::empty(), |all, one| all.union(one));
        let mut tree = Bvh8::build(&boxes, Quality::Good);
        let order = std::mem::take(&mut tree.order);
        let blocks = tree.number_leaves(|positions| {
            TriangleBlock::new(order[positions].iter().map(|&row| (row, triangles[row as usize])))
        });
        Self { tree, blocks, bounds }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.tree.bytes() + self.blocks.len() * size_of::<TriangleBlock>()
    }

    /// Lowest and highest corner; lowest above highest if there is no triangle.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        (self.bounds.min.to_array(), self.bounds.max.to_array())
    }
}

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

/// Rays against the whole scene.
#[derive(Clone, Debug, Default)]
pub struct Accel {
    tree: Bvh8,
    instances: Vec<InstanceRef>,
    bounds: Option<([f32; 3], [f32; 3])>,
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
        let boxes: Vec<Aabb> = instances.par_iter().map(world_bounds).collect();
        let tree = Bvh8::build(&boxes, Quality::Fast);
        let all = boxes.iter().filter(|one| one.valid()).fold(Aabb::empty(), |all, one| all.union(one));
        let bounds = all.valid().then(|| (all.min.to_array(), all.max.to_array()));
        Self { tree, instances, bounds }
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
        self.tree.bytes() + self.instances.len() * size_of::<InstanceRef>()
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
        if let [only] = self.instances.as_slice() {
            nearest_in(only, 0, &ray, &mut t_max, &mut best, ray_id, coverage, mesh);
        } else {
            self.tree.walk::<true>(&ray, &mut t_max, top, |first, count, t_max| {
                for &row in &self.tree.order[first..first + count] {
                    nearest_in(&self.instances[row as usize], row, &ray, t_max, &mut best, ray_id, coverage, mesh);
                }
                false
            });
        }
        best
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
        if let [only] = self.instances.as_slice() {
            return occluded_in(only, 0, &ray, t_max, ray_id, coverage, mesh);
        }
        let mut found = false;
        self.tree.walk::<false>(&ray, &mut t_max, top, |first, count, t_max| {
            found = self.tree.order[first..first + count]
                .iter()
                .any(|&row| occluded_in(&self.instances[row as usize], row, &ray, *t_max, ray_id, coverage, mesh));
            found
        });
        found
    }
}

/// The ray as the instance's mesh sees it.
#[inline(always)]
fn to_local(instance: &InstanceRef, ray: &Ray) -> Ray {
    if instance.identity {
        return *ray;
    }
    let m = &instance.local_from_world;
    Ray::new(transform_point(m, ray.origin), transform_vector(m, ray.direction))
}

#[inline(always)]
fn nearest_in<C: Coverage>(
    instance: &InstanceRef,
    row: u32,
    ray: &Ray,
    t_max: &mut f32,
    best: &mut Hit,
    ray_id: u32,
    coverage: &C,
    stack: &mut Stack,
) {
    let local = to_local(instance, ray);
    let blas = &*instance.blas;
    blas.tree.walk::<true>(&local, t_max, stack, |block, _, t_max| {
        let block = &blas.blocks[block];
        let met = block.intersect(&local, *t_max);
        let mut lanes = met.hits;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize & (LANES - 1);
            lanes &= lanes - 1;
            let found = hit_of(&met, block, row, lane);
            let nearer =
                found.t < best.t || found.t == best.t && (row, found.triangle) < (best.instance, best.triangle);
            if nearer && (C::TRIVIAL || !instance.check || coverage.covers(ray_id, &found)) {
                *best = found;
                *t_max = found.t;
            }
        }
        false
    });
}

#[inline(always)]
fn hit_of(met: &BlockHit, block: &TriangleBlock, instance: u32, lane: usize) -> Hit {
    Hit {
        t: met.t[lane],
        instance,
        triangle: block.rows[lane],
        b1: met.b1[lane],
        b2: met.b2[lane],
        back: met.back >> lane & 1 == 1,
    }
}

#[inline(always)]
fn occluded_in<C: Coverage>(
    instance: &InstanceRef,
    row: u32,
    ray: &Ray,
    t_max: f32,
    ray_id: u32,
    coverage: &C,
    stack: &mut Stack,
) -> bool {
    let local = to_local(instance, ray);
    let blas = &*instance.blas;
    let mut found = false;
    let mut t_end = t_max;
    blas.tree.walk::<false>(&local, &mut t_end, stack, |block, _, t_end| {
        let block = &blas.blocks[block];
        let met = block.intersect(&local, *t_end);
        found = met.hits != 0
            && (C::TRIVIAL
                || !instance.check
                || (0..LANES)
                    .any(|lane| met.hits >> lane & 1 == 1 && coverage.covers(ray_id, &hit_of(&met, block, row, lane))));
        found
    });
    found
}

/// A box in the world that holds the instance, grown by the rounding of its transform.
fn world_bounds(instance: &InstanceRef) -> Aabb {
    let (lo, hi) = instance.blas.bounds();
    if lo[0] > hi[0] {
        return Aabb::empty();
    }
    if instance.identity {
        return instance.blas.bounds;
    }
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
