//! Starts paths at the camera.

use glam::DVec3;
use wide::f32x8;

use super::{
    dimensions,
    queues::{PathBlock, PathQueue},
    stats::Blocks,
};
use crate::{
    flat::{CameraView, NONE, ViewProjection},
    sampling::{FilterTable, Sampler},
    simd::{Bits, LANES, Real},
};

/// Camera rays of a film of given size.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    view: CameraView,
    width: f64,
    height: f64,
}

impl Lens {
    /// For a camera and the size of the whole picture, pixels.
    pub fn new(view: CameraView, width: u32, height: u32) -> Self {
        Self { view, width: f64::from(width), height: f64::from(height) }
    }

    /// Origin, unit direction and length of the ray through a film position in pixels, y down.
    ///
    /// In f64, rounded at the end: far from the origin neighbouring pixels still get different rays.
    #[inline]
    pub fn ray(&self, x: f64, y: f64) -> ([f32; 3], [f32; 3], f32) {
        let view = &self.view;
        let (s, t) = ((2.0 * x - self.width) / self.height, 1.0 - 2.0 * y / self.height);
        let (origin, direction) = match view.projection {
            ViewProjection::Perspective { tan_half_yfov } => {
                let direction = view.forward + tan_half_yfov * (s * view.right + t * view.up);
                (view.origin, direction.normalize())
            }
            ViewProjection::Orthographic { half_height } => {
                (view.origin + half_height * (s * view.right + t * view.up), view.forward)
            }
        };
        // Clipping planes are at depths along the axis.
        let per_depth = 1.0 / direction.dot(view.forward);
        let start = f64::from(view.znear) * per_depth;
        let length = (f64::from(view.zfar) * per_depth - start) as f32;
        let origin: DVec3 = origin + start * direction;
        (origin.as_vec3().to_array(), direction.as_vec3().to_array(), length)
    }
}

/// A point as the camera sees it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sighting {
    /// Place on the film, pixels, y down.
    pub film: [f64; 2],
    /// Start of the camera's ray, m.
    pub origin: [f32; 3],
    /// Its direction, unit length.
    pub direction: [f32; 3],
    /// From its start to the point, m.
    pub distance: f32,
    /// Pixels that a surface of 1 m² would fill there, if it faced the camera and were seen everywhere as it is at the point.
    pub pixels: f32,
}

impl Lens {
    /// The inverse of [`Lens::ray`]; none for what is not between the clipping planes.
    #[inline]
    pub fn see(&self, p: [f32; 3]) -> Option<Sighting> {
        let view = &self.view;
        let to = DVec3::from_array(p.map(f64::from)) - view.origin;
        let depth = to.dot(view.forward);
        let (near, far) = (f64::from(view.znear), f64::from(view.zfar));
        if !(depth > near.max(0.0) && depth <= far) {
            return None;
        }
        let across = [view.right, view.up].map(|axis| to.dot(axis));
        let (half, direction, start, cos) = match view.projection {
            ViewProjection::Perspective { tan_half_yfov } => {
                let distance = to.length();
                (tan_half_yfov * depth, to / distance, view.origin, depth / distance)
            }
            ViewProjection::Orthographic { half_height } => {
                (half_height, view.forward, view.origin + (to - depth * view.forward), 1.0)
            }
        };
        // A piece of the film at the point's depth, as large as the surface seen there, is turned away from it by `cos`.
        let per_metre = 0.5 * self.height / half;
        let [s, t] = across.map(|x| x * per_metre);
        Some(Sighting {
            film: [0.5 * self.width + s, 0.5 * self.height - t],
            origin: (start + near / cos * direction).as_vec3().to_array(),
            direction: direction.as_vec3().to_array(),
            distance: ((depth - near) / cos) as f32,
            pixels: (per_metre * per_metre / cos) as f32,
        })
    }
}

/// Which camera samples of a tile have been started: eight neighbouring pixels at a time, of these sample by sample, so
/// that rays which follow one another run side by side.
#[derive(Clone, Copy, Debug)]
pub struct Cursor {
    /// Next sample; at least `end` when all are started.
    pub sample: u32,
    /// At or past this all are started.
    pub end: u32,
    first: u32,
    step: u32,
    /// First of the eight pixels.
    block: u32,
    /// Next pixel.
    pixel: u32,
}

