//! A plain recursive path tracer in f64, to be checked against the rendering equation in one sitting.
//!
//! In flow the tables of a [`FlatScene`](crate::flat::FlatScene), out flows a picture with the variance
//! of each pixel. It shares the tables with the fast renderer and nothing else, so
//! that what the two agree on was thought out twice. What both mean by a picture is
//! `docs/model.md`. Read `trace.rs` first: emission, plus light found by looking for
//! lights, plus light found by following the scattering, weighted so that nothing is
//! counted twice.

pub mod bsdf;
pub mod geometry;
mod lights;
mod render;
mod rng;
mod shapes;
mod surface;
#[cfg(test)]
mod tests;
mod texture;
mod trace;
mod transport;

pub use self::{
    bsdf::{Lobe, Surface, brdf},
    render::{ReferencePicture, ReferenceSettings, Technique, camera_ray, render, render_with},
    rng::Rng,
    trace::Tracer,
    transport::{Transport, TransportError, TransportSettings},
};
