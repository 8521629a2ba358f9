//! The rendering equation solved the other way: as a system of linear equations between patches of surfaces.
//!
//! In a scene of matt surfaces, cut into patches that are each taken for evenly bright, L = E + KL is a matrix equation with
//!
//! ```text
//! Kᵢⱼ = ρᵢ Fᵢⱼ,   Fᵢⱼ the share of the cosine-weighted directions from patch i that meet patch j
//! ```
//!
//! (Goral et al. 1984, "Modeling the Interaction of Light Between Diffuse Surfaces"; Cohen, Wallace 1993, "Radiosity and Realistic
//! Image Synthesis", chapters 2 to 5). The form factors F are found by casting rays. Then either (I − K)L = E is solved, or the partial sums E + KE + K²E + … are
//! taken: a path tracer must find the same light, up to what the patches are too coarse for.
//!
//! ```
//! use wavecast::{
//!     film::{Split, luminance},
//!     load::{self, LoadOptions},
//!     reference::{Transport, TransportSettings},
//!     render::{LayerKind, RenderSettings, Renderer},
//! };
//!
//! let mut scene = load::load("scenes/cornell.gltf".as_ref(), &LoadOptions::default())?.scene;
//! let mut renderer = Renderer::new();
//! renderer.sync(&mut scene);
//!
//! // L = E + KL by patches of at most 0.2 m: all light but E, as the camera sees it.
//! let settings = TransportSettings { edge: 0.2, rays: 1024, seed: 1 };
//! let transport = Transport::new(renderer.scene(), &settings)?;
//! let (all, _) = transport.solve();
//! let scattered: Vec<_> = all.iter().zip(transport.emission()).map(|(all, e)| *all - e).collect();
//! let seen = transport.mean_of_view(renderer.scene(), &scattered, [48, 48], 16, false);
//! let by_patches = luminance(seen.to_array());
//!
//! // The same by paths: KE + K²E + K³E + …
//! let layers = vec![LayerKind::Light(Split::Bounces)];
//! let settings = RenderSettings { width: 48, height: 48, layers, ..RenderSettings::default() };
//! let terms = renderer.render(&settings, &()).stats.parts;
//! let by_paths: f64 = terms[1..].iter().map(|term| term.luminance.value).sum();
//!
//! assert!((by_patches / by_paths - 1.0).abs() < 0.02, "{by_patches} nit, {by_paths} nit");
//! // K takes light away, so the series ends.
//! assert!(transport.spectral_radius() < 1.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::{
    geometry::{Bvh, Hit, Ray, Triangle, world_triangles},
    render::camera_ray,
    rng::Rng,
};
use crate::flat::{EnvironmentLight, FlatScene, NONE, ShadingClass, flags};

/// How a scene is cut into patches and connected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransportSettings {
    /// Edges are halved until none is longer, m.
    pub edge: f64,
    /// Rays from each side of a patch.
    pub rays: u32,
    /// Chooses the random numbers.
    pub seed: u64,
}

/// Why a scene cannot be solved for.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TransportError {
    /// Something is not matt, or has a texture.
    #[error("the material of instance {instance} is not matt and of one colour; the matrix knows no other")]
    NotMatt {
        /// Row of the instance.
        instance: u32,
    },
    /// A light that has no patch.
    #[error("the scene has {0}, which no patch stands for")]
    Light(&'static str),
    /// More than fits into memory.
    #[error("{0} patches are too many for a full matrix; ask for longer edges")]
    TooMany(usize),
}

/// Rays from one point of a patch.
const RAYS_OF_A_POINT: u32 = 16;
/// Times as many rays leave lamps, where these are few.
const LAMP_RAYS: usize = 64;
/// Sides of patches at most: a matrix of 1.6 GB.
const MOST_SIDES: usize = 20_000;

