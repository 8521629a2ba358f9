//! One binary, a module per kind of evidence.

mod accel;
mod allocation;
mod analytic;
mod assets;
mod caustics;
mod cli;
mod common;
mod confidence;
mod determinism;
mod gltf;
mod layering;
mod lecture;
mod matrix;
mod meters;
mod parts;
mod reciprocity;
mod scenes;
mod screen;
mod shapes;
mod sharing;
mod skipping;
mod sync;
mod twin;
