//! Starts paths at the camera.

use glam::DVec3;
use wide::{f32x8, f64x8};

use super::{
    aim::Aim,
    dimensions,
    queues::{PathBlock, PathQueue},
    stats::Blocks,
};
use crate::{
    flat::{CameraView, NONE, ViewProjection},
    sampling::{FilterTable, Sampler},
    simd::{Bits, LANES},
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
    #[inline]
    pub fn ray(&self, x: f64, y: f64) -> ([f32; 3], [f32; 3], f32) {
        let Rays { origin, direction, length } = self.rays([x; LANES], [y; LANES]);
        (origin.map(|column| column[0]), direction.map(|column| column[0]), length[0])
    }

    /// As [`Lens::ray`], of eight positions.
    ///
    /// In f64, rounded at the end: far from the origin neighbouring pixels still get different rays.
    #[inline(always)]
    fn rays(&self, x: [f64; LANES], y: [f64; LANES]) -> Rays {
        let view = &self.view;
        let s = (f64x8::new(x) * f64x8::splat(2.0) - f64x8::splat(self.width)) / f64x8::splat(self.height);
        let t = f64x8::ONE - f64x8::new(y) * f64x8::splat(2.0) / f64x8::splat(self.height);
        let all = |v: DVec3| v.to_array().map(f64x8::splat);
        let (right, up, forward, eye) = (all(view.right), all(view.up), all(view.forward), all(view.origin));
        let dot = |a: &[f64x8; 3], b: &[f64x8; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let across = |i: usize| s * right[i] + t * up[i];
        let (start, direction) = match view.projection {
            ViewProjection::Perspective { tan_half_yfov } => {
                let direction = [0, 1, 2].map(|i| forward[i] + f64x8::splat(tan_half_yfov) * across(i));
                let scale = f64x8::ONE / dot(&direction, &direction).sqrt();
                (eye, direction.map(|v| v * scale))
            }
            ViewProjection::Orthographic { half_height } => {
                ([0, 1, 2].map(|i| eye[i] + f64x8::splat(half_height) * across(i)), forward)
            }
        };
        // Clipping planes are at depths along the axis.
        let per_depth = f64x8::ONE / dot(&direction, &forward);
        let near = f64x8::splat(view.znear.into()) * per_depth;
        let rounded = |v: f64x8| v.to_array().map(|v| v as f32);
        Rays {
            origin: [0, 1, 2].map(|i| rounded(start[i] + near * direction[i])),
            direction: direction.map(rounded),
            length: rounded(f64x8::splat(view.zfar.into()) * per_depth - near),
        }
    }
}

/// Eight rays of a [`Lens`], by columns.
struct Rays {
    origin: [[f32; LANES]; 3],
    direction: [[f32; LANES]; 3],
    length: [f32; LANES],
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

    /// Paths that should be in the same wave as the next one: those of the same pixels, if it is the first of so many samples.
    fn together(&self, pixels: u32) -> usize {
        let done = (self.sample - self.first) / self.step;
        if self.pixel != self.block || !done.is_multiple_of(KEPT_TOGETHER) {
            return 0;
        }
        let samples = (self.end - self.sample).div_ceil(self.step).min(KEPT_TOGETHER);
        (samples * (self.next_block(pixels) - self.block)) as usize
    }

    fn next_block(&self, pixels: u32) -> u32 {
        pixels.min(self.block + LANES as u32)
    }
}

/// Samples of the same eight pixels that are not torn apart between two waves: what is traced together has no more.
const KEPT_TOGETHER: u32 = 16;

/// Adds paths to the queue, which has room for them, until it holds `capacity` or almost, or the cursor is at its end.
pub fn generate(
    lens: &Lens,
    filter: &FilterTable,
    sampler: &Sampler,
    aim: &Aim,
    film_width: u32,
    tile: [u32; 4],
    cursor: &mut Cursor,
    capacity: usize,
    paths: &mut PathQueue,
) -> Blocks {
    let mut blocks = Blocks::default();
    let [x0, y0, width, height] = tile;
    let pixels = width * height;
    while cursor.sample < cursor.end && paths.len() < capacity {
        if !paths.is_empty() && paths.len() + cursor.together(pixels) > capacity {
            break;
        }
        let left = cursor.next_block(pixels) - cursor.pixel;
        let count = (left as usize).min(capacity - paths.len());
        blocks += Blocks::one(count as u32);
        // Lanes beyond repeat the last one.
        let slot: [u32; LANES] = std::array::from_fn(|lane| cursor.pixel + lane.min(count - 1) as u32);
        let (x, y) = (slot.map(|slot| x0 + slot % width), slot.map(|slot| y0 + slot / width));
        let keys: [(u32, u32); LANES] = std::array::from_fn(|lane| sampler.of_pixel(x[lane], y[lane], cursor.sample));
        let (hashes, indices) = (keys.map(|(hash, _)| hash), keys.map(|(_, index)| index));
        let [hash, index] = [hashes, indices].map(|column| Bits::from_fn(|lane| column[lane]));
        let u: (f32x8, f32x8) = sampler.pair(hash, index, Bits::splat(dimensions::FILTER));
        let (mut film_x, mut film_y) = (x, y);
        if let Aim::Pixels(..) = aim {
            for lane in 0..LANES {
                [film_x[lane], film_y[lane]] = aim.pixel([x[lane], y[lane]], film_width);
            }
        }
        let film = |pixel: [u32; LANES], u: f32x8| {
            let offset = filter.offset(u).to_array();
            std::array::from_fn(|lane| f64::from(pixel[lane]) + 0.5 + f64::from(offset[lane]))
        };
        let Rays { origin: [ox, oy, oz], direction: [dx, dy, dz], length } =
            lens.rays(film(film_x, u.0), film(film_y, u.1));
        let block = PathBlock {
            ox,
            oy,
            oz,
            dx,
            dy,
            dz,
            t_max: length,
            throughput_r: [1.0; LANES],
            throughput_g: [1.0; LANES],
            throughput_b: [1.0; LANES],
            pdf: [0.0; LANES],
            eta_scale: [1.0; LANES],
            slot,
            sample: [cursor.sample; LANES],
            index: indices,
            pixel_hash: hashes,
            depth: [0; LANES],
            medium: [NONE; LANES],
            side: [0; LANES],
        };
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
