//! Images on surfaces that are no colours: tilts of the normal, and holes.

use burn::tensor::Tensor;

use super::holes::Mask;
use super::{Material, Object, Wrap};
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

impl Material {
    /// Sets a normal map `[H, W, 3]` that repeats, with numbers in [−1, 1] as glTF has them: red along increasing u,
    /// green along increasing v (up in the image), blue along the normal, so that a texel of a file is twice its
    /// value in [0, 1] (linear, not sRGB) less 1. Red and green are multiplied by `scale`. The shading normal is
    /// N' ∝ r·T + g·B + b·N, from the interpolated normal N, the tangent T made perpendicular to it, and
    /// B = ±N × T ([`Mesh::with_tangents`](super::Mesh::with_tangents)); (0, 0, 1) leaves it as it is.
    ///
    /// Gradients go to texels, normals, texture coordinates and tangents; tangents that a mesh does not bring along
    /// are in the graph of its vertices, normals and texture coordinates. The surface keeps its shape: it is
    /// shaded as if it were tilted, but cos θ is at most four times that to its true normal, so that no light comes
    /// through it.
    pub fn normal_map(mut self, texels: Tensor<3>, scale: f64) -> Self {
        let texels = if scale == 1.0 || texels.dims()[2] != 3 {
            texels
        } else {
            let tilt = texels.clone().narrow(2, 0, 2) * scale;
            Tensor::cat(vec![tilt, texels.narrow(2, 2, 1)], 2)
        };
        let wrap = Wrap::Repeat;
        self.normal_map = Some(NormalMap { texels, wrap });
        self
    }

    /// Sets a mask `[H, W]` that repeats: where alpha, looked up bilinearly, is less than `cutoff`, the surface has a
    /// hole, through which rays of cameras, bounces and shadows pass. Where it is not, it is opaque.
    ///
    /// The mask has no gradient: the outlines of its holes are not edges of a mesh, and what jumps at them is no part
    /// of any gradient. Where a fit is to move an outline, give it as a mesh. Masks are for cones; a render
    /// by the softmax with one is an error.
    pub fn alpha_mask(mut self, alpha: Tensor<2>, cutoff: f64) -> Self {
        let wrap = Wrap::Repeat;
        self.alpha_mask = Some(AlphaMask {
            alpha,
            wrap,
            cutoff,
        });
        self
    }
}

impl Object {
    /// Whether a material has a normal map, and the mesh no tangents.
    pub(crate) fn lacks_tangents(&self) -> bool {
        self.mesh.tangents.is_none() && self.materials.iter().any(|m| m.normal_map.is_some())
    }
}

impl AlphaMask {
    /// The mask on the host.
    ///
    /// # Errors
    /// If it is empty, or a number is not finite.
    pub(super) fn on_host(&self, material: &str) -> Result<Mask> {
        let [h, w] = self.alpha.dims();
        let wrong = |field: &str, found: String, expected: &str| {
            Err(Error::invalid(material, field, found, expected))
        };
        if h == 0 || w == 0 {
            let expected = "at least one row and column";
            return wrong("alpha mask", format!("of shape [{h}, {w}]"), expected);
        }
        let cutoff = self.cutoff;
        if !(cutoff as f32).is_finite() {
            return wrong("alpha cutoff", cutoff.to_string(), "a finite number");
        }
        let values = host_values(&self.alpha)?.into_iter();
        let alpha: Vec<f32> = values.map(|a| a as f32).collect();
        if let Some(i) = alpha.iter().position(|a| !a.is_finite()) {
            let field = format!("alpha mask texel ({}, {})", i / w, i % w);
            return wrong(&field, alpha[i].to_string(), "finite numbers");
        }
        Ok(Mask {
            alpha,
            width: w,
            height: h,
            wrap: self.wrap,
            cutoff: cutoff as f32,
        })
    }
}
