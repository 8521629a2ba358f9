//! Evidence for the reference: closed forms and identities.

mod bsdf;
mod geometry;
mod lights;
mod media;
mod picture;
mod scene;
mod series;
mod surface;
mod twin;
