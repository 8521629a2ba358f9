//! How far a picture is from another.

pub mod flip;
pub mod heat;
pub mod metrics;
pub mod ssim;

#[cfg(test)]
mod published;
