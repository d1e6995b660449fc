//! Limits on the files that are loaded.

use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use burn::tensor::Device;
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};

/// Limits on the size of loaded files, and on the files that they may refer to.
///
/// ```
/// use softray::prelude::*;
/// let limits = LoadLimits::default().with_pixels(1 << 28).with_outside(true);
/// # let _ = limits;
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoadLimits {
    pub(super) pixels: u64,
    text_bytes: u64,
    pub(super) triangles: u64,
    pub(super) corners: u64,
    memory: Option<u64>,
    outside: bool,
    pub(super) strict: bool,
}

/// Approximate bytes that a render takes for each triangle, object and light, and for each number of a texture.
pub(super) const TRIANGLE: u64 = 600;
pub(super) const OBJECT: u64 = 2048;
pub(super) const LIGHT: u64 = 1024;
pub(super) const TEXEL: u64 = 4;

/// The default memory limit: `MIN_MEMORY` bytes, or `PER_BYTE` per byte of the files read if that is more. A file
/// that uses each array and image once takes about `PER_BYTE`.
const MIN_MEMORY: u64 = 3 << 28;
const PER_BYTE: u64 = 64;

/// A file that is read, its limits, and the device of its tensors.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub path: &'a Path,
    pub limits: &'a LoadLimits,
    pub device: &'a Device,
}

/// The memory that the parts of a file take.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Memory {
    pub taken: u64,
    /// Bytes of all files that were read.
    pub read: u64,
}

impl Memory {
    /// Adds `count` parts of `size` bytes each.
    ///
    /// # Errors
    /// If the sum exceeds the limit. The message lacks the name of the part.
    pub fn take(
        &mut self,
        count: u64,
        size: u64,
        limits: &LoadLimits,
    ) -> std::result::Result<(), String> {
        self.taken = self.taken.saturating_add(count.saturating_mul(size));
        let least = MIN_MEMORY.max(PER_BYTE.saturating_mul(self.read));
        let most = limits.memory.unwrap_or(least);
        match self.taken > most {
            true => Err(format!(
                "takes about {} bytes in memory with what comes before it, more than {most}: LoadLimits::with_memory \
                 raises the limit",
                self.taken
            )),
            false => Ok(()),
        }
    }
}

impl Default for LoadLimits {
    fn default() -> Self {
        Self {
            pixels: 1 << 27,
            text_bytes: 1 << 30,
            triangles: 1 << 26,
            corners: 1 << 14,
            memory: None,
            outside: false,
            strict: false,
        }
    }
}

impl LoadLimits {
    /// Sets the largest number of pixels of an image, 2²⁷ (11,585²) by default.
    pub fn with_pixels(self, pixels: u64) -> Self {
        Self { pixels, ..self }
    }

    /// Sets the largest size in bytes of a text or data file (OBJ, MTL, JSON, glTF and its buffers, PLY), 2³⁰ by
    /// default.
    pub fn with_text_bytes(self, text_bytes: u64) -> Self {
        Self { text_bytes, ..self }
    }

    /// Sets the largest number of triangles of an OBJ, glTF or PLY file, 2²⁶ by default. Each instance of a mesh
    /// counts.
    pub fn with_triangles(self, triangles: u64) -> Self {
        Self { triangles, ..self }
    }

    /// Sets the largest number of corners of a concave polygon, 2¹⁴ by default. All concave polygons with over 1,024
    /// corners also share this limit: the squares of their numbers of corners, by which their time grows, are summed.
    pub fn with_corners(self, corners: u64) -> Self {
        Self { corners, ..self }
    }

    /// Sets the approximate memory in bytes that all textures, triangles and objects of a file may take.
    ///
    /// Each instance of a mesh counts. The default is 3·2²⁸, or 64 times the size of the file with all files that it
    /// refers to if that is more. A small file may use an image or an array many times.
    pub fn with_memory(self, bytes: u64) -> Self {
        Self {
            memory: Some(bytes),
            ..self
        }
    }

    /// Enables or disables strict loading (disabled by default).
    ///
    /// These faults are errors in strict loading and warnings otherwise: missing or malformed textures (and materials
    /// in OBJ), missing texture coordinates or normals, and faces with fewer than three corners.
    pub fn with_strict(self, strict: bool) -> Self {
        Self { strict, ..self }
    }

    /// Sets whether a file may refer to files outside its own folder (false by default).
    pub fn with_outside(self, outside: bool) -> Self {
        Self { outside, ..self }
    }

    /// Returns the path of a file that the file `path` refers to. It must lie in the folder of `path` or below,
    /// unless files outside are allowed.
    pub(super) fn beside(&self, path: &Path, name: &str) -> Result<PathBuf> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let file = folder.join(name);
        self.check_place(&file, folder, &path.display().to_string())?;
        Ok(file)
    }

    /// Checks a number of triangles. The message is for an error of the file.
    pub(super) fn check_triangles(&self, count: u64) -> std::result::Result<(), String> {
        let most = self.triangles;
        match count <= most {
            true => Ok(()),
            false => Err(format!(
                "there are more than {most} triangles: LoadLimits::with_triangles raises the limit"
            )),
        }
    }

    /// Checks that a file lies in a folder or below it, unless files outside are allowed.
    pub(crate) fn check_place(&self, file: &Path, folder: &Path, named_by: &str) -> Result<()> {
        if self.outside {
            return Ok(());
        }
        // An empty folder is the current one. Missing files are reported when they are read.
        let Ok(real) = folder.join(".").canonicalize() else {
            return Ok(());
        };
        let place = match self.may_look_at(file, folder) {
            true => match file.canonicalize() {
                Ok(place) if !place.starts_with(&real) => place,
                _ => return Ok(()),
            },
            false => file.into(),
        };
        let folder = real.display();
        let message = format!(
            "it is named by {named_by} but lies outside of {folder}: it is read only with \
             LoadLimits::with_outside(true)"
        );
        Err(Error::format(place, message))
    }

    /// Returns whether a path names a file in a folder or below it, or files outside are allowed. Only then may the file
    /// system be asked about it: a look at other paths may connect to another machine (`\\machine\share`), mount a
    /// file system or open a device.
    pub(super) fn may_look_at(&self, file: &Path, folder: &Path) -> bool {
        let lies_in = |folder: Option<PathBuf>| {
            let (file, folder) = (absolute(file), folder.as_deref().and_then(absolute));
            file.zip(folder)
                .is_some_and(|(f, folder)| f.starts_with(folder))
        };
        let folder = folder.join(".");
        self.outside || lies_in(Some(folder.clone())) || lies_in(folder.canonicalize().ok())
    }
}

