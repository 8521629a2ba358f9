//! Luminous intensity of a luminaire by direction, as a goniophotometer reads it: from so far away that it is a point.
//!
//! Of surfaces I(ω) = ∫ L(x, ω) dA over what is seen of them at right angles to ω, interreflections among them; a lamp without
//! extent adds the intensity that the scene gives it where nothing hides it. Directions are those of type C photometry (IES LM-63-2002;
//! CIE 121-1996): γ from straight down (0°) to straight up (180°), C around the vertical, counterclockwise seen from above, from +X.

use std::{f64::consts::PI, fmt::Write as _};

use glam::DVec3;

use super::{
    meter::{Effort, Meters, Reading, read},
    student::Estimate,
};
use crate::{
    accel::Stacks,
    film::luminance,
    flat::{FlatScene, SceneNeeds},
    render::{Observer, SamplerKind},
    sampling::{Sampler, warp},
    simd::{Bits, V3},
    wavefront::SceneCoverage,
    world::Shape,
};

/// Independent estimates of what lamps without extent send off, and directions in each.
const REPLICAS: u64 = 16;
const DIRECTIONS: u32 = 4096;
/// Rays that decide how much of a lamp without extent is hidden by what covers in part.
const PARTIAL: u32 = 256;

/// Intensities on a grid of directions.
#[derive(Clone, Debug, PartialEq)]
pub struct FarField {
    /// From 0° to 180°, evenly.
    pub gamma_degrees: Vec<f64>,
    /// From 0°, evenly, to one step before 360°.
    pub c_degrees: Vec<f64>,
    /// cd; those of the first C, then those of the second and so on.
    pub intensity: Vec<Reading>,
    /// Mean over all directions, cd, and not only those of the grid; 4π times as much is the flux, lm.
    pub mean: Reading,
    /// Samples of each direction.
    pub samples: u64,
    /// Wall time.
    pub seconds: f64,
    /// The error that was asked for was reached, in the mean of the directions and in the flux.
    pub reached: bool,
    /// Contributions that were not finite.
    pub discarded: u64,
}

/// The direction of γ and C, degrees, in the axes of the scene, whose up is +Y.
pub fn direction(gamma_degrees: f64, c_degrees: f64) -> DVec3 {
    let ((sin, cos), (sin_c, cos_c)) = (gamma_degrees.to_radians().sin_cos(), c_degrees.to_radians().sin_cos());
    DVec3::new(sin * cos_c, -cos, -sin * sin_c)
}

/// Why there is no far field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FarFieldError {
    /// Something in the scene has no end.
    #[error("it has no end, so it cannot be seen from far away")]
    Endless,
}

