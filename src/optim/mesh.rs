//! Differentiable losses that keep a mesh regular.

use std::fmt;

use burn::tensor::{Bool, DType, Device, IndexingUpdateOp, Int, Tensor, TensorData};

use super::connectivity::Connectivity;
use crate::debug::Text;
use crate::device::label;
use crate::error::Result;
use crate::geometry::{Vec3, columns, gather_columns, host_values, length, split, unit_size};
use crate::scene::Mesh;

/// The object name in error messages.
const OBJECT: &str = "mesh regularizer";
/// The cotangent of 3°. Corners with a smaller angle use this value.
const STEEPEST_COTANGENT: f64 = 19.081_136_687_728_21;

/// Regularization losses for meshes with common faces: roughness, bending and uneven edge lengths.
///
/// It is built once from the faces. Every method then takes the vertices `[B, V, 3]` of B meshes, in scene
/// units. For one mesh with vertices `[V, 3]` pass `vertices.unsqueeze()`. For meshes with different faces
/// build one mesh of disjoint parts, with their vertices one after the other.
///
/// Losses are scalars `[1]`. They are means over the batch and over vertices or edges, so a weight keeps its
/// meaning on a finer mesh, except for the change of the loss itself under refinement.
///
/// Vertices are identified by their index; positions are not welded. Faces that list a vertex twice are left
/// out. Triangles without area have no normal, so edges at them count as flat. Values and gradients are finite
/// for all finite vertices.
///
/// ```
/// use softray::optim::MeshRegularizer;
/// use softray::prelude::*;
///
/// let mesh = shapes::icosphere(2, &Device::flex());
/// let regular = MeshRegularizer::from_mesh(&mesh)?;
/// let vertices = mesh.vertices.autodiff().require_grad();
/// let batch = vertices.clone().unsqueeze();
/// let loss = regular.laplacian(batch.clone()) * 10.0 + regular.normal_consistency(batch);
/// assert!(vertices.grad(&loss.backward()).is_some());
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone)]
pub struct MeshRegularizer {
    vertices: usize,
    edges: usize,
    hinges: usize,
    /// The number of vertices at which an edge ends.
    connected: usize,
    /// Vertex indices of the faces `[1, 3F]`: all first corners, then all second, then all third.
    corners: Tensor<2, Int>,
    /// Index of the edge opposite to each of `corners`, `[1, 3F]`.
    opposite: Tensor<2, Int>,
    /// Vertex indices of the ends of edges `[1, 2E]`: all first ends, then all second.
    ends: Tensor<2, Int>,
    /// Vertex indices of the edges with two faces `[1, 4H]`: all first ends, all second ends, then the faces'
    /// third vertices.
    hinge_vertices: Tensor<2, Int>,
    /// The number of neighbors of each vertex, at least 1, `[1, V]`.
    neighbors: Tensor<2, Int>,
}

impl fmt::Debug for MeshRegularizer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MeshRegularizer")
            .field("vertices", &self.vertices)
            .field("edges", &self.edges)
            .field("device", &Text(label(&self.corners.device())))
            .finish_non_exhaustive()
    }
}

impl MeshRegularizer {
    /// Creates a regularizer for meshes with these faces and `vertices` vertices, on the device of the
    /// vertices.
    ///
    /// # Errors
    /// If no face has three different vertices, or an index is out of range.
    pub fn new(faces: &[[u32; 3]], vertices: usize, device: &Device) -> Result<Self> {
        let connectivity = Connectivity::new(OBJECT, faces, vertices)?;
        let degrees = connectivity.degrees(vertices);
        let Connectivity {
            faces,
            edges,
            opposite,
            hinges,
        } = &connectivity;
        let device = device.clone().inner();
        let row = |values: Vec<u32>| {
            let data: Vec<i32> = values.iter().map(|&v| v as i32).collect();
            Tensor::from_data(TensorData::new(data, [1, values.len()]), &device)
        };
        Ok(Self {
            vertices,
            edges: edges.len(),
            hinges: hinges.len(),
            connected: degrees.iter().filter(|&&d| d > 0).count(),
            corners: row(columns(faces)),
            opposite: row(columns(opposite)),
            ends: row(columns(edges)),
            hinge_vertices: row(columns(hinges)),
            neighbors: row(degrees.iter().map(|&d| d.max(1)).collect()),
        })
    }

