//! Nearest points of a surface, and distances to it.

use glam::DVec3;
use rayon::prelude::*;

use super::bvh::Bvh;
use super::mesh::{SurfacePoint, TriangleMesh};
use super::winding::Winding;
use crate::error::{Error, Result};

/// For each point, the nearest point of a mesh's surface: carries values of vertices over to another mesh, by
/// [`SurfacePoint::interpolate`].
///
/// # Errors
/// [`Error::Invalid`] if the mesh is not valid, has no face, or if a point is not finite.
pub fn closest_points(mesh: &TriangleMesh, points: &[[f64; 3]]) -> Result<Vec<SurfacePoint>> {
    let bvh = tree(mesh)?;
    let nearest = |(i, p): (usize, &[f64; 3])| {
        let found = bvh.nearest((*p).into(), f64::INFINITY, |_| true);
        found.map(|near| near.on).ok_or_else(|| {
            let (field, value) = (format!("points[{i}]"), format!("{p:?}"));
            Error::invalid("closest_points", field, value, "finite coordinates")
        })
    };
    points.par_iter().enumerate().map(nearest).collect()
}

/// For each point, its distance from a closed mesh's surface in scene units, negative inside (where the generalized winding
/// number of Barill et al. 2018 is above 1/2). A point without finite coordinates has the distance ∞.
///
/// ```
/// use softray::meshing::{TriangleMesh, signed_distances};
/// use softray::prelude::*;
/// let cube = TriangleMesh::try_from(&shapes::cube(&Device::flex()))?;
/// let found = signed_distances(&cube, &[[0.0; 3], [3.0, 0.0, 0.0]])?;
/// assert!((found[0] + 1.0).abs() < 1e-6 && (found[1] - 2.0).abs() < 1e-6);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// [`Error::Invalid`] if the mesh is not valid or has no face.
pub fn signed_distances(mesh: &TriangleMesh, points: &[[f64; 3]]) -> Result<Vec<f64>> {
    let bvh = tree(mesh)?;
    let winding = Winding::new(&bvh);
    let distance = |&p: &[f64; 3]| {
        let point = DVec3::from(p);
        let found = bvh.nearest(point, f64::INFINITY, |_| true);
        let distance = found.map_or(f64::INFINITY, |near| {
            point.distance(near.on.interpolate(&mesh.faces, &mesh.positions).into())
        });
        let inside = distance.is_finite() && winding.about(point) > 0.5;
        if inside { -distance } else { distance }
    };
    Ok(points.par_iter().map(distance).collect())
}

/// The intersection over union of the bodies in two closed meshes, from 0 to 1: of the points of a lattice with `resolution`
/// points along the longest side of their common box, the share of those in either that are in both. It is 0 if there
/// are none.
///
/// ```
/// use softray::meshing::{TriangleMesh, volume_iou};
/// use softray::prelude::*;
/// let cube = TriangleMesh::try_from(&shapes::cube(&Device::flex()))?;
/// let mut half = cube.clone();
/// half.positions.iter_mut().for_each(|p| p[0] = p[0].min(0.0));
/// assert!((volume_iou(&cube, &half, 32)? - 0.5).abs() < 0.02);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// [`Error::Invalid`] if a mesh is not valid or has no face, or if `resolution` is 0 or above 1024.
pub fn volume_iou(a: &TriangleMesh, b: &TriangleMesh, resolution: usize) -> Result<f64> {
    let valid = (1..=1024).contains(&resolution);
    Error::unless(valid, "volume_iou", "resolution", resolution, "1 to 1024")?;
    let [first, second] = [tree(a)?, tree(b)?];
    let bodies = [Winding::new(&first), Winding::new(&second)];
    let all = || a.positions.iter().chain(&b.positions);
    let min = all().fold(DVec3::INFINITY, |min, &p| min.min(p.into()));
    let max = all().fold(DVec3::NEG_INFINITY, |max, &p| max.max(p.into()));
    let step = (max - min).max_element() / resolution as f64;
    let count = ((max - min) / step).ceil().max(DVec3::ONE);
    let [x, y, z] = count.to_array().map(|n| n as usize);
    let within = |i: usize| {
        let at = DVec3::new((i % x) as f64, (i / x % y) as f64, (i / x / y) as f64);
        let point = min + (at + 0.5) * step;
        let [p, q] = [&bodies[0], &bodies[1]].map(|body| body.about(point) > 0.5);
        [usize::from(p && q), usize::from(p || q)]
    };
    let sum = |a: [usize; 2], b: [usize; 2]| [a[0] + b[0], a[1] + b[1]];
    let found = (0..x * y * z).into_par_iter().map(within);
    let [both, either] = found.reduce(|| [0; 2], sum);
    Ok(both as f64 / either.max(1) as f64)
}

/// The tree over the faces of a valid mesh that has some.
fn tree(mesh: &TriangleMesh) -> Result<Bvh> {
    mesh.check()?;
    let some = !mesh.faces.is_empty();
    Error::unless(some, "mesh", "faces", "empty", "at least one face")?;
    Ok(Bvh::new(mesh))
}

#[cfg(test)]
mod tests {
    use super::super::samples::ball;
    use super::*;

    #[test]
    fn distances_and_volumes_of_balls() {
        let (one, mut two) = (ball(48), ball(48));
        let radius = DVec3::from(one.positions[0]).length();
        let points = [[0.3, 0.2, -0.1], [0.0, 2.5, 1.0], [f64::NAN; 3]];
        let found = signed_distances(&one, &points).expect("distances");
        for (distance, point) in found.iter().zip(points).take(2) {
            let expected = DVec3::from(point).length() - radius;
            assert!((distance - expected).abs() < 0.01, "{distance}, {expected}");
        }
        assert!(found[2] == f64::INFINITY);
        two.positions
            .iter_mut()
            .for_each(|p| *p = p.map(|x| 0.8 * x));
        let found = volume_iou(&one, &two, 64).expect("a share");
        assert!((found - 0.512).abs() < 0.01, "{found}");
        assert!(volume_iou(&one, &two, 0).is_err());
    }

    #[test]
    fn values_are_carried_over() {
        let (coarse, fine) = (ball(16), ball(32));
        let found = closest_points(&fine, &coarse.positions).expect("points");
        for (point, p) in found.iter().zip(&coarse.positions) {
            let on = point.interpolate(&fine.faces, &fine.positions);
            assert!((0..3).all(|i| (on[i] - p[i]).abs() < 0.03));
        }
        let error = closest_points(&fine, &[[0.0, f64::NAN, 0.0]]).expect_err("an error");
        assert!(error.to_string().contains("points[0]"), "{error}");
    }
}
