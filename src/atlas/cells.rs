//! The cells of a grid that a chart with its gutter takes.

use glam::DVec2;

use super::overlap::extent;

/// The cells of a chart: for each row the ranges of columns.
#[derive(Clone)]
pub(super) struct Cells {
    /// The number of columns.
    pub width: usize,
    /// Ranges `[from, to)` of each row.
    pub rows: Vec<Vec<[u32; 2]>>,
}

impl Cells {
    /// The cells that lie within `margin` of the triangles, along each axis. Cells have a side of 1. Points are in a
    /// rectangle of `size` cells, `margin` from its sides.
    pub fn new(faces: &[[u32; 3]], points: &[DVec2], margin: f64, size: DVec2) -> Self {
        let (width, height) = (size.x as usize, size.y as usize);
        let mut rows: Vec<Vec<[u32; 2]>> = vec![Vec::new(); height];
        for face in faces {
            let t = face.map(|v| points[v as usize]);
            let low = (t.iter().fold(f64::INFINITY, |m, p| m.min(p.y)) - margin).max(0.0);
            let high = t.iter().fold(0.0f64, |m, p| m.max(p.y)) + margin;
            let end = height.min(high.ceil() as usize);
            for (row, number) in rows[..end].iter_mut().zip(0u32..).skip(low as usize) {
                let y = f64::from(number);
                if let Some([from, to]) = extent(t, y - margin, y + 1.0 + margin) {
                    let from = ((from - margin).max(0.0) as u32).min(width as u32 - 1);
                    let to = ((to + margin).ceil() as u32).min(width as u32);
                    row.push([from, to.max(from + 1)]);
                    compact(row);
                }
            }
        }
        rows.iter_mut().for_each(merge);
        Self { width, rows }
    }

    /// The number of cells.
    pub fn count(&self) -> usize {
        let of_row =
            |row: &Vec<[u32; 2]>| row.iter().map(|r| (r[1] - r[0]) as usize).sum::<usize>();
        self.rows.iter().map(of_row).sum()
    }

    /// The cells, turned by 180°.
    pub fn turned(&self) -> Self {
        let width = self.width as u32;
        let turn = |row: &Vec<[u32; 2]>| {
            let ranges = row.iter().rev();
            ranges.map(|r| [width - r[1], width - r[0]]).collect()
        };
        Self {
            width: self.width,
            rows: self.rows.iter().rev().map(turn).collect(),
        }
    }
}

/// Joins ranges when a row has many.
fn compact(row: &mut Vec<[u32; 2]>) {
    if row.len() >= 64 && row.len().is_power_of_two() {
        merge(row);
    }
}

/// Sorts the ranges of a row and joins those that touch.
fn merge(row: &mut Vec<[u32; 2]>) {
    row.sort_unstable();
    row.dedup_by(|next, last| {
        let touches = next[0] <= last[1];
        if touches {
            last[1] = last[1].max(next[1]);
        }
        touches
    });
}

/// Turns points such that their bounding box is about as small as possible: one side lies along an edge of their
/// convex hull.
pub(super) fn align(points: &mut [DVec2]) {
    let hull = hull(points);
    let mut best = (f64::INFINITY, DVec2::X);
    for i in 0..hull.len() {
        let along = (hull[(i + 1) % hull.len()] - hull[i]).normalize_or(DVec2::X);
        let size = bounds(hull.iter().map(|p| along.conjugate().rotate(*p)));
        let area = (size[1] - size[0]).element_product();
        if area < best.0 * (1.0 - 1e-9) {
            best = (area, along);
        }
    }
    let turn = best.1.conjugate();
    points.iter_mut().for_each(|p| *p = turn.rotate(*p));
    let [min, _] = bounds(points.iter().copied());
    points.iter_mut().for_each(|p| *p -= min);
}

/// The least and greatest coordinates.
pub(super) fn bounds(points: impl Iterator<Item = DVec2>) -> [DVec2; 2] {
    let start = [DVec2::INFINITY, DVec2::NEG_INFINITY];
    points.fold(start, |[min, max], p| [min.min(p), max.max(p)])
}

/// The convex hull, counterclockwise (Andrew 1979).
fn hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted = points.to_vec();
    sorted.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let half = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..]
                && (b - a).perp_dot(p - a) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut all = half(&mut sorted.iter().copied());
    all.extend(half(&mut sorted.iter().rev().copied()));
    all
}

trait Conjugate {
    fn conjugate(self) -> Self;
}

impl Conjugate for DVec2 {
    /// The opposite rotation, as a complex number.
    fn conjugate(self) -> Self {
        DVec2::new(self.x, -self.y)
    }
}
