//! Meshes between the levels of a fit.

use super::mesh::TriangleMesh;
use super::remesh::{RemeshOptions, remesh};
use super::repair::{RepairOptions, repair};
use crate::error::Result;

/// Makes a mesh that a fit has moved even and sound again: it is repaired, remeshed to edges of about `edge` scene units,
/// and repaired where that has made faces cross.
///
/// # Errors
/// As [`repair`] and [`remesh`] return them.
pub fn renew(mesh: &TriangleMesh, edge: f64) -> Result<TriangleMesh> {
    let sound = RepairOptions::default().with_edge_length(edge);
    let even = remesh(&repair(mesh, &sound)?.mesh, &RemeshOptions::uniform(edge))?;
    Ok(repair(&even.mesh, &sound)?.mesh)
}
