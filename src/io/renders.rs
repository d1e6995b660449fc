//! Writes rendered images to files.

use std::path::Path;

use burn::tensor::Tensor;
use colorous::VIRIDIS;
use image::{ExtendedColorType, ImageFormat};

use super::HostImage;
use super::exr_write::Layer;
use super::images::{format_of, sides};
use super::srgb::srgb_byte;
use super::whole::write_whole;
use crate::error::{Error, Result};
use crate::render::{Image, Program, unpremultiply};
use softray_kernels::warning;

/// The gray of pixels without a surface in depth pictures. No depth has this color.
const BACKGROUND: [u8; 3] = [128; 3];

const DEPTH: Layer = Layer {
    name: "depth.premultiplied",
    comment: "mean over the pixel of the distance along the rays, 0 where nothing is hit; divide by the opacity for the \
              mean over the visible surfaces",
};

const NORMALS: Layer = Layer {
    name: "normals.premultiplied",
    comment: "mean over the pixel of the normals in scene axes, 0 where nothing is hit; divide by the opacity for the \
              mean over the visible surfaces",
};

impl Image {
    /// Writes the radiance: `.exr` and `.pfm` as linear 32-bit floats, `.png` as 8-bit sRGB clipped to [0, 1]. The file
    /// appears under its name only when it is complete.
    ///
    /// ```no_run
    /// # use softray::prelude::*;
    /// # let device = Device::flex();
    /// # let scene = Scene::new().with_object(Object::new(shapes::cube(&device)));
    /// # let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]);
    /// let image = render(&scene, &camera, &RenderOptions::new(64, 64).with_depth())?;
    /// image.write("image.exr")?;
    /// image.write_depth("depth.png")?;
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the file extension is another one, the tensor cannot be read back, or the file cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        format_of(path)?;
        let image = HostImage::from_tensor(&self.radiance)?;
        // Kernels on the host know this when they render.
        let is_black = || image.pixels.iter().all(|&v| v == 0.0);
        if self.statistics.program != Program::HostKernels && is_black() {
            warning!("{}: the image is black", path.display());
        }
        image.write(path)
    }

    /// Writes the depth.
    ///
    /// `.exr` and `.pfm` store [`Image::depth`] in scene units, the same in all three channels: means over whole pixels,
    /// premultiplied by the opacity. The layer of an `.exr` is named `depth.premultiplied`. `.png` shows the depth of the
    /// visible surfaces by the color map viridis, from dark violet for the nearest to yellow for the farthest depth of the
    /// image, and gray where no surface is visible.
    ///
    /// # Errors
    /// As [`Image::write`], or if [`RenderOptions::with_depth`](crate::render::RenderOptions::with_depth) is off.
    pub fn write_depth(&self, path: impl AsRef<Path>) -> Result<()> {
        let depth = self.depth.as_ref().map(in_three_channels);
        let depth = self.of_surfaces_in_png(path.as_ref(), depth)?;
        write_output(path.as_ref(), depth, ("depth", Some(DEPTH)), |values| {
            let seen = |d: f32| d.is_finite() && d > 0.0;
            let depths = || values.iter().copied().filter(|&d| seen(d));
            let near = depths().fold(f32::INFINITY, f32::min);
            let far = depths().fold(0.0, f32::max);
            // If all depths are equal, all of them count as the nearest.
            let per_unit = if far > near { 1.0 / (far - near) } else { 0.0 };
            let color = |d: f32| match seen(d) {
                true => VIRIDIS
                    .eval_continuous(f64::from((d - near) * per_unit))
                    .as_array(),
                false => BACKGROUND,
            };
            values.iter().step_by(3).flat_map(|&d| color(d)).collect()
        })
    }

    /// Writes the normals.
    ///
    /// `.exr` and `.pfm` store [`Image::normals`]: means over whole pixels, premultiplied by the opacity. The layer of an
    /// `.exr` is named `normals.premultiplied`. `.png` stores 0.5 + 0.5·n as linear bytes, without sRGB encoding, with the
    /// normal n of the visible surfaces.
    ///
    /// # Errors
    /// As [`Image::write`], or if [`RenderOptions::with_normals`](crate::render::RenderOptions::with_normals) is off.
    pub fn write_normals(&self, path: impl AsRef<Path>) -> Result<()> {
        let normals = self.of_surfaces_in_png(path.as_ref(), self.normals.clone())?;
        write_output(
            path.as_ref(),
            normals,
            ("normals", Some(NORMALS)),
            |values| values.iter().map(|n| linear_byte(0.5 + 0.5 * n)).collect(),
        )
    }

    /// Writes the albedo: `.exr` and `.pfm` unchanged, `.png` as 8-bit sRGB.
    ///
    /// # Errors
    /// As [`Image::write`], or if [`RenderOptions::with_albedo`](crate::render::RenderOptions::with_albedo) is off.
    pub fn write_albedo(&self, path: impl AsRef<Path>) -> Result<()> {
        write_output(
            path.as_ref(),
            self.albedo.clone(),
            ("albedo", None),
            |values| values.iter().map(|&v| srgb_byte(v)).collect(),
        )
    }

    /// Writes the opacity: `.exr` and `.pfm` with the same value in all three channels, `.png` as linear gray bytes,
    /// without sRGB encoding.
    ///
    /// # Errors
    /// As [`Image::write`], or if [`RenderOptions::with_opacity`](crate::render::RenderOptions::with_opacity) is off.
    pub fn write_opacity(&self, path: impl AsRef<Path>) -> Result<()> {
        let opacity = self.opacity.as_ref().map(in_three_channels);
        write_output(path.as_ref(), opacity, ("opacity", None), |values| {
            values.iter().step_by(3).map(|&v| linear_byte(v)).collect()
        })
    }

    /// Returns an output that is premultiplied by the opacity, for a PNG that of the visible surfaces.
    fn of_surfaces_in_png(
        &self,
        path: &Path,
        output: Option<Tensor<3>>,
    ) -> Result<Option<Tensor<3>>> {
        match (output, &self.opacity) {
            (Some(output), Some(opacity)) if format_of(path)? == ImageFormat::Png => {
                unpremultiply(output, opacity.clone(), 1e-6).map(Some)
            }
            (output, _) => Ok(output),
        }
    }
}

