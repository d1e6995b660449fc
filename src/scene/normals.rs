//! Shading normals computed from the faces.

use burn::tensor::{IndexingUpdateOp, Int, Tensor, TensorData};

use super::Mesh;
use super::mesh::check_indices;
use super::parameter::without_tape;
use crate::geometry::{Context, Vec3, columns, gather_columns, length, split, unit_size};

impl Mesh {
    /// Sets smooth shading normals, computed from the vertices.
    ///
    /// The normal of a vertex is the unit vector along the sum of its faces' normals, each weighted by the angle of the
    /// face at the vertex (Thürmer and Wüthrich 1998, *Computing Vertex Normals from Polygonal Facets*). So it does not
    /// matter how a flat part is cut into triangles.
    ///
    /// The normals are in the graph of the vertices: gradients of shading flow to them. Call this function last, in
    /// every step of a fit. Normals from an OBJ file or from before [`with_vertices`](Mesh::with_vertices) do not
    /// follow vertices that are optimized.
    ///
    /// Vertices are the same if their indices are the same. Separate vertices at one place, as on the two sides of a
    /// crease, keep separate normals. Faces without area do not contribute. A vertex gets the normal (0, 0, 1) without
    /// gradient if no face or only such faces touch it, or if its faces cancel each other. A mesh stays unchanged if it
    /// has no faces or a face index is out of range; a render reports the latter.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let device = Device::flex();
    /// let height = Tensor::<1>::from_floats([1.0, 1.5, 1.0], &device).autodiff().require_grad();
    /// let egg = shapes::icosphere(2, &device).scaled(height).smooth_normals();
    /// let normals = egg.normals.expect("normals");
    /// assert_eq!(normals.values.dims(), [162, 3]);
    /// assert!(normals.values.is_tracked());
    /// ```
    pub fn smooth_normals(self) -> Self {
        let dims = self.vertices.dims();
        let fits = check_indices("mesh", "vertices", dims, 3, &self.faces).is_ok();
        if !fits || self.faces.is_empty() {
            return self;
        }
        let normals = vertex_normals(&self.vertices, &self.faces);
        self.with_normals(normals)
    }

    /// Removes the shading normals, so that every face is shaded flat.
    pub fn without_normals(mut self) -> Self {
        self.normals = None;
        self
    }
}

/// Returns unit normals `[V, 3]` at the vertices.
fn vertex_normals(vertices: &Tensor<2>, faces: &[[u32; 3]]) -> Tensor<2> {
    let vertices = without_tape(vertices);
    let [count, _] = vertices.dims();
    let n = faces.len();
    let context = Context {
        device: vertices.device().inner(),
        dtype: vertices.dtype(),
    };
    let epsilon = context.epsilon();
    let index: Vec<i32> = columns(faces).iter().map(|&v| v as i32).collect();
    let index = Tensor::<2, Int>::from_data(TensorData::new(index, [1, 3 * n]), &context.device);

    let planes = unit_size(vertices.swap_dims(0, 1));
    let corners = gather_columns(&planes, &index);
    let corner = |i: usize| split(&corners.clone().narrow(1, i * n, n));
    let [a, b, c] = [corner(0), corner(1), corner(2)];
    let sides = [b.sub(&a), c.sub(&b), a.sub(&c)].map(|side| unit_or_zero(&side));
    let turned = |i: usize| weighted_normal(&sides[i], &sides[(i + 2) % 3], epsilon).rows();
    let weighted = Tensor::cat(vec![turned(0), turned(1), turned(2)], 1);

    unit_sums(weighted, index, count, [0.0, 0.0, 1.0], &context)
}

/// Returns the directions `[C, 3]` of sums of vectors `[3, N]`. `index` `[1, N]` is the number of the sum that each
/// vector belongs to. A sum of about 0 gets the direction `otherwise`, without gradient.
pub(super) fn unit_sums(
    vectors: Tensor<2>,
    index: Tensor<2, Int>,
    count: usize,
    otherwise: [f64; 3],
    context: &Context,
) -> Tensor<2> {
    let index = index.expand(vectors.dims());
    let zeros = Tensor::zeros([3, count], (&context.device, context.dtype));
    let sums = split(&zeros.scatter(1, index, vectors, IndexingUpdateOp::Add));
    let square = sums.dot(&sums);
    let least = (16.0 * context.epsilon()).powi(2);
    let none = square.clone().lower_elem(least);
    let length = square.mask_fill(none.clone(), 1.0).sqrt();
    let axis = |sum: Tensor<2>, otherwise: f64| {
        let unit = sum / length.clone();
        unit.mask_fill(none.clone(), otherwise)
    };
    let [x, y, z] = otherwise;
    let unit = Vec3::new(axis(sums.x, x), axis(sums.y, y), axis(sums.z, z));
    unit.rows().swap_dims(0, 1)
}

/// Returns the unit vectors. 0 stays 0.
pub(super) fn unit_or_zero(v: &Vec3) -> Vec3 {
    let length = length(v);
    let none = length.clone().lower_equal_elem(0.0);
    let length = length.mask_fill(none, 1.0);
    v.map(|x| x / length.clone())
}

/// Returns the face's unit normal times its angle θ at a corner. `leaving` and `coming` are unit vectors along the side
/// that leaves the corner and the side that arrives at it. The result is their cross product times θ/sin θ, or 0 if sin
/// θ is no larger than rounding errors.
fn weighted_normal(leaving: &Vec3, coming: &Vec3, epsilon: f64) -> Vec3 {
    let back = coming.scale_by(-1.0);
    let normal = leaving.cross(&back);
    let square = normal.dot(&normal);
    let none = square.clone().lower_elem((8.0 * epsilon).powi(2));
    let sin = square.mask_fill(none.clone(), 1.0).sqrt();
    let angle = sin.clone().atan2(leaving.dot(&back));
    normal.scale(&(angle / sin).mask_fill(none, 0.0))
}
