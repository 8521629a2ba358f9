//! One of all lights: those that are somewhere, those that are infinitely far away, and the sky.

use wide::f32x8;

use super::{Choices, Chosen, Emitter, LightTree, Receiver, Receivers};
use crate::simd::{LANES, Mask, Real};

/// Lights infinitely far away, by how much they bring to a surface that faces them.
#[derive(Clone, Debug, Default, PartialEq)]
struct Far {
    to_light: Vec<[f32; 3]>,
    /// lx.
    illuminance: Vec<f32>,
}

impl Far {
    /// What one brings; a bit even where the surface turns away by no more than rounding.
    #[inline]
    fn brings(&self, row: usize, at: &Receiver) -> f32 {
        let (d, n) = (self.to_light[row], at.n);
        let cos = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];
        self.illuminance[row] * (cos + 2e-4).max(0.0)
    }

    fn all(&self, at: &Receiver) -> f32 {
        (0..self.illuminance.len()).map(|row| self.brings(row, at)).sum()
    }
}

/// Chooses one light for a point, by what it may bring there.
///
/// Rows are those of the lights that are somewhere, then those far away, then the sky.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightChoice {
    near: LightTree,
    /// Rows that are somewhere.
    near_rows: u32,
    far: Far,
    /// What the part of the sky that is looked for brings on average, lx.
    sky: f32,
}

/// Of the three kinds, how likely each is.
#[derive(Clone, Copy)]
struct Shares {
    near: f32,
    far: f32,
    sky: f32,
    /// What all that are far away bring, lx.
    all_far: f32,
}

/// Share of the choice of a kind that is left to chance: what is in the way is not known, and may leave but one of them.
const EVEN: f32 = 0.25;

/// Probability of the side.
#[inline(always)]
fn of_side(at: &Receiver) -> f32 {
    if at.halved { 0.5 } else { 1.0 }
}

impl LightChoice {
    /// Of lights that are somewhere, of lights far away given by direction and illuminance (lx), and of a sky that brings so much on
    /// average, lx; zero if it is not to be looked for.
    pub fn new(near: &[Emitter], far: impl IntoIterator<Item = ([f32; 3], f32)>, sky: f32) -> Self {
        let (to_light, illuminance) = far.into_iter().unzip();
        Self { near: LightTree::new(near), near_rows: near.len() as u32, far: Far { to_light, illuminance }, sky }
    }

    /// Rows.
    pub fn len(&self) -> usize {
        self.near_rows as usize + self.far.illuminance.len() + usize::from(self.sky > 0.0)
    }

    /// True if there is nothing to choose.
    pub fn is_empty(&self) -> bool {
        self.near.is_empty() && self.far.illuminance.is_empty() && self.sky <= 0.0
    }

    /// The light that is somewhere, if there is no other.
    pub fn alone(&self) -> Option<u32> {
        self.near.alone().filter(|_| !self.depends_on_place())
    }

    /// True if it matters from where a light is chosen: among several; and one that is far away is not chosen where a surface
    /// turns away from it.
    pub fn depends_on_place(&self) -> bool {
        !self.far.illuminance.is_empty() || self.near.lights() + usize::from(self.sky > 0.0) > 1
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.near.bytes() + self.far.illuminance.len() * 16
    }

    /// The first row of those far away.
    fn first_far(&self) -> u32 {
        self.near_rows
    }

    /// The row of the sky.
    fn sky_row(&self) -> u32 {
        self.near_rows + self.far.illuminance.len() as u32
    }

    #[inline]
    fn shares(&self, at: &Receiver) -> Shares {
        let only = |near, far, sky, all_far| Shares { near, far, sky, all_far };
        let all_far = self.far.all(at);
        match (!self.near.is_empty(), all_far > 0.0, self.sky > 0.0) {
            (false, false, false) => return only(0.0, 0.0, 0.0, 0.0),
            (true, false, false) => return only(1.0, 0.0, 0.0, 0.0),
            (false, true, false) => return only(0.0, 1.0, 0.0, all_far),
            (false, false, true) => return only(0.0, 0.0, 1.0, 0.0),
            _ => {}
        }
        let near = self.near.illuminance(at);
        let bring = [near, all_far, self.sky].map(|lux| if lux.is_finite() { lux } else { f32::MAX / 4.0 });
        let (all, kinds) = (bring.iter().sum::<f32>(), bring.iter().filter(|&&lux| lux > 0.0).count() as f32);
        let share = |lux: f32| if lux > 0.0 { (1.0 - EVEN) * (lux / all) + EVEN / kinds } else { 0.0 };
        only(share(bring[0]), share(bring[1]), share(bring[2]), all_far)
    }

