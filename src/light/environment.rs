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

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::{
        measure::statistics::{Moments, chi_square_test},
        sampling::tests::numbers,
    };

    fn map(width: u32, height: u32, texel: impl Fn(u32, u32) -> [f32; 3]) -> EnvironmentMap {
        let texels = (0..height).flat_map(|row| (0..width).map(move |column| (row, column))).map(|(r, c)| texel(r, c));
        EnvironmentMap { name: String::new(), width, height, texels: texels.collect() }
    }

    /// Direction of a place on the map, 0 to 1, without rotation.
    fn direction(u: f64, v: f64) -> [f32; 3] {
        let (sin, cos) = (PI * v).sin_cos();
        let (z, x) = (2.0 * PI * (u - 0.5)).sin_cos();
        [sin * x, cos, sin * z].map(|v| v as f32)
    }

    /// A map with all sorts of texels: grey noise, a sun, a black band and coloured ones.
    fn sky(width: u32, height: u32) -> EnvironmentMap {
        map(width, height, |row, column| match (row, column) {
            (r, c) if r == height / 3 && c == width / 4 => [4e5, 4e5, 3e5],
            (r, _) if r == height / 2 => [0.0; 3],
            (r, c) => [1.0 + (r * 7 + c * 13) as f32 % 11.0, 1.0 + (c % 3) as f32, (r % 5) as f32],
        })
    }

    /// Integral over the sphere of a function of (direction, solid angle weight in it): the midpoint rule, several
    /// points to each texel, weighted by exact solid angles.
    fn quadrature(table: &EnvironmentTable, per_texel: u32, mut f: impl FnMut([f32; 3], f64)) {
        let (rows, columns) = (table.height * per_texel, table.width * per_texel);
        for row in 0..rows {
            let edge = |row: u32| PI * f64::from(row) / f64::from(rows);
            let weight = (edge(row).cos() - edge(row + 1).cos()) * 2.0 * PI / f64::from(columns);
            for column in 0..columns {
                let u = (f64::from(column) + 0.5) / f64::from(columns);
                let d = direction(u, (f64::from(row) + 0.5) / f64::from(rows));
                let (sin, cos) = f64::from(table.rotation).sin_cos();
                let (x, z) = (f64::from(d[0]), f64::from(d[2]));
                f([(x * cos + z * sin) as f32, d[1], (z * cos - x * sin) as f32], weight);
            }
        }
    }

    /// ∫L dω = 4πL, however the map is cut; the power over a disk of radius r is πr² of that.
    #[test]
    fn constant_map_integrates_to_the_sphere() {
        for (width, height) in [(1, 1), (2, 1), (1, 2), (7, 3), (64, 32), (1000, 501)] {
            let table = EnvironmentTable::new(&map(width, height, |_, _| [1.5; 3]), 33.0, 2.0);
            let want = 4.0 * PI * 3.0;
            assert!((table.luminance_integral / want - 1.0).abs() < 1e-6, "{width}×{height}");
            assert!((f64::from(table.power(2.0)) / (want * PI * 4.0) - 1.0).abs() < 1e-6);
            for u in numbers(20, 2000) {
                let (d, pdf, radiance) = table.sample(u.0, (u.1, u.0));
                assert_eq!(radiance, [3.0; 3]);
                assert!((f64::from(pdf) * 4.0 * PI - 1.0).abs() < 2e-6, "{width}×{height}: {pdf} at {d:?}");
            }
        }
    }

    #[test]
    fn density_is_not_negative_and_integrates_to_one() {
        for (width, height, rotation) in [(1, 1, 0.0), (8, 4, 0.0), (16, 9, 77.0), (64, 32, -200.0)] {
            let table = EnvironmentTable::new(&sky(width, height), rotation, 0.25);
            let mut integral = 0.0;
            quadrature(&table, 4, |d, weight| {
                let pdf = table.pdf(d);
                assert!(pdf >= 0.0 && pdf.is_finite());
                integral += f64::from(pdf) * weight;
            });
            assert!((integral - 1.0).abs() < 1e-4, "{width}×{height}: {integral}");
        }
    }

    /// Samples against the density: counts per texel and within texels, and E[f] for three functions.
    /// Significance 1e-4 each.
    #[test]
    fn directions_follow_the_density() {
        let functions: [fn([f32; 3]) -> f64; 3] = [
            |d| f64::from(d[0]) + 2.0 * f64::from(d[1]),
            |d| f64::from(d[0] * d[2]) + f64::from(d[1] * d[1]),
            |d| (3.0 * f64::from(d[2])).exp(),
        ];
        for (width, height, rotation) in [(8, 4, 0.0), (16, 9, 77.0)] {
            // Without the sun, which would take nearly all samples.
            let mut picture = sky(width, height);
            picture.texels.iter_mut().for_each(|t| *t = t.map(|v| v.min(30.0)));
            let table = EnvironmentTable::new(&picture, rotation, 1.0);
            // Midpoints of the bands are not where half their solid angle is, so the quadrature is fine.
            let cells = (width * height * 4) as usize;
            let cell = |d: [f32; 3]| {
                let (row, column) = table.texel(d);
                let (row_half, column_half) = {
                    let finer = EnvironmentTable { width: 2 * width, height: 2 * height, ..table.clone_frame() };
                    finer.texel(d)
                };
                assert_eq!((row_half / 2, column_half / 2), (row, column), "halves of the texel");
                row_half * 2 * width as usize + column_half
            };
            let (mut expected, mut means) = (vec![0.0; cells], [0.0; 3]);
            quadrature(&table, 32, |d, weight| {
                let p = f64::from(table.pdf(d)) * weight;
                expected[cell(d)] += p;
                means.iter_mut().zip(functions).for_each(|(mean, f)| *mean += p * f(d));
            });
            let (mut observed, mut moments) = (vec![0u64; cells], [Moments::default(); 3]);
            for (u, v) in numbers(21, 300_000).zip(numbers(22, 300_000)) {
                let (d, pdf, radiance) = table.sample(u.0, v);
                assert_eq!((radiance, pdf), table.look_up(d));
                let length: f32 = d.iter().map(|v| v * v).sum();
                assert!((length - 1.0).abs() < 5e-7, "{d:?}");
                observed[cell(d)] += 1;
                moments.iter_mut().zip(functions).for_each(|(moments, f)| moments.push(f(d)));
            }
            let test = chi_square_test(&observed, &expected);
            assert!(test.p > 1e-4, "{width}×{height}: {test:?}");
            for (got, want) in moments.iter().zip(means) {
                let off = (got.mean - want).abs() - 1e-4;
                assert!(off < 3.9 * got.standard_error(), "{width}×{height}: {got:?} is not {want}");
            }
        }
    }

    impl EnvironmentTable {
        /// Only what [`EnvironmentTable::texel`] needs.
        fn clone_frame(&self) -> Self {
            Self { rotation: self.rotation, rotation_sin_cos: self.rotation_sin_cos, ..Self::default() }
        }
    }

    /// The only bright texel is drawn always, and its radiance over its density is the whole integral.
    #[test]
    fn single_bright_texel_is_always_met() {
        for (width, height) in [(16, 8), (4096, 2048)] {
            for (row, column) in
                [(0, 0), (height - 1, width - 1), (height / 2, width / 2), (height / 2, 0), (1, width / 3)]
            {
                let lit = |r, c| if (r, c) == (row, column) { [5.0; 3] } else { [0.0; 3] };
                let table = EnvironmentTable::new(&map(width, height, lit), 123.0, 1.0);
                let mut strayed = 0;
                for (u, v) in numbers(23, 2000).zip(numbers(24, 2000)) {
                    let (d, pdf, radiance) = table.sample(u.0, v);
                    assert_eq!((radiance, pdf), table.look_up(d));
                    if pdf > 0.0 {
                        assert_eq!(table.texel(d), (row as usize, column as usize));
                        let ratio = 5.0 / f64::from(pdf) / table.luminance_integral;
                        assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
                    } else {
                        strayed += 1;
                    }
                }
                assert!(strayed <= 2000 * width / 4096 / 100, "{width}×{height} {row} {column}: {strayed}");
            }
        }
    }

    /// Radiance over density, the sample of the sky's integral, is the luminance integral wherever a grey sky is not
    /// black: no rounding at an edge between the sun and the dark makes it larger.
    #[test]
    fn samples_of_a_grey_sky_have_no_variance() {
        let picture = map(512, 256, |row, column| match (row * 31 + column * 17) % 5 {
            0 => [1e6; 3],
            1 => [0.0; 3],
            k => [1e-3 * k as f32; 3],
        });
        let table = EnvironmentTable::new(&picture, 10.0, 1.0);
        for (u, v) in numbers(25, 200_000).zip(numbers(26, 200_000)) {
            let (_, pdf, radiance) = table.sample(u.0, v);
            if pdf > 0.0 {
                let ratio = f64::from(radiance[0] / pdf) / table.luminance_integral;
                assert!((ratio - 1.0).abs() < 2e-6, "{ratio}");
            } else {
                assert_eq!(radiance, [0.0; 3]);
            }
        }
    }

    /// The centre of the map looks along +X, a quarter to the right along +Z, the top along +Y; a turn of 90° takes
    /// +X to −Z, counter-clockwise seen from above.
    #[test]
    fn turned_map_looks_where_it_should() {
        // Column k of 8 spans u = k/8 to (k+1)/8; the middle of the map is the edge between 3 and 4.
        let picture = map(8, 2, |row, column| [(10 * row + column) as f32; 3]);
        let look = |rotation: f32, d: [f32; 3]| EnvironmentTable::new(&picture, rotation, 1.0).radiance(d)[0];
        let up = 0.1;
        assert_eq!(look(0.0, [1.0, up, 0.1]), 4.0);
        assert_eq!(look(0.0, [1.0, up, -0.1]), 3.0);
        assert_eq!(look(0.0, [0.1, up, 1.0]), 5.0);
        assert_eq!(look(0.0, [-0.1, up, 1.0]), 6.0);
        assert_eq!(look(0.0, [-1.0, up, 0.1]), 7.0);
        assert_eq!(look(0.0, [-1.0, up, -0.1]), 0.0);
        assert_eq!(look(0.0, [0.1, up, -1.0]), 2.0);
        assert_eq!(look(0.0, [1.0, -up, 0.1]), 14.0);
        // What was at +X is at −Z now, what was at +Z at +X.
        assert_eq!(look(90.0, [0.1, up, -1.0]), 4.0);
        assert_eq!(look(90.0, [-0.1, up, -1.0]), 3.0);
        assert_eq!(look(90.0, [1.0, up, 0.1]), 6.0);
        assert_eq!(look(-270.0, [1.0, up, -0.1]), 5.0);
        assert_eq!(look(360.0, [1.0, up, 0.1]), 4.0);
    }

    #[test]
    fn poles_and_seams_have_a_texel() {
        for (width, height) in [(1, 1), (3, 1), (16, 8), (8192, 4096)] {
            let table = EnvironmentTable { width, height, rotation_sin_cos: [0.0, 1.0], ..EnvironmentTable::default() };
            let (w, h) = (width as usize, height as usize);
            for tiny in [0.0, -0.0, 1e-30, -1e-30, 1e-8, -1e-8f32] {
                assert_eq!(table.texel([tiny, 1.0, tiny]).0, 0);
                assert_eq!(table.texel([tiny, -1.0, -tiny]).0, h - 1);
                for d in [[tiny, 1.0, tiny], [-1.0, tiny, tiny], [1.0, 0.0, tiny], [tiny, tiny, tiny]] {
                    let (row, column) = table.texel(d);
                    assert!(row < h && column < w, "{d:?}");
                }
            }
            let seam = [table.texel([-1.0, 0.0, 0.0]).1, table.texel([-1.0, 0.0, -0.0]).1];
            assert!(seam.iter().all(|&column| column == 0 || column == w - 1));
        }
    }

    /// The middle of each texel is found again, also in the rows at the poles of a fine map.
    #[test]
    fn centres_of_texels_are_found_again() {
        let (width, height) = (4096, 2048);
        let table = EnvironmentTable { width, height, rotation_sin_cos: [0.0, 1.0], ..EnvironmentTable::default() };
        for row in (0..height).step_by(31).chain([1, 2, height - 3, height - 2, height - 1]) {
            for column in (0..width).step_by(57).chain([width - 1]) {
                let d =
                    direction((f64::from(column) + 0.5) / f64::from(width), (f64::from(row) + 0.5) / f64::from(height));
                assert_eq!(table.texel(d), (row as usize, column as usize));
            }
        }
    }

    #[test]
    fn black_sky_has_nothing_to_choose() {
        let table = EnvironmentTable::new(&map(4, 2, |_, _| [0.0; 3]), 0.0, 1.0);
        assert!(table.choice.is_empty());
        assert_eq!(
            (table.power(1.0), table.pdf([0.0, 1.0, 0.0]), table.radiance([1.0, 0.0, 0.0])),
            (0.0, 0.0, [0.0; 3])
        );
    }
}
