//! Light sampling: which light, and from where on it. A kernel for eight lanes or one.

use glam::DVec3;

use crate::{
    accel::Hit,
    flat::{EnvironmentLight, FlatScene, NONE},
    sampling::lengthen,
    simd::{Mask, Real, Rgb, V3},
};

use super::{dimensions::mix, surface::Surface};

/// Light that may arrive at a surface, before what is in the way.
#[derive(Clone, Copy, Debug)]
pub struct LightSample<F: Real> {
    /// Unit direction towards the light.
    pub wi: V3<F>,
    /// The point that the shadow ray ends at, or, for a light infinitely far away, its direction.
    pub target: V3<F>,
    /// `target` is a point.
    pub near: F::Mask,
    /// Radiance over the density of the sample, choice of light included, nit·sr.
    pub light: Rgb<F>,
    /// Density per sr with which the direction was drawn; 0 where no scattered ray can find the light.
    pub pdf: F,
    /// Something may arrive.
    pub valid: F::Mask,
}

/// What was chosen for one lane.
#[derive(Clone, Copy, Default)]
struct Picked {
    target: [f32; 3],
    error: [f32; 3],
    normal: [f32; 3],
    radiance: [f32; 3],
    /// Area for a triangle, one over the density by area for a shape, density for the sky.
    measure: f32,
    pmf: f32,
}

/// Row bits of the kinds among the lanes.
#[derive(Clone, Copy, Default)]
struct Kinds {
    triangle: u32,
    two_sided: u32,
    local: u32,
    distant: u32,
    sky: u32,
}