fn in_three_channels(plane: &Tensor<2>) -> Tensor<3> {
    let [height, width] = plane.dims();
    let plane: Tensor<3> = plane.clone().unsqueeze_dim(2);
    plane.expand([height, width, 3])
}

/// Writes an output of a render; a missing output is an error. `.exr` and `.pfm` store its values unchanged. `.png`
/// stores the bytes that `picture` returns: one per pixel for gray, or three for RGB.
fn write_output(
    path: &Path,
    output: Option<Tensor<3>>,
    (field, layer): (&str, Option<Layer>),
    picture: impl FnOnce(&[f32]) -> Vec<u8>,
) -> Result<()> {
    let format = format_of(path)?;
    let output = output.ok_or_else(|| {
        let expected = format!("an image rendered with RenderOptions::with_{field}");
        Error::invalid("image", field, "not there", expected)
    })?;
    let data = HostImage::take(output)?;
    if format != ImageFormat::Png {
        return data.write_layer(path, layer);
    }
    let [w, h] = sides(data.width, data.height)?;
    let bytes = picture(&data.pixels);
    let color = match bytes.len() == data.pixels.len() {
        true => ExtendedColorType::Rgb8,
        false => ExtendedColorType::L8,
    };
    write_whole(path, |file| {
        image::write_buffer_with_format(file, &bytes, w, h, color, format)
            .map_err(|e| Error::format(path, format!("it can't be written: {e}")))
    })
}

fn linear_byte(v: f32) -> u8 {
    (v.clamp(0.0, 1.0) * 255.0).round() as u8
}
