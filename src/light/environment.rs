//! The sky as a light: look-up, and sampling by texel.
//!
//! A direction belongs to exactly one texel, and texels are chosen by solid angle times how much brighter they are than
//! the mean. What is not brighter is left to scattered rays, which find an even sky as well; so the samples go where
//! those would miss (Karlík, Šik, Vévoda, Skřivan, Křivánek 2019, "MIS Compensation: Optimizing Sampling Techniques in Multiple
//! Importance Sampling", section 5).

use std::f32::consts::{PI, TAU};

use rayon::prelude::*;

use crate::{
    sampling::{AliasTable, warp::sin_cos_twice},
    simd::{LANES, Mask, Real, Rgb, V3},
    world::EnvironmentMap,
};

/// A latitude–longitude map with its exact sampling table.
#[derive(Clone, Debug, Default)]
pub struct EnvironmentTable {
    /// Texels around.
    pub width: u32,
    /// Texels from pole to pole.
    pub height: u32,
    /// Radiance, nit, scale included.
    pub texels: Vec<[f32; 3]>,
    /// Turn about +Y, rad, counter-clockwise seen from above.
    pub rotation: f32,
    /// One row per texel, by solid angle times luminance beyond the mean.
    pub choice: AliasTable,
    /// Sine and cosine of `rotation`.
    pub rotation_sin_cos: [f32; 2],
    /// Density of a direction, 1/sr, by how much brighter than the mean it is; 0 for an even map.
    pub pdf_per_luminance: f32,
    /// The mean luminance over the sphere, nit.
    pub mean: f32,
    /// Share of a texel at each edge where rounding could decide for the neighbour.
    pub seam: f32,
    /// Where texels of a row lie between the nearer pole (0) and its opposite (1), (1 − cosθ)/2: at the edge towards
    /// that pole, and how much more at the other.
    pub band: Vec<[f32; 2]>,
    /// Integral over the sphere of the luminance beyond the mean, lx without a cosine.
    pub beyond_integral: f64,
}

impl EnvironmentTable {
    /// The table of a map whose radiance is multiplied by `scale`.
    ///
    /// The choice is empty if the whole map is as bright everywhere.
    ///
    /// # Panics
    /// If the map has no texel, or not as many as its sides say.
    pub fn new(map: &EnvironmentMap, rotation_degrees: f32, scale: f32) -> Self {
        let (width, height) = (map.width as usize, map.height as usize);
        assert!(width > 0 && height > 0 && map.texels.len() == width * height, "a map is whole");
        let step = std::f64::consts::PI / height as f64;
        // (1 − cosθ)/2 without cancellation, from the pole that is nearer.
        let share = |edge: usize| (0.5 * step * edge as f64).sin().powi(2);
        let bands: Vec<[f64; 2]> = (0..height)
            .map(|row| {
                let row = row.min(height - 1 - row);
                [share(row), share(row + 1) - share(row)]
            })
            .collect();
        let solid_angle = |row: usize| 4.0 * std::f64::consts::PI * bands[row][1] / width as f64;

        let texels: Vec<[f32; 3]> = map.texels.par_iter().map(|texel| texel.map(|v| v * scale)).collect();
        // Of each row, in a fixed order.
        let sums: Vec<f64> = texels
            .par_chunks(width)
            .enumerate()
            .map(|(row, texels)| solid_angle(row) * texels.iter().map(|texel| luminance(*texel)).sum::<f64>())
            .collect();
        let luminance_integral: f64 = sums.iter().sum();
        let mean = (luminance_integral / (4.0 * std::f64::consts::PI)) as f32;
        let mut weights = vec![0.0f32; texels.len()];
        let sums: Vec<f64> = weights
            .par_chunks_mut(width)
            .zip(texels.par_chunks(width))
            .enumerate()
            .map(|(row, (weights, texels))| {
                let solid_angle = solid_angle(row);
                let mut sum = 0.0;
                for (weight, texel) in weights.iter_mut().zip(texels) {
                    let beyond = V3::<f32>::from_array(*texel).luminance() - mean;
                    // An even map is one but for rounding.
                    let power = if beyond > 1e-5 * mean { f64::from(beyond) * solid_angle } else { 0.0 };
                    sum += power;
                    *weight = power as f32;
                }
                sum
            })
            .collect();
        let beyond_integral: f64 = sums.iter().sum();
        let rotation = f64::from(rotation_degrees).to_radians();
        Self {
            width: map.width,
            height: map.height,
            texels,
            rotation: rotation as f32,
            choice: AliasTable::new(&weights),
            rotation_sin_cos: [rotation.sin() as f32, rotation.cos() as f32],
            pdf_per_luminance: if beyond_integral > 0.0 { (1.0 / beyond_integral) as f32 } else { 0.0 },
            mean,
            beyond_integral,
            // Directions are right within 1e-6 rad, which is 3.2e-7 of the texels around or pole to pole; and what is
            // left of a number has few bits.
            seam: 2e-6 * width.max(height) as f32,
            band: bands.iter().map(|band| band.map(|v| v as f32)).collect(),
        }
    }

