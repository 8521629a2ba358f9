//! `measure --on ENTITY --bake WxH`: the illuminance of each texel of a picture over a surface's texture coordinates, as light maps
//! are.

use std::path::Path;

use image::ImageFormat;
use wavecast::{
    film::{self, Format, Layer, LayerData, Picture, WriteOptions},
    flat::FlatScene,
    measure::meter::{Effort, Meters, Reading, read},
};

use super::{
    colours::{Scale, false_colours},
    places::check_points,
};
use crate::cli::{error::CliError, progress::Watcher};

/// Samples of a texel where nothing says how many.
const SAMPLES: u64 = 1024;
/// Texels beside those that a surface covers get the value of the nearest: so many around, as filters of textures reach there.
const GUTTER: usize = 2;

/// Texels by rows from the top, which is v = 0; none where nothing is near.
pub struct Baked {
    size: [u32; 2],
    texels: Vec<Option<Reading>>,
    /// Texels whose middle is on the surface.
    pub covered: usize,
    /// Of those the mean of half the 95 % interval over the mean value.
    pub error: f64,
    /// Samples of each.
    pub samples: u64,
    /// Wall time.
    pub seconds: f64,
    /// Share of the triangles that lie outside of the picture, at least in part.
    outside: f64,
    /// Texels that several triangles lie on.
    overlaps: usize,
}

/// A texel, the triangle under its middle, and barycentrics of that one's second and third corners.
type Texel = (usize, (u32, [f32; 2]));

/// Places of a mesh under the middles of texels; the number of triangles that reach beyond the picture, and that of texels which
/// several triangles lie on.
fn places(scene: &FlatScene, instance: usize, [width, height]: [u32; 2]) -> (Vec<Texel>, usize, usize) {
    let (mut outside, mut overlaps) = (0, 0);
    let mesh = &scene.meshes[scene.instances.mesh[instance] as usize];
    let mut found: Vec<Option<(u32, [f32; 2])>> = vec![None; width as usize * height as usize];
    for triangle in 0..mesh.triangles.len() as u32 {
        let corners = mesh.vertices(triangle).map(|vertex| mesh.uvs[0][vertex as usize].map(f64::from));
        let is_in = |[u, v]: &[f64; 2]| (-1e-6..=1.0 + 1e-6).contains(u) && (-1e-6..=1.0 + 1e-6).contains(v);
        outside += usize::from(!corners.iter().all(is_in));
        let [a, b, c] = corners.map(|[u, v]| [u * f64::from(width), v * f64::from(height)]);
        let (ab, ac) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        let area = ab[0] * ac[1] - ab[1] * ac[0];
        let span = |axis: usize, all: u32| {
            let (lo, hi) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
            ((lo - 0.5).ceil().max(0.0) as u32, ((hi - 0.5).floor().min(f64::from(all) - 1.0)))
        };
        let ((x0, x1), (y0, y1)) = (span(0, width), span(1, height));
        if area == 0.0 || x1 < 0.0 || y1 < 0.0 {
            continue;
        }
        for (y, x) in (y0..=y1 as u32).flat_map(|y| (x0..=x1 as u32).map(move |x| (y, x))) {
            let p = [f64::from(x) + 0.5 - a[0], f64::from(y) + 0.5 - a[1]];
            let b1 = (p[0] * ac[1] - p[1] * ac[0]) / area;
            let b2 = (ab[0] * p[1] - ab[1] * p[0]) / area;
            if b1 >= 0.0 && b2 >= 0.0 && b1 + b2 <= 1.0 {
                let texel = &mut found[(y * width + x) as usize];
                // The middle of a texel may lie on an edge of two.
                let on_edge = b1.min(b2).min(1.0 - b1 - b2) < 1e-6;
                overlaps += usize::from(texel.is_some() && !on_edge);
                texel.get_or_insert((triangle, [b1 as f32, b2 as f32]));
            }
        }
    }
    (found.into_iter().enumerate().filter_map(|(texel, place)| Some((texel, place?))).collect(), outside, overlaps)
}

/// Reads all texels of an instance.
pub fn bake(
    scene: &FlatScene,
    instance: usize,
    name: &str,
    size: [u32; 2],
    effort: &Effort,
    watcher: &Watcher,
) -> Result<Baked, CliError> {
    let mesh = &scene.meshes[scene.instances.mesh[instance] as usize];
    if mesh.uvs.first().is_none_or(|uvs| uvs.is_empty()) {
        return Err(CliError::Usage(format!("--bake: {name} has no texture coordinates")));
    }
    check_points("--bake", size)?;
    let (places, outside, overlaps) = places(scene, instance, size);
    if places.is_empty() {
        return Err(CliError::Usage(format!("--bake: the texture coordinates of {name} are nowhere between 0 and 1")));
    }
    let samples = effort.samples.unwrap_or(SAMPLES);
    let effort = Effort { error: None, samples: Some(samples), ..*effort };
    let meters = Meters::On(instance as u32, places.iter().map(|(_, place)| *place).collect());
    let readings = read(scene, &meters, &effort, watcher);
    let mut texels = vec![None; size[0] as usize * size[1] as usize];
    let mut half = 0.0;
    for ((texel, _), reading) in places.iter().zip(&readings.each) {
        let [from, to] = reading.value.interval(0.95);
        half += 0.5 * (to - from);
        texels[*texel] = Some(*reading);
    }
    (0..GUTTER).for_each(|_| grow(&mut texels, size));
    let mean = readings.mean.value.value.max(f64::MIN_POSITIVE);
    Ok(Baked {
        size,
        texels,
        covered: places.len(),
        error: half / places.len() as f64 / mean,
        samples: readings.samples,
        seconds: readings.seconds,
        outside: outside as f64 / mesh.triangles.len().max(1) as f64,
        overlaps,
    })
}

