//! Light to pixels to files.

mod picture;
mod sums;
mod tiles;
pub use picture::{Layer, LayerData, Picture};
pub use sums::{Sums, Unit};
pub use tiles::{Film, Tile};