    /// Row and column, in texels and fractions, of what unit directions in world space meet.
    ///
    /// Right within 1e-6 rad: that near to an edge rounding decides between neighbours.
    #[inline(always)]
    fn place<F: Real>(&self, d: V3<F>) -> (F, F) {
        let [sin, cos] = self.rotation_sin_cos.map(F::splat);
        let (x, z) = (d.x * cos - d.z * sin, d.z * cos + d.x * sin);
        let u = F::splat(0.5) + turns(z, x);
        // The same as acos(y), and as exact near the poles as elsewhere.
        let v = turns((x * x + z * z).sqrt(), d.y);
        (v * F::splat(2.0 * self.height as f32), u * F::splat(self.width as f32))
    }

    /// Index of the texel that holds a place.
    #[inline(always)]
    fn index(&self, row: f32, column: f32) -> usize {
        let (row, column) = (row as u32, column as u32);
        // The last edge is the first one again around, and the pole downwards.
        let column = if column < self.width { column } else { 0 };
        (row.min(self.height - 1) * self.width + column) as usize
    }

    /// Row and column of the texel that a unit direction in world space meets.
    #[inline]
    pub fn texel(&self, d: [f32; 3]) -> (usize, usize) {
        let (row, column) = self.place::<f32>(V3::from_array(d));
        let index = self.index(row, column);
        (index / self.width as usize, index % self.width as usize)
    }

    /// Radiance from a unit direction in world space, nit.
    #[inline]
    pub fn radiance(&self, d: [f32; 3]) -> [f32; 3] {
        self.look_up::<f32>(V3::from_array(d)).0.lane(0)
    }

    /// Density with which [`EnvironmentTable::sample`] gives a unit direction in world space, 1/sr.
    #[inline]
    pub fn pdf(&self, d: [f32; 3]) -> f32 {
        self.look_up::<f32>(V3::from_array(d)).1
    }

    /// [`EnvironmentTable::radiance`] and [`EnvironmentTable::pdf`] of all lanes, for little more than one of them.
    #[inline(always)]
    pub fn look_up<F: Real>(&self, d: V3<F>) -> (Rgb<F>, F) {
        let (row, column) = self.place(d);
        let radiance = Rgb::from_fn(|i| self.texels[self.index(row.lane(i), column.lane(i))]);
        (radiance, self.radiance_pdf(radiance))
    }

    /// Probability of a texel over its solid angle, which cancels.
    #[inline(always)]
    fn radiance_pdf<F: Real>(&self, radiance: Rgb<F>) -> F {
        let beyond = radiance.luminance() - F::splat(self.mean);
        (beyond * F::splat(self.pdf_per_luminance)).masked(beyond.gt(F::splat(1e-5 * self.mean)))
    }

    /// A unit direction in world space with probability by how bright it is there, its density (1/sr) and its radiance (nit).
    ///
    /// `u`, of many more than 24 bits, chooses the texel, `v` a direction inside, uniform in solid angle.
    ///
    /// A direction drawn near an edge may round into the next texel. Density and radiance are those of the texel that
    /// the rounded direction meets, looked up if it is near an edge: bit for bit what [`EnvironmentTable::look_up`] says of it. So weights against other
    /// ways of finding the sky add up to 1, and a sample that strayed from the sun into the dark beside it has the dark
    /// radiance over the dark density. What remains is an error of the true density in a seam as wide as the rounding,
    /// about 1e-7 rad. The density is 0 if it strayed into black.
    ///
    /// # Panics
    /// If the whole map is as bright everywhere.
    #[inline]
    pub fn sample(&self, u: f64, v: (f32, f32)) -> ([f32; 3], f32, [f32; 3]) {
        let (direction, pdf, radiance) = self.sample_each::<f32>(&[u; LANES], v, 1);
        (direction.lane(0), pdf, radiance.lane(0))
    }

    /// As [`EnvironmentTable::sample`], for `lanes`; the others get anything.
    ///
    /// # Panics
    /// If the whole map is as bright everywhere.
    #[inline(always)]
    pub fn sample_each<F: Real>(&self, u: &[f64; LANES], (along, down): (F, F), lanes: u32) -> (V3<F>, F, Rgb<F>) {
        let texel: [u32; LANES] = std::array::from_fn(|lane| {
            if lane < F::LANES && lanes >> lane & 1 == 1 { self.choice.sample(u[lane]).0 } else { 0 }
        });
        let (direction, radiance) = self.in_texels(&texel, (along, down), lanes);
        (direction, self.radiance_pdf(radiance), radiance)
    }

