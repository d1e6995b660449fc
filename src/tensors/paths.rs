//! The active paths of a tile, and the light that they contribute.

use burn::tensor::Tensor;

use super::rays::{Rays, is_identity};
use super::softmax::Shares;
use super::tracer::Tracer;
use crate::error::Result;
use crate::geometry::{Context, Vec3, detached, host_values};
use softray_kernels::sampling::Dimensions;

/// Applies Russian roulette, in which paths survive in proportion to their throughput. Returns the survivors.
pub(super) fn roulette(tracer: &Tracer, batch: &mut PathBatch, bounce: u32) -> Result<Vec<u32>> {
    let count = batch.paths.len() as u32;
    let Some(current) = &mut batch.throughput else {
        return Ok((0..count).collect());
    };
    let largest = detached(&current.x)
        .max_pair(detached(&current.y))
        .max_pair(detached(&current.z));
    // At least 5 %, so that a path whose light is 0 now still carries its gradient.
    let survival: Vec<f64> = host_values(&largest)?
        .iter()
        .map(|q| q.clamp(0.05, 1.0))
        .collect();
    let sampler = tracer.transport.sampler;
    let [_, random, ..] = sampler.uniform(&batch.paths, Dimensions::choices(bounce));
    let inverse: Vec<f64> = survival.iter().map(|q| q.recip()).collect();
    *current = current.scale(&tracer.scene().context.row(&inverse));
    Ok((0..count)
        .filter(|&i| random[i as usize] < survival[i as usize])
        .collect())
}

/// The active paths of a tile.
pub(super) struct PathBatch {
    /// The pixel and sample of each path.
    pub paths: Vec<(u32, u32)>,
    /// The column of the tile to which each path belongs.
    pub slots: Vec<u32>,
    /// The fraction of its slot that each path represents. `None` stands for 1.
    pub share: Option<Vec<f64>>,
    pub rays: Rays,
    /// `None` stands for 1.
    pub throughput: Option<Vec3>,
}

impl PathBatch {
    /// Continues with several surfaces of each ray instead of one. Returns these surfaces. The batch then has one path
    /// for each of them.
    pub fn split(
        &mut self,
        context: &Context,
        weights: &Shares,
        random: &[f64],
        reflects: impl Fn(u32) -> bool,
    ) -> Result<Vec<u32>> {
        let mut drawn = weights.split(random)?;
        drawn.retain(|d| reflects(d.1));
        if drawn.is_empty() {
            return Ok(Vec::new());
        }
        let ratio = weights.ratio(drawn.iter().map(|d| (d.0, d.1)));
        let rays: Vec<u32> = drawn.iter().map(|d| d.0).collect();
        let share: Vec<f64> = drawn.iter().map(|d| d.2).collect();
        self.keep(context, &rays);
        let share = share.iter().any(|&s| s != 1.0).then_some(share);
        let row = share.as_ref().map(|share| context.row(share));
        let change = match (ratio, row) {
            (Some(ratio), Some(row)) => Some(ratio * row),
            (ratio, row) => ratio.or(row),
        };
        if let Some(change) = change {
            self.throughput = Some(times(self.throughput.take(), &change));
        }
        self.share = share;
        Ok(drawn.iter().map(|d| d.1).collect())
    }

    /// Keeps the listed paths, each as often as it is listed.
    pub fn keep(&mut self, context: &Context, which: &[u32]) {
        if is_identity(which, self.paths.len()) {
            return;
        }
        self.paths = which.iter().map(|&i| self.paths[i as usize]).collect();
        self.slots = which.iter().map(|&i| self.slots[i as usize]).collect();
        if let Some(share) = &mut self.share {
            *share = which.iter().map(|&i| share[i as usize]).collect();
        }
        if which.is_empty() {
            return;
        }
        self.rays = self.rays.pick(context, which);
        let index = context.index_row(which);
        self.throughput = self.throughput.take().map(|t| t.gather(&index));
    }

    /// Returns the light that the listed paths contribute, or that all contribute without a list.
    pub fn contribution(
        &self,
        context: &Context,
        bounce: u32,
        which: Option<&[u32]>,
        light: Vec3,
    ) -> Contribution {
        let (slots, throughput) = match which {
            None => (self.slots.clone(), self.throughput.clone()),
            Some(which) => {
                let index = context.index_row(which);
                (
                    which.iter().map(|&i| self.slots[i as usize]).collect(),
                    self.throughput.as_ref().map(|t| t.gather(&index)),
                )
            }
        };
        Contribution {
            bounce,
            slots,
            light: weighted(light, throughput),
        }
    }
}

/// Contributions of some of a tile's paths.
pub(super) struct Contribution {
    pub bounce: u32,
    pub slots: Vec<u32>,
    pub light: Vec3,
}

/// Returns a throughput times one scalar for each path. `None` stands for 1.
pub(super) fn times(throughput: Option<Vec3>, ratio: &Tensor<2>) -> Vec3 {
    match throughput {
        Some(t) => t.scale(ratio),
        None => Vec3::new(ratio.clone(), ratio.clone(), ratio.clone()),
    }
}

pub(super) fn weighted(light: Vec3, throughput: Option<Vec3>) -> Vec3 {
    match throughput {
        Some(t) => light.mul(&t),
        None => light,
    }
}
