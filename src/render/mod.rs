//! Renders scenes with kernels or with tensor operations.

mod adaptive;
mod batch;
mod cache;
mod checks;
mod debug;
mod derivative;
mod film;
mod kernel;
#[cfg(feature = "gpu")]
mod late;
mod mistakes;
mod node;
mod options;
mod outputs;
mod overview;
#[cfg(feature = "remote")]
pub(crate) mod remote;
mod standing;
mod tangent;
mod tensors;
mod tiles;
mod values;

use std::collections::HashMap;
use std::sync::Arc;

use burn::tensor::Tensor;

use crate::error::{Error, Result};
use crate::geometry::host_values_async;
use crate::scene::{Camera, Collect, Material, Scene, Visit, look_at_scene, visit_camera};
use softray_kernels::host::ParameterId;

pub use crate::tensors::{Diagnostics, Sampling, SoftmaxOptions, SurfaceSampling, Visibility};
pub use batch::Batch;
pub use cache::HierarchyCache;
pub use derivative::{ImageDerivative, render_derivative};
pub(crate) use film::Means;
pub use film::{Image, ImageBatch, Program, Statistics, SurfacesPerRay};
pub use options::{Engine, RenderOptions};
pub use outputs::{Outputs, unpremultiply};
pub use overview::overview;
#[cfg(feature = "remote")]
pub(crate) use remote::client::finish;
#[doc(inline)]
pub use softray_kernels::sampling::{EmitterSampling, Sequence};
pub use tangent::Tangent;
#[cfg(feature = "fit")]
pub(crate) use values::Values;

/// Renders a scene and returns an image `[H, W, 3]`.
///
/// The image is in the autodiff graph of every tracked tensor of the scene and the camera: vertices, transforms,
/// velocities, materials, textures, lights, environment, camera pose, field of view and lens. Without a tracked tensor,
/// no tape is recorded. On the CPU, tiles run on all cores.
///
/// Gradients are first derivatives: burn has no others. The tensors of `backward()` are outside of any graph, so a loss
/// that is computed from a gradient has no derivative with respect to the scene (burn's `backward()` panics on a loss that
/// nothing tracks, and `grad` returns none or zeros). Gauss–Newton steps need none: [`render_derivative`] returns the first
/// derivatives of all pixels.
///
/// [`softray`](crate) has an example.
///
/// # Errors
/// If the scene, the camera or the options are not valid. Nothing is rendered then.
pub fn render(scene: &Scene, camera: &Camera, options: &RenderOptions) -> Result<Image> {
    render_list(scene, camera, options, None)
}

/// Renders a scene like [`render`], without waiting for the device: reads its tensors by `await`. In a web page, which
/// may not wait for a GPU, it replaces `render`.
///
/// The image is on the device of the scene, and so are its gradients. Read it by burn's
/// [`into_data_async`](Tensor::into_data_async). Some options read the image itself, and then wait:
/// [adaptive sampling](RenderOptions::with_adaptive), [statistics](RenderOptions::with_statistics) and
/// [diagnostics](RenderOptions::with_diagnostics). So does [`Visibility::softmax`], which reads the scene again.
///
/// # Errors
/// Like [`render`].
pub async fn render_async(
    scene: &Scene,
    camera: &Camera,
    options: &RenderOptions,
) -> Result<Image> {
    options.check_values()?;
    let batch = Batch::views(vec![scene.clone()], vec![(0, camera.clone())])?;
    #[cfg(feature = "remote")]
    if batch.is_remote() {
        return render(scene, camera, options);
    }
    let mut batch = batch.with_tangents().into_owned();
    let cache = options.cache.clone().unwrap_or_default();
    let copied = kernel::copy(&batch, &cache, host_values_async).await;
    batch.on_host = Some(single(copied)?);
    let (means, size) = single(tracked_means(&batch, options, None))?;
    Ok(means.image(size, options.outputs))
}

/// Renders a list of pixels and returns them side by side as an image `[1, N, 3]`.
///
/// `pixels` holds indices y·width + x into the image of the options, in any order, with or without repeats. Without
/// [adaptive sampling](RenderOptions::with_adaptive), each pixel has the same paths as in the whole image.
///
/// ```
/// use softray::prelude::*;
/// let (room, camera) = cornell_box(&Device::flex());
/// let options = RenderOptions::new(16, 16).with_samples(4);
/// // The upper corners.
/// let image = render_pixels(&room, &camera, &options, &[0, 15])?;
/// assert_eq!(image.radiance.dims(), [1, 2, 3]);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// Like [`render`], or if the list is empty or a pixel lies outside of the image.
pub fn render_pixels(
    scene: &Scene,
    camera: &Camera,
    options: &RenderOptions,
    pixels: &[u32],
) -> Result<Image> {
    let count = options.width as u128 * options.height as u128;
    let wrong =
        |field, found: &str, expected: &str| Err(Error::invalid("pixels", field, found, expected));
    if let Some(p) = pixels.iter().find(|&&p| u128::from(p) >= count) {
        return wrong("pixel", &p.to_string(), &format!("a number under {count}"));
    }
    if pixels.is_empty() {
        return wrong("list", "empty", "at least one pixel");
    }
    options.check_values()?;
    options.check_memory(pixels.len() as u128)?;
    // Each pixel is traced once, even if the list repeats it.
    let mut rows = HashMap::with_capacity(pixels.len());
    let mut distinct = Vec::with_capacity(pixels.len());
    let row = |&pixel: &u32| {
        *rows.entry(pixel).or_insert_with(|| {
            distinct.push(pixel);
            distinct.len() as i32 - 1
        })
    };
    let row_of_each: Vec<i32> = pixels.iter().map(row).collect();
    let all_distinct = distinct.len() == pixels.len();
    let image = render_list(scene, camera, options, Some(Arc::new(distinct)))?;
    if all_distinct {
        return Ok(image);
    }
    let device = image.radiance.device();
    Ok(image.columns(Tensor::from_data(row_of_each.as_slice(), &device)))
}

