//! The film as tiles, each owned by one worker at a time, and its resolution to a picture.

use super::{Layer, LayerData, Picture, Splats, Split, Splits, Sums, Unit};
use crate::{
    render::{LayerKind, RenderSettings},
    sampling::REPLICAS,
};

/// Edge of the blocks of pixels that are rendered as one. They lie at multiples of it in the whole picture, whatever
/// part is rendered and however it is cut into tiles, so that pixels of a block may share work and a picture still does not
/// depend on either.
pub const BLOCK: u32 = 8;

/// A rectangle of pixels with the light that fell on it: whole blocks, but for the picture's right and lower edge.
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
    /// Samples per pixel by replica of the sampler.
    pub samples: [u32; REPLICAS],
    /// Light by replica, whose spread shows the error.
    pub replicas: [Sums; REPLICAS],
    /// The same light by its parts, layer by layer of the film's splits.
    pub parts: Vec<[Sums; REPLICAS]>,
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

    /// The sums of all light, or of a part of it.
    pub fn sums(&self, part: Option<usize>) -> &[Sums; REPLICAS] {
        part.map_or(&self.replicas, |part| &self.parts[part])
    }

    /// All light that fell on a pixel so far, in steps of the film's unit.
    pub fn light(&self, pixel: usize) -> [i128; 3] {
        std::array::from_fn(|i| self.replicas.iter().map(|sums| sums.0[pixel][i]).sum())
    }

    /// What the sum over each replica's samples is multiplied by to give the pixel's mean.
    ///
    /// All samples weigh the same where all pixels have as many. Where `adaptive`, the even and the odd replicas have
    /// decided about each other's number of samples; each of these halves then has the pixel's value as its expectation,
    /// but their number says something of the other half's light, so that weights that depend on it would be unfair.
    pub fn weights(&self, adaptive: bool) -> [f64; REPLICAS] {
        let all: u32 = self.samples.iter().sum();
        let half = |of: usize| self.samples.iter().skip(of % 2).step_by(2).sum::<u32>();
        std::array::from_fn(|replica| match half(replica) {
            own if adaptive && half(replica + 1) > 0 => 0.5 / f64::from(own.max(1)),
            _ => 1.0 / f64::from(all.max(1)),
        })
    }
}

/// All tiles of a picture, or of the part of it that is rendered.
#[derive(Debug)]
pub struct Film {
    /// x, y, width, height of the part that was asked for; the tiles cover all blocks that it touches.
    pub window: [u32; 4],
    /// Step of the light sums.
    pub unit: Unit,
    /// Tiles, by rows.
    pub tiles: Vec<Tile>,
    /// Layers beside the beauty picture.
    pub layers: Vec<LayerKind>,
    /// Layers that the light is split into.
    pub splits: Splits,
    /// Names of the lights that it may be split by.
    pub lights: Vec<String>,
    /// True if coverage is kept.
    pub transparent: bool,
    /// True if blocks, which are then a tile each, get samples by their error.
    pub adaptive: bool,
    /// Light that falls anywhere, if some does.
    pub splats: Option<Splats>,
}

