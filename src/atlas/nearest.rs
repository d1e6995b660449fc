//! The nearest points of triangles.

use glam::DVec3;

use super::surface::check;
use crate::error::{Error, Result};
use crate::meshing::{Bvh, TriangleMesh};

/// The point of a mesh that is nearest to another point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// The face.
    pub face: u32,
    /// The barycentric coordinates of the point on the face.
    pub barycentric: [f64; 3],
    /// The distance.
    pub distance: f64,
}

/// Finds the nearest points of a mesh, in a hierarchy of bounding boxes over its triangles.
///
/// ```
/// use softray::atlas::NearestFaces;
/// let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let faces = NearestFaces::new(&positions, &[[0, 1, 2]])?;
/// let nearest = faces.nearest([0.25, 0.25, 2.0]);
/// assert_eq!((nearest.face, nearest.distance), (0, 2.0));
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct NearestFaces {
    tree: Bvh,
    /// Of the faces, of any length.
    normals: Vec<DVec3>,
}

impl NearestFaces {
    /// Builds the hierarchy.
    ///
    /// # Errors
    /// If there is no face, a position is not finite, or an index is out of range.
    pub fn new(positions: &[[f64; 3]], faces: &[[u32; 3]]) -> Result<Self> {
        check(positions, faces)?;
        Error::unless(!faces.is_empty(), "mesh", "faces", 0, "at least one")?;
        let mesh = TriangleMesh {
            positions: positions.to_vec(),
            faces: faces.to_vec(),
        };
        let normal = |face: u32| {
            let [a, b, c] = mesh.corners(face);
            (b - a).cross(c - a)
        };
        Ok(Self {
            tree: Bvh::new(&mesh),
            normals: (0..faces.len() as u32).map(normal).collect(),
        })
    }

    /// The point of the mesh nearest to `point`. If that is not finite, any point with an infinite distance.
    pub fn nearest(&self, point: [f64; 3]) -> Nearest {
        self.search(point, |_| true).unwrap_or(Nearest {
            face: 0,
            barycentric: [1.0, 0.0, 0.0],
            distance: f64::INFINITY,
        })
    }

    /// The point nearest to `point` among faces whose normals are within 90° of `normal`, so that a point of one side
    /// of a thin wall finds none on the other. Among all faces if no face is.
    pub fn nearest_facing(&self, point: [f64; 3], normal: [f64; 3]) -> Nearest {
        let normal = DVec3::from(normal);
        let facing = |face: u32| self.normals[face as usize].dot(normal) > 0.0;
        let found = self.search(point, facing);
        found.unwrap_or_else(|| self.nearest(point))
    }

    fn search(&self, point: [f64; 3], accept: impl Fn(u32) -> bool) -> Option<Nearest> {
        let found = self.tree.nearest(point.into(), f64::INFINITY, accept)?;
        Some(Nearest {
            face: found.on.face,
            barycentric: found.on.barycentric,
            distance: found.squared_distance.sqrt(),
        })
    }
}
