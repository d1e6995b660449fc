//! Renders by kernels: all views of a batch are one node of the graph, from the tensors of scenes and
//! cameras to the images. The backward pass traces the paths again; memory does not grow with them.

mod backward;
mod forward;
mod prepare;
mod rows;

use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use burn::tensor::{DType, Tensor, TensorData};

use super::batch::Batch;
use super::film::{Means, Program, Statistics};
use super::node::{Derivative, attach};
use super::options::RenderOptions;
use crate::error::Result;
use crate::geometry::Context;
#[cfg(feature = "wgpu")]
use crate::geometry::host_values;
#[cfg(feature = "wgpu")]
use crate::gpu::{Job, pack};
use crate::kernel::View;
use crate::scene::{Camera, Scene};
use crate::tensors::Diagnostics;
use backward::Backward;
use forward::{Forward, Traced, camera_tiles};
use prepare::{Places, Prepared, prepare};
use rows::Rows;

/// The jumps of visibility in the gradient of a view's tensors (as one row), from the gradient of its rows
/// `[P, C]`.
pub(super) fn jumps(
    (scene, camera): (&Scene, &Camera),
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
    upstream: &TensorData,
) -> Result<Vec<f64>> {
    let batch = Batch::views(vec![scene.clone()], vec![(0, camera.clone())])?;
    let prepared = prepare(&batch, options, false)?;
    let size = prepared.parent.map_or(0, |p| p.dims()[0]);
    if !prepared.views.iter().any(|(view, _)| view.has_edges) {
        return Ok(vec![0.0; size]);
    }
    let objects = prepared.views[0].0.scene.lists.counted.len();
    let rows = Rows::new(options.outputs, objects);
    let backward = Backward::new(prepared.views, size, rows, options, pixels);
    Ok(backward.gradient(upstream))
}

