//! What flows between the stages of light paths.

use crate::{
    simd::{Compress, LANES},
    soa,
    wavefront::queues::queue,
};

queue! {
    /// Light paths under way. A row's ray starts at the path's last vertex.
    pub struct LightQueue of LightPath by LightBlock {
        /// Start of the ray, m; off the surface it leaves by more than its rounding error.
        ox: f32,
        /// As above.
        oy: f32,
        /// As above.
        oz: f32,
        /// Direction, unit length.
        dx: f32,
        /// As above.
        dy: f32,
        /// As above.
        dz: f32,
        /// Light that the path stands for, lm, red.
        flux_r: f32,
        /// As above, green.
        flux_g: f32,
        /// As above, blue.
        flux_b: f32,
        /// Of the path, for the sampler.
        index: u32,
        /// Scatterings behind it.
        depth: u32,
        /// The target that it must meet first; afterwards of no use.
        target: u32,
        /// Its last vertex in the [`History`](super::history::History), if one is kept.
        node: u32,
    }
}

queue! {
    /// Rays from the camera to vertices of light paths, with the light that they see there if nothing is in the way.
    pub struct SightQueue of Sight by SightBlock {
        /// Start, m.
        ox: f32,
        /// As above.
        oy: f32,
        /// As above.
        oz: f32,
        /// Direction, not of unit length.
        dx: f32,
        /// As above.
        dy: f32,
        /// As above.
        dz: f32,
        /// Decides about surfaces that cover in part.
        ray_id: u32,
        /// Nit times pixels, red.
        light_r: f32,
        /// As above, green.
        light_g: f32,
        /// As above, blue.
        light_b: f32,
        /// Column on the film, pixels.
        x: f32,
        /// Row on the film, pixels.
        y: f32,
        /// Of the path.
        index: u32,
        /// Scatterings behind it.
        depth: u32,
    }
}