/// Returns an absolute path without `.` and `..`, judged by names alone. On Windows, paths that the file system returned
/// and paths in files then have the same prefix.
fn absolute(path: &Path) -> Option<PathBuf> {
    let mut whole = std::path::absolute(path).ok()?;
    if cfg!(windows) {
        whole = match whole.to_str() {
            Some(text) => without_verbatim(text).into(),
            None => whole,
        };
    }
    let mut plain = PathBuf::new();
    for part in whole.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir => drop(plain.pop()),
            part => plain.push(part),
        }
    }
    Some(plain)
}

/// Returns a Windows path without the verbatim prefix that `canonicalize` gives it: `D:\x` for `\\?\D:\x`, and
/// `\\machine\share` for `\\?\UNC\machine\share`. Other paths stay.
fn without_verbatim(path: &str) -> String {
    let Some(rest) = path.strip_prefix(r"\\?\") else {
        return path.to_owned();
    };
    if let Some(share) = rest.strip_prefix(r"UNC\") {
        return format!(r"\\{share}");
    }
    match rest.as_bytes() {
        [letter, b':', ..] if letter.is_ascii_alphabetic() => rest.to_owned(),
        _ => path.to_owned(),
    }
}

/// Opens a regular file, and returns it with its length in bytes.
pub(crate) fn open(path: &Path) -> Result<(File, u64)> {
    let io = Error::io(path);
    // Read before the file is opened: opening a pipe waits for its other end.
    let metadata = std::fs::metadata(path).map_err(io)?;
    if !metadata.is_file() {
        let kind = match metadata.is_dir() {
            true => "a folder",
            false => "a device or a pipe",
        };
        let message = format!("it is {kind}, expected a regular file");
        return Err(Error::format(path, message));
    }
    Ok((File::open(path).map_err(io)?, metadata.len()))
}

/// Reads a file within the size limit of text files.
pub(crate) fn read_bytes(path: &Path, limits: &LoadLimits) -> Result<Vec<u8>> {
    let most = limits.text_bytes;
    let (file, length) = open(path)?;
    let mut bytes = Vec::new();
    if length <= most {
        // The file may contain more than its reported length.
        let read = file.take(most.saturating_add(1)).read_to_end(&mut bytes);
        read.map_err(Error::io(path))?;
    }
    if length.max(bytes.len() as u64) > most {
        let message = format!(
            "it has more than {most} bytes, the limit: LoadLimits::with_text_bytes raises it"
        );
        return Err(Error::format(path, message));
    }
    Ok(bytes)
}

/// Reads a text file without its byte-order mark. Bytes that are not UTF-8 (in comments of old exporters) are
/// replaced.
pub(crate) fn read_text(path: &Path, limits: &LoadLimits) -> Result<String> {
    let bytes = read_bytes(path, limits)?;
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        let message = "it is UTF-16, expected UTF-8: save it as that";
        return Err(Error::format(path, message));
    }
    let mut text = match String::from_utf8(bytes) {
        Ok(text) => text,
        Err(e) => String::from_utf8_lossy(e.as_bytes()).into_owned(),
    };
    if text.starts_with('\u{feff}') {
        text.drain(..3);
    }
    if text.contains('\r') && !text.contains('\n') {
        let message = "its lines end with a carriage return alone, expected line feeds";
        return Err(Error::format(path, message));
    }
    Ok(text)
}

/// Parses JSON. Error messages contain the path of the field.
pub(super) fn parse_json<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T> {
    let mut json = serde_json::Deserializer::from_slice(bytes);
    let parsed = serde_path_to_error::deserialize(&mut json).map_err(|e| {
        let field = match e.path().to_string() {
            // The top level has no field name.
            top if top == "." => String::new(),
            field => field + ": ",
        };
        Error::format(path, format!("{field}{}", e.into_inner()))
    })?;
    json.end().map_err(|e| Error::format(path, e.to_string()))?;
    Ok(parsed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verbatim_prefixes_are_removed() {
        for (path, expected) in [
            (r"\\?\D:\scenes\a.obj", r"D:\scenes\a.obj"),
            (r"\\?\UNC\machine\share\a.obj", r"\\machine\share\a.obj"),
            (r"D:\scenes", r"D:\scenes"),
            (r"\\machine\share", r"\\machine\share"),
            // Devices and volumes have no other name.
            (r"\\.\pipe\a", r"\\.\pipe\a"),
            (r"\\?\Volume{0}\a", r"\\?\Volume{0}\a"),
            ("/scenes/a.obj", "/scenes/a.obj"),
        ] {
            assert_eq!(without_verbatim(path), expected);
        }
    }
}
