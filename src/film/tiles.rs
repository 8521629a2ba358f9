//! The film as tiles, each owned by one worker at a time, and its resolution to a picture.

use super::{Layer, LayerData, Picture, Splats, Sums, Unit};
use crate::render::{LayerKind, RenderSettings};

/// A rectangle of pixels with the light that fell on it.
#[derive(Clone, Debug, Default)]
pub struct Tile {
    /// First column in the whole picture.
    pub x: u32,
    /// First row in the whole picture.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples per pixel in each half.
    pub samples: [u32; 2],
    /// Light by half: samples of even and of odd index, whose difference shows the error.
    pub halves: [Sums; 2],
    /// Camera rays that met something, where coverage is asked for.
    pub covered: Vec<u32>,
    /// Sums of each layer, in the order of the settings.
    pub layers: Vec<Sums>,
    /// Ids of the first sample, by layer.
    pub ids: Vec<Vec<u32>>,
}

impl Tile {
    /// Pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// All tiles of a picture, or of the part of it that is rendered.
#[derive(Debug)]
pub struct Film {
    /// x, y, width, height of the rendered part.
    pub window: [u32; 4],
    /// Step of the light sums.
    pub unit: Unit,
    /// Tiles, by rows.
    pub tiles: Vec<Tile>,
    /// Layers beside the beauty picture.
    pub layers: Vec<LayerKind>,
    /// True if coverage is kept.
    pub transparent: bool,
    /// Light that falls anywhere, if some does.
    pub splats: Option<Splats>,
}

impl Film {
    /// Black, for the window that the settings ask for.
    pub fn new(settings: &RenderSettings, unit: Unit) -> Self {
        let window = settings.crop.unwrap_or([0, 0, settings.width, settings.height]);
        let [x0, y0, width, height] = window;
        let edge = settings.tile_size.max(1);
        let mut tiles = Vec::new();
        for y in (0..height).step_by(edge as usize) {
            for x in (0..width).step_by(edge as usize) {
                let (w, h) = (edge.min(width - x), edge.min(height - y));
                let pixels = w as usize * h as usize;
                let zeros = |on: bool| if on { vec![0; pixels] } else { Vec::new() };
                tiles.push(Tile {
                    x: x0 + x,
                    y: y0 + y,
                    width: w,
                    height: h,
                    samples: [0; 2],
                    halves: [Sums::new(pixels), Sums::new(pixels)],
                    covered: zeros(settings.transparent),
                    layers: settings
                        .layers
                        .iter()
                        .map(|kind| Sums::new(if kind.is_sum() { pixels } else { 0 }))
                        .collect(),
                    ids: settings.layers.iter().map(|kind| zeros(kind.is_id())).collect(),
                });
            }
        }
        let (layers, transparent) = (settings.layers.clone(), settings.transparent);
        Self { window, unit, tiles, layers, transparent, splats: None }
    }

    /// Makes room for light that falls anywhere, in tiles of the same edge.
    pub fn keep_splats(&mut self, settings: &RenderSettings) {
        let pixels = self.tiles.iter().map(Tile::pixels);
        self.splats = Some(Splats::new(self.window, settings.tile_size.max(1), self.unit, pixels));
    }

    /// What splats add to the means of a tile's pixels; of each half, and of both together.
    fn splatted(&self, tile: usize) -> impl Fn(usize, usize) -> [f64; 3] {
        let (unit, found) = (self.unit, self.splats.as_ref().map(|splats| (splats.tile(tile), splats.samples())));
        move |pixel, channel| match &found {
            None => [0.0; 3],
            Some((sums, [m, n])) => {
                let [a, b] = [0, 1].map(|half: usize| sums[half].0[pixel][channel]);
                let mean = |sum: i128, count: u32| unit.value(sum) / f64::from(count.max(1));
                [mean(a, *m), mean(b, *n), mean(a + b, m + n)]
            }
        }
    }

