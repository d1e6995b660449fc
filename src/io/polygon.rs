//! Splits polygons of files into triangles.

use earcut::Earcut;
use glam::{DVec2, DVec3};

use super::LoadLimits;

/// Concave polygons with more corners share one limit, since the time of ear clipping grows with the square of the
/// number of corners.
const MAX_FREE_CORNERS: usize = 1024;

/// Triangulates the polygons of one file within a limit.
pub(super) struct Polygons {
    /// The largest number of corners of a polygon that a fan does not fill.
    most: u64,
    /// The sum of the squared numbers of corners of such polygons with more than [`MAX_FREE_CORNERS`] corners.
    squares: u64,
}

impl Polygons {
    pub fn new(limits: &LoadLimits) -> Self {
        Self {
            most: limits.corners,
            squares: 0,
        }
    }

    /// Returns the corners of triangles that fill a polygon of at least three corners. They are a fan from the first
    /// corner if the fan fills the polygon. Otherwise, the `earcut` crate computes them in the polygon's mean plane.
    pub fn triangles(&mut self, corners: &[DVec3]) -> Result<Vec<[usize; 3]>, String> {
        let fan = || Ok((1..corners.len() - 1).map(|i| [0, i, i + 1]).collect());
        if corners.len() == 3 {
            return fan();
        }
        // Relative to the first corner, which reduces rounding far from the origin.
        let local: Vec<DVec3> = corners.iter().map(|&c| c - corners[0]).collect();
        let of_fan = |i: usize| local[i].cross(local[i + 1]);
        // The normal times twice the polygon's area (Newell). The fan has the same sum.
        let normal: DVec3 = (1..local.len() - 1).map(of_fan).sum();
        let area = normal.length();
        if !(area > 0.0 && area.is_finite()) {
            return fan();
        }
        let normal = normal / area;
        if (1..local.len() - 1).all(|i| of_fan(i).dot(normal) >= -1e-9 * area) {
            return fan();
        }
        self.check(corners.len())?;
        let (u, v) = normal.any_orthonormal_pair();
        let flat = local.iter().map(|c| DVec2::new(c.dot(u), c.dot(v)));
        let mut found: Vec<usize> = Vec::new();
        Earcut::new().earcut(flat.map(|p| p.to_array()), &[], &mut found);
        let triangles: Vec<[usize; 3]> =
            found.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        if triangles.is_empty() {
            return fan();
        }
        // Triangles get the orientation of the polygon.
        let turned = |&[a, b, c]: &[usize; 3]| {
            let across = (local[b] - local[a]).cross(local[c] - local[a]);
            if across.dot(normal) < 0.0 {
                [a, c, b]
            } else {
                [a, b, c]
            }
        };
        Ok(triangles.iter().map(turned).collect())
    }

    /// Counts a polygon that a fan does not fill. Exceeding the limit is an error.
    fn check(&mut self, corners: usize) -> Result<(), String> {
        if corners > MAX_FREE_CORNERS {
            let square = (corners as u64).saturating_mul(corners as u64);
            self.squares = self.squares.saturating_add(square);
        }
        if self.squares <= self.most.saturating_mul(self.most) {
            return Ok(());
        }
        let found = match corners as u64 > self.most {
            true => format!("a concave polygon has {corners} corners"),
            false => {
                let together = (self.squares as f64).sqrt();
                format!("concave polygons take as long as one of {together:.0} corners")
            }
        };
        let most = self.most;
        Err(format!(
            "{found}, more than {most}: LoadLimits::with_corners raises the limit"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangles(corners: &[DVec3]) -> Vec<[usize; 3]> {
        let mut all = Polygons::new(&LoadLimits::default());
        all.triangles(corners).expect("triangles")
    }

    fn area(corners: &[DVec3], triangles: &[[usize; 3]]) -> f64 {
        let of = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|i| corners[i]);
            0.5 * (b - a).cross(c - a).length()
        };
        triangles.iter().map(of).sum()
    }

    #[test]
    fn convex_polygons_are_fans() {
        let square = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)];
        let corners = square.map(|(x, y)| DVec3::new(x, 3.0, y));
        assert_eq!(triangles(&corners), [[0, 1, 2], [0, 2, 3]]);
    }

    /// Fans of these polygons have at least 10 % too much area.
    #[test]
    fn concave_polygons_keep_their_area_and_side() {
        let turn = glam::DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1);
        let arrow = [(0.0, 0.0), (-1.0, 2.0), (-1.5, -1.0), (2.0, 0.0)];
        let comb = [
            (4.0, 0.0),
            (4.0, 3.0),
            (3.0, 3.0),
            (3.0, 1.0),
            (2.0, 1.0),
            (2.0, 3.0),
            (1.0, 3.0),
            (1.0, 1.0),
            (0.0, 1.0),
            (0.0, 0.0),
        ];
        for flat in [&arrow[..], &comb[..]] {
            for reversed in [false, true] {
                let mut corners: Vec<DVec3> = flat
                    .iter()
                    .map(|&(x, y)| turn * DVec3::new(x, y, 0.0) + DVec3::new(1e3, 5.0, -2.0))
                    .collect();
                if reversed {
                    corners.reverse();
                }
                let n = flat.len();
                let shoelace = |i: usize| {
                    let (p, q) = (flat[i], flat[(i + 1) % n]);
                    p.0 * q.1 - p.1 * q.0
                };
                let signed = 0.5 * (0..n).map(shoelace).sum::<f64>();
                let found = triangles(&corners);
                assert_eq!(found.len(), n - 2);
                assert!((area(&corners, &found) / signed.abs() - 1.0).abs() < 1e-9);
                let side = signed.signum() * if reversed { -1.0 } else { 1.0 };
                let normal = turn * DVec3::Z * side;
                for [a, b, c] in found {
                    let across = (corners[b] - corners[a]).cross(corners[c] - corners[a]);
                    assert!(across.dot(normal) >= 0.0);
                }
            }
        }
    }

    #[test]
    fn polygons_without_area_are_fans() {
        let same = vec![DVec3::ONE; 6];
        assert_eq!(triangles(&same).len(), 4);
    }
}
