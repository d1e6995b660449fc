//! Nearest points of a surface.

use rayon::prelude::*;

use super::bvh::Bvh;
use super::mesh::{SurfacePoint, TriangleMesh};
use crate::error::{Error, Result};

/// For each point, the nearest point of a mesh's surface: carries values of vertices over to another mesh, by
/// [`SurfacePoint::interpolate`].
///
/// # Errors
/// [`Error::Invalid`] if the mesh is not valid, has no face, or if a point is not finite.
pub fn closest_points(mesh: &TriangleMesh, points: &[[f64; 3]]) -> Result<Vec<SurfacePoint>> {
    mesh.check()?;
    Error::unless(
        !mesh.faces.is_empty(),
        "mesh",
        "faces",
        "empty",
        "at least one face",
    )?;
    let bvh = Bvh::new(mesh);
    let nearest = |(i, p): (usize, &[f64; 3])| {
        let found = bvh.nearest((*p).into(), f64::INFINITY, |_| true);
        found.map(|near| near.on).ok_or_else(|| {
            let (field, value) = (format!("points[{i}]"), format!("{p:?}"));
            Error::invalid("closest_points", field, value, "finite coordinates")
        })
    };
    points.par_iter().enumerate().map(nearest).collect()
}

#[cfg(test)]
mod tests {
    use super::super::samples::ball;
    use super::*;

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
