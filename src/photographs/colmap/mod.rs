//! Models of COLMAP: `cameras`, `images` and `points3D`, binary or as text.
//!
//! `rigs` and `frames` beside them are not read: `images` has the pose of each image itself.

mod binary;
mod lens;
mod text;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::Distortion;
use super::draft::{Draft, Drafts, Focal, Intrinsics, finite, wrong};
use super::folder::name_of;
use super::pose::{from_opencv, rotation_of};
use super::view::Dialect;
use crate::error::{Error, Result};
use crate::io::Files;
use lens::{Lens, Placed};

/// The folder of a model, and whether its files are binary.
pub(super) struct Model {
    pub folder: PathBuf,
    binary: bool,
}

impl Model {
    fn file(&self, name: &str) -> PathBuf {
        let ending = if self.binary { "bin" } else { "txt" };
        self.folder.join(format!("{name}.{ending}"))
    }
}

/// Where a model may be in a folder.
pub(super) const PLACES: [&str; 4] = ["", "sparse/0", "sparse", "colmap/sparse/0"];

/// Returns the first model in a folder. Binary files come before text.
pub(super) fn model_in(folder: &Path) -> Option<Model> {
    let models = PLACES.iter().flat_map(|place| {
        [true, false].map(|binary| Model {
            folder: folder.join(place),
            binary,
        })
    });
    let exists = |model: &Model| {
        let files = ["cameras", "images"].map(|name| model.file(name));
        files.iter().all(|file| file.is_file())
    };
    models.into_iter().find(exists)
}

/// Reads the points of a model; none if it has no file of them.
pub(super) fn points_of(model: &Model, files: Files) -> Result<Vec<[f64; 3]>> {
    let file = model.file("points3D");
    match (file.is_file(), model.binary) {
        (false, _) => Ok(Vec::new()),
        (true, true) => binary::points(&file, &files.read_bytes(&file)?),
        (true, false) => text::points(&file, &files.read_text(&file)?),
    }
}

/// Reads a model. The images are in `images` or `input` of the folder, or in the folder itself.
///
/// # Errors
/// If a file is malformed, or names an image that is not there.
pub(super) fn read(folder: &Path, model: &Model, files: Files) -> Result<Drafts> {
    let [camera_file, image_file] = ["cameras", "images"].map(|name| model.file(name));
    let (lenses, placed) = match model.binary {
        true => (
            binary::cameras(&camera_file, &files.read_bytes(&camera_file)?)?,
            binary::images(&image_file, &files.read_bytes(&image_file)?)?,
        ),
        false => (
            text::cameras(&camera_file, &files.read_text(&camera_file)?)?,
            text::images(&image_file, &files.read_text(&image_file)?)?,
        ),
    };
    let mut all = BTreeMap::new();
    for (id, lens) in lenses {
        all.insert(id, intrinsics_of(&camera_file, id, &lens)?);
    }
    let mut drafts = Drafts::new(&image_file, Dialect::Colmap);
    let first = placed.first().map_or("", |(_, image)| &image.name);
    let candidates = ["images", "input", ""].map(|name| folder.join(name));
    let images = candidates.iter().find(|c| c.join(first).is_file());
    let images = images.unwrap_or(&candidates[0]);
    drafts.images = images.is_dir().then(|| images.clone());
    for (id, image) in placed {
        let place = format!("image {id}");
        let Some(&intrinsics) = all.get(&image.camera) else {
            let message = format!(
                "is {}, but {} has no such camera",
                image.camera,
                name_of(&camera_file)
            );
            return Err(wrong(&image_file, &place, "camera", &message));
        };
        drafts.views.push(draft_of(
            &image_file,
            &place,
            image,
            intrinsics,
            images,
            files,
        )?);
    }
    // COLMAP's own order is that in which it placed the images.
    drafts.views.sort_by(|a, b| a.name.cmp(&b.name));
    drafts.points = points_of(model, files)?;
    Ok(drafts)
}

