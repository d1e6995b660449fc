//! Renders with kernels. All views of a batch are one node of the graph, from the tensors of scenes and cameras to the
//! images. The backward pass traces the paths again, so memory does not grow with their number.

mod backward;
mod forward;
mod prepare;
mod rows;
#[cfg(feature = "gpu")]
mod step;
#[cfg(test)]
mod tests;
mod trace;

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use burn::tensor::{Tensor, TensorData};

use super::batch::Batch;
use super::film::{Means, Program, Statistics};
use super::node::{Derivative, attach};
use super::options::RenderOptions;
#[cfg(feature = "gpu")]
use super::standing::Group;
use super::standing::Places;
use crate::error::Result;
use crate::geometry::Context;
#[cfg(feature = "gpu")]
use crate::gpu::Job;
use crate::scene::{Camera, Scene};
use crate::tensors::Diagnostics;
use backward::Backward;
use forward::Traced;
use prepare::{Prepared, prepare};
pub(super) use prepare::{copy, on_gpu};
use rows::Rows;
use softray_kernels::host::ParameterId;
use softray_kernels::kernel::View;
use softray_kernels::warning;
use trace::{Jobs, Pass};

/// Returns the boundary terms of the gradient of a view's tensors (as one row) for the upstream gradient `[P, C]` of
/// its rows.
pub(super) fn jumps(
    (scene, camera): (&Scene, &Camera),
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
    upstream: &TensorData,
) -> Result<Vec<f64>> {
    let batch = Batch::views(vec![scene.clone()], vec![(0, camera.clone())])?;
    let prepared = prepare(&batch, options, false, None)?;
    let size = prepared.parent.map_or(0, |p| p.dims()[0]);
    if !prepared.views.iter().any(|(view, _)| view.has_edges) {
        return Ok(vec![0.0; size]);
    }
    let objects = prepared.views[0].0.scene.lists.counted.len();
    let rows = Rows::new(options.outputs, objects);
    let backward = Backward::new(prepared.views, size, rows, options, pixels);
    Ok(backward.gradient(upstream))
}

/// Renders a view with its derivatives along directions, each of which has numbers for some tensors. Returns the means
/// `[K + 1, P, C]`, which are K derivatives and then the image, and the program that computed them.
pub(super) fn derivatives(
    (scene, camera): (&Scene, &Camera),
    options: &RenderOptions,
    directions: &[&HashMap<ParameterId, Vec<f64>>],
) -> Result<(Tensor<3>, Program)> {
    let chosen: HashSet<ParameterId> = directions.iter().flat_map(|d| d.keys().copied()).collect();
    let batch = Batch::views(vec![scene.clone()], vec![(0, camera.clone())])?;
    let prepared = prepare(&batch.with_tangents(), options, true, Some(chosen))?;
    let size = prepared.parent.map_or(0, |p| p.dims()[0]);
    let (_, places) = &prepared.views[0];
    let places = places.scene.iter().chain(&places.camera);
    let mut rows = vec![vec![0.0; size]; directions.len()];
    for (id, range) in places {
        for (row, direction) in rows.iter_mut().zip(directions) {
            if let Some(values) = direction.get(id) {
                row[range.clone()].copy_from_slice(values);
            }
        }
    }
    let channels = Rows::new(options.outputs, 0);
    #[cfg(feature = "gpu")]
    if on_gpu(&prepared.context) {
        let pass = Pass {
            options,
            views: &prepared.views,
            context: &prepared.context,
            rows: &channels,
            pixels: None,
            count: options.width * options.height,
            groups: None,
            row: None,
        };
        return Ok((pass.derivatives(&rows)?, Program::DeviceKernels));
    }
    let backward = Backward::new(prepared.views, size, channels, options, None);
    let all = backward.derivatives(&rows);
    let shape = [all.len() / (directions.len() + 1), directions.len() + 1];
    let all = prepared.context.tensor(&all, shape).transpose();
    let pixels = options.width * options.height;
    let count = channels.derived();
    let all = all.reshape([directions.len() + 1, pixels, count]);
    Ok((all, Program::HostKernels))
}