    /// Creates a regularizer for meshes with the faces of a mesh, on its device.
    ///
    /// # Errors
    /// Like [`MeshRegularizer::new`].
    pub fn from_mesh(mesh: &Mesh) -> Result<Self> {
        let vertices = mesh.vertices.dims()[0];
        Self::new(&mesh.faces, vertices, &mesh.vertices.device())
    }

    /// Uniform Laplacian loss: the mean of |δ|² over the vertices that have a neighbor, in square scene units.
    ///
    /// δᵢ = (Σⱼ vⱼ)/nᵢ − vᵢ over the nᵢ neighbors j is the umbrella operator (Taubin 1995, *A Signal Processing
    /// Approach to Fair Surface Design*, Eq. 2). The loss smooths the mesh and also pulls vertices together;
    /// [`laplacian_cotangent`](Self::laplacian_cotangent) only smooths.
    ///
    /// # Panics
    /// If the vertices are not `[_, V, 3]`, like all methods.
    pub fn laplacian(&self, vertices: Tensor<3>) -> Tensor<1> {
        let planes = self.planes(vertices);
        let sums = self.sums_at_vertices(self.edge_vectors(&planes));
        let counts = self.neighbors.clone().float().cast(planes.dtype());
        self.mean_square(sums / counts)
    }

    /// Cotangent Laplacian loss: the mean of |δ|² over the vertices that have a neighbor, in square scene
    /// units.
    ///
    /// δᵢ = Σⱼ wᵢⱼ(vⱼ − vᵢ)/Σⱼ wᵢⱼ, where wᵢⱼ = (cot α + cot β)/2 of the angles opposite to the edge (Desbrun
    /// et al. 1999, *Implicit Fairing of Irregular Meshes using Diffusion and Curvature Flow*, the curvature
    /// normal). δ points along the normal, so the loss does not pull vertices along the surface.
    ///
    /// No gradient flows through the weights. Cotangents are clamped to the values at 3° and 177°. Their sum at
    /// an edge is clamped to at least 0, so vᵢ + δᵢ lies in the convex hull of the neighbors on any mesh. If all
    /// weights of a vertex are 0, δᵢ is 0.
    pub fn laplacian_cotangent(&self, vertices: Tensor<3>) -> Tensor<1> {
        let planes = self.planes(vertices);
        let weights = self.cotangent_weights(&planes.clone().detach());
        let totals = Tensor::cat(vec![weights.clone(), weights.clone()], 1);
        let totals = self.scatter_ends(totals);
        let none = totals.clone().lower_equal_elem(0.0);
        let totals = totals.mask_fill(none, 1.0);
        let three = |t: Tensor<2>| Tensor::cat(vec![t; 3], 0);
        let vectors = self.edge_vectors(&planes) * three(weights);
        self.mean_square(self.sums_at_vertices(vectors) / three(totals))
    }

    /// Mean of 1 − cos of the angle between the normals of the two faces of an edge. The mean is over edges
    /// with exactly two faces. The loss is 0 on a plane and 2 at a fold. The normals are computed as if both
    /// faces were wound alike.
    pub fn normal_consistency(&self, vertices: Tensor<3>) -> Tensor<1> {
        self.bends(vertices).mean()
    }

    /// Mean of (cos θ + 1)² over edges with exactly two faces, where θ is the dihedral angle between the faces.
    ///
    /// θ is π on a plane, where the loss is 0, and 0 at a fold, where it is 4. This is the flattening loss of
    /// Liu et al. 2019, *Soft Rasterizer*, which uses a sum. cos θ is minus the cosine between the normals of
    /// faces wound alike, so the sign of a bend (ridge or valley) has no effect.
    pub fn flatness(&self, vertices: Tensor<3>) -> Tensor<1> {
        let bends = self.bends(vertices);
        (bends.clone() * bends).mean()
    }

