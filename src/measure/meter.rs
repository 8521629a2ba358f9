//! Light meters: illuminance at places, luminance along views, each with an interval that means what it says.
//!
//! A meter that faces along n reads E = ∫ L(ω) max(n·ω, 0) dω (Pharr, Jakob, Humphreys 2023, "Physically Based Rendering", section
//! 4.1.1). It is measured as what a white matt surface there would send back, which is E/π in every direction: so the meter is
//! reached by all light that a path tracer knows, lamps without extent among it, and casts no shadow, since no ray meets it.
//!
//! Each meter is read by several copies whose numbers have nothing to do with one another; intervals rest on the spread of their
//! readings, and on nothing that is assumed of the sequence that a copy draws its samples from.

use std::{f64::consts::PI, sync::Arc, time::Duration};

use glam::{DVec3, Vec3};

use super::student::Estimate;
use crate::{
    film::luminance,
    flat::{FlatMesh, FlatScene},
    render::{Observer, PixelFilter, RenderSettings, Rendered, Sharing},
    wavefront::{Aim, Beam, Place, add_unseen, render_aimed},
};

/// What is read.
#[derive(Clone, Debug, PartialEq)]
pub enum Meters {
    /// Illuminance on planes given by point, m, and normal, in lx.
    Planes(Vec<(DVec3, DVec3)>),
    /// Illuminance on an instance's own surface, on the side of its front, in lx: rows of triangles and barycentrics of their second
    /// and third corners.
    On(u32, Vec<(u32, [f32; 2])>),
    /// Luminance of pixels of the camera's picture of such a size, in nit.
    Pixels([u32; 2], Vec<[u32; 2]>),
    /// Luminous intensity of all that is in the scene, as seen from far away in unit directions, in cd; their mean is
    /// weighted. See [`far_field`](super::far_field).
    Directions(Vec<(DVec3, f64)>),
    /// The mean of that over all directions, in cd.
    Around,
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// Half of the 95 % interval over the reading, of the mean over all meters; at most that is to be reached.
    pub error: Option<f64>,
    /// Samples of each meter, at most.
    pub samples: Option<u64>,
    /// Time, at most.
    pub time: Option<Duration>,
    /// Chooses the random numbers.
    pub seed: u64,
    /// Worker threads; 0 for one per core.
    pub threads: usize,
    /// Greatest number of scatterings behind the light that is read; none for Russian roulette alone. 0 is light straight
    /// from the lamps.
    pub max_depth: Option<u32>,
}

impl Default for Effort {
    fn default() -> Self {
        Self { error: Some(0.005), samples: None, time: None, seed: 0, threads: 0, max_depth: None }
    }
}

/// A number for each colour channel and for luminance, which is what lux and nit mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// By channel of linear Rec.709.
    pub rgb: [Estimate; 3],
    /// Of their luminance.
    pub value: Estimate,
}

/// What meters read.
#[derive(Clone, Debug, PartialEq)]
pub struct Readings {
    /// By meter.
    pub each: Vec<Reading>,
    /// The mean over all meters.
    pub mean: Reading,
    /// Samples of each meter.
    pub samples: u64,
    /// Wall time.
    pub seconds: f64,
    /// Contributions that were not finite.
    pub discarded: u64,
    /// The error that was asked for was reached.
    pub reached: bool,
}

/// Copies of a single meter: enough that the spread of their readings is well known.
const COPIES: usize = 1024;
/// Copies of each of many meters, at least.
const LEAST_COPIES: usize = 8;
/// Samples of each copy in the first round, which tells how many it takes.
const FIRST_SPP: u32 = 16;
/// By how much more samples are taken than would do on average: so that the error is mostly reached with them.
const MARGIN: f64 = 1.25;
/// Rounds at most.
const ROUNDS: usize = 8;
/// Pixels to a row of the film.
const WIDTH: usize = 128;

