//! One binary, a module per kind of evidence.

mod cli;
mod gltf;
