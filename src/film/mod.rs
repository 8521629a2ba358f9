//! Light to pixels to files.

mod error;
mod exr;
mod hdr;
mod metadata;
mod picture;
mod png;
mod read;
mod tonemap;
mod write;

pub use self::{
    error::FilmError,
    picture::{Layer, LayerData, Picture},
    read::{Referred, read},
    tonemap::{Exposure, ToneMap, srgb_decode, srgb_encode},
    write::{Format, WriteOptions, check_writable, discard_unfinished, write, write_file},
};

pub(crate) use self::tonemap::luminance;

#[cfg(test)]
mod tests;
