//! How far a picture is from another, and the statistics that tests and error bars stand on.

pub mod brdf;
pub mod converged;
pub mod far_field;
pub mod flip;
pub mod flux;
pub mod glare;
pub mod heat;
pub mod meter;
pub mod metrics;
pub mod series;
pub mod solid_angle;
pub mod ssim;
pub mod statistics;
pub mod student;

#[cfg(test)]
mod published;
