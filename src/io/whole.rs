//! Files that appear under their names only when they are complete.

use std::fs;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::error::{Error, Result};

/// A complete file under a temporary name in its folder. It is removed if it is never published.
pub(super) struct Part {
    part: PathBuf,
    path: PathBuf,
}

impl Part {
    /// Writes a file's contents under a temporary name in the same folder. If this fails, no file is left.
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
        let mut file = BufWriter::new(fs::File::create(&part).map_err(Error::io(path))?);
        let this = Self {
            part,
            path: path.into(),
        };
        write(&mut file)?;
        file.flush().map_err(Error::io(path))?;
        Ok(this)
    }

    /// Writes slices of bytes one after the other.
    pub fn of(path: &Path, bytes: &[&[u8]]) -> Result<Self> {
        Self::write(path, |file| {
            let written = bytes.iter().try_for_each(|bytes| file.write_all(bytes));
            written.map_err(Error::io(path))
        })
    }

    /// Renames the file to its final name.
    pub fn publish(self) -> Result<()> {
        fs::rename(&self.part, &self.path).map_err(Error::io(&self.path))
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // A published file no longer has this name.
        let _ = fs::remove_file(&self.part);
    }
}

/// Writes a file under a temporary name in its folder and renames it, so that it is never visible incomplete.
pub(crate) fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<fs::File>) -> Result<()>,
) -> Result<()> {
    Part::write(path, write)?.publish()
}

/// Checks that a file of `bytes` bytes can be written: that its folder takes a small file, which is removed, and that the
/// disk has the space.
pub(super) fn check_writable(path: &Path, bytes: u64) -> Result<()> {
    let folder = folder_of(path);
    let failed = |why: String| {
        let message = format!(
            "{bytes} bytes for it can't be written to the folder {}: {why}",
            folder.display()
        );
        Err(Error::format(path, message))
    };
    match Part::of(path, &[&[0; 4096]]) {
        Ok(_) => {}
        Err(Error::Io { source, .. }) => return failed(source.to_string()),
        Err(other) => return Err(other),
    }
    match free_space(folder) {
        Ok(free) if free < bytes => failed(format!("the disk has {free} bytes of free space")),
        // Some file systems don't tell their free space.
        _ => Ok(()),
    }
}

/// Returns the number of bytes that may be written to the file system of a folder.
#[cfg(not(target_family = "wasm"))]
fn free_space(folder: &Path) -> std::io::Result<u64> {
    fs4::available_space(folder)
}

#[cfg(target_family = "wasm")]
fn free_space(_: &Path) -> std::io::Result<u64> {
    Err(std::io::ErrorKind::Unsupported.into())
}

/// Returns the folder of a file.
pub(super) fn folder_of(path: &Path) -> &Path {
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// Returns the extension of a path if it is in `known`, regardless of case. Any other extension is an error.
pub(super) fn ending<'a>(path: &Path, known: &[&'a str]) -> Result<&'a str> {
    let found = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let same = known.iter().find(|e| found.eq_ignore_ascii_case(e));
    same.copied().ok_or_else(|| {
        let expected = known.join(" or .");
        Error::format(
            path,
            format!("its ending is {found:?}, expected .{expected}"),
        )
    })
}
