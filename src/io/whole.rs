//! Files that appear under their names only when they are complete.

use std::fs;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::error::{Error, Result};

/// A file that is complete but under another name in its folder; removed if it is never published.
pub(super) struct Part {
    part: PathBuf,
    path: PathBuf,
}

impl Part {
    /// Writes a file's contents under another name in the same folder.
    ///
    /// # Errors
    /// When the system or the function fails; nothing is left then.
    pub fn write(
        path: &Path,
        write: impl FnOnce(&mut BufWriter<fs::File>) -> Result<()>,
    ) -> Result<Self> {
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        let mut name = std::ffi::OsString::from(".");
        name.push(path.file_name().unwrap_or_default());
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        name.push(format!(".{}-{count}.part", std::process::id()));
        let part = path.with_file_name(name);
        let mut file = BufWriter::new(fs::File::create(&part).map_err(|e| io(path, e))?);
        let this = Self {
            part,
            path: path.into(),
        };
        write(&mut file)?;
        file.flush().map_err(|e| io(path, e))?;
        Ok(this)
    }

    /// Gives it its name.
    ///
    /// # Errors
    /// When the system fails.
    pub fn publish(self) -> Result<()> {
        fs::rename(&self.part, &self.path).map_err(|e| io(&self.path, e))
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // After it was published there is no such file.
        let _ = fs::remove_file(&self.part);
    }
}

/// Writes a file under another name in its folder and renames it, so that it is never seen incomplete.
#[cfg(feature = "fit")]
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    write_whole_by(path, |file| file.write_all(bytes).map_err(|e| io(path, e)))
}

/// As [`write_whole`], with a function that writes the contents.
pub(super) fn write_whole_by(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<fs::File>) -> Result<()>,
) -> Result<()> {
    Part::write(path, write)?.publish()
}

/// The error of a file operation.
pub(super) fn io(path: &Path, source: std::io::Error) -> Error {
    Error::Io {
        path: path.into(),
        source,
    }
}
