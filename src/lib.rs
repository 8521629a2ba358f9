//! wavecast: a data-oriented wavefront path tracer for glTF 2.0 scenes.

pub mod accel;
pub mod bsdf;
pub mod film;
pub mod flat;
pub mod light;
pub mod load;
pub mod measure;
pub mod reference;
pub mod render;
pub mod sampling;
pub mod simd;
pub mod systems;
pub mod world;
