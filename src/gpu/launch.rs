//! Kernels on burn's devices: what they are launched with, in pieces that are not long.

use std::sync::Arc;

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Backend, Cube, Dispatch, backend_extension};
use burn::cubecl::prelude::*;
use burn::tensor::{DType, Device, Int, Tensor, TensorData};

use super::device::{floats, int_zeros, zeros};
use super::film::film_jumps;
use super::list::List;
use super::passes::{add_jumps, go_back, keep_paths};
use super::records::JUMPED;
use super::records::RECORD;
use super::sums::{FIRST_SUM, LOST, MEASURE, PARTS, Places};
use super::{Derivatives, Outputs, Packed, render_pixels};
use crate::device::label;
use crate::error::{Error, Result};
use crate::kernel::{Sums, View};

/// A view, and what of it is rendered.
#[derive(Clone)]
pub(crate) struct Job {
    pub view: Arc<Packed>,
    /// All pixels if there is no list.
    pub pixels: Option<Arc<Vec<u32>>>,
    pub count: usize,
    pub samples: u32,
    pub outputs: Outputs,
}

/// What a backward pass adds up.
#[derive(Clone)]
pub(crate) struct Sought {
    derivatives: Derivatives,
    numbers: usize,
    scales: Vec<f32>,
    /// Looks at one sample of every so many pixels.
    stride: usize,
    /// How much the loss depends on the radiance of a pixel, on average.
    typical: f32,
}

/// Edges on the film of a view.
#[derive(Clone)]
pub(crate) struct FilmJob {
    /// `FilmEdges::flat`.
    pub pieces: Arc<(Vec<f32>, f32)>,
    /// The row of each pixel, if not all pixels are asked for.
    pub places: Option<Arc<Vec<u32>>>,
    /// The radius of the pixel filter.
    pub radius: f32,
    pub samples: u32,
}

#[backend_extension(Cube)]
pub(crate) trait GpuBackend: Backend {
    /// The image `[P, C]`, on the device of a tensor, and why it could not be launched if so.
    fn trace(like: FloatTensor<Self>, job: Job, failed: &mut Option<String>) -> FloatTensor<Self>;

    /// The sums of derivatives ([`Places`]), from those by the image's rows.
    fn trace_backward(upstream: FloatTensor<Self>, job: Job, sought: Sought) -> IntTensor<Self>;

    /// The same of jumps on the film.
    fn trace_film(
        upstream: FloatTensor<Self>,
        job: Job,
        film: FilmJob,
        sought: Sought,
    ) -> IntTensor<Self>;
}

/// Paths of a launch at most, so that no launch is long.
const PATHS: usize = 1 << 20;
/// Words of a launch's records at most.
const RECORDS: usize = 1 << 24;
/// Threads of a workgroup.
const GROUP: u32 = 64;

impl Job {
    /// The pieces of the job: first pixel, number of pixels, first sample and the one past the last.
    fn pieces(&self, paths: usize) -> Vec<[u32; 4]> {
        let at_once = paths.clamp(1, self.count.max(1));
        let samples_at_once = (paths / at_once).max(1) as u32;
        let mut pieces = Vec::new();
        for first in (0..self.count).step_by(at_once) {
            let count = at_once.min(self.count - first);
            let mut from = 0;
            while from < self.samples {
                let past = self.samples.min(from.saturating_add(samples_at_once));
                pieces.push([first as u32, count as u32, from, past]);
                from = past;
            }
        }
        pieces
    }

    fn lists(&self, client: &Client) -> [List; 3] {
        let none = vec![0];
        let pixels = self.pixels.as_deref().unwrap_or(&none);
        let [floats, words] = self.view.on_device(client);
        [floats, words, List::new(client, pixels)]
    }
}

impl Sought {
    /// The length of the list of sums.
    fn length(&self) -> usize {
        let measures = self.scales[0] == MEASURE;
        let numbers = if measures { 1 } else { self.numbers.max(1) };
        FIRST_SUM + 2 * numbers
    }
}