/// The number of channels of the rows of scenes with at most so many objects.
#[cfg(feature = "remote")]
pub(super) fn channels(options: &RenderOptions, objects: usize) -> usize {
    Rows::new(options.outputs, objects).count()
}

/// Renders the listed pixels of all views, or all pixels without a list.
pub(super) fn render(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<Means> {
    #[cfg(feature = "gpu")]
    let prepared = step::prepare_step(batch, options)?;
    #[cfg(not(feature = "gpu"))]
    let prepared = prepare(batch, options, true, None)?;
    let Prepared {
        views,
        parent,
        context,
        lit,
        #[cfg(feature = "gpu")]
        groups,
        #[cfg(feature = "gpu")]
        late,
    } = prepared;
    let objects = views.iter().map(|(v, _)| v.scene.lists.counted.len()).max();
    let objects = objects.unwrap_or(0);
    let rows = Rows::new(options.outputs, objects);
    let count = match &pixels {
        Some(pixels) => pixels.len(),
        None => options.width * options.height,
    };
    let pass = Pass {
        options,
        views: &views,
        context: &context,
        rows: &rows,
        pixels: pixels.clone(),
        count,
        #[cfg(feature = "gpu")]
        groups: groups.as_deref(),
        #[cfg(feature = "gpu")]
        row: late.row.as_ref(),
    };
    let ((mut mean, traced), jobs) = pass.trace(parent.is_some().then_some(0))?;
    let program = match jobs {
        Some(_) => Program::DeviceKernels,
        None => Program::HostKernels,
    };
    // Scenes without light have their own warning.
    if lit && !options.quiet && pixels.is_none() {
        warn_of_black_images(&traced);
    }
    let diagnosed = views.iter().zip(&traced).filter(|_| options.diagnostics);
    let diagnostics = diagnosed.map(|((view, _), traced)| Diagnostics {
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
        let derivative = match jobs {
            Some(jobs) => {
                let views = Arc::new(views);
                #[cfg(feature = "gpu")]
                if let Some(cache) = &options.cache {
                    late.keep(cache, &views, &groups_of(&jobs), (&context, lit));
                }
                of_jobs(jobs, &context, views, size)
            }
            None => {
                let backward = Backward::new(views, size, rows, options, pixels);
                Derivative::Host(Box::new(move |upstream| backward.gradient(upstream)))
            }
        };
        mean = attach(parent.into_dispatch(), mean, derivative);
    }
    Ok(Means {
        mean,
        objects,
        statistics,
        diagnostics,
    })
}

/// Warns of a view of a scene with light whose image is black.
fn warn_of_black_images(traced: &[Traced]) {
    if let Some(black) = traced.iter().position(|t| !t.lit) {
        warning!(
            "the image of view {black} is black though its scene has light: does the camera look at \
             something lit? Emitters shine from their front alone, and a closed object hides what is \
             inside of it"
        );
    }
}

/// The groups of views that jobs trace.
#[cfg(feature = "gpu")]
fn groups_of(jobs: &Jobs) -> Vec<Group> {
    let group = |(views, job): &(Vec<usize>, Job)| (views.clone(), job.views.clone());
    jobs.iter().map(group).collect()
}

/// The derivative on a GPU with respect to `numbers` parameters.
fn of_jobs(
    jobs: Jobs,
    context: &Context,
    views: Arc<Vec<(View, Places)>>,
    numbers: usize,
) -> Derivative {
    #[cfg(feature = "gpu")]
    {
        let device = context.device.clone();
        Derivative::Gpu(Box::new(move |upstream| {
            let views: Vec<_> = views.iter().map(step::as_places).collect();
            crate::gpu::gradient_of(&device, upstream, &jobs, &views, numbers)
        }))
    }
    #[cfg(not(feature = "gpu"))]
    {
        let _ = (context, views, numbers);
        match jobs {}
    }
}
