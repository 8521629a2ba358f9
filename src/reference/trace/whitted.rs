//! Whitted's recursive tree in f64, for [`Integrator::Whitted`](crate::render::Integrator::Whitted) to be held against.

use glam::DVec3;

use super::{Met, Ray, Target, Tracer};
use crate::{flat::NONE, reference::bsdf};

/// A ray of the tree with what limits it.
#[derive(Clone, Copy)]
struct Branch {
    ray: Ray,
    depth: u32,
    inside: Option<u32>,
    /// Share of its light that reaches the eye.
    share: DVec3,
}

impl Tracer<'_> {
    /// The light that a ray sees of lamps as points, and by way of mirrors and clear glass down to a depth, nit.
    ///
    /// Branches that bring the eye less than a share of 1e-5 are cut off. Emitting triangles are looked for at their middle, two that
    /// are one parallelogram in the table of lights at its own; there must be no emitting shapes or entities of many such triangles, and
    /// nothing that stops rays at random.
    pub fn whitted(&self, origin: DVec3, direction: DVec3, most: u32) -> DVec3 {
        let ray = Ray { origin, direction: direction.normalize(), t_min: 0.0, t_max: f64::INFINITY };
        self.branch(Branch { ray, depth: 0, inside: None, share: DVec3::ONE }, most)
    }

    fn branch(&self, branch: Branch, most: u32) -> DVec3 {
        let Branch { ray, depth, inside, share } = branch;
        let wo = -ray.direction;
        let Some(hit) = self.meet_surely(&ray) else { return self.lights.sky(-wo) };
        let place = self.place(&hit);
        let keep = self.transmittance(inside, &place, wo, hit.t());
        let emitted = place.emission(wo);
        if place.is_unlit() {
            return keep * emitted;
        }
        let point = place.shading(wo, self.least_lift);
        let mut light = emitted + self.lamps(&point, wo);
        for delta in bsdf::deltas(&point.surface, point.local(wo)) {
            let wi = point.frame * delta.wi;
            let share = share * keep * delta.weight;
            let eta = if delta.wi.z < 0.0 && point.surface.solid { point.surface.eta() } else { 1.0 };
            if depth >= most || (share * eta * eta).max_element() < 1e-5 || !point.sides_agree(wi) {
                continue;
            }
            let ray = Ray { origin: point.p, direction: wi, t_min: self.offset, t_max: f64::INFINITY };
            let next = Branch { ray, depth: depth + 1, inside: point.inside_after(wi, inside, &place), share };
            light += delta.weight * self.branch(next, most);
        }
        keep * light
    }

    fn meet_surely(&self, ray: &Ray) -> Option<Met> {
        self.meet(ray, &mut super::Rng::new(0, 0))
    }

    /// The light of all lamps after one scattering.
    fn lamps(&self, point: &super::ShadingPoint, wo: DVec3) -> DVec3 {
        let lights = &self.scene.lights;
        let vec3 = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let mut light = DVec3::ZERO;
        let mut add = |target: Target, arriving: &dyn Fn(DVec3, f64) -> DVec3, gap: f64| {
            let Some((origin, wi, distance)) = point.leave_for(target) else { return };
            let f = point.eval(wo, wi, None);
            let ray = Ray { origin, direction: wi, t_min: self.offset, t_max: distance - gap };
            if f != DVec3::ZERO && self.meet_surely(&ray).is_none() {
                light += f * arriving(wi, distance);
            }
        };
        for row in 0..lights.triangles.len() {
            let lamp = lights.triangles.row(row);
            assert_eq!(lamp.texture, NONE, "lamps are of one colour here");
            let share = if lamp.four == 1 { 0.5 } else { 1.0 / 3.0 };
            let middle = vec3(lamp.p0) + share * (vec3(lamp.e1) + vec3(lamp.e2));
            let power = vec3(lamp.radiance) * f64::from(lamp.area);
            let arriving = |wi: DVec3, distance: f64| {
                let cos = -wi.dot(vec3(lamp.n));
                let faces = cos > 0.0 || lamp.two_sided == 1;
                if faces { power * cos.abs() / (distance * distance) } else { DVec3::ZERO }
            };
            add(Target::At(middle), &arriving, 1e-6 * self.bvh.scale());
        }
        for row in 0..lights.local.len() {
            let arriving = |wi: DVec3, distance: f64| self.lights.illuminance(row, wi, distance);
            add(Target::At(self.lights.position(row)), &arriving, self.offset);
        }
        for row in 0..lights.distant.len() {
            add(Target::Towards(self.lights.distant(row).0), &|_, _| self.lights.distant(row).1, 0.0);
        }
        light
    }
}
