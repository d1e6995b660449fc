//! Views of a file with the images that are there: sizes, orientations, masks.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::draft::{Draft, Drafts, Focal, wrong};
use super::folder::{name_of, with_ending};
use super::pose::with_unit_axes;
use super::{View, ViewCamera};
use crate::error::Result;
use crate::io::{Files, Raster};

/// What was found about views, with the names of the views for which it holds.
#[derive(Default)]
pub(super) struct Findings(BTreeMap<String, Vec<String>>);

impl Findings {
    fn add(&mut self, what: impl Into<String>, name: &str) {
        self.0.entry(what.into()).or_default().push(name.into());
    }

    /// Returns a note for each finding.
    pub fn notes(self) -> Vec<String> {
        let note = |(what, names): (String, Vec<String>)| format!("{what}: {}", names.join(", "));
        self.0.into_iter().map(note).collect()
    }
}

/// Looks at the images of all views.
///
/// # Errors
/// If a camera is not valid, an image can't be read, or its size has another aspect ratio than its camera.
pub(super) fn settle(
    drafts: &Drafts,
    folder: &Path,
    files: Files,
) -> Result<(Vec<View>, Vec<String>)> {
    let mut findings = Findings::default();
    let masks = MaskFolder::of(folder);
    let mut views = Vec::with_capacity(drafts.views.len());
    for draft in &drafts.views {
        let mut view = view_of(&drafts.file, draft, files, &mut findings)?;
        if view.mask_path.is_none()
            && let Some(masks) = &masks
        {
            view.mask_path = masks.mask_of(&view);
            if view.mask_path.is_none() {
                let what = format!("there is no mask in {}", masks.0.display());
                findings.add(what, &view.name);
            }
        }
        views.push(view);
    }
    Ok((views, findings.notes()))
}

fn view_of(file: &Path, draft: &Draft, files: Files, findings: &mut Findings) -> Result<View> {
    let place = &draft.place;
    let (rows, scale) =
        with_unit_axes(draft.rows).map_err(|message| wrong(file, place, "pose", &message))?;
    if (scale - 1.0).abs() > 1e-3 {
        findings.add(
            "the axes of the pose have another length than 1",
            &draft.name,
        );
    }
    let named_by = format!("{}: {place}", file.display());
    let (stored, exif) =
        Raster::read_size(&draft.path, files).map_err(|error| error.named_by(&named_by))?;
    let fit = fit(draft.intrinsics.size, stored, exif).ok_or_else(|| {
        let [w, h] = draft.intrinsics.size.unwrap_or_default();
        let message = format!(
            "is {w} × {h}, but {} has {} × {} pixels, expected the same aspect ratio",
            draft.path.display(),
            stored[0],
            stored[1]
        );
        wrong(file, place, "size of the camera's image", &message)
    })?;
    if exif != 1 {
        let what = match (fit.orientation == exif, draft.intrinsics.size) {
            (true, _) => {
                "turned by its EXIF orientation, since the camera's size is that of the turned image"
            }
            (false, Some(_)) => {
                "not turned by its EXIF orientation, since the camera's size is that of the stored image"
            }
            (false, None) => {
                "not turned by its EXIF orientation, since the cameras have no size and COLMAP doesn't turn images"
            }
        };
        findings.add(what, &draft.name);
    }
    let calibrated = draft.intrinsics.size.unwrap_or(fit.size.map(|n| n as f64));
    if calibrated != fit.size.map(|n| n as f64) {
        let what = format!(
            "the camera is for {} × {} pixels, and was scaled to the image's {} × {}",
            calibrated[0], calibrated[1], fit.size[0], fit.size[1]
        );
        findings.add(what, &draft.name);
    }
    Ok(View {
        name: draft.name.clone(),
        path: draft.path.clone(),
        mask_path: draft.mask.clone(),
        camera: camera_of(file, draft, rows, calibrated, fit.size)?,
        split: draft.split,
        depths: draft.depths,
        orientation: fit.orientation,
    })
}

