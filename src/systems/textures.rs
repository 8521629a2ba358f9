//! Images to compact texels, and the slots that look into them; cached by identity.

use std::{collections::HashMap, sync::Arc};

use crate::{
    flat::{Decode, FlatImage, ImageTexels, NONE, TextureSlot, Textures},
    world::{Image, Texels, Texture},
};

/// Flat images by the identity of their source.
#[derive(Default)]
pub struct ImageCache {
    images: HashMap<usize, (Arc<Image>, Arc<FlatImage>)>,
}

/// Collects the textures that materials refer to.
pub struct TextureTable<'a> {
    cache: &'a mut ImageCache,
    kept: HashMap<usize, (Arc<Image>, Arc<FlatImage>)>,
    rows: HashMap<usize, u32>,
    /// The table as far as it has come.
    pub table: Textures,
    /// Images that had to be made anew.
    pub built: usize,
}

impl<'a> TextureTable<'a> {
    /// An empty table over what the cache still holds.
    pub fn new(cache: &'a mut ImageCache) -> Self {
        Self { cache, kept: HashMap::new(), rows: HashMap::new(), table: Textures::default(), built: 0 }
    }

    /// The slot row of a use of a texture, or `NONE`.
    pub fn slot(&mut self, texture: Option<&Texture>, decode: Decode) -> u32 {
        let Some(texture) = texture else { return NONE };
        let [[a, b, c], [d, e, f]] = texture.transform.rows();
        let slot = TextureSlot {
            image: self.image(&texture.image),
            wrap_u: TextureSlot::wrap_code(texture.wrap_u),
            wrap_v: TextureSlot::wrap_code(texture.wrap_v),
            nearest: TextureSlot::nearest_code(texture.filter),
            srgb: u8::from(decode == Decode::Srgb),
            tex_coord: texture.tex_coord,
            transform: [a, b, c, d, e, f],
        };
        let slots = &mut self.table.slots;
        (0..slots.len()).find(|&row| slots.row(row) == slot).unwrap_or_else(|| {
            slots.push(slot);
            slots.len() - 1
        }) as u32
    }

    fn image(&mut self, image: &Arc<Image>) -> u32 {
        let id = Arc::as_ptr(image) as usize;
        if let Some(&row) = self.rows.get(&id) {
            return row;
        }
        let entry = self.cache.images.remove(&id).unwrap_or_else(|| {
            self.built += 1;
            (Arc::clone(image), Arc::new(flatten(image)))
        });
        let row = self.table.images.len() as u32;
        self.table.images.push(Arc::clone(&entry.1));
        self.kept.insert(id, entry);
        self.rows.insert(id, row);
        row
    }

    /// The finished table; images that nothing referred to are forgotten.
    pub fn finish(self) -> (Textures, usize) {
        self.cache.images = self.kept;
        (self.table, self.built)
    }
}

fn flatten(image: &Image) -> FlatImage {
    let texels = match &image.texels {
        Texels::Rgba8(texels) => ImageTexels::Rgba8(texels.clone()),
        Texels::Rgba16(texels) => ImageTexels::Rgba16(texels.clone()),
    };
    FlatImage { width: image.width, height: image.height, texels }
}