/// Draws a light by its power for each lane, and a point on it.
///
/// `u_choice` chooses; `u` are two numbers for the place. `lookups` counts texture and environment look-ups.
#[inline(always)]
pub fn sample<F: Real>(
    scene: &FlatScene,
    surface: &Surface<F>,
    active: u32,
    u_choice: F,
    u: (F, F),
    lookups: &mut [u64; 2],
) -> LightSample<F> {
    let lights = &scene.lights;
    let (first_local, first_distant) = (lights.first_local(), lights.first_distant());
    let (first_shape, sky_row) = (lights.first_shape(), lights.environment_row());
    let mut kinds = Kinds::default();
    let mut picked = [Picked::default(); 8];
    let (b1, b2) = crate::sampling::warp::triangle(u);
    for (lane, one) in picked.iter_mut().enumerate().take(F::LANES) {
        if active >> lane & 1 == 0 {
            continue;
        }
        // Many lights, and then a sky of many texels, need more bits than a sample has.
        let choice = u_choice.lane(lane);
        let (row, rest) = lights.choice.sample(lengthen(choice, mix(choice.to_bits() ^ u.0.lane(lane).to_bits())));
        let pmf = lights.choice.pmf(row);
        let bit = 1 << lane;
        one.pmf = pmf;
        if row < first_local {
            let (triangles, row) = (&lights.triangles, row as usize);
            let (b1, b2) = (b1.lane(lane), b2.lane(lane));
            kinds.triangle |= bit;
            kinds.two_sided |= triangles.two_sided[row] << lane;
            let (p0, e1, e2) = (&triangles.p0[row], &triangles.e1[row], &triangles.e2[row]);
            one.target = std::array::from_fn(|i| p0[i] + b1 * e1[i] + b2 * e2[i]);
            one.error = triangles.error[row];
            one.normal = triangles.n[row];
            one.measure = triangles.area[row];
            one.radiance = triangles.radiance[row];
            let texture = triangles.texture[row];
            if texture != NONE {
                lookups[0] += 1;
                let mesh = &scene.meshes[scene.instances.mesh[triangles.instance[row] as usize] as usize];
                let vertices = mesh.triangles[triangles.triangle[row] as usize];
                let set = scene.textures.slots.tex_coord[texture as usize];
                let texel = scene.textures.sample(texture, mesh.uv_at(set, vertices, b1, b2));
                (0..3).for_each(|i| one.radiance[i] *= texel[i]);
            }
        } else if row < first_distant {
            let light = lights.local.row((row - first_local) as usize);
            kinds.local |= bit;
            one.target = light.position;
            one.radiance = light.intensity;
            one.normal = light.axis;
            one.error = [light.cos_scale, light.cos_offset, 0.0];
        } else if row < first_shape {
            let light = lights.distant.row((row - first_distant) as usize);
            kinds.distant |= bit;
            one.target = light.to_light;
            one.radiance = light.illuminance;
        } else if row < sky_row {
            // What follows of a triangle holds of any piece of surface.
            let row = (row - first_shape) as usize;
            kinds.triangle |= bit;
            kinds.two_sided |= lights.shapes.two_sided[row] << lane;
            *one = Picked { pmf, ..on_shape(scene, row, (u.0.lane(lane), u.1.lane(lane)), &mut lookups[0]) };
        } else if let Some(EnvironmentLight::Map(map)) = &lights.environment {
            lookups[1] += 1;
            kinds.sky |= bit;
            let (direction, pdf, radiance) = map.sample(rest, (u.0.lane(lane), u.1.lane(lane)));
            one.target = direction;
            one.measure = pdf;
            one.radiance = radiance;
        }
    }
    let target = V3::from_fn(|lane| picked[lane].target);
    let radiance: Rgb<F> = V3::from_fn(|lane| picked[lane].radiance);
    let pmf = F::from_fn(|lane| picked[lane].pmf);
    let mask = |bits: u32| F::Mask::from_bits(bits);
    let near = mask(kinds.triangle | kinds.local);

    let mut wi = target;
    let mut end = target;
    let mut light = radiance * (F::one() / pmf.max(F::splat(f32::MIN_POSITIVE)));
    let mut pdf = F::zero();
    let mut valid = mask(kinds.distant | kinds.sky) & pmf.gt(F::zero());
    if (kinds.triangle | kinds.local) != 0 {
        // Reflected rays start at the lifted point, those through the surface at the point itself.
        let in_front = (target - surface.lifted).dot(surface.frame.n).gt(F::zero());
        let from = V3::select(in_front, surface.lifted, surface.p);
        // What lies between the two planes is in front of the point alone: no ray reaches it, as scattered ones leave
        // from the lifted point too.
        let behind = (target - surface.p).dot(surface.frame.n).lt(F::zero());
        let to_light = target - from;
        let distance2 = to_light.length_squared();
        let apart = distance2.gt(F::splat(f32::MIN_POSITIVE)) & (in_front | behind);
        let distance2 = F::select(apart, distance2, F::one());
        let direction = to_light * (F::one() / distance2.sqrt());
        wi = V3::select(near, direction, wi);
        let normal: V3<F> = V3::from_fn(|lane| picked[lane].normal);
        let cos = -direction.dot(normal);
        if kinds.triangle != 0 {
            let is_triangle = mask(kinds.triangle);
            let faces = cos.gt(F::zero()) | (mask(kinds.two_sided) & cos.lt(F::zero()));
            let area = F::from_fn(|lane| picked[lane].measure);
            // Where the light is seen edge-on the weight runs to zero with the cosine.
            let solid_angle = area * cos.abs() / distance2;
            let seen = is_triangle & faces & apart & solid_angle.gt(F::splat(1e-30));
            pdf = F::select(seen, pmf / F::select(seen, solid_angle, F::one()), pdf);
            light = V3::select(is_triangle, light * solid_angle, light);
            valid = valid | seen;
            // The end of the ray is moved off the light towards the surface by the light's own error.
            let error: V3<F> = V3::from_fn(|lane| picked[lane].error);
            let shift = normal.abs().dot(error).copysign(cos);
            end = V3::select(is_triangle, normal.scale_add(shift, end), end);
        }
        if kinds.local != 0 {
            let is_local = mask(kinds.local);
            let scale = F::from_fn(|lane| picked[lane].error[0]);
            let offset = F::from_fn(|lane| picked[lane].error[1]);
            let falloff = cos.mul_add(scale, offset).saturate().sqr();
            light = V3::select(is_local, light * (falloff / distance2), light);
            valid = valid | (is_local & apart & falloff.gt(F::zero()));
        }
    }
    if kinds.sky != 0 {
        let density = F::from_fn(|lane| picked[lane].measure);
        let is_sky = mask(kinds.sky);
        let seen = is_sky & density.gt(F::zero());
        light = V3::select(is_sky, light * (F::one() / F::select(seen, density, F::one())).masked(seen), light);
        pdf = F::select(is_sky, density * pmf, pdf);
        valid = (valid & !is_sky) | seen;
    }
    LightSample { wi, target: end, near, light, pdf, valid }
}

