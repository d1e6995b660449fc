//! Triangle meshes as lists.

use glam::DVec3;

use crate::error::{Error, Result};

/// The largest absolute coordinate: products of a few lengths stay finite.
const LARGEST: f64 = 1e30;

/// A triangle mesh on the host: a list of positions, and faces as triples of their indices. The front of a face is
/// where its corners are in counterclockwise order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// The positions of the vertices, in scene units.
    pub positions: Vec<[f64; 3]>,
    /// The vertices of each face, as indices into `positions`.
    pub faces: Vec<[u32; 3]>,
}

/// A point of a mesh's surface: a face, and the barycentric coordinates in it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfacePoint {
    /// The index of the face.
    pub face: u32,
    /// The weights of the face's three corners, which add up to 1.
    pub barycentric: [f64; 3],
}

impl SurfacePoint {
    /// Interpolates values of vertices, such as colors or texture coordinates.
    ///
    /// # Panics
    /// If the face is not one of `faces`, or if one of its vertices has no value.
    pub fn interpolate<const N: usize>(&self, faces: &[[u32; 3]], values: &[[f64; N]]) -> [f64; N] {
        let corners = faces[self.face as usize].map(|v| values[v as usize]);
        std::array::from_fn(|i| (0..3).map(|c| self.barycentric[c] * corners[c][i]).sum())
    }
}

impl TriangleMesh {
    /// Creates a mesh and checks it.
    ///
    /// # Errors
    /// [`Error::Invalid`] as [`check`](Self::check) returns it.
    pub fn new(positions: Vec<[f64; 3]>, faces: Vec<[u32; 3]>) -> Result<Self> {
        let mesh = Self { positions, faces };
        mesh.check()?;
        Ok(mesh)
    }

    /// Checks that all positions are finite, that faces contain indices of vertices, and that no face has the same
    /// vertex twice.
    ///
    /// # Errors
    /// [`Error::Invalid`] with the first vertex or face that is not valid.
    pub fn check(&self) -> Result<()> {
        self.check_indices()?;
        let twice = |f: &[u32; 3]| f[0] == f[1] || f[1] == f[2] || f[2] == f[0];
        if let Some(k) = self.faces.iter().position(twice) {
            let (field, value) = (format!("faces[{k}]"), format!("{:?}", self.faces[k]));
            return Err(Error::invalid(
                "mesh",
                field,
                value,
                "three different vertices",
            ));
        }
        Ok(())
    }

    /// [`check`](Self::check), except that faces may have the same vertex twice.
    pub(super) fn check_indices(&self) -> Result<()> {
        let bad = |p: &[f64; 3]| !p.iter().all(|x| x.abs() <= LARGEST);
        if let Some(v) = self.positions.iter().position(bad) {
            let (field, value) = (
                format!("positions[{v}]"),
                format!("{:?}", self.positions[v]),
            );
            let expected = format!("finite coordinates of at most {LARGEST:e}");
            return Err(Error::invalid("mesh", field, value, expected));
        }
        let count = self.positions.len();
        let outside = |f: &[u32; 3]| f.iter().any(|&v| v as usize >= count);
        if let Some(k) = self.faces.iter().position(outside) {
            let (field, value) = (format!("faces[{k}]"), format!("{:?}", self.faces[k]));
            let expected = format!("indices below the number of vertices, {count}");
            return Err(Error::invalid("mesh", field, value, expected));
        }
        Ok(())
    }

    /// The enclosed volume of a closed mesh, in cubic scene units: negative if its faces point inwards.
    pub fn volume(&self) -> f64 {
        let origin = self.faces.first().map_or(DVec3::ZERO, |f| self.at(f[0]));
        let faces = 0..self.faces.len() as u32;
        let six = |k| {
            let [a, b, c] = self.corners(k).map(|p| p - origin);
            a.dot(b.cross(c))
        };
        faces.map(six).sum::<f64>() / 6.0
    }

    /// The area of all faces, in square scene units.
    pub fn area(&self) -> f64 {
        let faces = 0..self.faces.len() as u32;
        faces.map(|k| self.area_vector(k).length()).sum()
    }

    /// The edge length with which [`remesh`](super::remesh()) makes about this many faces.
    pub fn edge_length_for(&self, faces: usize) -> f64 {
        (4.0 * self.area() / (3f64.sqrt() * faces.max(1) as f64)).sqrt()
    }

    pub(super) fn at(&self, vertex: u32) -> DVec3 {
        self.positions[vertex as usize].into()
    }

    pub(crate) fn corners(&self, face: u32) -> [DVec3; 3] {
        self.faces[face as usize].map(|v| self.at(v))
    }

    /// The normal of a face, times its area.
    pub(super) fn area_vector(&self, face: u32) -> DVec3 {
        let [a, b, c] = self.corners(face);
        (b - a).cross(c - a) / 2.0
    }

    /// The unit normal of each vertex, the mean of its faces' normals weighted by area; zero where they cancel.
    pub(super) fn vertex_normals(&self) -> Vec<DVec3> {
        let mut normals = vec![DVec3::ZERO; self.positions.len()];
        for (k, f) in self.faces.iter().enumerate() {
            let normal = self.area_vector(k as u32);
            f.iter().for_each(|&v| normals[v as usize] += normal);
        }
        normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
        normals
    }

    /// Removes vertices that no face has.
    pub(super) fn compacted(&self) -> Self {
        let mut place = vec![u32::MAX; self.positions.len()];
        let mut positions = Vec::new();
        let mut faces = self.faces.clone();
        for v in faces.iter_mut().flatten() {
            let at = &mut place[*v as usize];
            if *at == u32::MAX {
                *at = positions.len() as u32;
                positions.push(self.positions[*v as usize]);
            }
            *v = *at;
        }
        Self { positions, faces }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_lists_are_errors() {
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let fails = |positions: &[[f64; 3]], face: [u32; 3]| {
            let made = TriangleMesh::new(positions.to_vec(), vec![face]);
            made.expect_err("an error").to_string()
        };
        assert!(TriangleMesh::new(positions.clone(), vec![[0, 1, 2]]).is_ok());
        let error = fails(&positions, [0, 1, 3]);
        assert!(
            error.contains("faces[0]") && error.contains("vertices, 3"),
            "{error}"
        );
        let error = fails(&positions, [0, 1, 1]);
        assert!(error.contains("three different"), "{error}");
        let mut bad = positions.clone();
        bad[1][2] = f64::NAN;
        let error = fails(&bad, [0, 1, 2]);
        assert!(
            error.contains("positions[1]") && error.contains("NaN"),
            "{error}"
        );
    }

    #[test]
    fn values_are_interpolated() {
        let point = SurfacePoint {
            face: 1,
            barycentric: [0.5, 0.25, 0.25],
        };
        let values = [[0.0], [4.0], [8.0], [16.0]];
        assert_eq!(
            point.interpolate(&[[0, 1, 2], [1, 2, 3]], &values),
            [2.0 + 2.0 + 4.0]
        );
    }
}
