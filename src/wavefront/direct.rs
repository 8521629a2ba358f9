//! Light sampling: which light, and from where on it. A kernel for eight lanes or one.

use glam::{DMat3, DVec3};

use crate::{
    accel::Hit,
    flat::{Candidate, EnvironmentLight, FlatScene, NONE},
    light::{Density, Facets, Receiver, Receivers, pack},
    sampling::lengthen,
    simd::{Bits, LANES, Mask, Real, Rgb, V3},
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
    /// Rows of the lights, lane by lane.
    pub rows: [u32; LANES],
}

/// As [`Candidate`], of all lanes.
struct Columns<F: Real> {
    target: V3<F>,
    e1: V3<F>,
    e2: V3<F>,
    error: V3<F>,
    normal: V3<F>,
    radiance: Rgb<F>,
    measure: F,
    four: F,
    two_sided: F,
    textured: F,
}

impl<F: Real> Columns<F> {
    /// The same in all lanes.
    #[inline(always)]
    fn all(one: &Candidate) -> Self {
        Self {
            target: V3::from_array(one.target),
            e1: V3::from_array(one.e1),
            e2: V3::from_array(one.e2),
            error: V3::from_array(one.error),
            normal: V3::from_array(one.normal),
            radiance: V3::from_array(one.radiance),
            measure: F::splat(one.measure),
            four: F::splat(one.four),
            two_sided: F::splat(one.two_sided),
            textured: F::splat(one.textured),
        }
    }

    #[inline(always)]
    fn from_lanes(picked: &[Candidate; LANES]) -> Self {
        let part =
            |i: usize| F::columns_of_eight(|lane| bytemuck::cast_ref::<Candidate, [[f32; 8]; 3]>(&picked[lane])[i]);
        let ([a, b, c, d, e, f, g, h], [i, j, k, l, m, n, o, p], [q, r, s, t, u, v, ..]) = (part(0), part(1), part(2));
        Self {
            target: V3::new(a, b, c),
            e1: V3::new(d, e, f),
            e2: V3::new(g, h, i),
            error: V3::new(j, k, l),
            normal: V3::new(m, n, o),
            radiance: V3::new(p, q, r),
            measure: s,
            four: t,
            two_sided: u,
            textured: v,
        }
    }
}

/// Row bits of the kinds among the lanes.
#[derive(Clone, Copy, Default)]
struct Kinds {
    /// Triangles and parallelograms.
    flat: u32,
    shape: u32,
    /// Shapes of which the measure is a density per sr.
    by_angle: u32,
    local: u32,
    distant: u32,
    sky: u32,
}

