//! Vectors as three planes.

use std::fmt;

use burn::tensor::{Int, Tensor};
use glam::DVec3;

use super::context::{Context, detached, host_values};
use crate::debug::tensor;
use crate::error::Result;

/// Three planes of one shape: `[1, N]` for rays, `[T, 1]` for triangles.
#[derive(Clone)]
pub struct Vec3 {
    pub x: Tensor<2>,
    pub y: Tensor<2>,
    pub z: Tensor<2>,
}

impl fmt::Debug for Vec3 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Vec3 {:?}", tensor(&self.x))
    }
}

impl Vec3 {
    pub fn new(x: Tensor<2>, y: Tensor<2>, z: Tensor<2>) -> Self {
        Self { x, y, z }
    }

    /// Creates a constant vector `[1, 1]`.
    pub fn constant(context: &Context, v: [f64; 3]) -> Self {
        Self::new(
            context.row(&v[..1]),
            context.row(&v[1..2]),
            context.row(&v[2..]),
        )
    }

    /// Creates constant vectors `[1, N]` from host values.
    pub fn from_host(context: &Context, vectors: &[DVec3]) -> Self {
        let axis = |k: usize| context.row(&vectors.iter().map(|v| v[k]).collect::<Vec<_>>());
        Self::new(axis(0), axis(1), axis(2))
    }

    /// Splits the rows of `[3, N]` into planes `[1, N]`.
    pub fn from_rows(v: Tensor<2>) -> Self {
        Self::new(
            v.clone().slice([0..1]),
            v.clone().slice([1..2]),
            v.slice([2..3]),
        )
    }

    /// Splits the columns of `[T, 3]` into planes `[T, 1]`.
    pub fn from_columns(v: Tensor<2>) -> Self {
        Self::new(
            v.clone().narrow(1, 0, 1),
            v.clone().narrow(1, 1, 1),
            v.narrow(1, 2, 1),
        )
    }

    /// Joins planes `[1, N]` to `[3, N]`.
    pub fn rows(&self) -> Tensor<2> {
        Tensor::cat(vec![self.x.clone(), self.y.clone(), self.z.clone()], 0)
    }

    /// Joins planes `[T, 1]` to `[T, 3]`.
    pub fn columns(&self) -> Tensor<2> {
        Tensor::cat(vec![self.x.clone(), self.y.clone(), self.z.clone()], 1)
    }

    /// Concatenates vectors along a dimension.
    pub fn cat(parts: &[Self], dim: usize) -> Self {
        let plane = |f: fn(&Self) -> &Tensor<2>| {
            Tensor::cat(parts.iter().map(|p| f(p).clone()).collect(), dim)
        };
        Self::new(plane(|p| &p.x), plane(|p| &p.y), plane(|p| &p.z))
    }

    pub fn map(&self, f: impl Fn(Tensor<2>) -> Tensor<2>) -> Self {
        Self::new(f(self.x.clone()), f(self.y.clone()), f(self.z.clone()))
    }

    pub fn zip(&self, o: &Self, f: impl Fn(Tensor<2>, Tensor<2>) -> Tensor<2>) -> Self {
        Self::new(
            f(self.x.clone(), o.x.clone()),
            f(self.y.clone(), o.y.clone()),
            f(self.z.clone(), o.z.clone()),
        )
    }

    pub fn detached(&self) -> Self {
        Self::new(detached(&self.x), detached(&self.y), detached(&self.z))
    }

    /// Whether any plane is tracked.
    pub fn is_tracked(&self) -> bool {
        self.x.is_tracked() || self.y.is_tracked() || self.z.is_tracked()
    }

    pub fn add(&self, o: &Self) -> Self {
        self.zip(o, |a, b| a + b)
    }

    pub fn sub(&self, o: &Self) -> Self {
        self.zip(o, |a, b| a - b)
    }

    /// Componentwise product.
    pub fn mul(&self, o: &Self) -> Self {
        self.zip(o, |a, b| a * b)
    }

    /// Product with one scalar per ray (or per triangle).
    pub fn scale(&self, s: &Tensor<2>) -> Self {
        self.map(|a| a * s.clone())
    }

