//! Texels to values.

use glam::{DVec2, DVec4};

use crate::flat::{FlatImage, FlatScene, ImageTexels};

/// The transfer function of sRGB, encoded to linear (IEC 61966-2-1).
fn linear_from_srgb(x: f64) -> f64 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// Maps the index of a texel outside of 0..size back into it; `code` as in `TextureSlot::wrap_code`.
fn wrap(index: i64, size: i64, code: u8) -> i64 {
    match code {
        0 => index.rem_euclid(size),
        1 => {
            let m = index.rem_euclid(2 * size);
            if m < size { m } else { 2 * size - 1 - m }
        }
        _ => index.clamp(0, size - 1),
    }
}

fn texel(image: &FlatImage, x: i64, y: i64, srgb: bool) -> DVec4 {
    let index = y as usize * image.width as usize + x as usize;
    let [r, g, b, a] = match &image.texels {
        ImageTexels::Rgba8(texels) => texels[index].map(|c| f64::from(c) / 255.0),
        ImageTexels::Rgba16(texels) => texels[index].map(|c| f64::from(c) / 65535.0),
    };
    if srgb {
        DVec4::new(linear_from_srgb(r), linear_from_srgb(g), linear_from_srgb(b), a)
    } else {
        DVec4::new(r, g, b, a)
    }
}

/// The linear value of a row of `TextureSlots` at texture coordinates before the slot's transform.
pub fn look_up(scene: &FlatScene, slot: u32, uv: DVec2) -> DVec4 {
    let slot = scene.textures.slots.row(slot as usize);
    let image = &scene.textures.images[slot.image as usize];
    let m = slot.transform.map(f64::from);
    let u = m[0] * uv.x + m[1] * uv.y + m[2];
    let v = m[3] * uv.x + m[4] * uv.y + m[5];
    let (width, height) = (i64::from(image.width), i64::from(image.height));
    let at = |x: f64, y: f64| {
        texel(image, wrap(x as i64, width, slot.wrap_u), wrap(y as i64, height, slot.wrap_v), slot.srgb == 1)
    };
    let (x, y) = (u * width as f64, v * height as f64);
    if slot.nearest == 1 {
        return at(x.floor(), y.floor());
    }
    // Texel centres lie at half-integers.
    let (x, y) = (x - 0.5, y - 0.5);
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    (1.0 - fy) * ((1.0 - fx) * at(x0, y0) + fx * at(x0 + 1.0, y0))
        + fy * ((1.0 - fx) * at(x0, y0 + 1.0) + fx * at(x0 + 1.0, y0 + 1.0))
}