/// The sides of surfaces that rays leave to, as paths carry them; 0 where it does not matter.
#[inline(always)]
pub fn sides<F: Real>(settings: &Settings, surface: &Surface<F>, up: F::Mask, transmissive: bool) -> F::Bits {
    if !settings.lights_by_place {
        return F::Bits::splat(transmissive.into());
    }
    let n = surface.frame.n;
    pack(if transmissive { V3::select(up, n, -n) } else { n }, transmissive)
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
    let mut kinds = Kinds::default();
    let (columns, pmf, rows) = if let Some(row) = settings.only_flat_light {
        // All lanes look for the same, with certainty but for the side.
        kinds.flat = active;
        let pmf = if transmissive { 0.5 } else { 1.0 };
        (Columns::<F>::all(&lights.facets[row as usize]), F::splat(pmf), [row; LANES])
    } else {
        // Many lights, and then a sky of many texels, need more bits than a sample has.
        let choices = std::array::from_fn(|lane| {
            let lane = lane % F::LANES;
            let choice = u_choice.lane(lane);
            lengthen(choice, mix(choice.to_bits() ^ u.0.lane(lane).to_bits()))
        });
        let at = Receivers::new(origin, sides(settings, surface, up, transmissive));
        let chosen = lights.choice.sample_each(&at, choices, active);
        let mut picked = [Candidate::default(); LANES];
        for (lane, one) in picked.iter_mut().enumerate().take(F::LANES) {
            let (row, bit) = (chosen.row[lane], chosen.lanes & 1 << lane);
            if bit == 0 {
                continue;
            }
            if row < first_local {
                kinds.flat |= bit;
                *one = lights.facets[row as usize];
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
                let u = (u.0.lane(lane), u.1.lane(lane));
                let (point, by_angle) = on_shape(scene, row, at.lane(lane).p, u, &mut lookups[0]);
                kinds.by_angle |= u32::from(by_angle) << lane;
                *one = point;
            } else if row < sky_row {
                let light = lights.distant.row((row - first_distant) as usize);
                kinds.distant |= bit;
                one.target = light.to_light;
                one.radiance = light.illuminance;
            } else {
                kinds.sky |= bit;
            }
        }
        let mut columns =
            if kinds.sky == chosen.lanes { Columns::all(&Candidate::default()) } else { Columns::from_lanes(&picked) };
        if kinds.sky != 0
            && let Some(EnvironmentLight::Map(map)) = &lights.environment
        {
            lookups[1] += u64::from(kinds.sky.count_ones());
            let is_sky = F::Mask::from_bits(kinds.sky);
            let (direction, pdf, radiance) = map.sample_each(&chosen.rest, u, kinds.sky);
            columns.target = V3::select(is_sky, direction, columns.target);
            columns.radiance = V3::select(is_sky, radiance, columns.radiance);
            columns.measure = F::select(is_sky, pdf, columns.measure);
        }
        let drawn = F::Mask::from_bits(chosen.lanes);
        (columns, F::load(&chosen.pmf.to_array()).masked(drawn), chosen.row)
    };
    let Columns { mut target, e1, e2, error, normal, mut radiance, measure, four, two_sided, textured } = columns;
    let (four, two_sided) = (four.gt(F::zero()), two_sided.gt(F::zero()));
    let mask = |bits: u32| F::Mask::from_bits(bits);
    let surfaces = kinds.flat | kinds.shape;
    let near = mask(surfaces | kinds.local);

    // Flat lights are drawn from by solid angle.
    let mut seen = None;
    if kinds.flat != 0 {
        let facets = Facets { p0: target, e1, e2, four };
        let as_seen = facets.seen_from(origin);
        let (b1, b2) = as_seen.sample(u);
        // Of those that are not flat, both edges are zero.
        target = facets.e1.scale_add(b1, facets.e2.scale_add(b2, target));
        seen = Some(as_seen);
        let textured = textured.gt(F::zero()).bits() & kinds.flat;
        if textured != 0 {
            radiance = V3::from_fn(|lane| {
                let radiance = radiance.lane(lane);
                if textured >> lane & 1 == 0 {
                    return radiance;
                }
                lookups[0] += 1;
                let texel = texel(scene, rows[lane] as usize, b1.lane(lane), b2.lane(lane));
                std::array::from_fn(|i| radiance[i] * texel[i])
            });
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
            let faces = cos.gt(F::zero()) | (two_sided & cos.lt(F::zero()));
            let area = measure * cos.abs();
            // Where the light is seen edge-on the weight runs to zero with the cosine.
            let mut density = F::zero();
            if kinds.shape != 0 {
                density = distance2 / area.max(F::splat(1e-30));
            }
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
    LightSample { origin, up, wi, target: end, near, light, pdf, valid, sky: kinds.sky, rows }
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
fn on_shape(scene: &FlatScene, row: usize, from: [f32; 3], u: (f32, f32), lookups: &mut u64) -> (Candidate, bool) {
    let light = scene.lights.shapes.row(row);
    let Some((shape, linear, offset)) = placed(scene, light.instance) else { return (Candidate::default(), false) };
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
    let picked = Candidate {
        target: (target + offset).as_vec3().to_array(),
        error: light.error,
        normal: (piece / stretch).as_vec3().to_array(),
        radiance,
        measure: match density {
            Density::Area(density) => stretch / density,
            Density::SolidAngle(density) => density * per_world(&linear, &inverse, target - from),
        } as f32,
        two_sided: light.two_sided as f32,
        ..Candidate::default()
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
    let light = &scene.lights.facets[light_row as usize];
    let [p0, e1, e2] = [light.target, light.e1, light.e2].map(V3::<f32>::from_array);
    let seen = Facets { p0, e1, e2, four: light.four > 0.0 }.seen_from(V3::from_array(at.p));
    scene.lights.choice.near_pmf(light_row, at) * seen.pdf(t * t, light.measure * cos.abs())
}
