//! The file's top-level arrays and references between them.

use serde_json::Value;

use super::{
    error::{LoadError, Place},
    json::Json,
};

/// A top-level array: its key and what one element is called.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kind {
    pub(super) key: &'static str,
    pub(super) what: &'static str,
}

macro_rules! kinds {
    ($($name:ident $key:literal $what:literal),* $(,)?) => {
        $(pub(super) const $name: Kind = Kind { key: $key, what: $what };)*
        /// All of them.
        const KINDS: &[Kind] = &[$($name),*];
    };
}

kinds! {
    ACCESSORS "accessors" "accessor",
    ANIMATIONS "animations" "animation",
    BUFFERS "buffers" "buffer",
    BUFFER_VIEWS "bufferViews" "bufferView",
    CAMERAS "cameras" "camera",
    IMAGES "images" "image",
    MATERIALS "materials" "material",
    MESHES "meshes" "mesh",
    NODES "nodes" "node",
    SAMPLERS "samplers" "sampler",
    SCENES "scenes" "scene",
    SKINS "skins" "skin",
    TEXTURES "textures" "texture",
}

/// The root object, known to be of version 2 and to hold arrays of objects where arrays belong.
#[derive(Clone, Debug)]
pub(super) struct Document<'a> {
    pub(super) root: Json<'a>,
}

impl<'a> Document<'a> {
    /// # Errors
    /// If the version is not supported or a top-level array is something else.
    pub(super) fn new(value: &'a Value, place: Place) -> Result<Self, LoadError> {
        let root = Json::new(value, place);
        let asset = root.required("asset")?;
        let (version, minimum) = (asset.required("version")?, asset.get("minVersion")?);
        let (major, _) = parse_version(&version)?;
        if major != 2 {
            return Err(version.expected("version 2.x"));
        }
        if let Some(minimum) = minimum
            && parse_version(&minimum)? > (2, 0)
        {
            return Err(minimum.expected("at most 2.0"));
        }
        for kind in KINDS {
            for element in root.list(kind.key)? {
                element.object()?;
            }
        }
        Ok(Self { root })
    }

    fn values(&self, kind: Kind) -> &'a [Value] {
        self.root.value.get(kind.key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
    }

    /// Number of elements of a top-level array.
    pub(super) fn count(&self, kind: Kind) -> usize {
        self.values(kind).len()
    }

    /// The element at `index`, which must be less than [`count`](Self::count).
    pub(super) fn element(&self, kind: Kind, index: usize) -> Json<'a> {
        Json::new(&self.values(kind)[index], self.root.at.join(kind.key).join(index))
    }

    pub(super) fn elements(&self, kind: Kind) -> impl Iterator<Item = Json<'a>> + '_ {
        (0..self.count(kind)).map(move |index| self.element(kind, index))
    }

    /// The element an index refers to.
    pub(super) fn follow(&self, index: &Json<'_>, kind: Kind) -> Result<(usize, Json<'a>), LoadError> {
        let index = index.index(kind.what, self.count(kind))?;
        Ok((index, self.element(kind, index)))
    }

    /// The element the property `key` of `from` refers to, if it is there.
    pub(super) fn follow_key(
        &self,
        from: &Json<'_>,
        key: &str,
        kind: Kind,
    ) -> Result<Option<(usize, Json<'a>)>, LoadError> {
        from.get(key)?.map(|index| self.follow(&index, kind)).transpose()
    }
}

fn parse_version(version: &Json<'_>) -> Result<(u32, u32), LoadError> {
    let parts = version.string()?.split_once('.');
    let parsed = parts.and_then(|(major, minor)| Some((major.parse().ok()?, minor.parse().ok()?)));
    parsed.ok_or_else(|| version.expected("a version such as \"2.0\""))
}
