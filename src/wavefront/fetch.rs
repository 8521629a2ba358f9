//! What shading reads of meshes and instances: rows here and there in memory, made columns of lanes.

use super::surface::Incoming;
use crate::{
    flat::{FlatMesh, FlatScene},
    simd::{LANES, Mask, Real, V3},
};

/// The linear part of 3×4 matrices, transposed, times vectors: takes normals from the space that the
/// matrix leads to back to the one it comes from.
#[inline(always)]
pub fn transposed<F: Real>(m: &[F; 12], v: V3<F>) -> V3<F> {
    V3::new(
        m[0] * v.x + m[4] * v.y + m[8] * v.z,
        m[1] * v.x + m[5] * v.y + m[9] * v.z,
        m[2] * v.x + m[6] * v.y + m[10] * v.z,
    )
}

#[inline(always)]
fn row<F: Real>(m: &[F; 12], r: usize) -> V3<F> {
    V3::new(m[4 * r], m[4 * r + 1], m[4 * r + 2])
}

/// The linear part of 3×4 matrices times vectors.
#[inline(always)]
pub fn linear<F: Real>(m: &[F; 12], v: V3<F>) -> V3<F> {
    V3::new(row(m, 0).dot(v), row(m, 1).dot(v), row(m, 2).dot(v))
}

/// The same with all magnitudes.
#[inline(always)]
pub fn linear_abs<F: Real>(m: &[F; 12], v: V3<F>) -> V3<F> {
    V3::new(row(m, 0).abs().dot(v), row(m, 1).abs().dot(v), row(m, 2).abs().dot(v))
}

/// What 3×4 matrices add.
#[inline(always)]
pub fn translation<F: Real>(m: &[F; 12]) -> V3<F> {
    V3::new(m[3], m[7], m[11])
}

/// Positions and normals as fetched.
pub struct Fetched<F> {
    /// Of the triangle.
    pub corners: [V3<F>; 3],
    /// At its corners, zero without any.
    pub normals: [V3<F>; 3],
    /// By rows, of lanes with a transform.
    pub world_from_local: [F; 12],
    /// By rows, of lanes with a transform.
    pub local_from_world: [F; 12],
    /// −1 where the transform mirrors, else 1.
    pub mirror: F,
    /// Some lane has normals.
    pub any_normals: bool,
    /// Some lane has a transform.
    pub any_transform: bool,
    /// Lanes with normals. What they need leaves the others as they would be alone: no bit may depend on who shares a
    /// block.
    pub smooth: u32,
    /// Lanes with a transform.
    pub transformed: u32,
    /// Lanes on a shape: their first corner is the point itself, their second the normal.
    pub shaped: u32,
}

/// The rows of a column that vertices have, for one corner of the triangles in all lanes; zero for shapes.
#[inline(always)]
fn corner<'a, F: Real>(vertices: &[[u32; 3]; LANES], corner: usize, column: impl Fn(usize) -> &'a [[f32; 3]]) -> V3<F> {
    V3::from_fn(|lane| column(lane).get(vertices[lane][corner] as usize).copied().unwrap_or_default())
}

#[inline(always)]
fn matrices<F: Real>(column: &[[f32; 12]], instances: &[u32; LANES]) -> [F; 12] {
    let part = |i: usize| F::columns_of_four(|lane| column[instances[lane] as usize].as_chunks().0[i]);
    let ([a, b, c, d], [e, f, g, h], [i, j, k, l]) = (part(0), part(1), part(2));
    [a, b, c, d, e, f, g, h, i, j, k, l]
}

/// What hits need of meshes and instances.
#[inline(always)]
pub fn fetch<F: Real>(scene: &FlatScene, hits: &Incoming<F>) -> Fetched<F> {
    let mesh_of = |lane: usize| &*scene.meshes[scene.instances.mesh[hits.instance[lane] as usize] as usize];
    let (mut meshes, mut vertices) = ([mesh_of(0); LANES], [[0; 3]; LANES]);
    let (mut smooth, mut transformed, mut shaped) = (0, 0, 0);
    for lane in 0..F::LANES {
        let mesh = mesh_of(lane);
        meshes[lane] = mesh;
        transformed |= u32::from(scene.instances.identity[hits.instance[lane] as usize] == 0) << lane;
        match mesh.triangles.get(hits.triangle[lane] as usize) {
            Some(triangle) => vertices[lane] = *triangle,
            None => shaped |= 1 << lane,
        }
        smooth |= u32::from(!mesh.normals.is_empty()) << lane;
    }
    let (any_normals, any_transform) = (smooth != 0, transformed != 0);
    let mut f = Fetched {
        corners: [0, 1, 2].map(|i| corner(&vertices, i, |lane| &meshes[lane].positions)),
        normals: [V3::splat(0.0); 3],
        world_from_local: [F::zero(); 12],
        local_from_world: [F::zero(); 12],
        mirror: F::one(),
        any_normals,
        any_transform,
        smooth,
        transformed,
        shaped,
    };
    if any_normals {
        f.normals = [0, 1, 2].map(|i| corner(&vertices, i, |lane| &meshes[lane].normals));
    }
    if shaped != 0 {
        fetch_shapes(&mut f, &meshes, hits);
    }
    if any_transform {
        let instances = &scene.instances;
        f.world_from_local = matrices(&instances.world_from_local, &hits.instance);
        f.local_from_world = matrices(&instances.local_from_world, &hits.instance);
        let mirrored = |lane: usize| instances.mirrored[hits.instance[lane] as usize] == 1;
        f.mirror = F::from_fn(|lane| if mirrored(lane) { -1.0 } else { 1.0 });
    }
    f
}

/// Of hits of shapes, whose numbers say where on them.
#[cold]
#[inline(never)]
fn fetch_shapes<F: Real>(f: &mut Fetched<F>, meshes: &[&FlatMesh; LANES], hits: &Incoming<F>) {
    for lane in (0..F::LANES).filter(|lane| f.shaped >> lane & 1 == 1) {
        let Some(shape) = meshes[lane].shape else { continue };
        let p = shape.point(hits.triangle[lane], hits.b1.lane(lane), hits.b2.lane(lane));
        let here = F::Mask::from_bits(1 << lane);
        for (corner, v) in f.corners.iter_mut().zip([p, shape.normal(p)]) {
            *corner = V3::select(here, V3::from_array(v.as_vec3().to_array()), *corner);
        }
    }
}
