//! Edges between charts.

use glam::DVec2;

use super::surface::{NONE, Surface};

/// The edges whose faces have different texture coordinates: the two ends for one face, then for the other.
pub(super) fn seams(surface: &Surface, faces: &[[u32; 3]]) -> Vec<[[u32; 2]; 2]> {
    let mut seams = Vec::new();
    for (f, across) in surface.across.iter().enumerate() {
        for (i, &g) in across.iter().enumerate() {
            if g == NONE || g < f as u32 {
                continue;
            }
            let g = g as usize;
            let start = surface.corners[f][i];
            // The other face has the edge from its end to its start.
            let opposite = (0..3).find(|&j| {
                surface.across[g][j] == f as u32 && surface.corners[g][(j + 1) % 3] == start
            });
            let Some(j) = opposite else {
                continue;
            };
            let own = [faces[f][i], faces[f][(i + 1) % 3]];
            let other = [faces[g][(j + 1) % 3], faces[g][j]];
            if own != other {
                seams.push([own, other]);
            }
        }
    }
    seams
}

/// Points at equal distances of about one texel along the edges, on both of their sides.
pub(super) fn pairs(
    seams: &[[[u32; 2]; 2]],
    uvs: &[[f64; 2]],
    size: usize,
) -> Vec<([f64; 2], [f64; 2])> {
    let mut pairs = Vec::new();
    for sides in seams {
        let [own, other] = sides.map(|ends| ends.map(|v| DVec2::from(uvs[v as usize])));
        let length = own[0].distance(own[1]).max(other[0].distance(other[1]));
        let count = (length * size as f64).ceil().max(1.0) as usize;
        for k in 0..count {
            let t = (k as f64 + 0.5) / count as f64;
            let at = |ends: [DVec2; 2]| ends[0].lerp(ends[1], t).to_array();
            pairs.push((at(own), at(other)));
        }
    }
    pairs
}
