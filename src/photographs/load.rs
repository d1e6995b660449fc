//! Photographs are read, freed of the distortion of their lenses and shrunk, one at a time.

use std::path::Path;

use super::area::{limited, shrink};
use super::background::{Background, plain_background};
use super::photograph::{Photograph, Sample};
use super::{View, ViewCamera};
use crate::error::{Error, Result};
use crate::io::{Files, LoadLimits, Raster};

/// How photographs are loaded.
///
/// ```
/// use softray::photographs::PhotographOptions;
/// let options = PhotographOptions::new().with_longest_side(800).with_memory(1 << 30);
/// # let _ = options;
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotographOptions {
    pub(super) longest: Option<usize>,
    pub(super) memory: u64,
    pub(super) limits: LoadLimits,
    black: bool,
    plain: bool,
}

impl Default for PhotographOptions {
    fn default() -> Self {
        Self {
            longest: None,
            memory: 1 << 31,
            limits: LoadLimits::default(),
            black: false,
            plain: true,
        }
    }
}

impl PhotographOptions {
    /// Photographs at full size, in at most 2 GiB of memory.
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets the longest side in pixels to which photographs are shrunk. Smaller ones stay as they are.
    pub fn with_longest_side(self, pixels: usize) -> Self {
        Self {
            longest: Some(pixels.max(1)),
            ..self
        }
    }

    /// Sets the memory in bytes that all loaded photographs together may take, 2³¹ by default. Each takes 20 bytes a
    /// pixel. The one or two files that are decoded at a time come on top.
    pub fn with_memory(self, bytes: u64) -> Self {
        Self {
            memory: bytes,
            ..self
        }
    }

    /// Sets whether colors are multiplied by the mask before they are shrunk (false by default), so that they are as
    /// before black. The colors of images with alpha always are.
    pub fn with_black_backdrop(self, black: bool) -> Self {
        Self { black, ..self }
    }

    /// Sets whether a plain background, white or black, becomes the mask of photographs that have no other (true by
    /// default). A note names the photographs with one.
    pub fn with_plain_background(self, plain: bool) -> Self {
        Self { plain, ..self }
    }

    /// Sets the limits of single files.
    pub fn with_limits(self, limits: LoadLimits) -> Self {
        Self { limits, ..self }
    }
}

/// The mask of a photograph at full size.
enum Mask {
    None,
    Values(Vec<f32>),
    Plain(Background),
}

impl Mask {
    fn at(&self, i: usize) -> f32 {
        match self {
            Self::None => 1.0,
            Self::Values(values) => values[i].clamp(0.0, 1.0),
            Self::Plain(background) => f32::from(u8::from(!background.is_background[i])),
        }
    }
}

