//! A photograph in memory.

use super::ViewCamera;
use super::area::{limited, shrink};
use super::camera::Window;
use crate::error::{Error, Result};
use crate::io::HostImage;
use crate::meshing::Silhouette;

/// Color, mask and weight of a pixel. Color and mask are multiplied by the weight.
pub(super) type Sample = [f32; 5];

/// The bytes of a pixel of a photograph.
pub(super) const PIXEL_BYTES: u64 = size_of::<Sample>() as u64;

/// A loaded photograph: without distortion of its lens, and shrunk.
#[derive(Clone, Debug, PartialEq)]
pub struct Photograph {
    /// The view's name.
    pub name: String,
    /// Linear RGB. An image with alpha is composited on black; with a mask of another source the color is that of the
    /// file, unless [`PhotographOptions::with_black_backdrop`](super::PhotographOptions::with_black_backdrop) is set.
    pub color: HostImage,
    /// The part of each pixel that shows the object, 0 to 1, `height · width` values row by row. All are 1 if the view has
    /// no mask.
    pub mask: Vec<f32>,
    /// The part of each pixel that the photograph shows, 0 to 1, row by row: 0 where undoing the distortion of the lens
    /// looks outside of the photograph. It multiplies the loss of a pixel.
    pub weight: Vec<f32>,
    /// Whether the view has a mask.
    pub masked: bool,
    /// The pinhole camera of this image.
    pub camera: ViewCamera,
}

impl Photograph {
    /// Makes a photograph from the pixels of its camera's image.
    pub(super) fn of_samples(
        name: &str,
        samples: &[Sample],
        camera: ViewCamera,
        masked: bool,
    ) -> Result<Self> {
        let [width, height] = camera.size;
        let mut pixels = Vec::with_capacity(samples.len() * 3);
        let mut mask = Vec::with_capacity(samples.len());
        for [red, green, blue, object, weight] in samples {
            let factor = if *weight > 0.0 { weight.recip() } else { 0.0 };
            pixels.extend([red, green, blue].map(|v| v * factor));
            mask.push((object * factor).clamp(0.0, 1.0));
        }
        Ok(Self {
            name: name.into(),
            color: HostImage::new(width, height, pixels)?,
            mask,
            weight: samples.iter().map(|s| s[4].clamp(0.0, 1.0)).collect(),
            masked,
            camera,
        })
    }

    /// Returns the mask as a silhouette, from which [`visual_hull`](crate::meshing::visual_hull) carves.
    pub fn silhouette(&self) -> Silhouette<'_> {
        let camera = &self.camera;
        Silhouette {
            world_to_camera: camera.from_world(),
            focal: camera.focal,
            principal: camera.principal,
            width: camera.size[0],
            height: camera.size[1],
            mask: &self.mask,
        }
    }

    /// The mean linear color of the object, of a photograph whose color is 0 beside it.
    pub fn mean_color(&self) -> [f64; 3] {
        let shown: f64 = self.mask.iter().map(|&m| f64::from(m)).sum();
        let factor = self.mask.len() as f64 / shown.max(f64::MIN_POSITIVE);
        self.color.mean().map(|c| c * factor)
    }

    /// Checks that all lists have the size of the camera's image.
    pub(crate) fn check(&self) -> Result<()> {
        let [width, height] = self.camera.size;
        let color = [self.color.width, self.color.height] == self.camera.size;
        let color = color && self.color.pixels.len() == 3 * width * height;
        for (field, fits) in [
            ("color", color),
            ("mask", self.mask.len() == width * height),
            ("weight", self.weight.len() == width * height),
        ] {
            let expected = format!("that of the camera, {width} × {height}");
            Error::unless(fits, &self.name, field, "of another size", &expected)?;
        }
        Ok(())
    }

    /// Writes a row's samples.
    fn row(&self, y: usize, row: &mut [Sample]) {
        let width = self.camera.size[0];
        for (x, sample) in row.iter_mut().enumerate() {
            let i = y * width + x;
            let weight = self.weight[i];
            let color = &self.color.pixels[3 * i..3 * i + 3];
            let [red, green, blue] = [0, 1, 2].map(|c| color[c] * weight);
            *sample = [red, green, blue, self.mask[i] * weight, weight];
        }
    }

    /// Returns the photograph with its longest side at most `longest` pixels, shrunk by area, with the camera of that
    /// size.
    ///
    /// # Errors
    /// If the photograph's lists have other sizes than its camera.
    pub fn shrunk(&self, longest: usize) -> Result<Self> {
        self.check()?;
        let size = limited(self.camera.size, Some(longest.max(1)));
        let samples = shrink(self.camera.size, size, |y, row| self.row(y, row));
        let camera = self.camera.scaled_to(size);
        Self::of_samples(&self.name, &samples, camera, self.masked)
    }

    /// Returns the levels of the photograph, from coarse to fine: each has about half the size of the next, the last one
    /// is the photograph itself, and none but the last has a longest side below `smallest` pixels.
    ///
    /// # Errors
    /// As [`Photograph::shrunk`].
    pub fn levels(&self, smallest: usize) -> Result<Vec<Self>> {
        let mut levels = vec![self.clone()];
        loop {
            let finest = &levels[levels.len() - 1];
            let longest = finest.camera.size[0].max(finest.camera.size[1]).div_ceil(2);
            if longest < smallest.max(1)
                || longest == finest.camera.size[0].max(finest.camera.size[1])
            {
                break;
            }
            let next = finest.shrunk(longest)?;
            levels.push(next);
        }
        levels.reverse();
        Ok(levels)
    }

    /// Returns a part of the photograph, with the camera of that part.
    ///
    /// # Errors
    /// If the window has no pixels or some that the photograph lacks, or as [`Photograph::shrunk`].
    pub fn cropped(&self, window: Window) -> Result<Self> {
        self.check()?;
        let camera = self.camera.cropped(window)?;
        let width = self.camera.size[0];
        let [x, y] = window.start;
        let rows = (y..y + window.size[1]).map(|y| y * width + x..y * width + x + window.size[0]);
        let of = |list: &[f32], channels: usize| -> Vec<f32> {
            let rows = rows.clone();
            rows.flat_map(|row| &list[row.start * channels..row.end * channels])
                .copied()
                .collect()
        };
        Ok(Self {
            name: self.name.clone(),
            color: HostImage::new(window.size[0], window.size[1], of(&self.color.pixels, 3))?,
            mask: of(&self.mask, 1),
            weight: of(&self.weight, 1),
            masked: self.masked,
            camera,
        })
    }
}
