//! The three versions against plain formulas, quadrature and statistics.

// Vectors are walked by component.
#![allow(clippy::needless_range_loop)]

mod chi_square;
mod delta;
mod energy;
mod plain;
mod robust;
mod twin;

use wide::f32x8;

use super::{Bsdf, Params, Sampled};
use crate::simd::{Mask, Real, V3};

/// A surface in double precision, one lane.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Surface {
    base_color: [f64; 3],
    metallic: f64,
    roughness: f64,
    specular: f64,
    specular_color: [f64; 3],
    ior: f64,
    transmission: f64,
    solid: bool,
    inside: bool,
}

const LAMBERT: Surface = Surface {
    base_color: [0.8, 0.5, 0.2],
    metallic: 0.0,
    roughness: 1.0,
    specular: 0.0,
    specular_color: [1.0; 3],
    ior: 1.5,
    transmission: 0.0,
    solid: false,
    inside: false,
};
const PLASTIC: Surface = Surface { specular: 1.0, ..LAMBERT };
const METAL: Surface = Surface { metallic: 1.0, base_color: [1.0, 0.7, 0.3], ..PLASTIC };
const THIN: Surface = Surface { transmission: 1.0, base_color: [0.9, 1.0, 0.7], ..PLASTIC };
const ENTERING: Surface = Surface { solid: true, ..THIN };
const LEAVING: Surface = Surface { inside: true, ..ENTERING };
/// A bit of everything.
const MIXED: Surface =
    Surface { metallic: 0.2, transmission: 0.6, specular: 0.8, specular_color: [1.3, 0.6, 1.0], ..ENTERING };
const MIXED_THIN: Surface = Surface { solid: false, ior: 1.8, ..MIXED };

impl Surface {
    /// The same in all lanes.
    fn params<F: Real>(&self) -> Params<F> {
        let rgb = |c: [f64; 3]| V3::from_array(c.map(|c| c as f32));
        let roughness = self.roughness as f32;
        Params {
            base_color: rgb(self.base_color),
            metallic: F::splat(self.metallic as f32),
            alpha: F::splat(roughness * roughness),
            specular: F::splat(self.specular as f32),
            specular_color: rgb(self.specular_color),
            ior: F::splat(self.ior as f32),
            transmission: F::splat(self.transmission as f32),
            solid: F::Mask::splat(self.solid),
            inside: F::Mask::splat(self.inside),
        }
    }
    /// Stands for the shading class.
    fn is_opaque(&self) -> bool {
        self.transmission == 0.0
    }
    /// Factor of radiance on crossing.
    fn eta(&self) -> f64 {
        if !self.solid {
            1.0
        } else if self.inside {
            1.0 / self.ior
        } else {
            self.ior
        }
    }
}

/// Eight different surfaces, one to a lane.
fn gather(surfaces: &[Surface; 8]) -> Params<f32x8> {
    let each = surfaces.map(|s| s.params::<f32>());
    let mask =
        |f: fn(&Params<f32>) -> bool| Mask::from_bits(each.iter().enumerate().map(|(i, p)| u32::from(f(p)) << i).sum());
    Params {
        base_color: V3::from_fn(|i| each[i].base_color.lane(0)),
        metallic: Real::from_fn(|i| each[i].metallic),
        alpha: Real::from_fn(|i| each[i].alpha),
        specular: Real::from_fn(|i| each[i].specular),
        specular_color: V3::from_fn(|i| each[i].specular_color.lane(0)),
        ior: Real::from_fn(|i| each[i].ior),
        transmission: Real::from_fn(|i| each[i].transmission),
        solid: mask(|p| p.solid),
        inside: mask(|p| p.inside),
    }
}

/// What [`Bsdf::sample`] says of one lane.
#[derive(Clone, Copy, Debug)]
struct Draw {
    wi: [f64; 3],
    weight: [f64; 3],
    pdf: f64,
    delta: bool,
    transmitted: bool,
    valid: bool,
    eta_scale: f64,
}

