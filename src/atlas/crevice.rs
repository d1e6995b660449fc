//! Crevices of charts that are narrower than the texels of a lookup.

use glam::{DVec2, DVec3};

/// The smallest distance in texture space of two points that are apart on the surface, in texels: the diagonals of two
/// texels, one for the reach of a lookup, one for the texel's nearest face.
const NEAR: f64 = 2.5;
/// Points are apart if their distance in space is larger, in texels.
const APART: f64 = 3.5;

/// A point of a chart's border.
struct Sample {
    /// Its cell in texture space.
    cell: [i32; 2],
    /// Its cell in space.
    place: [i32; 3],
    flat: DVec2,
    point: DVec3,
    face: u32,
}

/// Finds two faces at the border of a chart that are near in texture space but not on the surface, for a side of `texel` of
/// the texels: a lookup at one could read a texel of the other. Returns their indices in `faces`.
///
/// `flat` and `points` have the vertices in texture space and in space.
pub(super) fn crevice(
    faces: &[[u32; 3]],
    flat: &[DVec2],
    points: &[DVec3],
    texel: f64,
) -> Option<[usize; 2]> {
    let mut samples = Vec::new();
    for (face, i) in border_edges(faces) {
        let ends = [faces[face][i], faces[face][(i + 1) % 3]].map(|v| v as usize);
        let length = flat[ends[0]].distance(flat[ends[1]]);
        let count = (2.0 * length / texel).ceil().clamp(1.0, 1e5) as u32;
        for k in 0..count {
            let t = (f64::from(k) + 0.5) / f64::from(count);
            let at = flat[ends[0]].lerp(flat[ends[1]], t);
            let point = points[ends[0]].lerp(points[ends[1]], t);
            let (cell, place) = ((at / (NEAR * texel)).floor(), (point / texel).floor());
            samples.push(Sample {
                cell: [cell.x as i32, cell.y as i32],
                place: [place.x as i32, place.y as i32, place.z as i32],
                flat: at,
                point,
                face: face as u32,
            });
        }
    }
    samples.sort_unstable_by_key(|s| (s.cell, s.place, s.face));
    samples.dedup_by_key(|s| (s.cell, s.place));
    for s in &samples {
        for (dx, dy) in [(0, 0), (0, 1), (1, -1), (1, 0), (1, 1)] {
            let cell = [s.cell[0].saturating_add(dx), s.cell[1].saturating_add(dy)];
            let first = samples.partition_point(|other| other.cell < cell);
            let near = samples[first..].iter().take_while(|o| o.cell == cell);
            let mut wrong = near.filter(|o| {
                o.face != s.face
                    && o.flat.distance(s.flat) < NEAR * texel
                    && o.point.distance(s.point) > APART * texel
            });
            if let Some(other) = wrong.next() {
                return Some([s.face as usize, other.face as usize]);
            }
        }
    }
    None
}

/// The edges with a face on one side only, as a face and the number of its edge.
fn border_edges(faces: &[[u32; 3]]) -> Vec<(usize, usize)> {
    let mut edges: Vec<(u32, u32, usize)> = Vec::with_capacity(3 * faces.len());
    for (f, face) in faces.iter().enumerate() {
        for i in 0..3 {
            let (a, b) = (face[i], face[(i + 1) % 3]);
            edges.push((a.min(b), a.max(b), 3 * f + i));
        }
    }
    edges.sort_unstable();
    let single = edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1));
    let single = single.filter(|group| group.len() == 1);
    single.map(|g| (g[0].2 / 3, g[0].2 % 3)).collect()
}
