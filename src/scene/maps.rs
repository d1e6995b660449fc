//! Images on surfaces that are no colours: tilts of the normal, and holes.

use burn::tensor::Tensor;

use super::wrap::Wrap;
use crate::error::{Error, Result};
use crate::geometry::host_values;

/// Tilts of the shading normal over a surface.
#[derive(Clone)]
pub struct NormalMap {
    /// `[H, W, 3]`, row 0 at the top (v = 1), looked up bilinearly like an [`Albedo`](super::Albedo)'s texture: the
    /// normal's parts along tangent, bitangent and the interpolated normal, of any length.
    pub texels: Tensor<3>,
    /// Outside of the unit square.
    pub wrap: Wrap,
}

/// Where a surface is, and where it has holes.
#[derive(Clone)]
pub struct AlphaMask {
    /// `[H, W]`, row 0 at the top (v = 1), looked up bilinearly.
    pub alpha: Tensor<2>,
    /// Outside of the unit square.
    pub wrap: Wrap,
    /// There is a hole where alpha is less.
    pub cutoff: f64,
}

impl AlphaMask {
    /// The numbers on the host.
    ///
    /// # Errors
    /// If there are none, or a number is not finite.
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
