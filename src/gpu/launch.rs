//! Kernels on burn's devices: an image, in launches that are not long.

use std::sync::Arc;

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Backend, Cube, Dispatch, backend_extension};
use burn::cubecl::prelude::*;
use burn::tensor::{DType, Device, Tensor};

use super::device::{floats, int_zeros, zeros};
use super::launch_backward::{Pass, Sought};
use super::list::List;
use super::pieces::PieceLaunch;
use super::sums::FIRST_SUM;
use super::{Outputs, Packed, add_chunks, render_pixels};
use crate::device::label;
use crate::error::{Error, Result};

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

#[backend_extension(Cube)]
pub(crate) trait GpuBackend: Backend {
    /// The rows of all views `[B·P, C]`, on the device of a tensor, and why they could not be computed if so.
    fn trace(like: FloatTensor<Self>, job: Job, failed: &mut Option<String>) -> FloatTensor<Self>;

    /// The sums of derivatives ([`Places`](super::sums::Places)), from those by the rows.
    fn trace_backward(upstream: FloatTensor<Self>, job: Job, sought: Sought) -> IntTensor<Self>;
}

/// Paths of a launch at most, so that no launch is long.
pub(super) const PATHS: usize = 1 << 20;
/// Threads that keep a GPU busy, about.
const THREADS: usize = 1 << 17;
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

impl GpuBackend for Cube {
    fn trace(like: FloatTensor<Self>, job: Job, failed: &mut Option<String>) -> FloatTensor<Self> {
        let rows = job.outputs.rows();
        let (tensor, image) = zeros(&like, [job.count(), rows]);
        let (client, _) = floats(like);
        let [floats, words, pixels] = job.lists(&client);
        for piece in job.pieces(PATHS) {
            let samples = piece.past - piece.from;
            // A pixel's samples are shared by threads where pixels are few.
            let chunks = (THREADS / piece.count).clamp(1, samples as usize) as u32;
            let each = samples.div_ceil(chunks);
            let chunks = samples.div_ceil(each) as usize;
            let partial = (chunks > 1).then(|| List::room(&client, chunks * piece.count * rows));
            let first = u32::from(piece.from == 0);
            render_pixels::launch(
                &client,
                groups(chunks * piece.count),
                CubeDim::new_1d(GROUP),
                floats.argument(),
                words.argument(),
                pixels.argument(),
                partial.as_ref().unwrap_or(&image).argument(),
                piece.argument(&job),
                if partial.is_some() {
                    0
                } else {
                    piece.first as u32
                },
                each,
                if partial.is_some() { 1 } else { first },
                1.0 / job.samples as f32,
                job.pixels.is_some(),
                job.outputs,
                job.views.features,
            );
            if let Some(partial) = partial {
                add_chunks::launch(
                    &client,
                    groups(piece.count * rows),
                    CubeDim::new_1d(GROUP),
                    partial.argument(),
                    image.argument(),
                    (piece.first * rows) as u32,
                    (piece.count * rows) as u32,
                    chunks as u32,
                    first,
                );
            }
        }
        // Buffers that could not be had and kernels that could not be compiled are known now.
        *failed = client.check([&image.handle]).err().map(without_backtrace);
        tensor
    }

    fn trace_backward(upstream: FloatTensor<Self>, job: Job, sought: Sought) -> IntTensor<Self> {
        let (tensor, sums) = int_zeros(&upstream, FIRST_SUM + 2 * job.views.sums.count);
        Pass::new(upstream, &job, &sought).run(&sums);
        tensor
    }
}

/// Renders on a device: rows `[B·P, C]`.
///
/// # Errors
/// If buffers can't be had, or kernels can't be compiled.
pub(crate) fn trace(device: &Device, job: Job) -> Result<Tensor<2>> {
    // The device is known by a tensor that lies there.
    let like = Tensor::<1>::zeros([1], (device, DType::F32));
    let mut failed = None;
    let image = <Dispatch as GpuBackend>::trace(like.into_dispatch(), job, &mut failed);
    match failed {
        None => Ok(Tensor::from_dispatch(image)),
        Some(why) => Err(Error::device(label(device), why)),
    }
}

/// An error's text, without the part for those who mend CubeCL.
pub(super) fn without_backtrace(error: impl ToString) -> String {
    let text = error.to_string();
    let lines = text.lines().map(str::trim);
    let told = lines.take_while(|line| !line.starts_with("Backtrace"));
    told.collect::<Vec<_>>().join(" ")
}
