//! Loading glTF files: generated ones with numbers by hand, broken ones, and the asset pack.

mod accessors;
mod assets;
mod environment;
mod file;
mod malformed;
mod materials;
mod poses;
mod primitives;
mod scenes;
