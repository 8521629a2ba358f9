//! What can go wrong with a scene file, and where.

use std::{
    collections::HashSet,
    fmt, io,
    path::{Path, PathBuf},
    sync::Arc,
};

/// A spot in a file: a JSON pointer such as `/meshes/3/primitives/0`, `line 7 column 2`, or `byte 12`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file as it was named to the loader.
    pub file: Arc<Path>,
    /// Where in the file; empty for all of it.
    pub part: String,
}

impl Place {
    /// The file as a whole.
    pub(super) fn file(path: &Path) -> Self {
        Self { file: path.into(), part: String::new() }
    }

    /// Another part of the same file.
    pub(super) fn with_part(&self, part: String) -> Self {
        Self { file: self.file.clone(), part }
    }

    /// One step further down the JSON.
    pub(super) fn join(&self, step: impl fmt::Display) -> Self {
        let step = step.to_string().replace('~', "~0").replace('/', "~1");
        self.with_part(format!("{}/{step}", self.part))
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", one_line(&self.file.display().to_string()))?;
        if self.part.is_empty() { Ok(()) } else { write!(f, ": {}", one_line(&self.part)) }
    }
}

/// Text from a file with control characters escaped, cut to what a line can bear.
pub(super) fn one_line(text: &str) -> String {
    let mut line: String = text.chars().take(200).flat_map(escape).collect();
    if text.chars().nth(200).is_some() {
        line.push('…');
    }
    line
}

fn escape(c: char) -> impl Iterator<Item = char> {
    let (plain, escaped) = if c.is_control() { (None, Some(c.escape_unicode())) } else { (Some(c), None) };
    plain.into_iter().chain(escaped.into_iter().flatten())
}

/// Why a scene, or an environment, could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// The file, or one it refers to, could not be read.
    #[error("{}: cannot read it{}", one_line(&path.display().to_string()), named_by(at.as_ref()))]
    Read {
        /// The file that could not be read.
        path: PathBuf,
        /// What refers to it, if it is not the scene file itself.
        at: Option<Place>,
        /// What the system says.
        source: io::Error,
    },
    /// Neither a GLB container nor JSON text, or a broken one.
    #[error("{at}: {reason}")]
    Syntax {
        /// File with line or byte.
        at: Place,
        /// What is broken.
        reason: String,
    },
    /// The file requires an extension that this renderer does not implement.
    #[error("{at}: the file requires {}, which is not supported; export it without", one_line(name))]
    RequiredExtension {
        /// The entry of `extensionsRequired`, or the object that cannot do without.
        at: Place,
        /// Name of the extension.
        name: String,
    },
    /// A property that must be there is not.
    #[error("{at}: there is no {key}")]
    Missing {
        /// The object.
        at: Place,
        /// The property.
        key: String,
    },
    /// A value has the wrong type or is out of range.
    #[error("{at}: expected {expected}, found {found}")]
    Value {
        /// The value.
        at: Place,
        /// What the specification asks for.
        expected: String,
        /// What is there.
        found: String,
    },
    /// An index points beyond what there is.
    #[error("{at}: refers to {what} {index}, there are {count}")]
    Reference {
        /// The index.
        at: Place,
        /// The array, in the singular.
        what: &'static str,
        /// Its value.
        index: u64,
        /// Length of the array.
        count: usize,
    },
    /// Data reaches beyond the end of what holds it.
    #[error("{at}: needs {needed} bytes, there are {available}")]
    Bounds {
        /// The accessor, view or buffer.
        at: Place,
        /// Bytes from the start to the end of the data.
        needed: u64,
        /// Bytes there are.
        available: u64,
    },
    /// An attribute has another length than the positions beside it.
    #[error("{at}: has {actual} elements, POSITION has {expected}")]
    AttributeLength {
        /// The attribute.
        at: Place,
        /// Elements of `POSITION`.
        expected: usize,
        /// Elements of the attribute.
        actual: usize,
    },
    /// A URI that must not, or cannot, be followed.
    #[error("{at}: cannot follow {:?}: {reason}", one_line(uri))]
    Uri {
        /// The URI.
        at: Place,
        /// Its text.
        uri: String,
        /// Why not.
        reason: &'static str,
    },
    /// The node hierarchy is not a set of trees.
    #[error("{at}: {reason}")]
    Hierarchy {
        /// The node.
        at: Place,
        /// What is wrong with it.
        reason: String,
    },
    /// An image could not be decoded.
    #[error("{at}: cannot decode image {:?}: {reason}", one_line(name))]
    Image {
        /// The image.
        at: Place,
        /// Its name or URI.
        name: String,
        /// What the decoder says.
        reason: String,
    },
    /// More data than a file of this size can reasonably mean.
    #[error("{at}: asks for {needed} {what}, at most {limit} are accepted")]
    TooLarge {
        /// What asks for it.
        at: Place,
        /// Of what.
        what: &'static str,
        /// How much.
        needed: u64,
        /// How much at most.
        limit: u64,
    },
    /// The scene that was asked for is not in the file.
    #[error("{at}: there is no scene {wanted:?}; there are {available}")]
    NoSuchScene {
        /// The file.
        at: Place,
        /// Name or index.
        wanted: String,
        /// Names of the scenes there are.
        available: String,
    },
}

fn named_by(at: Option<&Place>) -> String {
    at.map(|place| format!(", which {place} refers to")).unwrap_or_default()
}

/// Something the picture can do without or that had to be bent, said once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Warning {
    /// Where.
    pub at: Place,
    /// What, in one sentence without a full stop.
    pub text: String,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.at, one_line(&self.text))
    }
}

/// Collects warnings in the order they arise, each once.
#[derive(Debug, Default)]
pub(super) struct Warnings {
    pub(super) list: Vec<Warning>,
    said: HashSet<(String, String)>,
}

impl Warnings {
    pub(super) fn push(&mut self, at: &Place, text: impl Into<String>) {
        let text = text.into();
        if self.said.insert((at.part.clone(), text.clone())) {
            self.list.push(Warning { at: at.clone(), text });
        }
    }
}
