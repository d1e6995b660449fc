//! Files of a folder: images in order, and the first of several places that exists.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Endings of the image formats that are read.
const ENDINGS: [&str; 9] = [
    "png", "jpg", "jpeg", "exr", "hdr", "webp", "bmp", "tga", "gif",
];

/// Returns whether a file has the ending of an image.
pub(super) fn is_image(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default();
    ENDINGS.iter().any(|e| ending.eq_ignore_ascii_case(e))
}

/// Returns the images in a folder, ordered by name. Files that begin with a dot are left out.
///
/// # Errors
/// If the folder can't be read.
pub(super) fn images_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let io = Error::io(folder);
    let mut images = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let hidden = name_of(&path).starts_with('.');
        if !hidden && is_image(&path) && path.is_file() {
            images.push(path);
        }
    }
    images.sort();
    Ok(images)
}

/// Returns the last part of a path.
pub(super) fn name_of(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// Returns all image files in a folder and the folders below it, by their names from the folder with `/`.
pub(super) fn names_below(folder: &Path) -> Result<Vec<String>> {
    fn visit(folder: &Path, prefix: &str, depth: usize, names: &mut Vec<String>) -> Result<()> {
        /// Folders deeper than this are not looked at; a link may lead in a circle.
        const DEEPEST: usize = 4;
        let images = images_in(folder)?;
        names.extend(images.iter().map(|path| prefix.to_owned() + &name_of(path)));
        let io = Error::io(folder);
        for entry in std::fs::read_dir(folder).map_err(io)? {
            let path = entry.map_err(io)?.path();
            if depth < DEEPEST && path.is_dir() {
                let prefix = format!("{prefix}{}/", name_of(&path));
                visit(&path, &prefix, depth + 1, names)?;
            }
        }
        Ok(())
    }
    let mut names = Vec::new();
    visit(folder, "", 0, &mut names)?;
    names.sort();
    Ok(names)
}

/// Returns the file with a name in a folder: the name itself, or with the ending of an image if it has none.
pub(super) fn with_ending(path: &Path) -> Option<PathBuf> {
    if is_image(path) && path.is_file() {
        return Some(path.into());
    }
    let endings = ENDINGS.iter().map(|e| (*e).to_owned());
    let upper = ENDINGS.iter().map(|e| e.to_uppercase());
    let longer = |ending: String| {
        let mut name = path.as_os_str().to_owned();
        name.push(".");
        name.push(ending);
        PathBuf::from(name)
    };
    endings.chain(upper).map(longer).find(|path| path.is_file())
}
