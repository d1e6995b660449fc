//! `cameras_sphere.npz` of NeuS and IDR: for each image i, the projection `world_mat_i` and the region `scale_mat_i`.
//!
//! Cameras are in the world of `world_mat`, P = K·[R|t]. NeuS itself works in the frame of `scale_mat`, in which the
//! object lies in the unit sphere; here this sphere is the set's region. Its pixels have their centers at whole numbers,
//! so half a pixel is added to the principal point. Masks are the images of the folder `mask`, in order.

use std::path::{Path, PathBuf};

use super::Distortion;
use super::draft::{Draft, Drafts, Focal, Intrinsics, wrong};
use super::folder::{images_in, name_of};
use super::numpy::Archive;
use super::pose::{decomposed, from_opencv};
use super::region::Region;
use super::view::Dialect;
use crate::error::{Error, Result};
use crate::io::Files;

/// Folders of the images, in the order in which they are looked for.
const FOLDERS: [&str; 2] = ["image", "images"];

/// The skew, relative to the focal length, that counts as rounding.
const SKEW: f64 = 1e-3;

/// Reads `cameras_sphere.npz` of a folder.
///
/// # Errors
/// If the file is malformed, or there are more or fewer images than cameras.
pub(super) fn read(folder: &Path, file: &Path, files: Files) -> Result<Drafts> {
    let bytes = files.read_bytes(file)?;
    let mut archive = Archive::open(&bytes, file)?;
    let folders = FOLDERS.map(|name| folder.join(name));
    let Some(images) = folders.iter().find(|folder| folder.is_dir()) else {
        let message = format!("there is no folder of its images, expected one of {FOLDERS:?}");
        return Err(Error::format(file, message));
    };
    let paths = images_in(images)?;
    let has = |i: usize| archive.has(&format!("world_mat_{i}"));
    let count = (0..).find(|&i| !has(i)).unwrap_or(0);
    if paths.len() != count {
        let message = format!(
            "it has {count} matrices world_mat_0, world_mat_1 and so on, but {} has {} images, expected as many",
            images.display(),
            paths.len()
        );
        return Err(Error::format(file, message));
    }
    let masks = masks_of(folder, file, count)?;
    let mut drafts = Drafts::new(file, Dialect::Neus);
    for (i, path) in paths.into_iter().enumerate() {
        let field = format!("world_mat_{i}");
        let rows = archive.rows(&field)?;
        let draft = draft_of(file, &format!("image {i}"), &field, rows, &path)?;
        let mask = masks.get(i).cloned();
        drafts.views.push(Draft { mask, ..draft });
    }
    if archive.has("scale_mat_0") {
        let rows = archive.rows("scale_mat_0")?;
        let radius = rows[0][0];
        if radius <= 0.0 {
            let message = format!("scale_mat_0: its scale is {radius}, expected a number > 0");
            return Err(Error::format(file, message));
        }
        drafts.region = Some(Region::sphere(rows.map(|row| row[3]), radius));
    }
    Ok(drafts)
}

/// Returns the masks in the order of the images; none if there is no folder `mask`. Their names may have fewer digits than
/// those of the images.
fn masks_of(folder: &Path, file: &Path, count: usize) -> Result<Vec<PathBuf>> {
    let folder = folder.join("mask");
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let masks = images_in(&folder)?;
    if masks.len() != count {
        let message = format!(
            "it has {count} cameras, but {} has {} images, expected as many",
            folder.display(),
            masks.len()
        );
        return Err(Error::format(file, message));
    }
    Ok(masks)
}

fn draft_of(
    file: &Path,
    place: &str,
    field: &str,
    projection: [[f64; 4]; 3],
    path: &Path,
) -> Result<Draft> {
    let Some(parts) = decomposed(projection) else {
        let message = format!("is {projection:?}, expected K·[R|t] with an inverse of K·R");
        return Err(wrong(file, place, field, &message));
    };
    let [[fx, skew, cx], [_, fy, cy], _] = parts.k;
    if skew.abs() > SKEW * fx {
        let message = format!("has the skew {skew} at the focal length {fx}, expected none");
        return Err(wrong(file, place, field, &message));
    }
    Ok(Draft {
        name: name_of(path),
        path: path.into(),
        mask: None,
        rows: from_opencv(parts.rotation, parts.translation),
        intrinsics: Intrinsics {
            focal: Focal::Pixels(fx),
            focal_y: Some(Focal::Pixels(fy)),
            principal: [cx, cy].map(|c| Some(c + 0.5)),
            size: None,
            distortion: Distortion::None,
        },
        split: None,
        depths: None,
        place: place.into(),
    })
}
