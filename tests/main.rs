//! One binary, a module per kind of evidence.

mod analytic;
mod cli;
mod gltf;
