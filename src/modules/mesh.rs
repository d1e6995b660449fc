use std::sync::Arc;

use burn::module::{Module, Param};
use burn::tensor::Tensor;

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
/// let ball = shapes::icosphere(1, &Device::flex().autodiff());
/// let params = MeshParams::from_mesh(&ball);
/// assert_eq!(params.num_params(), 42 * 3);
/// let moved = params.mesh().translated(Tensor::from_floats([0.0, 1.0, 0.0], &Device::flex()));
/// assert!(moved.vertices.is_tracked());
/// ```
#[derive(Module)]
pub struct MeshParams {
    /// Positions `[V, 3]`, scene units.
    pub vertices: Param<Tensor<2>>,
    template: Template,
}

impl MeshParams {
    /// Creates parameters with the vertices of a mesh, on their device and in their float type.
    pub fn from_mesh(mesh: &Mesh) -> Self {
        Self {
            vertices: Param::from_tensor(mesh.vertices.clone().detach()),
            template: Template::new(mesh),
        }
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
/// let ball = shapes::icosphere(1, &Device::flex().autodiff());
/// let params = MeshOffsets::from_mesh(&ball);
/// let penalty = params.offsets.val().powi_scalar(2).mean();
/// assert_eq!(penalty.into_scalar::<f32>(), 0.0);
/// ```
#[derive(Module)]
pub struct MeshOffsets {
    /// Offsets `[V, 3]` from the initial vertices, scene units; 0 at the start.
    pub offsets: Param<Tensor<2>>,
    rest: Tensor<2>,
    template: Template,
}

impl MeshOffsets {
    /// Creates offsets of 0 from the vertices of a mesh, on their device and in their float type.
    pub fn from_mesh(mesh: &Mesh) -> Self {
        let rest = mesh.vertices.clone().detach();
        Self {
            offsets: Param::from_tensor(rest.zeros_like()),
            rest,
            template: Template::new(mesh),
        }
    }

    /// Returns the mesh, in the graph of the offsets.
    pub fn mesh(&self) -> Mesh {
        let offsets = self.offsets.val();
        let rest = self.rest.clone().cast(offsets.dtype());
        self.template.mesh(rest + offsets)
    }
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
    fn new(mesh: &Mesh) -> Self {
        let attributes = mesh.attributes().map(|(_, _, attribute)| attribute);
        let [uvs, normals, colors, tangents] =
            attributes.map(|a| a.map_or_else(Arc::default, |a| a.faces.clone()));
        Self {
            attributes: attributes.map(|a| a.map(|a| a.values.clone().detach())),
            faces: [mesh.faces.clone(), uvs, normals, colors, tangents],
        }
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
