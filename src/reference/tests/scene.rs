//! Small scenes, their tables filled by hand.

use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};

use crate::{
    flat::*,
    light::EnvironmentTable,
    reference::{ReferenceSettings, Rng, Tracer, render::Estimate},
    world::{self, AlphaMode, TriMesh},
};

/// Fills a [`FlatScene`]; what concerns the fast renderer alone stays empty.
#[derive(Default)]
pub struct TestScene {
    pub flat: FlatScene,
}

/// White Lambert, seen from both sides.
pub fn lambert(albedo: f32) -> world::Material {
    world::Material::lambert(Vec3::splat(albedo))
}

/// Lambert that emits a radiance, nit, from both sides.
pub fn emitter(albedo: f32, radiance: f32) -> world::Material {
    world::Material { emissive: Vec3::splat(radiance), ..lambert(albedo) }
}

/// A square of side `2·half` about `center`, facing +Y.
pub fn floor(center: Vec3, half: f32) -> TriMesh {
    let corner = center + Vec3::new(-half, 0.0, half);
    TriMesh::quad(corner, Vec3::new(2.0 * half, 0.0, 0.0), Vec3::new(0.0, 0.0, -2.0 * half))
}

/// The same triangles without vertex normals.
pub fn flat_shaded(mesh: TriMesh) -> TriMesh {
    TriMesh { normals: Vec::new(), ..mesh }
}

/// The same triangles facing the other way.
pub fn turned_inside_out(mut mesh: TriMesh) -> TriMesh {
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh.normals.iter_mut().for_each(|n| *n = -*n);
    mesh
}

impl TestScene {
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a material's row, without textures.
    pub fn material(&mut self, m: &world::Material) -> u32 {
        let bits = [
            (m.double_sided, flags::DOUBLE_SIDED),
            (m.unlit, flags::UNLIT),
            (matches!(m.alpha_mode, AlphaMode::Mask { .. }), flags::MASK),
            (m.alpha_mode == AlphaMode::Blend, flags::BLEND),
            (m.transmission > 0.0, flags::TRANSMISSION),
            (m.is_solid(), flags::SOLID),
            (m.emissive != Vec3::ZERO, flags::EMISSIVE),
        ];
        let absorption = m.attenuation_color.map(|c| -c.ln() / m.attenuation_distance);
        self.flat.materials.push(MaterialRow {
            flags: bits.iter().filter(|(set, _)| *set).map(|(_, bit)| bit).sum(),
            base_color: m.base_color.to_array(),
            base_alpha: m.base_alpha,
            alpha_cutoff: if let AlphaMode::Mask { cutoff } = m.alpha_mode { cutoff } else { 0.0 },
            metallic: m.metallic,
            roughness: m.roughness,
            emissive: m.emissive.to_array(),
            specular: m.specular,
            specular_color: m.specular_color.to_array(),
            ior: m.ior,
            transmission: m.transmission,
            absorption: absorption.to_array(),
            normal_scale: m.normal_scale,
            base_color_texture: NONE,
            metallic_roughness_texture: NONE,
            normal_texture: NONE,
            emissive_texture: NONE,
            specular_texture: NONE,
            specular_color_texture: NONE,
            transmission_texture: NONE,
            ..MaterialRow::default()
        });
        self.flat.materials.len() as u32 - 1
    }

