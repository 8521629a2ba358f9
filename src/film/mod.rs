//! Light to pixels to files.

mod picture;
pub use picture::{Layer, LayerData, Picture};
