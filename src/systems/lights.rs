//! Emitters to light tables, and the probability of choosing each.

use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};
use hecs::World;

use crate::{
    flat::{
        DistantLight, DistantLights, EmissiveShape, EmissiveShapes, EmissiveTriangle, EmissiveTriangles,
        EnvironmentLight, FlatScene, LocalLight, LocalLights, NONE, Textures, flags,
    },
    light::EnvironmentTable,
    sampling::AliasTable,
    world::{
        DirectionalLight, Environment, EnvironmentMap, PointLight, SceneKey, Shape, Sky, SpotLight, WorldTransform,
        WorldVisibility, cofactors,
    },
};

/// The last environment map's table, kept while it is the same picture in the same pose.
#[derive(Default)]
pub struct EnvironmentCache(Option<(Arc<EnvironmentMap>, f32, f32, Arc<EnvironmentTable>)>);

type Placed<'a, T> = (&'a SceneKey, &'a T, Option<&'a WorldTransform>, Option<&'a WorldVisibility>);

/// Visible entities with a `T`, with their transform, in the order of their keys.
fn placed<T: hecs::Component + Clone>(world: &mut World) -> Vec<(SceneKey, T, glam::DAffine3)> {
    let mut rows: Vec<_> = world
        .query_mut::<Placed<T>>()
        .into_iter()
        .filter(|(_, _, _, visibility)| visibility.is_none_or(|v| v.0))
        .map(|(key, component, transform, _)| {
            (*key, component.clone(), transform.map_or(glam::DAffine3::IDENTITY, |t| t.0))
        })
        .collect();
    rows.sort_unstable_by_key(|row| row.0);
    rows
}

/// Where the local −Z axis points in the world.
fn forward(transform: &glam::DAffine3) -> [f32; 3] {
    transform.transform_vector3(DVec3::NEG_Z).normalize_or(DVec3::NEG_Z).as_vec3().to_array()
}

/// Point and spot lights by key.
pub fn local_lights(world: &mut World) -> LocalLights {
    let points = placed::<PointLight>(world).into_iter().map(|(key, light, transform)| LocalLight {
        position: transform.translation.as_vec3().to_array(),
        axis: forward(&transform),
        intensity: (light.color * light.intensity.0).to_array(),
        cos_scale: 0.0,
        cos_offset: 1.0,
        key: key.0,
    });
    let mut rows: Vec<LocalLight> = points.collect();
    rows.extend(placed::<SpotLight>(world).into_iter().map(|(key, light, transform)| {
        // KHR_lights_punctual, "Inner and Outer Cone Angles".
        let (cos_inner, cos_outer) = (light.inner.cos(), light.outer.cos());
        let cos_scale = 1.0 / (cos_inner - cos_outer).max(0.001);
        LocalLight {
            position: transform.translation.as_vec3().to_array(),
            axis: forward(&transform),
            intensity: (light.color * light.intensity.0).to_array(),
            cos_scale,
            cos_offset: -cos_outer * cos_scale,
            key: key.0,
        }
    }));
    rows.sort_unstable_by_key(|row| row.key);
    let mut table = LocalLights::default();
    rows.into_iter().filter(|row| row.intensity != [0.0; 3]).for_each(|row| table.push(row));
    table
}

/// Directional lights by key.
pub fn distant_lights(world: &mut World) -> DistantLights {
    let mut table = DistantLights::default();
    for (key, light, transform) in placed::<DirectionalLight>(world) {
        let illuminance = (light.color * light.illuminance.0).to_array();
        if illuminance != [0.0; 3] {
            table.push(DistantLight { to_light: forward(&transform).map(|x| -x), illuminance, key: key.0 });
        }
    }
    table
}