/// Gives texels without a value that of a neighbour.
fn grow(texels: &mut [Option<Reading>], [width, height]: [u32; 2]) {
    let (width, height) = (i64::from(width), i64::from(height));
    let before = texels.to_vec();
    for (at, texel) in (0_i64..).zip(texels.iter_mut()).filter(|(_, texel)| texel.is_none()) {
        let (x, y) = (at % width, at / width);
        let near = [(0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];
        *texel = near.into_iter().find_map(|(dx, dy)| {
            let (x, y) = (x + dx, y + dy);
            let inside = (0..width).contains(&x) && (0..height).contains(&y);
            if inside { before[(y * width + x) as usize] } else { None }
        });
    }
}

impl Baked {
    /// What there is to warn of.
    pub fn warnings(&self) -> Vec<String> {
        let outside = (self.outside > 0.0).then(|| {
            let percent = 100.0 * self.outside;
            format!("--bake: {percent:.0} % of the triangles reach beyond texture coordinates of 0 to 1 and are cut off there")
        });
        let overlaps = (self.overlaps > 0).then(|| {
            let percent = 100.0 * self.overlaps as f64 / self.covered as f64;
            format!("--bake: several triangles lie on {percent:.0} % of the texels, which show the first of them")
        });
        outside.into_iter().chain(overlaps).collect()
    }

    /// In lux as EXR, with the standard error, or as PNG in false colours with a legend.
    pub fn write(&self, path: &Path, at: &str) -> Result<(), CliError> {
        if Format::of(path).is_ok_and(|format| format == Format::Exr) {
            let [width, height] = self.size.map(|n| n as usize);
            let of = |f: &dyn Fn(&Reading) -> [f64; 3]| {
                self.texels.iter().map(|t| t.as_ref().map_or([0.0; 3], |t| f(t).map(|c| c as f32))).collect::<Vec<_>>()
            };
            let values = of(&|reading| reading.rgb.map(|channel| channel.value));
            let errors = of(&|reading| reading.rgb.map(|channel| channel.variance.sqrt()));
            let picture = Picture {
                width,
                height,
                rgb: values.iter().map(|rgb| rgb.map(|c| c.max(0.0))).collect(),
                alpha: Some(self.texels.iter().map(|texel| f32::from(u8::from(texel.is_some()))).collect()),
                layers: vec![Layer { name: "error".into(), data: LayerData::Rgb(errors) }],
                metadata: vec![("illuminance, lx, of".into(), at.to_owned())],
            };
            return Ok(film::write(path, &picture, &WriteOptions::default())?);
        }
        let values: Vec<f64> = self.texels.iter().map(|texel| texel.map_or(0.0, |t| t.value.value)).collect();
        let picture = false_colours(self.size, &values, "lx", Scale::linear(&values));
        Ok(film::write_file(path, |file| picture.write_to(file, ImageFormat::Png).map_err(std::io::Error::other))?)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec2, Vec3};
    use wavecast::{
        render::Renderer,
        world::{Geometry, LocalTransform, Material, MaterialSlots, PointLight, Scene, TriMesh, units::Candela},
    };

    use super::*;

    /// A square of 2 m under a lamp, mapped to half of the picture: each texel has the lux of its place, those beside it the same as
    /// their neighbours, and all others nothing.
    #[test]
    fn texels_have_the_light_of_their_places() {
        let mut scene = Scene::new();
        let mut quad = TriMesh::quad(Vec3::new(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0);
        quad.uvs = vec![quad.positions.iter().map(|p| Vec2::new(0.25 * (p.x + 1.0), 0.5 * (p.z + 1.0))).collect()];
        let material = scene.spawn((Material::lambert(Vec3::splat(0.5)),));
        scene.spawn((Geometry(quad.into()), MaterialSlots::from(material)));
        let lamp = DVec3::new(0.3, 1.0, -0.2);
        let light = PointLight { color: Vec3::ONE, intensity: Candela(10.0) };
        scene.spawn((light, LocalTransform::from_translation(lamp)));
        let mut renderer = Renderer::new();
        renderer.sync(&mut scene);
        let effort = Effort { samples: Some(8), ..Effort::default() };
        let watcher = Watcher::new(true);
        let baked = bake(renderer.scene(), 0, "quad", [32, 16], &effort, &watcher).expect("it has coordinates");
        assert_eq!((baked.covered, baked.warnings()), (16 * 16, Vec::new()));
        for (i, texel) in baked.texels.iter().enumerate() {
            let (x, y) = (i % 32, i / 32);
            assert_eq!(texel.is_some(), x < 16 + GUTTER, "{x} {y}");
            let Some(texel) = texel else { continue };
            let at = |x: usize| DVec3::new((x.min(15) as f64 + 0.5) / 8.0 - 1.0, 0.0, (y as f64 + 0.5) / 8.0 - 1.0);
            let want = 10.0 * lamp.y / lamp.distance(at(x)).powi(3);
            // Beside the surface a neighbour may be one row off.
            let tolerance = if x < 16 { 1e-4 } else { 0.2 };
            assert!((texel.value.value / want - 1.0).abs() < tolerance, "{x} {y}: {texel:?} {want}");
        }
        assert!(bake(renderer.scene(), 0, "quad", [1 << 11, 1 << 11], &effort, &watcher).is_err(), "too many");
    }
}
