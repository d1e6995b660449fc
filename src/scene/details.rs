//! What surfaces have beside shape and reflection: colors and tangents of corners, normal maps, masks.

use std::sync::Arc;

use burn::tensor::Tensor;

use super::corners::CornerAttribute;
use super::maps::{AlphaMask, NormalMap};
use super::{Material, Mesh, Object};
use softray_kernels::host::Wrap;

impl Mesh {
    /// Sets colors `[N, 3]`, linear RGB ≥ 0, and the rows of them at the corners of each face: for colors of
    /// vertices, which have one row each, these are `mesh.faces.clone()`. They are interpolated over each face, and
    /// the diffuse albedo of its material is multiplied by them (as by glTF's `COLOR_0`): give it an albedo of 1
    /// where they are all of the color.
    ///
    /// They are differentiable. Where faces side by side have other colors at the edge that they share, the color
    /// jumps, and gradients by vertices count that.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let device = Device::flex();
    /// let ball = shapes::icosphere(1, &device);
    /// let colors = Tensor::ones([42, 3], &device.clone().autodiff()).require_grad();
    /// let faces = ball.faces.clone();
    /// let painted = Object::new(ball.with_colors(colors * 0.5, faces)).with_material(Material::diffuse([1.0; 3]));
    /// # let _ = painted;
    /// ```
    pub fn with_colors(mut self, values: Tensor<2>, faces: impl Into<Arc<Vec<[u32; 3]>>>) -> Self {
        self.colors = Some(CornerAttribute::new(values, faces));
        self
    }

    /// Sets tangents `[N, 4]` for normal maps, and the rows of them at the corners of each face, as glTF has them:
    /// x, y and z point along increasing u, and the fourth number is 1 or −1, by which the bitangent
    /// normal × tangent is multiplied to point along increasing v. They need not be of unit length or
    /// perpendicular to the normals, and are differentiable.
    ///
    /// A mesh without them gets those of [`mikktspace_tangents`](Self::mikktspace_tangents) where its material has a
    /// normal map.
    pub fn with_tangents(
        mut self,
        values: Tensor<2>,
        faces: impl Into<Arc<Vec<[u32; 3]>>>,
    ) -> Self {
        self.tangents = Some(CornerAttribute::new(values, faces));
        self
    }

    /// The attributes of corners that it may have, with their names and numbers of columns.
    pub(crate) fn attributes(&self) -> [(&'static str, usize, Option<&CornerAttribute>); 4] {
        [
            ("uvs", 2, self.uvs.as_ref()),
            ("normals", 3, self.normals.as_ref()),
            ("colors", 3, self.colors.as_ref()),
            ("tangents", 4, self.tangents.as_ref()),
        ]
    }

    /// The same, to be changed.
    pub(crate) fn attributes_mut(&mut self) -> [Option<&mut CornerAttribute>; 4] {
        [
            self.uvs.as_mut(),
            self.normals.as_mut(),
            self.colors.as_mut(),
            self.tangents.as_mut(),
        ]
    }

    /// Changes the directions `[N, 3]` of tangents.
    pub(super) fn turn_tangents(&mut self, turn: impl FnOnce(Tensor<2>) -> Tensor<2>) {
        if let Some(tangents) = &mut self.tangents
            && tangents.values.dims()[1] == 4
        {
            let turned = turn(tangents.values.clone().narrow(1, 0, 3));
            let sides = tangents.values.clone().narrow(1, 3, 1);
            tangents.values = Tensor::cat(vec![turned, sides], 1);
        }
    }
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
    pub fn with_normal_map(mut self, texels: Tensor<3>, scale: f64) -> Self {
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
    pub fn with_alpha_mask(mut self, alpha: Tensor<2>, cutoff: f64) -> Self {
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
