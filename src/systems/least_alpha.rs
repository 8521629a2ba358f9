//! The least alpha in any part of an image, for triangles that can be told to cover wholly.

use crate::flat::{FlatImage, ImageTexels, Textures};

/// Texels along the side of a square of the first level.
const SQUARE: u32 = 4;
/// Squares along a side that are looked at before a coarser level is.
const MOST: u32 = 4;
/// What rounding may move a coordinate by, in texels and as a share of it: well above what interpolating, transforming and
/// folding it do.
const SLACK: (f64, f64) = (1.0 / 64.0, 1e-6);

/// Least alpha, of 65535, in squares of 4, 8, 16, … texels.
#[derive(Clone, Debug)]
pub struct LeastAlpha {
    width: u32,
    height: u32,
    /// From fine to coarse, the last a single square: squares to a row, and the least alpha in each.
    levels: Vec<(u32, Vec<u16>)>,
}

impl LeastAlpha {
    /// Of an image that is not empty.
    pub fn new(image: &FlatImage) -> Self {
        let (width, height) = (image.width, image.height);
        let (mut columns, mut rows) = (width.div_ceil(SQUARE), height.div_ceil(SQUARE));
        let mut least = vec![u16::MAX; (columns * rows) as usize];
        let mut take = |at: usize, alpha: u16| {
            let (x, y) = (at as u32 % width, at as u32 / width);
            let square = &mut least[(y / SQUARE * columns + x / SQUARE) as usize];
            *square = alpha.min(*square);
        };
        match &image.texels {
            // 255 · 257 = 65535.
            ImageTexels::Rgba8(all) => {
                all.iter().enumerate().for_each(|(at, texel)| take(at, u16::from(texel[3]) * 257))
            }
            ImageTexels::Rgba16(all) => all.iter().enumerate().for_each(|(at, texel)| take(at, texel[3])),
        }
        let mut levels = vec![(columns, least)];
        while columns * rows > 1 {
            let (below, fine) = levels.last().expect("the first level");
            let (wide, high) = (columns.div_ceil(2), rows.div_ceil(2));
            let mut coarse = vec![u16::MAX; (wide * high) as usize];
            for (at, &alpha) in fine.iter().enumerate() {
                let (x, y) = (at as u32 % below, at as u32 / below);
                let square = &mut coarse[(y / 2 * wide + x / 2) as usize];
                *square = alpha.min(*square);
            }
            levels.push((wide, coarse));
            (columns, rows) = (wide, high);
        }
        Self { width, height, levels }
    }

    /// Not more than the least alpha of the texels in a range of columns and rows, ends included, inside the image.
    fn within(&self, [x0, x1]: [u32; 2], [y0, y1]: [u32; 2]) -> u16 {
        let mut level = 0;
        let side = |level: usize| SQUARE << level;
        while level + 1 < self.levels.len() && (x1 - x0).max(y1 - y0) >= MOST * side(level) {
            level += 1;
        }
        let (columns, squares) = &self.levels[level];
        let rows = y0 / side(level)..=y1 / side(level);
        let all = rows.flat_map(|y| (x0 / side(level)..=x1 / side(level)).map(move |x| y * columns + x));
        all.map(|at| squares[at as usize]).min().unwrap_or(0)
    }

    /// Not more than any alpha, 0 to 1, that a look into a slot of this image gives inside a triangle of these texture
    /// coordinates.
    pub fn over(&self, textures: &Textures, slot: u32, uvs: [[f32; 2]; 3]) -> f32 {
        if uvs.iter().flatten().any(|coordinate| !coordinate.is_finite()) {
            return 0.0;
        }
        let (row, slots) = (slot as usize, &textures.slots);
        let m = slots.transform[row].map(f64::from);
        let along = |first: usize, size: u32, wrap: u8| -> Option<Vec<[u32; 2]>> {
            let at = uvs.map(|[u, v]| m[first] * f64::from(u) + m[first + 1] * f64::from(v) + m[first + 2]);
            let (least, most) = at.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &x| (a.min(x), b.max(x)));
            // Products and sums on the way are as large as what they are made of, whatever is left of them.
            let large = uvs.iter().flatten().map(|u| f64::from(u.abs())).fold(0.0, f64::max);
            let large = large * (m[first].abs() + m[first + 1].abs()) + m[first + 2].abs();
            let slack = SLACK.0 + SLACK.1 * large * f64::from(size);
            // From half a texel before to half a texel after: what is filtered together.
            let [from, to] = [least * f64::from(size) - 0.5 - slack, most * f64::from(size) + 0.5 + slack];
            pieces(from, to, size, wrap)
        };
        let (columns, rows) = (along(0, self.width, slots.wrap_u[row]), along(3, self.height, slots.wrap_v[row]));
        let (Some(columns), Some(rows)) = (columns, rows) else { return 0.0 };
        let all = columns.iter().flat_map(|&x| rows.iter().map(move |&y| (x, y)));
        all.map(|(x, y)| f32::from(self.within(x, y)) / 65535.0).fold(1.0, f32::min)
    }
}

