//! Texels in compact form.

use std::sync::Arc;

use crate::{
    simd::prefetch,
    soa,
    world::{Filter, Wrap},
};

/// How stored numbers become linear ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Decode {
    /// As they are, 0 to 1.
    #[default]
    Linear,
    /// R, G and B through the sRGB transfer function; A as it is.
    Srgb,
}

/// Texels as stored: 4 or 8 bytes each.
#[derive(Clone, Debug, PartialEq)]
pub enum ImageTexels {
    /// Eight bits a channel.
    Rgba8(Vec<[u8; 4]>),
    /// Sixteen bits a channel.
    Rgba16(Vec<[u16; 4]>),
}

/// One image, shared by all slots that look into it.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatImage {
    /// Texels to a row.
    pub width: u32,
    /// Rows, from the top.
    pub height: u32,
    /// `width × height` of them.
    pub texels: ImageTexels,
}

soa! {
    /// Ways of looking into images; a material refers to rows of this.
    pub struct TextureSlots of TextureSlot {
        /// Row of `Textures::images`.
        image: u32,
        /// Beyond the left and right edge: a `Wrap`.
        wrap_u: u8,
        /// Beyond the top and bottom edge.
        wrap_v: u8,
        /// 1 for nearest, 0 for bilinear.
        nearest: u8,
        /// 1 if R, G and B are sRGB-encoded.
        srgb: u8,
        /// Which set of texture coordinates.
        tex_coord: u32,
        /// `u' = m[0]·u + m[1]·v + m[2]; v' = m[3]·u + m[4]·v + m[5]`.
        transform: [f32; 6],
    }
}

impl TextureSlot {
    /// `wrap` as stored.
    pub fn wrap_code(wrap: Wrap) -> u8 {
        match wrap {
            Wrap::Repeat => 0,
            Wrap::MirroredRepeat => 1,
            Wrap::ClampToEdge => 2,
        }
    }

    /// `filter` as stored in `nearest`.
    pub fn nearest_code(filter: Filter) -> u8 {
        u8::from(filter == Filter::Nearest)
    }
}

/// All images and the slots that refer to them.
#[derive(Clone, Debug, Default)]
pub struct Textures {
    /// Each image once.
    pub images: Vec<Arc<FlatImage>>,
    /// One row for each distinct way of looking.
    pub slots: TextureSlots,
}

/// sRGB-encoded bytes as linear numbers (IEC 61966-2-1).
fn srgb_table() -> &'static [f32; 256] {
    static TABLE: std::sync::OnceLock<[f32; 256]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0)))
}

/// The sRGB transfer function, from encoded to linear.
pub fn srgb_to_linear(encoded: f32) -> f32 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

impl FlatImage {
    /// A texel, linear, 0 to 1.
    #[inline]
    fn texel(&self, x: u32, y: u32, srgb: bool) -> [f32; 4] {
        let at = y as usize * self.width as usize + x as usize;
        match &self.texels {
            ImageTexels::Rgba8(texels) => {
                let texel = texels[at];
                if srgb {
                    let table = srgb_table();
                    let [r, g, b] = [texel[0], texel[1], texel[2]].map(|c| table[c as usize]);
                    [r, g, b, f32::from(texel[3]) / 255.0]
                } else {
                    texel.map(|c| f32::from(c) / 255.0)
                }
            }
            ImageTexels::Rgba16(texels) => {
                let texel = texels[at].map(|c| f32::from(c) / 65535.0);
                if srgb {
                    let [r, g, b] = [texel[0], texel[1], texel[2]].map(srgb_to_linear);
                    [r, g, b, texel[3]]
                } else {
                    texel
                }
            }
        }
    }
}

/// The texel that a whole-texel coordinate means, beyond the edges too.
#[inline]
fn wrap(at: i32, size: u32, code: u8) -> u32 {
    let size = size as i32;
    (match code {
        0 => at.rem_euclid(size),
        1 => {
            let at = at.rem_euclid(2 * size);
            if at < size { at } else { 2 * size - 1 - at }
        }
        _ => at.clamp(0, size - 1),
    }) as u32
}

/// Coordinates beyond this many texels lose all precision; clamping keeps the integer conversion defined.
const FARTHEST_TEXEL: f32 = 1e9;

impl Textures {
    /// The image that a slot looks into, and where in it coordinates lie, in texels, before they are wrapped.
    #[inline(always)]
    fn place(&self, row: usize, uv: [f32; 2]) -> (&FlatImage, [f32; 2]) {
        let slots = &self.slots;
        let m = &slots.transform[row];
        let u = m[0] * uv[0] + m[1] * uv[1] + m[2];
        let v = m[3] * uv[0] + m[4] * uv[1] + m[5];
        let image = &*self.images[slots.image[row] as usize];
        // Whole repeats are taken off first, so that coordinates far from zero keep their precision.
        let (u, v) = (fold(u, slots.wrap_u[row]), fold(v, slots.wrap_v[row]));
        let x = (u * image.width as f32).clamp(-FARTHEST_TEXEL, FARTHEST_TEXEL);
        let y = (v * image.height as f32).clamp(-FARTHEST_TEXEL, FARTHEST_TEXEL);
        (image, [x, y])
    }

