//! From a hit to a surface: position, normals, appearance. A kernel for eight lanes or one.

use super::fetch::{Fetched, fetch, linear, linear_abs, translation, transposed};
use crate::{
    bsdf::Params,
    flat::{FlatScene, NONE, flags},
    simd::{Frame, Mask, Real, Rgb, V3},
};

/// Half the distance between 1 and the next number.
const UNIT_ROUNDOFF: f32 = f32::EPSILON / 2.0;

/// Bound on the relative error of `n` rounded operations (Higham's γₙ).
const fn gamma(n: i32) -> f32 {
    let n = n as f32 * UNIT_ROUNDOFF;
    n / (1.0 - n)
}

/// Rays and what they met, one per lane. Lanes that carry nothing repeat one that does.
#[derive(Clone, Copy, Debug)]
pub struct Incoming<F: Real> {
    /// Direction of the ray, unit length.
    pub direction: V3<F>,
    /// Barycentric of the second corner.
    pub b1: F,
    /// Barycentric of the third corner.
    pub b2: F,
    /// The back was met.
    pub back: F::Mask,
    /// Rows of the instances.
    pub instance: [u32; 8],
    /// Rows of the triangles.
    pub triangle: [u32; 8],
    /// Rows of the materials.
    pub material: [u32; 8],
}

/// Surfaces in world space, seen from the side the ray came from.
#[derive(Clone, Copy, Debug)]
pub struct Surface<F: Real> {
    /// Point, m.
    pub p: V3<F>,
    /// Bound on its rounding error along each axis, m.
    pub error: V3<F>,
    /// What rounding may make of the distance between the facet and a ray that starts on it, m.
    pub reach: F,
    /// Where rays start that are reflected: lifted to the smooth surface.
    pub lifted: V3<F>,
    /// `lifted` is off the facet by more than rounding, so that rays may start below the facet's plane.
    pub is_lifted: F::Mask,
    /// Geometric normal on the side of `wo`.
    pub ng: V3<F>,
    /// Shading normal on the side of `wo`, before it is bent.
    pub ns: V3<F>,
    /// Lanes whose shading normal is not the geometric one, so that it may have to be bent.
    pub smooth: F::Mask,
    /// It was bent.
    pub bent: F::Mask,
    /// Shading frame on the side of `wo`.
    pub frame: Frame<F>,
    /// Where the ray came from, unit length.
    pub wo: V3<F>,
    /// `wo` in the shading frame; z above 0.
    pub wo_local: V3<F>,
    /// Appearance.
    pub params: Params<F>,
}

/// Which parameters a shading class reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parts {
    /// The base colour alone.
    Color,
    /// All but transmission.
    Opaque,
    /// All.
    All,
}

/// Columns filled lane by lane.
#[inline(always)]
fn vector<F: Real>(columns: &[[f32; 8]; 3]) -> V3<F> {
    V3::load(&columns[0], &columns[1], &columns[2])
}

/// Flips a vector where `mask` holds.
#[inline(always)]
pub(super) fn flip<F: Real>(mask: F::Mask, v: V3<F>) -> V3<F> {
    V3::select(mask, -v, v)
}

/// Bends a shading normal just so far that the mirror direction of `wo` stays above the surface, and says where.
///
/// After Keller et al. 2017, "The Iray Light Transport Simulation and Rendering System", A.3.
#[inline(always)]
pub(super) fn valid_normal<F: Real>(ns: V3<F>, ng: V3<F>, wo: V3<F>) -> (V3<F>, F::Mask) {
    let r = ns.scale_add(F::splat(2.0) * ns.dot(wo), -wo);
    let least = least_mirror_height(wo.dot(ng));
    let height = r.dot(ng);
    let below = height.lt(least);
    // The mirror direction is the same for both signs of the normal; the one towards `wo` is meant.
    let ns = flip::<F>(ns.dot(wo).lt(F::zero()), ns);
    if !below.any() {
        return (ns, below);
    }
    let raised = ng.scale_add(least - height, r).normalize();
    (V3::select(below, (wo + raised).normalize(), ns), below)
}

/// The cosine to the geometric normal that the mirror direction of a `wo` of given cosine has at least.
#[inline(always)]
pub fn least_mirror_height<F: Real>(cos: F) -> F {
    (F::splat(0.1) * cos).min(F::splat(0.01))
}

