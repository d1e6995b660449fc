//! The form of the sums of a pass, and the room that they and a job's other lists need.

use burn::cubecl::prelude::*;
use burn::tensor::Device;

use super::device::{List, has_room};
use super::job::Job;
use super::sums::{AddingLaunch, ReplicasLaunch, typical};
use crate::device::label;
use crate::error::{Error, Result};
use softray_kernels::trace::{Derivatives, MEASURE, PARTS};

/// Approximate maximum number of sums in all replicas together.
const REPLICATED: usize = 1 << 16;
/// Maximum number of replicas: the number of threads in a warp.
const REPLICAS: usize = 32;

/// The form of the sums of a pass: those of parameters or, in forward mode, those of pixels.
#[derive(Clone, Copy)]
pub(super) struct Form {
    /// The number of parts, each of which has a scale, and the number of sums.
    pub parts: usize,
    pub count: usize,
    /// In forward mode, the number of directions and of pixels; otherwise 0.
    pub directions: usize,
    pub pixels: usize,
}

impl Form {
    /// Returns the form of a job's sums, in forward mode if there are directions.
    pub fn new(job: &Job, directions: usize) -> Self {
        if directions == 0 {
            return Self {
                parts: PARTS,
                count: job.views.sums.count,
                directions,
                pixels: 0,
            };
        }
        let parts = job.outputs.channels(true) as usize * directions;
        Self {
            parts,
            count: parts * job.count(),
            directions,
            pixels: job.count(),
        }
    }

    pub fn is_forward(self) -> bool {
        self.directions > 0
    }

    /// Returns the number of replicas of all sums. With several, threads of a warp do not wait for each other.
    pub fn replicas(self) -> usize {
        (REPLICATED / self.count.max(1)).clamp(1, REPLICAS)
    }

    /// Returns the number of words of all sums: three per sum for all launches, and two per sum for each replica of one
    /// launch.
    pub fn words(self) -> usize {
        (3 + 2 * self.replicas()) * self.count
    }

    /// Returns the scales before any derivative is measured, if scaled derivatives have so many bits.
    pub fn scales(self, bits: i32, views: usize) -> Vec<f32> {
        let mut scales = vec![MEASURE; self.parts];
        scales.push(2.0f32.powi(bits));
        scales.resize(typical(self.parts as u32) as usize + 2 * views, 0.0);
        scales
    }

    /// Returns the replicas as an argument of kernels.
    pub fn as_argument(self) -> ReplicasLaunch {
        ReplicasLaunch::new(self.replicas() as u32, self.count as u32)
    }

    /// Returns the sums, in a list, as an argument of kernels.
    pub fn adding(self, client: &Client, to: &List, of: Derivatives) -> AddingLaunch {
        AddingLaunch::new(
            to.argument(),
            to.pairs(client).into(),
            self.as_argument(),
            self.parts as u32,
            self.directions as u32,
            self.pixels as u32,
            of,
        )
    }
}

/// Checks that a device supports the bindings of the kernels and the lengths of the lists. If derivatives are computed,
/// `directions` is the number of directions of forward mode, or 0 for a gradient.
///
/// # Errors
/// Returns an error with the name of the device, and the missing bindings or the list that is too long.
pub(crate) fn check<'a>(
    device: &Device,
    jobs: impl Iterator<Item = &'a Job>,
    directions: Option<usize>,
) -> Result<()> {
    let mut lists = Vec::new();
    for job in jobs {
        let scene = job.views.buffers.longest();
        lists.push(("the scene", scene));
        lists.push(("the image", job.count() * job.outputs.rows()));
        if let Some(directions) = directions {
            let form = Form::new(job, directions);
            lists.push(("the sums of derivatives", form.words()));
        }
    }
    has_room(device, &lists).map_err(|message| Error::device(label(device), message))
}
