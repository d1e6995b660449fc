//! Images of files and buffers, decoded.

use std::io::{BufRead, Seek};
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use super::LoadLimits;
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
        let malformed = |e| Error::format(path, format!("it can't be decoded: {e}"));
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
        let decoder = reader.into_decoder().map_err(malformed)?;
        let (width, height) = decoder.dimensions();
        if u64::from(width) * u64::from(height) > limits.pixels {
            return Err(Error::format(
                path,
                format!(
                    "it has {width} × {height} pixels, more than {}: LoadLimits::pixels raises the limit",
                    limits.pixels
                ),
            ));
        }
        let image = DynamicImage::from_decoder(decoder).map_err(malformed)?;
        Ok(Self { image, linear })
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.image.width() as usize, self.image.height() as usize]
    }

    /// Linear RGB, row by row: numbers that are not linear are decoded from sRGB. Grey becomes RGB and alpha is
    /// dropped.
    pub fn colours(self) -> Vec<f32> {
        match self.linear {
            true => self.numbers(),
            false => decode_srgb(self.image),
        }
    }

    /// The numbers as they are, three a pixel row by row: those of integers stand for [0, 1].
    pub fn numbers(self) -> Vec<f32> {
        self.image.into_rgb32f().into_raw()
    }

    /// The alpha of each pixel, 1 where the image has none.
    pub fn alpha(self) -> Vec<f32> {
        match self.image.color().has_alpha() {
            true => self.image.into_rgba32f().pixels().map(|p| p[3]).collect(),
            false => vec![1.0; self.image.width() as usize * self.image.height() as usize],
        }
    }
}
