//! What is rendered, and in which pieces.

use std::sync::Arc;

use burn::cubecl::prelude::*;

use super::list::List;
use super::pieces::PieceLaunch;
use super::{Outputs, Packed};

/// Views, and what of them is rendered.
#[derive(Clone)]
pub(crate) struct Job {
    pub views: Arc<Packed>,
    /// All pixels if there is no list.
    pub pixels: Option<Arc<Vec<u32>>>,
    /// Pixels of a view.
    pub of_view: usize,
    pub samples: u32,
    pub outputs: Outputs,
}

/// Paths of a launch at most, so that no launch is long.
pub(super) const PATHS: usize = 1 << 20;
/// Threads of a workgroup.
pub(super) const GROUP: u32 = 64;

/// Workgroups for so many threads.
pub(super) fn groups(threads: usize) -> CubeCount {
    /// Along one axis.
    const MOST: u32 = 65_535;
    let groups = (threads as u32).div_ceil(GROUP).max(1);
    CubeCount::Static(groups.min(MOST), groups.div_ceil(MOST), 1)
}

/// Samples `from` to `past` of pixels, which are counted over all views.
#[derive(Clone, Copy)]
pub(super) struct Samples {
    pub first: usize,
    pub stride: usize,
    pub count: usize,
    pub from: u32,
    pub past: u32,
}

impl Samples {
    pub fn paths(&self) -> usize {
        self.count * (self.past - self.from) as usize
    }

    pub fn argument(&self, job: &Job) -> PieceLaunch {
        PieceLaunch::new(
            self.first as u32,
            self.stride as u32,
            self.count as u32,
            self.from,
            self.past,
            job.of_view as u32,
        )
    }
}

impl Job {
    /// Pixels of all views.
    pub fn count(&self) -> usize {
        self.views.views * self.of_view
    }

    /// All samples in pieces of so many paths at most.
    pub(super) fn pieces(&self, paths: usize) -> Vec<Samples> {
        let at_once = paths.clamp(1, self.count().max(1));
        let samples_at_once = (paths / at_once).max(1) as u32;
        let mut pieces = Vec::new();
        for first in (0..self.count()).step_by(at_once) {
            let mut from = 0;
            while from < self.samples {
                let past = self.samples.min(from.saturating_add(samples_at_once));
                pieces.push(Samples {
                    first,
                    stride: 1,
                    count: at_once.min(self.count() - first),
                    from,
                    past,
                });
                from = past;
            }
        }
        pieces
    }

    pub(super) fn lists(&self, client: &Client) -> [List; 3] {
        let none = vec![0];
        let pixels = self.pixels.as_deref().unwrap_or(&none);
        let [floats, words] = self.views.on_device(client);
        [floats, words, List::new(client, pixels)]
    }
}
