//! Images within glTF files to come.

use std::path::Path;

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::HostImage;
use super::srgb::{srgb_byte, srgb_word};
use crate::error::{Error, Result};

/// An image of colours, or of other numbers in [0, 1].
#[derive(PartialEq)]
pub(super) struct Picture {
    pub texels: HostImage,
    /// Whether its numbers are encoded as sRGB.
    pub colours: bool,
    /// One a pixel, in [0, 1].
    pub alpha: Option<Vec<f32>>,
}

impl Picture {
    /// It as a PNG file, clipped to [0, 1]: 8 bits a channel where they hold all of it, else 16.
    pub fn png(&self, path: &Path) -> Result<Vec<u8>> {
        let [width, height] = self.texels.check_size()?;
        let pixels = &self.texels.pixels;
        let short = self.fits_bytes();
        let number = |v: f32, most: f32| (v.clamp(0.0, 1.0) * most).round() as u16;
        let linear = |v: f32| number(v, if short { 255.0 } else { 65535.0 });
        let colour = |v: f32| match (self.colours, short) {
            (true, true) => u16::from(srgb_byte(v)),
            (true, false) => srgb_word(v),
            (false, _) => linear(v),
        };
        let mut words = Vec::with_capacity(pixels.len() / 3 * 4);
        for (i, rgb) in pixels.chunks_exact(3).enumerate() {
            words.extend(rgb.iter().map(|&v| colour(v)));
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
        let fit = match self.colours {
            true => self.texels.fits_srgb(),
            false => self.texels.pixels.iter().all(byte),
        };
        fit && self.alpha.iter().flatten().all(byte)
    }
}
