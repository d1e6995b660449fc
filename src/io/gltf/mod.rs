//! Reads glTF 2.0 files, `.gltf` and `.glb`, into descriptions.
//!
//! References are indices, checked where they are followed. Meshes, cameras, lights and accessors that no node uses
//! are not checked. Arrays are read in place from their buffers.

mod accessors;
mod buffers;
mod container;
mod extensions;
mod fields;
mod materials;
mod meshes;
mod nodes;
mod schema;

use std::fmt::Display;
use std::path::Path;

use bytes::Bytes;
use fields::Fields;
use schema::Root;
use serde_json::Value;

use super::description::Description;
use super::files::Files;
use super::limits::parse_json;
use super::notes::Notes;
use crate::error::{Error, Result};

/// Reads a file and its buffers.
pub(super) fn read(path: &Path, files: Files) -> Result<Description> {
    let bytes = Bytes::from(files.read_bytes(path)?);
    let (json, binary) = container::split(&bytes).map_err(|m| Error::format(path, m))?;
    let root: Root = parse_json(path, &bytes[json])?;
    let mut document = Document {
        path,
        files,
        root,
        buffers: Vec::new(),
        bytes: bytes.len() as u64,
        notes: Notes::default(),
    };
    document.check_version()?;
    let binary = binary.map(|range| bytes.slice(range));
    let (buffers, more) = buffers::load(&document, binary)?;
    document.buffers = buffers;
    document.bytes += more;
    let description = nodes::walk(&document)?;
    Ok(Description {
        notes: document.notes,
        ..description
    })
}

/// A parsed file with its buffers.
struct Document<'a> {
    path: &'a Path,
    files: Files<'a>,
    root: Root,
    buffers: Vec<Bytes>,
    /// The size of the file and the files of its buffers.
    bytes: u64,
    notes: Notes,
}

impl Document<'_> {
    /// Returns an error about a place in the file.
    fn fail(&self, place: impl Display, message: impl Display) -> Error {
        Error::format(self.path, format!("{place} {message}"))
    }

    /// Returns an error about a place in the file unless `valid`.
    fn unless(&self, valid: bool, place: impl Display, message: impl Display) -> Result<()> {
        match valid {
            true => Ok(()),
            false => Err(self.fail(place, message)),
        }
    }

    /// Adds a part that would change the picture and is not read to the warnings.
    fn skip(&self, what: impl Into<String>) {
        self.notes.part("these parts are not read", what);
    }

    /// Returns the element of a list that a field refers to.
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

    /// Returns the fields of the element of a list that a field refers to.
    fn fields<'b>(
        &'b self,
        list: &'b [Value],
        index: usize,
        place: impl Display,
        name: &str,
    ) -> Result<Fields<'b>> {
        Ok(Fields {
            document: self,
            json: self.get(list, index, place, name)?,
            place: format!("{name}[{index}]"),
        })
    }

    fn check_version(&self) -> Result<()> {
        let version = &self.root.asset.version;
        let message = format_args!("is {version:?}, expected 2.0");
        self.unless(version.starts_with("2."), "asset.version", message)?;
        self.check_extensions()?;
        if !self.root.animations.is_empty() {
            self.skip("animations");
        }
        Ok(())
    }
}
