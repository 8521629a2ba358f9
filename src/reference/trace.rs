//! The rendering equation, by recursion.

mod whitted;

use glam::DVec3;

use super::{
    ReferenceSettings, Technique,
    bsdf::{self, BsdfSample, Lobe},
    geometry::{Bvh, Hit, Ray, world_triangles},
    lights::{Light, LightTable},
    rng::Rng,
    shapes::{Placed, placed_shapes},
    surface::{Place, ShadingPoint},
};
use crate::flat::FlatScene;

/// A scene made ready for rays.
#[derive(Debug)]
pub struct Tracer<'a> {
    scene: &'a FlatScene,
    bvh: Bvh,
    shapes: Vec<Placed>,
    lights: LightTable<'a>,
    max_depth: u32,
    least_lift: f64,
    transparent: bool,
    lobes: Vec<Lobe>,
    technique: Technique,
    /// Rays leave a surface this far from it, m: above the rounding of f64, below any detail.
    offset: f64,
}

/// How a ray was come by, which decides who else could have found what it meets.
#[derive(Clone, Copy)]
enum Arrival {
    Camera,
    /// Through a delta: only so.
    Delta,
    /// With this density, 1/sr; also by looking for lights.
    Scattered(f64),
}

impl Arrival {
    /// Weight of finding light this way rather than by looking for it with density `pdf`
    /// (power heuristic; Veach, Guibas 1995, "Optimally Combining Sampling Techniques", section 3.4).
    fn weight(self, pdf: f64, technique: Technique) -> f64 {
        match (self, technique) {
            (Self::Camera | Self::Delta, _) | (_, Technique::Bsdf) => 1.0,
            (Self::Scattered(own), Technique::Both) => power_heuristic(own, pdf),
            // What cannot be looked for is met all the same.
            (_, Technique::Lights) => f64::from(u8::from(pdf == 0.0)),
        }
    }
}

