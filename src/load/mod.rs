//! glTF file to Scene.