/// Renders pixels of all views (all pixels, if there is no list).
pub(super) fn render(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<Means> {
    let Prepared {
        views,
        parent,
        context,
        lit,
    } = prepare(batch, options, true)?;
    let objects = views.iter().map(|(v, _)| v.scene.lists.counted.len()).max();
    let objects = objects.unwrap_or(0);
    let rows = Rows::new(options.outputs, objects);
    let count = match &pixels {
        Some(pixels) => pixels.len(),
        None => options.width * options.height,
    };
    let pass = (pixels.clone(), count);
    let (mut mean, traced, gpu) = trace(options, &views, &context, pass, &rows, parent.is_some())?;
    let program = match gpu {
        Some(_) => Program::DeviceKernels,
        None => Program::HostKernels,
    };
    // Where scenes have no light that was told already.
    if lit
        && pixels.is_none()
        && let Some(black) = traced.iter().position(|t| !t.lit)
    {
        log::warn!(
            "the image of view {black} is black though its scene has light: does the camera look at \
             something lit? Emitters shine from their front alone, and a closed object hides what is \
             inside of it"
        );
    }
    let asked = views.iter().zip(&traced).filter(|_| options.diagnostics);
    let diagnostics = asked.map(|((view, _), traced)| Diagnostics {
        degenerate_triangles: view.scene.degenerate(),
        non_finite_light: traced.non_finite,
        effective_surfaces: 1.0,
        ..Diagnostics::default()
    });
    let diagnostics = diagnostics.collect();
    let statistics = traced.into_iter().map(|t| Statistics {
        program,
        rays: t.counts.rays,
        bounces: t.counts.bounces,
        ..Statistics::default()
    });
    let statistics: Vec<Statistics> = statistics.collect();
    if let Some(parent) = parent {
        let size = parent.dims()[0];
        let derivative = match gpu {
            Some(gpu) => gpu.derivative(views, size),
            None => {
                let backward = Backward::new(views, size, rows, options, pixels);
                Derivative::Host(Box::new(move |upstream| backward.gradient(upstream)))
            }
        };
        mean = attach(parent, mean, derivative);
    }
    Ok(Means {
        mean: mean.reshape([statistics.len(), count, rows.count()]),
        objects,
        statistics,
        diagnostics,
    })
}

/// Groups of views whose images come from a GPU.
#[cfg(feature = "wgpu")]
struct Gpu {
    device: burn::tensor::Device,
    jobs: Vec<(std::ops::Range<usize>, Job)>,
}

/// Without GPUs there are none.
#[cfg(not(feature = "wgpu"))]
enum Gpu {}

impl Gpu {
    /// The gradient of so many numbers, there.
    fn derivative(self, views: Vec<(View, Places)>, numbers: usize) -> Derivative {
        #[cfg(feature = "wgpu")]
        return Derivative::Gpu(Box::new(move |upstream| {
            let views = views.iter().map(|(v, p)| (v, &*p.scene, &*p.camera));
            let views: Vec<_> = views.collect();
            crate::gpu::gradient_of(&self.device, upstream, &self.jobs, &views, numbers)
        }));
        #[cfg(not(feature = "wgpu"))]
        {
            let _ = (views, numbers);
            match self {}
        }
    }
}

/// The rows of all pixels of all views `[B·P, C]`, and what was counted: by kernels on the device where it is a GPU
/// and numbers are f32, else on the host.
fn trace(
    options: &RenderOptions,
    views: &[(View, Places)],
    context: &Context,
    (pixels, count): (Option<Arc<Vec<u32>>>, usize),
    rows: &Rows,
    with_gradient: bool,
) -> Result<(Tensor<2>, Vec<Traced>, Option<Gpu>)> {
    #[cfg(feature = "wgpu")]
    if context.dtype == DType::F32 && crate::device::runs_kernels(&context.device) {
        let all: Vec<&View> = views.iter().map(|v| &v.0).collect();
        let job = |(range, packed)| {
            let job = Job {
                views: Arc::new(packed),
                pixels: pixels.clone(),
                of_view: count,
                samples: options.samples,
                outputs: rows.for_gpu(),
            };
            (range, job)
        };
        let jobs: Vec<_> = pack(&all).into_iter().map(job).collect();
        let device = context.device.clone();
        crate::gpu::check(&device, jobs.iter().map(|j| &j.1), with_gradient)?;
        let images = jobs
            .iter()
            .map(|(_, job)| crate::gpu::trace(&device, job.clone()))
            .collect::<Result<_>>()?;
        let image = Tensor::cat(images, 0);
        // Light that is not black is not known before the image is read.
        let mut traced = vec![
            Traced {
                lit: true,
                ..Traced::default()
            };
            views.len()
        ];
        if options.statistics {
            for (range, job) in &jobs {
                let counts = crate::gpu::counts_of(&device, job)?;
                for (traced, counts) in traced[range.clone()].iter_mut().zip(counts) {
                    traced.counts = counts;
                }
            }
        }
        if options.diagnostics {
            let light = image.clone().slice([0..views.len() * count, 0..3]);
            let values = host_values(&light)?;
            for (traced, values) in traced.iter_mut().zip(values.chunks_exact(3 * count)) {
                traced.non_finite = values.iter().filter(|v| !v.is_finite()).count() as u64;
            }
        }
        return Ok((image, traced, Some(Gpu { device, jobs })));
    }
    #[cfg(not(feature = "wgpu"))]
    let _ = with_gradient;
    let tiles = camera_tiles(options, count);
    let pass = Forward {
        options,
        pixels: pixels.as_deref(),
        tiles: &tiles,
        rows,
        all: tiles.len() * views.len(),
        done: &AtomicUsize::new(0),
    };
    let (means, traced) = if context.dtype == DType::F64 {
        pass.views(views, count, |value| value)?
    } else {
        pass.views(views, count, |value| value as f32)?
    };
    let means = Tensor::from_data(means, (&context.device, context.dtype));
    Ok((means, traced, None))
}
