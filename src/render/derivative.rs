//! Images with their derivatives along directions: forward mode.

use std::collections::HashSet;

use burn::tensor::Tensor;

use super::film::{Image, ImageBatch, Means, Program, Statistics};
use super::kernel;
use super::options::{Engine, RenderOptions};
use super::tangent::{OnDevice, Tangent, with_tangents};
use crate::error::{Error, Result};
use crate::scene::{Camera, Scene, check_devices, host_device, visit_tensors};

/// An image and its derivatives, by [`render_derivative`].
#[derive(Clone, Debug)]
pub struct ImageDerivative {
    /// The image, from the same samples as its derivatives.
    pub image: Image,
    /// For each direction an image of derivatives, in the order of the directions: of radiance `[K, H, W, 3]`, and of
    /// opacity, depth and normals if requested.
    pub tangents: ImageBatch,
}

/// Renders an image and its derivatives along directions of the scene and the camera: Jacobian-vector products.
///
/// This is the forward mode of differentiation. Its cost grows slowly with the number of directions, and not with the
/// number of pixels; that of `backward()` is the other way round. The paths and the edges are those of a backward pass. So
/// ⟨w, J·v⟩ = ⟨Jᵀ·w, v⟩ for a loss with the derivatives w with respect to pixels: in the mean over seeds, and without
/// [adaptive edges](RenderOptions::with_adaptive_edges) to rounding if all entries of w have the same absolute value.
/// (Otherwise a backward pass draws more edges where w is larger.)
///
/// Directions come from [`Tangent::new`] or from [`Tangent::of_numbers`].
///
/// ```
/// use softray::prelude::*;
///
/// let device = Device::flex();
/// // A ball by its position in x.
/// let build = |values: &[f64]| {
///     let ball = shapes::icosphere(2, &device).translated([values[0], 0.0, 0.0]);
///     let scene = Scene::new().with_object(Object::new(ball)).with_environment([1.0; 3]);
///     Ok((scene, Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]).with_fov_y(40.0)))
/// };
/// let (scene, camera, tangents) = Tangent::of_numbers(&[0.0], build)?;
/// let options = RenderOptions::new(16, 16).with_samples(16).with_bounces(0);
/// let derivative = render_derivative(&scene, &camera, &options, &tangents)?;
/// let by_x = derivative.tangents.view(0).radiance;
/// // The darker ball moves to the right: pixels become brighter at its left edge and darker at its right edge.
/// let half = |columns| by_x.clone().slice([0..16, columns]).mean().into_scalar::<f32>();
/// assert!(half(0..8) > 0.0 && half(8..16) < 0.0);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// On a GPU the kernels of the backward pass compute it, and all images stay on the device; as in a render, the scene is
/// read back once. Otherwise, and for f64 tensors on a GPU, the kernels of the host do, on all cores; the images are
/// copied to the scene's device. With the same seed the same call has the same result to the bit. Memory does not grow
/// with the number of samples. Gradients do not flow through the result. Albedos and object ids have no derivative and
/// are not rendered; [`RenderOptions::with_adaptive`], [`with_statistics`](RenderOptions::with_statistics) and
/// [`with_diagnostics`](RenderOptions::with_diagnostics) have no effect.
///
/// # Errors
/// Like [`render`](super::render); if there is no direction, a direction does not fit the scene, or the options have the
/// softmax or [`Engine::Tensors`]. On a GPU, if the tangents or the sums of derivatives (20 bytes for each pixel, channel
/// and direction) are larger than a buffer may be.
pub fn render_derivative(
    scene: &Scene,
    camera: &Camera,
    options: &RenderOptions,
    tangents: &[Tangent],
) -> Result<ImageDerivative> {
    let wrong = |field: &str, found: &str, expected: &str| {
        Err(Error::invalid("render_derivative", field, found, expected))
    };
    if tangents.is_empty() {
        return wrong("tangents", "empty", "at least one direction");
    }
    if options.visibility.is_softmax() {
        return wrong("visibility", "Softmax", "Visibility::Cone");
    }
    if options.engine == Engine::Tensors {
        return wrong("engine", "Tensors", "Engine::Kernels or Engine::Auto");
    }
    let mut options = options.clone();
    options.outputs.albedo = false;
    options.outputs.object_ids = false;
    options.adaptive = false;
    options.statistics = false;
    options.diagnostics = false;
    options.check_values()?;
    options.check_gradient()?;
    let pixels = options.width as u128 * options.height as u128;
    options.check_memory(pixels * (tangents.len() as u128 + 1))?;
    let context = check_devices(scene)?;
    let completed = tangents.iter().map(|t| t.clone().completed(scene, camera));
    let tangents = completed.collect::<Result<Vec<Tangent>>>()?;
    let chosen: HashSet<_> = tangents
        .iter()
        .flat_map(|t| t.values.keys().copied())
        .collect();
    let (mut scene, mut camera) = (with_tangents(scene), camera.clone());
    let on_host = host_device().filter(|_| !kernel::on_gpu(&context));
    let mut on_device = OnDevice {
        device: on_host.as_ref().unwrap_or(&context.device),
        dtype: context.dtype,
        chosen: &chosen,
    };
    visit_tensors(&mut scene, &mut camera, &mut on_device);
    let directions: Vec<_> = tangents.iter().map(|t| &t.values).collect();
    let (means, program) = kernel::derivatives((&scene, &camera), &options, &directions)?;
    let means = means.to_device(&context.device);
    Ok(images(means, program, &options))
}

/// Makes images of the means `[K + 1, P, C]`, the last of which are the values.
fn images(means: Tensor<3>, program: Program, options: &RenderOptions) -> ImageDerivative {
    let count = means.dims()[0];
    let size = [options.width, options.height];
    let values = means.clone().narrow(0, count - 1, 1);
    let tangents = means.narrow(0, 0, count - 1);
    let statistics = Statistics {
        program,
        ..Statistics::default()
    };
    let of = |mean: Tensor<3>| {
        let [views, pixels, channels] = mean.dims();
        let means = Means {
            mean: mean.reshape([views * pixels, channels]),
            objects: 0,
            statistics: vec![statistics.clone(); views],
            diagnostics: Vec::new(),
        };
        means.images(size, options.outputs)
    };
    ImageDerivative {
        image: of(values).view(0),
        tangents: of(tangents),
    }
}
