//! `poses_bounds.npy` of LLFF: a row of 17 numbers an image, a matrix of 3 × 5 row by row, and the nearest and farthest
//! depth.
//!
//! The columns of the matrix are down, right and backward, the position, and (height, width, focal length). The principal
//! point is the middle of the image. The rows belong to the images of the folder `images`, or of one with smaller images
//! (`images_2`, `images_4`, `images_8`), in the order of their names.

use std::path::Path;

use super::Distortion;
use super::draft::{Draft, Drafts, Focal, Intrinsics};
use super::folder::{images_in, name_of};
use super::numpy::Array;
use super::view::Dialect;
use crate::error::{Error, Result};
use crate::io::Files;

/// Folders of the images, in the order in which they are looked for.
const FOLDERS: [&str; 5] = ["images", "images_1", "images_2", "images_4", "images_8"];

/// Reads `poses_bounds.npy` of a folder.
///
/// # Errors
/// If the file is malformed, or there are more or fewer images than rows.
pub(super) fn read(folder: &Path, file: &Path, files: Files) -> Result<Drafts> {
    let array = Array::parse(&files.read_bytes(file)?, file, "poses")?;
    let &[count, 17] = &array.shape[..] else {
        let message = format!("its shape is {:?}, expected [N, 17]", array.shape);
        return Err(Error::format(file, message));
    };
    let folders = FOLDERS.map(|name| folder.join(name));
    let Some(images) = folders.iter().find(|folder| folder.is_dir()) else {
        let message = format!("there is no folder of its images, expected one of {FOLDERS:?}");
        return Err(Error::format(file, message));
    };
    let paths = images_in(images)?;
    if paths.len() != count {
        let message = format!(
            "it has {count} poses, but {} has {} images, expected as many",
            images.display(),
            paths.len()
        );
        return Err(Error::format(file, message));
    }
    let mut drafts = Drafts::new(file, Dialect::Llff);
    for (i, (path, row)) in paths
        .into_iter()
        .zip(array.values.chunks_exact(17))
        .enumerate()
    {
        let at = |r: usize, c: usize| row[5 * r + c];
        drafts.views.push(Draft {
            name: name_of(&path),
            path,
            mask: None,
            rows: [0, 1, 2].map(|r| [at(r, 1), -at(r, 0), at(r, 2), at(r, 3)]),
            intrinsics: Intrinsics {
                focal: Focal::Pixels(at(2, 4)),
                focal_y: None,
                principal: [None; 2],
                size: Some([at(1, 4), at(0, 4)]),
                distortion: Distortion::None,
            },
            split: None,
            depths: Some([row[15], row[16]]),
            place: format!("row {i}"),
        });
    }
    Ok(drafts)
}
