//! What pixels look at, if not at what lies before them in the camera's picture: places of surfaces, which are light meters
//! then, pixels of a picture in any order, or all that shines in a direction.

use super::{
    dimensions,
    queues::{HitQueue, HitRow, PathQueue},
};
use crate::flat::{FlatScene, Instance, MaterialRow, NONE, ShadingClass, flags};
use crate::{
    sampling::{Sampler, warp},
    simd::{Bits, Real, V3},
};

/// A place of a surface, as a ray would have met it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Row of the instance.
    pub instance: u32,
    /// Row of the triangle in its mesh.
    pub triangle: u32,
    /// Barycentric of the second corner.
    pub b1: f32,
    /// Barycentric of the third corner.
    pub b2: f32,
    /// Unit direction that the ray came along.
    pub direction: [f32; 3],
    /// The back was met.
    pub back: bool,
}

/// Discs are so many radii of a ball away from its centre.
const BEYOND: f32 = 1.01;

impl Beam {
    /// All that a ball sends off in a unit direction.
    pub fn new(center: glam::Vec3, radius: f32, to: glam::Vec3) -> Self {
        let (x, y) = to.any_orthonormal_pair();
        Self {
            center: (center + to * (radius * BEYOND)).to_array(),
            direction: (-to).to_array(),
            radii: [x, y].map(|axis| (axis * radius).to_array()),
        }
    }
}

/// What the pixels of a film look at, by rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Aim {
    /// What lies before them.
    #[default]
    Camera,
    /// The light that surfaces send back along given rays.
    Places(Vec<Place>),
    /// Pixels of a picture of that size.
    Pixels([u32; 2], Vec<[u32; 2]>),
    /// What comes through discs, straight.
    Beams(Vec<Beam>),
    /// What comes out of a ball in any direction, uniformly: its centre and radius, m.
    Around([f32; 3], f32),
}

/// Parallel rays through a disc.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Beam {
    /// Its centre, m.
    pub center: [f32; 3],
    /// Unit direction of the rays.
    pub direction: [f32; 3],
    /// Two radii that are at right angles to each other, m.
    pub radii: [[f32; 3]; 2],
}

impl Aim {
    /// The place that a pixel of a film of such a width looks at.
    #[inline]
    fn place(&self, pixel: [u32; 2], width: u32) -> Option<&Place> {
        let Self::Places(places) = self else { return None };
        places.get((pixel[1] * width + pixel[0]) as usize).or(places.last())
    }

    /// The pixel of the camera's picture that one of a film of such a width looks at.
    #[inline]
    pub fn pixel(&self, pixel: [u32; 2], width: u32) -> [u32; 2] {
        match self {
            Self::Pixels(_, pixels) => {
                pixels.get((pixel[1] * width + pixel[0]) as usize).or(pixels.last()).copied().unwrap_or(pixel)
            }
            _ => pixel,
        }
    }
}

/// Puts the paths from row `from` on where they have met their places; `tile` is their rectangle of a film of such a width.
/// Before it, they need not have been traced, after it they have met what they look at.
pub fn arrive(
    aim: &Aim,
    [x0, y0, width, _]: [u32; 4],
    film_width: u32,
    from: usize,
    paths: &PathQueue,
    hits: &mut HitQueue,
) {
    for row in from..paths.len() {
        let slot = paths.slot[row];
        if let Some(place) = aim.place([x0 + slot % width, y0 + slot / width], film_width) {
            let Place { instance, triangle, b1, b2, back, .. } = *place;
            hits.set(row, HitRow { t: 0.0, b1, b2, instance, triangle, back: u32::from(back) });
        }
    }
}

/// Points the paths from row `from` on at their places, so that they meet nothing on the way.
pub fn point(aim: &Aim, [x0, y0, width, _]: [u32; 4], film_width: u32, from: usize, paths: &mut PathQueue) {
    for row in from..paths.len() {
        let slot = paths.slot[row];
        if let Some(place) = aim.place([x0 + slot % width, y0 + slot / width], film_width) {
            [paths.dx[row], paths.dy[row], paths.dz[row]] = place.direction;
            paths.t_max[row] = 0.0;
        }
    }
}

/// Sends the paths from row `from` on through their discs.
pub fn shine(
    aim: &Aim,
    [x0, y0, width, _]: [u32; 4],
    film_width: u32,
    from: usize,
    sampler: &Sampler,
    paths: &mut PathQueue,
) {
    type Integer = <f32 as Real>::Bits;
    if !matches!(aim, Aim::Beams(_) | Aim::Around(..)) {
        return;
    }
    for row in from..paths.len() {
        let (hash, index) = (Integer::splat(paths.pixel_hash[row]), Integer::splat(paths.index[row]));
        let pair = |dimension| sampler.pair::<f32>(hash, index, Integer::splat(dimension));
        let beam = match aim {
            Aim::Around(center, radius) => {
                let V3 { x, y, z } = warp::uniform_sphere(pair(dimensions::LENS));
                Beam::new((*center).into(), *radius, glam::Vec3::new(x, y, z))
            }
            Aim::Beams(beams) => {
                let slot = paths.slot[row];
                let pixel = (y0 + slot / width) * film_width + x0 + slot % width;
                let Some(beam) = beams.get(pixel as usize).or(beams.last()) else { return };
                *beam
            }
            _ => return,
        };
        let (x, y) = warp::concentric_disk(pair(dimensions::FILTER));
        let [a, b] = beam.radii;
        let at = |i: usize| b[i].mul_add(y, a[i].mul_add(x, beam.center[i]));
        [paths.ox[row], paths.oy[row], paths.oz[row]] = [at(0), at(1), at(2)];
        [paths.dx[row], paths.dy[row], paths.dz[row]] = beam.direction;
        paths.t_max[row] = f32::INFINITY;
    }
}

/// Adds surfaces to a scene's tables that no ray meets: what is seen of them by [`Aim::Places`] is white and matt. Returns the
/// row of the first.
pub fn add_unseen(scene: &mut FlatScene, instances: impl IntoIterator<Item = (u32, [f32; 12], [f32; 12])>) -> u32 {
    let white = scene.materials.len() as u32;
    scene.materials.push(MaterialRow {
        flags: flags::DOUBLE_SIDED,
        class: ShadingClass::Lambert as u32,
        base_color: [1.0; 3],
        base_alpha: 1.0,
        roughness: 1.0,
        specular_color: [1.0; 3],
        ior: 1.5,
        base_color_texture: NONE,
        metallic_roughness_texture: NONE,
        normal_texture: NONE,
        emissive_texture: NONE,
        specular_texture: NONE,
        specular_color_texture: NONE,
        transmission_texture: NONE,
        key: u64::MAX,
        ..MaterialRow::default()
    });
    let first = scene.instances.len() as u32;
    for (mesh, world_from_local, local_from_world) in instances {
        let slots = scene.meshes[mesh as usize].slot_count.max(1);
        let material_base = scene.material_rows.len() as u32;
        scene.material_rows.extend((0..slots).map(|_| white));
        let m = |i: usize| world_from_local[i];
        let determinant = m(0) * (m(5) * m(10) - m(6) * m(9)) - m(1) * (m(4) * m(10) - m(6) * m(8))
            + m(2) * (m(4) * m(9) - m(5) * m(8));
        scene.instances.push(Instance {
            mesh,
            material_base,
            light_base: NONE,
            mirrored: u32::from(determinant < 0.0),
            identity: 0,
            key: u64::MAX,
            world_from_local,
            local_from_world,
        });
    }
    first
}
