//! Which surfaces are there for a ray: culled backs and partial coverage.

use std::cell::Cell;

use super::dimensions::mix;
use crate::{
    accel::{Coverage, Hit},
    flat::{COVERS, FlatScene, NONE, flags},
};

/// Asks the materials of a scene.
pub struct SceneCoverage<'a> {
    scene: &'a FlatScene,
    /// Hits whose alpha was looked at.
    pub alpha_tests: Cell<u64>,
    /// Texture look-ups among them.
    pub texture_lookups: Cell<u64>,
}

impl<'a> SceneCoverage<'a> {
    /// For the materials of `scene`.
    pub fn new(scene: &'a FlatScene) -> Self {
        Self { scene, alpha_tests: Cell::new(0), texture_lookups: Cell::new(0) }
    }

    fn is_shape(&self, hit: &Hit) -> bool {
        self.scene.meshes[self.scene.instances.mesh[hit.instance as usize] as usize].shape.is_some()
    }

    fn alpha(&self, material: usize, hit: &Hit) -> f32 {
        let materials = &self.scene.materials;
        let mesh = &self.scene.meshes[self.scene.instances.mesh[hit.instance as usize] as usize];
        let triangle = mesh.vertices(hit.triangle);
        let b0 = 1.0 - hit.b1 - hit.b2;
        let mut alpha = materials.base_alpha[material];
        if !mesh.colors.is_empty() {
            let [a, b, c] = triangle.map(|vertex| mesh.colors[vertex as usize][3]);
            alpha *= b0 * a + hit.b1 * b + hit.b2 * c;
        }
        let slot = materials.base_color_texture[material];
        if slot != NONE {
            let uv = mesh.uv_at(self.scene.textures.slots.tex_coord[slot as usize], triangle, hit.b1, hit.b2);
            alpha *= self.scene.textures.sample(slot, uv)[3];
            self.texture_lookups.set(self.texture_lookups.get() + 1);
        }
        alpha
    }
}

impl SceneCoverage<'_> {
    /// As [`Coverage::covers`], for `BACKS` too.
    fn covers_with<const BACKS: bool>(&self, ray_id: u32, hit: &Hit) -> bool {
        let material = self.scene.material_of(hit.instance, hit.triangle) as usize;
        let bits = self.scene.materials.flags[material];
        if !BACKS && hit.back && bits & (flags::DOUBLE_SIDED | flags::TRANSMISSION) == 0 {
            return false;
        }
        if bits & (flags::MASK | flags::BLEND) == 0 {
            return true;
        }
        self.alpha_tests.set(self.alpha_tests.get() + 1);
        let alpha = self.alpha(material, hit);
        if bits & flags::MASK != 0 {
            alpha >= self.scene.materials.alpha_cutoff[material]
        } else {
            // A pure function of the ray and the surface, so that the order of traversal does not matter.
            // A ray may come in and go out through the same face of a shape, and asks twice.
            let place = if hit.back && self.is_shape(hit) { !hit.triangle } else { hit.triangle };
            let u = mix(ray_id ^ mix(place ^ mix(hit.instance))) >> 8;
            (u as f32) * (1.0 / 16_777_216.0) < alpha || alpha >= COVERS
        }
    }
}

impl Coverage for SceneCoverage<'_> {
    const TRIVIAL: bool = false;

    fn covers(&self, ray_id: u32, hit: &Hit) -> bool {
        self.covers_with::<false>(ray_id, hit)
    }
}

/// Asks the materials of a scene for rays that run with the light.
///
/// A surface without a back lets those through that run against the light, but may have scattered the same light at its
/// front: so these stop at both sides, and what stopped them is to tell which.
pub struct BothSides<'a>(pub SceneCoverage<'a>);

impl Coverage for BothSides<'_> {
    const TRIVIAL: bool = false;
    const BACKS: bool = true;

    fn covers(&self, ray_id: u32, hit: &Hit) -> bool {
        self.0.covers_with::<true>(ray_id, hit)
    }
}
