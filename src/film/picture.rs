//! A finished picture in memory: what is written to files and what is compared.

/// One further layer of a [`Picture`], a value per pixel, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// As in the file: `albedo`, `normal`, `depth`, …
    pub name: String,
    /// Values.
    pub data: LayerData,
}

/// Values of a layer.
#[derive(Clone, Debug, PartialEq)]
pub enum LayerData {
    /// Channel `<layer>.Y`, or just `<layer>` in EXR.
    Scalar(Vec<f32>),
    /// Channels `<layer>.U/V`.
    Uv(Vec<[f32; 2]>),
    /// Channels `<layer>.R/G/B`.
    Rgb(Vec<[f32; 3]>),
    /// Channels `<layer>.X/Y/Z`.
    Xyz(Vec<[f32; 3]>),
    /// An unsigned integer channel: ids and counts.
    Id(Vec<u32>),
}

/// Scene-linear Rec.709 radiance in nit with its alpha and layers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Pixels to a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Beauty, nit, rows from the top.
    pub rgb: Vec<[f32; 3]>,
    /// Coverage, where asked for.
    pub alpha: Option<Vec<f32>>,
    /// In the order they were asked for.
    pub layers: Vec<Layer>,
    /// Written into the file's metadata: version, scene, settings.
    pub metadata: Vec<(String, String)>,
}
