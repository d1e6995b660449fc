//! Prepares a training step on a GPU: as a late step if the last render allows it.

use std::sync::Arc;

use burn::tensor::Tensor;

use super::prepare::{Prepared, collect_scenes, copy, prepare};
use crate::error::Result;
use crate::geometry::{host_values, now};
use crate::gpu::ViewPlaces;
use crate::render::batch::Batch;
use crate::render::cache::HierarchyCache;
use crate::render::late::{Late, serve};
use crate::render::options::{RenderOptions, sampler};
use crate::render::standing::{Group, Places, Preparing, Standing};
use crate::scene::Collect;
use softray_kernels::kernel::View;

/// Makes the views of a batch. If the host does not take the present values of tensors, the device places them.
pub(super) fn prepare_step(batch: &Batch, options: &RenderOptions) -> Result<Prepared> {
    let mut late = Late::new(batch, options);
    let cache = options.cache.clone().unwrap_or_default();
    if let Some(values) = late.values.take() {
        // The cache must not wait for a thread that keeps it alive.
        let options = options.clone().with_cache(&cache.of_scenes());
        late.preparing = prepare_later(with_values(batch, &cache, &values)?, options);
    }
    if let Some(views) = late.views.take() {
        let (views, lit) = views?;
        if serve(&views) {
            let views = views.into_iter().enumerate();
            let views =
                views.map(|(index, (view, places))| (as_now(&view, options, index), places));
            return Ok(Prepared {
                views: views.collect(),
                parent: Some(place(batch, &cache, &mut late)),
                context: batch.context()?,
                lit,
                groups: None,
                late,
            });
        }
        late.read();
    }
    if let Some(standing) = late.standing.take() {
        if let Some(prepared) = again(batch, options, &standing, &cache, &mut late) {
            return Ok(Prepared { late, ..prepared });
        }
        late.read();
    }
    let prepared = prepare(batch, options, true, None)?;
    Ok(Prepared { late, ..prepared })
}

/// Copies a batch to the host, with other `values` of its tracked tensors.
fn with_values(batch: &Batch, cache: &HierarchyCache, values: &[f64]) -> Result<Batch> {
    // The row begins with the batch's vertices, which are copied last.
    let tracked = batch.vertices.iter().filter(|v| v.1.is_tracked());
    let first: usize = tracked.map(|v| v.1.shape().num_elements()).sum();
    let take = async |row: Tensor<1>| {
        if row.dims() != [values.len()] {
            return host_values(&row);
        }
        let (vertices, others) = values.split_at(first);
        Ok([others, vertices].concat())
    };
    Ok(now(copy(batch, cache, take))?.batch(batch))
}

/// Lets another thread prepare the views of a batch on the host.
fn prepare_later(batch: Batch, options: RenderOptions) -> Option<Preparing> {
    Preparing::new(move || {
        let prepared = prepare(&batch, &options, true, None)?;
        Ok((prepared.views, prepared.lit))
    })
}

/// Returns a view with the random numbers of a render.
fn as_now(view: &View, options: &RenderOptions, index: usize) -> View {
    view.with_sampler(sampler(&options.of_view(index)))
}

/// Lets the device place the tracked tensors of a batch. Returns their row.
fn place(batch: &Batch, cache: &HierarchyCache, late: &mut Late) -> Tensor<1> {
    let mut row = Collect::default();
    collect_scenes(&mut row, batch);
    let parent = Tensor::cat(row.rows, 0);
    late.place(&parent, cache);
    parent
}

/// Makes the views again from those of the last render, in its buffers, or returns `None` if these are not on the
/// device.
fn again(
    batch: &Batch,
    options: &RenderOptions,
    last: &Standing,
    cache: &HierarchyCache,
    late: &mut Late,
) -> Option<Prepared> {
    let parent = place(batch, cache, late);
    let row = late.row.as_ref()?;
    let view = |(index, (view, places)): (usize, &(View, Places))| {
        (as_now(view, options, index), places.clone())
    };
    let views: Vec<(View, Places)> = last.views.iter().enumerate().map(view).collect();
    let mut buffers = cache.buffers.take(&last.context.device);
    let group = |(of, group): &Group| {
        let own = of.iter().map(|&v| as_places(&views[v]));
        let own: Vec<ViewPlaces> = own.collect();
        let packed = group.again(&own, row, buffers.next()?)?;
        Some((of.clone(), Arc::new(packed)))
    };
    let groups: Option<Vec<Group>> = last.groups.iter().map(group).collect();
    Some(Prepared {
        groups: Some(groups?),
        parent: Some(parent),
        context: last.context.clone(),
        lit: last.lit,
        views,
        late: Late::default(),
    })
}

/// Returns a view with the ranges of its tensors as GPU code takes them.
pub(super) fn as_places((view, places): &(View, Places)) -> ViewPlaces<'_> {
    (view, &places.scene, &places.camera)
}
