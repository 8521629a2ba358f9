//! Light sampling: which light, and from where on it. A kernel for eight lanes or one.

use glam::{DMat3, DVec3};

use crate::{
    accel::Hit,
    flat::{EnvironmentLight, FlatScene, NONE},
    light::{Chosen, Density, Facets, Receiver, pack},
    sampling::lengthen,
    simd::{LANES, Mask, Real, Rgb, V3},
    world::Shape,
};

use super::{Settings, dimensions::mix, surface::Surface};

/// Light that may arrive at a surface, before what is in the way.
#[derive(Clone, Copy, Debug)]
pub struct LightSample<F: Real> {
    /// Where the ray leaves the surface, m.
    pub origin: V3<F>,
    /// It leaves on the side of the surface that the path came from.
    pub up: F::Mask,
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
    /// Lanes in which it is the sky.
    pub sky: u32,
}

/// What was chosen for one lane.
#[derive(Clone, Copy, Default)]
struct Picked {
    /// The point, or the first corner of a flat light.
    target: [f32; 3],
    e1: [f32; 3],
    e2: [f32; 3],
    error: [f32; 3],
    normal: [f32; 3],
    radiance: [f32; 3],
    /// Area of a flat light, one over the density by area of a shape or that by solid angle, density for the sky.
    measure: f32,
    pmf: f32,
    /// Row of a flat light with a texture.
    textured: u32,
}

/// As [`Picked`], of all lanes.
struct Columns<F: Real> {
    target: V3<F>,
    e1: V3<F>,
    e2: V3<F>,
    error: V3<F>,
    normal: V3<F>,
    radiance: Rgb<F>,
    measure: F,
    pmf: F,
}

impl<F: Real> Columns<F> {
    /// The same in all lanes.
    #[inline(always)]
    fn all(one: &Picked) -> Self {
        Self {
            target: V3::from_array(one.target),
            e1: V3::from_array(one.e1),
            e2: V3::from_array(one.e2),
            error: V3::from_array(one.error),
            normal: V3::from_array(one.normal),
            radiance: V3::from_array(one.radiance),
            measure: F::splat(one.measure),
            pmf: F::splat(one.pmf),
        }
    }

    #[inline(always)]
    fn from_lanes(picked: &[Picked; 8]) -> Self {
        Self {
            target: V3::from_fn(|lane| picked[lane].target),
            e1: V3::from_fn(|lane| picked[lane].e1),
            e2: V3::from_fn(|lane| picked[lane].e2),
            error: V3::from_fn(|lane| picked[lane].error),
            normal: V3::from_fn(|lane| picked[lane].normal),
            radiance: V3::from_fn(|lane| picked[lane].radiance),
            measure: F::from_fn(|lane| picked[lane].measure),
            pmf: F::from_fn(|lane| picked[lane].pmf),
        }
    }
}

/// A flat light, of which the place is still to be drawn.
#[inline(always)]
fn on_facet(scene: &FlatScene, row: usize) -> Picked {
    let flat = &scene.lights.triangles;
    Picked {
        target: flat.p0[row],
        e1: flat.e1[row],
        e2: flat.e2[row],
        error: flat.error[row],
        normal: flat.n[row],
        radiance: flat.radiance[row],
        measure: flat.area[row],
        pmf: 0.0,
        textured: if flat.texture[row] == NONE { NONE } else { row as u32 },
    }
}

/// Row bits of the kinds among the lanes.
#[derive(Clone, Copy, Default)]
struct Kinds {
    /// Triangles and parallelograms.
    flat: u32,
    four: u32,
    shape: u32,
    /// Shapes of which the measure is a density per sr.
    by_angle: u32,
    two_sided: u32,
    local: u32,
    distant: u32,
    sky: u32,
}

/// The side of a surface that a ray leaves to, as a path carries it; 0 where it does not matter.
#[inline(always)]
pub fn side<F: Real>(settings: &Settings, surface: &Surface<F>, up: F::Mask, transmissive: bool, lane: usize) -> u32 {
    if !settings.lights_by_place {
        return u32::from(transmissive);
    }
    let n = surface.frame.n.lane(lane);
    pack(if up.bits() >> lane & 1 == 1 { n } else { n.map(|x| -x) }, transmissive)
}

