//! Ray against geometry.

/// Rays against the triangles of one mesh, in its local space.
#[derive(Clone, Debug, Default)]
pub struct Blas;

/// Rays against the whole scene.
#[derive(Clone, Debug, Default)]
pub struct Accel;