/// Reads all meters in a scene.
///
/// With an error to reach, a first round tells how many samples that takes, and a second one, with other random numbers, takes them
/// (Stein 1945, "A Two-Sample Test for a Linear Hypothesis Whose Power is Independent of the Variance"): a reading does not end
/// because it looks good, so its interval stays honest. If that was not enough, there is another such round.
pub fn read(scene: &FlatScene, meters: &Meters, effort: &Effort, observer: &dyn Observer) -> Readings {
    let start = std::time::Instant::now();
    let count = meters.count();
    let copies = (COPIES / count.max(1)).clamp(LEAST_COPIES, COPIES);
    let (scene, aim, scale) = meters.aim(scene, copies);
    let most_spp = effort.samples.map_or(u32::MAX, |n| n.div_ceil(copies as u64).clamp(1, u64::from(u32::MAX)) as u32);
    let mut spp = match effort.error {
        None => most_spp.min(1 << 20),
        Some(_) => FIRST_SPP.min(most_spp),
    };
    let mut seconds_each = 0.0;
    let mut last = None;
    let mut round = 0;
    loop {
        let left = effort.time.map(|limit| limit.saturating_sub(start.elapsed()));
        if let Some(left) = left
            && seconds_each > 0.0
        {
            spp = spp.min((left.as_secs_f64() / seconds_each) as u32).max(1);
        }
        let before = start.elapsed().as_secs_f64();
        let rendered = round_of(&scene, &aim, meters, count * copies, spp, effort, (round, left), observer);
        if rendered.stats.cancelled {
            // Some copies have been read and others not: these say nothing.
            return last.unwrap_or_else(|| readings(&rendered, meters, copies, scale).unknown());
        }
        seconds_each = (start.elapsed().as_secs_f64() - before) / rendered.stats.spp.max(1.0);
        let mut readings = readings(&rendered, meters, copies, scale);
        readings.samples = (rendered.stats.spp * copies as f64).round() as u64;
        readings.seconds = start.elapsed().as_secs_f64();
        let Some(target) = effort.error else {
            readings.reached = true;
            return readings;
        };
        let value = &readings.mean.value;
        let [from, to] = value.interval(0.95);
        let half = 0.5 * (to - from);
        readings.reached = half <= target * value.value.abs();
        let late = effort.time.is_some_and(|limit| start.elapsed().as_secs_f64() + seconds_each >= limit.as_secs_f64());
        if readings.reached || round + 1 == ROUNDS || spp >= most_spp || late {
            return readings;
        }
        // Nothing was found yet: look harder.
        let ratio = if value.value == 0.0 { 16.0 } else { (half / (target * value.value.abs())).powi(2) };
        let want = f64::from(spp) * (MARGIN * ratio).max(1.5);
        spp = want.min(f64::from(most_spp)).min(f64::from(1_u32 << 30)) as u32;
        last = Some(readings);
        round += 1;
    }
}

impl Readings {
    /// With intervals that reach everywhere.
    fn unknown(mut self) -> Self {
        for reading in self.each.iter_mut().chain([&mut self.mean]) {
            reading.rgb.iter_mut().chain([&mut reading.value]).for_each(|estimate| estimate.variance = f64::INFINITY);
        }
        self
    }
}

fn round_of(
    scene: &FlatScene,
    aim: &Aim,
    meters: &Meters,
    pixels: usize,
    spp: u32,
    effort: &Effort,
    (round, left): (usize, Option<Duration>),
    observer: &dyn Observer,
) -> Rendered {
    let width = WIDTH.min(pixels.max(1));
    // Light that a surface sends back has been scattered once more.
    let more = u32::from(matches!(meters, Meters::Planes(_) | Meters::On(..)));
    let settings = RenderSettings {
        width: width as u32,
        height: pixels.div_ceil(width) as u32,
        spp: Some(spp),
        time: left,
        max_depth: effort.max_depth.map(|most| most.saturating_add(more)),
        // Rounds have nothing to do with one another.
        seed: effort.seed.wrapping_mul(ROUNDS as u64).wrapping_add(round as u64),
        sharing: Sharing::Off,
        filter: PixelFilter::Box,
        threads: effort.threads,
        tile_size: 16,
        ..RenderSettings::default()
    };
    render_aimed(scene, &settings, aim.clone(), observer)
}

/// By meter and all together, from pixels that are the copies of the first meter, then those of the second, and so on.
fn readings(rendered: &Rendered, meters: &Meters, copies: usize, scale: f64) -> Readings {
    let count = meters.count();
    let value = |meter: usize, copy: usize| rendered.picture.rgb[meter * copies + copy].map(|c| scale * f64::from(c));
    let reading = |of_copy: &dyn Fn(usize) -> [f64; 3]| {
        let all: Vec<[f64; 3]> = (0..copies).map(of_copy).collect();
        Reading {
            rgb: std::array::from_fn(|c| Estimate::of(all.iter().map(|rgb| rgb[c]))),
            value: Estimate::of(all.iter().map(|&rgb| luminance(rgb))),
        }
    };
    let all = (0..count).map(|meter| meters.weight(meter)).sum::<f64>().max(f64::MIN_POSITIVE);
    let mean = |copy: usize| {
        let sum = (0..count).fold([0.0; 3], |sum, meter| {
            let (rgb, weight) = (value(meter, copy), meters.weight(meter));
            std::array::from_fn(|c| rgb[c].mul_add(weight, sum[c]))
        });
        sum.map(|c| c / all)
    };
    Readings {
        each: (0..count).map(|meter| reading(&|copy| value(meter, copy))).collect(),
        mean: reading(&mean),
        samples: 0,
        seconds: 0.0,
        discarded: rendered.stats.discarded.iter().map(|(_, count)| count).sum(),
        reached: false,
    }
}

impl Meters {
    /// How many there are.
    pub fn count(&self) -> usize {
        match self {
            Self::Planes(places) => places.len(),
            Self::On(_, places) => places.len(),
            Self::Pixels(_, pixels) => pixels.len(),
            Self::Directions(directions) => directions.len(),
            Self::Around => 1,
        }
    }