/// Makes surfaces of hits.
///
/// `TEXTURED` materials look into their textures and vertex colours, and the number of look-ups is added to `lookups`.
#[inline(always)]
pub fn interact<F: Real, const TEXTURED: bool>(
    scene: &FlatScene,
    hits: &Incoming<F>,
    parts: Parts,
    terminator_fix: bool,
    lookups: &mut u64,
) -> Surface<F> {
    let f = fetch(scene, hits);
    let wo = -hits.direction;
    let shaped = F::Mask::from_bits(f.shaped);
    let (mut b1, mut b2) = (hits.b1, hits.b2);
    if f.shaped != 0 {
        (b1, b2) = (F::select(shaped, F::zero(), b1), F::select(shaped, F::zero(), b2));
    }
    let b0 = F::one() - b1 - b2;
    let weigh = |a: V3<F>, b: V3<F>, c: V3<F>| c.scale_add(b2, b.scale_add(b1, a * b0));
    let corners = f.corners;

    // Position with its error (Pharr, Jakob, Humphreys 2023, section 6.8.4), here in local space.
    let mut p = weigh(corners[0], corners[1], corners[2]);
    let magnitude = weigh(corners[0].abs(), corners[1].abs(), corners[2].abs()).abs();
    let mut error = magnitude * F::splat(gamma(7));
    let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
    let mut ng = e1.cross(e2);
    // A ray is tested against corners relative to its start. What they round by grows with the facet and not with
    // the point: on a plane through the origin the point's own error may well be zero.
    let mut extent = V3::new(e1.x.abs().max(e2.x.abs()), e1.y.abs().max(e2.y.abs()), e1.z.abs().max(e2.z.abs()));
    if f.shaped != 0 {
        // The test of a shape is exact beside the point's own error.
        ng = V3::select(shaped, corners[1], ng);
        extent = V3::select(shaped, V3::splat(0.0), extent);
    }
    let mut world_corners = corners;
    let mut ns_raw = V3::splat(0.0);
    let mut world_normals = [V3::splat(0.0); 3];
    if f.any_normals {
        world_normals = f.normals;
        ns_raw = weigh(world_normals[0], world_normals[1], world_normals[2]);
    }
    if f.any_transform {
        let (to_world, to_local) = (&f.world_from_local, &f.local_from_world);
        let local = p;
        p = linear(to_world, local) + translation(to_world);
        // The point's own error carried over, the rounding of the transform, and that of the next
        // ray's way back into this local space.
        let there = linear_abs(to_world, local.abs()) + translation(to_world).abs();
        let back_again = linear_abs(to_local, p.abs()) + translation(to_local).abs();
        let moved = F::Mask::from_bits(f.transformed);
        let in_world = linear_abs(to_world, error + back_again * F::splat(gamma(4))) + there * F::splat(gamma(4));
        error = V3::select(moved, in_world, error);
        extent = linear_abs(to_world, extent);
        ng = transposed(to_local, ng);
        ns_raw = transposed(to_local, ns_raw);
        if terminator_fix && f.any_normals {
            world_corners = world_corners.map(|corner| linear(to_world, corner) + translation(to_world));
            world_normals = world_normals.map(|local| {
                let n = transposed(to_local, local);
                let length2 = n.length_squared();
                V3::select(moved, n * (F::one() / length2.max(F::splat(f32::MIN_POSITIVE)).sqrt()), local)
            });
        }
    }
    // The last addition of an offset rounds once more.
    error = p.abs().scale_add(F::splat(2.0 * UNIT_ROUNDOFF), error);
    let reach = extent.max_element() * F::splat(gamma(16));
    // Edges may be so short that squares of their product vanish; what is left of a normal then faces the ray.
    ng = ng * (F::one() / ng.abs().max_element().max(F::splat(f32::MIN_POSITIVE)));
    let length2 = ng.length_squared();
    let has_normal = length2.gt(F::splat(0.25));
    ng = ng * (F::one() / F::select(has_normal, length2, F::one()).sqrt());
    let ng_front = V3::select(has_normal, ng, flip::<F>(hits.back, wo));
    ng = flip::<F>(hits.back, ng_front);

    let mut ns = ng;
    let mut unflipped = ng_front;
    if f.any_normals {
        let length2 = ns_raw.length_squared();
        let smooth = length2.gt(F::splat(1e-24));
        let normal = ns_raw * (F::one() / F::select(smooth, length2, F::one()).sqrt());
        unflipped = V3::select(smooth, normal, ng_front);
        ns = flip::<F>(hits.back, unflipped);
    }

    let mut params = gather_params(scene, hits, parts);
    let mut mapped = f.smooth;
    if TEXTURED {
        mapped |= textured(scene, hits, unflipped, &f, &mut params, &mut ns, lookups);
    }
    let smooth = F::Mask::from_bits(mapped);
    let (unbent, mut bent) = (ns, F::Mask::splat(false));
    if smooth.any() {
        let (valid, below) = valid_normal(ns, ng, wo);
        (ns, bent) = (V3::select(smooth, valid, ns), below & smooth);
    }
    let frame = Frame::new(ns);
    let mut wo_local = frame.to_local(wo);
    wo_local.z = wo_local.z.max(F::splat(1e-6));

    let mut lifted = p;
    let mut is_lifted = F::Mask::splat(false);
    if terminator_fix && f.any_normals {
        // Hanika 2021, "Hacking the Shadow Terminator".
        let lift = |i: usize| {
            let n = flip::<F>(hits.back, world_normals[i]);
            let height = (world_corners[i] - p).dot(n).max(F::zero());
            n * height.masked(n.dot(ng).gt(F::zero()))
        };
        let lift = weigh(lift(0), lift(1), lift(2));
        lifted = p + lift;
        is_lifted = lift.dot(ng).gt(ng.abs().dot(error) * F::splat(4.0));
    }
    Surface { p, error, reach, lifted, is_lifted, ng, ns: unbent, smooth, bent, frame, wo, wo_local, params }
}

