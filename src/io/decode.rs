//! Decodes images from files and buffers.

use std::io::{BufRead, Seek};
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader};

use super::LoadLimits;
use super::files::Files;
use super::srgb::decode_srgb;
use crate::error::{Error, Result};

/// A decoded image with the values of its file.
pub(super) struct Decoded {
    image: DynamicImage,
    /// Whether the values are linear (EXR and HDR).
    linear: bool,
}

impl Decoded {
    /// Decodes an image whose size is within the limits. Messages contain `path`. The format is detected from the
    /// contents, and from the extension of `path` if that fails.
    pub fn read(source: impl BufRead + Seek, path: &Path, limits: &LoadLimits) -> Result<Self> {
        let (decoder, linear) = decoder(source, path)?;
        let (width, height) = decoder.dimensions();
        check_size([width as usize, height as usize], path, limits)?;
        let image = DynamicImage::from_decoder(decoder).map_err(malformed(path))?;
        Ok(Self { image, linear })
    }

    /// Decodes an image file.
    pub fn of_file(path: &Path, files: Files) -> Result<Self> {
        Self::read(files.open(path)?.0, path, &files)
    }

    /// Returns the columns and rows of an image without decoding it.
    pub fn read_size(source: impl BufRead + Seek, path: &Path) -> Result<[usize; 2]> {
        let (width, height) = decoder(source, path)?.0.dimensions();
        Ok([width as usize, height as usize])
    }

    /// Returns columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.image.width() as usize, self.image.height() as usize]
    }

    /// Returns linear RGB, row by row. Values that are not linear are decoded from sRGB. Gray becomes RGB, and alpha
    /// is dropped.
    pub fn colors(&self) -> Vec<f32> {
        match self.linear {
            true => self.numbers(),
            false => decode_srgb(&self.image),
        }
    }

    /// Returns the values of the file, three per pixel, row by row. Integers are scaled to [0, 1].
    pub fn numbers(&self) -> Vec<f32> {
        self.image.to_rgb32f().into_raw()
    }

    /// Returns one channel of [`Self::numbers`].
    pub fn channel(&self, channel: usize) -> Vec<f32> {
        let numbers = self.numbers().into_iter();
        numbers.skip(channel).step_by(3).collect()
    }

    /// Returns the alpha of each pixel, or 1 if the image has no alpha.
    pub fn alpha(&self) -> Vec<f32> {
        match self.image.color().has_alpha() {
            true => self.image.to_rgba32f().pixels().map(|p| p[3]).collect(),
            false => vec![1.0; self.image.width() as usize * self.image.height() as usize],
        }
    }
}

pub(super) fn malformed(path: &Path) -> impl Fn(ImageError) -> Error {
    move |e| Error::format(path, format!("it can't be decoded: {e}"))
}

/// Checks that the size of an image is within the limits.
pub(super) fn check_size(
    [width, height]: [usize; 2],
    path: &Path,
    limits: &LoadLimits,
) -> Result<()> {
    let most = limits.pixels;
    if width as u64 * height as u64 <= most {
        return Ok(());
    }
    let message = format!(
        "it has {width} × {height} pixels, more than {most}: LoadLimits::with_pixels raises the limit"
    );
    Err(Error::format(path, message))
}

/// Returns the decoder of an image, and whether the image's values are linear.
pub(super) fn decoder<'a>(
    source: impl BufRead + Seek + 'a,
    path: &Path,
) -> Result<(impl ImageDecoder + 'a, bool)> {
    let mut reader = ImageReader::new(source);
    if let Ok(format) = ImageFormat::from_path(path) {
        reader.set_format(format);
    }
    let mut reader = reader.with_guessed_format().map_err(Error::io(path))?;
    // Memory is limited by `check_size` instead.
    reader.no_limits();
    let linear = matches!(
        reader.format(),
        Some(ImageFormat::OpenExr | ImageFormat::Hdr)
    );
    let decoder = reader.into_decoder().map_err(malformed(path))?;
    Ok((decoder, linear))
}