/// Draws a light for each lane by what it could bring there, and a point on it.
///
/// `u_choice` chooses; `u` are two numbers for the place. `lookups` counts texture and environment look-ups. Of surfaces that let
/// light through, one of the two sides is chosen first.
#[inline(always)]
pub fn sample<F: Real>(
    scene: &FlatScene,
    settings: &Settings,
    surface: &Surface<F>,
    active: u32,
    transmissive: bool,
    u_choice: F,
    u: (F, F),
    lookups: &mut [u64; 2],
) -> LightSample<F> {
    let lights = &scene.lights;
    let (first_local, first_shape) = (lights.first_local(), lights.first_shape());
    let (first_distant, sky_row) = (lights.first_distant(), lights.environment_row());
    let (mut up, mut u_choice) = (F::Mask::splat(true), u_choice);
    if transmissive {
        let twice = u_choice + u_choice;
        up = twice.lt(F::one());
        u_choice = F::select(up, twice, twice - F::one());
    }
    let origin = surface.leave(up);
    let (mut kinds, mut picked) = (Kinds::default(), [Picked::default(); 8]);
    let columns = if let Some(row) = settings.only_flat_light {
        // All lanes look for the same, with certainty but for the side.
        let pmf = if transmissive { 0.5 } else { 1.0 };
        let one = Picked { pmf, ..on_facet(scene, row as usize) };
        kinds.flat = active;
        kinds.four = active * scene.lights.triangles.four[row as usize];
        kinds.two_sided = active * scene.lights.triangles.two_sided[row as usize];
        Columns::all(&one)
    } else {
        let (mut at, mut choices) = ([Receiver::default(); LANES], [0.0; LANES]);
        for lane in (0..F::LANES).filter(|lane| active >> lane & 1 == 1) {
            // Many lights, and then a sky of many texels, need more bits than a sample has.
            let choice = u_choice.lane(lane);
            choices[lane] = lengthen(choice, mix(choice.to_bits() ^ u.0.lane(lane).to_bits()));
            at[lane] = Receiver::new(origin.lane(lane), side(settings, surface, up, transmissive, lane));
        }
        let chosen = lights.choice.sample_each(&at, choices, active);
        for (lane, one) in picked.iter_mut().enumerate().take(F::LANES) {
            let Some(Chosen { row, pmf, rest }) = chosen[lane].filter(|_| active >> lane & 1 == 1) else { continue };
            let bit = 1 << lane;
            if row < first_local {
                let (flat, row) = (&lights.triangles, row as usize);
                kinds.flat |= bit;
                kinds.four |= flat.four[row] << lane;
                kinds.two_sided |= flat.two_sided[row] << lane;
                *one = on_facet(scene, row);
            } else if row < first_shape {
                let light = lights.local.row((row - first_local) as usize);
                kinds.local |= bit;
                one.target = light.position;
                one.radiance = light.intensity;
                one.normal = light.axis;
                one.error = [light.cos_scale, light.cos_offset, 0.0];
            } else if row < first_distant {
                let row = (row - first_shape) as usize;
                kinds.shape |= bit;
                kinds.two_sided |= lights.shapes.two_sided[row] << lane;
                let u = (u.0.lane(lane), u.1.lane(lane));
                let (point, by_angle) = on_shape(scene, row, at[lane].p, u, &mut lookups[0]);
                kinds.by_angle |= u32::from(by_angle) << lane;
                *one = point;
            } else if row < sky_row {
                let light = lights.distant.row((row - first_distant) as usize);
                kinds.distant |= bit;
                one.target = light.to_light;
                one.radiance = light.illuminance;
            } else if let Some(EnvironmentLight::Map(map)) = &lights.environment {
                lookups[1] += 1;
                kinds.sky |= bit;
                let (direction, pdf, radiance) = map.sample(rest, (u.0.lane(lane), u.1.lane(lane)));
                one.target = direction;
                one.measure = pdf;
                one.radiance = radiance;
            }
            one.pmf = pmf;
        }
        Columns::from_lanes(&picked)
    };
    let Columns { mut target, e1, e2, error, normal, mut radiance, measure, pmf } = columns;
    let mask = |bits: u32| F::Mask::from_bits(bits);
    let surfaces = kinds.flat | kinds.shape;
    let near = mask(surfaces | kinds.local);

    // Flat lights are drawn from by solid angle.
    let mut seen = None;
    if kinds.flat != 0 {
        let facets = Facets { p0: target, e1, e2, four: mask(kinds.four) };
        let as_seen = facets.seen_from(origin);
        let (b1, b2) = as_seen.sample(u);
        // Of those that are not flat, both edges are zero.
        target = facets.e1.scale_add(b1, facets.e2.scale_add(b2, target));
        seen = Some(as_seen);
        let mut textured: u32 = 0;
        if settings.only_flat_light.is_none() {
            picked.iter().enumerate().for_each(|(lane, one)| textured |= u32::from(one.textured != NONE) << lane);
        }
        textured &= kinds.flat;
        if textured != 0 {
            for lane in (0..F::LANES).filter(|lane| textured >> lane & 1 == 1) {
                lookups[0] += 1;
                let texel = texel(scene, picked[lane].textured as usize, b1.lane(lane), b2.lane(lane));
                (0..3).for_each(|i| picked[lane].radiance[i] *= texel[i]);
            }
            radiance = V3::from_fn(|lane| picked[lane].radiance);
        }
    }

    let mut wi = target;
    let mut end = target;
    let mut light = radiance * (F::one() / pmf.max(F::splat(f32::MIN_POSITIVE)));
    let mut pdf = F::zero();
    let mut valid = mask(kinds.distant | kinds.sky) & pmf.gt(F::zero());
    if (surfaces | kinds.local) != 0 {
        // What a lamp without extent brings changes with the last digit of its distance, and no ray finds it by chance: there
        // the way is that from the surface itself. All else is as a scattered ray sees it.
        let start = V3::select(mask(kinds.local), V3::select(up, surface.lifted, surface.p), origin);
        let to_light = target - start;
        let distance2 = to_light.length_squared();
        let apart = distance2.gt(F::splat(f32::MIN_POSITIVE));
        let distance2 = F::select(apart, distance2, F::one());
        let direction = to_light * (F::one() / distance2.sqrt());
        wi = V3::select(near, direction, wi);
        let cos = -direction.dot(normal);
        if surfaces != 0 {
            let is_surface = mask(surfaces);
            let faces = cos.gt(F::zero()) | (mask(kinds.two_sided) & cos.lt(F::zero()));
            let area = measure * cos.abs();
            // Where the light is seen edge-on the weight runs to zero with the cosine.
            let mut density = distance2 / area.max(F::splat(1e-30));
            if let Some(seen) = seen {
                density = F::select(mask(kinds.flat), seen.pdf(distance2, area), density);
            }
            if kinds.by_angle != 0 {
                density = F::select(mask(kinds.by_angle), measure, density);
            }
            let seen = is_surface & faces & apart & density.lt(F::splat(1e30)) & density.gt(F::zero());
            let density = F::select(seen, density, F::one());
            pdf = F::select(seen, pmf * density, pdf);
            light = V3::select(is_surface, light * (F::one() / density), light);
            valid = valid | seen;
            // The end of the ray is moved off the light towards the surface by the light's own error.
            let shift = normal.abs().dot(error).copysign(cos);
            end = V3::select(is_surface, normal.scale_add(shift, end), end);
        }
        if kinds.local != 0 {
            let is_local = mask(kinds.local);
            let falloff = cos.mul_add(error.x, error.y).saturate().sqr();
            light = V3::select(is_local, light * (falloff / distance2), light);
            valid = valid | (is_local & apart & falloff.gt(F::zero()));
        }
    }
    if kinds.sky != 0 {
        let density = measure;
        let is_sky = mask(kinds.sky);
        let seen = is_sky & density.gt(F::zero());
        light = V3::select(is_sky, light * (F::one() / F::select(seen, density, F::one())).masked(seen), light);
        pdf = F::select(is_sky, density * pmf, pdf);
        valid = (valid & !is_sky) | seen;
    }
    LightSample { origin, up, wi, target: end, near, light, pdf, valid, sky: kinds.sky }
}

