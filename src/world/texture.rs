//! Decoded images and how materials look into them.

use std::sync::Arc;

/// Texels of an image: eight or sixteen bits a channel, four channels, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub enum Texels {
    /// R, G, B, A of eight bits.
    Rgba8(Vec<[u8; 4]>),
    /// R, G, B, A of sixteen bits.
    Rgba16(Vec<[u16; 4]>),
}

/// A decoded image, as stored in its file: no transfer function applied.
///
/// Images are immutable and shared; equality of [`Texture`]s compares their identity.
#[derive(Clone, Debug)]
pub struct Image {
    /// What to call it in messages: its name or URI.
    pub name: String,
    /// Texels to a row; at least 1.
    pub width: u32,
    /// Rows; at least 1.
    pub height: u32,
    /// `width × height` texels.
    pub texels: Texels,
}

/// What lies beyond the image's edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// The image again.
    #[default]
    Repeat,
    /// The image again, mirrored every other time.
    MirroredRepeat,
    /// The edge's texel.
    ClampToEdge,
}

/// How a value between texel centres is made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// The nearest texel.
    Nearest,
    /// The four nearest, weighted, after decoding to linear.
    #[default]
    Linear,
}

/// `KHR_texture_transform`: uv' = offset + R(rotation) · (scale ⊙ uv).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvTransform {
    /// In units of the image's size.
    pub offset: [f32; 2],
    /// Counter-clockwise about the origin, rad.
    pub rotation: f32,
    /// Per axis.
    pub scale: [f32; 2],
}

impl UvTransform {
    /// The transform that changes nothing.
    pub const IDENTITY: Self = Self { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2] };

    /// Rows `[a, b, c]` of u' = a·u + b·v + c and likewise v'.
    ///
    /// The matrix of the extension's text: translation · rotation · scale with
    /// rotation = [cos, sin; −sin, cos] in uv space, whose v runs downwards.
    pub fn rows(&self) -> [[f32; 3]; 2] {
        let (sin, cos) = self.rotation.sin_cos();
        [
            [cos * self.scale[0], sin * self.scale[1], self.offset[0]],
            [-sin * self.scale[0], cos * self.scale[1], self.offset[1]],
        ]
    }
}

impl Default for UvTransform {
    fn default() -> Self {
        Self::IDENTITY
    }
}

/// An image as a material uses it.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Shared texels.
    pub image: Arc<Image>,
    /// Across, along u.
    pub wrap_u: Wrap,
    /// Down, along v.
    pub wrap_v: Wrap,
    /// Between texels.
    pub filter: Filter,
    /// Which set of texture coordinates.
    pub tex_coord: u32,
    /// Applied to the coordinates first.
    pub transform: UvTransform,
}

impl Texture {
    /// The image over texture coordinate set 0: repeated, bilinear.
    pub fn new(image: Arc<Image>) -> Self {
        Self {
            image,
            wrap_u: Wrap::default(),
            wrap_v: Wrap::default(),
            filter: Filter::default(),
            tex_coord: 0,
            transform: UvTransform::IDENTITY,
        }
    }
}

impl PartialEq for Texture {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.image, &other.image)
            && (self.wrap_u, self.wrap_v, self.filter, self.tex_coord)
                == (other.wrap_u, other.wrap_v, other.filter, other.tex_coord)
            && self.transform == other.transform
    }
}
