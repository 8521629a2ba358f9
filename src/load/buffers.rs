//! Bytes of buffers and the views into them.

use std::{
    path::{Path, PathBuf},
    sync::{
        OnceLock,
        atomic::{AtomicU64, Ordering},
    },
};

use super::{
    document::{BUFFER_VIEWS, BUFFERS, Document},
    error::{LoadError, Place},
    json::Json,
    uri,
};

/// Elements any file may ask for, however small: room for what is made of zeros and sparse values.
const FREE_ELEMENTS: u64 = 1 << 22;

/// Elements per byte of buffer: the same data may be read by many meshes, each with a copy.
const ELEMENTS_PER_BYTE: u64 = 32;

/// The file's buffers, read when first asked for.
pub(super) struct Buffers<'a> {
    document: &'a Document<'a>,
    folder: PathBuf,
    binary: Option<Vec<u8>>,
    loaded: Vec<OnceLock<Vec<u8>>>,
    limit: u64,
    spent: AtomicU64,
}

/// A stretch of a buffer.
#[derive(Clone, Debug)]
pub(super) struct View<'b> {
    pub(super) bytes: &'b [u8],
    /// Bytes from one element to the next, if they are not packed.
    pub(super) stride: Option<u64>,
    pub(super) at: Place,
}

impl<'a> Buffers<'a> {
    pub(super) fn new(document: &'a Document<'a>, folder: &Path, binary: Option<Vec<u8>>) -> Self {
        let loaded = (0..document.count(BUFFERS)).map(|_| OnceLock::new()).collect();
        let mut buffers =
            Self { document, folder: folder.to_owned(), binary, loaded, limit: 0, spent: AtomicU64::new(0) };
        let available: u64 = document.elements(BUFFERS).map(|buffer| buffers.size_hint(&buffer)).sum();
        buffers.limit = FREE_ELEMENTS + ELEMENTS_PER_BYTE * available;
        buffers
    }

    fn size_hint(&self, buffer: &Json<'_>) -> u64 {
        let uri = buffer.get("uri").ok().flatten();
        let there = match &uri {
            Some(uri) => uri::resolve(uri, &self.folder).map_or(0, |target| target.size_hint()),
            None => self.binary.as_ref().map_or(0, |bytes| bytes.len() as u64),
        };
        let said = buffer.unsigned_or("byteLength", 0).unwrap_or(0);
        there.min(said)
    }

    /// Notes that `count` elements are about to be read, so that a few bytes cannot ask for all memory.
    ///
    /// # Errors
    /// If all that has been asked for is out of proportion to the buffers.
    pub(super) fn charge(&self, at: &Place, count: u64) -> Result<(), LoadError> {
        let needed = self.spent.fetch_add(count.min(1 << 60), Ordering::Relaxed).saturating_add(count);
        if needed <= self.limit {
            return Ok(());
        }
        Err(LoadError::TooLarge { at: at.clone(), what: "elements", needed, limit: self.limit })
    }

    fn buffer(&self, index: usize, buffer: &Json<'_>) -> Result<&[u8], LoadError> {
        let needed = buffer.required("byteLength")?.unsigned()?;
        let bytes: &[u8] = match (self.loaded[index].get(), buffer.get("uri")?) {
            (Some(bytes), _) => bytes,
            (None, Some(uri)) => {
                let bytes = uri::resolve(&uri, &self.folder)?.read(&uri)?;
                self.loaded[index].get_or_init(|| bytes)
            }
            (None, None) => match (&self.binary, index) {
                (Some(bytes), 0) => bytes,
                _ => return Err(LoadError::Missing { at: buffer.at.clone(), key: "uri".to_owned() }),
            },
        };
        let available = bytes.len() as u64;
        let end = usize::try_from(needed).ok().and_then(|needed| bytes.get(..needed));
        end.ok_or_else(|| LoadError::Bounds { at: buffer.at.clone(), needed, available })
    }

    /// The bytes of a bufferView.
    pub(super) fn view(&self, view: &Json<'_>) -> Result<View<'_>, LoadError> {
        let buffer = self.document.follow(&view.required("buffer")?, BUFFERS)?;
        let (offset, length) = (view.unsigned_or("byteOffset", 0)?, view.required("byteLength")?.unsigned()?);
        let stride = view.get("byteStride")?;
        let bytes = self.buffer(buffer.0, &buffer.1)?;
        let needed = offset.saturating_add(length);
        let available = bytes.len() as u64;
        if needed > available {
            return Err(LoadError::Bounds { at: view.at.clone(), needed, available });
        }
        let stride = match &stride {
            None => None,
            Some(json) => Some(match json.unsigned()? {
                stride @ 1..=252 => stride,
                _ => return Err(json.expected("a stride of 4 to 252 bytes")),
            }),
        };
        Ok(View { bytes: &bytes[offset as usize..needed as usize], stride, at: view.at.clone() })
    }

    /// The bytes of the bufferView that the property `bufferView` of `from` refers to, if it is there.
    pub(super) fn view_of(&self, from: &Json<'_>) -> Result<Option<View<'_>>, LoadError> {
        match self.document.follow_key(from, "bufferView", BUFFER_VIEWS)? {
            None => Ok(None),
            Some((_, view)) => self.view(&view).map(Some),
        }
    }

    /// The folder that URIs are relative to.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }
}
