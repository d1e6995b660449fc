//! Pairs of faces that pass through each other.

use glam::DVec3;
use rayon::prelude::*;

use super::bvh::Bvh;
use super::mesh::TriangleMesh;

/// Six times the volume of a tetrahedron: positive if `d` is in front of the triangle `a`, `b`, `c`.
fn volume(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> f64 {
    (b - a).cross(c - a).dot(d - a)
}

/// Returns whether a segment passes from one side of a triangle to the other through the triangle. Within the rounding of
/// coordinates, its ends count as on the triangle's plane.
fn passes([p, q]: [DVec3; 2], [a, b, c]: [DVec3; 3]) -> bool {
    let (above, below) = (volume(a, b, c, p), volume(a, b, c, q));
    let (low, high) = (above.min(below), above.max(below));
    if low >= 0.0 || high <= 0.0 {
        return false;
    }
    let largest = p.abs().max(q.abs()).max(a.abs()).max(b.abs()).max(c.abs());
    let size = largest.max_element();
    let rounding = 16.0 * f64::EPSILON * size * b.distance(a) * c.distance(a);
    if low >= -rounding || high <= rounding {
        return false;
    }
    let sides = [volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)];
    sides.iter().all(|&s| s >= 0.0) || sides.iter().all(|&s| s <= 0.0)
}

/// Returns whether two faces pass through each other. Faces that touch don't, and faces that share an edge don't.
pub(super) fn cross(mesh: &TriangleMesh, [k, l]: [u32; 2]) -> bool {
    let (f, g) = (mesh.faces[k as usize], mesh.faces[l as usize]);
    let (t, s) = (mesh.corners(k), mesh.corners(l));
    let shared = |f: &[u32; 3], g: &[u32; 3]| (0..3).find(|&i| g.contains(&f[i]));
    match f.iter().filter(|v| g.contains(v)).count() {
        0 => (0..3).any(|i| passes([t[i], t[(i + 1) % 3]], s) || passes([s[i], s[(i + 1) % 3]], t)),
        1 => {
            let opposite = |c: [DVec3; 3], i: usize| [c[(i + 1) % 3], c[(i + 2) % 3]];
            shared(&f, &g).is_some_and(|i| passes(opposite(t, i), s))
                || shared(&g, &f).is_some_and(|i| passes(opposite(s, i), t))
        }
        2 => false,
        _ => true,
    }
}

/// The most crossings of a face with later faces that are listed, so that many copies of a face don't fill the memory.
const MOST: usize = 64;

/// The pairs of faces that pass through each other, the smaller index first, in order; at most 64 for each smaller index.
pub(super) fn crossing_pairs(mesh: &TriangleMesh) -> Vec<[u32; 2]> {
    let bvh = Bvh::new(mesh);
    let of_face = |k: u32| {
        let [a, b, c] = mesh.corners(k);
        let mut found = Vec::new();
        bvh.overlapping(a.min(b).min(c), a.max(b).max(c), |l| {
            if l > k && found.len() < MOST && cross(mesh, [k, l]) {
                found.push([k, l]);
            }
        });
        found.sort_unstable();
        found
    };
    let faces = (0..mesh.faces.len() as u32).into_par_iter();
    faces.flat_map_iter(of_face).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn crossing(positions: &[[f64; 3]], faces: &[[u32; 3]]) -> usize {
        let mesh = TriangleMesh {
            positions: positions.to_vec(),
            faces: faces.to_vec(),
        };
        crossing_pairs(&mesh).len()
    }

    #[test]
    fn crossings_are_told_from_contact() {
        let flat = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let with = |more: [[f64; 3]; 3]| [&flat[..], &more[..]].concat();
        let faces = [[0, 1, 2], [3, 4, 5]];
        let through = [[0.2, 0.2, -1.0], [0.2, 0.2, 1.0], [5.0, 5.0, 1.0]];
        assert_eq!(crossing(&with(through), &faces), 1);
        let beside = through.map(|[x, y, z]| [x + 2.0, y, z]);
        assert_eq!(crossing(&with(beside), &faces), 0);
        let touching = [[0.2, 0.2, 0.0], [0.2, 0.2, 1.0], [5.0, 5.0, 1.0]];
        assert_eq!(crossing(&with(touching), &faces), 0);
        // A common vertex, and the side opposite to it passes through the other face.
        let near = with([[0.6, 0.2, -1.0], [0.6, 0.2, 1.0], [0.0; 3]]);
        assert_eq!(crossing(&near, &[[0, 1, 2], [0, 3, 4]]), 1);
        let away = with([[-0.6, 0.2, -1.0], [-0.6, 0.2, 1.0], [0.0; 3]]);
        assert_eq!(crossing(&away, &[[0, 1, 2], [0, 3, 4]]), 0);
    }
}
