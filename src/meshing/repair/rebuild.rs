//! A new surface around what a mesh encloses.

use glam::DVec3;

use super::super::bvh::Bvh;
use super::super::lattice::{Lattice, MAX_CELLS};
use super::super::mesh::TriangleMesh;
use super::super::parts::bodies;
use super::super::remesh::{RemeshOptions, remesh};
use super::super::smooth::{SmoothOptions, smooth};
use super::super::winding::Winding;
use super::local::relaxed;
use crate::error::Result;

/// The size of a cell of the lattice, in edges of the new mesh.
const CELL: f64 = 0.8;

/// The rounds in which crossings that the remeshing made may be relaxed.
const ROUNDS: usize = 4;

/// Makes a mesh with a given edge length around all points about which the faces wind at least half a time, by marching
/// tetrahedra on the signed distance. It is closed, manifold and without crossings, and has no face if nothing is
/// enclosed.
pub(super) fn rebuilt(mesh: &TriangleMesh, length: f64, share: f64) -> Result<TriangleMesh> {
    let bvh = Bvh::new(mesh);
    let winding = Winding::new(&bvh);
    let Some(root) = bvh.nodes.first() else {
        return Ok(TriangleMesh::default());
    };
    let (center, size) = (
        (root.min + root.max) / 2.0,
        (root.max - root.min).max_element(),
    );
    let step = (CELL * length).max(size / f64::from(MAX_CELLS - 5));
    let cells = (size / step).ceil() as u32 + 4;
    // Not in the planes of coordinates, where models have faces.
    let shift = DVec3::new(0.37, 0.23, 0.41) * step / 10.0;
    let lattice = Lattice {
        corner: center - step * f64::from(cells) / 2.0 + shift,
        step,
        cells,
    };
    let field = |point: DVec3| {
        let near = bvh.nearest(point, f64::INFINITY, |_| true);
        let distance = near.map_or(f64::INFINITY, |near| near.squared_distance.sqrt());
        if winding.about(point) > 0.5 {
            distance
        } else {
            -distance
        }
    };
    let raw = bodies(&lattice.surface(1.0, field), share);
    if raw.faces.is_empty() {
        return Ok(raw);
    }
    // Small handles and thin parts may need more smoothing, or finer edges, before they can be remeshed.
    let length = length.max(step / CELL);
    for (steps, length) in [(2, length), (12, length), (12, 0.7 * length)] {
        let smoothed = smooth(&raw, &SmoothOptions::default().with_steps(steps))?;
        let options = RemeshOptions::uniform(length).with_passes(6);
        let mut even = remesh(&smoothed, &options)?.mesh;
        if relaxed(&mut even, ROUNDS) {
            return Ok(even);
        }
    }
    Ok(raw)
}