impl Film {
    /// Black, for the window that the settings ask for.
    pub fn new(settings: &RenderSettings, unit: Unit) -> Self {
        let window = settings.crop.unwrap_or([0, 0, settings.width, settings.height]);
        let [columns, rows] = [(0, settings.width), (1, settings.height)].map(|(axis, all)| {
            let end = (window[axis] + window[axis + 2]).next_multiple_of(BLOCK).min(all);
            window[axis] / BLOCK * BLOCK..end
        });
        let adaptive = settings.is_adaptive();
        let edge = if adaptive { BLOCK } else { settings.tile_size.clamp(1, 1 << 16).next_multiple_of(BLOCK) };
        let mut tiles = Vec::new();
        for y in rows.clone().step_by(edge as usize) {
            for x in columns.clone().step_by(edge as usize) {
                let (w, h) = (edge.min(columns.end - x), edge.min(rows.end - y));
                let pixels = w as usize * h as usize;
                let zeros = |on: bool| if on { vec![0; pixels] } else { Vec::new() };
                tiles.push(Tile {
                    x,
                    y,
                    width: w,
                    height: h,
                    samples: [0; REPLICAS],
                    replicas: std::array::from_fn(|_| Sums::new(pixels)),
                    parts: Vec::new(),
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
        let (splits, lights) = (Splits::default(), Vec::new());
        Self { window, unit, tiles, layers, splits, lights, transparent, adaptive, splats: None }
    }

    /// Keeps the light apart that `splits` tells apart, of lights with such names. Before any light falls on it.
    pub fn split(&mut self, splits: Splits, lights: Vec<String>) {
        for tile in &mut self.tiles {
            let part = std::array::from_fn(|_| Sums::new(tile.pixels()));
            tile.parts = vec![part; splits.layers()];
        }
        (self.splits, self.lights) = (splits, lights);
    }

    /// Makes room for light that falls anywhere.
    pub fn keep_splats(&mut self) {
        self.splats = Some(Splats::new(&self.tiles, self.unit, self.splits.clone()));
    }

    /// What splats add to the means of a tile's pixels, or to a part of them; of each replica, and of all together last.
    pub(super) fn splatted(&self, tile: usize, part: Option<usize>) -> impl Fn(usize, usize) -> [f64; REPLICAS + 1] {
        let (unit, found) = (self.unit, self.splats.as_ref().map(|splats| (splats.tile(tile, part), splats.samples())));
        move |pixel, channel| match &found {
            None => [0.0; REPLICAS + 1],
            Some((sums, samples)) => {
                let mean = |sum: i128, count: u32| unit.value(sum) / f64::from(count.max(1));
                let sum = |replica: usize| sums[replica].0[pixel][channel];
                std::array::from_fn(|replica| match samples.get(replica) {
                    Some(&count) => mean(sum(replica), count),
                    None => mean((0..REPLICAS).map(sum).sum(), samples.iter().sum()),
                })
            }
        }
    }

    /// Pixel means as a picture.
    pub fn resolve(&self) -> Picture {
        let [_, _, width, height] = self.window.map(|length| length as usize);
        let pixels = width * height;
        let mut picture = Picture {
            width,
            height,
            rgb: vec![[0.0; 3]; pixels],
            alpha: self.transparent.then(|| vec![0.0; pixels]),
            layers: self.layers.iter().flat_map(|kind| self.blank(*kind, pixels)).collect(),
            metadata: Vec::new(),
        };
        for (row, tile) in self.tiles.iter().enumerate() {
            let samples: u32 = tile.samples.iter().sum();
            let scale = 1.0 / f64::from(samples.max(1));
            let mean_light = self.mean_light(row, tile, None);
            for (pixel, at) in self.pixels_of(tile) {
                picture.rgb[at] = mean_light(pixel).map(|mean| mean as f32);
                if let Some(alpha) = &mut picture.alpha {
                    alpha[at] = (f64::from(tile.covered[pixel]) * scale) as f32;
                }
            }
            let mut layers = picture.layers.iter_mut();
            for (i, &kind) in self.layers.iter().enumerate() {
                if let LayerKind::Light(split) = kind {
                    let first = self.splits.first_of(split);
                    for part in first..first + self.splits.layers_of(split) {
                        let mean = self.mean_light(row, tile, Some(part));
                        let standard_errors = self.standard_errors(row, tile, Some(part));
                        let (Some(light), Some(error)) = (layers.next(), layers.next()) else { break };
                        for (pixel, at) in self.pixels_of(tile) {
                            light.data.set_rgb(at, mean(pixel).map(|mean| mean as f32));
                            error.data.set_rgb(at, standard_errors(pixel));
                        }
                    }
                    continue;
                }
                let Some(layer) = layers.next() else { break };
                if kind == LayerKind::Error {
                    let standard_errors = self.standard_errors(row, tile, None);
                    self.pixels_of(tile).for_each(|(pixel, at)| layer.data.set_rgb(at, standard_errors(pixel)));
                    continue;
                }
                for (pixel, at) in self.pixels_of(tile) {
                    let mean = |channel: usize| (Unit::PLAIN.value(tile.layers[i].0[pixel][channel]) * scale) as f32;
                    match &mut layer.data {
                        LayerData::Scalar(values) => values[at] = mean(0),
                        LayerData::Uv(values) => values[at] = [mean(0), mean(1)],
                        LayerData::Rgb(values) | LayerData::Xyz(values) => values[at] = [mean(0), mean(1), mean(2)],
                        LayerData::Id(values) => {
                            values[at] = if kind == LayerKind::SampleCount { samples } else { tile.ids[i][pixel] };
                        }
                    }
                }
            }
        }
        picture
    }

    /// By pixel, the mean of all light or of a part of it, nit.
    pub(super) fn mean_light<'a>(
        &'a self,
        row: usize,
        tile: &'a Tile,
        part: Option<usize>,
    ) -> impl Fn(usize) -> [f64; 3] + 'a {
        let splatted = self.splatted(row, part);
        let weights = tile.weights(self.adaptive);
        let even = weights.iter().all(|&weight| weight == weights[0]);
        let replicas = tile.sums(part);
        move |pixel| {
            std::array::from_fn(|i| {
                let sums = replicas.each_ref().map(|sums| sums.0[pixel][i]);
                // Exactly as long as that can be, so that ranges of samples can be joined.
                let mean = if even {
                    self.unit.value(sums.iter().sum()) * weights[0]
                } else {
                    sums.iter().zip(weights).map(|(&sum, weight)| self.unit.value(sum) * weight).sum::<f64>()
                };
                mean + splatted(pixel, i)[REPLICAS]
            })
        }
    }

    /// Black layers of a kind.
    fn blank(&self, kind: LayerKind, pixels: usize) -> Vec<Layer> {
        let LayerKind::Light(split) = kind else { return vec![kind.blank(pixels)] };
        let layer = |name: String| Layer { name, data: LayerData::Rgb(vec![[0.0; 3]; pixels]) };
        let names = self.splits.names(split, &self.lights);
        names.into_iter().flat_map(|name| [layer(name.clone()), layer(format!("{name}.error"))]).collect()
    }

    /// The pixels of a tile that were asked for: their places in the tile and in the picture.
    pub(super) fn pixels_of(&self, tile: &Tile) -> impl Iterator<Item = (usize, usize)> + use<> {
        let [x0, y0, width, height] = self.window;
        let &Tile { x, y, width: tile_width, .. } = tile;
        let across = x.max(x0)..(x + tile_width).min(x0 + width);
        (y.max(y0)..(y + tile.height).min(y0 + height)).flat_map(move |row| {
            across.clone().map(move |column| {
                let place = (row - y) as usize * tile_width as usize + (column - x) as usize;
                (place, (row - y0) as usize * width as usize + (column - x0) as usize)
            })
        })
    }

    /// Mean samples per pixel.
    pub fn spp(&self) -> f64 {
        let samples: f64 =
            self.tiles.iter().map(|t| f64::from(t.samples.iter().sum::<u32>()) * t.pixels() as f64).sum();
        samples / self.tiles.iter().map(|t| t.pixels() as f64).sum::<f64>().max(1.0)
    }
}

impl LayerKind {
    /// True for layers that are means over samples.
    pub fn is_sum(self) -> bool {
        !self.is_id() && !matches!(self, Self::SampleCount | Self::Error | Self::Light(_))
    }

    /// How it splits light, if it does.
    pub fn split(self) -> Option<Split> {
        if let Self::Light(split) = self { Some(split) } else { None }
    }

    /// True for layers that hold an id.
    pub fn is_id(self) -> bool {
        matches!(self, Self::EntityId | Self::MaterialId)
    }

    /// The layer's name in files; of light in parts, that of the option which asks for it.
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
            Self::Error => "error",
            Self::Light(Split::Bounces) => "bounces",
            Self::Light(Split::Lights) => "lights",
            Self::Light(Split::Direct) => "direct",
            Self::Light(Split::LightsByBounces) => "lights.bounces",
            Self::Light(Split::LightsByDirect) => "lights.direct",
            Self::Light(Split::Lobes) => "lobes",
            Self::Light(Split::LobesByBounces) => "lobes.bounces",
            Self::Light(Split::Paths) => "paths",
        }
    }

