//! Nearest-neighbor search among points.

use glam::DVec3;
use rayon::prelude::*;

/// The largest number of points in a leaf.
const LEAF: usize = 8;

/// A k-d tree of points (Bentley 1975). Each node is split at the median point along the longest side of its
/// bounding box, so the tree is balanced for any points.
pub(crate) struct PointTree {
    /// The points, in the order of the leaves.
    points: Vec<DVec3>,
    /// The index of each point in the list passed to `new`.
    rows: Vec<u32>,
    nodes: Vec<Node>,
}

struct Node {
    min: DVec3,
    max: DVec3,
    /// The range of the node's points.
    from: usize,
    to: usize,
    /// The index of the second child, 0 in a leaf; the first child follows its parent.
    second: usize,
}

/// A point of the tree and the square of its distance.
#[derive(Clone, Copy)]
pub(crate) struct Near {
    pub row: u32,
    pub square: f64,
}

impl PointTree {
    /// Builds a tree of at least one point; all points must be finite.
    pub fn new(points: &[DVec3]) -> Self {
        let mut rows: Vec<u32> = (0..points.len() as u32).collect();
        let mut nodes = Vec::with_capacity(4 * points.len() / LEAF + 1);
        grow(points, &mut rows, 0, &mut nodes);
        Self {
            points: rows.iter().map(|&row| points[row as usize]).collect(),
            rows,
            nodes,
        }
    }

    /// Returns the nearest point of the tree to each of `others`.
    pub fn nearest_to(&self, others: &[DVec3]) -> Vec<Near> {
        others
            .par_iter()
            .with_min_len(64)
            .map(|&p| self.nearest(p))
            .collect()
    }

    fn nearest(&self, p: DVec3) -> Near {
        let mut best = Near {
            row: 0,
            square: f64::INFINITY,
        };
        self.search(0, p, &mut best);
        best
    }

    fn search(&self, at: usize, p: DVec3, best: &mut Near) {
        let node = &self.nodes[at];
        if node.second == 0 {
            for i in node.from..node.to {
                let square = self.points[i].distance_squared(p);
                if square < best.square {
                    let row = self.rows[i];
                    *best = Near { row, square };
                }
            }
            return;
        }
        let to = |child: usize| (self.nodes[child].square_to(p), child);
        let (first, second) = (to(at + 1), to(node.second));
        let ordered = if second.0 < first.0 {
            [second, first]
        } else {
            [first, second]
        };
        for (square, child) in ordered {
            if square < best.square {
                self.search(child, p, best);
            }
        }
    }
}

impl Node {
    /// Returns the square of the distance of a point from the bounding box.
    fn square_to(&self, p: DVec3) -> f64 {
        p.distance_squared(p.clamp(self.min, self.max))
    }
}

/// Adds the nodes of the points `rows`, whose first one is at place `from` in the order of the leaves.
fn grow(points: &[DVec3], rows: &mut [u32], from: usize, nodes: &mut Vec<Node>) {
    let at = nodes.len();
    let all = || rows.iter().map(|&row| points[row as usize]);
    let min = all().fold(DVec3::INFINITY, DVec3::min);
    let max = all().fold(DVec3::NEG_INFINITY, DVec3::max);
    nodes.push(Node {
        min,
        max,
        from,
        to: from + rows.len(),
        second: 0,
    });
    if rows.len() <= LEAF {
        return;
    }
    let axis = (max - min).max_position();
    let along = |row: u32| points[row as usize][axis];
    let half = rows.len() / 2;
    rows.select_nth_unstable_by(half, |&a, &b| along(a).total_cmp(&along(b)));
    let (below, above) = rows.split_at_mut(half);
    grow(points, below, from, nodes);
    nodes[at].second = nodes.len();
    grow(points, above, from + half, nodes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use softray_kernels::model::integers::mix;

    fn cloud(count: u64, seed: u64, at: impl Fn([f64; 3]) -> DVec3) -> Vec<DVec3> {
        let number = |i| (mix(seed ^ mix(i)) >> 11) as f64 / (1u64 << 53) as f64;
        (0..count)
            .map(|i| at([number(3 * i), number(3 * i + 1), number(3 * i + 2)]))
            .collect()
    }

    /// The clouds lie in space, on a plane and at a few places; one cloud is a single point.
    #[test]
    fn the_nearest_point_is_that_of_a_plain_loop() {
        let clouds = [
            cloud(700, 9, DVec3::from),
            cloud(700, 9, |[x, y, _]| DVec3::new(x, 3.0, 1e-3 * y)),
            cloud(300, 9, |u| DVec3::from(u.map(|x| (3.0 * x).floor()))),
            cloud(300, 9, |_| DVec3::ONE),
            cloud(1, 9, DVec3::from),
        ];
        let queries = cloud(200, 5, |u| DVec3::from(u) * 4.0 - 1.0);
        for points in clouds {
            let found = PointTree::new(&points).nearest_to(&queries);
            for (q, near) in queries.iter().zip(found) {
                let least = points.iter().map(|p| p.distance_squared(*q));
                let least = least.fold(f64::INFINITY, f64::min);
                assert_eq!(near.square, least);
                assert_eq!(points[near.row as usize].distance_squared(*q), least);
            }
        }
    }
}
