//! The cameras and images of COLMAP's files, and its models of lenses.

use std::path::Path;

use crate::error::Result;
use crate::photographs::draft::wrong;

/// A camera of a model: its name in messages, COLMAP's model of the lens, columns and rows, and the parameters.
#[derive(Debug)]
pub(super) struct Lens {
    pub model: &'static str,
    pub size: [u64; 2],
    pub parameters: Vec<f64>,
}

/// An image of a model: the pose from world to camera.
#[derive(Debug)]
pub(super) struct Placed {
    /// w, x, y, z.
    pub quaternion: [f64; 4],
    pub translation: [f64; 3],
    pub camera: u32,
    pub name: String,
}

/// The models of lenses that are read, with their numbers and counts of parameters.
const MODELS: [(i32, &str, usize); 9] = [
    (0, "SIMPLE_PINHOLE", 3),
    (1, "PINHOLE", 4),
    (2, "SIMPLE_RADIAL", 4),
    (3, "RADIAL", 5),
    (4, "OPENCV", 8),
    (5, "OPENCV_FISHEYE", 8),
    (6, "FULL_OPENCV", 12),
    (8, "SIMPLE_RADIAL_FISHEYE", 4),
    (9, "RADIAL_FISHEYE", 5),
];

/// Other models, for messages.
const OTHERS: [(i32, &str); 3] = [
    (7, "FOV"),
    (10, "THIN_PRISM_FISHEYE"),
    (11, "RAD_TAN_THIN_PRISM_FISHEYE"),
];

/// Returns a model's name and number of parameters.
pub(super) fn model_of(
    file: &Path,
    place: &str,
    found: ModelName,
) -> Result<(&'static str, usize)> {
    let is_it = |&&(number, name, _): &&(i32, &str, usize)| match found {
        ModelName::Number(n) => n == number,
        ModelName::Text(text) => text == name,
    };
    if let Some(&(_, name, count)) = MODELS.iter().find(is_it) {
        return Ok((name, count));
    }
    let shown = match found {
        ModelName::Text(text) => text.to_owned(),
        ModelName::Number(n) => match OTHERS.iter().find(|(number, _)| *number == n) {
            Some((_, name)) => (*name).to_owned(),
            None => format!("number {n}"),
        },
    };
    let names = MODELS.map(|(_, name, _)| name).join(", ");
    let message =
        format!("is {shown}, expected one of {names}: COLMAP's image_undistorter makes PINHOLE");
    Err(wrong(file, place, "model", &message))
}

/// A model of a lens by its number (binary) or its name (text).
#[derive(Clone, Copy)]
pub(super) enum ModelName<'a> {
    Number(i32),
    Text(&'a str),
}