/// The transport matrix of a scene with its emission.
#[derive(Debug)]
pub struct Transport {
    bvh: Bvh,
    /// The back's place among the sides, of two-sided triangles; else [`NONE`].
    backs: Vec<u32>,
    sides: Vec<Side>,
    /// By rows, Fᵢⱼ of all pairs of sides.
    form_factors: Vec<f32>,
    /// Light of the sky that a side sends on after one scattering, nit.
    from_sky: Vec<DVec3>,
    scene_has_sky: bool,
    /// Sides that emit.
    lamps: usize,
}

/// What rays from a side have met.
struct Seen {
    /// By side, how often.
    met: Vec<u32>,
    /// Radiance of the sky, averaged over all that count, nit.
    sky: DVec3,
    /// Rays that count.
    counted: u32,
    /// All rays.
    sent: u32,
    /// Some that count went through a surface that is not there from behind.
    through: bool,
}

/// One side of a patch.
#[derive(Clone, Copy, Debug)]
struct Side {
    /// Index of the triangle in the tree.
    triangle: usize,
    back: bool,
    area: f64,
    albedo: DVec3,
    emission: DVec3,
}

fn vec3(rgb: [f32; 3]) -> DVec3 {
    DVec3::from_array(rgb.map(f64::from))
}

impl Transport {
    /// Cuts a scene into patches and finds what each sees of each other.
    ///
    /// # Errors
    /// If the scene is not matt, has lamps without area, or takes too many patches.
    pub fn new(scene: &FlatScene, settings: &TransportSettings) -> Result<Self, TransportError> {
        let lights = &scene.lights;
        let other = [
            (!lights.local.is_empty(), "point or spot lights"),
            (!lights.distant.is_empty(), "directional lights"),
            (!lights.shapes.is_empty(), "emitting shapes"),
            (scene.meshes.iter().any(|mesh| mesh.shape.is_some()), "surfaces given by formulas"),
        ];
        if let Some((_, what)) = other.iter().find(|(there, _)| *there) {
            return Err(TransportError::Light(what));
        }
        let mut patches = Vec::new();
        for triangle in world_triangles(scene) {
            cut(triangle, settings.edge, &mut patches);
            if patches.len() > MOST_SIDES {
                return Err(TransportError::TooMany(patches.len()));
            }
        }
        let bvh = Bvh::new(patches);
        let mut fronts = Vec::with_capacity(bvh.triangles.len());
        let mut more = Vec::new();
        let mut backs = Vec::with_capacity(bvh.triangles.len());
        for (index, triangle) in bvh.triangles.iter().enumerate() {
            let row = scene.material_of(triangle.instance, triangle.triangle) as usize;
            let materials = &scene.materials;
            let matt = materials.class[row] == ShadingClass::Lambert as u32 && materials.emissive_texture[row] == NONE;
            if !matt || materials.flags[row] & (flags::MASK | flags::BLEND) != 0 {
                return Err(TransportError::NotMatt { instance: triangle.instance });
            }
            let side = Side {
                triangle: index,
                back: false,
                area: 0.5 * triangle.cross().length(),
                albedo: vec3(materials.base_color[row]),
                emission: vec3(materials.emissive[row]),
            };
            fronts.push(side);
            if materials.flags[row] & flags::DOUBLE_SIDED != 0 {
                backs.push((bvh.triangles.len() + more.len()) as u32);
                more.push(Side { back: true, ..side });
            } else {
                backs.push(NONE);
            }
        }
        let sides: Vec<Side> = fronts.iter().copied().chain(more).collect();
        if sides.len() > MOST_SIDES {
            return Err(TransportError::TooMany(sides.len()));
        }
        let count = sides.len();
        let lamps = sides.iter().filter(|side| side.emission != DVec3::ZERO).count();
        let mut transport = Self {
            bvh,
            backs,
            sides,
            form_factors: vec![0.0; count * count],
            from_sky: Vec::new(),
            scene_has_sky: lights.environment.is_some(),
            lamps,
        };
        transport.connect(scene, settings);
        Ok(transport)
    }

    /// Patches' sides, the unknowns of the equation.
    pub fn len(&self) -> usize {
        self.sides.len()
    }

