//! The sky as a light.
//!
//! In flows the map of an [`Environment`](crate::world::Environment); out flow radiance by direction and directions
//! by radiance. Surfaces and punctual lights need no table beyond the columns of
//! [`Lights`](crate::flat::Lights): the kernels of the wavefront sample them from there.

mod environment;

pub use environment::EnvironmentTable;