fn power_heuristic(own: f64, other: f64) -> f64 {
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

/// What a ray meets first.
#[derive(Clone, Copy)]
enum Met {
    Triangle(Hit),
    /// Index of the shape, distance, point in its space.
    Shape(usize, f64, DVec3),
}

impl Met {
    fn t(&self) -> f64 {
        match self {
            Self::Triangle(hit) => hit.t,
            Self::Shape(_, t, _) => *t,
        }
    }
}

/// What a path carries from one surface to the next.
#[derive(Clone, Copy)]
struct Path {
    ray: Ray,
    arrival: Arrival,
    /// Scatterings so far.
    depth: u32,
    /// Row of the material of the solid that the path is known to be in.
    inside: Option<u32>,
    /// Light at the start per light here, for Russian roulette alone.
    throughput: DVec3,
}

impl<'a> Tracer<'a> {
    /// Builds the tree and the table of lights; of the settings only what does not concern the film is used.
    pub fn new(scene: &'a FlatScene, settings: &ReferenceSettings) -> Self {
        let bvh = Bvh::new(world_triangles(scene));
        let shapes = placed_shapes(scene);
        let scale = shapes.iter().map(Placed::reach).fold(bvh.scale(), f64::max);
        let lights = LightTable::new(scene, &bvh.triangles, &shapes, scale);
        Self {
            scene,
            lights,
            max_depth: settings.max_depth.unwrap_or(u32::MAX),
            // Lower ones could not be told from none: a ray would start past the facet it was lifted from.
            least_lift: if settings.terminator_fix { 1e-8 * scale } else { f64::INFINITY },
            transparent: settings.transparent,
            lobes: settings.lobes.clone(),
            technique: settings.technique,
            offset: 1e-9 * scale,
            bvh,
            shapes,
        }
    }

    /// An unbiased estimate of the radiance, nit, that a camera ray sees between two distances along it.
    pub fn radiance(&self, origin: DVec3, direction: DVec3, t_min: f64, t_max: f64, rng: &mut Rng) -> DVec3 {
        let ray = Ray { origin, direction: direction.normalize(), t_min, t_max };
        self.incident(Path { ray, arrival: Arrival::Camera, depth: 0, inside: None, throughput: DVec3::ONE }, rng)
    }

    /// L: what the path's ray sees.
    fn incident(&self, path: Path, rng: &mut Rng) -> DVec3 {
        let wo = -path.ray.direction;
        let Some(hit) = self.meet(&path.ray, rng) else {
            let hidden = self.transparent && matches!(path.arrival, Arrival::Camera);
            let weight = path.arrival.weight(self.lights.sky_pdf(-wo), self.technique);
            return if hidden { DVec3::ZERO } else { weight * self.lights.sky(-wo) };
        };
        let place = self.place(&hit);
        let transmittance = self.transmittance(path.inside, &place, wo, hit.t());
        let found = self.found_pdf(&hit, wo);
        let emitted = path.arrival.weight(found, self.technique) * place.emission(wo);
        if place.is_unlit() || path.depth >= self.max_depth {
            return transmittance * emitted;
        }
        let point = place.shading(wo, self.least_lift);
        let path = Path { throughput: path.throughput * transmittance, ..path };
        transmittance * (emitted + self.direct(&path, &place, &point, rng) + self.indirect(&path, &place, &point, rng))
    }

    /// The part of the scattered light that comes straight from lights, by looking for one of them.
    fn direct(&self, path: &Path, place: &Place, point: &ShadingPoint, rng: &mut Rng) -> DVec3 {
        let Some((light, probability)) = self.lights.choose(rng.uniform()) else { return DVec3::ZERO };
        let wo = -path.ray.direction;
        let target = match light {
            Light::Triangle(index) => {
                let root = rng.uniform().sqrt();
                let b2 = root * rng.uniform();
                Target::At(self.bvh.triangles[index].point(root - b2, b2))
            }
            Light::Shape(index) => {
                let shape = &self.shapes[index];
                Target::At(shape.facet(shape.sample(rng)).p0)
            }
            Light::Local(row) => Target::At(self.lights.position(row)),
            Light::Distant(row) => Target::Towards(self.lights.distant(row).0),
            Light::Map => Target::Towards(self.lights.sample_sky(rng)),
        };
        let Some((origin, wi, distance)) = point.leave_for(target) else { return DVec3::ZERO };
        let f = point.eval(wo, wi, self.lobe(path));
        if f == DVec3::ZERO {
            return DVec3::ZERO;
        }
        let scattered = point.pdf(wo, wi);
        let inside = point.inside_after(wi, path.inside, place);
        let mut ray = Ray { origin, direction: wi, t_min: self.offset, t_max: f64::INFINITY };
        match light {
            Light::Triangle(_) | Light::Shape(_) => match self.meet(&ray, rng) {
                Some(hit) if self.is_on(&hit, light, distance) => {
                    let there = self.place(&hit);
                    let pdf = self.found_pdf(&hit, wi);
                    let emitted = self.transmittance(inside, &there, -wi, hit.t()) * there.emission(-wi);
                    f * emitted * self.looked_for(pdf, scattered) / pdf
                }
                _ => DVec3::ZERO,
            },
            Light::Local(row) => {
                ray.t_max = distance - self.offset;
                let clear = self.absorbed(inside, distance);
                let open = self.meet(&ray, rng).is_none();
                if open { f * clear * self.lights.illuminance(row, wi, distance) / probability } else { DVec3::ZERO }
            }
            _ if self.meet(&ray, rng).is_some() => DVec3::ZERO,
            Light::Distant(row) => f * self.lights.distant(row).1 / probability,
            Light::Map => {
                let pdf = self.lights.sky_pdf(wi);
                f * self.lights.sky(wi) * self.looked_for(pdf, scattered) / pdf
            }
        }
    }

    /// The scattered light, but for what [`Self::direct`] has found, by looking where the surface scatters to.
    fn indirect(&self, path: &Path, place: &Place, point: &ShadingPoint, rng: &mut Rng) -> DVec3 {
        let u = std::array::from_fn(|_| rng.uniform());
        let Some((BsdfSample { wi, mut weight, pdf }, origin)) = point.sample(-path.ray.direction, u) else {
            return DVec3::ZERO;
        };
        if let Some(lobe) = self.lobe(path) {
            weight *= point.share(-path.ray.direction, wi, pdf.is_none(), lobe);
            if weight == DVec3::ZERO {
                return weight;
            }
        }
        // Russian roulette: dim paths end early, and all of them in time.
        let throughput = path.throughput * weight;
        let survival = match path.depth {
            0..4 => 1.0,
            4..200 => throughput.max_element().min(0.99),
            _ => throughput.max_element().min(0.9),
        };
        if rng.uniform() >= survival {
            return DVec3::ZERO;
        }
        let next = Path {
            ray: Ray { origin, direction: wi, t_min: self.offset, t_max: f64::INFINITY },
            arrival: pdf.map_or(Arrival::Delta, Arrival::Scattered),
            depth: path.depth + 1,
            inside: point.inside_after(wi, path.inside, place),
            throughput: throughput / survival,
        };
        weight / survival * self.incident(next, rng)
    }

    /// Weight of looking for a light with density `pdf` rather than meeting it with density `scattered`.
    fn looked_for(&self, pdf: f64, scattered: f64) -> f64 {
        match self.technique {
            Technique::Both => power_heuristic(pdf, scattered),
            Technique::Lights => 1.0,
            Technique::Bsdf => 0.0,
        }
    }

    /// The only lobe that scatters a path, if it is but one.
    fn lobe(&self, path: &Path) -> Option<Lobe> {
        self.lobes.get(path.depth as usize).copied()
    }

    /// The nearest surface that is there for this ray: covered, and not a back that is culled.
    fn meet(&self, ray: &Ray, rng: &mut Rng) -> Option<Met> {
        let mut is_there = |met: &Met| self.place(met).is_met(ray.direction, || rng.uniform());
        let mut nearest = self.bvh.intersect(ray, &mut |hit| is_there(&Met::Triangle(*hit))).map(Met::Triangle);
        for (index, shape) in self.shapes.iter().enumerate() {
            for (t, p) in shape.crossings(ray) {
                let met = Met::Shape(index, t, p);
                let is_nearer = nearest.is_none_or(|old| (t, shape.instance) < (old.t(), self.instance(&old)));
                if is_nearer && is_there(&met) {
                    nearest = Some(met);
                }
            }
        }
        nearest
    }

    fn instance(&self, met: &Met) -> u32 {
        match met {
            Met::Triangle(hit) => self.bvh.triangles[hit.index].instance,
            Met::Shape(index, ..) => self.shapes[*index].instance,
        }
    }

    fn place(&self, met: &Met) -> Place<'a> {
        match met {
            Met::Triangle(hit) => Place::new(self.scene, &self.bvh.triangles[hit.index], hit),
            Met::Shape(index, _, p) => Place::on_shape(self.scene, &self.shapes[*index], *p),
        }
    }

    /// Density, 1/sr, with which a point is looked for as a light from where a ray along ±`direction` has come from.
    fn found_pdf(&self, met: &Met, direction: DVec3) -> f64 {
        match met {
            Met::Triangle(hit) => self.lights.triangle_pdf(hit.index, &self.bvh.triangles[hit.index], direction, hit.t),
            Met::Shape(index, t, p) => self.lights.shape_pdf(*index, &self.shapes[*index], *p, direction, *t),
        }
    }

    /// Whether what is met is the point of the light that was looked for: a shape may hide its own far side.
    fn is_on(&self, met: &Met, light: Light, distance: f64) -> bool {
        match met {
            Met::Triangle(hit) => light == Light::Triangle(hit.index),
            Met::Shape(index, t, _) => light == Light::Shape(*index) && (t - distance).abs() <= 1e-6 * distance,
        }
    }

    /// What is left, per channel, of light that came from `place` over the distance `t`.
    fn transmittance(&self, inside: Option<u32>, place: &Place, wo: DVec3, t: f64) -> DVec3 {
        let found_inside = place.is_back_of_solid(wo).then_some(place.material_row);
        self.absorbed(inside.or(found_inside), t)
    }

    /// What is left, per channel, of light after a distance in a solid.
    fn absorbed(&self, inside: Option<u32>, distance: f64) -> DVec3 {
        inside.map_or(DVec3::ONE, |row| {
            let absorption = self.scene.materials.absorption[row as usize].map(f64::from);
            (-distance * DVec3::from_array(absorption)).exp()
        })
    }
}

