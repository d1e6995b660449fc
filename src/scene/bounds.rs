//! Bounding boxes of meshes and scenes.

use super::parameter::Range;
use super::{Mesh, Scene};
use crate::error::{Error, Result};
use softray_kernels::host::Bounds;

impl Mesh {
    /// Computes the bounding box of the mesh's faces, on the host. Vertices that no face uses are ignored.
    ///
    /// # Errors
    /// If the mesh has no face, a face has an index out of range, the vertices are not `[V, 3]` or not finite, they
    /// can't be read from their device, or the mesh was built with a mistake (e.g. scaled by NaN).
    pub fn bounds(&self) -> Result<Bounds> {
        self.bounds_as("mesh")?.ok_or_else(|| {
            let expected = "at least one face, which bounds are around";
            Error::invalid("mesh", "faces", "empty", expected)
        })
    }

    /// Returns the bounding box of the mesh, or None if it has no faces. Error messages use the name `name`.
    fn bounds_as(&self, name: &str) -> Result<Option<Bounds>> {
        let vertices = self.checked_vertices(name)?;
        let corners = self.faces.iter().flatten().map(|&v| vertices[v as usize]);
        Ok(Bounds::of_points(corners))
    }
}

impl Scene {
    /// Computes the bounding box of all objects, emitters included, on the host.
    ///
    /// A moving object is included at the start and at the end of the shutter. Large objects are included as well: a
    /// ground plane of 1000 units makes the box that wide. For the box of a few objects, combine their [`Mesh::bounds`]
    /// by [`Bounds::union`].
    ///
    /// ```
    /// use softray::prelude::*;
    /// let device = Device::flex();
    /// let scene = Scene::new()
    ///     .with_object(Object::new(shapes::cube(&device)))
    ///     .with_object(Object::new(shapes::cube(&device)).with_velocity([0.0, 4.0, 0.0]));
    /// let bounds = scene.bounds()?;
    /// assert_eq!((bounds.min, bounds.max), ([-1.0; 3], [1.0, 5.0, 1.0]));
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the scene has no triangle, a mesh has an error of [`Mesh::bounds`], or a velocity is not three finite
    /// numbers.
    pub fn bounds(&self) -> Result<Bounds> {
        let mut all: Option<Bounds> = None;
        for object in &self.objects {
            let Some(mut bounds) = object.mesh.bounds_as(&object.name)? else {
                continue;
            };
            if let Some(velocity) = &object.velocity {
                let offset = velocity.check(&object.name, "velocity", Range::Finite)?;
                bounds = bounds.union(&bounds.moved(offset));
            }
            all = Some(all.map_or(bounds, |all| all.union(&bounds)));
        }
        all.ok_or(Error::NoTriangles {
            path: None,
            objects: self.objects.len(),
        })
    }
}

/// Checks that a box is larger than a point in the precision of f32.
pub(super) fn check_extent(bounds: &Bounds) -> Result<()> {
    let reach = bounds.min.iter().chain(&bounds.max);
    let reach = reach.fold(0.0f64, |reach, v| reach.max(v.abs()));
    let least = f64::from(f32::MIN_POSITIVE).max(reach * f64::from(f32::EPSILON));
    let found = format!("from {:?} to {:?}", bounds.min, bounds.max);
    let expected = "triangles that are not all in one point";
    Error::unless(bounds.radius() > least, "scene", "bounds", found, expected)
}

#[cfg(test)]
mod tests {
    use super::super::{Object, shapes};
    use super::*;
    use burn::tensor::{Device, Tensor};

    #[test]
    fn a_scene_has_the_box_around_all_objects_over_the_shutter() {
        let device = Device::flex();
        // A vertex without a face is not seen.
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [9.0; 3]];
        let sheet = Mesh::from_host(&corners, vec![[0, 1, 2]], &device);
        let flat = sheet.bounds().expect("bounds");
        assert_eq!((flat.min, flat.max), ([0.0; 3], [1.0, 2.0, 0.0]));
        assert!((flat.radius() - 0.5 * 5f64.sqrt()).abs() < 1e-12);
        let tracked = Tensor::<1>::from_floats([-3.0, 0.0, 0.5], &device)
            .autodiff()
            .require_grad();
        let scene = Scene::new()
            .with_object(Object::new(sheet))
            .with_object(Object::new(Mesh::from_host(&corners, vec![], &device)))
            .with_object(Object::new(shapes::cube(&device)).with_velocity(tracked));
        let bounds = scene.bounds().expect("bounds");
        assert_eq!(
            (bounds.min, bounds.max),
            ([-4.0, -1.0, -1.0], [1.0, 2.0, 1.5])
        );
        assert_eq!(bounds.center(), [-1.5, 0.5, 0.25]);
        assert_eq!(bounds.size(), [5.0, 3.0, 2.5]);
    }

    #[test]
    fn what_has_no_bounds_is_an_error() {
        let device = Device::flex();
        let empty = Mesh::from_host(&[[0.0; 3]], vec![], &device);
        let of = |mesh: Mesh| Scene::new().with_object(Object::new(mesh).with_name("it"));
        let cases = [
            (Scene::new().bounds(), "no objects"),
            (of(empty.clone()).bounds(), "no faces"),
            (empty.bounds(), "mesh: faces is empty"),
            (
                of(Mesh::from_host(&[[0.0; 3]], vec![[0, 0, 1]], &device)).bounds(),
                "it: vertices of face 0",
            ),
            (
                of(shapes::cube(&device).scaled([1.0, f64::NAN, 1.0])).bounds(),
                "it: mesh is scaled by [1.0, NaN, 1.0]",
            ),
            (
                Mesh::from_host(&[[f64::INFINITY; 3]; 3], vec![[0, 1, 2]], &device).bounds(),
                "mesh: vertices 0 is [inf, inf, inf]",
            ),
            (
                Scene::new()
                    .with_object(Object::new(shapes::cube(&device)).with_velocity([f64::NAN; 3]))
                    .bounds(),
                "velocity is [NaN, NaN, NaN]",
            ),
        ];
        for (found, expected) in cases {
            let error = found.expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
