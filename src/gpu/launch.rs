//! Kernels on burn's devices: an image, in launches that are not long.

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Cube, Dispatch, backend_extension};
use burn::cubecl::prelude::*;
use burn::tensor::{DType, Device, Shape, Tensor};

use super::device::{floats, without_backtrace, zeros};
use super::job::{GROUP, Job, PATHS, groups};
use super::list::List;
use super::{add_chunks, render_pixels};
use crate::device::label;
use crate::error::{Error, Result};

/// Threads that keep a GPU busy, about.
const THREADS: usize = 1 << 17;

#[backend_extension(Cube)]
pub(crate) trait GpuBackend: Backend {
    /// The rows of all views `[B·P, C]`, on the device of a tensor, and why they could not be computed if so.
    fn trace(like: FloatTensor<Self>, job: Job, failed: &mut Option<String>) -> FloatTensor<Self>;
}

impl GpuBackend for Cube {
    fn trace(like: FloatTensor<Self>, job: Job, failed: &mut Option<String>) -> FloatTensor<Self> {
        let rows = job.outputs.rows();
        let (tensor, image) = zeros(&like, Shape::from([job.count(), rows]));
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
