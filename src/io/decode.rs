//! Images of files and buffers, decoded.

use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader};

use super::limits::{LoadLimits, open};
use super::srgb::decode_srgb;
use crate::error::{Error, Result};

/// An image as a file has it.
pub(super) struct Decoded {
    image: DynamicImage,
    /// Whether its numbers are linear: EXR and HDR.
    linear: bool,
}

impl Decoded {
    /// Decodes an image of a size within the limits. Messages call it by its path; the contents say what it is,
    /// the path's ending only where they don't.
    pub fn read(source: impl BufRead + Seek, path: &Path, limits: &LoadLimits) -> Result<Self> {
        let (decoder, linear) = decoder(source, path)?;
        let (width, height) = decoder.dimensions();
        check_size([width as usize, height as usize], path, limits)?;
        let image = DynamicImage::from_decoder(decoder).map_err(malformed(path))?;
        Ok(Self { image, linear })
    }

    /// Decodes the image of a file.
    pub fn of_file(path: &Path, limits: &LoadLimits) -> Result<Self> {
        Self::read(BufReader::new(open(path)?.0), path, limits)
    }

    /// Columns and rows of an image that is not decoded.
    pub fn read_size(source: impl BufRead + Seek, path: &Path) -> Result<[usize; 2]> {
        let (width, height) = decoder(source, path)?.0.dimensions();
        Ok([width as usize, height as usize])
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.image.width() as usize, self.image.height() as usize]
    }

    /// Linear RGB, row by row: numbers that are not linear are decoded from sRGB. Grey becomes RGB and alpha is
    /// dropped.
    pub fn colours(&self) -> Vec<f32> {
        match self.linear {
            true => self.numbers(),
            false => decode_srgb(&self.image),
        }
    }

    /// The numbers as they are, three a pixel row by row: those of integers stand for [0, 1].
    pub fn numbers(&self) -> Vec<f32> {
        self.image.to_rgb32f().into_raw()
    }

    /// One channel of [`Self::numbers`].
    pub fn channel(&self, channel: usize) -> Vec<f32> {
        let numbers = self.numbers().into_iter();
        numbers.skip(channel).step_by(3).collect()
    }

    /// The alpha of each pixel, 1 where the image has none.
    pub fn alpha(&self) -> Vec<f32> {
        match self.image.color().has_alpha() {
            true => self.image.to_rgba32f().pixels().map(|p| p[3]).collect(),
            false => vec![1.0; self.image.width() as usize * self.image.height() as usize],
        }
    }
}

fn malformed(path: &Path) -> impl Fn(ImageError) -> Error {
    move |e| Error::format(path, format!("it can't be decoded: {e}"))
}

/// Checks that columns and rows of an image are within the limits.
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
        "it has {width} × {height} pixels, more than {most}: LoadLimits::pixels raises the limit"
    );
    Err(Error::format(path, message))
}

/// The decoder of an image, and whether its numbers are linear.
fn decoder<'a>(
    source: impl BufRead + Seek + 'a,
    path: &Path,
) -> Result<(impl ImageDecoder + 'a, bool)> {
    let mut reader = ImageReader::new(source);
    if let Ok(format) = ImageFormat::from_path(path) {
        reader.set_format(format);
    }
    let mut reader = reader.with_guessed_format().map_err(Error::io(path))?;
    // What it may take is said by its size.
    reader.no_limits();
    let linear = matches!(
        reader.format(),
        Some(ImageFormat::OpenExr | ImageFormat::Hdr)
    );
    let decoder = reader.into_decoder().map_err(malformed(path))?;
    Ok((decoder, linear))
}