    /// Solid angle of a texel, sr.
    pub fn solid_angle(&self, texel: u32) -> f32 {
        2.0 * TAU * self.band[(texel / self.width) as usize][1] / self.width as f32
    }

    /// Unit directions in world space, each uniform in the solid angle of a texel but for rounding, and the radiance there, nit.
    #[inline(always)]
    pub fn in_texels<F: Real>(&self, texel: &[u32; LANES], (along, down): (F, F), lanes: u32) -> (V3<F>, Rgb<F>) {
        // The texel is fetched before it is sure to be the right one.
        let mut radiance = Rgb::<F>::from_fn(|lane| self.texels[texel[lane] as usize]);
        let [near, extent, column, upwards] = F::columns_of_four(|lane| {
            let (row, column) = (texel[lane] / self.width, texel[lane] % self.width);
            let [near, extent] = self.band[row as usize];
            [near, extent, column as f32, if 2 * row < self.height { 1.0 } else { -1.0 }]
        });
        let one = F::one();
        let share = down.mul_add(extent, near);
        let y = F::splat(-2.0).mul_add(share, one) * upwards;
        let radius = F::splat(2.0) * (share * (one - share)).safe_sqrt();
        // The column is counted from u = 0.5, where the map looks along +X, so that the sum loses little.
        let from_middle = (column - F::splat(0.5 * self.width as f32)) + along;
        let (z, x) = sin_cos_twice(from_middle * F::splat(PI / self.width as f32));
        // A step of Newton's brings them back to the circle, which they are some roundings off.
        let radius = radius * x.mul_add(x, z * z).mul_add(F::splat(-0.5), F::splat(1.5));
        let (x, z) = (x * radius, z * radius);
        let [sin, cos] = self.rotation_sin_cos.map(F::splat);
        let direction = V3::new(x * cos + z * sin, y, z * cos - x * sin);
        let seam = F::splat(self.seam);
        let inside = |place: F| seam.lt(place) & place.lt(one - seam);
        let at_edge = lanes & !(inside(along) & inside(down)).bits();
        if at_edge != 0 {
            radiance = Rgb::from_fn(|lane| match at_edge >> lane & 1 {
                1 => self.radiance(direction.lane(lane)),
                _ => radiance.lane(lane),
            });
        }
        for lane in (0..F::LANES).filter(|lane| cfg!(debug_assertions) && lanes >> lane & 1 == 1) {
            let seen = self.radiance(direction.lane(lane));
            debug_assert_eq!(radiance.lane(lane), seen, "inside the seam rounding cannot cross an edge");
        }
        (direction, radiance)
    }

    /// What the part that is looked for brings to a surface, lx: the mean over all ways that it may face.
    pub fn mean_illuminance(&self) -> f32 {
        (0.25 * self.beyond_integral) as f32
    }
}

/// Angle of (x, y) about the origin, in turns: −1/2 to 1/2, within 1e-7; 0 at the origin.
///
/// Argument reduction to tan(π/8) and polynomial as in Moshier 1992, "Cephes", atanf.
#[inline(always)]
pub(super) fn turns<F: Real>(y: F, x: F) -> F {
    let (ax, ay) = (x.abs(), y.abs());
    let (small, large) = (ax.min(ay), ax.max(ay));
    // Above tan(π/8): atan(s/l) = π/4 + atan((s − l)/(s + l)).
    let steep = small.gt(large * F::splat(0.414_213_57));
    let over = F::select(steep, small - large, small);
    let under = F::select(steep, small + large, large);
    let t = over / F::select(under.eq(F::zero()), F::one(), under);
    let t2 = t * t;
    let p = t2
        .mul_add(F::splat(8.053_744_5e-2), F::splat(-1.387_768_6e-1))
        .mul_add(t2, F::splat(1.997_771_1e-1))
        .mul_add(t2, F::splat(-3.333_295e-1));
    let angle = (p * t2).mul_add(t, t) * F::splat(1.0 / TAU) + F::splat(0.125).masked(steep);
    let angle = F::select(ay.gt(ax), F::splat(0.25) - angle, angle);
    F::select(x.lt(F::zero()), F::splat(0.5) - angle, angle).copysign(y)
}

/// Of linear Rec.709.
fn luminance(c: [f32; 3]) -> f64 {
    0.212_671 * f64::from(c[0]) + 0.715_160 * f64::from(c[1]) + 0.072_169 * f64::from(c[2])
}

#[cfg(test)]
mod tests;