/// Where to look for a light.
#[derive(Clone, Copy)]
enum Target {
    At(DVec3),
    Towards(DVec3),
}

impl ShadingPoint {
    /// Start, direction and distance of a ray to `target`: from the lifted point if it reflects.
    fn leave_for(&self, target: Target) -> Option<(DVec3, DVec3, f64)> {
        let from = |origin: DVec3| match target {
            Target::At(q) => (origin, (q - origin).normalize_or_zero(), (q - origin).length()),
            Target::Towards(wi) => (origin, wi, f64::INFINITY),
        };
        let reflected = from(self.p_lifted);
        if self.local(reflected.1).z > 0.0 {
            return Some(reflected);
        }
        let transmitted = from(self.p);
        (self.local(transmitted.1).z < 0.0).then_some(transmitted)
    }

    fn local(&self, w: DVec3) -> DVec3 {
        self.frame.transpose() * w
    }

    /// Whether the sides of the geometric and of the shading normal agree, or the ray starts above a facet that stands
    /// for a smooth surface and will find out itself whether it meets that facet.
    fn sides_agree(&self, wi: DVec3) -> bool {
        let lifted = self.p_lifted != self.p;
        let z = self.local(wi).z;
        z * self.ng.dot(wi) > 0.0 || (z > 0.0 && lifted)
    }

