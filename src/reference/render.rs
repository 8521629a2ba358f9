//! Pixels: the mean over rays through each, and how sure it is.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::{bsdf::Lobe, rng::Rng, trace::Tracer};
use crate::{
    flat::{CameraView, FlatScene, ViewProjection},
    render::PixelFilter,
};

/// How to make a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceSettings {
    /// Pixels to a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples per pixel.
    pub spp: u32,
    /// Chooses the random numbers.
    pub seed: u64,
    /// Greatest number of scatterings; `None` leaves it to Russian roulette.
    pub max_depth: Option<u32>,
    /// Pixel filter.
    pub filter: PixelFilter,
    /// Lift the origins of rays towards the smooth surface.
    pub terminator_fix: bool,
    /// No sky for camera rays.
    pub transparent: bool,
    /// The only lobe that scatters at the first surface, at the second and so on; behind these all do.
    pub lobes: Vec<Lobe>,
    /// How lights are found.
    pub technique: Technique,
}

/// How lights are found that can be found in two ways. All have the same expected value; lamps without extent can only be looked for,
/// and what mirrors show can only be met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Technique {
    /// Both ways, each weighted where it is better (multiple importance sampling; Veach, Guibas 1995).
    #[default]
    Both,
    /// By looking for them: directions are drawn by the light.
    Lights,
    /// By meeting them: directions are drawn by the BSDF.
    Bsdf,
}

impl Default for ReferenceSettings {
    fn default() -> Self {
        Self {
            width: 64,
            height: 64,
            spp: 16,
            seed: 0,
            max_depth: None,
            filter: PixelFilter::default(),
            terminator_fix: true,
            transparent: false,
            lobes: Vec::new(),
            technique: Technique::default(),
        }
    }
}

/// A picture with the variance of its pixels, rows from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReferencePicture {
    /// Pixels to a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Mean radiance, nit.
    pub rgb: Vec<DVec3>,
    /// Estimated variance of that mean, nit²; zero for a single sample.
    pub variance: Vec<DVec3>,
    /// Samples in each pixel.
    pub samples: u32,
}

/// Renders `scene`; the same settings give the same picture, bit for bit.
pub fn render(scene: &FlatScene, settings: &ReferenceSettings) -> ReferencePicture {
    render_with(&Tracer::new(scene, settings), scene, settings)
}

/// [`render`] by a tracer that was made before, of the same scene and settings.
pub fn render_with(tracer: &Tracer, scene: &FlatScene, settings: &ReferenceSettings) -> ReferencePicture {
    let pixels: Vec<_> = (0..settings.height)
        .into_par_iter()
        .flat_map_iter(|y| (0..settings.width).map(move |x| (x, y)))
        .map(|(x, y)| pixel(scene, settings, tracer, x, y))
        .collect();
    let (rgb, variance) = pixels.into_iter().unzip();
    ReferencePicture { width: settings.width, height: settings.height, rgb, variance, samples: settings.spp }
}

/// Mean and variance of the mean of one pixel.
fn pixel(scene: &FlatScene, settings: &ReferenceSettings, tracer: &Tracer, x: u32, y: u32) -> (DVec3, DVec3) {
    let mut rng = Rng::new(settings.seed, u64::from(y) * u64::from(settings.width) + u64::from(x));
    let mut estimate = Estimate::default();
    for _ in 0..settings.spp {
        let offset = DVec2::new(filter_offset(settings.filter, &mut rng), filter_offset(settings.filter, &mut rng));
        let film = DVec2::new(f64::from(x), f64::from(y)) + 0.5 + offset;
        let (origin, direction) = camera_ray(&scene.camera, film, settings.width, settings.height);
        let depth = direction.dot(scene.camera.forward);
        let (near, far) = (f64::from(scene.camera.znear) / depth, f64::from(scene.camera.zfar) / depth);
        estimate.add(tracer.radiance(origin, direction, near, far, &mut rng));
    }
    (estimate.mean, estimate.variance())
}

/// A running mean (Welford 1962, "Note on a Method for Calculating Corrected Sums of Squares and Products").
#[derive(Clone, Copy, Debug, Default)]
pub struct Estimate {
    count: f64,
    /// Of all samples.
    pub mean: DVec3,
    squares: DVec3,
}

impl Estimate {
    /// Takes one more sample in.
    pub fn add(&mut self, sample: DVec3) {
        self.count += 1.0;
        let before = sample - self.mean;
        self.mean += before / self.count;
        self.squares += before * (sample - self.mean);
    }

    /// Of the mean; zero below two samples.
    pub fn variance(&self) -> DVec3 {
        if self.count < 2.0 { DVec3::ZERO } else { self.squares / ((self.count - 1.0) * self.count) }
    }
}

/// Origin and unit direction of the ray of a film position, pixels from the top left.
pub fn camera_ray(camera: &CameraView, film: DVec2, width: u32, height: u32) -> (DVec3, DVec3) {
    let (width, height) = (f64::from(width), f64::from(height));
    let s = (2.0 * film.x - width) / height;
    let t = 1.0 - 2.0 * film.y / height;
    let aside = s * camera.right + t * camera.up;
    match camera.projection {
        ViewProjection::Perspective { tan_half_yfov } => {
            (camera.origin, (camera.forward + tan_half_yfov * aside).normalize())
        }
        ViewProjection::Orthographic { half_height } => (camera.origin + half_height * aside, camera.forward),
    }
}

/// Distance from the pixel's centre along one axis, pixels, distributed as the filter.
fn filter_offset(filter: PixelFilter, rng: &mut Rng) -> f64 {
    const RADIUS: f64 = 1.5;
    let shape = |x: f64| match filter {
        PixelFilter::Box => 1.0,
        PixelFilter::Gaussian => (-x * x / (2.0 * 0.5 * 0.5)).exp(),
        PixelFilter::BlackmanHarris => {
            let a = PI * x / RADIUS;
            0.35875 + 0.48829 * a.cos() + 0.14128 * (2.0 * a).cos() + 0.01168 * (3.0 * a).cos()
        }
    };
    let radius = if filter == PixelFilter::Box { 0.5 } else { RADIUS };
    loop {
        let x = radius * (2.0 * rng.uniform() - 1.0);
        if rng.uniform() < shape(x) {
            return x;
        }
    }
}
