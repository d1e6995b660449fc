//! Distances of point clouds.

use burn::tensor::Tensor;
use glam::DVec3;

use crate::error::{Error, Result};
use crate::geometry::host_values;
use crate::optim::nearest::{Near, PointTree};
use crate::scene::take_rows;

/// The Chamfer distance between two point clouds `[N, 3]` and `[M, 3]` in scene units.
///
/// It is (1/N)·Σᵢ minⱼ |aᵢ − bⱼ|² + (1/M)·Σⱼ minᵢ |aᵢ − bⱼ|², which equals `pytorch3d.loss.chamfer_distance`
/// with its defaults. The unit is square scene units. The distance is 0 where both clouds have the same points.
///
/// Gradients flow to both clouds. The nearest points are found on the host in a k-d tree and are constant for
/// the gradient; the distance has a kink where the nearest point changes. The search takes about N·log M steps.
/// It takes up to N·M steps where many points are about equally near, for example from a small cloud in the
/// middle of a sphere. [`sample_points`](crate::optim::sample_points) returns points of a surface.
///
/// ```
/// use softray::loss;
/// use softray::optim::sample_points;
/// use softray::prelude::*;
/// let device = Device::flex();
/// let target = sample_points(&shapes::sphere(24, 12, &device), 500, 0)?;
/// let size = Tensor::<1>::from_floats([0.5], &device).autodiff().require_grad();
/// let ball = shapes::icosphere(2, &device).scaled(size.clone());
/// let distance = loss::chamfer(sample_points(&ball, 500, 1)?, target)?;
/// // The ball should grow.
/// let gradient = size.grad(&distance.backward()).expect("a gradient");
/// assert!(gradient.into_scalar::<f32>() < 0.0);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If a cloud is not `[N, 3]`, has no points or a point that is not finite, the clouds differ in device or
/// float type, or a tensor cannot be read from its device.
pub fn chamfer(a: Tensor<2>, b: Tensor<2>) -> Result<Tensor<1>> {
    let [from_a, from_b] = nearest(&a, &b)?;
    let mean = |from: &Tensor<2>, to: &Tensor<2>, nearest: &[Near]| {
        let apart = from.clone() - take_rows(to, nearest.iter().map(|n| n.row));
        (apart.clone() * apart).sum() * (nearest.len() as f64).recip()
    };
    Ok(mean(&a, &b, &from_a) + mean(&b, &a, &from_b))
}

/// The F-score of two point clouds `[N, 3]` and `[M, 3]` at a threshold in scene units, computed on the host.
///
/// It is the harmonic mean of two shares: for each cloud, the share of its points that lie within the threshold
/// of a point of the other cloud (Knapitsch et al. 2017, *Tanks and Temples*). It ranges from 0 to 1; a larger
/// value means closer clouds.
///
/// ```
/// use softray::loss;
/// use softray::prelude::*;
/// let cloud = |points| Tensor::<2>::from_floats(points, &Device::flex());
/// let a = cloud([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]);
/// let b = cloud([[0.0, 0.1, 0.0], [9.0, 0.0, 0.0]]);
/// assert_eq!(loss::f_score(&a, &b, 0.2)?, 0.5);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// Like [`chamfer`], or if the threshold is negative or NaN.
pub fn f_score(a: &Tensor<2>, b: &Tensor<2>, threshold: f64) -> Result<f64> {
    let expected = "a number of at least 0";
    Error::unless(
        threshold >= 0.0,
        "f_score",
        "threshold",
        threshold,
        expected,
    )?;
    let share = |nearest: &Vec<Near>| {
        let close = |n: &&Near| n.square.sqrt() <= threshold;
        nearest.iter().filter(close).count() as f64 / nearest.len() as f64
    };
    let [precision, recall] = nearest(a, b)?.each_ref().map(share);
    Ok(if precision + recall > 0.0 {
        2.0 * precision * recall / (precision + recall)
    } else {
        0.0
    })
}

/// Returns the nearest point of `b` to each point of `a`, and the nearest point of `a` to each point of `b`.
fn nearest(a: &Tensor<2>, b: &Tensor<2>) -> Result<[Vec<Near>; 2]> {
    const B: &str = "points b";
    let (device, other) = (a.device().inner(), b.device().inner());
    let expected = format!("{device:?} like points a");
    Error::unless(
        other == device,
        B,
        "device",
        format!("{other:?}"),
        &expected,
    )?;
    let (found, expected) = (
        format!("{:?}", b.dtype()),
        format!("{:?} like points a", a.dtype()),
    );
    Error::unless(a.dtype() == b.dtype(), B, "dtype", found, &expected)?;
    let (on_a, on_b) = (points("points a", a)?, points(B, b)?);
    let from_a = PointTree::new(&on_b).nearest_to(&on_a);
    let from_b = PointTree::new(&on_a).nearest_to(&on_b);
    Ok([from_a, from_b])
}

/// Reads the points of a cloud back to the host.
fn points(name: &str, tensor: &Tensor<2>) -> Result<Vec<DVec3>> {
    let [count, axes] = tensor.dims();
    let expected = "[N, 3] with at least one point";
    let found = format!("[{count}, {axes}]");
    Error::unless(count > 0 && axes == 3, name, "shape", found, expected)?;
    let values = host_values(tensor)?;
    let points: Vec<DVec3> = values.chunks_exact(3).map(DVec3::from_slice).collect();
    if let Some(i) = points.iter().position(|p| !p.is_finite()) {
        let (row, found) = (format!("row {i}"), format!("{:?}", points[i].to_array()));
        return Err(Error::invalid(name, row, found, "finite numbers"));
    }
    Ok(points)
}
