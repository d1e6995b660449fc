//! `transforms.json` in the dialects of NeRF, instant-ngp and nerfstudio.
//!
//! Poses are camera-to-world matrices in the axes of OpenGL. They are taken as the file has them: nerfstudio's
//! `applied_transform` is already in them, and is applied here to the points of COLMAP that stand beside.

use std::path::Path;

use serde_json::Value;

use super::draft::{Draft, Drafts, Focal, Intrinsics, wrong};
use super::fields::Fields;
use super::folder::with_ending;
use super::pose::Rows;
use super::view::{Dialect, Split};
use super::{Distortion, colmap};
use crate::error::{Error, Result};
use crate::io::{Files, parse_json};

/// Reads `transforms.json`.
///
/// # Errors
/// If the file is malformed, or names an image that is not there.
pub(super) fn read(file: &Path, files: Files) -> Result<Drafts> {
    let mut drafts = Drafts::new(file, Dialect::Transforms);
    let top = add_frames(&mut drafts, file, None, files)?;
    let folder = file.parent().unwrap_or(Path::new(""));
    let images = folder.join("images");
    drafts.images = images.is_dir().then_some(images);
    let fields = Fields::new(file, "the file", &top, None)?;
    if let Some(name) = fields.text("ply_file_path")? {
        let note = format!("the points of ply_file_path, {name:?}, are not read");
        drafts.notes.push(note);
    }
    if let Some(applied) = fields.rows("applied_transform")? {
        add_points(&mut drafts, folder, applied, files)?;
    }
    Ok(drafts)
}

/// Reads the files of a synthetic scene of NeRF in a folder: those of the parts train, val and test that exist.
///
/// # Errors
/// As [`read`].
pub(super) fn read_parts(folder: &Path, files: Files) -> Result<Drafts> {
    let mut drafts = Drafts::new(
        &folder.join("transforms_train.json"),
        Dialect::NerfSynthetic,
    );
    for (part, split) in [
        ("train", Split::Train),
        ("val", Split::Validation),
        ("test", Split::Test),
    ] {
        let file = folder.join(format!("transforms_{part}.json"));
        if file.is_file() {
            add_frames(&mut drafts, &file, Some(split), files)?;
        } else {
            let note = format!("there is no {}", file.display());
            drafts.notes.push(note);
        }
    }
    Ok(drafts)
}

/// Adds the frames of a file, and returns the file.
fn add_frames(
    drafts: &mut Drafts,
    file: &Path,
    split: Option<Split>,
    files: Files,
) -> Result<Value> {
    let top: Value = parse_json(file, &files.read_bytes(file)?)?;
    let Some(frames) = top.get("frames").and_then(Value::as_array) else {
        return Err(Error::format(file, "frames is missing, expected a list"));
    };
    let fields = Fields::new(file, "the file", &top, None)?;
    let parts = [
        ("train_filenames", Split::Train),
        ("val_filenames", Split::Validation),
        ("test_filenames", Split::Test),
    ];
    let mut lists = Vec::new();
    for (name, split) in parts {
        let names = fields.texts(name)?;
        lists.extend(
            names
                .into_iter()
                .map(|name| (plain(name).to_owned(), split)),
        );
    }
    for (i, frame) in frames.iter().enumerate() {
        let place = format!("frames[{i}]");
        let fields = Fields::new(file, &place, frame, Some(&top))?;
        let mut draft = frame_of(&fields, files)?;
        let listed = lists.iter().find(|(name, _)| *name == draft.name);
        draft.split = split.or(listed.map(|(_, split)| *split));
        drafts.views.push(draft);
    }
    let known = |name: &String| drafts.views.iter().any(|view| view.name == *name);
    if let Some((name, _)) = lists.iter().find(|(name, _)| !known(name)) {
        let message = format!("{name:?} is in a list of the file, but no frame has this file_path");
        return Err(Error::format(file, message));
    }
    Ok(top)
}

/// Returns a name without a dot and slash before it.
fn plain(name: &str) -> &str {
    name.strip_prefix("./").unwrap_or(name)
}

