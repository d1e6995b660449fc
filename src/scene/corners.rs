//! Values at the corners of faces.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};

/// Values at the corners of faces, with their own indices.
/// Texture coordinates and normals may have seams where positions have none.
///
/// [`Mesh::smooth_normals`](super::Mesh::smooth_normals) has an example.
#[derive(Clone)]
#[cfg_attr(feature = "remote", derive(serde::Serialize, serde::Deserialize))]
pub struct CornerAttribute {
    /// The values `[V, C]`.
    #[cfg_attr(feature = "remote", serde(with = "super::slots::tensor"))]
    pub values: Tensor<2>,
    /// Rows of `values` for the three corners of each face.
    #[cfg_attr(feature = "remote", serde(with = "super::slots::faces"))]
    pub faces: Arc<Vec<[u32; 3]>>,
}

impl CornerAttribute {
    /// Creates an attribute from values `[V, C]` and their rows at the three corners of each face.
    pub fn new(values: Tensor<2>, faces: impl Into<Arc<Vec<[u32; 3]>>>) -> Self {
        let faces = faces.into();
        Self { values, faces }
    }

    /// Creates an attribute from constant values on a device, in its default float type, and their rows at the three
    /// corners of each face.
    pub fn from_host<const C: usize>(
        values: &[[f64; C]],
        faces: impl Into<Arc<Vec<[u32; 3]>>>,
        device: &Device,
    ) -> Self {
        let numbers = TensorData::new(values.concat(), [values.len(), C]);
        Self::new(Tensor::from_data(numbers, device), faces)
    }

    /// Flips the sign of the bitangents of tangents, for a mirror image.
    pub(super) fn mirror(&mut self) {
        let device = self.values.device().inner();
        let sides = TensorData::new(vec![1.0f32, 1.0, 1.0, -1.0], [1, 4]);
        let sides = Tensor::<2>::from_data(sides, (&device, self.values.dtype()));
        self.values = self.values.clone() * sides;
    }
}
