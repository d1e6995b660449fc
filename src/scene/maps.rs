//! Normal maps and alpha masks.

use burn::tensor::Tensor;

use crate::error::{Error, Result};
use crate::geometry::host_values;
use softray_kernels::host::Wrap;

/// A normal map: tilts of the shading normal over a surface.
///
/// [`NormalMapParams`](crate::modules::NormalMapParams) has an example.
#[derive(Clone)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub struct NormalMap {
    /// Texels `[H, W, 3]`, row 0 at the top (v = 1), interpolated bilinearly like the texture of a
    /// [`ColorTexture`](super::ColorTexture).
    /// They are the normal's components along tangent, bitangent and the interpolated normal, of any length.
    #[cfg_attr(feature = "remote", serde(with = "super::slots::tensor"))]
    pub texels: Tensor<3>,
    /// The continuation outside of the unit square.
    pub wrap: Wrap,
}

/// An alpha mask: the holes of a surface.
///
/// ```
/// use softray::prelude::*;
/// let alpha = Tensor::<2>::from_floats([[0.0, 1.0]], &Device::flex());
/// let fence = Material::diffuse([0.5; 3]).with_alpha_mask(alpha, 0.5);
/// assert_eq!(fence.alpha_mask.expect("a mask").cutoff, 0.5);
/// ```
#[derive(Clone)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub struct AlphaMask {
    /// Alpha `[H, W]`, row 0 at the top (v = 1), interpolated bilinearly.
    #[cfg_attr(feature = "remote", serde(with = "super::slots::tensor"))]
    pub alpha: Tensor<2>,
    /// The continuation outside of the unit square.
    pub wrap: Wrap,
    /// The surface has a hole where alpha is less than this.
    pub cutoff: f64,
}

impl AlphaMask {
    /// Returns the values of alpha on the host.
    ///
    /// # Errors
    /// If there are no values, or a value is not finite.
    pub(super) fn numbers(&self, material: &str) -> Result<Vec<f32>> {
        let [h, w] = self.alpha.dims();
        let wrong = |field: &str, found: String, expected: &str| {
            Err(Error::invalid(material, field, found, expected))
        };
        if h == 0 || w == 0 {
            let expected = "at least one row and column";
            return wrong("alpha mask", format!("of shape [{h}, {w}]"), expected);
        }
        let values = host_values(&self.alpha)?.into_iter();
        let alpha: Vec<f32> = values.map(|a| a as f32).collect();
        if let Some(i) = alpha.iter().position(|a| !a.is_finite()) {
            let field = format!("alpha mask texel ({}, {})", i / w, i % w);
            return wrong(&field, alpha[i].to_string(), "finite numbers");
        }
        Ok(alpha)
    }
}