/// A point on a shape that shines.
#[cold]
fn on_shape(scene: &FlatScene, row: usize, u: (f32, f32), lookups: &mut u64) -> Picked {
    let light = scene.lights.shapes.row(row);
    let instance = light.instance as usize;
    let Some(shape) = scene.meshes[scene.instances.mesh[instance] as usize].shape else { return Picked::default() };
    let local = shape.sample(u);
    let m = scene.instances.world_from_local[instance].map(f64::from);
    let along = |row: usize| DVec3::new(m[row * 4], m[row * 4 + 1], m[row * 4 + 2]).dot(local) + m[row * 4 + 3];
    let mut radiance = light.radiance;
    if light.texture != NONE {
        *lookups += 1;
        let texel = scene.textures.sample(light.texture, shape.uv(local));
        (0..3).for_each(|i| radiance[i] *= texel[i]);
    }
    let piece = piece(&light.cofactors, shape.normal(local));
    let stretch = piece.length();
    Picked {
        target: [0, 1, 2].map(|row| along(row) as f32),
        error: light.error,
        normal: (piece / stretch).as_vec3().to_array(),
        radiance,
        measure: (f64::from(light.area) * stretch) as f32,
        pmf: 0.0,
    }
}

/// The normal in the world, as long as a piece of a shape gets larger on its way there.
fn piece(cofactors: &[f32; 9], normal: DVec3) -> DVec3 {
    let row = |i: usize| DVec3::from_array([0, 1, 2].map(|k| f64::from(cofactors[3 * i + k]))).dot(normal);
    DVec3::new(row(0), row(1), row(2))
}

/// As [`triangle_pdf`], of a shape.
#[cold]
pub fn shape_pdf(scene: &FlatScene, light_row: u32, hit: &Hit, direction: [f32; 3]) -> f32 {
    let lights = &scene.lights;
    let shape_row = light_row - lights.shape_row(0);
    let light = lights.shapes.row(shape_row as usize);
    let Some(shape) = scene.meshes[scene.instances.mesh[hit.instance as usize] as usize].shape else { return 0.0 };
    let normal = shape.normal(shape.point(hit.triangle, hit.b1, hit.b2));
    let facing = piece(&light.cofactors, normal).dot(DVec3::from_array(direction.map(f64::from)));
    let solid_angle = (f64::from(light.area) * facing.abs()) as f32 / (hit.t * hit.t);
    if solid_angle > 1e-30 { lights.choice.pmf(lights.first_shape() + shape_row) / solid_angle } else { 0.0 }
}

/// Density per sr with which [`sample`] draws the direction of a ray of unit direction that met an
/// emitting triangle at distance `t`, as seen from the ray's origin.
#[inline]
pub fn triangle_pdf(scene: &FlatScene, light_row: u32, t: f32, cos: f32) -> f32 {
    let lights = &scene.lights;
    let solid_angle = lights.triangles.area[light_row as usize] * cos.abs() / (t * t);
    if solid_angle > 1e-30 { lights.choice.pmf(light_row) / solid_angle } else { 0.0 }
}
