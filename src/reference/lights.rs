//! What shines, and the choice of one light to look for.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::{geometry::Triangle, rng::Rng, shapes::Placed};
use crate::{
    flat::{EnvironmentLight, FlatScene, NONE, flags},
    light::EnvironmentTable,
};

/// A light that can be looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Light {
    /// An index into the triangles of the tree.
    Triangle(usize),
    /// An index into the shapes.
    Shape(usize),
    /// A row of `Lights::local`.
    Local(usize),
    /// A row of `Lights::distant`.
    Distant(usize),
    /// The picture of the sky.
    Map,
}

/// A discrete distribution, by its cumulative sums.
#[derive(Debug, Default)]
struct Distribution {
    /// One more than there are outcomes; from 0 to 1.
    cumulative: Vec<f64>,
}

impl Distribution {
    fn new(weights: impl IntoIterator<Item = f64>) -> Self {
        let mut cumulative = vec![0.0];
        let mut sum = 0.0;
        for weight in weights {
            sum += weight;
            cumulative.push(sum);
        }
        if sum > 0.0 {
            cumulative.iter_mut().for_each(|c| *c /= sum);
        }
        Self { cumulative }
    }

    fn probability(&self, index: usize) -> f64 {
        self.cumulative[index + 1] - self.cumulative[index]
    }

    fn sample(&self, u: f64) -> usize {
        self.cumulative.partition_point(|&c| c <= u) - 1
    }
}

/// All lights of a scene, each with its probability.
#[derive(Debug)]
pub struct LightTable<'a> {
    scene: &'a FlatScene,
    lights: Vec<Light>,
    choice: Distribution,
    /// By triangle of the tree: its index among the lights.
    of_triangle: Vec<Option<usize>>,
    /// By shape: the same.
    of_shape: Vec<Option<usize>>,
    texels: Distribution,
}

