//! Where scenes are read from: the file system, or files in memory.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, ErrorKind, Read, Seek};
use std::ops::Deref;
use std::path::{Component, Path, PathBuf};

use burn::tensor::Device;

use super::LoadLimits;
use crate::error::{Error, Result, one_of};

/// The contents of a file.
pub(crate) trait Source: BufRead + Seek {}

impl<T: BufRead + Seek> Source for T {}

/// Files in memory, by their names without `.` and `..`.
pub(crate) struct MemoryFiles(BTreeMap<PathBuf, Vec<u8>>);

impl MemoryFiles {
    /// # Errors
    /// If two files have the same name.
    pub fn new<N: Into<PathBuf>, B: Into<Vec<u8>>>(
        files: impl IntoIterator<Item = (N, B)>,
    ) -> Result<Self> {
        let mut all = BTreeMap::new();
        for (name, bytes) in files {
            let name = name.into();
            if all.insert(plain(&name), bytes.into()).is_some() {
                return Err(Error::format(name, "two files have this name"));
            }
        }
        Ok(Self(all))
    }

    fn get(&self, path: &Path) -> Result<&[u8]> {
        let found = self.0.get(&plain(path)).map(Vec::as_slice);
        found.ok_or_else(|| {
            let names: Vec<_> = self.0.keys().map(|name| name.to_string_lossy()).collect();
            let known = one_of(names.iter().map(|name| &**name));
            let message = format!("it is not in memory, expected {known}");
            Error::io(path)(std::io::Error::new(ErrorKind::NotFound, message))
        })
    }
}

/// The files that a scene is read from, within limits.
#[derive(Clone, Copy)]
pub(crate) struct Files<'a> {
    limits: &'a LoadLimits,
    /// `None` for the file system.
    memory: Option<&'a MemoryFiles>,
}

/// A file that is read, where it and the files that it refers to are, and the device of its tensors.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub path: &'a Path,
    pub files: Files<'a>,
    pub device: &'a Device,
}

impl Deref for Files<'_> {
    type Target = LoadLimits;

    fn deref(&self) -> &LoadLimits {
        self.limits
    }
}

impl<'a> Files<'a> {
    pub fn of_system(limits: &'a LoadLimits) -> Self {
        let memory = None;
        Self { limits, memory }
    }

    pub fn in_memory(memory: &'a MemoryFiles, limits: &'a LoadLimits) -> Self {
        let memory = Some(memory);
        Self { limits, memory }
    }

    /// Opens a regular file, and returns it with its length in bytes.
    pub fn open(self, path: &Path) -> Result<(Box<dyn Source + 'a>, u64)> {
        let io = Error::io(path);
        if let Some(memory) = self.memory {
            let bytes = memory.get(path)?;
            return Ok((Box::new(Cursor::new(bytes)), bytes.len() as u64));
        }
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
        let file = BufReader::new(File::open(path).map_err(io)?);
        Ok((Box::new(file), metadata.len()))
    }

    /// Reads a file within the size limit of text files.
    pub fn read_bytes(self, path: &Path) -> Result<Vec<u8>> {
        let most = self.text_bytes;
        let (file, length) = self.open(path)?;
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
    pub fn read_text(self, path: &Path) -> Result<String> {
        let bytes = self.read_bytes(path)?;
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

    /// Returns whether there is a file at a path that a file of a folder refers to.
    pub fn has(self, path: &Path, folder: &Path) -> bool {
        match self.memory {
            Some(memory) => memory.0.contains_key(&plain(path)),
            None => self.may_look_at(path, folder) && path.is_file(),
        }
    }

    /// Returns a path that is the same for all paths of a file.
    pub fn key(self, path: &Path) -> PathBuf {
        match self.memory {
            Some(_) => plain(path),
            None => path.canonicalize().unwrap_or_else(|_| path.into()),
        }
    }

    /// Returns the path of a file that the file `path` refers to. It must lie in the folder of `path` or below,
    /// unless files outside are allowed.
    pub fn beside(self, path: &Path, name: &str) -> Result<PathBuf> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let file = folder.join(name);
        self.check_place(&file, folder, &path.display().to_string())?;
        Ok(file)
    }

    /// Checks that a file lies in a folder or below it, unless files outside are allowed.
    pub fn check_place(self, file: &Path, folder: &Path, named_by: &str) -> Result<()> {
        if self.outside || self.memory.is_some() {
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
    fn may_look_at(self, file: &Path, folder: &Path) -> bool {
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
    Some(plain(&whole))
}

/// Returns a path without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir => drop(plain.pop()),
            part => plain.push(part),
        }
    }
    plain
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
