//! Renders with tensor operations, tile by tile. This implements the softmax, and cones as the specification of the
//! kernels.

mod outputs;
mod renderer;
mod replay;

use std::sync::Arc;

use burn::tensor::Tensor;

use super::batch::{Batch, in_batch};
use super::film::{Means, Statistics};
use super::node::{Derivative, attach};
use super::options::RenderOptions;
use crate::error::Result;
use crate::geometry::detached;
use crate::scene::{Camera, Collect, Detach, Flattened, Normalization, Scene, visit_tensors};
use renderer::{TensorRenderer, Traced};
use replay::Replay;
use softray_kernels::host::SceneFrame;

/// Renders the views of a batch one after another.
pub(super) fn render(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<Means> {
    let mut views = Vec::with_capacity(batch.views.len());
    for (index, (scene, camera)) in batch.views.iter().enumerate() {
        let scene = batch.scene(*scene, true);
        let view = render_view(&scene, camera, &options.of_view(index), pixels.clone());
        views.push(view.map_err(in_batch("view", index))?);
    }
    let objects = views.iter().map(|v| v.0).max().unwrap_or(0);
    let rows = views.iter().map(|(own, traced)| {
        let rows = traced.rows.clone().swap_dims(0, 1);
        if !options.outputs.object_ids || *own == objects {
            return rows;
        }
        // Views with fewer objects get weights of 0 for the missing ones. The background is last.
        let [pixels, all] = rows.dims();
        let none = Tensor::zeros([pixels, objects - own], (&rows.device(), rows.dtype()));
        let background = rows.clone().narrow(1, all - 1, 1);
        Tensor::cat(vec![rows.narrow(1, 0, all - 1), none, background], 1)
    });
    Ok(Means {
        mean: Tensor::cat(rows.collect(), 0),
        objects,
        statistics: views
            .iter()
            .map(|v| Statistics::new(&v.1.statistics))
            .collect(),
        diagnostics: views.into_iter().filter_map(|v| v.1.diagnostics).collect(),
    })
}

/// Renders one view. Returns the number of its objects, and means over samples.
fn render_view(
    scene: &Scene,
    camera: &Camera,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<(usize, Traced)> {
    let mut collected = Collect::default();
    visit_tensors(&mut scene.clone(), &mut camera.clone(), &mut collected);
    if !collected.rows.is_empty() {
        options.check_gradient()?;
    }
    let (mut still, mut still_camera) = (scene.clone(), camera.clone());
    visit_tensors(&mut still, &mut still_camera, &mut Detach);
    let (host, context) = still.read_back()?;
    still_camera.check(Some(&context))?;
    let normalization = if !options.visibility.is_softmax() {
        // The same as in the kernels.
        let frame = SceneFrame::new(&host);
        Normalization {
            center: frame.center.into(),
            radius: frame.unit,
        }
    } else {
        let given = options.normalization();
        given.unwrap_or_else(|| Normalization::new(&host))
    };
    let flattened = Flattened::new(&still, (&host, &context), &still_camera, normalization)?;
    let rays = pixels.clone();
    let renderer = TensorRenderer::new(&flattened, &still_camera, options, rays, None)?;
    let [tiles, replayed] = renderer.tiles()?;
    let mut traced = renderer.render(&tiles)?;
    if !collected.rows.is_empty() {
        // The forward pass has no tape. The backward pass traces the paths again.
        let parameters = Tensor::cat(collected.rows, 0);
        let replay = Replay {
            scene: scene.clone(),
            camera: camera.clone(),
            options: options.clone(),
            normalization,
            host,
            context,
            pixels,
            parameters: detached(&parameters),
            hierarchy: renderer.hierarchy(),
            tiles: replayed,
        };
        let derivative = Derivative::Host(Box::new(move |upstream| replay.gradient(upstream)));
        traced.rows = attach(parameters.into_dispatch(), traced.rows, derivative);
    }
    Ok((flattened.objects(), traced))
}
