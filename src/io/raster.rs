//! Photographs as they are decoded, read row by row as linear RGB with alpha.

use std::path::Path;

use image::metadata::Orientation;
use image::{ColorType, DynamicImage, ImageDecoder};

use super::decode::{check_size, decoder, malformed};
use super::files::Files;
use super::srgb::{srgb_table, srgb_to_linear};
use crate::error::Result;

/// A decoded image. Images with 8 bits per channel stay in bytes.
pub(crate) struct Raster {
    size: [usize; 2],
    alpha: bool,
    pixels: Pixels,
}

enum Pixels {
    /// Bytes with their number of channels, and the linear value of each sRGB byte.
    Bytes {
        bytes: Vec<u8>,
        channels: usize,
        table: Vec<f32>,
    },
    /// Four values a pixel, and whether they are linear.
    Floats { values: Vec<f32>, linear: bool },
}

impl Raster {
    /// Returns the columns and rows of the raster that a file stores, and its EXIF orientation (1–8; 1 for files that
    /// name none).
    ///
    /// # Errors
    /// If the file can't be read or is not an image.
    pub fn read_size(path: &Path, files: Files) -> Result<([usize; 2], u8)> {
        let (mut decoder, _) = decoder(files.open(path)?.0, path)?;
        let (width, height) = decoder.dimensions();
        let orientation = decoder.orientation().map_err(malformed(path))?;
        Ok(([width as usize, height as usize], orientation.to_exif()))
    }

    /// Decodes an image and turns it by an EXIF orientation (1: as it is stored).
    ///
    /// # Errors
    /// If the file can't be read, is not an image, or has more pixels than the limits allow.
    pub fn read(path: &Path, orientation: u8, files: Files) -> Result<Self> {
        let (decoder, linear) = decoder(files.open(path)?.0, path)?;
        let (width, height) = decoder.dimensions();
        check_size([width as usize, height as usize], path, &files)?;
        let mut image = DynamicImage::from_decoder(decoder).map_err(malformed(path))?;
        if let Some(orientation) = Orientation::from_exif(orientation) {
            image.apply_orientation(orientation);
        }
        let (size, color) = (
            [image.width() as usize, image.height() as usize],
            image.color(),
        );
        let pixels = match color {
            ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8 => Pixels::Bytes {
                bytes: image.into_bytes(),
                channels: usize::from(color.channel_count()),
                table: srgb_table(),
            },
            _ => Pixels::Floats {
                values: image.into_rgba32f().into_raw(),
                linear,
            },
        };
        let raster = Self {
            size,
            alpha: false,
            pixels,
        };
        let alpha = color.has_alpha() && raster.is_transparent();
        Ok(Self { alpha, ..raster })
    }

    /// Returns whether a pixel has an alpha below 1, if there is an alpha channel.
    fn is_transparent(&self) -> bool {
        match &self.pixels {
            Pixels::Bytes {
                bytes, channels, ..
            } => {
                let mut alphas = bytes.iter().skip(channels - 1).step_by(*channels);
                alphas.any(|&alpha| alpha < 255)
            }
            Pixels::Floats { values, .. } => {
                let mut alphas = values.iter().skip(3).step_by(4);
                alphas.any(|&alpha| alpha < 1.0)
            }
        }
    }

    /// Returns columns and rows.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Returns whether the file has an alpha channel in which a pixel is below 1.
    pub fn has_alpha(&self) -> bool {
        self.alpha
    }

    /// Writes a row of linear RGB and straight alpha (1 if the file has none) to `row`, which has a place for each column.
    pub fn row(&self, y: usize, row: &mut [[f32; 4]]) {
        let width = self.size[0];
        match &self.pixels {
            Pixels::Bytes {
                bytes,
                channels,
                table,
            } => {
                let bytes = &bytes[y * width * channels..(y + 1) * width * channels];
                for (pixel, b) in row.iter_mut().zip(bytes.chunks_exact(*channels)) {
                    let color = match channels {
                        1 | 2 => [b[0]; 3],
                        _ => [b[0], b[1], b[2]],
                    };
                    let [red, green, blue] = color.map(|v| table[usize::from(v)]);
                    let alpha = match channels {
                        2 => f32::from(b[1]) / 255.0,
                        4 => f32::from(b[3]) / 255.0,
                        _ => 1.0,
                    };
                    *pixel = [red, green, blue, alpha];
                }
            }
            Pixels::Floats { values, linear } => {
                let values = &values[y * width * 4..(y + 1) * width * 4];
                for (pixel, v) in row.iter_mut().zip(values.chunks_exact(4)) {
                    let decode = |v: f32| if *linear { v } else { srgb_to_linear(v) };
                    *pixel = [decode(v[0]), decode(v[1]), decode(v[2]), v[3]];
                }
            }
        }
    }

    /// Returns the first channel of the file, row by row, with integers scaled to [0, 1]. This is a mask: its values are
    /// not decoded from sRGB.
    pub fn numbers(&self) -> Vec<f32> {
        match &self.pixels {
            Pixels::Bytes {
                bytes, channels, ..
            } => {
                let first = bytes.iter().step_by(*channels);
                first.map(|&b| f32::from(b) / 255.0).collect()
            }
            Pixels::Floats { values, .. } => values.iter().step_by(4).copied().collect(),
        }
    }
}