impl GpuBackend for Cube {
    fn trace(like: FloatTensor<Self>, job: Job, failed: &mut Option<String>) -> FloatTensor<Self> {
        let (tensor, image) = zeros(&like, [job.count, job.outputs.rows()]);
        let (client, _) = floats(like);
        let [floats, words, pixels] = job.lists(&client);
        for [first, count, from, past] in job.pieces(PATHS) {
            render_pixels::launch(
                &client,
                CubeCount::Static(count.div_ceil(GROUP), 1, 1),
                CubeDim::new_1d(GROUP),
                floats.argument(),
                words.argument(),
                pixels.argument(),
                image.argument(),
                first,
                count,
                from,
                past,
                1.0 / job.samples as f32,
                job.pixels.is_some(),
                job.outputs,
                job.view.features,
            );
        }
        // Buffers that could not be had and kernels that could not be compiled are known now.
        *failed = client.check([&image.handle]).err().map(without_backtrace);
        tensor
    }

    fn trace_backward(upstream: FloatTensor<Self>, job: Job, sought: Sought) -> IntTensor<Self> {
        let (tensor, totals) = int_zeros(&upstream, sought.length());
        let (client, gradient) = floats(upstream);
        let [floats, words, pixels] = job.lists(&client);
        let scales = List::new(&client, &sought.scales);
        let of = sought.derivatives;
        let points = job.view.words[super::layout::BOUNCES] + 1;
        let of_point = if of.jumps { RECORD + JUMPED } else { RECORD };
        let of_path = (of_point * points + 1) as usize;
        let at_once = (RECORDS / of_path).max(1);
        let pieces = if sought.stride > 1 {
            let some = job.count.div_ceil(sought.stride).min(at_once);
            vec![[0, some as u32, 0, 1]]
        } else {
            job.pieces(at_once)
        };
        let paths = |piece: &[u32; 4]| piece[1] * (piece[3] - piece[2]);
        let most = pieces.iter().map(paths).max().unwrap_or(1) as usize;
        let records = List::room(&client, of_path * most);
        let (stride, listed) = (sought.stride as u32, job.pixels.is_some());
        let (outputs, features) = (job.outputs, job.view.features);
        let scale = 1.0 / job.samples as f32;
        let groups = |threads: u32| CubeCount::Static(threads.div_ceil(GROUP), 1, 1);
        for [first, count, from, past] in pieces {
            let samples = past - from;
            keep_paths::launch(
                &client,
                groups(count * samples),
                CubeDim::new_1d(GROUP),
                floats.argument(),
                words.argument(),
                pixels.argument(),
                gradient.argument(),
                records.argument(),
                first,
                stride,
                count,
                from,
                samples,
                scale,
                listed,
                outputs,
                features,
            );
            if of.jumps {
                add_jumps::launch(
                    &client,
                    groups(count * samples * points),
                    CubeDim::new_1d(GROUP),
                    floats.argument(),
                    words.argument(),
                    pixels.argument(),
                    gradient.argument(),
                    records.argument(),
                    totals.argument(),
                    scales.argument(),
                    first,
                    stride,
                    count,
                    from,
                    samples,
                    scale,
                    sought.typical,
                    listed,
                    outputs,
                    features,
                    of,
                );
            }
            go_back::launch(
                &client,
                groups(count),
                CubeDim::new_1d(GROUP),
                floats.argument(),
                words.argument(),
                pixels.argument(),
                gradient.argument(),
                records.argument(),
                totals.argument(),
                scales.argument(),
                first,
                stride,
                count,
                from,
                samples,
                scale,
                listed,
                outputs,
                features,
                of,
            );
        }
        tensor
    }

    fn trace_film(
        upstream: FloatTensor<Self>,
        job: Job,
        film: FilmJob,
        sought: Sought,
    ) -> IntTensor<Self> {
        let (tensor, totals) = int_zeros(&upstream, sought.length());
        let (client, gradient) = floats(upstream);
        let [floats, words, _] = job.lists(&client);
        let (list, total) = &*film.pieces;
        let pieces = List::new(&client, list);
        let none = vec![0];
        let places = List::new(&client, film.places.as_deref().unwrap_or(&none));
        let scales = List::new(&client, &sought.scales);
        let samples = if sought.stride > 1 {
            film.samples.min(MEASURED as u32)
        } else {
            film.samples
        };
        for first in (0..samples).step_by(PATHS) {
            let count = (samples - first).min(PATHS as u32);
            film_jumps::launch(
                &client,
                CubeCount::Static(count.div_ceil(GROUP), 1, 1),
                CubeDim::new_1d(GROUP),
                floats.argument(),
                words.argument(),
                pieces.argument(),
                places.argument(),
                gradient.argument(),
                totals.argument(),
                scales.argument(),
                first,
                count,
                film.samples,
                (list.len() / 4) as u32,
                *total,
                film.radius,
                film.places.is_some(),
                job.outputs,
                job.view.features,
                sought.derivatives,
            );
        }
        tensor
    }
}