    /// Pixel means as a picture.
    pub fn resolve(&self) -> Picture {
        let [x0, y0, width, height] = self.window;
        let (columns, pixels) = (width as usize, width as usize * height as usize);
        let mut picture = Picture {
            width: columns,
            height: height as usize,
            rgb: vec![[0.0; 3]; pixels],
            alpha: self.transparent.then(|| vec![0.0; pixels]),
            layers: self.layers.iter().map(|kind| kind.blank(pixels)).collect(),
            metadata: Vec::new(),
        };
        for (row, tile) in self.tiles.iter().enumerate() {
            let splatted = self.splatted(row);
            let samples = tile.samples[0] + tile.samples[1];
            let scale = 1.0 / f64::from(samples.max(1));
            for pixel in 0..tile.pixels() {
                let (x, y) = (pixel % tile.width as usize, pixel / tile.width as usize);
                let at = ((tile.y - y0) as usize + y) * columns + (tile.x - x0) as usize + x;
                picture.rgb[at] = std::array::from_fn(|i| {
                    let sum = tile.halves[0].0[pixel][i] + tile.halves[1].0[pixel][i];
                    (self.unit.value(sum) * scale + splatted(pixel, i)[2]) as f32
                });
                if let Some(alpha) = &mut picture.alpha {
                    alpha[at] = (f64::from(tile.covered[pixel]) * scale) as f32;
                }
                for (i, layer) in picture.layers.iter_mut().enumerate() {
                    let mean = |channel: usize| (Unit::PLAIN.value(tile.layers[i].0[pixel][channel]) * scale) as f32;
                    match &mut layer.data {
                        LayerData::Scalar(values) => values[at] = mean(0),
                        LayerData::Uv(values) => values[at] = [mean(0), mean(1)],
                        LayerData::Rgb(values) | LayerData::Xyz(values) => values[at] = [mean(0), mean(1), mean(2)],
                        LayerData::Id(values) => {
                            values[at] =
                                if self.layers[i] == LayerKind::SampleCount { samples } else { tile.ids[i][pixel] };
                        }
                    }
                }
            }
        }
        picture
    }

    /// Mean samples per pixel.
    pub fn spp(&self) -> f64 {
        let samples: f64 = self.tiles.iter().map(|t| f64::from(t.samples[0] + t.samples[1]) * t.pixels() as f64).sum();
        samples / self.tiles.iter().map(|t| t.pixels() as f64).sum::<f64>().max(1.0)
    }

    /// An estimate of the picture's relMSE from the difference of its halves; `None` if one is empty.
    ///
    /// With means a and b of halves of m and n samples, (a − b)²·mn/(m+n)² has the variance of the pooled
    /// mean as its expectation, if samples are independent; scrambled sequences do better than this says.
    pub fn relmse(&self) -> Option<f64> {
        let mut variance_and_mean = Vec::new();
        for (row, tile) in self.tiles.iter().enumerate() {
            let splatted = self.splatted(row);
            let [m, n] = tile.samples.map(f64::from);
            if m == 0.0 || n == 0.0 {
                return None;
            }
            for (pixel, (even, odd)) in tile.halves[0].0.iter().zip(&tile.halves[1].0).enumerate() {
                for i in 0..3 {
                    let (a, b) = (self.unit.value(even[i]), self.unit.value(odd[i]));
                    let [even, odd, both] = splatted(pixel, i);
                    let difference = a / m + even - (b / n + odd);
                    variance_and_mean
                        .push((difference * difference * m * n / (m + n).powi(2), (a + b) / (m + n) + both));
                }
            }
        }
        let count = variance_and_mean.len() as f64;
        let mean = variance_and_mean.iter().map(|(_, mean)| mean).sum::<f64>() / count;
        let floor = 0.01 * mean * mean;
        let sum: f64 = variance_and_mean.iter().map(|(v, m)| if *v == 0.0 { 0.0 } else { v / (m * m + floor) }).sum();
        Some(sum / count)
    }
}

impl LayerKind {
    /// True for layers that are means over samples.
    pub fn is_sum(self) -> bool {
        !self.is_id() && self != Self::SampleCount
    }

    /// True for layers that hold an id.
    pub fn is_id(self) -> bool {
        matches!(self, Self::EntityId | Self::MaterialId)
    }

    /// The layer's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Depth => "depth",
            Self::Position => "position",
            Self::Uv => "uv",
            Self::EntityId => "entity-id",
            Self::MaterialId => "material-id",
            Self::SampleCount => "samples",
        }
    }

    fn blank(self, pixels: usize) -> Layer {
        let data = match self {
            Self::Albedo => LayerData::Rgb(vec![[0.0; 3]; pixels]),
            Self::Normal | Self::Position => LayerData::Xyz(vec![[0.0; 3]; pixels]),
            Self::Depth => LayerData::Scalar(vec![0.0; pixels]),
            Self::Uv => LayerData::Uv(vec![[0.0; 2]; pixels]),
            Self::EntityId | Self::MaterialId | Self::SampleCount => LayerData::Id(vec![0; pixels]),
        };
        Layer { name: self.name().to_owned(), data }
    }
}
