//! A finished picture in memory: what is written to files and what is compared.

/// One further layer of a [`Picture`], a value per pixel, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// As in the file: `albedo`, `normal`, `depth`, …
    pub name: String,
    /// Values.
    pub data: LayerData,
}

/// Values of a layer; in an EXR all but ids are `<layer>.R/G/B`, so that every reader shows them.
#[derive(Clone, Debug, PartialEq)]
pub enum LayerData {
    /// One number, in all three channels.
    Scalar(Vec<f32>),
    /// u in R, v in G, 0 in B.
    Uv(Vec<[f32; 2]>),
    /// A colour.
    Rgb(Vec<[f32; 3]>),
    /// A point or direction: x in R, y in G, z in B.
    Xyz(Vec<[f32; 3]>),
    /// Ids and counts: the unsigned integer channel `<layer>.Y`.
    Id(Vec<u32>),
}

impl LayerData {
    /// Gives a pixel three numbers, where there is room for them.
    pub(super) fn set_rgb(&mut self, at: usize, value: [f32; 3]) {
        if let Self::Rgb(values) | Self::Xyz(values) = self {
            values[at] = value;
        }
    }
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
    /// Coverage, where asked for; light in `rgb` is multiplied by it already.
    pub alpha: Option<Vec<f32>>,
    /// In the order they were asked for.
    pub layers: Vec<Layer>,
    /// Written into the file's metadata: version, scene, settings.
    pub metadata: Vec<(String, String)>,
}