/// Reads all that is in the scene, in `gammas` + 1 directions, three at least, from down to up for each of `cs` around, one at least; without its sky and lamps
/// that are infinitely far away.
///
/// # Errors
///
/// A scene that has no end.
pub fn far_field(
    scene: &FlatScene,
    gammas: u32,
    cs: u32,
    effort: &Effort,
    observer: &dyn Observer,
) -> Result<FarField, FarFieldError> {
    let (gammas, cs) = (gammas.max(2), cs.max(1));
    let mut meshes = scene.instances.mesh.iter().map(|&row| &scene.meshes[row as usize]);
    if meshes.any(|mesh| mesh.shape == Some(Shape::Plane)) || !scene.radius.is_finite() {
        return Err(FarFieldError::Endless);
    }
    let mut scene = scene.clone();
    scene.lights.environment = None;
    let step = 180.0 / f64::from(gammas);
    let gamma_degrees: Vec<f64> = (0..=gammas).map(|i| f64::from(i) * step).collect();
    let c_degrees: Vec<f64> = (0..cs).map(|i| f64::from(i) * 360.0 / f64::from(cs)).collect();
    // The poles once; each direction stands for the cell around it.
    let cap = |gamma: f64| 2.0 * PI * (1.0 - gamma.to_radians().cos());
    let band = |gamma: f64| (cap(gamma + 0.5 * step) - cap(gamma - 0.5 * step)) / f64::from(cs);
    let mut directions = vec![(direction(0.0, 0.0), cap(0.5 * step)), (direction(180.0, 0.0), cap(0.5 * step))];
    for &c in &c_degrees {
        let inner = gamma_degrees[1..gammas as usize].iter();
        directions.extend(inner.map(|&gamma| (direction(gamma, c), band(gamma))));
    }
    let mut readings = read(&scene, &Meters::Directions(directions.clone()), effort, observer);
    let lamps: Vec<[f64; 3]> = directions.iter().map(|&(to, _)| from_points(&scene, to)).collect();
    readings.each.iter_mut().zip(&lamps).for_each(|(reading, &rgb)| add(reading, rgb));
    // As many samples as all directions of the grid have together.
    let whole = effort.samples.map(|samples| samples.saturating_mul(directions.len() as u64));
    let around = read(&scene, &Meters::Around, &Effort { samples: whole, ..*effort }, observer);
    let of_lamps: Vec<[f64; 3]> = (0..REPLICAS).map(|replica| mean_of_points(&scene, replica)).collect();
    let mean = sum(&around.mean, &of_lamps);
    let inner = gammas as usize - 1;
    let of = |c: usize, gamma: usize| match gamma {
        0 => readings.each[0],
        _ if gamma == gammas as usize => readings.each[1],
        _ => readings.each[2 + c * inner + gamma - 1],
    };
    let intensity = (0..cs as usize).flat_map(|c| (0..=gammas as usize).map(move |gamma| (c, gamma)));
    Ok(FarField {
        intensity: intensity.map(|(c, gamma)| of(c, gamma)).collect(),
        mean,
        gamma_degrees,
        c_degrees,
        samples: readings.samples,
        seconds: readings.seconds + around.seconds,
        reached: readings.reached && around.reached,
        discarded: readings.discarded + around.discarded,
    })
}

fn add(reading: &mut Reading, rgb: [f64; 3]) {
    (0..3).for_each(|c| reading.rgb[c].value += rgb[c]);
    reading.value.value += luminance(rgb);
}

/// A reading and independent estimates of something else.
fn sum(reading: &Reading, others: &[[f64; 3]]) -> Reading {
    let both = |a: Estimate, b: Estimate| Estimate::sum([(1.0, a), (1.0, b)]);
    Reading {
        rgb: std::array::from_fn(|c| both(reading.rgb[c], Estimate::of(others.iter().map(|rgb| rgb[c])))),
        value: both(reading.value, Estimate::of(others.iter().map(|&rgb| luminance(rgb)))),
    }
}

/// Mean intensity of lamps without extent, cd, by directions that are spread evenly over the sphere.
fn mean_of_points(scene: &FlatScene, replica: u64) -> [f64; 3] {
    type Integer = <f32 as crate::simd::Real>::Bits;
    if scene.lights.local.is_empty() {
        return [0.0; 3];
    }
    let sampler = Sampler::new(SamplerKind::Sobol, replica);
    let hash = sampler.pixel_hash(0, 0);
    let mut all = [0.0; 3];
    for index in 0..DIRECTIONS {
        let u = sampler.pair::<f32>(Integer::splat(hash), Integer::splat(index), Integer::splat(0));
        let V3 { x, y, z } = warp::uniform_sphere(u);
        let rgb = from_points(scene, DVec3::new(x.into(), y.into(), z.into()).normalize());
        (0..3).for_each(|c| all[c] += rgb[c] / f64::from(DIRECTIONS));
    }
    all
}

