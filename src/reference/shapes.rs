//! Surfaces given by a formula: where it is zero, in local space.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DVec2, DVec3};

use super::{
    geometry::{Ray, Triangle, transforms},
    rng::Rng,
};
use crate::{flat::FlatScene, world::Shape};

/// A shape in the world.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    shape: Shape,
    /// Row of the instance.
    pub instance: u32,
    world_from_local: DAffine3,
}

/// All shapes of a scene.
pub fn placed_shapes(scene: &FlatScene) -> Vec<Placed> {
    let instances = 0..scene.instances.len() as u32;
    let placed = instances.filter_map(|instance| {
        let shape = scene.meshes[scene.instances.mesh[instance as usize] as usize].shape?;
        Some(Placed { shape, instance, world_from_local: transforms(scene, instance).0 })
    });
    placed.collect()
}

impl Placed {
    /// All distances at which a ray crosses the surface, within its part that counts, with the point in local space.
    pub fn crossings(&self, ray: &Ray) -> Vec<(f64, DVec3)> {
        let local_from_world = self.world_from_local.inverse();
        let o = local_from_world.transform_point3(ray.origin);
        let d = local_from_world.transform_vector3(ray.direction);
        // a t² + 2 b t + c = 0
        let (a, b, c) = match self.shape {
            Shape::Sphere { radius } => (d.dot(d), o.dot(d), o.dot(o) - f64::from(radius).powi(2)),
            Shape::Cylinder { radius, .. } => {
                (d.x * d.x + d.z * d.z, o.x * d.x + o.z * d.z, o.x * o.x + o.z * o.z - f64::from(radius).powi(2))
            }
            Shape::Disc { .. } | Shape::Plane => (0.0, 0.5 * d.y, o.y),
        };
        let root = (b * b - a * c).sqrt();
        let roots = if a == 0.0 { vec![-0.5 * c / b] } else { vec![(-b - root) / a, (-b + root) / a] };
        let crossings = roots.into_iter().filter(|&t| t > ray.t_min && t < ray.t_max).map(|t| (t, o + t * d));
        let within = |p: DVec3| match self.shape {
            Shape::Sphere { .. } | Shape::Plane => true,
            Shape::Disc { radius } => p.length() <= f64::from(radius),
            Shape::Cylinder { half_height, .. } => p.y.abs() <= f64::from(half_height),
        };
        crossings.filter(|&(_, p)| within(p)).collect()
    }

    /// The plane that touches the surface in a local point, as a triangle whose first corner that point is.
    pub fn facet(&self, p: DVec3) -> Triangle {
        let (along, across) = self.normal(p).any_orthonormal_pair();
        Triangle {
            p0: self.world_from_local.transform_point3(p),
            e1: self.world_from_local.transform_vector3(along),
            e2: self.world_from_local.transform_vector3(across),
            instance: self.instance,
            triangle: 0,
        }
    }

    /// Unit normal in local space: the gradient of the formula.
    fn normal(&self, p: DVec3) -> DVec3 {
        let gradient = match self.shape {
            Shape::Sphere { .. } => p,
            Shape::Cylinder { .. } => p * DVec3::new(1.0, 0.0, 1.0),
            Shape::Disc { .. } | Shape::Plane => DVec3::Y,
        };
        gradient.normalize()
    }

    /// Texture coordinates of a local point.
    pub fn uv(&self, p: DVec3) -> DVec2 {
        let turn = (p.z.atan2(p.x) / TAU).rem_euclid(1.0);
        match self.shape {
            Shape::Sphere { radius } => DVec2::new(turn, (p.y / f64::from(radius)).clamp(-1.0, 1.0).acos() / PI),
            Shape::Plane => DVec2::new(p.x, p.z),
            Shape::Disc { radius } => 0.5 * (DVec2::new(p.x, p.z) / f64::from(radius) + 1.0),
            Shape::Cylinder { half_height, .. } => {
                DVec2::new(turn, (f64::from(half_height) - p.y) / f64::from(2.0 * half_height))
            }
        }
    }

    /// Tangent of growing u, and whether the bitangent is n × t (1) or its opposite (−1).
    pub fn tangent(&self, p: DVec3) -> [f64; 4] {
        match self.shape {
            Shape::Sphere { .. } | Shape::Cylinder { .. } => [-p.z, 0.0, p.x, -1.0],
            Shape::Disc { .. } | Shape::Plane => [1.0, 0.0, 0.0, 1.0],
        }
    }

    /// Area in local space, m²; `None` if it is infinite.
    pub fn area(&self) -> Option<f64> {
        match self.shape {
            Shape::Sphere { radius } => Some(4.0 * PI * f64::from(radius).powi(2)),
            Shape::Plane => None,
            Shape::Disc { radius } => Some(PI * f64::from(radius).powi(2)),
            Shape::Cylinder { radius, half_height } => Some(TAU * f64::from(radius) * f64::from(2.0 * half_height)),
        }
    }

    /// A point in local space, uniform by area there: of what is around it, if that falls on the surface.
    pub fn sample(&self, rng: &mut Rng) -> DVec3 {
        let mut between = || 2.0 * rng.uniform() - 1.0;
        loop {
            let [x, y, z] = std::array::from_fn(|_| between());
            let (cube, square) = (DVec3::new(x, y, z), DVec3::new(x, 0.0, z));
            match self.shape {
                Shape::Sphere { radius } if (1e-3..1.0).contains(&cube.length()) => {
                    return f64::from(radius) * cube.normalize();
                }
                Shape::Disc { radius } if square.length() < 1.0 => return f64::from(radius) * square,
                Shape::Cylinder { radius, half_height } if (1e-3..1.0).contains(&square.length()) => {
                    return f64::from(radius) * square.normalize() + f64::from(half_height) * y * DVec3::Y;
                }
                Shape::Plane => return DVec3::ZERO,
                _ => {}
            }
        }
    }

    /// Density by area in the world of [`Self::sample`] at a local point, 1/m².
    pub fn pdf(&self, p: DVec3) -> f64 {
        // A unit square of the touching plane becomes a parallelogram.
        let stretch = self.facet(p).cross().length();
        self.area().map_or(0.0, |area| 1.0 / (area * stretch))
    }

    /// The largest coordinate in the world, m, of a box around it; of a plane that of a metre of it.
    pub fn reach(&self) -> f64 {
        let half = match self.shape {
            Shape::Sphere { radius } | Shape::Disc { radius } => DVec3::splat(radius.into()),
            Shape::Plane => DVec3::ONE,
            Shape::Cylinder { radius, half_height } => DVec3::new(radius.into(), half_height.into(), radius.into()),
        };
        let corner = |i: u32| {
            half * DVec3::new(
                [-1.0, 1.0][i as usize & 1],
                [-1.0, 1.0][i as usize >> 1 & 1],
                [-1.0, 1.0][i as usize >> 2],
            )
        };
        (0..8).map(|i| self.world_from_local.transform_point3(corner(i)).abs().max_element()).fold(0.0, f64::max)
    }
}
