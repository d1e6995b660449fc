//! Views as a file of cameras describes them, before their images are looked at.

use std::path::{Path, PathBuf};

use super::Distortion;
use super::pose::Rows;
use super::region::Region;
use super::view::{Dialect, Split};
use crate::error::{Error, Result};

/// A focal length.
#[derive(Clone, Copy, Debug)]
pub(super) enum Focal {
    Pixels(f64),
    /// The angle in radians that the image's whole width or height subtends.
    Angle(f64),
}

/// The matrix K of a file. What is missing follows from the size of the image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Intrinsics {
    pub focal: Focal,
    /// The focal length for y, if it is not that for x.
    pub focal_y: Option<Focal>,
    /// The principal point from the upper left corner, in pixels of `size`. `None` for the middle.
    pub principal: [Option<f64>; 2],
    /// Columns and rows of the images of the calibration. `None` for those of the image.
    pub size: Option<[f64; 2]>,
    pub distortion: Distortion,
}

/// A view of a file.
#[derive(Clone, Debug)]
pub(super) struct Draft {
    pub name: String,
    pub path: PathBuf,
    pub mask: Option<PathBuf>,
    pub rows: Rows,
    pub intrinsics: Intrinsics,
    pub split: Option<Split>,
    pub depths: Option<[f64; 2]>,
    /// Where the file describes it, for messages: `frames[3]`.
    pub place: String,
}

/// All that a file of cameras says.
#[derive(Debug)]
pub(super) struct Drafts {
    /// The file.
    pub file: PathBuf,
    pub dialect: Dialect,
    pub views: Vec<Draft>,
    /// The folder whose images should all have a camera.
    pub images: Option<PathBuf>,
    pub points: Vec<[f64; 3]>,
    pub region: Option<Region>,
    pub notes: Vec<String>,
}

impl Drafts {
    pub fn new(file: &Path, dialect: Dialect) -> Self {
        Self {
            file: file.into(),
            dialect,
            views: Vec::new(),
            images: None,
            points: Vec::new(),
            region: None,
            notes: Vec::new(),
        }
    }
}

/// Returns an error about a field of a file.
pub(super) fn wrong(file: &Path, place: &str, field: &str, message: &str) -> Error {
    Error::format(file, format!("{place}: {field} {message}"))
}

/// Checks a number of a file, and returns it.
pub(super) fn finite(file: &Path, place: &str, field: &str, value: f64) -> Result<f64> {
    match value.is_finite() {
        true => Ok(value),
        false => {
            let message = format!("is {value}, expected a finite number");
            Err(wrong(file, place, field, &message))
        }
    }
}
