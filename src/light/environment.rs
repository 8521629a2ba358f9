//! The sky as a light: look-up, and sampling by texel.
//!
//! A direction belongs to exactly one texel, and a texel has one radiance and one density. So `radiance` and `pdf`
//! are two columns of the same row, and their ratio, which is what a sample carries, is as exact as the table.

use std::f32::consts::{FRAC_1_PI, TAU};

use rayon::prelude::*;

use crate::{sampling::AliasTable, world::EnvironmentMap};

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
    /// One row per texel, by luminance times solid angle.
    pub choice: AliasTable,
    /// Sine and cosine of `rotation`.
    pub rotation_sin_cos: [f32; 2],
    /// Solid angle of a texel by its row, sr.
    pub solid_angle: Vec<f32>,
    /// Where texels of a row lie between the nearer pole (0) and its opposite (1), (1 − cosθ)/2: at the edge towards
    /// that pole, and how much more at the other.
    pub band: Vec<[f32; 2]>,
    /// Integral of the luminance over the sphere, lx without a cosine.
    pub luminance_integral: f64,
}

impl EnvironmentTable {
    /// The table of a map whose radiance is multiplied by `scale`.
    ///
    /// The choice is empty if the whole map is black.
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
        let mut weights = vec![0.0f32; texels.len()];
        let sums: Vec<f64> = weights
            .par_chunks_mut(width)
            .zip(texels.par_chunks(width))
            .enumerate()
            .map(|(row, (weights, texels))| {
                let solid_angle = solid_angle(row);
                let mut sum = 0.0;
                for (weight, texel) in weights.iter_mut().zip(texels) {
                    let power = luminance(*texel) * solid_angle;
                    sum += power;
                    *weight = power as f32;
                }
                sum
            })
            .collect();
        let rotation = f64::from(rotation_degrees).to_radians();
        Self {
            width: map.width,
            height: map.height,
            texels,
            rotation: rotation as f32,
            choice: AliasTable::new(&weights),
            rotation_sin_cos: [rotation.sin() as f32, rotation.cos() as f32],
            solid_angle: (0..height).map(|row| solid_angle(row) as f32).collect(),
            band: bands.iter().map(|band| band.map(|v| v as f32)).collect(),
            luminance_integral: sums.iter().sum(),
        }
    }

    /// Row and column of the texel that a unit direction in world space meets.
    #[inline]
    pub fn texel(&self, d: [f32; 3]) -> (usize, usize) {
        let [sin, cos] = self.rotation_sin_cos;
        let (x, z) = (d[0] * cos - d[2] * sin, d[2] * cos + d[0] * sin);
        let u = 0.5 + z.atan2(x) * (1.0 / TAU);
        // The same as acos(y), and as exact near the poles as elsewhere.
        let v = (x * x + z * z).sqrt().atan2(d[1]) * FRAC_1_PI;
        // u = 1 is u = 0; NaN goes to 0.
        let column = (u * self.width as f32) as usize;
        let row = (v * self.height as f32) as usize;
        (row.min(self.height as usize - 1), if column < self.width as usize { column } else { 0 })
    }

    /// Radiance from a unit direction in world space, nit.
    #[inline]
    pub fn radiance(&self, d: [f32; 3]) -> [f32; 3] {
        let (row, column) = self.texel(d);
        self.texels[row * self.width as usize + column]
    }

    /// Density with which [`EnvironmentTable::sample`] gives a unit direction in world space, 1/sr.
    #[inline]
    pub fn pdf(&self, d: [f32; 3]) -> f32 {
        let (row, column) = self.texel(d);
        self.texel_pdf(row, column)
    }

    /// [`EnvironmentTable::radiance`] and [`EnvironmentTable::pdf`] for little more than one of them.
    #[inline]
    pub fn look_up(&self, d: [f32; 3]) -> ([f32; 3], f32) {
        let (row, column) = self.texel(d);
        (self.texels[row * self.width as usize + column], self.texel_pdf(row, column))
    }

    #[inline]
    fn texel_pdf(&self, row: usize, column: usize) -> f32 {
        if self.choice.is_empty() {
            return 0.0;
        }
        self.choice.pmf[row * self.width as usize + column] / self.solid_angle[row]
    }

    /// A unit direction in world space with probability by luminance, its density (1/sr) and its radiance (nit).
    ///
    /// `u` and the first of `v` choose the texel, what is left of them and the second of `v` a direction inside,
    /// uniform in solid angle.
    ///
    /// A direction drawn near an edge may round into the next texel. Density and radiance are those of the texel that
    /// the rounded direction meets, bit for bit what [`EnvironmentTable::look_up`] says of it. So weights against other
    /// ways of finding the sky add up to 1, and a sample that strayed from the sun into the dark beside it has the dark
    /// radiance over the dark density. What remains is an error of the true density in a seam as wide as the rounding,
    /// about 1e-7 rad. The density is 0 if it strayed into black.
    ///
    /// # Panics
    /// If the whole map is black.
    #[inline]
    pub fn sample(&self, u: f32, v: (f32, f32)) -> ([f32; 3], f32, [f32; 3]) {
        let (texel, along) = self.choice.sample_fine((u, v.0));
        let (row, column) = (texel / self.width, texel % self.width);
        let [near, extent] = self.band[row as usize];
        let share = v.1.mul_add(extent, near);
        let y = 1.0 - 2.0 * share;
        let y = if 2 * row < self.height { y } else { -y };
        let radius = 2.0 * (share * (1.0 - share)).sqrt();
        // The column is counted from u = 0.5, where the map looks along +X, so that the sum loses little.
        let from_middle = (column as f32 - 0.5 * self.width as f32) + along;
        let (z, x) = (TAU * from_middle / self.width as f32).sin_cos();
        let (x, z) = (x * radius, z * radius);
        let [sin, cos] = self.rotation_sin_cos;
        let direction = [x * cos + z * sin, y, z * cos - x * sin];
        let (radiance, pdf) = self.look_up(direction);
        (direction, pdf, radiance)
    }

    /// Light that a sphere around the scene takes from the sky, lm: the luminance integral times πr².
    pub fn power(&self, radius: f32) -> f32 {
        (self.luminance_integral * std::f64::consts::PI * f64::from(radius).powi(2)) as f32
    }
}

/// Of linear Rec.709.
fn luminance(c: [f32; 3]) -> f64 {
    0.212_671 * f64::from(c[0]) + 0.715_160 * f64::from(c[1]) + 0.072_169 * f64::from(c[2])
}
