//! Renders as chains of tensor operations, tile by tile: the softmax, and cones as the specification of
//! the kernels.

mod outputs;
mod renderer;
mod replay;
mod sight;

use std::sync::Arc;

use burn::tensor::Tensor;

use super::batch::{Batch, in_batch};
use super::film::{Means, Statistics};
use super::node::attach;
use super::options::RenderOptions;
use crate::error::Result;
use crate::geometry::detached;
use crate::scene::{
    Camera, Collect, Detach, Flattened, HostScene, Normalization, Scene, SceneFrame, visit_tensors,
};
use crate::transport::Diagnostics;
use crate::visibility::Visibility;
use renderer::{Found, TensorRenderer};
use replay::Replay;

/// Renders the views of a batch one after another.
pub(super) fn render(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<Means> {
    let mut rendered = Vec::with_capacity(batch.views.len());
    for (index, (scene, camera)) in batch.views.iter().enumerate() {
        let scene = batch.scene(*scene, true);
        let view = RenderedView::render(&scene, camera, &options.of_view(index), pixels.clone());
        rendered.push(view.map_err(in_batch("view", index))?);
    }
    let objects = rendered.iter().map(|v| v.objects).max().unwrap_or(0);
    let rows = rendered.iter().map(|v| {
        let rows = v.rows(objects, options.outputs.object_ids);
        rows.swap_dims(0, 1)
    });
    Ok(Means {
        mean: Tensor::stack(rows.collect(), 0),
        objects,
        statistics: rendered.iter().map(|v| v.statistics.clone()).collect(),
        diagnostics: rendered.into_iter().filter_map(|v| v.diagnostics).collect(),
    })
}

/// One view: means over samples `[C, P]`, and counts.
struct RenderedView {
    mean: Tensor<2>,
    objects: usize,
    statistics: Statistics,
    diagnostics: Option<Diagnostics>,
}

impl RenderedView {
    fn new(renderer: &TensorRenderer, mean: Tensor<2>, found: Found) -> Self {
        Self {
            mean,
            objects: renderer.scene.objects(),
            statistics: Statistics::new(&found.statistics),
            diagnostics: found.diagnostics,
        }
    }

    /// The rows, with weights of so many objects if there are any.
    fn rows(&self, objects: usize, with_objects: bool) -> Tensor<2> {
        let mean = self.mean.clone();
        if !with_objects || objects == self.objects {
            return mean;
        }
        let [rows, pixels] = mean.dims();
        let more = [objects - self.objects, pixels];
        let none = Tensor::zeros(more, (&mean.device(), mean.dtype()));
        let background = mean.clone().slice([rows - 1..rows]);
        Tensor::cat(vec![mean.slice([0..rows - 1]), none, background], 0)
    }

    fn render(
        scene: &Scene,
        camera: &Camera,
        options: &RenderOptions,
        pixels: Option<Arc<Vec<u32>>>,
    ) -> Result<Self> {
        let mut collected = Collect::default();
        visit_tensors(&mut scene.clone(), &mut camera.clone(), &mut collected);
        let (mut still, mut still_camera) = (scene.clone(), camera.clone());
        visit_tensors(&mut still, &mut still_camera, &mut Detach);
        let hard = matches!(options.visibility, Visibility::Cone { .. });
        let host = HostScene::new(&still)?;
        still_camera.check(Some(&host.context))?;
        let normalization = if hard {
            // As the kernels have it.
            let frame = SceneFrame::new(&host);
            Normalization {
                center: frame.centre.into(),
                radius: frame.unit,
            }
        } else {
            let given = options.normalization();
            given.unwrap_or_else(|| Normalization::new(&host))
        };
        let flattened = Flattened::new(&still, &host, &still_camera, normalization)?;
        let rays = pixels.clone();
        let renderer = TensorRenderer::new(&flattened, &still_camera, options, rays, None)?;
        let (mut mean, found) = renderer.render()?;
        if !collected.rows.is_empty() {
            // Forward without tape, backward on paths traced again.
            let parameters = Tensor::cat(collected.rows, 0);
            let replay = Replay {
                scene: scene.clone(),
                camera: camera.clone(),
                options: options.clone(),
                normalization,
                host,
                pixels,
                parameters: detached(&parameters),
                hierarchy: renderer.hierarchy(),
                hard,
            };
            mean = attach(parameters, mean, move |upstream| replay.gradient(upstream));
        }
        Ok(Self::new(&renderer, mean, found))
    }
}