/// The sky of the environment entity of the lowest key.
pub fn environment(world: &mut World, cache: &mut EnvironmentCache) -> Option<EnvironmentLight> {
    let mut rows: Vec<(SceneKey, Environment)> =
        world.query_mut::<(&SceneKey, &Environment)>().into_iter().map(|(key, sky)| (*key, sky.clone())).collect();
    rows.sort_unstable_by_key(|row| row.0);
    let (_, found) = rows.into_iter().next()?;
    match found.sky {
        Sky::Constant(radiance) => Some(EnvironmentLight::Constant((radiance * found.scale).to_array())),
        Sky::Map(map) => {
            let kept = cache.0.take().filter(|(source, rotation, scale, _)| {
                Arc::ptr_eq(source, &map) && (*rotation, *scale) == (found.rotation_degrees, found.scale)
            });
            let table = kept.map_or_else(
                || Arc::new(EnvironmentTable::new(&map, found.rotation_degrees, found.scale)),
                |(.., table)| table,
            );
            cache.0 = Some((map, found.rotation_degrees, found.scale, Arc::clone(&table)));
            Some(EnvironmentLight::Map(table))
        }
    }
}

/// Emitting triangles of all instances, and the row of each triangle's light.
///
/// Also sets `light_base` of the instances. Rows of shapes are left for [`emissive_shapes`].
pub fn emissive_triangles(flat: &mut FlatScene) -> (EmissiveTriangles, Vec<u32>) {
    let mut table = EmissiveTriangles::default();
    let mut light_rows = Vec::new();
    for instance in 0..flat.instances.len() as u32 {
        let mesh = Arc::clone(&flat.meshes[flat.instances.mesh[instance as usize] as usize]);
        let base = flat.instances.material_base[instance as usize] as usize;
        let rows = &flat.material_rows[base..base + mesh.slot_count as usize];
        let emits = |row: &u32| flat.materials.flags[*row as usize] & flags::EMISSIVE != 0;
        if !rows.iter().any(emits) {
            flat.instances.light_base[instance as usize] = NONE;
            continue;
        }
        flat.instances.light_base[instance as usize] = light_rows.len() as u32;
        if let Some(shape) = mesh.shape {
            light_rows.resize(light_rows.len() + shape.faces(), NONE);
            continue;
        }
        let m = flat.instances.world_from_local[instance as usize].map(f64::from);
        let to_world = |p: [f32; 3]| {
            let p = p.map(f64::from);
            DVec3::from_array(std::array::from_fn(|row| {
                m[row * 4] * p[0] + m[row * 4 + 1] * p[1] + m[row * 4 + 2] * p[2] + m[row * 4 + 3]
            }))
        };
        let flip = if flat.instances.mirrored[instance as usize] == 1 { -1.0 } else { 1.0 };
        for triangle in 0..mesh.triangles.len() as u32 {
            let slot = mesh.slots.get(triangle as usize).copied().unwrap_or(0);
            let material = rows[slot as usize] as usize;
            let [p0, p1, p2] = mesh.corners(triangle).map(to_world);
            let (e1, e2) = (p1 - p0, p2 - p0);
            let normal = e1.cross(e2);
            let area = 0.5 * normal.length();
            let area_f32 = area as f32;
            if !emits(&rows[slot as usize]) || area_f32 == 0.0 || !area_f32.is_finite() {
                light_rows.push(NONE);
                continue;
            }
            light_rows.push(table.len() as u32);
            // Rounding of the columns, of the point made from them, and of the ray's way into local space.
            let size = |row: usize| -> f64 {
                let corner = |p: [f32; 3]| -> f64 {
                    (0..3).map(|axis| (m[row * 4 + axis] * f64::from(p[axis])).abs()).sum::<f64>()
                };
                mesh.corners(triangle).map(corner).into_iter().fold(0.0, f64::max) + m[row * 4 + 3].abs()
            };
            // And of the test against the triangle, which errs by its extent wherever it lies.
            let extent = e1.abs().max(e2.abs()).max_element();
            let error = std::array::from_fn(|row| (8.0 * f64::from(f32::EPSILON) * (size(row) + 2.0 * extent)) as f32);
            table.push(EmissiveTriangle {
                instance,
                triangle,
                p0: p0.as_vec3().to_array(),
                e1: e1.as_vec3().to_array(),
                e2: e2.as_vec3().to_array(),
                n: (flip * normal.normalize()).as_vec3().to_array(),
                area: area_f32,
                error,
                radiance: flat.materials.emissive[material],
                two_sided: u32::from(flat.materials.flags[material] & flags::DOUBLE_SIDED != 0),
                texture: flat.materials.emissive_texture[material],
            });
        }
    }
    (table, light_rows)
}