/// Ranges of texels, ends included, that hold what a range of coordinates in texels means; `None` if it is not finite.
fn pieces(from: f64, to: f64, size: u32, wrap: u8) -> Option<Vec<[u32; 2]>> {
    if !(from.abs() < 1e9 && to.abs() < 1e9) {
        return None;
    }
    let (from, to, last) = (from.floor() as i64, to.floor() as i64, i64::from(size) - 1);
    let piece = |from: i64, to: i64| [from.clamp(0, last) as u32, to.clamp(0, last) as u32];
    let period = i64::from(size) * if wrap == 1 { 2 } else { 1 };
    Some(match wrap {
        0 | 1 if to - from >= period - 1 => vec![piece(0, last)],
        0 => {
            let (start, end) = (from.rem_euclid(period), to.rem_euclid(period));
            if start <= end { vec![piece(start, end)] } else { vec![piece(start, last), piece(0, end)] }
        }
        1 => {
            let (start, end) = (from.rem_euclid(period), to.rem_euclid(period));
            if start <= end && end <= last {
                vec![piece(start, end)]
            } else if start <= end && start > last {
                vec![piece(period - 1 - end, period - 1 - start)]
            } else {
                vec![piece(0, last)]
            }
        }
        _ => vec![piece(from, to)],
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::flat::TextureSlot;

    /// Of any triangle of coordinates the bound is below what a look at any point in it gives, and not so far below that it
    /// says nothing.
    #[test]
    fn no_look_gives_less_than_the_least() {
        let mut state = 7_u32;
        let mut number = move || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 8) as f32 / 16_777_216.0
        };
        let (mut tight, mut looks) = (0, 0);
        for case in 0..3000_u32 {
            let (width, height) = (1 + case * 7 % 61, 1 + case * 5 % 43);
            // Opaque but for a few texels.
            let alpha = |share: f32| if share < 0.01 { 0 } else { 255 };
            let texels = (0..width * height).map(|_| [0, 0, 0, alpha(number())]).collect();
            let image = FlatImage { width, height, texels: ImageTexels::Rgba8(texels) };
            let least = LeastAlpha::new(&image);
            let mut textures = Textures::default();
            textures.images.push(Arc::new(image));
            let turn =
                [number() - 0.5, number() - 0.5, 3.0 * number(), number() - 0.5, number() - 0.5, -9.0 * number()];
            textures.slots.push(TextureSlot {
                wrap_u: (case % 3) as u8,
                wrap_v: (case / 3 % 3) as u8,
                nearest: (case / 9 % 2) as u8,
                transform: if case % 2 == 0 { turn } else { [1.0, 0.0, 0.0, 0.0, 1.0, 0.0] },
                ..TextureSlot::default()
            });
            let size = [0.05, 0.3, 3.0][case as usize / 18 % 3];
            let base = [8.0 * number() - 4.0, 8.0 * number() - 4.0];
            let uvs = [0; 3].map(|_| base.map(|x| x + size * number()));
            let bound = least.over(&textures, 0, uvs);
            let mut seen = 1.0_f32;
            for _ in 0..200 {
                let (mut b1, mut b2) = (number(), number());
                if b1 + b2 > 1.0 {
                    (b1, b2) = (1.0 - b1, 1.0 - b2);
                }
                let uv = [0, 1].map(|i| (1.0 - b1 - b2) * uvs[0][i] + b1 * uvs[1][i] + b2 * uvs[2][i]);
                let alpha = textures.sample(0, uv)[3];
                assert!(alpha >= bound - 1e-6, "case {case}: {alpha} at {uv:?}, said to be {bound}");
                seen = seen.min(alpha);
                looks += 1;
            }
            tight += u32::from(bound == 1.0 && seen > 0.999);
        }
        assert!(looks == 600_000 && tight > 300, "{tight} of 3000 told to cover");
    }

    #[test]
    fn coordinates_that_are_not_finite_say_nothing() {
        let texels = ImageTexels::Rgba16(vec![[65535; 4]]);
        let image = FlatImage { width: 1, height: 1, texels };
        let least = LeastAlpha::new(&image);
        let mut textures = Textures::default();
        textures.images.push(Arc::new(image));
        let transform = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        textures.slots.push(TextureSlot { transform, ..TextureSlot::default() });
        let over = |u: f32| least.over(&textures, 0, [[0.0; 2], [1.0; 2], [u; 2]]);
        assert_eq!((over(f32::NAN), over(f32::INFINITY), over(1e30), over(0.5)), (0.0, 0.0, 0.0, 1.0));
    }
}