/// What the texture of a flat light makes of its radiance.
pub(super) fn texel(scene: &FlatScene, row: usize, b1: f32, b2: f32) -> [f32; 4] {
    let triangles = &scene.lights.triangles;
    let texture = triangles.texture[row];
    let mesh = &scene.meshes[scene.instances.mesh[triangles.instance[row] as usize] as usize];
    let vertices = mesh.triangles[triangles.triangle[row] as usize];
    let set = scene.textures.slots.tex_coord[texture as usize];
    scene.textures.sample(texture, mesh.uv_at(set, vertices, b1, b2))
}

/// A point on a shape that shines, as seen from a place; and if its measure is a density per sr.
#[cold]
fn on_shape(scene: &FlatScene, row: usize, from: [f32; 3], u: (f32, f32), lookups: &mut u64) -> (Picked, bool) {
    let light = scene.lights.shapes.row(row);
    let Some((shape, linear, offset)) = placed(scene, light.instance) else { return (Picked::default(), false) };
    let inverse = linear.inverse();
    let from = DVec3::from_array(from.map(f64::from)) - offset;
    let (local, density) = shape.sample_seen(inverse * from, light.two_sided == 1, u);
    let mut radiance = light.radiance;
    if light.texture != NONE {
        *lookups += 1;
        let texel = scene.textures.sample(light.texture, shape.uv(local));
        (0..3).for_each(|i| radiance[i] *= texel[i]);
    }
    let piece = piece(&light.cofactors, shape.normal(local));
    let stretch = piece.length();
    let target = linear * local;
    let picked = Picked {
        target: (target + offset).as_vec3().to_array(),
        error: light.error,
        normal: (piece / stretch).as_vec3().to_array(),
        radiance,
        measure: match density {
            Density::Area(density) => stretch / density,
            Density::SolidAngle(density) => density * per_world(&linear, &inverse, target - from),
        } as f32,
        ..Picked::default()
    };
    (picked, matches!(density, Density::SolidAngle(_)))
}

