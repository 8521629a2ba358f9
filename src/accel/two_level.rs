//! Meshes placed in the world: a tree over instances, each with the tree of its mesh.

use std::sync::Arc;

use obvhs::aabb::Aabb;
use rayon::prelude::*;

use super::{
    Coverage,
    bvh2::{Bvh2, Quality, Stack, bounds_of},
    triangle::{self, Ray},
};
use crate::flat::NONE;

/// A triangle beside its row, as leaves hold them.
#[derive(Clone, Copy, Debug)]
struct LeafTriangle {
    corners: [[f32; 3]; 3],
    row: u32,
}

/// Rays against the triangles of one mesh, in its local space.
#[derive(Clone, Debug)]
pub struct Blas {
    tree: Bvh2,
    triangles: Vec<LeafTriangle>,
    bounds: Aabb,
}

impl Default for Blas {
    fn default() -> Self {
        Self { tree: Bvh2::default(), triangles: Vec::new(), bounds: Aabb::empty() }
    }
}

impl Blas {
    /// Over triangles given by their corners, which must be finite.
    pub fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        let boxes: Vec<Aabb> = triangles.par_iter().map(|&corners| bounds_of(corners)).collect();
        let tree = Bvh2::build(&boxes, Quality::Good);
        let bounds = boxes.iter().fold(Aabb::empty(), |all, one| all.union(one));
        let triangles = tree.order.iter().map(|&row| LeafTriangle { corners: triangles[row as usize], row }).collect();
        Self { tree, triangles, bounds }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.tree.bytes() + self.triangles.len() * size_of::<LeafTriangle>()
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
    tree: Bvh2,
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
        let tree = Bvh2::build(&boxes, Quality::Fast);
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
            self.tree.walk(&ray, &mut t_max, top, |first, count, t_max| {
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
        self.tree.walk(&ray, &mut t_max, top, |first, count, t_max| {
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
    blas.tree.walk(&local, t_max, stack, |first, count, t_max| {
        for leaf in &blas.triangles[first..first + count] {
            if let Some(hit) = triangle::intersect(&local, &leaf.corners, *t_max) {
                let found = Hit { t: hit.t, instance: row, triangle: leaf.row, b1: hit.b1, b2: hit.b2, back: hit.back };
                let nearer = hit.t < best.t || (row, leaf.row) < (best.instance, best.triangle);
                if nearer && (C::TRIVIAL || !instance.check || coverage.covers(ray_id, &found)) {
                    *best = found;
                    *t_max = hit.t;
                }
            }
        }
        false
    });
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
    blas.tree.walk(&local, &mut t_end, stack, |first, count, t_end| {
        found = blas.triangles[first..first + count].iter().any(|leaf| {
            triangle::intersect(&local, &leaf.corners, *t_end).is_some_and(|hit| {
                C::TRIVIAL || !instance.check || {
                    let hit =
                        Hit { t: hit.t, instance: row, triangle: leaf.row, b1: hit.b1, b2: hit.b2, back: hit.back };
                    coverage.covers(ray_id, &hit)
                }
            })
        });
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
