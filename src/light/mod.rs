//! Emission and the sampling of lights.

mod environment;
pub use environment::EnvironmentTable;
