//! What is where a ray hits: material, normals, emission, and where rays leave from.

use glam::{DMat3, DVec2, DVec3, DVec4};

use super::{
    bsdf::Surface,
    geometry::{Hit, Triangle, transforms},
    shapes::Placed,
    texture::look_up,
};
use crate::flat::{FlatMesh, FlatScene, MaterialRow, NONE, flags};

/// A triangle of the tables with the barycentrics of a point on it.
pub struct Place<'a> {
    scene: &'a FlatScene,
    mesh: &'a FlatMesh,
    triangle: Triangle,
    weights: [f64; 3],
    /// On a shape: it, and the point in its space.
    on_shape: Option<(Placed, DVec3)>,
    /// Row of the material.
    pub material_row: u32,
    /// That row.
    pub material: MaterialRow,
    /// Unit normal of the front side.
    pub front: DVec3,
}

/// All that scattering needs to know of a hit.
pub struct ShadingPoint {
    /// m.
    pub p: DVec3,
    /// Where reflected rays start; differs from `p` by the terminator lift if there is any.
    pub p_lifted: DVec3,
    /// Geometric normal on the side of `wo`.
    pub ng: DVec3,
    /// Axes of the shading frame as columns; the third is the shading normal.
    pub frame: DMat3,
    /// As textured.
    pub surface: Surface,
}

