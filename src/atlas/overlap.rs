//! Whether triangles in a plane overlap.

use glam::DVec2;

/// Twice the area by which a point may lie beyond a line, where charts have a size of about 1.
const ROUNDING: f64 = 1e-14;

/// The smallest area of a triangle in texture space, as a part of its area on the surface.
const LEAST_AREA: f64 = 0.02;

/// Twice the signed area of a triangle.
pub(super) fn twice_area([a, b, c]: [DVec2; 3]) -> f64 {
    (b - a).perp_dot(c - a)
}

/// The smallest and the largest x of the part of a triangle with y from `low` to `high`.
pub(super) fn extent(triangle: [DVec2; 3], low: f64, high: f64) -> Option<[f64; 2]> {
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    let mut add = |x: f64| range = [range[0].min(x), range[1].max(x)];
    for i in 0..3 {
        let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
        if (low..=high).contains(&a.y) {
            add(a.x);
        }
        for y in [low, high] {
            if (a.y < y) != (b.y < y) {
                let t = (y - a.y) / (b.y - a.y);
                let x = a.x + t * (b.x - a.x);
                add(x.clamp(a.x.min(b.x), a.x.max(b.x)));
            }
        }
    }
    (range[0] <= range[1]).then_some(range)
}

/// Whether the interiors of two counterclockwise triangles overlap: no edge of one has the other on its outer side.
fn cross(a: [DVec2; 3], b: [DVec2; 3]) -> bool {
    let separates = |a: [DVec2; 3], b: [DVec2; 3]| {
        (0..3).any(|i| {
            let line = [a[i], a[(i + 1) % 3]];
            b.iter()
                .all(|&p| twice_area([line[0], line[1], p]) <= ROUNDING)
        })
    };
    !separates(a, b) && !separates(b, a)
}

/// What is wrong with a chart.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Fault {
    /// These triangles are turned over, or have hardly any area.
    Turned(Vec<u32>),
    /// Triangles overlap.
    Overlaps,
    /// These two triangles are too near to each other.
    Near([usize; 2]),
}

/// Checks that the triangles of a connected chart are counterclockwise, with areas not far below `areas`, and don't
/// overlap.
///
/// If triangles are counterclockwise and surround each inner vertex once, the map is locally one to one; it is so as a
/// whole if its borders don't cross. So only triangles at borders are compared with each other.
pub(super) fn check(faces: &[[u32; 3]], areas: &[f64], points: &[DVec2]) -> Result<(), Fault> {
    let triangle = |f: usize| faces[f].map(|v| points[v as usize]);
    let turned = turned(faces, areas, points);
    if !turned.is_empty() {
        return Err(Fault::Turned(turned));
    }
    let at_border = border(faces, points.len());
    let mut around = vec![0.0; points.len()];
    for (f, face) in faces.iter().enumerate() {
        let t = triangle(f);
        for i in 0..3 {
            let (u, v) = (t[(i + 1) % 3] - t[i], t[(i + 2) % 3] - t[i]);
            around[face[i] as usize] += u.perp_dot(v).atan2(u.dot(v));
        }
    }
    let often = |(v, &sum): (usize, &f64)| !at_border[v] && sum > 1.5 * std::f64::consts::TAU;
    if around.iter().enumerate().any(often) {
        return Err(Fault::Overlaps);
    }
    let outer = |f: &usize| faces[*f].iter().any(|&v| at_border[v as usize]);
    let outer: Vec<[DVec2; 3]> = (0..faces.len()).filter(outer).map(triangle).collect();
    if any_cross(&outer) {
        return Err(Fault::Overlaps);
    }
    Ok(())
}

/// The triangles that are not counterclockwise, or whose areas are far below `areas`.
pub(super) fn turned(faces: &[[u32; 3]], areas: &[f64], points: &[DVec2]) -> Vec<u32> {
    let is_turned = |&f: &u32| {
        let area = 0.5 * twice_area(faces[f as usize].map(|v| points[v as usize]));
        area.is_nan() || area < LEAST_AREA * areas[f as usize]
    };
    (0..faces.len() as u32).filter(is_turned).collect()
}

/// Whether each vertex is at a border: an edge that has not one face on each side.
pub(super) fn border(faces: &[[u32; 3]], vertices: usize) -> Vec<bool> {
    let mut edges: Vec<(u32, u32, bool)> = Vec::with_capacity(3 * faces.len());
    for face in faces {
        for i in 0..3 {
            let (a, b) = (face[i], face[(i + 1) % 3]);
            edges.push((a.min(b), a.max(b), a < b));
        }
    }
    edges.sort_unstable();
    let mut at_border = vec![false; vertices];
    for group in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        if group.len() != 2 || group[0].2 == group[1].2 {
            at_border[group[0].0 as usize] = true;
            at_border[group[0].1 as usize] = true;
        }
    }
    at_border
}

/// Whether any two of the triangles overlap. Triangles are compared within the cells of a grid.
pub(super) fn any_cross(triangles: &[[DVec2; 3]]) -> bool {
    let all = || triangles.iter().flatten();
    let min = all().fold(DVec2::INFINITY, |m, p| m.min(*p));
    let size = all().fold(DVec2::NEG_INFINITY, |m, p| m.max(*p)) - min;
    let lengths = triangles
        .iter()
        .map(|t| t[0].distance(t[1]) + t[1].distance(t[2]));
    let mean = 0.5 * lengths.sum::<f64>() / triangles.len().max(1) as f64;
    let side = mean.max(size.max_element() / 2048.0);
    if side.is_nan() || side <= 0.0 || !side.is_finite() {
        return false;
    }
    let mut cells: Vec<(u32, u32, u32)> = Vec::new();
    for (k, t) in triangles.iter().enumerate() {
        let t = t.map(|p| (p - min) / side);
        let low = t.iter().fold(f64::INFINITY, |m, p| m.min(p.y)) as u32;
        let high = t.iter().fold(0.0f64, |m, p| m.max(p.y)) as u32;
        for row in low..=high {
            let (y, slack) = (f64::from(row), 1e-9);
            let Some([from, to]) = extent(t, y - slack, y + 1.0 + slack) else {
                continue;
            };
            for column in (from - slack).max(0.0) as u32..=(to + slack) as u32 {
                cells.push((row, column, k as u32));
            }
        }
    }
    cells.sort_unstable();
    cells.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).any(|cell| {
        cell.iter().enumerate().any(|(i, a)| {
            let rest = &cell[i + 1..];
            rest.iter()
                .any(|b| cross(triangles[a.2 as usize], triangles[b.2 as usize]))
        })
    })
}
