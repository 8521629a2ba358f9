//! Light that falls on any pixel of the film rather than on that of its path.

use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicU32, AtomicU64, Ordering},
};

use super::{Label, Splits, Sums, Tile, Unit};
use crate::sampling::{REPLICAS, replica};

/// Light for a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Tile that holds the pixel, by rows.
    pub tile: u32,
    /// Place of the pixel in the tile.
    pub slot: u32,
    /// Nit, for one sample of the whole film.
    pub light: [f32; 3],
    /// What light it is.
    pub label: Label,
}

/// Light of those channels whose bits are set.
#[inline]
pub fn of_channels(light: [f32; 3], channels: u32) -> [f32; 3] {
    std::array::from_fn(|c| if channels >> c & 1 == 1 { light[c] } else { 0.0 })
}

/// Sums by the sample's replica.
#[derive(Debug)]
struct OfTile {
    all: [Sums; REPLICAS],
    /// Layer by layer of the splits.
    parts: Vec<[Sums; REPLICAS]>,
}

/// Sums of such light, with a count of samples of their own.
///
/// Many add to them at the same time; since they are exact, the order changes no bit.
#[derive(Debug)]
pub struct Splats {
    /// x, y, width, height of the rendered part, pixels.
    pub window: [u32; 4],
    /// Edge of a tile, pixels.
    pub edge: u32,
    unit: Unit,
    splits: Splits,
    tiles: Vec<Mutex<OfTile>>,
    samples: [AtomicU32; REPLICAS],
    discarded: AtomicU64,
}

impl Splats {
    /// Black, for a film's tiles.
    pub fn new(tiles: &[Tile], unit: Unit, splits: Splits) -> Self {
        let first = tiles.first().map_or([0; 4], |tile| [tile.x, tile.y, tile.width, tile.height]);
        let [mut x1, mut y1] = [first[0], first[1]];
        for tile in tiles {
            (x1, y1) = (x1.max(tile.x + tile.width), y1.max(tile.y + tile.height));
        }
        let [x0, y0, width, height] = first;
        let sums = |tile: &Tile| {
            let black: [Sums; REPLICAS] = std::array::from_fn(|_| Sums::new(tile.pixels()));
            Mutex::new(OfTile { parts: vec![black.clone(); splits.layers()], all: black })
        };
        Self {
            window: [x0, y0, x1 - x0, y1 - y0],
            // If there is but one tile in a row or column it may be smaller than the others would be.
            edge: width.max(height).max(1),
            unit,
            tiles: tiles.iter().map(sums).collect(),
            splits,
            samples: [const { AtomicU32::new(0) }; REPLICAS],
            discarded: AtomicU64::new(0),
        }
    }

    /// Tile and slot of a pixel of the whole picture; none outside of the rendered part.
    #[inline]
    pub fn place(&self, x: i32, y: i32) -> Option<(u32, u32)> {
        let [x0, y0, width, height] = self.window;
        let (x, y) = ((x - x0 as i32) as u32, (y - y0 as i32) as u32);
        if x >= width || y >= height {
            return None;
        }
        let (column, row) = (x / self.edge, y / self.edge);
        let tile_width = self.edge.min(width - column * self.edge);
        Some((row * width.div_ceil(self.edge) + column, y % self.edge * tile_width + x % self.edge))
    }

    /// Adds light of a sample; `splats` are put in order of their tiles and taken away.
    pub fn add(&self, sample: u32, splats: &mut Vec<Splat>) {
        splats.sort_unstable_by_key(|splat| splat.tile);
        let mut discarded = 0;
        for of_tile in splats.chunk_by(|a, b| a.tile == b.tile) {
            let mut sums = self.tiles[of_tile[0].tile as usize].lock().unwrap_or_else(PoisonError::into_inner);
            for splat in of_tile {
                let (replica, pixel) = (replica(sample), splat.slot as usize);
                let added = sums.all[replica].add(self.unit, pixel, splat.light);
                discarded += u64::from(!added);
                if added {
                    self.splits.each(splat.label, |part, channels| {
                        sums.parts[part][replica].add(self.unit, pixel, of_channels(splat.light, channels));
                    });
                }
            }
        }
        self.discarded.fetch_add(discarded, Ordering::Relaxed);
        splats.clear();
    }

    /// Counts a sample, all of whose light has been added.
    pub fn finish(&self, sample: u32) {
        self.samples[replica(sample)].fetch_add(1, Ordering::Relaxed);
    }

    /// Contributions that were not finite or out of range.
    pub fn discarded(&self) -> u64 {
        self.discarded.load(Ordering::Relaxed)
    }

    /// Samples by replica.
    pub fn samples(&self) -> [u32; REPLICAS] {
        self.samples.each_ref().map(|samples| samples.load(Ordering::Relaxed))
    }

    /// The sums of a tile, of all light or of a part of it.
    pub fn tile(&self, tile: usize, part: Option<usize>) -> [Sums; REPLICAS] {
        let sums = self.tiles[tile].lock().unwrap_or_else(PoisonError::into_inner);
        part.map_or(&sums.all, |part| &sums.parts[part]).clone()
    }
}