fn vec3(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

impl<'a> Place<'a> {
    /// Where `hit` is on `triangle`.
    pub fn new(scene: &'a FlatScene, triangle: &Triangle, hit: &Hit) -> Self {
        let instance = triangle.instance as usize;
        let material_row = scene.material_of(triangle.instance, triangle.triangle);
        let orientation = if scene.instances.mirrored[instance] == 1 { -1.0 } else { 1.0 };
        Self {
            scene,
            mesh: &scene.meshes[scene.instances.mesh[instance] as usize],
            triangle: *triangle,
            weights: [1.0 - hit.b1 - hit.b2, hit.b1, hit.b2],
            on_shape: None,
            material_row,
            material: scene.materials.row(material_row as usize),
            front: orientation * triangle.cross().normalize(),
        }
    }

    /// A local point of a shape.
    pub fn on_shape(scene: &'a FlatScene, shape: &Placed, p: DVec3) -> Self {
        let at_first_corner = Hit { t: 0.0, b1: 0.0, b2: 0.0, index: 0 };
        Self { on_shape: Some((*shape, p)), ..Self::new(scene, &shape.facet(p), &at_first_corner) }
    }

    fn has(&self, flag: u32) -> bool {
        self.material.flags & flag != 0
    }

    /// Values of the three corners.
    fn corners<T: Copy>(&self, column: &[T]) -> Option<[T; 3]> {
        (!column.is_empty())
            .then(|| self.mesh.triangles[self.triangle.triangle as usize].map(|row| column[row as usize]))
    }

    /// Interpolates a column of the mesh; `None` if the mesh does not have it.
    fn interpolate<const N: usize>(&self, column: &[[f32; N]]) -> Option<[f64; N]> {
        let corners = self.corners(column)?;
        Some(std::array::from_fn(|i| (0..3).map(|corner| self.weights[corner] * f64::from(corners[corner][i])).sum()))
    }

    /// A texture's value here, white without one.
    fn texture(&self, slot: u32) -> DVec4 {
        if slot == NONE {
            return DVec4::ONE;
        }
        let set = self.scene.textures.slots.tex_coord[slot as usize] as usize;
        let of_mesh = || self.mesh.uvs.get(set).and_then(|uvs| self.interpolate(uvs)).unwrap_or([0.0; 2]);
        let uv = self.on_shape.map_or_else(|| DVec2::from_array(of_mesh()), |(shape, p)| shape.uv(p));
        look_up(self.scene, slot, uv)
    }

    /// Base colour and coverage.
    fn base(&self) -> DVec4 {
        let color = self.interpolate(&self.mesh.colors).map_or(DVec4::ONE, DVec4::from_array);
        let factor = vec3(self.material.base_color).extend(f64::from(self.material.base_alpha));
        factor * self.texture(self.material.base_color_texture) * color
    }

    /// Whether a ray along `direction` meets anything here; `u` is uniform in [0, 1).
    pub fn is_met(&self, direction: DVec3, u: impl FnOnce() -> f64) -> bool {
        let has_back = self.has(flags::DOUBLE_SIDED | flags::TRANSMISSION);
        if !has_back && direction.dot(self.front) >= 0.0 {
            return false;
        }
        if self.has(flags::MASK) {
            self.base().w >= f64::from(self.material.alpha_cutoff)
        } else if self.has(flags::BLEND) {
            u() < self.base().w
        } else {
            true
        }
    }

    /// Whether a solid's boundary is met from its inside.
    pub fn is_back_of_solid(&self, wo: DVec3) -> bool {
        self.has(flags::SOLID) && wo.dot(self.front) < 0.0
    }

    /// Whether light that passes here enters or leaves a solid.
    pub fn is_solid(&self) -> bool {
        self.has(flags::SOLID)
    }

    /// Whether nothing is scattered here.
    pub fn is_unlit(&self) -> bool {
        self.has(flags::UNLIT)
    }

    /// Radiance emitted along `wo`, nit.
    pub fn emission(&self, wo: DVec3) -> DVec3 {
        let from_front = wo.dot(self.front) > 0.0;
        if self.is_unlit() {
            let seen = from_front || self.has(flags::DOUBLE_SIDED);
            return if seen { self.base().truncate() } else { DVec3::ZERO };
        }
        if self.on_shape.is_some() {
            let shines = self.has(flags::EMISSIVE) && (from_front || self.has(flags::DOUBLE_SIDED));
            let radiance = vec3(self.material.emissive) * self.texture(self.material.emissive_texture).truncate();
            return if shines { radiance } else { DVec3::ZERO };
        }
        let row = self.scene.light_of(self.triangle.instance, self.triangle.triangle);
        if row == NONE {
            return DVec3::ZERO;
        }
        let light = self.scene.lights.triangles.row(row as usize);
        if from_front || light.two_sided == 1 {
            vec3(light.radiance) * self.texture(light.texture).truncate()
        } else {
            DVec3::ZERO
        }
    }

    /// The surface as seen along `wo`; `least_lift`, m, is the smallest terminator lift that counts, infinite for none.
    pub fn shading(&self, wo: DVec3, least_lift: f64) -> ShadingPoint {
        let m = &self.material;
        let metallic_roughness = self.texture(m.metallic_roughness_texture);
        let surface = Surface {
            base_color: self.base().truncate(),
            metallic: f64::from(m.metallic) * metallic_roughness.z,
            roughness: f64::from(m.roughness) * metallic_roughness.y,
            specular: f64::from(m.specular) * self.texture(m.specular_texture).w,
            specular_color: vec3(m.specular_color) * self.texture(m.specular_color_texture).truncate(),
            ior: f64::from(m.ior),
            transmission: if self.has(flags::TRANSMISSION) {
                f64::from(m.transmission) * self.texture(m.transmission_texture).x
            } else {
                0.0
            },
            solid: self.has(flags::SOLID),
            inside: wo.dot(self.front) < 0.0,
        };
        let side = if surface.inside { -1.0 } else { 1.0 };
        let ng = side * self.front;
        let ns = valid_normal(wo, self.shading_normal(ng, side), ng);
        let p = self.triangle.point(self.weights[1], self.weights[2]);
        let lift = self.lift(p, ng, side);
        let p_lifted = if lift.dot(ng) > least_lift { p + lift } else { p };
        let tangent = ns.any_orthonormal_vector();
        ShadingPoint { p, p_lifted, ng, frame: DMat3::from_cols(tangent, ns.cross(tangent), ns), surface }
    }

    /// The interpolated normal, bent by the normal map, on the side of `ng`.
    fn shading_normal(&self, ng: DVec3, side: f64) -> DVec3 {
        let (world_from_local, normal_from_local) = transforms(self.scene, self.triangle.instance);
        let vertex_normal = self
            .interpolate(&self.mesh.normals)
            .and_then(|n| (normal_from_local * DVec3::from_array(n)).try_normalize())
            .unwrap_or(self.front);
        let ns = side * self.mapped(vertex_normal, world_from_local.matrix3).unwrap_or(vertex_normal);
        if ns.dot(ng) < 0.0 { -ns } else { ns }
    }

    fn mapped(&self, n: DVec3, world_from_local: DMat3) -> Option<DVec3> {
        if self.material.normal_texture == NONE {
            return None;
        }
        let of_shape = self.on_shape.map(|(shape, p)| shape.tangent(p));
        let [x, y, z, w] = of_shape.or_else(|| self.interpolate(&self.mesh.tangents))?;
        let tangent = world_from_local * DVec3::new(x, y, z);
        let tangent = (tangent - tangent.dot(n) * n).try_normalize()?;
        let handedness = w.signum() * if world_from_local.determinant() < 0.0 { -1.0 } else { 1.0 };
        let bitangent = handedness * n.cross(tangent);
        let texel = 2.0 * self.texture(self.material.normal_texture).truncate() - 1.0;
        let scale = f64::from(self.material.normal_scale);
        (scale * texel.x * tangent + scale * texel.y * bitangent + texel.z * n).try_normalize()
    }

    /// From `p` to where the smooth surface may be (Hanika 2021, "Hacking the Shadow Terminator").
    fn lift(&self, p: DVec3, ng: DVec3, side: f64) -> DVec3 {
        let Some(normals) = self.corners(&self.mesh.normals) else { return DVec3::ZERO };
        let (_, normal_from_local) = transforms(self.scene, self.triangle.instance);
        let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)].map(|(b1, b2)| self.triangle.point(b1, b2));
        let mut lift = DVec3::ZERO;
        for corner in 0..3 {
            let n = side * (normal_from_local * vec3(normals[corner])).normalize_or_zero();
            if n.dot(ng) > 0.0 {
                lift += self.weights[corner] * (corners[corner] - p).dot(n).max(0.0) * n;
            }
        }
        lift
    }
}

/// `ns`, on the side of `ng`, bent if the mirror direction of `wo` would go below the surface
/// (Keller et al. 2017, "The Iray Light Transport Simulation and Rendering System", A.3).
pub fn valid_normal(wo: DVec3, ns: DVec3, ng: DVec3) -> DVec3 {
    let r = 2.0 * ns.dot(wo) * ns - wo;
    let least = (0.1 * wo.dot(ng)).min(0.01);
    if r.dot(ng) >= least {
        return ns;
    }
    let r = (r + (least - r.dot(ng)) * ng).normalize();
    (wo + r).normalize()
}
