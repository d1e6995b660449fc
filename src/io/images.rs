use std::fmt::{self, Display};
use std::io::{self, Seek, Write};
use std::path::Path;

use burn::tensor::{Device, Tensor, TensorData};
use image::{ExtendedColorType, ImageFormat};

use super::LoadLimits;
use super::decode::Decoded;
use super::exr_write::{Layer, write_exr};
use super::files::Files;
use super::srgb::{srgb_byte, srgb_table};
use super::whole::{check_writable, ending, folder_of, write_whole};
use crate::debug::numbers;
use crate::error::{Error, Result};

/// White columns between adjacent images.
const GAP: usize = 2;

/// A linear RGB image on the host.
#[derive(Clone, PartialEq)]
pub struct HostImage {
    /// Columns.
    pub width: usize,
    /// Rows, the first at the top.
    pub height: usize,
    /// height · width · 3 values, row by row.
    pub pixels: Vec<f32>,
}

impl fmt::Debug for HostImage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("HostImage")
            .field("width", &self.width)
            .field("height", &self.height)
            .field(
                "pixels",
                &numbers(self.pixels.iter().map(|&v| f64::from(v))),
            )
            .finish()
    }
}

impl HostImage {
    /// Creates an image from its values, row by row.
    ///
    /// # Errors
    /// If the number of values is not height · width · 3.
    pub fn new(width: usize, height: usize, pixels: Vec<f32>) -> Result<Self> {
        let image = Self {
            width,
            height,
            pixels,
        };
        image.check()?;
        Ok(image)
    }

    /// Reads a tensor `[H, W, 3]` back from its device.
    ///
    /// # Errors
    /// If the last dimension is not 3, or the device fails.
    pub fn from_tensor(tensor: &Tensor<3>) -> Result<Self> {
        Self::take(tensor.clone())
    }

    /// Reads a tensor back like [`HostImage::from_tensor`]; its values may be moved instead of copied.
    ///
    /// # Errors
    /// As [`HostImage::from_tensor`].
    pub fn take(tensor: Tensor<3>) -> Result<Self> {
        let [height, width, channels] = tensor.dims();
        if channels != 3 {
            return Err(Error::invalid(
                "image",
                "tensor",
                format!("of shape [{height}, {width}, {channels}]"),
                "shape [H, W, 3]",
            ));
        }
        let data = tensor
            .inner()
            .try_into_data_as::<f32>()
            .map_err(Error::read)?;
        let pixels = data.try_into_vec::<f32>().map_err(Error::read)?;
        Self::new(width, height, pixels)
    }

    /// Moves the image to a tensor `[H, W, 3]` in the device's default float type.
    pub fn into_tensor(self, device: &Device) -> Tensor<3> {
        let shape = [self.height, self.width, 3];
        Tensor::from_data(TensorData::new(self.pixels, shape), device)
    }

