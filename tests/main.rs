//! One binary, a module per kind of evidence.

mod gltf;
