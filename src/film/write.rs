//! Picture files go out: format by extension, a temporary file in the same folder, then a rename.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    sync::Mutex,
};

use super::{Exposure, FilmError, LayerData, Picture, ToneMap, exr, hdr, png};

/// Kinds of picture files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Scene-linear 32-bit float with layers.
    Exr,
    /// Display-referred, eight bits.
    Png,
    /// Radiance: scene-linear, shared exponent, no alpha, no layers.
    Hdr,
}

impl Format {
    /// By the extension of the file's name, upper or lower case.
    ///
    /// # Errors
    ///
    /// [`FilmError::Extension`] for any other.
    pub fn of(path: &Path) -> Result<Self, FilmError> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "exr" => Ok(Self::Exr),
            "png" => Ok(Self::Png),
            "hdr" => Ok(Self::Hdr),
            _ => Err(FilmError::Extension { path: path.into() }),
        }
    }
}

/// How a picture becomes a file; what a format does not need is not read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WriteOptions {
    /// PNG only.
    pub exposure: Exposure,
    /// PNG only.
    pub tone_map: ToneMap,
}

/// Writes a picture; the extension says how.
///
/// The file appears whole or not at all.
///
/// # Errors
///
/// If the extension is unknown, the folder is missing or cannot be written to, or the picture is empty
/// or inconsistent.
pub fn write(path: &Path, picture: &Picture, options: &WriteOptions) -> Result<(), FilmError> {
    let format = Format::of(path)?;
    check_picture(path, picture)?;
    write_file(path, |file| match format {
        Format::Exr => exr::encode(file, picture),
        Format::Png => png::encode(file, picture, options),
        Format::Hdr => hdr::encode(file, picture),
    })
}

/// Finds out whether a file could be written here, before hours are spent on its content.
///
/// # Errors
///
/// If the folder is missing or cannot be written to, or a folder of this name is in the way.
pub fn check_writable(path: &Path) -> Result<(), FilmError> {
    let folder = folder_of(path);
    if !folder.is_dir() {
        return Err(FilmError::Folder { path: path.into(), folder: folder.into() });
    }
    if path.is_dir() {
        return Err(FilmError::IsFolder { path: path.into() });
    }
    temporary_in(folder).map(drop).map_err(|source| FilmError::Write { path: path.into(), source })
}

/// Writes any file the careful way: `fill` gets a temporary file that is renamed when it is whole.
///
/// # Errors
///
/// As [`check_writable`], and what `fill` reports.
pub fn write_file(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
) -> Result<(), FilmError> {
    let failed = |source| FilmError::Write { path: path.into(), source };
    let folder = folder_of(path);
    if !folder.is_dir() {
        return Err(FilmError::Folder { path: path.into(), folder: folder.into() });
    }
    if path.is_dir() {
        return Err(FilmError::IsFolder { path: path.into() });
    }
    let mut temporary = temporary_in(folder).map_err(failed)?;
    let _listed = Listed::new(temporary.path());
    let mut writer = BufWriter::new(temporary.as_file_mut());
    fill(&mut writer).and_then(|()| writer.flush()).map_err(failed)?;
    drop(writer);
    temporary.persist(path).map_err(|error| failed(error.error))?;
    Ok(())
}

/// Removes what unfinished writes have left so far; for a program about to end at once.
pub fn discard_unfinished() {
    for path in unfinished().iter() {
        let _ = fs::remove_file(path);
    }
}

static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn unfinished() -> std::sync::MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Keeps a temporary file on the list of [`discard_unfinished`] while it exists.
struct Listed(PathBuf);

impl Listed {
    fn new(path: &Path) -> Self {
        unfinished().push(path.into());
        Self(path.into())
    }
}

impl Drop for Listed {
    fn drop(&mut self) {
        unfinished().retain(|path| *path != self.0);
    }
}

/// The folder a file of this name goes to.
fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// A new empty file that vanishes unless renamed, with the permissions of an ordinary one.
fn temporary_in(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".wavecast-").suffix(".part");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The process's umask takes its share of these.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

/// All columns must have a value per pixel, and there must be pixels.
fn check_picture(path: &Path, picture: &Picture) -> Result<(), FilmError> {
    let pixels = picture.width * picture.height;
    if pixels == 0 {
        return Err(FilmError::Empty { path: path.into() });
    }
    let check = |what: &str, actual: usize| {
        if actual == pixels {
            Ok(())
        } else {
            Err(FilmError::Length { path: path.into(), what: what.into(), expected: pixels, actual })
        }
    };
    check("beauty", picture.rgb.len())?;
    if let Some(alpha) = &picture.alpha {
        check("alpha", alpha.len())?;
    }
    for layer in &picture.layers {
        let values = match &layer.data {
            LayerData::Scalar(values) => values.len(),
            LayerData::Uv(values) => values.len(),
            LayerData::Rgb(values) | LayerData::Xyz(values) => values.len(),
            LayerData::Id(values) => values.len(),
        };
        check(&layer.name, values)?;
    }
    for (i, layer) in picture.layers.iter().enumerate() {
        if picture.layers[..i].iter().any(|other| other.name == layer.name) {
            return Err(FilmError::Duplicate { path: path.into(), name: layer.name.clone() });
        }
    }
    Ok(())
}