#[inline(always)]
fn gather_params<F: Real>(scene: &FlatScene, hits: &Incoming<F>, parts: Parts) -> Params<F> {
    let materials = &scene.materials;
    let row = |lane: usize| hits.material[lane] as usize;
    let number = |column: &[f32]| F::from_fn(|lane| column[row(lane)]);
    let color = |column: &[[f32; 3]]| -> Rgb<F> { V3::from_fn(|lane| column[row(lane)]) };
    let mut params = Params::lambert(color(&materials.base_color));
    if parts != Parts::Color {
        params.metallic = number(&materials.metallic);
        params.alpha = number(&materials.roughness).sqr();
        params.specular = number(&materials.specular);
        params.specular_color = color(&materials.specular_color);
        params.ior = number(&materials.ior);
    }
    if parts == Parts::All {
        params.transmission = number(&materials.transmission);
        let mut solid = 0;
        for lane in 0..F::LANES {
            solid |= u32::from(materials.flags[row(lane)] & flags::SOLID != 0) << lane;
        }
        params.solid = F::Mask::from_bits(solid);
        params.inside = params.solid & hits.back;
    }
    params
}

/// Applies textures and vertex colours; returns the lanes whose shading normal was mapped.
#[allow(clippy::inline_always)]
#[inline(always)]
fn textured<F: Real>(
    scene: &FlatScene,
    hits: &Incoming<F>,
    unflipped: V3<F>,
    f: &Fetched<F>,
    params: &mut Params<F>,
    ns: &mut V3<F>,
    lookups: &mut u64,
) -> u32 {
    let materials = &scene.materials;
    let textures = &scene.textures;
    let mut base = [[1.0; 8]; 3];
    let (mut metallic, mut roughness, mut specular, mut transmission) = ([1.0; 8], [1.0; 8], [1.0; 8], [1.0; 8]);
    let mut specular_color = [[1.0; 8]; 3];
    let mut mapped = 0_u32;
    let mut map = [[0.0; 8]; 3];
    let mut tangent = [[0.0; 8]; 3];
    let mut handed = [1.0; 8];
    for lane in 0..F::LANES {
        let row = hits.material[lane] as usize;
        let mesh = &*scene.meshes[scene.instances.mesh[hits.instance[lane] as usize] as usize];
        let vertices = mesh.vertices(hits.triangle[lane]);
        let (b1, b2) = (hits.b1.lane(lane), hits.b2.lane(lane));
        let mut sample = |slot: u32| {
            *lookups += 1;
            textures.sample(slot, mesh.uv_at(textures.slots.tex_coord[slot as usize], vertices, b1, b2))
        };
        if materials.base_color_texture[row] != NONE {
            let texel = sample(materials.base_color_texture[row]);
            (0..3).for_each(|i| base[i][lane] = texel[i]);
        }
        if !mesh.colors.is_empty() {
            let [a, b, c] = vertices.map(|vertex| mesh.colors[vertex as usize]);
            (0..3).for_each(|i| base[i][lane] *= (1.0 - b1 - b2) * a[i] + b1 * b[i] + b2 * c[i]);
        }
        if materials.metallic_roughness_texture[row] != NONE {
            let texel = sample(materials.metallic_roughness_texture[row]);
            roughness[lane] = texel[1];
            metallic[lane] = texel[2];
        }
        if materials.specular_texture[row] != NONE {
            specular[lane] = sample(materials.specular_texture[row])[3];
        }
        if materials.specular_color_texture[row] != NONE {
            let texel = sample(materials.specular_color_texture[row]);
            (0..3).for_each(|i| specular_color[i][lane] = texel[i]);
        }
        if materials.transmission_texture[row] != NONE {
            transmission[lane] = sample(materials.transmission_texture[row])[0];
        }
        if materials.normal_texture[row] != NONE && (!mesh.tangents.is_empty() || mesh.shape.is_some()) {
            let texel = sample(materials.normal_texture[row]);
            let scale = materials.normal_scale[row];
            map[0][lane] = (2.0 * texel[0] - 1.0) * scale;
            map[1][lane] = (2.0 * texel[1] - 1.0) * scale;
            map[2][lane] = 2.0 * texel[2] - 1.0;
            let at = if let Some(shape) = mesh.shape {
                shape.tangent(shape.point(hits.triangle[lane], b1, b2))
            } else {
                let [a, b, c] = vertices.map(|vertex| mesh.tangents[vertex as usize]);
                std::array::from_fn(|i| (1.0 - b1 - b2) * a[i] + b1 * b[i] + b2 * c[i])
            };
            (0..3).for_each(|i| tangent[i][lane] = at[i]);
            let sign = at[3];
            handed[lane] = if sign < 0.0 { -1.0 } else { 1.0 };
            mapped |= 1 << lane;
        }
    }
    params.base_color = params.base_color * vector(&base);
    params.metallic = params.metallic * F::load(&metallic);
    // alpha is the square of roughness, so a factor of roughness enters squared.
    params.alpha = params.alpha * F::load(&roughness).sqr();
    params.specular = params.specular * F::load(&specular);
    params.specular_color = params.specular_color * vector(&specular_color);
    params.transmission = params.transmission * F::load(&transmission);
    if mapped == 0 {
        return 0;
    }
    let mut t: V3<F> = vector(&tangent);
    if f.any_transform {
        t = linear(&f.world_from_local, t);
    }
    t = unflipped.scale_add(-unflipped.dot(t), t);
    let length2 = t.length_squared();
    let usable = F::Mask::from_bits(mapped) & length2.gt(F::splat(1e-24));
    t = t * (F::one() / F::select(usable, length2, F::one()).sqrt());
    // A mirroring transform turns the bitangent round with the rest of the surface.
    let b = unflipped.cross(t) * (F::load(&handed) * f.mirror);
    let map: V3<F> = vector(&map);
    let n = t.scale_add(map.x, b.scale_add(map.y, unflipped * map.z));
    let length2 = n.length_squared();
    let usable = usable & length2.gt(F::splat(1e-24));
    let n = n * (F::one() / F::select(usable, length2, F::one()).sqrt());
    *ns = V3::select(usable, flip::<F>(hits.back, n), *ns);
    mapped
}

