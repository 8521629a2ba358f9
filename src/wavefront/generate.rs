//! Starts paths at the camera.

use glam::DVec3;
use wide::f32x8;

use super::{
    dimensions,
    queues::{Path, PathQueue},
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

/// Which camera samples of a tile have been started: sample by sample, pixel by pixel.
#[derive(Clone, Copy, Debug)]
pub struct Cursor {
    /// Next sample.
    pub sample: u32,
    /// One past the last sample.
    pub end: u32,
    /// Next pixel.
    pub pixel: u32,
}

/// Adds paths to the queue until it holds `capacity` or the cursor is at its end.
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
        let count = ((pixels - cursor.pixel) as usize).min(LANES).min(capacity - paths.len());
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
        for (lane, &pixel_hash) in hashes.iter().enumerate().take(count) {
            let (slot, x, y) = place(lane);
            let (x, y) = (f64::from(x) + 0.5 + f64::from(dx.lane(lane)), f64::from(y) + 0.5 + f64::from(dy.lane(lane)));
            let (o, d, t_max) = lens.ray(x, y);
            paths.push(Path {
                ox: o[0],
                oy: o[1],
                oz: o[2],
                dx: d[0],
                dy: d[1],
                dz: d[2],
                t_max,
                throughput_r: 1.0,
                throughput_g: 1.0,
                throughput_b: 1.0,
                pdf: 0.0,
                eta_scale: 1.0,
                slot,
                sample: cursor.sample,
                pixel_hash,
                depth: 0,
                medium: NONE,
            });
        }
        cursor.pixel += count as u32;
        if cursor.pixel == pixels {
            cursor.pixel = 0;
            cursor.sample += 1;
        }
    }
    blocks
}
