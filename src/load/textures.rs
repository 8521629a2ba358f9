//! How a material looks into an image: texture, sampler, and `KHR_texture_transform`.

use std::sync::Arc;

use gltf::json::texture as gl;

use super::{
    document::{Document, IMAGES, SAMPLERS, TEXTURES},
    error::{LoadError, Warnings},
    extensions::TEXTURE_SOURCES,
    json::Json,
};
use crate::world::{Filter, Image, Texture, UvTransform, Wrap};

/// A [`Texture`] whose image is not decoded yet.
#[derive(Clone, Debug)]
pub(super) struct TextureUse {
    /// Index into the file's images.
    pub(super) image: usize,
    wrap_u: Wrap,
    wrap_v: Wrap,
    filter: Filter,
    /// Set of texture coordinates.
    pub(super) tex_coord: u32,
    pub(super) transform: UvTransform,
}

impl TextureUse {
    pub(super) fn with_image(&self, image: Arc<Image>) -> Texture {
        Texture {
            image,
            wrap_u: self.wrap_u,
            wrap_v: self.wrap_v,
            filter: self.filter,
            tex_coord: self.tex_coord,
            transform: self.transform,
        }
    }
}

/// Reads the textureInfo under `key`; none if it is absent or has no image that can be read.
pub(super) fn read_texture(
    owner: &Json<'_>,
    key: &str,
    document: &Document<'_>,
    warnings: &mut Warnings,
) -> Result<Option<TextureUse>, LoadError> {
    let Some(info) = owner.get(key)? else { return Ok(None) };
    let (_, texture) = document.follow(&info.required("index")?, TEXTURES)?;
    let Some(image) = read_source(&texture, document, warnings)? else { return Ok(None) };

    let mut tex_coord = read_set(&info)?.unwrap_or(0);
    let mut transform = UvTransform::IDENTITY;
    if let Some(json) = info.extension("KHR_texture_transform")? {
        tex_coord = read_set(&json)?.unwrap_or(tex_coord);
        let pair = |key: &str, default: [f32; 2]| -> Result<[f32; 2], LoadError> {
            Ok(json.get(key)?.map(|pair| pair.numbers::<2>()).transpose()?.map_or(default, |p| p.map(|x| x as f32)))
        };
        let rotation = json.get("rotation")?.map(|r| r.number()).transpose()?.unwrap_or(0.0) as f32;
        transform = UvTransform { offset: pair("offset", [0.0; 2])?, rotation, scale: pair("scale", [1.0; 2])? };
    }
    let (wrap_u, wrap_v, filter) = match document.follow_key(&texture, "sampler", SAMPLERS)? {
        None => (Wrap::Repeat, Wrap::Repeat, Filter::Linear),
        Some((_, sampler)) => (read_wrap(&sampler, "wrapS")?, read_wrap(&sampler, "wrapT")?, read_filter(&sampler)?),
    };
    Ok(Some(TextureUse { image, wrap_u, wrap_v, filter, tex_coord, transform }))
}

fn read_set(json: &Json<'_>) -> Result<Option<u32>, LoadError> {
    let Some(set) = json.get("texCoord")? else { return Ok(None) };
    match u32::try_from(set.unsigned()?) {
        Ok(index) => Ok(Some(index)),
        Err(_) => Err(set.expected("a set of texture coordinates")),
    }
}

/// The image of a texture: its plain source, whatever better one an extension may offer.
fn read_source(
    texture: &Json<'_>,
    document: &Document<'_>,
    warnings: &mut Warnings,
) -> Result<Option<usize>, LoadError> {
    if let Some((image, _)) = document.follow_key(texture, "source", IMAGES)? {
        return Ok(Some(image));
    }
    for name in TEXTURE_SOURCES {
        if texture.extension(name)?.is_some() {
            warnings.push(&texture.at, format!("its only image needs {name}, which is not supported; left out"));
            return Ok(None);
        }
    }
    warnings.push(&texture.at, "it has no image; left out");
    Ok(None)
}

fn read_wrap(sampler: &Json<'_>, key: &str) -> Result<Wrap, LoadError> {
    let Some(json) = sampler.get(key)? else { return Ok(Wrap::Repeat) };
    match u32::try_from(json.unsigned()?).unwrap_or(0) {
        gl::REPEAT => Ok(Wrap::Repeat),
        gl::MIRRORED_REPEAT => Ok(Wrap::MirroredRepeat),
        gl::CLAMP_TO_EDGE => Ok(Wrap::ClampToEdge),
        _ => Err(json.expected("10497, 33071 or 33648")),
    }
}

/// The magnification filter; a file that gives only the other one means that.
fn read_filter(sampler: &Json<'_>) -> Result<Filter, LoadError> {
    let known = |key: &str| -> Result<Option<u32>, LoadError> {
        let Some(json) = sampler.get(key)? else { return Ok(None) };
        let number = u32::try_from(json.unsigned()?).unwrap_or(0);
        let valid = if key == "magFilter" { gl::VALID_MAG_FILTERS } else { gl::VALID_MIN_FILTERS };
        if valid.contains(&number) { Ok(Some(number)) } else { Err(json.expected(format!("one of {valid:?}"))) }
    };
    let (mag, min) = (known("magFilter")?, known("minFilter")?);
    Ok(match mag.or(min) {
        Some(gl::NEAREST | gl::NEAREST_MIPMAP_NEAREST | gl::NEAREST_MIPMAP_LINEAR) => Filter::Nearest,
        _ => Filter::Linear,
    })
}
