//! Discrete choices in constant time.

/// A discrete distribution sampled by Walker's alias method.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AliasTable {
    /// Probability of each row; sums to 1, or empty.
    pub pmf: Vec<f32>,
    /// Share of the row's own column, 0 to 1; the rest belongs to `alias`.
    pub threshold: Vec<f32>,
    /// The other row in each column.
    pub alias: Vec<u32>,
}

impl AliasTable {
    /// stub
    pub fn new(_weights: &[f32]) -> Self {
        Self::default()
    }
}