/// An error's text, without the part for those who mend CubeCL.
fn without_backtrace(error: impl ToString) -> String {
    let text = error.to_string();
    let lines = text.lines().map(str::trim);
    let told = lines.take_while(|line| !line.starts_with("Backtrace"));
    told.collect::<Vec<_>>().join(" ")
}

/// Renders on a device: an image `[P, C]`.
///
/// # Errors
/// If its memory does not suffice, or a kernel can't be compiled.
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

/// The mean of how much a loss depends on the radiance of a pixel, over those that it depends on.
fn typical(upstream: &[f32], rows: usize) -> f32 {
    let pixels = upstream.chunks_exact(rows);
    let own = pixels.map(|row| row[..3].iter().map(|g| f64::from(g.abs())).sum::<f64>());
    let asked: Vec<f64> = own.filter(|&g| g > 0.0).collect();
    (asked.iter().sum::<f64>() / asked.len().max(1) as f64) as f32
}

/// Pixels that are looked at for the sizes of derivatives, at least.
const MEASURED: usize = 4096;

/// The sums of the derivatives of a view's light along paths and by jumps at their points, from derivatives by the
/// rows of its image.
pub(crate) fn sums_of(device: &Device, view: &View, job: &Job, upstream: &[f32]) -> Sums {
    // One sample of some pixels tells how large derivatives are.
    let paths = job.count.saturating_mul(job.samples as usize);
    let stride = job.count.div_ceil((paths / 16).max(MEASURED)).max(1);
    summed(device, view, job, upstream, stride, |upstream, sought| {
        <Dispatch as GpuBackend>::trace_backward(upstream, job.clone(), sought)
    })
}

/// Those by jumps on the film.
pub(crate) fn sums_of_film(
    device: &Device,
    view: &View,
    job: &Job,
    film: &FilmJob,
    upstream: &[f32],
) -> Sums {
    summed(device, view, job, upstream, 2, |upstream, sought| {
        <Dispatch as GpuBackend>::trace_film(upstream, job.clone(), film.clone(), sought)
    })
}

/// Sums of derivatives, whose sizes are looked at first, every `stride`-th.
fn summed(
    device: &Device,
    view: &View,
    job: &Job,
    upstream: &[f32],
    stride: usize,
    run: impl Fn(FloatTensor<Dispatch>, Sought) -> IntTensor<Dispatch>,
) -> Sums {
    let places = Places::new(&view.scene, &view.wanted);
    let data = TensorData::new(upstream.to_vec(), [upstream.len()]);
    let on_device = Tensor::<1>::from_data(data, (device, DType::F32));
    let derivatives = Derivatives::of(view, &job.view.words);
    let typical = typical(upstream, job.outputs.rows());
    let words = |stride: usize, scales: &[f32]| -> Vec<u32> {
        let sought = Sought {
            derivatives,
            numbers: places.count,
            scales: scales.to_vec(),
            stride,
            typical,
        };
        let totals = run(on_device.clone().into_dispatch(), sought);
        let totals = Tensor::<1, Int>::from_dispatch(totals).try_into_data();
        let totals = totals
            .unwrap_or_else(|why| panic!("device {}: {}", label(device), without_backtrace(why)));
        totals.iter::<i32>().map(|w| w as u32).collect()
    };
    let mut scales = Places::scales(&words(stride, &[MEASURE; PARTS]), 40.0);
    let mut found = words(1, &scales);
    if found[LOST] > 0 {
        // Some are much larger than those: all are looked at.
        scales = Places::scales(&words(1, &[MEASURE; PARTS]), 30.0);
        found = words(1, &scales);
    }
    places.read(&found, &scales, &view.scene, &view.wanted)
}
