//! Surfaces that are given by a formula and not by triangles.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

/// A surface by its formula: round from however near it is seen, and of no size in memory.
///
/// In local space, metres, about the origin with +Y up; the entity's transform may stretch, shear and mirror it. The
/// material is that of slot 0 of [`MaterialSlots`](super::MaterialSlots). An entity shows a shape or a
/// [`Geometry`](super::Geometry); of one that has both, the shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A sphere, its front outside.
    ///
    /// Texture coordinates are those of [`TriMesh::sphere`](super::TriMesh::sphere): u runs once around from +X over +Z,
    /// v from +Y to −Y with the angle.
    Sphere {
        /// m.
        radius: f32,
    },
    /// The plane y = 0 without end, its front +Y.
    ///
    /// u and v are x and z: a texture repeats with every metre. It is no part of the scene's size. Where it emits, only
    /// rays that are scattered find it: without a finite area there is nothing to draw a point from.
    Plane,
    /// A disc in the plane y = 0, its front +Y.
    ///
    /// u and v run from 0 to 1 along x and z: the texture's square lies about the disc.
    Disc {
        /// m.
        radius: f32,
    },
    /// A tube about the Y axis, open at both ends, its front outside.
    ///
    /// u runs once around from +X over +Z, v from 0 at the upper rim to 1 at the lower.
    Cylinder {
        /// m.
        radius: f32,
        /// Distance of either rim from the plane y = 0, m.
        half_height: f32,
    },
}

impl Shape {
    /// Says what is wrong with the shape, if anything.
    ///
    /// # Errors
    /// One sentence that names the number.
    pub fn check(&self) -> Result<(), String> {
        let sizes = match *self {
            Self::Sphere { radius } | Self::Disc { radius } => vec![("radius", radius)],
            Self::Plane => vec![],
            Self::Cylinder { radius, half_height } => vec![("radius", radius), ("half height", half_height)],
        };
        for (name, size) in sizes {
            // Below the normal numbers there is no precision left to bound errors with.
            if !(size.is_normal() && size > 0.0) {
                return Err(format!("its {name} of {size} m is not a positive number"));
            }
        }
        Ok(())
    }

    /// Area in local space, m²; infinite for a plane.
    ///
    /// With it, [`Lumens::over_area`](super::units::Lumens::over_area) gives the luminance of a shape that is not scaled.
    pub fn area(&self) -> f64 {
        match *self {
            Self::Sphere { radius } => 4.0 * PI * f64::from(radius).powi(2),
            Self::Plane => f64::INFINITY,
            Self::Disc { radius } => PI * f64::from(radius).powi(2),
            Self::Cylinder { radius, half_height } => 4.0 * PI * f64::from(radius) * f64::from(half_height),
        }
    }

    /// Area in the world, m², of a shape that is placed by a transform of this linear part.
    ///
    /// Exact where that scales evenly, and for discs; else a sum over the surface, right to five digits unless the shape
    /// is pressed nearly flat.
    pub fn area_under(&self, world_from_local: DMat3) -> f64 {
        // Around, and from end to end.
        const STEPS: [usize; 2] = [64, 256];
        let cofactors = cofactors(world_from_local);
        let [x, y, z] = [cofactors.x_axis, cofactors.y_axis, cofactors.z_axis];
        let skew = [x.dot(y), y.dot(z), z.dot(x)].map(f64::abs).into_iter().fold(0.0, f64::max);
        let even = (x.length() - y.length()).abs().max((y.length() - z.length()).abs());
        let largest = x.length().max(y.length()).max(z.length());
        let stretch = match self {
            Self::Plane | Self::Disc { .. } => y.length(),
            _ if skew <= 1e-12 * largest * largest && even <= 1e-12 * largest => largest,
            _ => {
                let [around, along] = STEPS;
                let rows = if matches!(self, Self::Sphere { .. }) { along } else { 1 };
                let places = (0..rows * around).map(|i| {
                    let (row, column) = (i / around, i % around);
                    let y = if rows == 1 { 0.0 } else { 1.0 - (2 * row + 1) as f64 / rows as f64 };
                    let (sin, cos) = (2.0 * PI * column as f64 / around as f64).sin_cos();
                    let radius = (1.0 - y * y).sqrt();
                    (cofactors * DVec3::new(radius * cos, y, radius * sin)).length()
                });
                places.sum::<f64>() / (rows * around) as f64
            }
        };
        self.area() * stretch
    }
}

/// What takes a normal, as long as a piece of surface is large, from the space that `m` comes from to the one it leads to.
pub(crate) fn cofactors(m: DMat3) -> DMat3 {
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_must_be_positive_numbers() {
        for bad in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-40] {
            assert!(Shape::Sphere { radius: bad }.check().is_err(), "{bad}");
            assert!(Shape::Disc { radius: bad }.check().is_err(), "{bad}");
            assert!(Shape::Cylinder { radius: 1.0, half_height: bad }.check().unwrap_err().contains("half height"));
            assert!(Shape::Cylinder { radius: bad, half_height: 1.0 }.check().is_err(), "{bad}");
        }
        for good in [1e-30, 1.0, 1e30] {
            assert_eq!(Shape::Cylinder { radius: good, half_height: good }.check(), Ok(()));
        }
        assert_eq!(Shape::Plane.check(), Ok(()));
    }

    /// A spheroid of axes a, a, c > a has 2πa² (1 + c/(a e) asin e), e² = 1 − a²/c²; with c < a, 2πa² (1 + (1 − e²)/e atanh e),
    /// e² = 1 − c²/a². A tube stretched to an ellipse of axes a and b has its circumference times its height.
    #[test]
    fn areas_are_those_of_closed_forms() {
        let sphere = Shape::Sphere { radius: 2.0 };
        let near = |got: f64, want: f64, error: f64| assert!((got / want - 1.0).abs() < error, "{got} {want}");
        near(sphere.area(), 16.0 * PI, 1e-15);
        near(sphere.area_under(DMat3::from_diagonal(DVec3::new(-3.0, 3.0, 3.0))), 144.0 * PI, 1e-14);
        let (a, c) = (2.0, 6.0);
        let e = (1.0_f64 - a * a / (c * c)).sqrt();
        let prolate = 2.0 * PI * a * a * (1.0 + c / (a * e) * e.asin());
        for axes in [DVec3::new(1.0, 1.0, 3.0), DVec3::new(1.0, 3.0, 1.0)] {
            near(sphere.area_under(DMat3::from_diagonal(axes)), prolate, 1e-5);
        }
        let (a, c) = (6.0, 2.0);
        let e = (1.0_f64 - c * c / (a * a)).sqrt();
        let oblate = 2.0 * PI * a * a * (1.0 + (1.0 - e * e) / e * e.atanh());
        near(sphere.area_under(DMat3::from_diagonal(DVec3::new(3.0, 1.0, 3.0))), oblate, 1e-5);
        near(Shape::Disc { radius: 2.0 }.area_under(DMat3::from_diagonal(DVec3::new(2.0, 9.0, 3.0))), 24.0 * PI, 1e-14);
        // The circumference of an ellipse of axes 2 and 1: 4·2·E(3/4).
        let tube = Shape::Cylinder { radius: 1.0, half_height: 0.5 };
        near(tube.area_under(DMat3::from_diagonal(DVec3::new(2.0, 5.0, 1.0))), 5.0 * 9.688_448_220_547_676, 1e-12);
    }
}
