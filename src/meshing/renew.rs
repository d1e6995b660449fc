//! Meshes between the levels of a fit.

use super::mesh::TriangleMesh;
use super::remesh::{RemeshOptions, remesh};
use super::repair::{RepairOptions, repair};
use super::smooth::{SmoothOptions, smooth};
use super::statistics::{edge_lengths, median};
use crate::error::Result;

/// From this ratio of the old edges to the new ones on, a mesh becomes finer.
const FINER: f64 = 1.4;

/// Makes a mesh that a fit has moved even and sound again: it is repaired, remeshed to edges of about `edge` scene units,
/// and repaired where that has made faces cross. Where edges become shorter, the old faces would show as facets, so these are
/// smoothed away.
///
/// # Errors
/// As [`repair`], [`remesh`] and [`smooth`] return them.
pub fn renew(mesh: &TriangleMesh, edge: f64) -> Result<TriangleMesh> {
    let sound = RepairOptions::default().with_edge_length(edge);
    let old = repair(mesh, &sound)?.mesh;
    let mut even = remesh(&old, &RemeshOptions::uniform(edge))?.mesh;
    let longer = median(&edge_lengths(&old)) / edge;
    if longer > FINER {
        // Taubin's filter has the width √steps edges.
        let steps = (2.5 * longer * longer).round() as usize;
        even = smooth(&even, &SmoothOptions::default().with_steps(steps))?;
    }
    Ok(repair(&even, &sound)?.mesh)
}
