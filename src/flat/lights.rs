//! Emitters, and how one of them is chosen.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use super::NONE;
use crate::{
    light::{EnvironmentTable, LightChoice},
    soa,
};

soa! {
    /// Emitting triangles in world space, and parallelograms of two of them.
    pub struct EmissiveTriangles of EmissiveTriangle {
        /// Row of the instance.
        instance: u32,
        /// Row of the triangle in its mesh; of a parallelogram the first's.
        triangle: u32,
        /// First corner, m.
        p0: [f32; 3],
        /// Second corner minus first.
        e1: [f32; 3],
        /// Third corner minus first.
        e2: [f32; 3],
        /// 1 for a parallelogram, whose fourth corner is `p0 + e1 + e2`. It has no texture.
        four: u32,
        /// Unit normal of the front side.
        n: [f32; 3],
        /// m².
        area: f32,
        /// Bound on the distance, along each axis, between a point made from these columns and the
        /// triangle that rays meet, m.
        error: [f32; 3],
        /// Radiance, nit, before any texture.
        radiance: [f32; 3],
        /// 1 if the back emits too.
        two_sided: u32,
        /// Row of the texture slot that scales the radiance, or `NONE`.
        texture: u32,
    }
}

soa! {
    /// Emitting shapes. Points are drawn uniformly by area in local space.
    pub struct EmissiveShapes of EmissiveShape {
        /// Row of the instance.
        instance: u32,
        /// In local space, m².
        area: f32,
        /// Area in the world, m².
        world_area: f32,
        /// By rows, what takes a unit normal in local space to one in the world that is as long as a piece of the surface
        /// gets larger.
        cofactors: [f32; 9],
        /// As of [`EmissiveTriangles`].
        error: [f32; 3],
        /// Radiance, nit, before any texture.
        radiance: [f32; 3],
        /// 1 if the back emits too.
        two_sided: u32,
        /// Row of the texture slot that scales the radiance, or `NONE`.
        texture: u32,
    }
}

soa! {
    /// Point and spot lights.
    pub struct LocalLights of LocalLight {
        /// m.
        position: [f32; 3],
        /// Unit direction the spot shines along; any unit vector for a point light.
        axis: [f32; 3],
        /// Intensity at full, cd.
        intensity: [f32; 3],
        /// Falloff is clamp(cos·scale + offset, 0, 1)²: 0 for a point light.
        cos_scale: f32,
        /// 1 for a point light.
        cos_offset: f32,
        /// Persistent key of the entity.
        key: u64,
    }
}

soa! {
    /// Directional lights.
    pub struct DistantLights of DistantLight {
        /// Unit direction towards the light.
        to_light: [f32; 3],
        /// Illuminance of a surface facing it, lx.
        illuminance: [f32; 3],
        /// Persistent key of the entity.
        key: u64,
    }
}

/// A light, or a point of one, in one piece as its sampling reads it: its columns lie in as many places of memory.
///
/// What is not said of a kind of light is zero.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Candidate {
    /// The point, m, or the first corner of a flat light, or the direction of one far away.
    pub target: [f32; 3],
    /// See [`EmissiveTriangles`].
    pub e1: [f32; 3],
    /// See [`EmissiveTriangles`].
    pub e2: [f32; 3],
    /// See [`EmissiveTriangles`]; of a local light scale and offset of the cosine.
    pub error: [f32; 3],
    /// Unit normal, or axis.
    pub normal: [f32; 3],
    /// nit; of a local light cd, of one far away lx.
    pub radiance: [f32; 3],
    /// Area of a flat light, one over the density by area of a shape or that by solid angle, density for the sky.
    pub measure: f32,
    /// 1 for a parallelogram.
    pub four: f32,
    /// 1 if the back emits too.
    pub two_sided: f32,
    /// 1 if a texture scales the radiance of a flat light.
    pub textured: f32,
    /// Fills whole vectors.
    pub padding: [f32; 2],
}

impl From<EmissiveTriangle> for Candidate {
    fn from(light: EmissiveTriangle) -> Self {
        Self {
            target: light.p0,
            e1: light.e1,
            e2: light.e2,
            error: light.error,
            normal: light.n,
            radiance: light.radiance,
            measure: light.area,
            four: light.four as f32,
            two_sided: light.two_sided as f32,
            textured: if light.texture == NONE { 0.0 } else { 1.0 },
            padding: [0.0; 2],
        }
    }
}

/// The sky.
#[derive(Clone, Debug)]
pub enum EnvironmentLight {
    /// The same radiance from everywhere, nit. Found by scattering alone: no sample of it is
    /// better than the BSDF's own.
    Constant([f32; 3]),
    /// A picture with its sampling table, shared with the cache.
    Map(Arc<EnvironmentTable>),
}

/// All emitters.
///
/// Choice row order: emissive triangles, local lights, emissive shapes, distant lights, then the
/// environment map if there is one.
#[derive(Clone, Debug, Default)]
pub struct Lights {
    /// Emitting triangles.
    pub triangles: EmissiveTriangles,
    /// The same, row by row.
    pub facets: Vec<Candidate>,
    /// Emitting shapes.
    pub shapes: EmissiveShapes,
    /// Point and spot lights.
    pub local: LocalLights,
    /// Directional lights.
    pub distant: DistantLights,
    /// The sky, if any.
    pub environment: Option<EnvironmentLight>,
    /// How likely each choice row is from where; empty without a light that can be sampled.
    pub choice: LightChoice,
    /// True if the scene had no light at all and a sky of 1 nit was put in.
    pub default_sky: bool,
}

impl Lights {
    /// First choice row of the local lights.
    pub fn first_local(&self) -> u32 {
        self.triangles.len() as u32
    }

    /// First choice row of the emitting shapes.
    pub fn first_shape(&self) -> u32 {
        self.first_local() + self.local.len() as u32
    }

    /// First choice row of the distant lights.
    pub fn first_distant(&self) -> u32 {
        self.first_shape() + self.shapes.len() as u32
    }

    /// The environment map's choice row, one past the last distant light's.
    pub fn environment_row(&self) -> u32 {
        self.first_distant() + self.distant.len() as u32
    }

    /// The light row of a shape, for [`FlatScene::light_rows`](super::FlatScene::light_rows): those of triangles come before.
    pub fn shape_row(&self, shape: usize) -> u32 {
        (self.triangles.len() + shape) as u32
    }
}