    /// True if there is nothing.
    pub fn is_empty(&self) -> bool {
        self.sides.is_empty()
    }

    fn connect(&mut self, scene: &FlatScene, settings: &TransportSettings) {
        let count = self.sides.len();
        let offset = 1e-9 * self.bvh.scale();
        let rows: Vec<Seen> = (0..count).into_par_iter().map(|side| self.look(scene, settings, side, offset)).collect();
        // Of sides that no back has let rays through to, AᵢFᵢⱼ = AⱼFⱼᵢ: what was counted at both ends then stands for one number, and is
        // likest with this weight. Lamps, which are small and send off many rays, are the better known for it.
        let area = |i: usize| self.sides[i].area * f64::from(rows[i].counted) / f64::from(rows[i].sent.max(1));
        let per_area: Vec<f64> =
            (0..count).map(|i| f64::from(rows[i].counted) / area(i).max(f64::MIN_POSITIVE)).collect();
        self.form_factors.par_chunks_mut(count.max(1)).enumerate().for_each(|(i, row)| {
            for (j, factor) in row.iter_mut().enumerate() {
                let (own, other) = (f64::from(rows[i].met[j]), f64::from(rows[j].met[i]));
                *factor = if rows[i].through || rows[j].through {
                    own / f64::from(rows[i].counted.max(1))
                } else if own + other > 0.0 && area(i) > 0.0 {
                    (own + other) / ((per_area[i] + per_area[j]) * area(i))
                } else {
                    0.0
                } as f32;
            }
        });
        self.from_sky = rows.iter().zip(&self.sides).map(|(row, side)| side.albedo * row.sky).collect();
    }

    /// Rays from one side.
    fn look(&self, scene: &FlatScene, settings: &TransportSettings, side: usize, offset: f64) -> Seen {
        let mut rng = Rng::new(settings.seed, side as u64);
        let lamp = self.sides[side].emission != DVec3::ZERO && self.lamps * LAMP_RAYS <= self.sides.len();
        let sent = settings.rays * if lamp { LAMP_RAYS as u32 } else { 1 };
        let mut seen = Seen { met: vec![0; self.sides.len()], sky: DVec3::ZERO, counted: 0, sent, through: false };
        let mut rays = Vec::with_capacity(RAYS_OF_A_POINT as usize);
        for first in (0..sent).step_by(RAYS_OF_A_POINT as usize) {
            let origin = self.point_of(side, &mut rng);
            rays.clear();
            let of_point = first..(first + RAYS_OF_A_POINT).min(sent);
            rays.extend(of_point.map(|number| {
                let ray = self.leave(side, origin, number, sent, offset, &mut rng);
                let first = self.bvh.intersect(&ray, &mut |_| true);
                (ray, first, first.is_some_and(|hit| !self.is_there(&ray, &hit)))
            }));
            // Under a box that stands on a floor, all that the floor sees are faces that are not there from behind. No ray from
            // outside sees that part of it.
            if rays.iter().all(|(.., inside)| *inside) {
                continue;
            }
            for (ray, first, through) in &rays {
                seen.counted += 1;
                seen.through |= through;
                let hit = if *through { self.bvh.intersect(ray, &mut |hit| self.is_there(ray, hit)) } else { *first };
                match hit {
                    Some(hit) => seen.met[self.side_of(ray, &hit)] += 1,
                    None => seen.sky += self.sky(scene, ray.direction),
                }
            }
        }
        seen.sky /= f64::from(seen.counted.max(1));
        seen
    }

    fn sky(&self, scene: &FlatScene, direction: DVec3) -> DVec3 {
        match &scene.lights.environment {
            None => DVec3::ZERO,
            Some(EnvironmentLight::Constant(radiance)) => vec3(*radiance),
            Some(EnvironmentLight::Map(map)) => {
                let u = (0.5 + direction.z.atan2(direction.x) / TAU).rem_euclid(1.0);
                let v = direction.y.clamp(-1.0, 1.0).acos() / std::f64::consts::PI;
                let at = |share: f64, count: u32| ((share * f64::from(count)) as u32).min(count - 1);
                vec3(map.texels[(at(v, map.height) * map.width + at(u, map.width)) as usize])
            }
        }
    }

