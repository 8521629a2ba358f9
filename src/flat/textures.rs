//! Texels in compact form.

use std::sync::Arc;

use crate::{
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
        /// u' = m[0]·u + m[1]·v + m[2]; v' = m[3]·u + m[4]·v + m[5].
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
