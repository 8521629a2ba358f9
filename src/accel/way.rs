//! How rays get into an instance.

use rayon::prelude::*;
use wide::f32x4;

use super::{InstanceRef, open::SHARE, triangle::Ray};

/// Local from world space, by columns, the last of which is the offset: a ray is led into an instance in vectors of its
/// three coordinates, which takes half the instructions of one after the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Way([f32x4; 4]);

impl Way {
    fn into(instance: &InstanceRef) -> Self {
        let m = &instance.local_from_world;
        Self([0, 1, 2, 3].map(|column| f32x4::new([m[column], m[4 + column], m[8 + column], 0.0])))
    }

    /// Into each instance.
    pub fn into_all(instances: &[InstanceRef]) -> Vec<Self> {
        // Few are no reason to wake another thread.
        if instances.len() > SHARE {
            instances.par_iter().with_min_len(SHARE).map(Self::into).collect()
        } else {
            instances.iter().map(Self::into).collect()
        }
    }

    /// A ray as the mesh sees it, with the roundings of a number at a time: no product is fused with a sum.
    #[inline(always)]
    pub fn lead(&self, origin: [f32; 3], direction: [f32; 3]) -> Ray {
        let Self([x, y, z, offset]) = *self;
        let linear = |of: [f32; 3]| x * f32x4::splat(of[0]) + y * f32x4::splat(of[1]) + z * f32x4::splat(of[2]);
        Ray::of(linear(origin) + offset, linear(direction))
    }
}

/// A 3×4 matrix, by rows, times a point.
#[cfg(test)]
pub(super) fn transform_point(m: &[f32; 12], p: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|row| {
        let m = &m[row * 4..row * 4 + 4];
        m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3]
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::accel::{Blas, tests::numbers};

    /// The linear part of a 3×4 matrix, by rows, times a vector.
    fn transform_vector(m: &[f32; 12], v: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|row| {
            let m = &m[row * 4..row * 4 + 4];
            m[0] * v[0] + m[1] * v[1] + m[2] * v[2]
        })
    }

    #[test]
    fn rays_are_led_in_as_they_are_a_number_at_a_time() {
        let mut random = numbers(3);
        for _ in 0..10_000 {
            let local_from_world: [f32; 12] = std::array::from_fn(|_| 20.0 * (random() - 0.5));
            let [origin, mut direction]: [[f32; 3]; 2] = std::array::from_fn(|_| [0; 3].map(|_| random() - 0.5));
            direction[0] = if random() < 0.25 { -0.0 } else { direction[0] };
            let instance =
                InstanceRef { local_from_world, identity: false, ..InstanceRef::unmoved(Arc::new(Blas::default())) };
            let got = Way::into(&instance).lead(origin, direction);
            let m = &local_from_world;
            let want = Ray::new(transform_point(m, origin), transform_vector(m, direction));
            let bits = |ray: &Ray| [ray.origin, ray.direction, ray.inverse, ray.shear].map(|of| of.map(f32::to_bits));
            assert_eq!((bits(&got), got.axes), (bits(&want), want.axes));
        }
    }
}