    /// A point anywhere on a side.
    fn point_of(&self, side: usize, rng: &mut Rng) -> DVec3 {
        let root = rng.uniform().sqrt();
        let b2 = root * rng.uniform();
        self.bvh.triangles[self.sides[side].triangle].point(root - b2, b2)
    }

    /// One of all rays from a side, in a direction by its cosine: these are in as many strata as there are rays.
    fn leave(&self, side: usize, origin: DVec3, number: u32, of: u32, offset: f64, rng: &mut Rng) -> Ray {
        let Side { triangle, back, .. } = self.sides[side];
        let n = self.bvh.triangles[triangle].cross().normalize() * if back { -1.0 } else { 1.0 };
        let across = f64::from(of).sqrt().floor().max(1.0);
        let strata = across * across;
        let number = f64::from(number);
        let u = if number < strata {
            DVec2::new((number % across + rng.uniform()) / across, ((number / across).floor() + rng.uniform()) / across)
        } else {
            DVec2::new(rng.uniform(), rng.uniform())
        };
        let (radius, angle) = (u.x.sqrt(), TAU * u.y);
        let (x, y) = n.any_orthonormal_pair();
        let direction = x * (radius * angle.cos()) + y * (radius * angle.sin()) + n * (1.0 - u.x).max(0.0).sqrt();
        Ray { origin, direction: direction.normalize(), t_min: offset, t_max: f64::INFINITY }
    }

    /// Single-sided surfaces are not there from behind.
    fn is_there(&self, ray: &Ray, hit: &Hit) -> bool {
        self.backs[hit.index] != NONE || self.bvh.triangles[hit.index].cross().dot(ray.direction) <= 0.0
    }

    /// The side that a ray has met.
    fn side_of(&self, ray: &Ray, hit: &Hit) -> usize {
        let from_behind = self.bvh.triangles[hit.index].cross().dot(ray.direction) > 0.0;
        if from_behind { self.backs[hit.index] as usize } else { hit.index }
    }

    /// E: what each side emits, nit.
    pub fn emission(&self) -> Vec<DVec3> {
        self.sides.iter().map(|side| side.emission).collect()
    }

    /// K applied to the radiance that sides send off; without what the sky sends, which is in [`Transport::from_sky`].
    pub fn apply(&self, radiance: &[DVec3]) -> Vec<DVec3> {
        let count = self.sides.len();
        (0..count)
            .into_par_iter()
            .map(|i| {
                let row = &self.form_factors[i * count..(i + 1) * count];
                let arriving = row.iter().zip(radiance).fold(DVec3::ZERO, |sum, (&f, &l)| sum + f64::from(f) * l);
                self.sides[i].albedo * arriving
            })
            .collect()
    }

    /// Light of the sky after one scattering, nit.
    pub fn from_sky(&self) -> &[DVec3] {
        &self.from_sky
    }

    /// The terms E, KE, K²E, … KⁿE; of the sky the first is what the camera sees of it, which no side sends off.
    pub fn terms(&self, n: usize) -> Vec<Vec<DVec3>> {
        let mut terms = vec![self.emission()];
        for scatterings in 1..=n {
            let mut next = self.apply(&terms[scatterings - 1]);
            if scatterings == 1 {
                next.iter_mut().zip(&self.from_sky).for_each(|(term, sky)| *term += *sky);
            }
            terms.push(next);
        }
        terms
    }

