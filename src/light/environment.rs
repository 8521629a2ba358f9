//! The sky as a light: look-up, and sampling by texel.

use crate::sampling::AliasTable;

/// A latitude–longitude map with its exact sampling table.
#[derive(Clone, Debug, Default)]
pub struct EnvironmentTable {
    /// Texels around.
    pub width: u32,
    /// Texels from pole to pole.
    pub height: u32,
    /// Radiance, nit, scale included.
    pub texels: Vec<[f32; 3]>,
    /// Turn about +Y, rad, counter-clockwise seen from above.
    pub rotation: f32,
    /// One row per texel, by luminance times solid angle.
    pub choice: AliasTable,
}

impl EnvironmentTable {
    /// stub
    pub fn new(_m: &crate::world::EnvironmentMap, _r: f32, _s: f32) -> Self {
        Self::default()
    }
    /// stub
    pub fn power(&self, _r: f32) -> f32 {
        0.0
    }
}
