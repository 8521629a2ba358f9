//! Emitters to light tables, and the probability of choosing each.

use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};
use hecs::World;
use rayon::prelude::*;

use crate::{
    flat::{
        DistantLight, DistantLights, EmissiveShape, EmissiveShapes, EmissiveTriangle, EmissiveTriangles,
        EnvironmentLight, FlatScene, LocalLight, LocalLights, NONE, Textures, flags,
    },
    light::{Emitter, EnvironmentTable, LightChoice},
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
                four: 0,
                radiance: flat.materials.emissive[material],
                two_sided: u32::from(flat.materials.flags[material] & flags::DOUBLE_SIDED != 0),
                texture: flat.materials.emissive_texture[material],
            });
            let last = table.len() - 1;
            if last > 0
                && slot == mesh.slots.get(triangle as usize - 1).copied().unwrap_or(0)
                && let Some(both) = parallelogram(&table.row(last - 1), &table.row(last))
            {
                table.resize(last);
                table.set(last - 1, both);
                light_rows.pop();
                light_rows.push(last as u32 - 1);
            }
        }
    }
    (table, light_rows)
}

/// Two triangles of a mesh and a material, one right after the other, as one light, if they have no texture and lie beside each
/// other as the halves of a parallelogram.
///
/// Of quads nearly all are written like that, and one light of four corners is drawn from more evenly than two of three.
fn parallelogram(first: &EmissiveTriangle, second: &EmissiveTriangle) -> Option<EmissiveTriangle> {
    if first.four == 1
        || first.texture != NONE
        || first.instance != second.instance
        || first.triangle + 1 != second.triangle
    {
        return None;
    }
    let corners = |light: &EmissiveTriangle| {
        let [p, e1, e2] = [light.p0, light.e1, light.e2].map(Vec3::from);
        [p, p + e1, p + e2]
    };
    let (ours, theirs) = (corners(first), corners(second));
    // What is not told apart by the rounding that the light's own error counts in.
    let near = |a: Vec3, b: Vec3| (a - b).abs().cmple(0.5 * Vec3::from(first.error)).all();
    // The corner of each that is not the other's.
    let own = (0..3).find(|&i| !theirs.iter().any(|&corner| near(corner, ours[i])))?;
    let other = (0..3).find(|&i| !ours.iter().any(|&corner| near(corner, theirs[i])))?;
    let [p, q, r] = [ours[own], ours[(own + 1) % 3], ours[(own + 2) % 3]];
    let whole = near(q + r - p, theirs[other]) && near(q, theirs[(other + 2) % 3]) && near(r, theirs[(other + 1) % 3]);
    whole.then(|| EmissiveTriangle {
        p0: p.to_array(),
        e1: (q - p).to_array(),
        e2: (r - p).to_array(),
        area: 2.0 * first.area,
        error: first.error.map(|error| 1.5 * error),
        four: 1,
        ..*first
    })
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

fn luminance(c: [f32; 3]) -> f32 {
    0.212_671 * c[0] + 0.715_160 * c[1] + 0.072_169 * c[2]
}

/// What each light may bring to where.
pub fn choice(flat: &FlatScene) -> LightChoice {
    let lights = &flat.lights;
    let shaded = |radiance: [f32; 3], texture: [f32; 3]| luminance(std::array::from_fn(|i| radiance[i] * texture[i]));
    let triangles = (0..lights.triangles.len()).into_par_iter().map(|row| {
        let light = lights.triangles.row(row);
        let texture = if light.texture == NONE { [1.0; 3] } else { mean_texture(flat, &light) };
        let [p, e1, e2] = [light.p0, light.e1, light.e2].map(Vec3::from);
        let corners = [p, p + e1, p + e2, if light.four == 1 { p + e1 + e2 } else { p }];
        Emitter {
            lower: corners.into_iter().fold(p, Vec3::min),
            upper: corners.into_iter().fold(p, Vec3::max),
            middle: if light.four == 1 { p + 0.5 * (e1 + e2) } else { p + (e1 + e2) * (1.0 / 3.0) },
            // Of a triangle less by what its edges have in common.
            spread2: if light.four == 1 {
                (e1.length_squared() + e2.length_squared()) / 12.0
            } else {
                (e1.length_squared() + e2.length_squared() - e1.dot(e2)) / 18.0
            },
            axis: light.n.into(),
            cos_cone: 1.0,
            cos_edge: 0.0,
            two_sided: light.two_sided == 1,
            intensity: light.area * shaded(light.radiance, texture),
        }
    });
    let mut near: Vec<Emitter> = triangles.collect();
    for row in 0..lights.local.len() {
        let light = lights.local.row(row);
        let position = Vec3::from(light.position);
        // A soft edge is counted whole.
        let all_around = light.cos_scale == 0.0;
        let cos_outer = if all_around { -1.0 } else { -light.cos_offset / light.cos_scale };
        near.push(Emitter {
            lower: position,
            upper: position,
            middle: position,
            spread2: 0.0,
            axis: light.axis.into(),
            cos_cone: cos_outer,
            cos_edge: 1.0,
            two_sided: false,
            intensity: luminance(light.intensity),
        });
    }
    for row in 0..lights.shapes.len() {
        let light = lights.shapes.row(row);
        let texture = if light.texture == NONE { [1.0; 3] } else { mean_texture_of_shape(flat, &light) };
        let m = &flat.instances.world_from_local[light.instance as usize];
        let mesh = &flat.meshes[flat.instances.mesh[light.instance as usize] as usize];
        let (least, most) = mesh.blas.bounds();
        let row_of = |i: usize| Vec3::new(m[4 * i], m[4 * i + 1], m[4 * i + 2]);
        let (middle, half) =
            (0.5 * (Vec3::from(least) + Vec3::from(most)), 0.5 * (Vec3::from(most) - Vec3::from(least)));
        let center = Vec3::from_array([0, 1, 2].map(|i| row_of(i).dot(middle) + m[4 * i + 3]));
        let reach = Vec3::from_array([0, 1, 2].map(|i| row_of(i).abs().dot(half)));
        let scale2 = [0, 1, 2].map(|axis| [0, 1, 2].map(|i| m[4 * i + axis].powi(2)).iter().sum::<f32>());
        let mean2 = mesh.shape.map_or([0.0; 3], |shape| shape.mean_squares());
        let is_disc = matches!(mesh.shape, Some(Shape::Disc { .. }));
        let normal = Vec3::from_array([0, 1, 2].map(|i| light.cofactors[3 * i + 1]));
        near.push(Emitter {
            lower: center - reach,
            upper: center + reach,
            middle: center,
            spread2: (0..3).map(|axis| mean2[axis] * scale2[axis]).sum(),
            axis: normal.normalize_or(Vec3::Y),
            cos_cone: if is_disc { 1.0 } else { -1.0 },
            cos_edge: 0.0,
            two_sided: is_disc && light.two_sided == 1,
            intensity: light.world_area * shaded(light.radiance, texture),
        });
    }
    let distant = (0..lights.distant.len()).map(|row| lights.distant.row(row));
    let far = distant.map(|light| (light.to_light, luminance(light.illuminance)));
    let sky = match &lights.environment {
        Some(EnvironmentLight::Map(map)) => map.mean_illuminance(),
        _ => 0.0,
    };
    LightChoice::new(&near, far, sky)
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
