//! The paths of a tile that are on their way, and the light that they bring back.

use burn::tensor::Tensor;

use super::rays::{Rays, is_identity};
use super::tracer::{RayWeights, Tracer};
use crate::error::Result;
use crate::geometry::{Context, Vec3, detached, gather_row, host_values};
use crate::sampling::Dimension;

/// Ends paths at random in proportion to their throughput, and returns those that go on.
pub(super) fn roulette(tracer: &Tracer, batch: &mut PathBatch, bounce: u32) -> Result<Vec<u32>> {
    let count = batch.paths.len() as u32;
    let Some(current) = &mut batch.throughput else {
        return Ok((0..count).collect());
    };
    let largest = detached(&current.x)
        .max_pair(detached(&current.y))
        .max_pair(detached(&current.z));
    // Not under 5 %, so that a path whose light is 0 for now still carries its gradient.
    let survival: Vec<f64> = host_values(&largest)?
        .iter()
        .map(|q| q.clamp(0.05, 1.0))
        .collect();
    let sampler = tracer.transport.sampler;
    let [random] = sampler.uniform(&batch.paths, bounce, [Dimension::Roulette]);
    let inverse: Vec<f64> = survival.iter().map(|q| q.recip()).collect();
    *current = current.scale(&tracer.scene().context.row(&inverse));
    Ok((0..count)
        .filter(|&i| random[i as usize] < survival[i as usize])
        .collect())
}

/// The paths of a tile that are on their way.
pub(super) struct PathBatch {
    /// Pixel and sample of each.
    pub paths: Vec<(u32, u32)>,
    /// The column of the tile that each belongs to.
    pub slots: Vec<u32>,
    /// The part of its slot that a path stands for, where that is not all.
    pub share: Option<Vec<f64>>,
    pub rays: Rays,
    /// None stands for 1.
    pub throughput: Option<Vec3>,
}

impl PathBatch {
    /// Goes on with several surfaces of each ray in place of one. Returns them; paths are then those
    /// of the surfaces.
    pub fn split(
        &mut self,
        tracer: &Tracer,
        weights: &RayWeights,
        random: &[f64],
        reflects: impl Fn(u32) -> bool,
    ) -> Result<Vec<u32>> {
        let context = &tracer.scene().context;
        let n = self.paths.len();
        // The first surface of each ray, then all others.
        let (mut first, mut others): (Vec<(u32, u32, f64)>, Vec<_>) = (Vec::new(), Vec::new());
        for entry in weights.split(random)? {
            if !reflects(entry.1) {
                continue;
            }
            match first.last() {
                Some(last) if last.0 == entry.0 => others.push(entry),
                _ => first.push(entry),
            }
        }
        let mut change = None;
        if !first.is_empty() {
            let mut drawn = vec![tracer.scene().triangles.len() as u32; n];
            for &(i, k, _) in &first {
                drawn[i as usize] = k;
            }
            let index: Vec<u32> = first.iter().map(|e| e.0).collect();
            if let Some(ratio) = weights.ratio(&drawn) {
                let ratio = pick_row(context, ratio, &index, n);
                let index: Vec<u32> = others.iter().map(|e| e.0).collect();
                change = Some(if index.is_empty() {
                    ratio
                } else {
                    let rays = self.rays.pick(context, &index);
                    let drawn: Vec<u32> = others.iter().map(|e| e.1).collect();
                    let again = tracer.weights(&rays)?.ratio(&drawn);
                    let ones = || ratio.zeros_like().slice([0..1, 0..1]) + 1.0;
                    let again = again.unwrap_or_else(|| ones().expand([1, index.len()]));
                    Tensor::cat(vec![ratio, again], 1)
                });
            }
        }
        first.extend(others);
        let index: Vec<u32> = first.iter().map(|e| e.0).collect();
        let share: Vec<f64> = first.iter().map(|e| e.2).collect();
        self.keep(context, &index);
        let whole = share.iter().all(|&s| s == 1.0);
        if !whole && !share.is_empty() {
            let row = context.row(&share);
            change = Some(match change {
                Some(ratio) => ratio * row,
                None => row,
            });
            self.share = Some(share);
        }
        if let Some(change) = change {
            self.throughput = Some(times(self.throughput.take(), &change));
        }
        Ok(first.iter().map(|e| e.1).collect())
    }

    /// Goes on with some paths, as often as they are named.
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

    /// Light that some paths (all, if not named) bring back.
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

fn pick_row(context: &Context, row: Tensor<2>, which: &[u32], count: usize) -> Tensor<2> {
    if is_identity(which, count) {
        return row;
    }
    gather_row(row, &context.index_row(which))
}

/// A throughput times a scalar a path; none stands for 1.
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
