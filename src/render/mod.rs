//! `render()`: passes, tiles, averaging.

mod batch;
mod debug;
mod film;
mod kernel;
mod options;
mod overview;
mod replay;
mod tensors;

use std::sync::Arc;

use burn::tensor::{Device, Tensor};

use crate::error::{Error, Result};
use crate::scene::{Camera, Collect, ParameterId, Scene, Visit, visit_camera, visit_scene};
use crate::visibility::Visibility;

pub use crate::transport::{Diagnostics, EmitterSampling, Sampling, Sequence, SurfaceSampling};
pub use batch::{Batch, render_batch};
pub use film::{Image, ImageBatch, Statistics};
pub use options::{Engine, Progress, RenderOptions};
pub use overview::overview;
use tensors::Renderer;

/// Renders a scene.
///
/// The image is in the graph of every tensor of the scene and camera that requires a gradient:
/// vertices, transforms, velocities, materials, textures, lights, environment, camera pose, field
/// of view and lens. Without any such tensor, tiles run on all cores and no tape is recorded.
///
/// # Errors
/// If the scene, the camera or the options are not valid; nothing is rendered then.
pub fn render(scene: &Scene, camera: &Camera, options: &RenderOptions) -> Result<Image> {
    render_list(scene, camera, options, None)
}

/// Renders some pixels, numbers y·width + x of the image of the options, in any order: an image
/// with them side by side `[1, N, 3]`. Each has the paths that it has in the whole image.
///
/// # Errors
/// Like [`render`], or if a pixel lies outside of the image.
pub fn render_pixels(
    scene: &Scene,
    camera: &Camera,
    options: &RenderOptions,
    pixels: &[u32],
) -> Result<Image> {
    let count = options.width as u128 * options.height as u128;
    if let Some(p) = pixels.iter().find(|&&p| u128::from(p) >= count) {
        return Err(Error::invalid(
            "pixels",
            "pixel",
            p,
            format!("a number under {count}"),
        ));
    }
    if pixels.is_empty() {
        return Err(Error::invalid(
            "pixels",
            "list",
            "empty",
            "at least one pixel",
        ));
    }
    render_list(scene, camera, options, Some(Arc::new(pixels.to_vec())))
}

fn render_list(
    scene: &Scene,
    camera: &Camera,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<Image> {
    let batch = Batch::views(vec![scene.clone()], vec![(0, camera.clone())])?;
    let images = render_views(&batch, options, pixels);
    Ok(images
        .map_err(|e| match e {
            Error::OfBatch { source, .. } => *source,
            other => other,
        })?
        .single())
}

/// Renders pixels of all views; all pixels, if there is no list.
fn render_views(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<ImageBatch> {
    options.check()?;
    let size = match &pixels {
        Some(pixels) => [pixels.len(), 1],
        None => [options.width, options.height],
    };
    let all = size[0] as u128 * size[1] as u128 * batch.views.len() as u128;
    options.check_memory(all)?;
    let mut means = match options.visibility {
        Visibility::Cone { .. } if options.engine != Engine::Tensors => {
            kernel::render(batch, options, pixels)?
        }
        _ => tensors::render(batch, options, pixels)?,
    };
    means.mean = with_gradient(means.mean, batch);
    Ok(means.images(size, options.outputs))
}

/// What changes nothing has a gradient of 0, not none: a fit may pass such a place.
fn with_gradient(mean: Tensor<3>, batch: &Batch) -> Tensor<3> {
    if mean.is_tracked() {
        return mean;
    }
    let mut collected = Collect::default();
    for scene in &batch.scenes {
        visit_scene(&mut scene.clone(), &mut collected);
    }
    for (_, camera) in &batch.views {
        visit_camera(&mut camera.clone(), &mut collected);
    }
    for v in &batch.vertices {
        collected.visit(ParameterId::Vertices(0), &mut v.values.clone());
    }
    match collected.of_value_zero() {
        Some(nothing) => {
            let nothing = nothing.cast(mean.dtype()).reshape([1, 1, 1]);
            mean + nothing
        }
        None => mean,
    }
}

/// Whether tiles of rays gain from several host threads.
pub(crate) fn is_cpu(device: &Device) -> bool {
    let name = format!("{device:?}");
    name.contains("Flex") || name.contains("NdArray")
}
