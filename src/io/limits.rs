//! Limits on the files that are loaded.

use std::path::Path;

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
    pub(super) text_bytes: u64,
    pub(super) triangles: u64,
    pub(super) corners: u64,
    memory: Option<u64>,
    pub(super) outside: bool,
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
}

/// Parses JSON. Error messages contain the path of the field.
pub(crate) fn parse_json<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T> {
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