fn vec3(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

fn luminance(v: DVec3) -> f64 {
    v.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

impl<'a> LightTable<'a> {
    /// The lights of `scene`, whose triangles and shapes reach as far as `scale`, m, from the origin.
    pub fn new(scene: &'a FlatScene, triangles: &[Triangle], shapes: &[Placed], scale: f64) -> Self {
        let mut lights = Vec::new();
        let mut power = Vec::new();
        let mut of_triangle = vec![None; triangles.len()];
        for (index, triangle) in triangles.iter().enumerate() {
            let row = scene.light_of(triangle.instance, triangle.triangle);
            if row != NONE {
                of_triangle[index] = Some(lights.len());
                lights.push(Light::Triangle(index));
                let radiance = luminance(vec3(scene.lights.triangles.radiance[row as usize]));
                power.push(PI * radiance * triangle.cross().length() / 2.0);
            }
        }
        let mut of_shape = vec![None; shapes.len()];
        for (index, shape) in shapes.iter().enumerate() {
            let material = scene.materials.row(scene.material_of(shape.instance, 0) as usize);
            if let Some(area) = shape.area()
                && material.flags & flags::EMISSIVE != 0
            {
                of_shape[index] = Some(lights.len());
                lights.push(Light::Shape(index));
                // Any weight will do; this one is right for what is not scaled.
                power.push(PI * luminance(vec3(material.emissive)) * area);
            }
        }
        for row in 0..scene.lights.local.len() {
            lights.push(Light::Local(row));
            power.push(2.0 * TAU * luminance(vec3(scene.lights.local.intensity[row])));
        }
        let disc = PI * scale * scale;
        for row in 0..scene.lights.distant.len() {
            lights.push(Light::Distant(row));
            power.push(disc * luminance(vec3(scene.lights.distant.illuminance[row])));
        }
        let mut texels = Distribution::default();
        if let Some(map) = map(scene) {
            let weight =
                |(i, texel): (usize, &[f32; 3])| luminance(vec3(*texel)) * texel_solid_angle(map, i as u32 / map.width);
            texels = Distribution::new(map.texels.iter().enumerate().map(weight));
            let flux: f64 = map.texels.iter().enumerate().map(weight).sum();
            if flux > 0.0 {
                lights.push(Light::Map);
                power.push(disc * flux);
            }
        }
        // Half by power, half evenly: what is dim may be near.
        let total: f64 = power.iter().sum();
        let even = 1.0 / lights.len() as f64;
        let share = |p: &f64| if total > 0.0 { p / total } else { 0.0 };
        let choice = Distribution::new(power.iter().map(|p| even + share(p)));
        Self { scene, lights, choice, of_triangle, of_shape, texels }
    }

    /// A light and its probability; `None` if there are none.
    pub fn choose(&self, u: f64) -> Option<(Light, f64)> {
        let index = (!self.lights.is_empty()).then(|| self.choice.sample(u))?;
        Some((self.lights[index], self.choice.probability(index)))
    }

    /// Density with which this triangle's point at a distance, seen at an angle, is looked for, 1/sr.
    pub fn triangle_pdf(&self, index: usize, triangle: &Triangle, direction: DVec3, t: f64) -> f64 {
        let Some(light) = self.of_triangle[index] else { return 0.0 };
        let cross = triangle.cross();
        let cos = direction.dot(cross.normalize()).abs();
        self.choice.probability(light) * t * t / (cos * cross.length() / 2.0)
    }

    /// The same of a shape, given its point in local space and the plane that touches it there.
    pub fn shape_pdf(&self, index: usize, shape: &Placed, p: DVec3, direction: DVec3, t: f64) -> f64 {
        let Some(light) = self.of_shape[index] else { return 0.0 };
        let cos = direction.dot(shape.facet(p).cross().normalize()).abs();
        self.choice.probability(light) * t * t * shape.pdf(p) / cos
    }

    /// Radiance of the sky, nit.
    pub fn sky(&self, direction: DVec3) -> DVec3 {
        match &self.scene.lights.environment {
            None => DVec3::ZERO,
            Some(EnvironmentLight::Constant(radiance)) => vec3(*radiance),
            Some(EnvironmentLight::Map(map)) => vec3(map.texels[texel_at(map, direction)]),
        }
    }

    /// Density with which this direction is looked for, 1/sr.
    pub fn sky_pdf(&self, direction: DVec3) -> f64 {
        if self.lights.last() != Some(&Light::Map) {
            return 0.0;
        }
        let map = map(self.scene).expect("the light refers to it");
        let texel = texel_at(map, direction);
        let per_texel = self.texels.probability(texel) / texel_solid_angle(map, texel as u32 / map.width);
        self.choice.probability(self.lights.len() - 1) * per_texel
    }

    /// A direction into the picture of the sky.
    pub fn sample_sky(&self, rng: &mut Rng) -> DVec3 {
        let map = map(self.scene).expect("only called for a picture");
        let texel = self.texels.sample(rng.uniform()) as u32;
        let (column, row) = (texel % map.width, texel / map.width);
        let (top, bottom) = row_cosines(map, row);
        let y = top + (bottom - top) * rng.uniform();
        let phi = TAU * ((f64::from(column) + rng.uniform()) / f64::from(map.width) - 0.5) - f64::from(map.rotation);
        let sin = (1.0 - y * y).max(0.0).sqrt();
        DVec3::new(sin * phi.cos(), y, sin * phi.sin())
    }

    /// Towards a distant light, and its illuminance, lx.
    pub fn distant(&self, row: usize) -> (DVec3, DVec3) {
        let light = self.scene.lights.distant.row(row);
        (vec3(light.to_light).normalize(), vec3(light.illuminance))
    }

    /// Where a local light is, m.
    pub fn position(&self, row: usize) -> DVec3 {
        vec3(self.scene.lights.local.position[row])
    }

    /// Illuminance, lx, by a local light of a surface that faces it along `wi` at distance `d`.
    pub fn illuminance(&self, row: usize, wi: DVec3, d: f64) -> DVec3 {
        let light = self.scene.lights.local.row(row);
        let cos = -wi.dot(vec3(light.axis));
        let ramp = (cos * f64::from(light.cos_scale) + f64::from(light.cos_offset)).clamp(0.0, 1.0);
        vec3(light.intensity) * ramp * ramp / (d * d)
    }
}

fn map(scene: &FlatScene) -> Option<&EnvironmentTable> {
    match &scene.lights.environment {
        Some(EnvironmentLight::Map(map)) => Some(map),
        _ => None,
    }
}

/// Cosines to +Y of the upper and the lower edge of a row.
fn row_cosines(map: &EnvironmentTable, row: u32) -> (f64, f64) {
    let cos = |row: u32| (PI * f64::from(row) / f64::from(map.height)).cos();
    (cos(row), cos(row + 1))
}

fn texel_solid_angle(map: &EnvironmentTable, row: u32) -> f64 {
    let (top, bottom) = row_cosines(map, row);
    (top - bottom) * TAU / f64::from(map.width)
}

fn texel_at(map: &EnvironmentTable, d: DVec3) -> usize {
    // Turning by −rotation about +Y adds the rotation to atan2(z, x).
    let turn = 0.5 + (d.z.atan2(d.x) + f64::from(map.rotation)) / TAU;
    let u = turn - turn.floor();
    let v = d.y.clamp(-1.0, 1.0).acos() / PI;
    let column = ((u * f64::from(map.width)) as usize).min(map.width as usize - 1);
    let row = ((v * f64::from(map.height)) as usize).min(map.height as usize - 1);
    row * map.width as usize + column
}
