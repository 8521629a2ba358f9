//! Starts light paths at the suns of a sky: the few texels that are far brighter than it is on average.

use glam::Vec3;

use super::{LightPath, targets::Targets};
use crate::{
    flat::{EnvironmentLight, FlatScene, NONE, SceneNeeds, flags},
    light::EnvironmentTable,
    sampling::{AliasTable, Sampler, lengthen, warp},
    simd::{Bits, Frame, LANES, Real, V3},
    wavefront::dimensions,
};

type Integer = <f32 as Real>::Bits;

/// Pairs of the sampler that surfaces along a path do not use.
const CHOICE: u32 = 0;
const PLACE: u32 = 1;
const DIRECTION: u32 = u32::MAX;

/// Marks the target of a path that comes from a sun.
pub const FROM_SUN: u32 = 1 << 31;
/// How many times as bright as the mean of the sky a sun is.
const BRIGHT: f32 = 100.0;
/// Least share of the sky's light that makes suns worth light paths.
const LEAST_SHARE: f64 = 0.05;

/// The suns, and what their light is aimed at.
#[derive(Clone, Debug)]
pub struct Suns {
    /// Mirrors, glass and whatever else may have narrow lobes.
    pub targets: Targets,
    /// Texels above this luminance, nit.
    pub least: f32,
    texels: Vec<u32>,
    by_power: AliasTable,
    by_area: AliasTable,
    /// A ball around the scene.
    middle: Vec3,
    reach: f32,
}

impl Suns {
    /// Those of a scene, if they are bright enough and shine on something that is of finite size and shiny.
    pub fn new(scene: &FlatScene) -> Option<Self> {
        let Some(EnvironmentLight::Map(map)) = &scene.lights.environment else { return None };
        // Which way camera paths come from decides what absorbs the light.
        if scene.needs.has(SceneNeeds::VOLUMES)
            || !scene.materials.flags.iter().any(|&bits| bits & (flags::DELTA | flags::SHINY) != 0)
        {
            return None;
        }
        let (least, texels) = bright_texels(map)?;
        let power = |&texel: &u32| luminance(map.texels[texel as usize]) * map.solid_angle(texel);
        let by_power = AliasTable::new(&texels.iter().map(power).collect::<Vec<_>>());
        let targets = Targets::new(scene, flags::DELTA | flags::SHINY);
        let (lower, upper) = scene.accel.bounds()?;
        let (lower, upper) = (Vec3::from(lower), Vec3::from(upper));
        let (middle, reach) = (0.5 * (lower + upper), 0.51 * (upper - lower).length());
        let areas: Vec<f32> = targets.balls().map(|(_, radius)| radius * radius).collect();
        let finite = areas.iter().sum::<f32>().is_finite() && middle.is_finite() && reach.is_finite();
        let by_area = if finite { AliasTable::new(&areas) } else { AliasTable::default() };
        (!by_area.is_empty() && !by_power.is_empty()).then_some(Self {
            targets,
            least,
            texels,
            by_power,
            by_area,
            middle,
            reach,
        })
    }

    /// A path with the light that it stands for, lm.
    pub fn start(&self, scene: &FlatScene, sampler: &Sampler, key: u32, index: u32) -> Option<LightPath> {
        let Some(EnvironmentLight::Map(map)) = &scene.lights.environment else { return None };
        let pair =
            |dimension| sampler.pair::<f32>(Integer::splat(key), Integer::splat(index), Integer::splat(dimension));
        let (choice, place) = (pair(CHOICE), pair(PLACE));
        let longer = |u: f32, salt: f32| lengthen(u, dimensions::mix(u.to_bits() ^ salt.to_bits()));
        let (sun, _) = self.by_power.sample(longer(choice.0, place.0));
        let (target, _) = self.by_area.sample(longer(choice.1, place.1));
        let texel = self.texels[sun as usize];
        let (to_sun, radiance) = map.in_texels::<f32>(&[texel; LANES], pair(DIRECTION), 1);
        let (to_sun, radiance) = (to_sun.lane(0), radiance.lane(0));
        if luminance(radiance) <= self.least {
            // It strayed over the edge of its texel by rounding.
            return None;
        }
        let (center, radius) = self.targets.balls().nth(target as usize)?;
        let to_sun = Vec3::from(to_sun);
        let frame = Frame::new(V3::<f32>::from_array(to_sun.to_array()));
        let (x, y) = warp::concentric_disk::<f32>(place);
        let across = frame.to_world(V3::new(x * radius, y * radius, 0.0));
        // From beyond everything.
        let back = (center - self.middle).length() + self.reach + radius;
        let [ox, oy, oz] = (center + Vec3::from(across.lane(0)) + back * to_sun).to_array();
        let probability = self.by_power.pmf(sun) * self.by_area.pmf(target);
        let scale = map.solid_angle(texel) * std::f32::consts::PI * radius * radius / probability;
        Some(LightPath {
            ox,
            oy,
            oz,
            dx: -to_sun.x,
            dy: -to_sun.y,
            dz: -to_sun.z,
            flux_r: radiance[0] * scale,
            flux_g: radiance[1] * scale,
            flux_b: radiance[2] * scale,
            index,
            depth: 0,
            target: target | FROM_SUN,
            node: NONE,
        })
    }
}

fn luminance(radiance: [f32; 3]) -> f32 {
    V3::<f32>::from_array(radiance).luminance()
}

/// Texels that are suns, and a luminance that they are above and others are not, all of them by more than rounding.
fn bright_texels(map: &EnvironmentTable) -> Option<(f32, Vec<u32>)> {
    let mut least = BRIGHT * map.mean;
    let near = |least: f32| map.texels.iter().any(|&texel| (luminance(texel) / least - 1.0).abs() < 1e-5);
    while least > 0.0 && near(least) {
        least *= 1.000_1;
    }
    let suns = map.texels.iter().enumerate().filter(|&(_, &texel)| luminance(texel) > least);
    let texels: Vec<u32> = suns.map(|(row, _)| row as u32).collect();
    let power = |&texel: &u32| f64::from(luminance(map.texels[texel as usize]) * map.solid_angle(texel));
    let all = 4.0 * std::f64::consts::PI * f64::from(map.mean);
    let share = texels.iter().map(power).sum::<f64>() / all;
    (share > LEAST_SHARE).then_some((least, texels))
}
