//! The sky as a light, and points on shapes that shine.
//!
//! In flows the map of an [`Environment`](crate::world::Environment); out flow radiance by direction and directions
//! by radiance. Triangles and punctual lights need no table beyond the columns of
//! [`Lights`](crate::flat::Lights): the kernels of the wavefront sample them from there.

mod environment;
mod shape;

pub use environment::EnvironmentTable;