    /// How much one counts in the mean of all.
    fn weight(&self, meter: usize) -> f64 {
        if let Self::Directions(directions) = self { directions[meter].1 } else { 1.0 }
    }

    /// The scene with its meters, what each pixel of a film looks at, and what a meter reads for a nit there.
    fn aim(&self, scene: &FlatScene, copies: usize) -> (FlatScene, Aim, f64) {
        let mut scene = scene.clone();
        let mut scale = if matches!(self, Self::Pixels(..)) { 1.0 } else { PI };
        let aim = match self {
            Self::Directions(directions) => {
                let (center, radius) = ball(&scene);
                // I = ∫ L dA over all that is seen at right angles to the direction.
                scale = PI * f64::from(radius).powi(2);
                let beam = |&(to, _): &(DVec3, f64)| Beam::new(center, radius, to.as_vec3());
                Aim::Beams(repeat(directions.iter().map(beam), copies))
            }
            Self::Around => {
                let (center, radius) = ball(&scene);
                scale = PI * f64::from(radius).powi(2);
                Aim::Around(center.to_array(), radius)
            }
            Self::Pixels(size, pixels) => Aim::Pixels(*size, repeat(pixels.iter().copied(), copies)),
            Self::Planes(places) => {
                let mesh = scene.meshes.len() as u32;
                scene.meshes.push(Arc::new(unit_triangle()));
                let first = add_unseen(&mut scene, places.iter().map(|&(p, n)| standing(mesh, p, n)));
                let place = |(row, (_, n)): (u32, &(DVec3, DVec3))| Place {
                    instance: row,
                    b1: 1.0 / 3.0,
                    b2: 1.0 / 3.0,
                    direction: (-n.normalize_or(DVec3::Y)).as_vec3().to_array(),
                    ..Place::default()
                };
                Aim::Places(repeat((first..).zip(places).map(place), copies))
            }
            Self::On(instance, places) => {
                let row = *instance as usize;
                // Without shading normals: light falls on the surface that is there.
                let shown = Arc::clone(&scene.meshes[scene.instances.mesh[row] as usize]);
                let mesh = scene.meshes.len() as u32;
                scene.meshes.push(Arc::new(FlatMesh {
                    positions: shown.positions.clone(),
                    triangles: shown.triangles.clone(),
                    slot_count: 1,
                    ..FlatMesh::default()
                }));
                let (to_world, to_local) =
                    (scene.instances.world_from_local[row], scene.instances.local_from_world[row]);
                let mirrored = scene.instances.mirrored[row] == 1;
                let first = add_unseen(&mut scene, [(mesh, to_world, to_local)]);
                let place = |&(triangle, [b1, b2]): &(u32, [f32; 2])| {
                    let [a, b, c] = shown.corners(triangle).map(|p| scene.placed(row, Vec3::from(p)));
                    let n = (b - a).cross(c - a).normalize_or(Vec3::Y) * if mirrored { -1.0 } else { 1.0 };
                    Place { instance: first, triangle, b1, b2, direction: (-n).to_array(), back: false }
                };
                Aim::Places(repeat(places.iter().map(place), copies))
            }
        };
        (scene, aim, scale)
    }
}

/// Ball around all that is shown, m; a little larger, for the rounding of rays.
fn ball(scene: &FlatScene) -> (Vec3, f32) {
    (Vec3::from(scene.center), scene.radius * (1.0 + 1e-5))
}

fn repeat<T: Copy>(items: impl Iterator<Item = T>, copies: usize) -> Vec<T> {
    items.flat_map(|item| std::iter::repeat_n(item, copies)).collect()
}

/// An equilateral triangle around the origin that faces +Z.
fn unit_triangle() -> FlatMesh {
    let corner = |degrees: f32| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [cos, sin, 0.0]
    };
    FlatMesh {
        positions: vec![corner(90.0), corner(210.0), corner(330.0)],
        triangles: vec![[0, 1, 2]],
        slot_count: 1,
        ..FlatMesh::default()
    }
}

/// The mesh at a point, turned from +Z to a normal: world from local and back.
fn standing(mesh: u32, p: DVec3, n: DVec3) -> (u32, [f32; 12], [f32; 12]) {
    let n = n.normalize_or(DVec3::Y);
    let (x, y) = n.any_orthonormal_pair();
    let to_world = [x.x, y.x, n.x, p.x, x.y, y.y, n.y, p.y, x.z, y.z, n.z, p.z].map(|v| v as f32);
    let back = |axis: DVec3| [axis.x, axis.y, axis.z, -axis.dot(p)].map(|v| v as f32);
    let ([a, b, c], mut to_local) = ([back(x), back(y), back(n)], [0.0; 12]);
    to_local[..4].copy_from_slice(&a);
    to_local[4..8].copy_from_slice(&b);
    to_local[8..].copy_from_slice(&c);
    (mesh, to_world, to_local)
}