fn frame_of(fields: &Fields, files: Files) -> Result<Draft> {
    let (file, place) = (fields.file, fields.place);
    let name = plain(fields.own_text("file_path")?.ok_or_else(|| {
        wrong(
            file,
            place,
            "file_path",
            "is missing, expected the name of an image",
        )
    })?);
    let find = |field: &str, name: &str| {
        let path = files.beside(file, name)?;
        with_ending(&path).ok_or_else(|| {
            let message = format!("is {name:?}, but there is no image {}", path.display());
            wrong(file, place, field, &message)
        })
    };
    let path = find("file_path", name)?;
    let mask = fields.own_text("mask_path")?;
    let mask = mask
        .map(|name| find("mask_path", plain(name)))
        .transpose()?;
    let rows = fields.rows("transform_matrix")?.ok_or_else(|| {
        let message = "is missing, expected 4 rows of 4 numbers";
        wrong(file, place, "transform_matrix", message)
    })?;
    Ok(Draft {
        name: name.into(),
        path,
        mask,
        rows,
        intrinsics: intrinsics_of(fields)?,
        split: None,
        depths: None,
        place: place.into(),
    })
}

fn intrinsics_of(fields: &Fields) -> Result<Intrinsics> {
    let focal = |length: &str, angle: &str| -> Result<Option<Focal>> {
        let pixels = fields.number(length)?.map(Focal::Pixels);
        Ok(pixels.or(fields.number(angle)?.map(Focal::Angle)))
    };
    let Some(across) = focal("fl_x", "camera_angle_x")? else {
        let message = "is missing, expected it or camera_angle_x, in the frame or at the top";
        return Err(wrong(fields.file, fields.place, "fl_x", message));
    };
    let size = [fields.number("w")?, fields.number("h")?];
    let size = match size {
        [Some(width), Some(height)] => Some([width, height]),
        _ => None,
    };
    Ok(Intrinsics {
        focal: across,
        focal_y: focal("fl_y", "camera_angle_y")?,
        principal: [fields.number("cx")?, fields.number("cy")?],
        size,
        distortion: distortion_of(fields)?,
    })
}

fn distortion_of(fields: &Fields) -> Result<Distortion> {
    let model = fields.text("camera_model")?.unwrap_or("OPENCV");
    let number = |name: &str| fields.number(name).map(Option::unwrap_or_default);
    let ks = ["k1", "k2", "k3", "k4", "k5", "k6"];
    let mut k = [0.0; 6];
    for (k, name) in k.iter_mut().zip(ks) {
        *k = number(name)?;
    }
    let [k1, k2, k3, k4, k5, k6] = k;
    let fisheye = fields.flag("is_fisheye")? || model == "OPENCV_FISHEYE";
    let distortion = match model {
        "PINHOLE" | "SIMPLE_PINHOLE" => Distortion::None,
        "OPENCV" | "OPENCV_FISHEYE" if fisheye => Distortion::Fisheye {
            k: [k1, k2, k3, k4],
        },
        "OPENCV" | "FULL_OPENCV" | "SIMPLE_RADIAL" | "RADIAL" => {
            // With k5 and k6, k4 is OpenCV's, in the denominator. Alone it is the last one of nerfstudio's polynomial.
            let full = model == "FULL_OPENCV" || k5 != 0.0 || k6 != 0.0;
            Distortion::Radial {
                numerator: [k1, k2, k3, if full { 0.0 } else { k4 }],
                denominator: if full { [k4, k5, k6] } else { [0.0; 3] },
                tangential: [number("p1")?, number("p2")?],
            }
        }
        _ => {
            let message = format!(
                "is {model:?}, expected one of PINHOLE, SIMPLE_PINHOLE, OPENCV, OPENCV_FISHEYE, SIMPLE_RADIAL, RADIAL \
                 and FULL_OPENCV"
            );
            return Err(wrong(fields.file, fields.place, "camera_model", &message));
        }
    };
    Ok(if distortion.is_none() {
        Distortion::None
    } else {
        distortion
    })
}

/// Adds the points of COLMAP's model beside the file, if there is one, by the transformation that the file's poses have.
fn add_points(drafts: &mut Drafts, folder: &Path, applied: Rows, files: Files) -> Result<()> {
    let Some(model) = colmap::model_in(folder) else {
        return Ok(());
    };
    let points = colmap::points_of(&model, files)?;
    if !points.is_empty() {
        let note = format!(
            "{} points are those of {}, transformed by applied_transform",
            points.len(),
            model.folder.display()
        );
        drafts.notes.push(note);
    }
    let moved = |p: [f64; 3]| applied.map(|[a, b, c, d]| a * p[0] + b * p[1] + c * p[2] + d);
    drafts.points = points.into_iter().map(moved).collect();
    Ok(())
}
