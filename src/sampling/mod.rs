//! Numbers in [0, 1) and what they are bent into.
//!
//! A [`Sampler`] turns (pixel, sample, dimension) into numbers, without state. [`warp`] bends pairs of them into
//! directions and points, [`filter`] into places on the film; an [`AliasTable`] chooses among rows; [`mis`] weighs
//! a sample that could have come from two sources.

pub mod filter;
pub mod mis;
mod sampler;
mod table;
#[cfg(test)]
pub(crate) mod tests;
pub mod warp;

pub use filter::{FilterDensity, FilterTable, filter_offset};
pub use sampler::{REPLICAS, Sampler, replica};
pub use table::{AliasTable, lengthen};
