//! Encodes the images of glTF files.

use std::path::Path;

use burn::tensor::Tensor;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::HostImage;
use super::srgb::{srgb_byte, srgb_word};
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::scene::Wrap;
use softray_kernels::model::texture::Texture;
use softray_kernels::warning;

/// A texture on the host.
pub(super) struct Texels {
    /// Row by row.
    pub values: Vec<f32>,
    /// Rows, columns, and numbers per texel.
    pub size: [usize; 3],
    pub wrap: Wrap,
}

impl Texels {
    pub fn of(texels: &Tensor<3>, wrap: Wrap) -> Result<Self> {
        let values = host_values(texels)?.into_iter();
        Ok(Self {
            values: values.map(|v| v as f32).collect(),
            size: texels.dims(),
            wrap,
        })
    }

    /// Returns a texture with the same value everywhere.
    pub fn full(value: f32, size: [usize; 3], wrap: Wrap) -> Self {
        let values = vec![value; size.iter().product()];
        Self { values, size, wrap }
    }

    pub fn mean(&self) -> f64 {
        let sum: f64 = self.values.iter().map(|&v| f64::from(v)).sum();
        sum / self.values.len() as f64
    }

    /// Prepares two textures as parts of one image, which has the wrap of the first. If their sizes differ, both get
    /// the larger number of rows and of columns.
    pub fn together(first: Self, second: Self, place: &str) -> [Self; 2] {
        let ([ah, aw, _], [bh, bw, _]) = (first.size, second.size);
        if ([ah, aw], first.wrap) == ([bh, bw], second.wrap) {
            return [first, second];
        }
        warning!(
            "{place}: two of its textures of other sizes or wraps are written as one image, the smaller one \
             interpolated"
        );
        let size = [ah.max(bh), aw.max(bw)];
        [first.resized(size), second.resized(size)]
    }

    /// Returns the texture interpolated at the texel centers of another size.
    fn resized(&self, [height, width]: [usize; 2]) -> Self {
        let [rows, columns, channels] = self.size;
        if [rows, columns] == [height, width] {
            let values = self.values.clone();
            return Self { values, ..*self };
        }
        let center = |i: usize, of: usize, size: usize| {
            ((i as f64 + 0.5) / of as f64 * size as f64 - 0.5) as f32
        };
        let image = Texture::new(0, [columns, rows], self.wrap);
        let mut values = Vec::with_capacity(height * width * channels);
        for y in 0..height {
            for x in 0..width {
                let cell = image.cell(center(x, width, columns), center(y, height, rows));
                for c in 0..channels {
                    let value = |k| self.values[cell.texel(k) as usize * channels + c];
                    values.push((0..4).map(|k| value(k) * cell.share(k)).sum());
                }
            }
        }
        let size = [height, width, channels];
        Self {
            values,
            size,
            ..*self
        }
    }
}

/// An image of colors, or of other numbers in [0, 1].
#[derive(PartialEq)]
pub(super) struct Picture {
    pub texels: HostImage,
    /// Whether the file stores the values as sRGB.
    pub colors: bool,
    /// One value per pixel, in [0, 1].
    pub alpha: Option<Vec<f32>>,
}

impl Picture {
    /// Encodes the image as PNG, clipped to [0, 1]. It has 8 bits per channel if these represent all values,
    /// otherwise 16.
    pub fn png(&self, path: &Path) -> Result<Vec<u8>> {
        let [width, height] = self.texels.check_size()?;
        let pixels = &self.texels.pixels;
        let short = self.fits_bytes();
        let number = |v: f32, most: f32| (v.clamp(0.0, 1.0) * most).round() as u16;
        let linear = |v: f32| number(v, if short { 255.0 } else { 65535.0 });
        let color = |v: f32| match (self.colors, short) {
            (true, true) => u16::from(srgb_byte(v)),
            (true, false) => srgb_word(v),
            (false, _) => linear(v),
        };
        let mut words = Vec::with_capacity(pixels.len() / 3 * 4);
        for (i, rgb) in pixels.chunks_exact(3).enumerate() {
            words.extend(rgb.iter().map(|&v| color(v)));
            words.extend(self.alpha.iter().map(|alpha| linear(alpha[i])));
        }
        let (bytes, kind): (Vec<u8>, _) = match (short, self.alpha.is_some()) {
            (true, alpha) => {
                let bytes = words.iter().map(|&w| w as u8).collect();
                let kinds = [ExtendedColorType::Rgb8, ExtendedColorType::Rgba8];
                (bytes, kinds[usize::from(alpha)])
            }
            (false, alpha) => {
                let bytes = words.iter().flat_map(|w| w.to_ne_bytes()).collect();
                let kinds = [ExtendedColorType::Rgb16, ExtendedColorType::Rgba16];
                (bytes, kinds[usize::from(alpha)])
            }
        };
        let mut png = Vec::new();
        PngEncoder::new(&mut png)
            .write_image(&bytes, width, height, kind)
            .map_err(|e| Error::format(path, format!("a texture can't be written: {e}")))?;
        Ok(png)
    }

    fn fits_bytes(&self) -> bool {
        let byte = |v: &f32| (v * 255.0 - (v * 255.0).round()).abs() < 1e-4;
        let fit = match self.colors {
            true => self.texels.fits_srgb(),
            false => self.texels.pixels.iter().all(byte),
        };
        fit && self.alpha.iter().flatten().all(byte)
    }
}