/// Loads the photograph of a view, and returns it with the name of the plain background that was found.
///
/// # Errors
/// If a file can't be read, has another size than when the set was opened, or has pixels that are not finite.
pub(super) fn load(
    view: &View,
    options: &PhotographOptions,
) -> Result<(Photograph, Option<&'static str>)> {
    let files = Files::of_system(&options.limits);
    let raster = Raster::read(&view.path, view.orientation, files)?;
    let full = view.camera.size;
    same_size(&view.path, raster.size(), full)?;
    let mask = match &view.mask_path {
        Some(path) => Mask::Values(mask_of(path, view, files)?),
        None if raster.has_alpha() || !options.plain => Mask::None,
        None => plain_background(&raster).map_or(Mask::None, Mask::Plain),
    };
    let masked = raster.has_alpha() || !matches!(mask, Mask::None);
    let mut colors = vec![[0.0; 4]; full[0]];
    let read = |y: usize, row: &mut [Sample]| {
        raster.row(y, &mut colors);
        for (x, (sample, [red, green, blue, alpha])) in row.iter_mut().zip(&colors).enumerate() {
            let object = mask.at(y * full[0] + x);
            let factor = if options.black {
                alpha * object
            } else {
                *alpha
            };
            *sample = [
                red * factor,
                green * factor,
                blue * factor,
                alpha * object,
                1.0,
            ];
        }
    };
    let size = limited(full, options.longest);
    let camera = view.camera.scaled_to(size).pinhole();
    let samples = match view.camera.distortion.is_none() {
        true => shrink(full, size, read),
        false => {
            // Undistorted at twice the size: looking between pixels blurs less there than the mean over areas does.
            let between = [0, 1].map(|i| full[i].min(2 * size[i]));
            let lens = view.camera.scaled_to(between);
            let image = shrink(full, between, read);
            shrink(between, size, |y, row| undistorted(&lens, &image, y, row))
        }
    };
    if let Some(i) = samples
        .iter()
        .position(|s| s.iter().any(|v| !v.is_finite()))
    {
        let message = format!(
            "near to its pixel ({}, {}) it is not a number or infinite, expected finite numbers",
            (i % size[0]) * full[0] / size[0],
            (i / size[0]) * full[1] / size[1]
        );
        return Err(Error::format(&view.path, message));
    }
    let photograph = Photograph::of_samples(&view.name, &samples, camera, masked)?;
    let found = match mask {
        Mask::Plain(background) => Some(background.name),
        _ => None,
    };
    Ok((photograph, found))
}

fn same_size(path: &Path, found: [usize; 2], expected: [usize; 2]) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    let [found, expected] = [found, expected].map(|[w, h]| format!("{w} × {h}"));
    let message = format!("it has {found} pixels, expected {expected} as its photograph's camera");
    Err(Error::format(path, message))
}

/// Reads a mask file, which has the size of its photograph, or that of the stored photograph if it is turned.
fn mask_of(path: &Path, view: &View, files: Files) -> Result<Vec<f32>> {
    let (stored, _) = Raster::read_size(path, files)?;
    let turned = view.orientation >= 5 && stored != view.camera.size;
    let orientation = if turned { view.orientation } else { 1 };
    let raster = Raster::read(path, orientation, files)?;
    same_size(path, raster.size(), view.camera.size)?;
    Ok(raster.numbers())
}

/// Writes row y of the image that a pinhole sees, from that of a lens, by interpolation between the nearest four pixels.
/// Pixels outside of the image have weight 0.
fn undistorted(lens: &ViewCamera, image: &[Sample], y: usize, row: &mut [Sample]) {
    let [width, height] = lens.size;
    let reach = lens.distortion.reach();
    let inverse = |i: usize, pixel: usize| (pixel as f64 + 0.5 - lens.principal[i]) / lens.focal[i];
    let down = inverse(1, y);
    for (x, sample) in row.iter_mut().enumerate() {
        *sample = [0.0; 5];
        let direction = [inverse(0, x), down];
        if direction[0].hypot(direction[1]) > reach {
            continue;
        }
        let shown = lens.distortion.distort(direction);
        let [u, v] = [0, 1].map(|i| lens.principal[i] + lens.focal[i] * shown[i]);
        let inside = (0.0..=width as f64).contains(&u) && (0.0..=height as f64).contains(&v);
        if !inside {
            continue;
        }
        let between = |at: f64, count: usize| {
            let at = (at - 0.5).clamp(0.0, (count - 1) as f64);
            let low = (at as usize).min(count - 1);
            (low, (low + 1).min(count - 1), (at - low as f64) as f32)
        };
        let (left, right, s) = between(u, width);
        let (top, bottom, t) = between(v, height);
        for (column, row, weight) in [
            (left, top, (1.0 - s) * (1.0 - t)),
            (right, top, s * (1.0 - t)),
            (left, bottom, (1.0 - s) * t),
            (right, bottom, s * t),
        ] {
            let pixel = &image[row * width + column];
            for (sum, value) in sample.iter_mut().zip(pixel) {
                *sum += weight * value;
            }
        }
    }
}