/// Renders all views of a batch and returns images `[B, H, W, 3]`.
///
/// Each view has its own random numbers ([`RenderOptions::of_view`]). Its image and gradients are those of [`render`]
/// with the scene, the camera and the options of the view.
///
/// The images are one node of the graph. On the CPU, views and tiles share all cores in both passes. On GPUs, kernels
/// trace all views at once.
///
/// ```
/// use softray::prelude::*;
///
/// let device = Device::flex();
/// let ball = shapes::icosphere(1, &device);
/// // A batch of three deformed balls, as a network predicts them.
/// let vertices = Tensor::stack::<3>(vec![ball.vertices.clone(); 3], 0);
/// let widths = Tensor::<1>::from_floats([0.8, 1.0, 1.2], &device).autodiff().require_grad();
/// let vertices = vertices * widths.clone().reshape([3, 1, 1]);
/// let scene = Scene::new()
///     .with_object(Object::new(ball).with_name("body"))
///     .with_environment([1.0, 1.0, 1.0]);
/// let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]).with_fov_y(40.0);
/// let batch = Batch::new(vec![scene; 3], vec![camera])?.with_vertices("body", vertices)?;
/// let options = RenderOptions::new(16, 16).with_samples(2).with_bounces(0);
/// let images = render_batch(&batch, &options)?;
/// assert_eq!(images.radiance.dims(), [3, 16, 16, 3]);
/// let gradients = images.radiance.mean().backward();
/// assert!(widths.grad(&gradients).is_some());
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// Like [`render`], with the index of the invalid scene or view. Nothing is rendered then.
pub fn render_batch(batch: &Batch, options: &RenderOptions) -> Result<ImageBatch> {
    let (means, size) = tracked_means(batch, options, None)?;
    Ok(means.images(size, options.outputs))
}

fn render_list(
    scene: &Scene,
    camera: &Camera,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<Image> {
    let batch = Batch::views(vec![scene.clone()], vec![(0, camera.clone())])?;
    let (means, size) = single(tracked_means(&batch, options, pixels))?;
    Ok(means.image(size, options.outputs))
}

/// Returns a result of a batch of one view; its errors name no part of the batch.
fn single<T>(result: Result<T>) -> Result<T> {
    result.map_err(|error| match error {
        Error::InBatch { source, .. } => *source,
        other => other,
    })
}

/// Returns the rows of the listed pixels of all views, or of all pixels without a list, as a part of the graph, and the
/// width and height of the images.
fn tracked_means(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<(Means, [usize; 2])> {
    let size = match &pixels {
        Some(pixels) => [pixels.len(), 1],
        None => [options.width, options.height],
    };
    let mut means = means(batch, options, pixels)?;
    means.mean = with_gradient(means.mean, batch);
    Ok((means, size))
}

/// Returns the rows of all pixels of all views.
pub(crate) fn means(
    batch: &Batch,
    options: &RenderOptions,
    pixels: Option<Arc<Vec<u32>>>,
) -> Result<Means> {
    options.check_values()?;
    let count = match &pixels {
        Some(pixels) => pixels.len() as u128,
        None => options.width as u128 * options.height as u128,
    };
    options.check_memory(count * batch.views.len() as u128)?;
    #[cfg(feature = "remote")]
    if batch.is_remote() {
        let channels = |objects| kernel::channels(options, objects);
        return remote::client::render(batch, options, pixels, channels);
    }
    let batch = &*batch.with_tangents();
    if !options.quiet {
        mistakes::warn_of_settings(batch, options);
    }
    let is_softmax = options.visibility.is_softmax();
    let refracts = batch.scenes.iter().any(Scene::refracts);
    let glows = |s: &Scene| {
        let mut materials = s.objects.iter().flat_map(|o| &o.materials);
        materials.any(Material::glows)
    };
    let glows = batch.scenes.iter().any(glows);
    if is_softmax && (refracts || glows) {
        let expected = if refracts {
            "Visibility::Cone, since the scene has a dielectric: the softmax's surfaces of closed objects are seen \
             from outside alone"
        } else {
            "Visibility::Cone, since a material's emission is a texture"
        };
        return Err(Error::invalid(
            "render options",
            "visibility",
            "Softmax",
            expected,
        ));
    }
    match options.engine {
        Engine::Tensors => tensors::render(batch, options, pixels),
        _ if is_softmax => tensors::render(batch, options, pixels),
        _ => kernel::render(batch, options, pixels),
    }
}

/// Attaches the images to all tracked tensors if they are not tracked yet. Tensors without influence then have a
/// gradient of 0 rather than none, which a fit may encounter.
fn with_gradient(mean: Tensor<2>, batch: &Batch) -> Tensor<2> {
    if mean.is_tracked() {
        return mean;
    }
    let mut collected = Collect::default();
    for scene in &batch.scenes {
        look_at_scene(scene, &mut collected);
    }
    for (_, camera) in &batch.views {
        visit_camera(&mut camera.clone(), &mut collected);
    }
    for (_, values) in &batch.vertices {
        collected.visit(ParameterId::Vertices(0), &mut values.clone());
    }
    let dtype = mean.dtype();
    match collected.tracked_zero() {
        Some(nothing) => mean + nothing.cast(dtype).reshape([1, 1]),
        None => mean,
    }
}
