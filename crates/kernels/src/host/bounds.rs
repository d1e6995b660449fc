//! Bounding boxes.

use serde::{Deserialize, Serialize};

/// An axis-aligned bounding box, in scene units. `Scene::bounds` has an example.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bounds {
    /// The smallest coordinates.
    pub min: [f64; 3],
    /// The largest coordinates.
    pub max: [f64; 3],
}

impl Bounds {
    /// Returns the bounding box of points, or None if there are none.
    pub fn of_points(points: impl IntoIterator<Item = [f64; 3]>) -> Option<Self> {
        let point = |p| Self { min: p, max: p };
        points.into_iter().map(point).reduce(|a, b| a.union(&b))
    }

    /// Returns the bounding box of both boxes.
    pub fn union(&self, other: &Self) -> Self {
        Self {
            min: std::array::from_fn(|i| self.min[i].min(other.min[i])),
            max: std::array::from_fn(|i| self.max[i].max(other.max[i])),
        }
    }

    /// Returns the center of the box.
    pub fn center(&self) -> [f64; 3] {
        std::array::from_fn(|i| 0.5 * self.min[i] + 0.5 * self.max[i])
    }

    /// Returns the lengths of the sides along x, y and z.
    pub fn size(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.max[i] - self.min[i])
    }

    /// Returns the radius of the sphere about the [`center`](Self::center) that passes through the corners: half the
    /// diagonal.
    /// The sphere contains the box.
    pub fn radius(&self) -> f64 {
        0.5 * glam::DVec3::from(self.size()).length()
    }

    /// Returns the corners of the box.
    pub fn corners(&self) -> [[f64; 3]; 8] {
        let side = |k: usize, i: usize| {
            if k >> i & 1 == 0 {
                self.min[i]
            } else {
                self.max[i]
            }
        };
        std::array::from_fn(|k| std::array::from_fn(|i| side(k, i)))
    }

    /// Returns the box moved by an offset.
    pub fn moved(&self, offset: [f64; 3]) -> Self {
        Self {
            min: std::array::from_fn(|i| self.min[i] + offset[i]),
            max: std::array::from_fn(|i| self.max[i] + offset[i]),
        }
    }
}
