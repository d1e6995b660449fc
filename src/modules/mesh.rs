use std::sync::Arc;

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData};

use super::values::leaf;
use crate::error::Result;
use crate::geometry::host_values;
use crate::scene::{CornerAttribute, Mesh};

/// A mesh with trained vertices.
///
/// Faces, texture coordinates, shading normals, colors and tangents come from the mesh passed to
/// [`MeshParams::from_mesh`] and are constant. Shading normals and tangents therefore do not follow the
/// vertices. If the shape changes much, omit them (`normals: None`), or recompute the normals with
/// [`Mesh::smooth_normals`].
///
/// ```
/// use burn::module::Module;
/// use softray::modules::MeshParams;
/// use softray::prelude::*;
/// let device = Device::flex();
/// let ball = shapes::icosphere(1, &device);
/// let params = MeshParams::from_mesh(&ball, &device.autodiff())?;
/// assert_eq!(params.num_params(), 42 * 3);
/// let moved = params.mesh().translated(Tensor::from_floats([0.0, 1.0, 0.0], &Device::flex()));
/// assert!(moved.vertices.is_tracked());
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct MeshParams {
    /// Positions `[V, 3]`, scene units.
    pub vertices: Param<Tensor<2>>,
    template: Template,
}

impl MeshParams {
    /// Creates parameters with the vertices of a mesh, in the device's default float type.
    ///
    /// # Errors
    /// If a tensor of the mesh cannot be read.
    pub fn from_mesh(mesh: &Mesh, device: &Device) -> Result<Self> {
        let values = host_values(&mesh.vertices)?;
        Ok(Self {
            vertices: leaf(values, mesh.vertices.dims(), device),
            template: Template::new(mesh, device)?,
        })
    }

    /// Returns the mesh, in the graph of the vertices.
    pub fn mesh(&self) -> Mesh {
        self.template.mesh(self.vertices.val())
    }
}

/// A mesh with trained offsets from constant vertices.
///
/// Weight decay or a penalty on the offsets pulls the mesh towards its initial shape. Otherwise it is like
/// [`MeshParams`].
///
/// ```
/// use softray::modules::MeshOffsets;
/// use softray::prelude::*;
/// let device = Device::flex();
/// let ball = shapes::icosphere(1, &device);
/// let params = MeshOffsets::from_mesh(&ball, &device.autodiff())?;
/// let penalty = params.offsets.val().powi_scalar(2).mean();
/// assert_eq!(penalty.into_scalar::<f32>(), 0.0);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct MeshOffsets {
    /// Offsets `[V, 3]` from the initial vertices, scene units; 0 at the start.
    pub offsets: Param<Tensor<2>>,
    rest: Tensor<2>,
    template: Template,
}

impl MeshOffsets {
    /// Creates offsets of 0 from the vertices of a mesh, in the device's default float type.
    ///
    /// # Errors
    /// If a tensor of the mesh cannot be read.
    pub fn from_mesh(mesh: &Mesh, device: &Device) -> Result<Self> {
        let rest = constant(&mesh.vertices, device)?;
        let [count, axes] = rest.dims();
        Ok(Self {
            offsets: leaf(vec![0.0; count * axes], [count, axes], device),
            rest,
            template: Template::new(mesh, device)?,
        })
    }

    /// Returns the mesh, in the graph of the offsets.
    pub fn mesh(&self) -> Mesh {
        let offsets = self.offsets.val();
        let rest = self.rest.clone().cast(offsets.dtype());
        self.template.mesh(rest + offsets)
    }
}

/// Copies a tensor to a device without its graph, in the device's default float type.
fn constant(tensor: &Tensor<2>, device: &Device) -> Result<Tensor<2>> {
    let data = TensorData::new(host_values(tensor)?, tensor.dims());
    Ok(Tensor::from_data(data, device))
}

/// The constant parts of a mesh with trained vertices. The tensors move between devices with the module.
#[derive(Module, Debug)]
struct Template {
    /// Texture coordinates, normals, colors and tangents.
    attributes: [Option<Tensor<2>>; 4],
    /// Indices of the faces into the positions, then into each attribute.
    #[module(skip)]
    faces: [Arc<Vec<[u32; 3]>>; 5],
}

impl Template {
    fn new(mesh: &Mesh, device: &Device) -> Result<Self> {
        let attributes = mesh.attributes().map(|(_, _, attribute)| attribute);
        let [uvs, normals, colors, tangents] =
            attributes.map(|a| a.map_or_else(Arc::default, |a| a.faces.clone()));
        let mut constants = [const { None }; 4];
        for (constant_of, attribute) in constants.iter_mut().zip(attributes) {
            *constant_of = attribute.map(|a| constant(&a.values, device)).transpose()?;
        }
        Ok(Self {
            attributes: constants,
            faces: [mesh.faces.clone(), uvs, normals, colors, tangents],
        })
    }

    /// Builds the mesh. Constants are cast to the float type of the vertices, which a loaded file may have
    /// changed.
    fn mesh(&self, vertices: Tensor<2>) -> Mesh {
        let dtype = vertices.dtype();
        let [faces, of_attributes @ ..] = &self.faces;
        let mut attributes = self
            .attributes
            .iter()
            .zip(of_attributes)
            .map(|(values, faces)| {
                let values = values.clone()?.cast(dtype);
                Some(CornerAttribute::new(values, faces.clone()))
            });
        let mut next = || attributes.next().flatten();
        Mesh {
            uvs: next(),
            normals: next(),
            colors: next(),
            tangents: next(),
            ..Mesh::of_faces(vertices, faces.clone())
        }
    }
}
