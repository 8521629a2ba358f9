//! Starts light paths: on an emitter, towards glass.

use glam::Vec3;
use rayon::prelude::*;

use super::{LightPath, targets::Targets};
use crate::{
    flat::{EmissiveTriangles, FlatScene, NONE},
    sampling::{AliasTable, Sampler, lengthen, warp},
    simd::{Bits, Frame, Real, V3},
    wavefront::{caustic, dimensions, direct},
};

type Integer = <f32 as Real>::Bits;

/// Pairs of the sampler that surfaces along a path do not use.
const CHOICE: u32 = 0;
const PLACE: u32 = 1;
const DIRECTION: u32 = u32::MAX;

/// Share of the choice among emitters that is by power alone: what is in the way is not known.
const EVEN: f32 = 0.1;

/// The emitters that light paths start at.
#[derive(Clone, Debug, Default)]
pub struct Emitters {
    choice: AliasTable,
}

/// The corner from which the edges run, and the edges.
fn corners(triangles: &EmissiveTriangles, row: usize) -> [Vec3; 3] {
    [triangles.p0[row], triangles.e1[row], triangles.e2[row]].map(Vec3::from)
}

impl Emitters {
    /// By what they may send to the targets.
    pub fn new(scene: &FlatScene, targets: &Targets) -> Self {
        let triangles = &scene.lights.triangles;
        let weigh = |row: usize| {
            if !caustic::emits(scene, row as u32) {
                return [0.0; 2];
            }
            let [p, e1, e2] = corners(triangles, row);
            let middle = p + (e1 + e2) * if triangles.four[row] == 1 { 0.5 } else { 1.0 / 3.0 };
            let sides = if triangles.two_sided[row] == 1 { 2 } else { 1 };
            let power = triangles.area[row] * triangles.radiance[row].iter().sum::<f32>() * sides as f32;
            let n = Vec3::from(triangles.n[row]);
            let towards = |n: Vec3| (0..targets.len()).map(|row| targets.aim(row, middle, n).weight).sum::<f32>();
            let share = [n, -n].into_iter().take(sides).map(towards).sum::<f32>() / sides as f32;
            [power, power * share]
        };
        let weights: Vec<[f32; 2]> = (0..triangles.len()).into_par_iter().map(weigh).collect();
        let sum = |i: usize| weights.iter().map(|w| f64::from(w[i])).sum::<f64>();
        let (power, sent) = (sum(0), sum(1));
        let share = |w: &[f32; 2]| {
            let by_power = f64::from(w[0]) / power;
            let by_both = if sent > 0.0 { f64::from(w[1]) / sent } else { by_power };
            (f64::from(EVEN) * by_power + f64::from(1.0 - EVEN) * by_both) as f32
        };
        let usable = power > 0.0 && power.is_finite() && sent.is_finite();
        Self {
            choice: if usable {
                AliasTable::new(&weights.iter().map(share).collect::<Vec<_>>())
            } else {
                AliasTable::default()
            },
        }
    }

    /// True if no light path can start.
    pub fn is_empty(&self) -> bool {
        self.choice.is_empty()
    }

    /// A path with the light that it stands for, lm; none if it would miss.
    pub fn start(
        &self,
        scene: &FlatScene,
        targets: &Targets,
        sampler: &Sampler,
        key: u32,
        index: u32,
        lookups: &mut u64,
    ) -> Option<LightPath> {
        let pair =
            |dimension| sampler.pair::<f32>(Integer::splat(key), Integer::splat(index), Integer::splat(dimension));
        let (choice, place) = (pair(CHOICE), pair(PLACE));
        let long = lengthen(choice.0, dimensions::mix(choice.1.to_bits() ^ place.0.to_bits()));
        let (row, rest) = self.choice.sample(long);
        let triangles = &scene.lights.triangles;
        let mut probability = self.choice.pmf(row);
        let row = row as usize;
        let (b1, b2) = if triangles.four[row] == 1 { place } else { warp::triangle(place) };
        let [p, e1, e2] = corners(triangles, row);
        let (mut n, mut back) = (Vec3::from(triangles.n[row]), 0);
        let error = n.abs().dot(Vec3::from(triangles.error[row]));
        if triangles.two_sided[row] == 1 {
            probability *= 0.5;
            (n, back) = if rest < 0.5 { (n, 0) } else { (-n, 1) };
        }
        let p = p + e1 * b1 + e2 * b2 + n * error;

        let all: f32 = (0..targets.len()).map(|row| targets.aim(row, p, n).weight).sum();
        let mut below = choice.1 * all;
        let mut chosen = None;
        for row in 0..targets.len() {
            let aim = targets.aim(row, p, n);
            if aim.weight > 0.0 {
                chosen = Some((row, aim));
                if below < aim.weight {
                    break;
                }
                below -= aim.weight;
            }
        }
        let (target, aim) = chosen?;
        probability *= aim.weight / all;
        let u = pair(DIRECTION);
        let (axis, local, density) = match aim.towards {
            Some(axis) => (axis, warp::uniform_cone(u, aim.one_minus_cos), warp::uniform_cone_pdf(aim.one_minus_cos)),
            None => {
                let local = warp::cosine_hemisphere(u);
                (n, local, warp::cosine_hemisphere_pdf(local.z))
            }
        };
        let direction = Frame::new(V3::<f32>::from_array(axis.to_array())).to_world(local).normalize();
        let cos = Vec3::from(direction.lane(0)).dot(n);
        let mut flux = triangles.radiance[row].map(|le| le * (cos * triangles.area[row] / (probability * density)));
        if triangles.texture[row] != NONE {
            *lookups += 1;
            let texel = direct::texel(scene, row, b1, b2);
            (0..3).for_each(|i| flux[i] *= texel[i]);
        }
        if !(cos > 0.0 && flux.iter().any(|&f| f > 0.0)) {
            return None;
        }
        let [ox, oy, oz] = p.to_array();
        Some(LightPath {
            ox,
            oy,
            oz,
            dx: direction.x,
            dy: direction.y,
            dz: direction.z,
            flux_r: flux[0],
            flux_g: flux[1],
            flux_b: flux[2],
            index,
            depth: 0,
            target: target as u32,
            node: row as u32 * 2 + back,
        })
    }
}
