//! Files: OBJ with MTL, images, and scenes with a camera as JSON.

mod images;
mod obj;
mod obj_text;
mod scene_file;

pub use images::HostImage;
#[cfg(feature = "fit")]
pub(crate) use images::write_whole;
pub use scene_file::SceneFile;

use std::path::Path;

use crate::error::{Error, Result};

/// A file's bytes.
fn read_file(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(|source| Error::Io {
        path: path.into(),
        source,
    })
}

/// A text file; bytes that are not UTF-8 (old exporters' comments) are replaced.
fn read_text(path: &Path) -> Result<String> {
    Ok(String::from_utf8_lossy(&read_file(path)?).into_owned())
}
