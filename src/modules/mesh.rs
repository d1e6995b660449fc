use std::sync::Arc;

use burn::module::{Module, Param};
use burn::tensor::Tensor;

use crate::scene::{CornerAttribute, Mesh};

/// A mesh with free vertices. Faces, texture coordinates, shading normals, colours and tangents are those of the mesh that
/// it was made from; they are constant, so shading normals and tangents don't follow the vertices: leave them out
/// (`normals: None`) where the shape changes much, or let [`Mesh::smooth_normals`] of the mesh follow them.
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
    /// Parameters that begin with the vertices of a mesh, on their device and in their float type.
    pub fn from_mesh(mesh: &Mesh) -> Self {
        Self {
            vertices: Param::from_tensor(mesh.vertices.clone().detach()),
            template: Template::new(mesh),
        }
    }

    /// The mesh, in the graph of the vertices.
    pub fn mesh(&self) -> Mesh {
        self.template.mesh(self.vertices.val())
    }
}

/// A mesh whose vertices are those of another, which are constant, plus offsets, which are trained: weight
/// decay or a penalty on the offsets pulls towards the mesh that it was made from. Otherwise like
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
    /// Offsets `[V, 3]` from the mesh that it was made from, scene units; 0 to begin with.
    pub offsets: Param<Tensor<2>>,
    rest: Tensor<2>,
    template: Template,
}

impl MeshOffsets {
    /// About the vertices of a mesh, on their device and in their float type.
    pub fn from_mesh(mesh: &Mesh) -> Self {
        let rest = mesh.vertices.clone().detach();
        Self {
            offsets: Param::from_tensor(rest.zeros_like()),
            rest,
            template: Template::new(mesh),
        }
    }

    /// The mesh, in the graph of the offsets.
    pub fn mesh(&self) -> Mesh {
        let offsets = self.offsets.val();
        let rest = self.rest.clone().cast(offsets.dtype());
        self.template.mesh(rest + offsets)
    }
}

/// The constant parts of a mesh whose vertices are trained: tensors go where the module goes.
#[derive(Module, Debug)]
struct Template {
    /// Texture coordinates, normals, colours and tangents.
    attributes: [Option<Tensor<2>>; 4],
    /// Those of positions, then of the attributes.
    #[module(skip)]
    faces: [Arc<Vec<[u32; 3]>>; 5],
}

impl Template {
    fn new(mesh: &Mesh) -> Self {
        let attributes = mesh.attributes().map(|(_, _, attribute)| attribute);
        let [uvs, normals, colours, tangents] =
            attributes.map(|a| a.map_or_else(Arc::default, |a| a.faces.clone()));
        Self {
            attributes: attributes.map(|a| a.map(|a| a.values.clone().detach())),
            faces: [mesh.faces.clone(), uvs, normals, colours, tangents],
        }
    }

    /// Constants take the float type of the vertices, which a file may have changed.
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
            colours: next(),
            tangents: next(),
            ..Mesh::of_faces(vertices, faces.clone())
        }
    }
}