/// Emitting shapes; sets their rows of [`FlatScene::light_rows`], which [`emissive_triangles`] has made.
pub fn emissive_shapes(flat: &mut FlatScene) -> EmissiveShapes {
    let mut table = EmissiveShapes::default();
    for instance in 0..flat.instances.len() {
        let Some(shape) = flat.meshes[flat.instances.mesh[instance] as usize].shape else { continue };
        let base = flat.instances.light_base[instance];
        let m = flat.instances.world_from_local[instance].map(f64::from);
        let column = |axis: usize| DVec3::new(m[axis], m[axis + 4], m[axis + 8]);
        let linear = DMat3::from_cols(column(0), column(1), column(2));
        let (area, world_area) = (shape.area() as f32, shape.area_under(linear) as f32);
        if base == NONE || !area.is_normal() || !world_area.is_normal() {
            continue;
        }
        let row = flat.lights.shape_row(table.len());
        flat.light_rows[base as usize..base as usize + shape.faces()].fill(row);
        let cofactors = cofactors(linear) * linear.determinant().signum();
        let material = flat.material_rows[flat.instances.material_base[instance] as usize] as usize;
        // Rounding of a point, and of the ray's way into local space.
        let (_, most) = flat.meshes[flat.instances.mesh[instance] as usize].blas.bounds();
        let size = |row: usize| {
            (0..3).map(|axis| (m[row * 4 + axis] * f64::from(most[axis])).abs()).sum::<f64>() + m[row * 4 + 3].abs()
        };
        table.push(EmissiveShape {
            instance: instance as u32,
            area,
            world_area,
            cofactors: std::array::from_fn(|i| cofactors.col(i % 3)[i / 3] as f32),
            error: std::array::from_fn(|row| (8.0 * f64::from(f32::EPSILON) * size(row)) as f32),
            radiance: flat.materials.emissive[material],
            two_sided: u32::from(flat.materials.flags[material] & flags::DOUBLE_SIDED != 0),
            texture: flat.materials.emissive_texture[material],
        });
    }
    table
}

/// True if a plane shines, of which no point can be drawn.
pub fn any_unsampled(flat: &FlatScene) -> bool {
    (0..flat.instances.len()).any(|instance| {
        let mesh = &flat.meshes[flat.instances.mesh[instance] as usize];
        mesh.shape == Some(Shape::Plane) && flat.instances.light_base[instance] != NONE
    })
}

