//! The generalized winding number (Barill et al. 2018, *Fast winding numbers for soups and clouds*).

use std::f64::consts::TAU;

use glam::DVec3;

use super::bvh::Bvh;

/// A node counts as one dipole from this many of its radii on.
const FAR: f64 = 2.0;

/// The faces below a node of a tree as one dipole.
#[derive(Clone, Copy)]
struct Dipole {
    center: DVec3,
    /// The sum of the faces' normals times their areas.
    area: DVec3,
    /// The largest distance of a corner from the center.
    radius: f64,
}

/// Winding numbers about points, from a tree over the faces.
pub(super) struct Winding<'a> {
    bvh: &'a Bvh,
    dipoles: Vec<Dipole>,
}

impl<'a> Winding<'a> {
    pub fn new(bvh: &'a Bvh) -> Self {
        let nothing = Dipole {
            center: DVec3::ZERO,
            area: DVec3::ZERO,
            radius: 0.0,
        };
        let mut dipoles = vec![nothing; bvh.nodes.len()];
        let mut sums = vec![(0.0, DVec3::ZERO); bvh.nodes.len()];
        // Children come after their parents.
        for at in (0..bvh.nodes.len()).rev() {
            let node = &bvh.nodes[at];
            let (mut weight, mut center, mut area) = (0.0, DVec3::ZERO, DVec3::ZERO);
            if node.count == 0 {
                for child in [at + 1, node.next as usize] {
                    weight += sums[child].0;
                    center += sums[child].1;
                    area += dipoles[child].area;
                }
            } else {
                let range = node.next as usize..(node.next + node.count) as usize;
                for [a, b, c] in &bvh.corners[range] {
                    let normal = (b - a).cross(c - a) / 2.0;
                    weight += normal.length();
                    center += normal.length() * (a + b + c) / 3.0;
                    area += normal;
                }
            }
            sums[at] = (weight, center);
            let middle = (node.min + node.max) / 2.0;
            let center = if weight > 0.0 {
                center / weight
            } else {
                middle
            };
            let farthest = (node.max - center).abs().max((center - node.min).abs());
            dipoles[at] = Dipole {
                center,
                area,
                radius: farthest.length(),
            };
        }
        Self { bvh, dipoles }
    }

    /// How many times the faces go around a point: 1 inside and 0 outside of a closed surface.
    pub fn about(&self, point: DVec3) -> f64 {
        let mut sum = 0.0;
        let mut open = Vec::with_capacity(64);
        if !self.dipoles.is_empty() {
            open.push(0u32);
        }
        while let Some(at) = open.pop() {
            let dipole = &self.dipoles[at as usize];
            let to = dipole.center - point;
            let squared = to.length_squared();
            if squared > (FAR * dipole.radius).powi(2) {
                sum += dipole.area.dot(to) / (squared * squared.sqrt());
                continue;
            }
            let node = &self.bvh.nodes[at as usize];
            if node.count == 0 {
                open.push(at + 1);
                open.push(node.next);
                continue;
            }
            let range = node.next as usize..(node.next + node.count) as usize;
            sum += self.bvh.corners[range]
                .iter()
                .map(|corners| solid_angle(corners.map(|p| p - point)))
                .sum::<f64>();
        }
        sum / (2.0 * TAU)
    }
}

/// The solid angle of a triangle from the origin (Van Oosterom and Strackee 1983), positive if its back is seen.
pub(super) fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let (x, y, z) = (a.length(), b.length(), c.length());
    let below = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
    2.0 * a.dot(b.cross(c)).atan2(below)
}
