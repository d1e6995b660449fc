//! Images on burn's devices: the kernels, and launches of limited duration.

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Cube, Dispatch, backend_extension};
use burn::tensor::{DType, Device, Shape, Tensor};

use softray_kernels::cube::*;

use super::device::{List, floats, launch, without_backtrace, zeros};
use super::hit::Memory;
use super::job::{Job, Outputs, PATHS, Paths, Piece};
use super::path::light_of_pixel;
use super::walk::PathLight;
use crate::device::label;
use crate::error::{Error, Result};
use softray_kernels::trace::{NONE, Scene, UNIT};

/// Adds the result of a path, times a factor, to a row of an image.
#[cube]
fn add_to_row(
    scene: &Scene,
    image: &mut [f32],
    row: usize,
    light: &PathLight,
    scale: f32,
    #[comptime] outputs: Outputs,
) {
    let seen = light.seen;
    image[row] += seen.radiance.x * scale;
    image[row + 1] += seen.radiance.y * scale;
    image[row + 2] += seen.radiance.z * scale;
    let mut at = row + 3;
    if comptime!(outputs.opacity) {
        image[at] += seen.opacity * scale;
        at += 1;
    }
    if comptime!(outputs.depth) {
        image[at] += seen.depth * scale * scene.settings[UNIT];
        at += 1;
    }
    if comptime!(outputs.normals) {
        image[at] += seen.normal.x * scale;
        image[at + 1] += seen.normal.y * scale;
        image[at + 2] += seen.normal.z * scale;
        at += 3;
    }
    if comptime!(outputs.albedo) {
        image[at] += light.albedo.x * scale;
        image[at + 1] += light.albedo.y * scale;
        image[at + 2] += light.albedo.z * scale;
        at += 3;
    }
    if comptime!(outputs.objects > 0) {
        let mut object = comptime!(outputs.objects as u32 - 1).runtime();
        if light.object != NONE {
            object = scene.counted[light.object as usize];
        }
        image[at + object as usize] += scale;
        at += outputs.objects;
    }
    if comptime!(outputs.rays) {
        image[at] += light.rays as f32 * scale;
    }
}

/// Adds samples of pixels, times `scale`, to the rows of an image from a first row on. If `fresh` is 1, the rows are
/// set to zero first. Several threads of one pixel each have their own samples and their own row.
#[cube(launch)]
fn render_pixels(
    paths: Paths,
    image: &mut [f32],
    row: u32,
    fresh: u32,
    scale: f32,
    #[comptime] outputs: Outputs,
) {
    if ABSOLUTE_POS < paths.piece.threads() as usize {
        let thread = ABSOLUTE_POS as u32;
        let which = paths.of_thread(thread);
        let scene = paths.views.scene(which.view);
        let mut memory = Memory::new(&scene);
        let rows = comptime!(outputs.rows());
        let count = paths.piece.count;
        let of_piece = which.row - paths.piece.first;
        let own = (row + thread / count * count + of_piece) as usize * rows;
        if fresh == 1 {
            for k in 0..rows {
                image[own + k] = 0.0;
            }
        }
        let mut sample = which.sample;
        let past = (sample + paths.piece.each).min(paths.piece.past);
        while sample < past {
            let light = light_of_pixel(&scene, &mut memory, which.pixel, sample);
            add_to_row(&scene, image, own, &light, scale, outputs);
            sample += 1;
        }
    }
}

/// Adds the rows of chunks of samples to the rows of an image, in a fixed order. If `fresh` is 1, they replace these
/// rows.
#[cube(launch)]
fn add_chunks(partial: &[f32], image: &mut [f32], first: u32, chunks: u32, fresh: u32) {
    let length = partial.len() / chunks as usize;
    if ABSOLUTE_POS < length {
        let own = first as usize + ABSOLUTE_POS;
        let mut sum = 0.0f32;
        if fresh == 0 {
            sum = image[own];
        }
        for chunk in 0..chunks {
            sum += partial[chunk as usize * length + ABSOLUTE_POS];
        }
        image[own] = sum;
    }
}

/// Approximate number of threads that keep a GPU busy.
const THREADS: usize = 1 << 17;

#[backend_extension(Cube)]
pub(crate) trait GpuBackend: Backend {
    /// Returns the rows of all views `[B·P, C]`, on the device of `like`. If they cannot be computed, `failed` is set
    /// to the reason.
    fn trace(like: FloatTensor<Self>, job: Job, failed: &mut Option<String>) -> FloatTensor<Self>;
}

impl GpuBackend for Cube {
    fn trace(like: FloatTensor<Self>, job: Job, failed: &mut Option<String>) -> FloatTensor<Self> {
        let rows = job.outputs.rows();
        let (tensor, image) = zeros(&like, Shape::from([job.count(), rows]));
        let (client, _) = floats(like);
        let lists = job.lists(&client);
        for piece in job.pieces(PATHS) {
            let samples = piece.past - piece.from;
            let count = piece.count as usize;
            // If pixels are few, several threads share the samples of a pixel.
            let chunks = (THREADS / count).clamp(1, samples as usize) as u32;
            let each = samples.div_ceil(chunks);
            let piece = Piece { each, ..piece };
            let chunks = piece.threads() / piece.count;
            let partial = (chunks > 1).then(|| List::room(&client, chunks as usize * count * rows));
            let first = u32::from(piece.from == job.from);
            let (row, fresh) = match partial {
                Some(_) => (0, 1),
                None => (piece.first, first),
            };
            launch!(
                &client,
                piece.threads() as usize,
                render_pixels(
                    job.paths(&client, &lists, piece),
                    partial.as_ref().unwrap_or(&image),
                    row,
                    fresh,
                    1.0 / job.samples as f32,
                    job.outputs
                )
            );
            if let Some(partial) = partial {
                let to = piece.first * rows as u32;
                launch!(
                    &client,
                    count * rows,
                    add_chunks(&partial, &image, to, chunks, first)
                );
            }
        }
        // This check reports buffers that could not be allocated and kernels that could not be compiled.
        *failed = client.check([&image.handle]).err().map(without_backtrace);
        tensor
    }
}

/// Renders a job on a device, and returns rows `[B·P, C]`.
///
/// # Errors
/// Returns an error if buffers cannot be allocated or kernels cannot be compiled.
pub(crate) fn trace(device: &Device, job: Job) -> Result<Tensor<2>> {
    // A tensor on the device selects it.
    let like = Tensor::<1>::zeros([1], (device, DType::F32));
    let mut failed = None;
    let image = <Dispatch as GpuBackend>::trace(like.into_dispatch(), job, &mut failed);
    match failed {
        None => Ok(Tensor::from_dispatch(image)),
        Some(why) => Err(Error::device(label(device), why)),
    }
}
