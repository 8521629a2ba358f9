//! Light to pixels to files.
//!
//! In flow contributions of paths, added as integers in the tiles of a [`Film`]; out
//! flows a [`Picture`], scene-linear and unexposed, and from it files. Exposure and tone
//! mapping happen here and nowhere else.

mod allocate;
mod automaton;
mod error;
mod estimate;
mod expression;
mod exr;
mod hdr;
mod metadata;
mod picture;
mod png;
mod read;
mod splats;
mod splits;
mod sums;
mod tiles;
mod tonemap;
mod write;

pub use self::{
    allocate::Growth,
    automaton::{Automaton, Event},
    error::FilmError,
    estimate::PictureError,
    expression::{Expression, ExpressionError},
    picture::{Layer, LayerData, Picture},
    read::{Referred, read},
    splats::{Splat, Splats, of_channels},
    splits::{Label, PathLayer, Split, Splits},
    sums::{Sums, Unit},
    tiles::{BLOCK, Film, Tile},
    tonemap::{Exposure, ToneMap, luminance, srgb_decode, srgb_encode},
    write::{Format, WriteOptions, check_writable, discard_unfinished, write, write_file},
};

#[cfg(test)]
mod tests;