    /// Product with a number.
    pub fn scale_by(&self, s: f64) -> Self {
        self.map(|a| a * s)
    }

    pub fn dot(&self, o: &Self) -> Tensor<2> {
        self.x.clone() * o.x.clone() + self.y.clone() * o.y.clone() + self.z.clone() * o.z.clone()
    }

    pub fn cross(&self, o: &Self) -> Self {
        let term = |a: &Tensor<2>, b: &Tensor<2>, c: &Tensor<2>, d: &Tensor<2>| {
            a.clone() * b.clone() - c.clone() * d.clone()
        };
        Self::new(
            term(&self.y, &o.z, &self.z, &o.y),
            term(&self.z, &o.x, &self.x, &o.z),
            term(&self.x, &o.y, &self.y, &o.x),
        )
    }

    /// Returns the unit vectors. No vector may be 0.
    pub fn normalized(&self) -> Self {
        let length = self.dot(self).sqrt();
        self.map(|a| a / length.clone())
    }

    /// Returns the elements (of columns `[T, 1]` or rows `[1, T]`) at a row of indices, as rows `[1, N]`.
    pub fn gather(&self, index: &Tensor<2, Int>) -> Self {
        self.map(|a| gather_row(a, index))
    }
}

/// Returns the elements of a column `[T, 1]` or row `[1, T]` at a row of indices `[1, N]`, as a row.
pub(crate) fn gather_row(plane: Tensor<2>, index: &Tensor<2, Int>) -> Tensor<2> {
    let [a, b] = plane.dims();
    plane.reshape([1, a * b]).gather(1, index.clone())
}

/// Reads three planes back to the host, as vectors.
pub(crate) fn host_vectors(v: &Vec3) -> Result<Vec<DVec3>> {
    let (x, y, z) = (host_values(&v.x)?, host_values(&v.y)?, host_values(&v.z)?);
    let vector = |i: usize| DVec3::new(x[i], y[i], z[i]);
    Ok((0..x.len()).map(vector).collect())
}

/// Returns all first entries of the rows, then all second entries, and so on.
pub(crate) fn columns<const N: usize>(rows: &[[u32; N]]) -> Vec<u32> {
    (0..N)
        .flat_map(|i| rows.iter().map(move |r| r[i]))
        .collect()
}

/// Returns the columns `[3B, n]` at these indices `[1, n]`. It uses `gather`, whose backward pass is parallel on GPUs;
/// the backward pass of `select` is serial.
pub(crate) fn gather_columns(planes: &Tensor<2>, index: &Tensor<2, Int>) -> Tensor<2> {
    let ([rows, _], [_, n]) = (planes.dims(), index.dims());
    planes.clone().gather(1, index.clone().expand([rows, n]))
}

/// Splits planes `[3B, N]` into vectors `[B, N]`.
pub(crate) fn split(planes: &Tensor<2>) -> Vec3 {
    let batch = planes.dims()[0] / 3;
    let axis = |i: usize| planes.clone().narrow(0, i * batch, batch);
    Vec3::new(axis(0), axis(1), axis(2))
}

/// Scales planes `[3B, V]` by the inverse of each mesh's extent, which is a constant for gradients. It is used for
/// angles: powers of lengths stay in the range of floats.
pub(crate) fn unit_size(planes: Tensor<2>) -> Tensor<2> {
    let plain = planes.clone().detach();
    let extent = plain.clone().max_dim(1) - plain.min_dim(1);
    let axes = split(&extent);
    let extent = axes.x.max_pair(axes.y).max_pair(axes.z);
    // Smaller extents have no reciprocal in f32.
    let none = extent.clone().lower_elem(f64::from(f32::MIN_POSITIVE));
    let scale = extent.mask_fill(none, 1.0).recip();
    planes * Tensor::cat(vec![scale; 3], 0)
}

/// Returns the length of vectors. The length of the vector 0 has no gradient.
pub(crate) fn length(v: &Vec3) -> Tensor<2> {
    let square = v.dot(v);
    let none = square.clone().lower_equal_elem(0.0);
    square
        .mask_fill(none.clone(), 1.0)
        .sqrt()
        .mask_fill(none, 0.0)
}
