//! Parts of a mesh that are not connected.

use std::f64::consts::TAU;

use super::edges::components;
use super::mesh::TriangleMesh;
use super::winding::solid_angle;

/// Keeps the bodies of a closed mesh whose volume is at least `share` of the largest one's, without their cavities and
/// without what lies inside of them. With a share of 1 only the largest stays.
pub(super) fn bodies(mesh: &TriangleMesh, share: f64) -> TriangleMesh {
    let (of_face, count) = components(mesh);
    let mut volumes = vec![0.0; count];
    let mut first = vec![u32::MAX; count];
    let origin = mesh
        .faces
        .first()
        .map_or(glam::DVec3::ZERO, |f| mesh.at(f[0]));
    for (k, &part) in of_face.iter().enumerate() {
        let [a, b, c] = mesh.corners(k as u32).map(|p| p - origin);
        volumes[part as usize] += a.dot(b.cross(c)) / 6.0;
        first[part as usize] = first[part as usize].min(k as u32);
    }
    let most = volumes.iter().copied().fold(0.0, f64::max);
    let mut kept: Vec<bool> = volumes
        .iter()
        .map(|&volume| volume > 0.0 && volume >= share.min(1.0) * most)
        .collect();
    // A body in another one's cavity goes with the cavity.
    let candidates: Vec<usize> = (0..count).filter(|&part| kept[part]).collect();
    let around = |part: usize, other: usize| {
        let point = mesh.at(mesh.faces[first[part] as usize][0]);
        let faces = (0..mesh.faces.len()).filter(|&k| of_face[k] as usize == other);
        let angle = |k: usize| solid_angle(mesh.corners(k as u32).map(|p| p - point));
        faces.map(angle).sum::<f64>() > TAU
    };
    /// The most bodies whose nesting is examined, as the work grows with the square of their number.
    const MOST: usize = 64;
    if candidates.len() <= MOST {
        for &part in &candidates {
            let larger = |&&other: &&usize| volumes[other] > volumes[part];
            if candidates
                .iter()
                .filter(larger)
                .any(|&other| around(part, other))
            {
                kept[part] = false;
            }
        }
    }
    let keep = |(k, f): (usize, &[u32; 3])| kept[of_face[k] as usize].then_some(*f);
    let faces = mesh.faces.iter().enumerate().filter_map(keep).collect();
    let rest = TriangleMesh {
        positions: mesh.positions.clone(),
        faces,
    };
    rest.compacted()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::lattice::Lattice;
    use super::*;

    #[test]
    fn cavities_and_islands_go() {
        let lattice = Lattice {
            corner: DVec3::splat(-2.0),
            step: 0.1,
            cells: 40,
        };
        // A hollow ball with a small ball inside, and an island beside it.
        let mesh = lattice.surface(1.0, |p| {
            let shell = 0.2 - (p.length() - 1.0).abs();
            let inner = 0.5 - p.length();
            let island = 0.3 - p.distance(DVec3::splat(1.4));
            shell.max(inner).max(island)
        });
        let parts = |mesh: &TriangleMesh| mesh.statistics().expect("a mesh").components;
        assert_eq!(parts(&mesh), 4);
        let largest = bodies(&mesh, 1.0);
        assert_eq!(parts(&largest), 1);
        let volume = 4.0 / 3.0 * std::f64::consts::PI * 1.2f64.powi(3);
        assert!((largest.volume() / volume - 1.0).abs() < 0.02);
        assert_eq!(parts(&bodies(&mesh, 0.005)), 2);
        assert_eq!(
            bodies(&TriangleMesh::default(), 1.0),
            TriangleMesh::default()
        );
    }
}