fn lanes<F: Real>(s: &Sampled<F>) -> impl Iterator<Item = Draw> + use<'_, F> {
    (0..F::LANES).map(|i| Draw {
        wi: s.wi.lane(i).map(f64::from),
        weight: s.weight.lane(i).map(f64::from),
        pdf: f64::from(s.pdf.lane(i)),
        delta: s.delta.bits() >> i & 1 == 1,
        transmitted: s.transmitted.bits() >> i & 1 == 1,
        valid: s.valid.bits() >> i & 1 == 1,
        eta_scale: f64::from(s.eta_scale.lane(i)),
    })
}

/// `blocks` times eight draws from one surface.
fn draws<B: Bsdf>(surface: &Surface, wo: [f64; 3], blocks: usize, rng: &mut Rng) -> Vec<Draw> {
    let prepared = B::prepare::<f32x8>(&surface.params(), vec(wo));
    let mut out = Vec::with_capacity(8 * blocks);
    for _ in 0..blocks {
        let s = B::sample(&prepared, rng.block(), (rng.block(), rng.block()));
        out.extend(lanes(&s));
    }
    out
}

/// SplitMix64 (Steele, Lea, Flood 2014).
struct Rng(u64);

impl Rng {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }
    /// In [0, 1), 24 bits as the samplers give.
    fn unit(&mut self) -> f64 {
        (self.next() >> 40) as f64 / 16_777_216.0
    }
    fn block(&mut self) -> f32x8 {
        Real::from_fn(|_| self.unit() as f32)
    }
    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[(self.next() % from.len() as u64) as usize]
    }
    /// Uniform over the sphere, or close to the horizon or the pole.
    fn direction(&mut self) -> [f64; 3] {
        let z = match self.next() % 4 {
            0 => self.unit() * 1e-3,
            1 => 1.0 - self.unit() * 1e-3,
            _ => self.unit(),
        };
        let sign = if self.next() & 1 == 0 { 1.0 } else { -1.0 };
        direction(sign * z.max(1e-6), self.unit() * std::f64::consts::TAU)
    }
    fn direction_up(&mut self) -> [f64; 3] {
        let [x, y, z] = self.direction();
        [x, y, z.abs()]
    }
    fn surface(&mut self) -> Surface {
        let color = |rng: &mut Self| [(); 3].map(|()| rng.unit());
        let base_color = color(self);
        let tint = color(self).map(|c| 2.0 * c);
        let (m, s, t) = (self.unit(), self.unit(), self.unit());
        Surface {
            base_color: self.pick(&[base_color, base_color, [0.0; 3], [1.0; 3]]),
            metallic: self.pick(&[0.0, 1.0, m]),
            roughness: self.pick(&[0.0, 0.005, 0.011, 0.03, 0.1, 0.3, 0.6, 1.0]),
            specular: self.pick(&[0.0, 1.0, s]),
            specular_color: self.pick(&[[1.0; 3], [0.0; 3], tint]),
            ior: self.pick(&[0.0, 1.0, 1.0 + 1e-6, 1.0003, 1.1, 1.33, 1.5, 4.0]),
            transmission: self.pick(&[0.0, 1.0, t]),
            solid: self.next() & 1 == 0,
            inside: self.next() & 1 == 0,
        }
    }
}

fn direction(z: f64, phi: f64) -> [f64; 3] {
    let r = (1.0 - z * z).max(0.0).sqrt();
    [r * phi.cos(), r * phi.sin(), z]
}

/// `wo` in the plane of x and z.
fn at_degrees(angle: f64) -> [f64; 3] {
    let (sin, cos) = angle.to_radians().sin_cos();
    [sin, 0.0, cos]
}

fn vec<F: Real>(v: [f64; 3]) -> V3<F> {
    V3::from_array(v.map(|v| v as f32))
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Value and density in one lane.
fn eval_one<B: Bsdf>(surface: &Surface, wo: [f64; 3], wi: [f64; 3]) -> ([f64; 3], f64) {
    let (f, pdf) = B::eval(&B::prepare::<f32>(&surface.params(), vec(wo)), vec(wi));
    (f.lane(0).map(f64::from), f64::from(pdf))
}