    /// Adds an image of 8 bits and a slot that looks into it.
    pub fn texture(&mut self, width: u32, texels: Vec<[u8; 4]>, slot: TextureSlot) -> u32 {
        let textures = &mut self.flat.textures;
        let height = texels.len() as u32 / width;
        textures.images.push(Arc::new(FlatImage { width, height, texels: ImageTexels::Rgba8(texels) }));
        let slot =
            TextureSlot { image: textures.images.len() as u32 - 1, transform: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0], ..slot };
        textures.slots.push(slot);
        textures.slots.len() as u32 - 1
    }

    /// Adds an untransformed mesh.
    pub fn mesh(&mut self, mesh: TriMesh, material: &world::Material) -> u32 {
        self.instance(mesh, material, DAffine3::IDENTITY)
    }

    /// Adds a mesh somewhere, and its triangles to the lights if the material emits.
    pub fn instance(&mut self, mesh: TriMesh, material: &world::Material, place: DAffine3) -> u32 {
        mesh.check().unwrap();
        let row = self.material(material);
        let mesh_row = self.flat.meshes.len() as u32;
        let instance = self.flat.instances.len() as u32;
        let rows = |m: DAffine3| {
            let [x, y, z, w] = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis, m.translation];
            let rows: [[f64; 4]; 3] = std::array::from_fn(|i| [x[i], y[i], z[i], w[i]]);
            std::array::from_fn(|i| rows[i / 4][i % 4] as f32)
        };
        let emits = material.emissive != Vec3::ZERO && !material.unlit;
        let light_base = if emits { self.flat.light_rows.len() as u32 } else { NONE };
        self.flat.instances.push(Instance {
            mesh: mesh_row,
            material_base: self.flat.material_rows.len() as u32,
            light_base,
            mirrored: u32::from(place.matrix3.determinant() < 0.0),
            identity: u32::from(place == DAffine3::IDENTITY),
            key: u64::from(instance),
            world_from_local: rows(place),
            local_from_world: rows(place.inverse()),
        });
        self.flat.material_rows.push(row);
        for triangle in 0..mesh.triangles.len() as u32 {
            if emits {
                self.flat.light_rows.push(self.flat.lights.triangles.len() as u32);
                // The reference takes positions from the mesh.
                self.flat.lights.triangles.push(EmissiveTriangle {
                    instance,
                    triangle,
                    radiance: material.emissive.to_array(),
                    two_sided: u32::from(material.double_sided),
                    texture: NONE,
                    ..EmissiveTriangle::default()
                });
            }
        }
        self.flat.meshes.push(Arc::new(FlatMesh {
            positions: mesh.positions.iter().map(|p| p.to_array()).collect(),
            triangles: mesh.triangles,
            normals: mesh.normals.iter().map(|n| n.to_array()).collect(),
            tangents: mesh.tangents.iter().map(|t| t.to_array()).collect(),
            uvs: mesh.uvs.iter().map(|set| set.iter().map(|uv| uv.to_array()).collect()).collect(),
            colors: mesh.colors.iter().map(|c| c.to_array()).collect(),
            slots: mesh.slots,
            slot_count: 1,
            shape: None,
            blas: Arc::default(),
        }));
        instance
    }

    pub fn point_light(&mut self, position: Vec3, candela: f32) {
        self.flat.lights.local.push(LocalLight {
            position: position.to_array(),
            axis: [0.0, -1.0, 0.0],
            intensity: [candela; 3],
            cos_scale: 0.0,
            cos_offset: 1.0,
            key: 0,
        });
    }

    pub fn distant_light(&mut self, to_light: Vec3, lux: f32) {
        let to_light = to_light.normalize().to_array();
        self.flat.lights.distant.push(DistantLight { to_light, illuminance: [lux; 3], key: 0 });
    }

    pub fn sky(&mut self, radiance: f32) {
        self.flat.lights.environment = Some(EnvironmentLight::Constant([radiance; 3]));
    }

    pub fn sky_map(&mut self, width: u32, texels: Vec<[f32; 3]>, rotation: f32) {
        let height = texels.len() as u32 / width;
        let table = EnvironmentTable { width, height, texels, rotation, ..EnvironmentTable::default() };
        self.flat.lights.environment = Some(EnvironmentLight::Map(Arc::new(table)));
    }

    /// Mean radiance, and the standard error of the green channel, along a ray.
    pub fn look(&self, from: Vec3, along: Vec3, settings: &ReferenceSettings) -> (DVec3, f64) {
        let tracer = Tracer::new(&self.flat, settings);
        let mut rng = Rng::new(settings.seed, 0);
        let mut estimate = Estimate::default();
        for _ in 0..settings.spp {
            estimate.add(tracer.radiance(from.as_dvec3(), along.as_dvec3(), 0.0, f64::INFINITY, &mut rng));
        }
        (estimate.mean, estimate.variance().y.sqrt())
    }

    /// Looks along a ray and expects a grey radiance, within four standard errors (two-sided
    /// p < 1e-4; seeds are fixed) and the rounding of the tables to f32.
    #[track_caller]
    pub fn check(&self, from: Vec3, along: Vec3, settings: &ReferenceSettings, want: f64) {
        let (mean, error) = self.look(from, along, settings);
        let tolerance = 4.0 * error + 1e-6 * want.abs();
        assert!(
            (mean - DVec3::splat(want)).abs().max_element() <= tolerance,
            "got {mean}, want {want}, tolerance {tolerance}"
        );
        assert!(error <= 0.01 * want.abs() + 1e-12, "standard error {error} is too large to say anything of {want}");
    }
}

/// `spp` samples of at most `max_depth` scatterings.
pub fn samples(spp: u32, max_depth: impl Into<Option<u32>>) -> ReferenceSettings {
    ReferenceSettings { spp, max_depth: max_depth.into(), seed: 1, ..ReferenceSettings::default() }
}