    /// A light, and with which probability, that of the side included; none if nothing can arrive.
    #[inline]
    pub fn sample(&self, at: &Receiver, u: f64) -> Option<Chosen> {
        self.sample_each(&(*at).into(), [u; LANES], 1).lane(0)
    }

    /// As [`LightChoice::sample`] for several places, those of `lanes`.
    #[inline]
    pub fn sample_each(&self, at: &Receivers, u: [f64; LANES], lanes: u32) -> Choices {
        let of_side = Real::select(Mask::from_bits(at.halved), f32x8::HALF, f32x8::ONE);
        if self.far.illuminance.is_empty() && self.sky <= 0.0 {
            let mut chosen = self.near.sample_each(at, u, lanes);
            chosen.pmf *= of_side;
            return chosen;
        }
        if self.near.is_empty() && self.far.illuminance.is_empty() {
            return Choices { row: [self.sky_row(); LANES], pmf: of_side, rest: u, lanes };
        }
        let mut chosen = Choices { row: [0; LANES], pmf: f32x8::ZERO, rest: u, lanes: 0 };
        let (mut pmf, mut near) = ([0.0; LANES], 0);
        for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
            let (at, u) = (at.lane(lane), &mut chosen.rest[lane]);
            let of = self.shares(&at);
            if *u < f64::from(of.near) {
                *u = if of.near < 1.0 { *u / f64::from(of.near) } else { *u };
                pmf[lane] = of.near;
                near |= 1 << lane;
            } else if let Some(far) = self.far_away(&at, *u, of) {
                (chosen.row[lane], pmf[lane], *u) = (far.row, far.pmf, far.rest);
                chosen.lanes |= 1 << lane;
            }
        }
        chosen.pmf = f32x8::new(pmf);
        if near != 0 {
            let from_near = self.near.sample_each(at, chosen.rest, near);
            for lane in (0..LANES).filter(|lane| near >> lane & 1 == 1) {
                (chosen.row[lane], chosen.rest[lane]) = (from_near.row[lane], from_near.rest[lane]);
            }
            chosen.pmf = Real::select(Mask::from_bits(near), from_near.pmf * chosen.pmf, chosen.pmf);
            chosen.lanes |= from_near.lanes;
        }
        chosen.pmf *= of_side;
        chosen
    }

    /// Of those that are nowhere.
    #[inline(always)]
    fn far_away(&self, at: &Receiver, u: f64, Shares { near, far, sky, all_far }: Shares) -> Option<Chosen> {
        let (to_near, to_far) = (f64::from(near), f64::from(near) + f64::from(far));
        if u < to_far || (far > 0.0 && sky == 0.0) {
            let x = (u - to_near) / (to_far - to_near) * f64::from(all_far);
            let (mut below, mut chosen) = (0.0_f32, None);
            for row in 0..self.far.illuminance.len() {
                let brings = self.far.brings(row, at);
                if brings > 0.0 && f64::from(below) <= x {
                    let rest = ((x - f64::from(below)) / f64::from(brings)).min(1.0 - f64::EPSILON / 2.0);
                    chosen = Some(Chosen { row: self.first_far() + row as u32, pmf: far * (brings / all_far), rest });
                }
                below += brings;
            }
            return chosen;
        }
        let rest = ((u - to_far) / f64::from(sky)).clamp(0.0, 1.0 - f64::EPSILON / 2.0);
        (sky > 0.0).then_some(Chosen { row: self.sky_row(), pmf: sky, rest })
    }

    /// Probability with which [`LightChoice::sample`] gives a light that is somewhere.
    #[inline]
    pub fn near_pmf(&self, row: u32, at: &Receiver) -> f32 {
        self.near.pmf(row, at) * self.shares(at).near * of_side(at)
    }

    /// Probability with which [`LightChoice::sample`] gives the sky.
    #[inline]
    pub fn sky_pmf(&self, at: &Receiver) -> f32 {
        if self.sky > 0.0 { self.shares(at).sky * of_side(at) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests;