    /// Mean of (length − target)² over edges, in square scene units; the target is in scene units. Edges of
    /// length 0 have no gradient.
    pub fn edge_length(&self, vertices: Tensor<3>, target: f64) -> Tensor<1> {
        let apart = self.edge_lengths(vertices) - target;
        (apart.clone() * apart).mean()
    }

    /// Returns the mean length of the edges in scene units, on the host: a target for
    /// [`edge_length`](Self::edge_length).
    ///
    /// # Errors
    /// If the mean cannot be read from the device.
    pub fn mean_edge_length(&self, vertices: &Tensor<3>) -> Result<f64> {
        let mean = self.edge_lengths(vertices.clone().inner()).mean();
        Ok(host_values(&mean)?[0])
    }

    /// Returns the signed volumes `[B]`, in cubic scene units. A volume is positive if faces are
    /// counter-clockwise seen from outside. For an open mesh it is the volume of the cone that connects the
    /// mesh to the mean of its vertices.
    pub fn volume(&self, vertices: Tensor<3>) -> Tensor<1> {
        // Relative to the mean, because far from the origin the volume would be lost to rounding.
        let planes = self.planes(vertices);
        let planes = planes.clone() - planes.mean_dim(1);
        let [a, b, c] = self.points(&planes, &self.corners);
        let [volumes, _] = a.x.dims();
        let six = a.dot(&b.cross(&c)).sum_dim(1).reshape([volumes]);
        six / 6.0
    }

    /// Returns the surface areas `[B]`, in square scene units.
    pub fn area(&self, vertices: Tensor<3>) -> Tensor<1> {
        let planes = self.planes(vertices);
        let [a, b, c] = self.points(&planes, &self.corners);
        let normal = b.sub(&a).cross(&c.sub(&a));
        let [batch, _] = normal.x.dims();
        length(&normal).sum_dim(1).reshape([batch]) / 2.0
    }

    /// Returns 1 − cos between the normals at edges with two faces, `[B, H]`, or a 0 `[1, 1]` if there is no
    /// such edge.
    fn bends(&self, vertices: Tensor<3>) -> Tensor<2> {
        let planes = self.planes(vertices);
        if self.hinges == 0 {
            return planes.sum().reshape([1, 1]) * 0.0;
        }
        let [i, j, k, l] = self.points(&unit_size(planes), &self.hinge_vertices);
        let (edge, to_k, to_l) = (j.sub(&i), k.sub(&i), l.sub(&i));
        // Normals of the faces i j k and j i l, which are wound alike whatever the winding in the mesh.
        let (first, first_flat) = unit_normal(&edge, &to_k);
        let (second, second_flat) = unit_normal(&to_l, &edge);
        let bends = first.dot(&second).neg().add_scalar(1.0);
        bends.mask_fill(first_flat.bool_or(second_flat), 0.0)
    }

    /// Returns (cot α + cot β)/2 at the edges, `[B, E]`, for planes that are not tracked.
    fn cotangent_weights(&self, planes: &Tensor<2>) -> Tensor<2> {
        let planes = unit_size(planes.clone());
        let [a, b, c] = self.points(&planes, &self.corners);
        let twice_area = length(&b.sub(&a).cross(&c.sub(&a)));
        let cotangent = |at: &Vec3, p: &Vec3, q: &Vec3| {
            let cos = p.sub(at).dot(&q.sub(at));
            // Where the quotient is out of range or 0/0, the clamped value replaces it.
            let bound = twice_area.clone() * STEEPEST_COTANGENT;
            let steep = cos.clone().abs().greater_equal(bound);
            let sign = cos.clone().sign() * STEEPEST_COTANGENT;
            let area = twice_area.clone().mask_fill(steep.clone(), 1.0);
            (cos / area).mask_where(steep, sign)
        };
        let cotangents = vec![
            cotangent(&a, &b, &c),
            cotangent(&b, &c, &a),
            cotangent(&c, &a, &b),
        ];
        let cotangents = Tensor::cat(cotangents, 1);
        let [batch, n] = cotangents.dims();
        let at = (&cotangents.device(), cotangents.dtype());
        let weights = Tensor::zeros([batch, self.edges], at).scatter(
            1,
            self.opposite.clone().expand([batch, n]),
            cotangents * 0.5,
            IndexingUpdateOp::Add,
        );
        weights.clamp_min(0.0)
    }