fn draft_of(
    file: &Path,
    place: &str,
    image: Placed,
    intrinsics: Intrinsics,
    images: &Path,
    files: Files,
) -> Result<Draft> {
    let path = images.join(&image.name);
    files.check_place(&path, images, &format!("{}: {place}", file.display()))?;
    if !path.is_file() {
        let message = format!(
            "is {:?}, but there is no file {}",
            image.name,
            path.display()
        );
        return Err(wrong(file, place, "name", &message));
    }
    for value in image.quaternion {
        finite(file, place, "rotation", value)?;
    }
    for value in image.translation {
        finite(file, place, "translation", value)?;
    }
    if image.quaternion.iter().all(|&v| v == 0.0) {
        return Err(wrong(
            file,
            place,
            "rotation",
            "is 0, expected a quaternion",
        ));
    }
    Ok(Draft {
        name: image.name,
        path,
        mask: None,
        rows: from_opencv(
            rotation_of(image.quaternion),
            DVec3::from(image.translation),
        ),
        intrinsics,
        split: None,
        depths: None,
        place: place.into(),
    })
}

fn intrinsics_of(file: &Path, id: u32, lens: &Lens) -> Result<Intrinsics> {
    let place = format!("camera {id}");
    for &value in &lens.parameters {
        finite(file, &place, "parameter", value)?;
    }
    let p = &lens.parameters[..];
    let one_focal_length = matches!(
        lens.model,
        "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE"
    );
    let (focal, center, k) = match (one_focal_length, p) {
        (true, [f, x, y, k @ ..]) => ([*f, *f], [*x, *y], k),
        (false, [fx, fy, x, y, k @ ..]) => ([*fx, *fy], [*x, *y], k),
        _ => {
            let message = format!("are {p:?}, too few for {}", lens.model);
            return Err(wrong(file, &place, "parameters", &message));
        }
    };
    let radial = |numerator: [f64; 3], denominator, tangential| {
        let [a, b, c] = numerator;
        Distortion::Radial {
            numerator: [a, b, c, 0.0],
            denominator,
            tangential,
        }
    };
    let distortion = match (lens.model, k) {
        ("SIMPLE_RADIAL", &[k]) => radial([k, 0.0, 0.0], [0.0; 3], [0.0; 2]),
        ("RADIAL", &[k1, k2]) => radial([k1, k2, 0.0], [0.0; 3], [0.0; 2]),
        ("OPENCV", &[k1, k2, p1, p2]) => radial([k1, k2, 0.0], [0.0; 3], [p1, p2]),
        ("FULL_OPENCV", &[k1, k2, p1, p2, k3, k4, k5, k6]) => {
            radial([k1, k2, k3], [k4, k5, k6], [p1, p2])
        }
        ("OPENCV_FISHEYE", &[k1, k2, k3, k4]) => Distortion::Fisheye {
            k: [k1, k2, k3, k4],
        },
        ("SIMPLE_RADIAL_FISHEYE", &[k]) => Distortion::Fisheye {
            k: [k, 0.0, 0.0, 0.0],
        },
        ("RADIAL_FISHEYE", &[k1, k2]) => Distortion::Fisheye {
            k: [k1, k2, 0.0, 0.0],
        },
        _ => Distortion::None,
    };
    if lens.size.contains(&0) {
        let message = format!(
            "is {} × {}, expected columns and rows",
            lens.size[0], lens.size[1]
        );
        return Err(Error::format(file, format!("{place}: size {message}")));
    }
    Ok(Intrinsics {
        focal: Focal::Pixels(focal[0]),
        focal_y: Some(Focal::Pixels(focal[1])),
        principal: center.map(Some),
        size: Some(lens.size.map(|n| n as f64)),
        distortion: match distortion.is_none() {
            true => Distortion::None,
            false => distortion,
        },
    })
}