    /// Asks for the texels that [`Textures::sample`] is going to read, but for those across an edge.
    #[inline]
    pub fn ask_for(&self, slot: u32, uv: [f32; 2]) {
        let (image, [x, y]) = self.place(slot as usize, uv);
        let (x, y) = ((x - 0.5).max(0.0) as usize, (y - 0.5).max(0.0) as usize);
        for y in [y, y + 1] {
            let at = y * image.width as usize + x;
            match &image.texels {
                ImageTexels::Rgba8(texels) => prefetch::<1, _>(texels, at),
                ImageTexels::Rgba16(texels) => prefetch::<1, _>(texels, at),
            }
        }
    }

    /// The value of a slot at texture coordinates, linear, R G B A.
    ///
    /// Texels are decoded first and filtered then, as glTF asks; v runs downwards from the first row.
    #[inline]
    pub fn sample(&self, slot: u32, uv: [f32; 2]) -> [f32; 4] {
        let row = slot as usize;
        let slots = &self.slots;
        let (wrap_u, wrap_v, srgb) = (slots.wrap_u[row], slots.wrap_v[row], slots.srgb[row] != 0);
        let (image, [x, y]) = self.place(row, uv);
        if slots.nearest[row] != 0 {
            let (x, y) = (wrap(x.floor() as i32, image.width, wrap_u), wrap(y.floor() as i32, image.height, wrap_v));
            return image.texel(x, y, srgb);
        }
        let (x, y) = (x - 0.5, y - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let (x0, y0) = (x0 as i32, y0 as i32);
        let columns = [x0, x0 + 1].map(|x| wrap(x, image.width, wrap_u));
        let rows = [y0, y0 + 1].map(|y| wrap(y, image.height, wrap_v));
        let [a, b] = columns.map(|x| image.texel(x, rows[0], srgb));
        let [c, d] = columns.map(|x| image.texel(x, rows[1], srgb));
        let (wa, wb) = ((1.0 - fx) * (1.0 - fy), fx * (1.0 - fy));
        let (wc, wd) = ((1.0 - fx) * fy, fx * fy);
        std::array::from_fn(|i| a[i] * wa + b[i] * wb + c[i] * wc + d[i] * wd)
    }
}

/// A coordinate with whole periods of its wrap mode taken off.
#[inline]
fn fold(u: f32, code: u8) -> f32 {
    match code {
        0 => u - u.floor(),
        1 => u - 2.0 * (u * 0.5).floor(),
        _ => u,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn textures(wrap: Wrap, filter: Filter, srgb: bool) -> Textures {
        let texels = ImageTexels::Rgba8(vec![[0, 0, 0, 255], [255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]]);
        let mut textures = Textures::default();
        textures.images.push(Arc::new(FlatImage { width: 2, height: 2, texels }));
        textures.slots.push(TextureSlot {
            wrap_u: TextureSlot::wrap_code(wrap),
            wrap_v: TextureSlot::wrap_code(wrap),
            nearest: TextureSlot::nearest_code(filter),
            srgb: u8::from(srgb),
            transform: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            ..TextureSlot::default()
        });
        textures
    }

    /// The image is black, red / green, blue; the first row is at v = 0.
    #[test]
    fn wrap_modes_continue_the_image_as_gltf_says() {
        let color = |wrap, uv| {
            let [r, g, b, _] = textures(wrap, Filter::Nearest, false).sample(0, uv);
            [r, g, b]
        };
        let (black, red, green, blue) = ([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        for wrap in [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge] {
            assert_eq!(color(wrap, [0.25, 0.25]), black);
            assert_eq!(color(wrap, [0.75, 0.25]), red);
            assert_eq!(color(wrap, [0.25, 0.75]), green);
        }
        assert_eq!(color(Wrap::Repeat, [1.25, 0.75]), green);
        assert_eq!(color(Wrap::Repeat, [-0.25, 0.25]), red);
        assert_eq!(color(Wrap::MirroredRepeat, [1.25, 0.75]), blue);
        assert_eq!(color(Wrap::MirroredRepeat, [-0.25, 0.25]), black);
        assert_eq!(color(Wrap::ClampToEdge, [7.0, 0.25]), red);
        assert_eq!(color(Wrap::ClampToEdge, [-7.0, 9.0]), green);
    }

    /// Midway between black and red: half of linear red, sRGB-encoded or not, since decoding comes first.
    #[test]
    fn filtering_follows_decoding() {
        for srgb in [false, true] {
            let value = textures(Wrap::ClampToEdge, Filter::Linear, srgb).sample(0, [0.5, 0.25]);
            assert!((value[0] - 0.5).abs() < 1e-6, "{value:?}");
        }
        let value = textures(Wrap::Repeat, Filter::Linear, false).sample(0, [0.0, 0.0]);
        assert!(value[..3].iter().all(|c| (c - 0.25).abs() < 1e-6), "the corner mixes all four: {value:?}");
    }

    #[test]
    fn absurd_coordinates_stay_inside_the_image() {
        for wrap in [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge] {
            for filter in [Filter::Nearest, Filter::Linear] {
                for u in [1e30, -1e30, f32::MAX, f32::MIN, 1e-40] {
                    assert!(textures(wrap, filter, true).sample(0, [u, u]).iter().all(|c| c.is_finite()));
                }
            }
        }
    }
}