/// Probability of each light by its power.
pub fn choice(flat: &FlatScene) -> AliasTable {
    let pi = std::f64::consts::PI;
    let luminance =
        |c: [f32; 3]| 0.212_671 * f64::from(c[0]) + 0.715_160 * f64::from(c[1]) + 0.072_169 * f64::from(c[2]);
    let lights = &flat.lights;
    let radius = if flat.radius > 0.0 { flat.radius } else { 1.0 };
    let disc = pi * f64::from(radius) * f64::from(radius);
    let mut power = Vec::with_capacity(lights.environment_row() as usize + 1);
    for row in 0..lights.triangles.len() {
        let triangle = lights.triangles.row(row);
        let sides = f64::from(1 + triangle.two_sided);
        let texture = if triangle.texture == NONE { [1.0; 3] } else { mean_texture(flat, &triangle) };
        let radiance: [f32; 3] = std::array::from_fn(|i| triangle.radiance[i] * texture[i]);
        power.push(pi * sides * f64::from(triangle.area) * luminance(radiance));
    }
    for row in 0..lights.local.len() {
        let light = lights.local.row(row);
        // A cone's share of the sphere; the soft edge is counted whole.
        let cos_outer = if light.cos_scale == 0.0 { -1.0 } else { -light.cos_offset / light.cos_scale };
        power.push(2.0 * pi * (1.0 - f64::from(cos_outer)).max(1e-6) * luminance(light.intensity));
    }
    power.extend(lights.distant.illuminance.iter().map(|&lux| disc * luminance(lux)));
    for row in 0..lights.shapes.len() {
        let light = lights.shapes.row(row);
        let texture = if light.texture == NONE { [1.0; 3] } else { mean_texture_of_shape(flat, &light) };
        let radiance: [f32; 3] = std::array::from_fn(|i| light.radiance[i] * texture[i]);
        power.push(pi * f64::from(1 + light.two_sided) * f64::from(light.world_area) * luminance(radiance));
    }
    if let Some(EnvironmentLight::Map(map)) = &lights.environment {
        power.push(f64::from(map.power(radius)));
    }
    let most = power.iter().copied().fold(0.0, f64::max);
    let scale = if most > 0.0 { 1.0 / most } else { 0.0 };
    AliasTable::new(&power.iter().map(|&p| (p * scale) as f32).collect::<Vec<_>>())
}

/// The mean of the texture over a triangle, by a grid of points about as fine as its texels.
///
/// Where it is zero the triangle is not chosen; scattered rays still find its light.
fn mean_texture(flat: &FlatScene, light: &EmissiveTriangle) -> [f32; 3] {
    let mesh = &flat.meshes[flat.instances.mesh[light.instance as usize] as usize];
    let textures: &Textures = &flat.textures;
    let set = textures.slots.tex_coord[light.texture as usize] as usize;
    let image = &textures.images[textures.slots.image[light.texture as usize] as usize];
    let Some(uvs) = mesh.uvs.get(set).filter(|uvs| !uvs.is_empty()) else {
        let [r, g, b, _] = textures.sample(light.texture, [0.0; 2]);
        return [r, g, b];
    };
    let [a, b, c] =
        mesh.triangles[light.triangle as usize].map(|vertex| Vec3::from((glam::Vec2::from(uvs[vertex as usize]), 0.0)));
    let texels = 0.5 * (b - a).cross(c - a).length() * image.width as f32 * image.height as f32;
    let steps = texels.sqrt().ceil().clamp(2.0, 24.0) as u32;
    let mut sum = Vec3::ZERO;
    let mut count = 0.0;
    for i in 0..steps {
        for j in 0..steps - i {
            let (b1, b2) = ((i as f32 + 1.0 / 3.0) / steps as f32, (j as f32 + 1.0 / 3.0) / steps as f32);
            let uv = a + (b - a) * b1 + (c - a) * b2;
            let [r, g, b, _] = textures.sample(light.texture, [uv.x, uv.y]);
            sum += Vec3::new(r, g, b);
            count += 1.0;
        }
    }
    (sum / count).to_array()
}

/// The mean of the texture over a shape, by a grid of points that are as many wherever its area is the same.
fn mean_texture_of_shape(flat: &FlatScene, light: &EmissiveShape) -> [f32; 3] {
    const STEPS: u32 = 64;
    let Some(shape) = flat.meshes[flat.instances.mesh[light.instance as usize] as usize].shape else { return [0.0; 3] };
    let places = (0..STEPS * STEPS).map(|i| [i % STEPS, i / STEPS].map(|i| (i as f32 + 0.5) / STEPS as f32));
    let texels = places.map(|[u0, u1]| {
        let [r, g, b, _] = flat.textures.sample(light.texture, shape.uv(shape.sample((u0, u1))));
        Vec3::new(r, g, b)
    });
    (texels.sum::<Vec3>() / (STEPS * STEPS) as f32).to_array()
}