    /// The radiance L of each side that solves (I − K)L = E, nit, and how many sweeps over the equations it took (Gauss–Seidel, to
    /// 1e-10 of the greatest).
    pub fn solve(&self) -> (Vec<DVec3>, usize) {
        let count = self.sides.len();
        let source: Vec<DVec3> =
            self.sides.iter().zip(&self.from_sky).map(|(side, sky)| side.emission + *sky).collect();
        let mut radiance = source.clone();
        for sweep in 1..1000 {
            let (mut moved, mut most) = (0.0_f64, 0.0_f64);
            for i in 0..count {
                let row = &self.form_factors[i * count..(i + 1) * count];
                let arriving = row.iter().zip(&radiance).fold(DVec3::ZERO, |sum, (&f, &l)| sum + f64::from(f) * l);
                let next = source[i] + self.sides[i].albedo * arriving;
                moved = moved.max((next - radiance[i]).abs().max_element());
                most = most.max(next.max_element());
                radiance[i] = next;
            }
            if moved <= 1e-10 * most {
                return (radiance, sweep);
            }
        }
        (radiance, 1000)
    }

    /// The spectral radius of K, for the channel that fades least: power iteration, to about 1e-6. Below one the series
    /// converges, each term being this share of the one before in the end.
    pub fn spectral_radius(&self) -> f64 {
        let mut vector = vec![DVec3::ONE; self.sides.len()];
        let mut radius = 0.0;
        for _ in 0..200 {
            let next = self.apply(&vector);
            let norm = |v: &[DVec3]| v.iter().fold(DVec3::ZERO, |sum, l| sum + *l * *l).map(f64::sqrt);
            let grown = norm(&next) / norm(&vector).max(DVec3::splat(f64::MIN_POSITIVE));
            let now = grown.max_element();
            let settled = (now - radius).abs() < 1e-7 * now.max(1e-300);
            radius = now;
            let scale = norm(&next).max(DVec3::splat(f64::MIN_POSITIVE)).recip();
            vector = next.into_iter().map(|l| l * scale).collect();
            if settled {
                break;
            }
        }
        radius
    }

    /// The mean radiance over the pixels of a camera's picture of such a size, each looked through at so many places, if sides send off
    /// `radiance`; the sky counts only if `sky`.
    pub fn mean_of_view(
        &self,
        scene: &FlatScene,
        radiance: &[DVec3],
        [width, height]: [u32; 2],
        spp: u32,
        sky: bool,
    ) -> DVec3 {
        let rows: Vec<DVec3> = (0..height)
            .into_par_iter()
            .map(|y| {
                let mut rng = Rng::new(1, u64::from(y));
                let mut sum = DVec3::ZERO;
                for (x, _) in (0..width).flat_map(|x| (0..spp).map(move |s| (x, s))) {
                    let film = DVec2::new(f64::from(x) + rng.uniform(), f64::from(y) + rng.uniform());
                    let (origin, direction) = camera_ray(&scene.camera, film, width, height);
                    let ray = Ray { origin, direction, t_min: 0.0, t_max: f64::INFINITY };
                    sum += match self.bvh.intersect(&ray, &mut |hit| self.is_there(&ray, hit)) {
                        Some(hit) => radiance[self.side_of(&ray, &hit)],
                        None if sky && self.scene_has_sky => self.sky(scene, direction),
                        None => DVec3::ZERO,
                    };
                }
                sum
            })
            .collect();
        rows.into_iter().fold(DVec3::ZERO, |sum, row| sum + row) / f64::from(width * height * spp)
    }
}

/// Halves a triangle across its longest edge until none is longer than `edge`.
fn cut(triangle: Triangle, edge: f64, patches: &mut Vec<Triangle>) {
    let corners = [triangle.p0, triangle.p0 + triangle.e1, triangle.p0 + triangle.e2];
    let length = |i: usize| (corners[(i + 1) % 3] - corners[i]).length();
    let longest = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).unwrap_or(0);
    if length(longest) <= edge || patches.len() > MOST_SIDES {
        patches.push(triangle);
        return;
    }
    let [a, b, c] = [0, 1, 2].map(|i| corners[(longest + i) % 3]);
    let middle = 0.5 * (a + b);
    for [p, q, r] in [[a, middle, c], [middle, b, c]] {
        cut(Triangle { p0: p, e1: q - p, e2: r - p, ..triangle }, edge, patches);
    }
}