    fn blank(self, pixels: usize) -> Layer {
        let data = match self {
            Self::Albedo | Self::Error | Self::Light(_) => LayerData::Rgb(vec![[0.0; 3]; pixels]),
            Self::Normal | Self::Position => LayerData::Xyz(vec![[0.0; 3]; pixels]),
            Self::Depth => LayerData::Scalar(vec![0.0; pixels]),
            Self::Uv => LayerData::Uv(vec![[0.0; 2]; pixels]),
            Self::EntityId | Self::MaterialId | Self::SampleCount => LayerData::Id(vec![0; pixels]),
        };
        Layer { name: self.name().to_owned(), data }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever is asked for, each block of the picture that it touches is in one tile, whole, and each pixel asked for has
    /// one place.
    #[test]
    fn tiles_hold_whole_blocks_of_the_picture() {
        for (size, crop) in [
            ([37, 20], None),
            ([37, 20], Some([3, 9, 10, 2])),
            ([64, 64], Some([8, 8, 16, 8])),
            ([19, 13], Some([17, 12, 2, 1])),
        ] {
            for tile_size in [1, 8, 13, 32, u32::MAX] {
                let [width, height] = size;
                let settings = RenderSettings { width, height, crop, tile_size, ..RenderSettings::default() };
                let film = Film::new(&settings, Unit::PLAIN);
                let mut owners = vec![0; (width * height) as usize];
                let mut places = vec![0; (film.window[2] * film.window[3]) as usize];
                for tile in &film.tiles {
                    assert!(tile.x % BLOCK == 0 && tile.y % BLOCK == 0);
                    for (y, x) in (0..tile.height).flat_map(|y| (0..tile.width).map(move |x| (y, x))) {
                        owners[((tile.y + y) * width + tile.x + x) as usize] += 1;
                    }
                    film.pixels_of(tile).for_each(|(_, at)| places[at] += 1);
                }
                let [x, y, w, h] = film.window;
                let touched = |at: u32, from: u32, length: u32| {
                    (from / BLOCK..=(from + length - 1) / BLOCK).contains(&(at / BLOCK))
                };
                for (i, &owners) in (0..).zip(&owners) {
                    let want = touched(i % width, x, w) && touched(i / width, y, h);
                    assert_eq!(owners, i32::from(want), "{size:?} {crop:?} tiles of {tile_size}, pixel {i}");
                }
                assert!(places.iter().all(|&count| count == 1));
            }
        }
    }
}