/// Of an instance of a shape: that, and what takes it into the world.
fn placed(scene: &FlatScene, instance: u32) -> Option<(Shape, DMat3, DVec3)> {
    let shape = scene.meshes[scene.instances.mesh[instance as usize] as usize].shape?;
    let m = scene.instances.world_from_local[instance as usize].map(f64::from);
    let column = |i: usize| DVec3::new(m[i], m[i + 4], m[i + 8]);
    Some((shape, DMat3::from_cols(column(0), column(1), column(2)), column(3)))
}

/// Solid angle in local space by that in the world, around a direction.
fn per_world(linear: &DMat3, inverse: &DMat3, direction: DVec3) -> f64 {
    (direction.length() / (*inverse * direction).length()).powi(3) / linear.determinant().abs()
}

/// The normal in the world, as long as a piece of a shape gets larger on its way there.
fn piece(cofactors: &[f32; 9], normal: DVec3) -> DVec3 {
    let row = |i: usize| DVec3::from_array([0, 1, 2].map(|k| f64::from(cofactors[3 * i + k]))).dot(normal);
    DVec3::new(row(0), row(1), row(2))
}

/// As [`facet_pdf`], of a shape.
#[cold]
pub fn shape_pdf(scene: &FlatScene, light_row: u32, at: &Receiver, hit: &Hit, direction: [f32; 3]) -> f32 {
    let lights = &scene.lights;
    let shape_row = light_row - lights.shape_row(0);
    let light = lights.shapes.row(shape_row as usize);
    let Some((shape, linear, offset)) = placed(scene, hit.instance) else { return 0.0 };
    let inverse = linear.inverse();
    let eye = inverse * (DVec3::from_array(at.p.map(f64::from)) - offset);
    let direction = DVec3::from_array(direction.map(f64::from));
    let density = match shape.density_seen(eye, light.two_sided == 1) {
        // From outside, none is drawn on the far side, which is found through holes.
        Density::SolidAngle(_) if hit.back => 0.0,
        Density::SolidAngle(density) => density * per_world(&linear, &inverse, direction),
        Density::Area(density) => {
            let normal = shape.normal(shape.point(hit.triangle, hit.b1, hit.b2));
            let facing = piece(&light.cofactors, normal).dot(direction).abs();
            density * f64::from(hit.t).powi(2) / facing.max(f64::MIN_POSITIVE)
        }
    };
    let density = density as f32;
    if density > 0.0 && density < f32::INFINITY {
        lights.choice.near_pmf(lights.first_shape() + shape_row, at) * density
    } else {
        0.0
    }
}

/// Density per sr with which [`sample`] draws the direction of a ray of unit direction that left `at` and met an
/// emitting triangle at distance `t`.
#[inline]
pub fn facet_pdf(scene: &FlatScene, light_row: u32, at: &Receiver, t: f32, cos: f32) -> f32 {
    let light = scene.lights.triangles.row(light_row as usize);
    let [p0, e1, e2] = [light.p0, light.e1, light.e2].map(V3::<f32>::from_array);
    let seen = Facets { p0, e1, e2, four: light.four == 1 }.seen_from(V3::from_array(at.p));
    scene.lights.choice.near_pmf(light_row, at) * seen.pdf(t * t, light.area * cos.abs())
}
