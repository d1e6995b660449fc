//! Vertices of meshes as planes `[3B, V]`: all x, all y, all z, the long axis contiguous.

use burn::tensor::{Int, Tensor};

use super::vec3::Vec3;

/// All first entries of the rows, then all second ones, and so on.
pub(crate) fn columns<const N: usize>(rows: &[[u32; N]]) -> Vec<u32> {
    (0..N)
        .flat_map(|i| rows.iter().map(move |r| r[i]))
        .collect()
}

/// The columns `[3B, n]` of these numbers `[1, n]`. It uses `gather`, whose backward pass is parallel on
/// GPUs where that of `select` is serial.
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

/// Planes `[3B, V]` in units of each mesh's extent, which is a constant to the gradient: for angles,
/// so that powers of lengths stay within what floats hold.
pub(crate) fn unit_size(planes: Tensor<2>) -> Tensor<2> {
    let plain = planes.clone().detach();
    let extent = plain.clone().max_dim(1) - plain.min_dim(1);
    let axes = split(&extent);
    let extent = axes.x.max_pair(axes.y).max_pair(axes.z);
    // Smaller ones have no reciprocal in f32.
    let none = extent.clone().lower_elem(f64::from(f32::MIN_POSITIVE));
    let scale = extent.mask_fill(none, 1.0).recip();
    planes * Tensor::cat(vec![scale; 3], 0)
}

/// Length of vectors; that of 0 has no gradient.
pub(crate) fn length(v: &Vec3) -> Tensor<2> {
    let square = v.dot(v);
    let none = square.clone().lower_equal_elem(0.0);
    square
        .mask_fill(none.clone(), 1.0)
        .sqrt()
        .mask_fill(none, 0.0)
}
