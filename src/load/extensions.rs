//! What is read of each extension, what is ignored, and what is refused.

use std::collections::HashSet;

use super::{
    document::Document,
    error::{LoadError, Place, Warnings},
};

/// What becomes of an extension that a file uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExtensionStatus {
    /// Read as specified.
    Read,
    /// Replaced by something near; says by what.
    Approximated(&'static str),
    /// Not read; says what that means.
    Ignored(&'static str),
}

/// An extension that a file names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExtensionUse {
    /// Its name.
    pub name: String,
    /// True if the file says that it cannot be shown without.
    pub required: bool,
    /// What becomes of it.
    pub status: ExtensionStatus,
}

/// Extensions that put a better image beside a texture's plain one.
pub(super) const TEXTURE_SOURCES: &[&str] =
    &["KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds"];

/// Extensions that are read as specified.
const READ: &[&str] = &[
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// Extensions that change nothing in a picture.
const METADATA: &[&str] = &["KHR_xmp_json_ld", "KHR_xmp"];

/// Extensions that are ignored, and what is shown instead.
const IGNORED: &[(&str, &str)] = &[
    ("EXT_mesh_gpu_instancing", "each mesh is shown once, at its node"),
    ("EXT_meshopt_compression", "the uncompressed data are read"),
    ("KHR_meshopt_compression", "the uncompressed data are read"),
    ("KHR_draco_mesh_compression", "the uncompressed data are read"),
    ("KHR_animation_pointer", "nothing is animated"),
    ("KHR_materials_variants", "the default materials are shown"),
    ("KHR_node_visibility", "all nodes are shown"),
];

fn status(name: &str) -> ExtensionStatus {
    if READ.contains(&name) {
        ExtensionStatus::Read
    } else if TEXTURE_SOURCES.contains(&name) {
        ExtensionStatus::Approximated("the plain PNG or JPEG of a texture is shown, where it has one")
    } else if METADATA.contains(&name) {
        ExtensionStatus::Ignored("it describes the file and changes nothing in the picture")
    } else {
        let known = IGNORED.iter().find(|(ignored, _)| *ignored == name);
        ExtensionStatus::Ignored(known.map_or("it is not supported", |(_, instead)| instead))
    }
}

/// Lists the file's extensions, with a warning for each that the picture lacks.
///
/// # Errors
/// If the file requires one that is not supported.
pub(super) fn check(document: &Document<'_>, warnings: &mut Warnings) -> Result<Vec<ExtensionUse>, LoadError> {
    let (mut uses, mut seen) = (Vec::new(), HashSet::new());
    let [required, used] = ["extensionsRequired", "extensionsUsed"].map(|key| document.root.list(key));
    for entry in required? {
        let name = entry.string()?.to_owned();
        let status = status(&name);
        if status != ExtensionStatus::Read && !METADATA.contains(&&*name) {
            return Err(LoadError::RequiredExtension { at: entry.at, name });
        }
        if seen.insert(name.clone()) {
            warn(&name, status, &entry.at, warnings);
            uses.push(ExtensionUse { name, required: true, status });
        }
    }
    for entry in used? {
        let name = entry.string()?.to_owned();
        let status = status(&name);
        if seen.insert(name.clone()) {
            warn(&name, status, &entry.at, warnings);
            uses.push(ExtensionUse { name, required: false, status });
        }
    }
    Ok(uses)
}

fn warn(name: &str, status: ExtensionStatus, at: &Place, warnings: &mut Warnings) {
    match status {
        ExtensionStatus::Approximated(how) => warnings.push(at, format!("{name} is not supported: {how}")),
        ExtensionStatus::Ignored(instead) if !METADATA.contains(&name) => {
            warnings.push(at, format!("{name} is ignored: {instead}"));
        }
        _ => {}
    }
}