    /// BSDF, or one lobe of it, times cosine.
    fn eval(&self, wo: DVec3, wi: DVec3, lobe: Option<Lobe>) -> DVec3 {
        if !self.sides_agree(wi) {
            return DVec3::ZERO;
        }
        let wi = self.local(wi);
        let (surface, wo) = (&self.surface, self.local(wo));
        lobe.map_or_else(|| bsdf::eval(surface, wo, wi), |lobe| bsdf::eval_lobe(surface, wo, wi, lobe)) * wi.z.abs()
    }

    /// Of what is scattered along a sampled direction, the share of one lobe.
    fn share(&self, wo: DVec3, wi: DVec3, is_delta: bool, lobe: Lobe) -> DVec3 {
        if is_delta || lobe == Lobe::Singular {
            return if is_delta && lobe == Lobe::Singular { DVec3::ONE } else { DVec3::ZERO };
        }
        let (wo, wi) = (self.local(wo), self.local(wi));
        let all = bsdf::eval(&self.surface, wo, wi);
        bsdf::eval_lobe(&self.surface, wo, wi, lobe) / DVec3::select(all.cmpgt(DVec3::ZERO), all, DVec3::ONE)
    }

    fn pdf(&self, wo: DVec3, wi: DVec3) -> f64 {
        bsdf::pdf(&self.surface, self.local(wo), self.local(wi))
    }

    /// A direction to look into, in world space, and where its ray starts.
    fn sample(&self, wo: DVec3, u: [f64; 4]) -> Option<(BsdfSample, DVec3)> {
        let sample = bsdf::sample(&self.surface, self.local(wo), u)?;
        let wi = self.frame * sample.wi;
        let lifted = sample.wi.z > 0.0 && sample.pdf.is_some();
        let origin = if lifted { self.p_lifted } else { self.p };
        self.sides_agree(wi).then_some((BsdfSample { wi, ..sample }, origin))
    }

    /// The solid that a ray along `wi` is known to be in.
    fn inside_after(&self, wi: DVec3, before: Option<u32>, place: &Place) -> Option<u32> {
        let transmitted = self.local(wi).z < 0.0;
        match (transmitted && place.is_solid(), self.surface.inside) {
            (false, _) => before,
            (true, false) => Some(place.material_row),
            (true, true) => None,
        }
    }
}
