//! Where the sums of views lie among all.

use std::collections::HashMap;

use crate::kernel::View;
use crate::trace::{CAMERAS, OF_CAMERA, PARTS};

/// Numbers of the sums of all replicas together, about.
const REPLICATED: usize = 1 << 16;
/// Replicas at most: as many as threads of a warp.
const REPLICAS: usize = 32;

/// Where the sums of each part of views begin, in numbers. Views of one scene share them, but for the camera's.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places {
    /// Of each view.
    pub first: Vec<[u32; PARTS]>,
    /// For each view, the first view of its scene.
    owner: Vec<usize>,
    pub count: usize,
}

impl Places {
    /// For views, each with the number of its scene.
    pub fn new<'a>(views: impl Iterator<Item = (&'a View, usize)>) -> Self {
        let mut places = Self::default();
        let mut known = HashMap::new();
        for (v, (view, scene)) in views.enumerate() {
            let owner = *known.entry(scene).or_insert(v);
            let mut first = [0; PARTS];
            if owner == v {
                let counts = view.wanted.lengths(&view.scene);
                // The camera's are last.
                for (first, n) in first.iter_mut().zip(counts).take(CAMERAS as usize) {
                    *first = places.count as u32;
                    places.count += n;
                }
            } else {
                first = places.first[owner];
            }
            first[CAMERAS as usize] = places.count as u32;
            places.count += OF_CAMERA as usize;
            places.first.push(first);
            places.owner.push(owner);
        }
        places
    }

    /// Copies of all sums that kernels add to, so that threads of a warp don't wait for each other.
    pub fn replicas(&self) -> usize {
        (REPLICATED / self.count.max(1)).clamp(1, REPLICAS)
    }

    /// Whether a view is the first one of its scene.
    pub fn owns(&self, view: usize) -> bool {
        self.owner[view] == view
    }
}
