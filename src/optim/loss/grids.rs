//! Penalties on grids of signed distances.

use burn::tensor::Tensor;

use super::check_size;
use crate::error::{Error, Result};

/// The eikonal penalty of grids of distances `[S, N, N, N]` whose nodes are `step` apart: the mean of (|∇d| − 1)², which is 0
/// for signed distances (Gropp et al. 2020, *Implicit Geometric Regularization for Learning Shapes*, Eq. 2). The
/// derivatives are differences between neighboring nodes. For
/// [`TetrahedralGrid::surfaces`](crate::modules::TetrahedralGrid::surfaces).
///
/// ```
/// use softray::loss;
/// use softray::modules::TetrahedralGrid;
/// use softray::prelude::*;
/// let grid = TetrahedralGrid::new(16, 2.0)?;
/// let x = grid.nodes(&Device::flex()).narrow(3, 0, 1).squeeze_dim::<3>(3).unsqueeze::<4>();
/// assert!(loss::eikonal(x.clone(), grid.step())?.into_scalar::<f32>() < 1e-6);
/// assert!(loss::eikonal(x * 2.0, grid.step())?.into_scalar::<f32>() > 0.9);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If the last three axes are shorter than 2, or `step` is not a finite number > 0.
pub fn eikonal(distances: Tensor<4>, step: f64) -> Result<Tensor<1>> {
    check("eikonal", &distances, step, 2)?;
    let squares = [1, 2, 3].map(|axis| {
        let change = changes(distances.clone(), axis);
        let others = (1..4).filter(|&other| other != axis);
        let first = |map: Tensor<4>, axis| {
            let length = map.dims()[axis] - 1;
            map.narrow(axis, 0, length)
        };
        (others.fold(change, first) / step).powi_scalar(2)
    });
    let [x, y, z] = squares;
    // The square root has no derivative at 0.
    let length = (x + y + z + 1e-12).sqrt();
    Ok((length - 1.0).powi_scalar(2).mean())
}

/// A penalty on grids of distances `[S, N, N, N]` that bend, whose nodes are `step` apart: the mean of the squared second
/// differences between neighboring nodes along the axes, over step², summed over the axes. It is 0 for a plane and about
/// (step/r)² for a surface with the radius of curvature r, so it keeps noise out of the surface: without it, a fit opens
/// small holes and handles.
///
/// ```
/// use softray::loss;
/// use softray::prelude::*;
/// let line = Tensor::<1>::from_floats([0.0, 1.0, 4.0], &Device::flex());
/// let grid = line.reshape([1, 3, 1, 1]).repeat(&[1, 1, 3, 3]);
/// assert_eq!(loss::bending(grid, 0.5)?.into_scalar::<f32>(), 16.0);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If the last three axes are shorter than 3, or `step` is not a finite number > 0.
pub fn bending(distances: Tensor<4>, step: f64) -> Result<Tensor<1>> {
    check("bending", &distances, step, 3)?;
    let [x, y, z] = [1, 2, 3].map(|axis| {
        let bend = changes(changes(distances.clone(), axis), axis);
        (bend / step).powi_scalar(2).mean()
    });
    Ok(x + y + z)
}

/// The differences between neighbors along an axis.
fn changes(map: Tensor<4>, axis: usize) -> Tensor<4> {
    let length = map.dims()[axis] - 1;
    map.clone().narrow(axis, 1, length) - map.narrow(axis, 0, length)
}

fn check(object: &'static str, distances: &Tensor<4>, step: f64, least: usize) -> Result<()> {
    check_size(object, distances)?;
    Error::unless_positive(object, "step", step)?;
    let dims = distances.dims();
    let long = dims[1..].iter().all(|&n| n >= least);
    let (shown, expected) = (
        format!("{dims:?}"),
        format!("axes of at least {least} nodes"),
    );
    Error::unless(long, object, "distances", shown, &expected)
}
