//! Rendered images in files.

use std::path::Path;

use burn::tensor::Tensor;
use image::{DynamicImage, GrayImage, ImageFormat, RgbImage};

use super::HostImage;
use super::images::format_of;
use super::viridis::viridis;
use super::whole::write_whole_by;
use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::render::Image;

/// The grey of pixels without a surface in pictures of depth, which no depth has.
const BACKGROUND: [u8; 3] = [128; 3];

impl Image {
    /// Writes the radiance: `.exr` has linear 32-bit floats, `.png` has 8-bit sRGB clipped to [0, 1].
    /// The file appears under its name only when it is complete.
    ///
    /// ```no_run
    /// # use softray::prelude::*;
    /// # let device = Device::flex();
    /// # let scene = Scene::new().with(Object::new(shapes::cube(&device)));
    /// # let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]);
    /// let image = render(&scene, &camera, &RenderOptions::new(64, 64).with_depth())?;
    /// image.write("image.exr")?;
    /// image.write_depth("depth.png")?;
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// When the ending is another one, the tensor can't be read back, or the system fails.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        format_of(path)?;
        HostImage::from_tensor(&self.radiance)?.write(path)
    }

    /// Writes the depth: `.exr` has scene units, 0 where nothing is seen, the same in all three
    /// channels. `.png` shows it by the colour map viridis, from dark violet for the nearest to
    /// yellow for the farthest depth of the image, and grey where nothing is seen.
    ///
    /// # Errors
    /// As [`Image::write`], and without [`RenderOptions::with_depth`](crate::render::RenderOptions::with_depth).
    pub fn write_depth(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let format = format_of(path)?;
        let plane = Plane::read(requested(&self.depth, "depth")?)?;
        if format == ImageFormat::OpenExr {
            return plane.as_grey()?.write(path);
        }
        let seen = |d: f32| d.is_finite() && d > 0.0;
        let depths = || plane.values.iter().copied().filter(|&d| seen(d));
        let near = depths().fold(f32::INFINITY, f32::min);
        let far = depths().fold(0.0, f32::max);
        // Where all is at one depth, that is the nearest.
        let per_unit = if far > near { 1.0 / (far - near) } else { 0.0 };
        let colour = |&d: &f32| {
            if seen(d) {
                viridis((d - near) * per_unit)
            } else {
                BACKGROUND
            }
        };
        let bytes = plane.values.iter().flat_map(colour).collect();
        write_png(path, plane.size, bytes)
    }

    /// Writes the normals: `.exr` has them as they are, 0 where nothing is seen. `.png` has
    /// 0.5 + 0.5·n in linear bytes, without sRGB encoding.
    ///
    /// # Errors
    /// As [`Image::write`], and without [`RenderOptions::with_normals`](crate::render::RenderOptions::with_normals).
    pub fn write_normals(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let format = format_of(path)?;
        let normals = HostImage::from_tensor(requested(&self.normals, "normals")?)?;
        if format == ImageFormat::OpenExr {
            return normals.write(path);
        }
        let bytes = normals.pixels.iter().map(|n| linear_byte(0.5 + 0.5 * n));
        write_png(path, [normals.width, normals.height], bytes.collect())
    }

    /// Writes the opacity: `.exr` has it the same in all three channels, `.png` has linear bytes of
    /// grey, without sRGB encoding.
    ///
    /// # Errors
    /// As [`Image::write`], and without [`RenderOptions::with_opacity`](crate::render::RenderOptions::with_opacity).
    pub fn write_opacity(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let format = format_of(path)?;
        let plane = Plane::read(requested(&self.opacity, "opacity")?)?;
        if format == ImageFormat::OpenExr {
            return plane.as_grey()?.write(path);
        }
        let bytes = plane.values.iter().map(|&v| linear_byte(v)).collect();
        write_png(path, plane.size, bytes)
    }
}

/// An output that may not have been asked for.
fn requested<'a, T>(output: &'a Option<T>, field: &str) -> Result<&'a T> {
    output.as_ref().ok_or_else(|| {
        let expected = format!("an image rendered with RenderOptions::with_{field}");
        Error::invalid("image", field, "not there", expected)
    })
}

/// One value for each pixel.
struct Plane {
    /// Columns and rows.
    size: [usize; 2],
    values: Vec<f32>,
}

impl Plane {
    fn read(tensor: &Tensor<2>) -> Result<Self> {
        let [height, width] = tensor.dims();
        let values = host_values(tensor)?;
        Ok(Self {
            size: [width, height],
            values: values.into_iter().map(|v| v as f32).collect(),
        })
    }

    fn as_grey(&self) -> Result<HostImage> {
        let pixels = self.values.iter().flat_map(|&v| [v; 3]).collect();
        HostImage::new(self.size[0], self.size[1], pixels)
    }
}

fn linear_byte(v: f32) -> u8 {
    (v.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// Writes bytes as they are: one for each pixel of grey, or three.
fn write_png(path: &Path, [width, height]: [usize; 2], bytes: Vec<u8>) -> Result<()> {
    let size = || {
        let expected = "at least one and at most 2³² − 1 columns and rows";
        Error::invalid("image", "size", format!("{width} × {height}"), expected)
    };
    let (Ok(w), Ok(h)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(size());
    };
    if w == 0 || h == 0 {
        return Err(size());
    }
    let image = if bytes.len() == width * height {
        GrayImage::from_raw(w, h, bytes).map(DynamicImage::from)
    } else {
        RgbImage::from_raw(w, h, bytes).map(DynamicImage::from)
    };
    let image = image.ok_or_else(size)?;
    write_whole_by(path, |file| {
        image
            .write_to(file, ImageFormat::Png)
            .map_err(|e| Error::format(path, format!("it can't be written: {e}")))
    })
}
