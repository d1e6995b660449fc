//! The outputs of a render.

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// The outputs of a render in addition to radiance.
///
/// [`RenderOptions`](super::RenderOptions) has an example.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct Outputs {
    /// See [`RenderOptions::with_opacity`](super::RenderOptions::with_opacity).
    pub opacity: bool,
    /// See [`RenderOptions::with_depth`](super::RenderOptions::with_depth).
    pub depth: bool,
    /// See [`RenderOptions::with_normals`](super::RenderOptions::with_normals).
    pub normals: bool,
    /// See [`RenderOptions::with_albedo`](super::RenderOptions::with_albedo).
    pub albedo: bool,
    /// See [`RenderOptions::with_object_ids`](super::RenderOptions::with_object_ids).
    pub object_ids: bool,
}

impl Outputs {
    /// Whether opacity is rendered. It belongs to depth and normals, which count rays without a surface as 0.
    pub(super) fn need_opacity(self) -> bool {
        self.opacity || self.depth || self.normals
    }
}

/// Converts means over whole pixels, such as [`Image::depth`](super::Image::depth) and
/// [`Image::normals`](super::Image::normals), to means over the part of each pixel that surfaces cover: values ÷
/// max(opacity, floor). In compositing, this is the step from premultiplied to straight alpha.
///
/// `opacity` has the shape `[…, H, W]`, and `values` either the same or `[…, H, W, C]`. The result is in the graphs of
/// both, with the derivative of the quotient. `floor`, above 0 and at most 1, limits how much pixels count of which
/// surfaces cover little. They are too small then, and pixels without a surface stay 0.
///
/// A quotient of two means of few samples is biased, and so is its derivative, both in proportion to 1 / samples. So
/// prefer a loss of the values themselves; if it needs the quotient, choose a floor of at least a few divided by the
/// number of samples of a pixel.
///
/// ```
/// use softray::prelude::*;
/// let (room, camera) = cornell_box(&Device::flex());
/// let image = render(&room, &camera, &RenderOptions::new(8, 8).with_samples(16).with_depth())?;
/// let (depth, opacity) = (image.depth.expect("depth"), image.opacity.expect("opacity"));
/// let of_surfaces = unpremultiply(depth, opacity, 0.2)?;
/// assert_eq!(of_surfaces.dims(), [8, 8]);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If the shapes do not fit, or the floor is not in its range.
pub fn unpremultiply<const D: usize, const E: usize>(
    values: Tensor<D>,
    opacity: Tensor<E>,
    floor: f64,
) -> Result<Tensor<D>> {
    let (shape, plane) = (values.dims(), opacity.dims());
    let fits = shape == plane[..] || (D == E + 1 && shape[..E] == plane);
    let (found, expected) = (
        format!("{shape:?}"),
        format!("{plane:?}, with or without channels"),
    );
    Error::unless(
        fits,
        "unpremultiply",
        "shape of the values",
        found,
        &expected,
    )?;
    let valid = floor > 0.0 && floor <= 1.0;
    Error::unless(
        valid,
        "unpremultiply",
        "floor",
        floor,
        "above 0 and at most 1",
    )?;
    let divisor = opacity.clamp_min(floor);
    let divisor: Tensor<D> = match D == E {
        true => divisor.reshape(shape),
        false => divisor.unsqueeze_dim(E),
    };
    Ok(values / divisor)
}
