//! Values at the corners of faces.

use std::sync::Arc;

use burn::tensor::Tensor;

use super::Mesh;
use super::mesh::host_tensor;

/// Values at the corners of faces, with an index of their own: texture coordinates and normals
/// have seams where positions have none.
#[derive(Clone)]
pub struct CornerAttribute {
    /// `[V, C]`.
    pub values: Tensor<2>,
    /// Rows of `values` for the three corners of each face.
    pub faces: Arc<Vec<[u32; 3]>>,
}

impl CornerAttribute {
    /// Values `[V, C]`, and their rows at the three corners of each face.
    pub fn new(values: Tensor<2>, faces: impl Into<Arc<Vec<[u32; 3]>>>) -> Self {
        let faces = faces.into();
        Self { values, faces }
    }

    /// Turns the bitangents of tangents to the other side, as those of a mirror image are.
    pub(super) fn mirror(&mut self) {
        let device = self.values.device().inner();
        let sides = host_tensor(&[[1.0, 1.0, 1.0, -1.0]], &device).cast(self.values.dtype());
        self.values = self.values.clone() * sides;
    }
}

impl Mesh {
    /// Sets colours `[N, 3]`, linear RGB ≥ 0, and the rows of them at the corners of each face: for colours of
    /// vertices, which have one row each, these are `mesh.faces.clone()`. They are interpolated over each face, and
    /// the diffuse albedo of its material is multiplied by them (as by glTF's `COLOR_0`): give it an albedo of 1
    /// where they are all of the colour.
    ///
    /// They are differentiable. Where faces side by side have other colours at the edge that they share, the colour
    /// jumps, and gradients by vertices count that.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let device = Device::flex();
    /// let ball = shapes::icosphere(1, &device);
    /// let colours = Tensor::ones([42, 3], &device.clone().autodiff()).require_grad();
    /// let faces = ball.faces.clone();
    /// let painted = Object::new(ball.with_colours(colours * 0.5, faces)).material(Material::diffuse([1.0; 3]));
    /// # let _ = painted;
    /// ```
    pub fn with_colours(mut self, values: Tensor<2>, faces: impl Into<Arc<Vec<[u32; 3]>>>) -> Self {
        self.colours = Some(CornerAttribute::new(values, faces));
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
            ("colours", 3, self.colours.as_ref()),
            ("tangents", 4, self.tangents.as_ref()),
        ]
    }

    /// The same, to be changed.
    pub(crate) fn attributes_mut(&mut self) -> [Option<&mut CornerAttribute>; 4] {
        [
            self.uvs.as_mut(),
            self.normals.as_mut(),
            self.colours.as_mut(),
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
