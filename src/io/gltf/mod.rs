//! glTF 2.0 files, `.gltf` and `.glb`, as descriptions.
//!
//! References are numbers that are checked where they are followed: what no node needs is not looked at, and
//! arrays are read where they lie in their buffers.

mod accessors;
mod buffers;
mod container;
mod extensions;
mod material_schema;
mod materials;
mod meshes;
mod nodes;
mod schema;

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fmt::Display;
use std::path::Path;
use std::sync::Arc;

use schema::Root;

use super::LoadLimits;
use super::description::{Bytes, Description};
use super::limits::read_bytes;
use crate::error::{Error, Result};

/// Reads a file, with the buffers that it names.
pub(super) fn read(path: &Path, limits: &LoadLimits) -> Result<Description> {
    let bytes = Arc::new(read_bytes(path, limits)?);
    let (json, binary) = container::split(&bytes).map_err(|m| Error::format(path, m))?;
    let mut reader = serde_json::Deserializer::from_slice(&bytes[json]);
    let root: Root = serde_path_to_error::deserialize(&mut reader).map_err(|e| {
        let field = match e.path().to_string() {
            // At the top there is no field to name.
            top if top == "." => String::new(),
            field => field + ": ",
        };
        Error::format(path, format!("{field}{}", e.into_inner()))
    })?;
    reader
        .end()
        .map_err(|e| Error::format(path, e.to_string()))?;
    let mut document = Document {
        path,
        limits,
        root,
        buffers: Vec::new(),
        bytes: bytes.len() as u64,
        unread: RefCell::default(),
    };
    document.check_version()?;
    let binary = binary.map(|range| Bytes {
        buffer: bytes.clone(),
        range,
    });
    let (buffers, more) = buffers::load(&document, binary)?;
    document.buffers = buffers;
    document.bytes += more;
    let description = nodes::walk(&document)?;
    let unread = document.unread.into_inner();
    if !unread.is_empty() {
        let list: Vec<String> = unread.into_iter().collect();
        let list = list.join(", ");
        log::warn!("{}: these parts are not read: {list}", path.display());
    }
    Ok(description)
}

/// A file whose buffers are read.
struct Document<'a> {
    path: &'a Path,
    limits: &'a LoadLimits,
    root: Root,
    buffers: Vec<Bytes>,
    /// Of the file and the files of its buffers.
    bytes: u64,
    /// What would change the picture and is not read, told once.
    unread: RefCell<BTreeSet<String>>,
}

impl Document<'_> {
    /// An error about a place in the file.
    fn fail(&self, place: impl Display, message: impl Display) -> Error {
        Error::format(self.path, format!("{place} {message}"))
    }

    /// Notes what is not read.
    fn skip(&self, what: impl Into<String>) {
        self.unread.borrow_mut().insert(what.into());
    }

    /// The element of a list that a field refers to.
    fn get<'b, T>(
        &self,
        list: &'b [T],
        index: usize,
        place: impl Display,
        name: &str,
    ) -> Result<&'b T> {
        list.get(index).ok_or_else(|| {
            let count = list.len();
            let message = format!("is {index}, expected an index of {name}, which has {count}");
            self.fail(place, message)
        })
    }

    /// A number in [0, 1].
    fn unit(&self, value: f32, place: impl Display) -> Result<f64> {
        // Numbers of files are rounded.
        if !(-1e-6..=1.0 + 1e-6).contains(&value) {
            return Err(self.fail(place, format!("is {value}, expected a number in [0, 1]")));
        }
        Ok(f64::from(value.clamp(0.0, 1.0)))
    }

    /// A finite number of at least 0.
    fn not_negative(&self, value: f32, place: impl Display) -> Result<f64> {
        if !(value.is_finite() && value >= 0.0) {
            return Err(self.fail(place, format!("is {value}, expected a finite number ≥ 0")));
        }
        Ok(f64::from(value))
    }

    fn check_version(&self) -> Result<()> {
        let version = &self.root.asset.version;
        if !version.starts_with("2.") {
            return Err(self.fail("asset.version", format!("is {version:?}, expected 2.0")));
        }
        self.check_extensions()?;
        if !self.root.animations.is_empty() {
            self.skip("animations");
        }
        Ok(())
    }
}