/// What lamps without extent send into a direction, cd.
fn from_points(scene: &FlatScene, to: DVec3) -> [f64; 3] {
    let (lights, to) = (&scene.lights.local, to.as_vec3());
    let coverage = SceneCoverage::new(scene);
    let mut stacks = Stacks::default();
    let rays = if scene.needs.has(SceneNeeds::ALPHA) { PARTIAL } else { 1 };
    let mut all = [0.0; 3];
    for row in 0..lights.len() {
        let light = lights.row(row);
        let cos = glam::Vec3::from(light.axis).dot(to);
        let falloff = f64::from(light.cos_scale.mul_add(cos, light.cos_offset).clamp(0.0, 1.0)).powi(2);
        if falloff == 0.0 {
            continue;
        }
        let is_open = |id: &u32| {
            let id = id.wrapping_mul(0x9e37_79b9);
            !scene.accel.occluded(light.position, to.to_array(), f32::INFINITY, id, &coverage, &mut stacks)
        };
        let open = (0..rays).filter(is_open).count() as f64 / f64::from(rays);
        (0..3).for_each(|c| all[c] += f64::from(light.intensity[c]) * falloff * open);
    }
    all
}

impl FarField {
    /// Flux, lm.
    pub fn flux(&self) -> Estimate {
        Estimate::sum([(4.0 * PI, self.mean.value)])
    }

    /// The greatest intensity, cd, and its γ and C, degrees.
    pub fn peak(&self) -> (Reading, [f64; 2]) {
        let by = |a: &usize, b: &usize| self.intensity[*a].value.value.total_cmp(&self.intensity[*b].value.value);
        let row = (0..self.intensity.len()).max_by(by).unwrap_or(0);
        let (c, gamma) = (row / self.gamma_degrees.len(), row % self.gamma_degrees.len());
        (self.intensity[row], [self.gamma_degrees[gamma], self.c_degrees[c]])
    }

    /// As a file of IES LM-63-2002: type C, absolute photometry; `remarks` are lines for its head.
    pub fn to_ies(&self, luminaire: &str, remarks: &[String]) -> String {
        // Of a line 256 characters are read.
        let clean = |text: &str| text.chars().filter(|c| !c.is_control()).take(200).collect::<String>();
        let mut text = String::from("IESNA:LM-63-2002\n");
        writeln!(text, "[TEST] wavecast\n[TESTLAB] simulated\n[ISSUEDATE] none\n[MANUFAC] none\n[LUMCAT] none")
            .expect(TAKES);
        writeln!(text, "[LUMINAIRE] {}", clean(luminaire)).expect(TAKES);
        for remark in remarks {
            writeln!(text, "[OTHER] {}", clean(remark)).expect(TAKES);
        }
        text.push_str("TILT=NONE\n");
        let (gammas, cs) = (self.gamma_degrees.len(), self.c_degrees.len());
        // One lamp of no stated flux, candela as they are, type C, metres, a point; no ballast, no known power.
        writeln!(text, "1 -1 1 {gammas} {} 1 2 0 0 0\n1 1 0", cs + 1).expect(TAKES);
        let rows = |text: &mut String, numbers: &mut dyn Iterator<Item = String>| {
            let mut width = 0;
            for number in numbers {
                if width + number.len() > 120 {
                    text.push('\n');
                    width = 0;
                }
                width += number.len() + 1;
                text.push_str(&number);
                text.push(' ');
            }
            text.push('\n');
        };
        let degrees = |x: f64| format!("{}", (x * 1e6).round() / 1e6);
        rows(&mut text, &mut self.gamma_degrees.iter().map(|&x| degrees(x)));
        rows(&mut text, &mut self.c_degrees.iter().chain(&[360.0]).map(|&x| degrees(x)));
        for c in (0..cs).chain([0]) {
            let all = &self.intensity[c * gammas..(c + 1) * gammas];
            rows(&mut text, &mut all.iter().map(|reading| six_digits(reading.value.value)));
        }
        text
    }
}

/// Without an exponent, which not every program reads.
fn six_digits(x: f64) -> String {
    if x <= 0.0 {
        return "0".into();
    }
    let places = (5.0 - x.log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{x:.places$}")
}

const TAKES: &str = "a string takes it";