fn camera_of(
    file: &Path,
    draft: &Draft,
    to_world: [[f64; 4]; 3],
    calibrated: [f64; 2],
    size: [usize; 2],
) -> Result<ViewCamera> {
    let Draft {
        intrinsics, place, ..
    } = draft;
    let pixels = |focal: Focal, side: f64| match focal {
        Focal::Pixels(pixels) => pixels,
        Focal::Angle(angle) => 0.5 * side / (0.5 * angle).tan(),
    };
    let across = pixels(intrinsics.focal, calibrated[0]);
    let down = intrinsics.focal_y.map(|focal| pixels(focal, calibrated[1]));
    let focal = [across, down.unwrap_or(across)];
    let principal = [0, 1].map(|i| intrinsics.principal[i].unwrap_or(0.5 * calibrated[i]));
    for (field, values) in [("focal length", focal), ("principal point", principal)] {
        let positive = field == "focal length";
        let fine = |v: &f64| v.is_finite() && (!positive || *v > 0.0);
        if let Some(value) = values.iter().find(|v| !fine(v)) {
            let expected = if positive {
                "a finite number > 0"
            } else {
                "a finite number"
            };
            let message = format!("is {value}, expected {expected}");
            return Err(wrong(file, place, field, &message));
        }
    }
    if !intrinsics.distortion.is_finite() {
        let message = format!("is {:?}, expected finite numbers", intrinsics.distortion);
        return Err(wrong(file, place, "distortion", &message));
    }
    let factor = [0, 1].map(|i| size[i] as f64 / calibrated[i]);
    Ok(ViewCamera {
        to_world,
        focal: [0, 1].map(|i| focal[i] * factor[i]),
        principal: [0, 1].map(|i| principal[i] * factor[i]),
        size,
        distortion: intrinsics.distortion,
    })
}

/// The columns and rows of an image, after it was turned by an orientation.
#[derive(Debug, PartialEq)]
struct Fit {
    size: [usize; 2],
    orientation: u8,
}

/// Decides whether a camera is that of the stored image or of the image turned by its EXIF orientation: the stored one
/// if its size fits. `None` if neither has the camera's aspect ratio.
fn fit(camera: Option<[f64; 2]>, stored: [usize; 2], exif: u8) -> Option<Fit> {
    let as_stored = Fit {
        size: stored,
        orientation: 1,
    };
    let Some(camera) = camera else {
        return Some(as_stored);
    };
    let turned = match exif >= 5 {
        true => [stored[1], stored[0]],
        false => stored,
    };
    let turned = Fit {
        size: turned,
        orientation: exif,
    };
    let equal = |fit: &Fit| fit.size.map(|n| n as f64) == camera;
    let similar = |fit: &Fit| {
        // Sides of smaller copies are rounded by up to a pixel.
        let [w, h] = fit.size.map(|n| n as f64);
        let (least, most) = ((w - 1.0) / camera[0], (w + 1.0) / camera[0]);
        let fine = camera.iter().all(|v| v.is_finite() && *v >= 1.0);
        fine && camera[1] * least <= h + 1.0 && camera[1] * most >= h - 1.0
    };
    let candidates = [as_stored, turned];
    let place = candidates.iter().position(equal);
    let place = place.or_else(|| candidates.iter().position(similar))?;
    candidates.into_iter().nth(place)
}

/// A folder of masks with the names of the images.
struct MaskFolder(PathBuf);

impl MaskFolder {
    fn of(folder: &Path) -> Option<Self> {
        let folders = ["masks", "mask"].map(|name| folder.join(name));
        folders.into_iter().find(|f| f.is_dir()).map(Self)
    }

    /// Returns the mask of an image a/b.jpg: `b.jpg.png` as COLMAP names it, or `b` with the ending of an image; in the
    /// folder `a` or directly.
    fn mask_of(&self, view: &View) -> Option<PathBuf> {
        let whole = PathBuf::from(&view.name);
        let inner = whole.components().skip(1).collect();
        let names = [whole.clone(), inner, PathBuf::from(name_of(&view.path))];
        names
            .iter()
            .filter(|name| name.file_name().is_some())
            .find_map(|name| {
                let mut longer = self.0.join(name).into_os_string();
                longer.push(".png");
                let longer = PathBuf::from(longer);
                let same = [longer, self.0.join(name)]
                    .into_iter()
                    .find(|p| p.is_file());
                same.or_else(|| with_ending(&self.0.join(name).with_extension("")))
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_decide_about_orientations() {
        let fit = |camera, exif| fit(camera, [40, 30], exif).map(|f| (f.size, f.orientation));
        let stored = Some(([40, 30], 1));
        for exif in 1..=8 {
            assert_eq!(fit(Some([40.0, 30.0]), exif), stored);
            assert_eq!(fit(None, exif), stored);
            let turned = (exif >= 5).then_some(([30, 40], exif));
            assert_eq!(fit(Some([30.0, 40.0]), exif), turned);
        }
        assert_eq!(fit(Some([4000.0, 3000.0]), 1), stored);
        assert_eq!(fit(Some([3000.0, 4000.0]), 6), Some(([30, 40], 6)));
        assert_eq!(fit(Some([40.0, 40.0]), 1), None);
        assert_eq!(fit(Some([f64::NAN, 40.0]), 1), None);
    }
}