impl Cursor {
    /// Before every `step`-th of the samples `from..to` of all pixels.
    pub fn new(from: u32, to: u32, step: u32) -> Self {
        Self { sample: from, end: to, first: from, step, block: 0, pixel: 0 }
    }

    /// Past so many pixels of the eight, of so many in the tile.
    fn advance(&mut self, count: u32, pixels: u32) {
        self.pixel += count;
        let next = self.next_block(pixels);
        if self.pixel < next {
            return;
        }
        self.pixel = self.block;
        self.sample = self.sample.saturating_add(self.step);
        if self.sample >= self.end && next < pixels {
            (self.sample, self.block, self.pixel) = (self.first, next, next);
        }
    }

    fn next_block(&self, pixels: u32) -> u32 {
        pixels.min(self.block + LANES as u32)
    }
}

/// Adds paths to the queue, which has room for them, until it holds `capacity` or the cursor is at its end.
pub fn generate(
    lens: &Lens,
    filter: &FilterTable,
    sampler: &Sampler,
    tile: [u32; 4],
    cursor: &mut Cursor,
    capacity: usize,
    paths: &mut PathQueue,
) -> Blocks {
    let mut blocks = Blocks::default();
    let [x0, y0, width, height] = tile;
    let pixels = width * height;
    while cursor.sample < cursor.end && paths.len() < capacity {
        let left = cursor.next_block(pixels) - cursor.pixel;
        let count = (left as usize).min(capacity - paths.len());
        blocks += Blocks::one(count as u32);
        let place = |lane: usize| {
            let slot = cursor.pixel + (lane.min(count - 1)) as u32;
            (slot, x0 + slot % width, y0 + slot / width)
        };
        let hashes: [u32; LANES] = std::array::from_fn(|lane| {
            let (_, x, y) = place(lane);
            sampler.pixel_hash(x, y)
        });
        let sample = Bits::splat(cursor.sample);
        let u: (f32x8, f32x8) =
            sampler.pair(Bits::from_fn(|lane| hashes[lane]), sample, Bits::splat(dimensions::FILTER));
        let (dx, dy) = (filter.offset(u.0), filter.offset(u.1));
        let mut block = PathBlock {
            ox: [0.0; LANES],
            oy: [0.0; LANES],
            oz: [0.0; LANES],
            dx: [0.0; LANES],
            dy: [0.0; LANES],
            dz: [0.0; LANES],
            t_max: [0.0; LANES],
            throughput_r: [1.0; LANES],
            throughput_g: [1.0; LANES],
            throughput_b: [1.0; LANES],
            pdf: [0.0; LANES],
            eta_scale: [1.0; LANES],
            slot: [0; LANES],
            sample: [cursor.sample; LANES],
            index: [cursor.sample; LANES],
            pixel_hash: hashes,
            depth: [0; LANES],
            medium: [NONE; LANES],
            side: [0; LANES],
        };
        for lane in 0..count {
            let (slot, x, y) = place(lane);
            let (x, y) = (f64::from(x) + 0.5 + f64::from(dx.lane(lane)), f64::from(y) + 0.5 + f64::from(dy.lane(lane)));
            let (o, d, t_max) = lens.ray(x, y);
            [block.ox[lane], block.oy[lane], block.oz[lane]] = o;
            [block.dx[lane], block.dy[lane], block.dz[lane]] = d;
            (block.t_max[lane], block.slot[lane]) = (t_max, slot);
        }
        paths.put(&block, (1 << count) - 1);
        cursor.advance(count as u32, pixels);
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tiles whose pixels do and do not fill blocks, started in pieces of all sizes: the samples of each pixel ascend,
    /// and nothing is left out.
    #[test]
    fn each_sample_of_each_pixel_is_started_once_in_order() {
        for (pixels, piece, step) in [(64, 8, 1), (37, 3, 1), (5, 8, 2), (16, 5, 3)] {
            let mut cursor = Cursor::new(3, 9, step);
            let mut next = vec![3; pixels as usize];
            while cursor.sample < cursor.end {
                let count = (cursor.next_block(pixels) - cursor.pixel).min(piece);
                for pixel in cursor.pixel..cursor.pixel + count {
                    assert_eq!(next[pixel as usize], cursor.sample, "pixel {pixel}");
                    next[pixel as usize] += step;
                }
                cursor.advance(count, pixels);
            }
            assert!(next.iter().all(|&sample| sample == 9), "{next:?}");
        }
    }
}