impl<F: Real> Surface<F> {
    /// Lanes in which a direction is one of reflection, and lanes in which it is one of transmission; `wi_local` is
    /// the direction in the shading frame.
    ///
    /// Both normals must agree on the side, but from a lifted start the shading normal alone decides about reflection.
    #[inline(always)]
    pub fn sides(&self, wi: V3<F>, wi_local: V3<F>) -> (F::Mask, F::Mask) {
        let (height, zero) = (wi.dot(self.ng), F::zero());
        let above = wi_local.z.gt(zero) & (height.gt(zero) | self.is_lifted);
        let below = wi_local.z.lt(zero) & height.lt(zero);
        (above, below)
    }

    /// Where a ray leaves the surface: on the side of `wo` if `reflected`, else beyond, and off it by more than the
    /// point's error (Pharr, Jakob, Humphreys 2023, section 6.8.6) and by more than the test of the facet may err.
    #[inline(always)]
    pub fn leave(&self, reflected: F::Mask) -> V3<F> {
        self.leave_at(reflected, reflected)
    }

    /// As [`Surface::leave`], from the lifted point only where it says so.
    #[inline(always)]
    pub fn leave_at(&self, reflected: F::Mask, lifted: F::Mask) -> V3<F> {
        let distance = self.ng.abs().dot(self.error) + self.reach;
        let start = V3::select(lifted, self.lifted, self.p);
        self.ng.scale_add(F::select(reflected, distance, -distance), start)
    }
}