    /// Returns the lengths of the edges, `[B, E]`.
    fn edge_lengths(&self, vertices: Tensor<3>) -> Tensor<2> {
        let planes = self.planes(vertices);
        length(&split(&self.edge_vectors(&planes)))
    }

    /// Returns the second end minus the first end of every edge, `[3B, E]`.
    fn edge_vectors(&self, planes: &Tensor<2>) -> Tensor<2> {
        let ends = gather_columns(planes, &self.ends);
        ends.clone().narrow(1, self.edges, self.edges) - ends.narrow(1, 0, self.edges)
    }

    /// Returns at each vertex the sum of the vectors to its neighbors, `[3B, V]`, from the vectors along edges.
    fn sums_at_vertices(&self, edge_vectors: Tensor<2>) -> Tensor<2> {
        self.scatter_ends(Tensor::cat(
            vec![edge_vectors.clone(), edge_vectors.neg()],
            1,
        ))
    }

    /// Sums values at the first and second ends of edges `[N, 2E]` at the vertices, `[N, V]`.
    fn scatter_ends(&self, values: Tensor<2>) -> Tensor<2> {
        let [rows, n] = values.dims();
        let zeros = Tensor::zeros([rows, self.vertices], (&values.device(), values.dtype()));
        let index = self.ends.clone().expand([rows, n]);
        zeros.scatter(1, index, values, IndexingUpdateOp::Add)
    }

    /// Mean of squared vectors `[3B, V]` over the connected vertices.
    fn mean_square(&self, vectors: Tensor<2>) -> Tensor<1> {
        let [rows, _] = vectors.dims();
        let count = self.connected * rows / 3;
        (vectors.clone() * vectors).sum() / count as f64
    }

    /// Returns vertices `[B, V, 3]` as `[3B, V]`: all x, then all y, then all z, with the long axis contiguous.
    fn planes(&self, vertices: Tensor<3>) -> Tensor<2> {
        let [batch, count, axes] = vertices.dims();
        assert!(
            count == self.vertices && axes == 3,
            "{OBJECT}: vertices have shape [{batch}, {count}, {axes}], expected [_, {}, 3]",
            self.vertices
        );
        vertices.permute([2, 0, 1]).reshape([3 * batch, count])
    }

    /// Returns the vertices at the N parts of an index `[1, N·n]`, as vectors `[B, n]`.
    fn points<const N: usize>(&self, planes: &Tensor<2>, index: &Tensor<2, Int>) -> [Vec3; N] {
        let all = gather_columns(planes, index);
        let n = index.dims()[1] / N;
        std::array::from_fn(|i| split(&all.clone().narrow(1, i * n, n)))
    }
}

/// Returns the unit vector along a × b, and whether a × b is too small to tell from rounding; then the vector
/// is not unit.
fn unit_normal(a: &Vec3, b: &Vec3) -> (Vec3, Tensor<2, Bool>) {
    let normal = a.cross(b);
    let square = normal.dot(&normal);
    let epsilon = match square.dtype() {
        DType::F64 => f64::EPSILON,
        _ => f64::from(f32::EPSILON),
    };
    let bound = a.dot(a) * b.dot(b) * (8.0 * epsilon).powi(2);
    let bad = square.clone().lower_equal(bound);
    let length = square.mask_fill(bad.clone(), 1.0).sqrt();
    (normal.map(|n| n / length.clone()), bad)
}
