//! Bodies for tests.

use glam::DVec3;

use super::lattice::Lattice;
use super::mesh::TriangleMesh;

/// The surface of a field in the cube from −1.6 to 1.6, with `cells` cells along it.
pub(super) fn body(cells: u32, field: impl Fn(DVec3) -> f64 + Sync) -> TriangleMesh {
    let lattice = Lattice {
        corner: DVec3::splat(-1.6),
        step: 3.2 / f64::from(cells),
        cells,
    };
    lattice.surface(2.0, field)
}

/// A ball of the radius 1.
pub(super) fn ball(cells: u32) -> TriangleMesh {
    body(cells, |p| 1.0 - p.length())
}

/// The signed distance to a torus about z with the radius 1, positive inside.
pub(super) fn torus_field(p: DVec3, tube: f64) -> f64 {
    tube - (p.truncate().length() - 1.0).hypot(p.z)
}

/// A torus about z with the radius 1.
pub(super) fn torus(cells: u32, tube: f64) -> TriangleMesh {
    body(cells, |p| torus_field(p, tube))
}

/// Moves all vertices by random offsets of up to a length.
pub(super) fn roughened(mesh: &TriangleMesh, size: f64) -> TriangleMesh {
    let mut seed = 1u32;
    let mut random = || {
        seed = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        2.0 * f64::from(seed >> 8) / f64::from(1 << 24) - 1.0
    };
    let mut rough = mesh.clone();
    for x in rough.positions.iter_mut().flatten() {
        *x += size * random();
    }
    rough
}