    /// Reads an image file as linear RGB.
    ///
    /// EXR and HDR are read unchanged; PNG, JPEG, BMP, TGA, GIF and WebP are decoded from sRGB. Gray becomes RGB, and
    /// alpha is dropped.
    ///
    /// # Errors
    /// If the file cannot be read, is not an image of these formats, or has more pixels than [`LoadLimits`] allows.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        Self::read_within(path, &LoadLimits::default())
    }

    /// Reads an image like [`HostImage::read`], with the given limits. Images with 8 bits per channel take at most 16
    /// bytes per pixel.
    ///
    /// # Errors
    /// As [`HostImage::read`].
    pub fn read_within(path: impl AsRef<Path>, limits: &LoadLimits) -> Result<Self> {
        Self::read_from(path.as_ref(), Files::of_system(limits))
    }

    // Callers of decoders and encoders are not generic, since each program would compile generic ones again.
    pub(super) fn read_from(path: &Path, files: Files) -> Result<Self> {
        let decoded = Decoded::of_file(path, files)?;
        let [width, height] = decoded.size();
        Self::new(width, height, decoded.colors())
    }

    /// Checks that an image can be written to a path: the extension is supported, and the folder exists and is
    /// writable.
    ///
    /// A check before a render avoids the loss of its result. An existing file is not changed, and no new one is
    /// left.
    ///
    /// # Errors
    /// If the extension is not supported, or nothing can be written to the folder.
    pub fn check_path(path: impl AsRef<Path>) -> Result<()> {
        Self::check_room(path, 1, 1)
    }

    /// Checks a path like [`HostImage::check_path`], and that the disk has the free space that an image of `width` ×
    /// `height` pixels may take.
    ///
    /// # Errors
    /// As [`HostImage::check_path`], or if the disk has less free space. A file system that doesn't report its free
    /// space counts as large enough.
    pub fn check_room(path: impl AsRef<Path>, width: usize, height: usize) -> Result<()> {
        let (path, pixels) = (path.as_ref(), (width as u64).saturating_mul(height as u64));
        Self::check_place(path)?;
        let of_pixel = match format_of(path)? {
            ImageFormat::Png => 3,
            _ => 12,
        };
        check_writable(path, pixels.saturating_mul(of_pixel).saturating_add(4096))
    }

    /// Checks that the extension of a path is supported and its folder exists.
    fn check_place(path: &Path) -> Result<()> {
        format_of(path)?;
        if path.is_dir() {
            return Err(Error::format(
                path,
                "it is a folder, expected a file's name",
            ));
        }
        let folder = folder_of(path);
        if !folder.is_dir() {
            let message = format!("there is no folder {}", folder.display());
            return Err(Error::format(path, message));
        }
        Ok(())
    }

    /// Writes the image: `.exr` and `.pfm` as linear 32-bit floats, `.png` as 8-bit sRGB clipped to [0, 1]. The file
    /// appears under its name only when it is complete.
    ///
    /// # Errors
    /// If the extension is another one, the image is empty, or the file cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        self.write_layer(path.as_ref(), None)
    }

    /// Writes the image like [`HostImage::write`], in an EXR file as the given layer.
    pub(super) fn write_layer(&self, path: &Path, layer: Option<Layer>) -> Result<()> {
        Self::check_place(path)?;
        self.check_size()?;
        write_whole(path, |file| self.encode(path, file, layer))
    }

    /// Encodes the image to `file`, in the format given by the extension of `path`.
    pub(super) fn encode(
        &self,
        path: &Path,
        file: &mut (impl Write + Seek),
        layer: Option<Layer>,
    ) -> Result<()> {
        let ([w, h], format) = (self.check_size()?, format_of(path)?);
        let failed = |e: &dyn Display| Error::format(path, format!("it can't be written: {e}"));
        match format {
            ImageFormat::Pnm => self.write_pfm(file).map_err(Error::io(path)),
            ImageFormat::Png => {
                let bytes = self.to_srgb();
                image::write_buffer_with_format(file, &bytes, w, h, ExtendedColorType::Rgb8, format)
                    .map_err(|e| failed(&e))
            }
            _ => write_exr(file, (self.width, self.height), &self.pixels, layer)
                .map_err(|e| failed(&e)),
        }
    }

    /// Writes a PFM file: a header, then the rows from the bottom up. A negative scale stands for little endian.
    fn write_pfm(&self, file: &mut impl Write) -> io::Result<()> {
        write!(file, "PF\n{} {}\n-1.0\n", self.width, self.height)?;
        for row in self.pixels.chunks_exact(3 * self.width).rev() {
            let bytes: Vec<u8> = row.iter().flat_map(|v| v.to_le_bytes()).collect();
            file.write_all(&bytes)?;
        }
        Ok(())
    }

    /// Returns the values as sRGB bytes, clipped to [0, 1], as a PNG has them.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let gray = HostImage::new(1, 1, vec![0.2140, 1.0, 7.0])?;
    /// assert_eq!(gray.to_srgb(), [127, 255, 255]);
    /// # Ok::<(), softray::Error>(())
    /// ```
    pub fn to_srgb(&self) -> Vec<u8> {
        self.pixels.iter().map(|&v| srgb_byte(v)).collect()
    }

    /// Returns whether sRGB bytes represent every value exactly, as for an image that was read from an 8-bit PNG.
    pub(super) fn fits_srgb(&self) -> bool {
        let table = srgb_table();
        let same = |&v: &f32| table[usize::from(srgb_byte(v))] == v;
        self.pixels.iter().all(same)
    }

    /// Returns columns and rows, which must be valid for a file.
    pub(super) fn check_size(&self) -> Result<[u32; 2]> {
        self.check()?;
        sides(self.width, self.height)
    }

    /// Returns the mean of each channel.
    pub fn mean(&self) -> [f64; 3] {
        let n = (self.width * self.height) as f64;
        std::array::from_fn(|c| {
            let channel = self.pixels.iter().skip(c).step_by(3);
            channel.map(|&v| f64::from(v)).sum::<f64>() / n
        })
    }

    /// Returns the root-mean-square difference over all channels. `clipped` clamps both images to [0, 1] first, so
    /// that directly visible lights do not outweigh the rest.
    ///
    /// # Errors
    /// If the sizes differ.
    pub fn rmse(&self, other: &Self, clipped: bool) -> Result<f64> {
        self.check()?;
        other.check()?;
        if (self.width, self.height) != (other.width, other.height) {
            return Err(Error::invalid(
                "image",
                "size",
                format!("{} × {}", self.width, self.height),
                format!("{} × {} like the other image", other.width, other.height),
            ));
        }
        let value = |&v: &f32| {
            let v = f64::from(v);
            if clipped { v.clamp(0.0, 1.0) } else { v }
        };
        let pairs = self.pixels.iter().zip(&other.pixels);
        let sum: f64 = pairs.map(|(a, b)| (value(a) - value(b)).powi(2)).sum();
        Ok((sum / self.pixels.len() as f64).sqrt())
    }

    /// Returns the sum of all values, divided by the sum of all values of `other`.
    pub fn mean_ratio(&self, other: &Self) -> f64 {
        let sum = |image: &Self| image.pixels.iter().map(|&v| f64::from(v)).sum::<f64>();
        sum(self) / sum(other)
    }

    /// Joins images in a row, aligned at the top, with white gaps of 2 pixels.
    pub fn side_by_side(images: &[&Self]) -> Self {
        let height = images.iter().map(|i| i.height).max().unwrap_or(0);
        let gaps = GAP * images.len().saturating_sub(1);
        let width = images.iter().map(|i| i.width).sum::<usize>() + gaps;
        let mut pixels = vec![1.0; width * height * 3];
        let mut left = 0;
        for image in images.iter().filter(|i| i.width > 0) {
            for (y, row) in image.pixels.chunks_exact(3 * image.width).enumerate() {
                let start = 3 * (y * width + left);
                if let Some(target) = pixels.get_mut(start..start + row.len()) {
                    target.copy_from_slice(row);
                }
            }
            left += image.width + GAP;
        }
        Self {
            width,
            height,
            pixels,
        }
    }

    fn check(&self) -> Result<()> {
        let expected = self.width.checked_mul(self.height);
        let expected = expected.and_then(|n| n.checked_mul(3));
        let count = expected.map_or("more than there can be".into(), |n| n.to_string());
        Error::unless(
            expected == Some(self.pixels.len()),
            "image",
            "pixels",
            format!("{} values", self.pixels.len()),
            &format!("{count} for {} × {} pixels", self.width, self.height),
        )
    }
}

/// Returns the format of an image to write, by its extension. `Pnm` stands for PFM.
pub(super) fn format_of(path: &Path) -> Result<ImageFormat> {
    Ok(match ending(path, &["exr", "pfm", "png"])? {
        "exr" => ImageFormat::OpenExr,
        "pfm" => ImageFormat::Pnm,
        _ => ImageFormat::Png,
    })
}

/// Returns columns and rows, which must be valid for a file.
pub(super) fn sides(width: usize, height: usize) -> Result<[u32; 2]> {
    match (u32::try_from(width), u32::try_from(height)) {
        (Ok(w @ 1..), Ok(h @ 1..)) => Ok([w, h]),
        _ => {
            let expected = "at least one and at most 2³² − 1 columns and rows";
            Err(Error::invalid(
                "image",
                "size",
                format!("{width} × {height}"),
                expected,
            ))
        }
    }
}
