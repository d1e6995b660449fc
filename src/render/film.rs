//! The images that a render returns: radiance and further outputs.

use burn::tensor::kind::Basic;
use burn::tensor::{Int, Tensor};
use serde::{Deserialize, Serialize};

use super::outputs::Outputs;
use crate::error::Result;
use crate::geometry::{detached, host_values};
use crate::tensors::{Diagnostics, RayStatistics};

/// The program that computed an image; see [`Engine`](super::Engine).
///
/// [`Statistics`] has an example.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Program {
    /// Kernels on the host's cores.
    #[default]
    HostKernels,
    /// Kernels on the scene's device. The backward pass runs there too.
    DeviceKernels,
    /// Tensor operations on the scene's device.
    Tensors,
}

/// The cost of a render. Kernels on a GPU count rays only with
/// [`with_statistics`](super::RenderOptions::with_statistics); otherwise the counts are 0 or empty.
///
/// ```
/// use softray::prelude::*;
/// let (room, camera) = cornell_box(&Device::flex());
/// let options = RenderOptions::new(8, 8).with_samples(1).with_engine(Engine::Kernels);
/// let image = render(&room, &camera, &options.with_diagnostics())?;
/// assert_eq!(image.statistics.program, Program::HostKernels);
/// assert!(image.statistics.rays > 0);
/// assert_eq!(image.diagnostics.expect("diagnostics").degenerate_triangles, 0);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Statistics {
    /// The program that ran.
    pub program: Program,
    /// The number of camera, bounce and shadow rays.
    pub rays: u64,
    /// Softmax only: the number of tested pairs of ray and triangle.
    pub tested: u64,
    /// Softmax only: the number of surfaces that may contribute to a camera or bounce ray.
    pub surfaces: SurfacesPerRay,
    /// For each bounce the number of surviving paths, which traced a ray to their next surface.
    pub bounces: Vec<u64>,
}

/// Statistics of the number of surfaces that may contribute to a ray; 0 if all triangles are tested.
///
/// [`Visibility`](super::Visibility) has an example.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct SurfacesPerRay {
    /// The mean over rays.
    pub mean: f64,
    /// The 99th percentile over rays.
    pub percentile_99: f64,
    /// The maximum over rays.
    pub most: f64,
}

impl Statistics {
    pub(super) fn new(rays: &RayStatistics) -> Self {
        let total: u64 = rays.surfaces.iter().sum();
        let pairs = rays.surfaces.iter().enumerate();
        let sum: u64 = pairs.map(|(k, n)| k as u64 * n).sum();
        let mut below = 0;
        let percentile = rays.surfaces.iter().position(|n| {
            below += n;
            100 * below >= 99 * total
        });
        let most = rays.surfaces.len().saturating_sub(1);
        Self {
            program: Program::Tensors,
            rays: rays.rays,
            tested: rays.tested,
            surfaces: SurfacesPerRay {
                mean: sum as f64 / total.max(1) as f64,
                percentile_99: percentile.unwrap_or(0) as f64,
                most: most as f64,
            },
            bounces: rays.bounces.clone(),
        }
    }
}

/// A rendered image. All tensors but the albedo and the object ids are tracked if the scene or the camera has tracked tensors.
#[derive(Clone)]
pub struct Image {
    /// Linear RGB radiance `[H, W, 3]`, row 0 at the top.
    pub radiance: Tensor<3>,
    /// Opacity `[H, W]`, if requested or if depth or normals are: 1 − W_background, with the background's weight
    /// W_background over the primary rays.
    pub opacity: Option<Tensor<2>>,
    /// Depth `[H, W]`, if requested: the mean over the primary rays of the distance along them to the visible surface, in
    /// scene units, with 0 for rays that hit nothing. So it is linear in what a pixel sees, like the radiance, and so are
    /// its derivatives; [`unpremultiply`](super::unpremultiply) returns the mean over the rays that hit a surface.
    pub depth: Option<Tensor<2>>,
    /// Normals `[H, W, 3]`, if requested: the mean over the primary rays of the geometric normal of the visible surface,
    /// facing the camera, with 0 for rays that hit nothing (see [`Image::depth`]).
    pub normals: Option<Tensor<3>>,
    /// The albedo `[H, W, 3]`, if requested ([`RenderOptions::with_albedo`](super::RenderOptions::with_albedo)). It is
    /// not differentiable.
    pub albedo: Option<Tensor<3>>,
    /// Object ids `[H, W]`, if requested: the index of the object with the most weight, or −1 for the background. They
    /// are not differentiable.
    pub object_ids: Option<Tensor<2, Int>>,
    /// The cost of the render.
    pub statistics: Statistics,
    /// Counts of degenerate cases, if requested.
    pub diagnostics: Option<Diagnostics>,
}

impl Image {
    /// Returns an image of the columns with the given indices, which may repeat.
    pub(super) fn columns(self, which: Tensor<1, Int>) -> Self {
        Self {
            radiance: self.radiance.select(1, which.clone()),
            opacity: self.opacity.map(|t| t.select(1, which.clone())),
            depth: self.depth.map(|t| t.select(1, which.clone())),
            normals: self.normals.map(|t| t.select(1, which.clone())),
            albedo: self.albedo.map(|t| t.select(1, which.clone())),
            object_ids: self.object_ids.map(|t| t.select(1, which.clone())),
            statistics: self.statistics,
            diagnostics: self.diagnostics,
        }
    }

    /// Returns the mean radiance of each channel, computed on the host.
    ///
    /// # Errors
    /// If the tensor can't be read back.
    pub fn mean(&self) -> Result<[f64; 3]> {
        let values = host_values(&self.radiance)?;
        let n = (values.len() / 3) as f64;
        Ok(std::array::from_fn(|c| {
            values.iter().skip(c).step_by(3).sum::<f64>() / n
        }))
    }
}

/// The images of a batch. All tensors but the albedo and the object ids are tracked if a scene or a camera has tracked tensors.
///
/// [`render_batch`](super::render_batch) has an example.
#[derive(Clone)]
pub struct ImageBatch {
    /// Linear RGB radiance `[B, H, W, 3]`, row 0 at the top.
    pub radiance: Tensor<4>,
    /// Opacity `[B, H, W]`; see [`Image::opacity`].
    pub opacity: Option<Tensor<3>>,
    /// Depth `[B, H, W]`; see [`Image::depth`].
    pub depth: Option<Tensor<3>>,
    /// Normals `[B, H, W, 3]`; see [`Image::normals`].
    pub normals: Option<Tensor<4>>,
    /// The albedo `[B, H, W, 3]`; see [`Image::albedo`].
    pub albedo: Option<Tensor<4>>,
    /// Object ids `[B, H, W]`; see [`Image::object_ids`].
    pub object_ids: Option<Tensor<3, Int>>,
    /// The cost of each view.
    pub statistics: Vec<Statistics>,
    /// Counts of degenerate cases in each view; empty unless requested.
    pub diagnostics: Vec<Diagnostics>,
}

impl ImageBatch {
    /// The number of views.
    pub fn len(&self) -> usize {
        self.statistics.len()
    }

    /// Whether there is no view. A batch has at least one, so this is false.
    pub fn is_empty(&self) -> bool {
        self.statistics.is_empty()
    }

    /// Returns the image of one view. Compute a loss over all views from the tensors of the batch instead, since each
    /// slice adds a node to the graph.
    ///
    /// # Panics
    /// If `index` is out of range.
    pub fn view(&self, index: usize) -> Image {
        fn one<const D: usize, const E: usize, K: Basic>(
            t: &Tensor<D, K>,
            index: usize,
        ) -> Tensor<E, K> {
            match t.dims()[0] {
                1 if index == 0 => t.clone(),
                _ => t.clone().slice([index..index + 1]),
            }
            .squeeze_dim(0)
        }
        Image {
            radiance: one(&self.radiance, index),
            opacity: self.opacity.as_ref().map(|t| one(t, index)),
            depth: self.depth.as_ref().map(|t| one(t, index)),
            normals: self.normals.as_ref().map(|t| one(t, index)),
            albedo: self.albedo.as_ref().map(|t| one(t, index)),
            object_ids: self.object_ids.as_ref().map(|t| one(t, index)),
            statistics: self.statistics[index].clone(),
            diagnostics: self.diagnostics.get(index).cloned(),
        }
    }
}

/// Means over the samples of all pixels of all views.
pub(crate) struct Means {
    /// Shape `[B·P, C]`, channels in the order radiance, opacity, depth, normal, albedo, weights of objects and
    /// the background.
    pub mean: Tensor<2>,
    /// The number of channels with weights of objects, without the background.
    pub objects: usize,
    pub statistics: Vec<Statistics>,
    pub diagnostics: Vec<Diagnostics>,
}

impl Means {
    /// Splits the channels into images of width × height pixels, one for each view.
    pub fn images(self, [width, height]: [usize; 2], outputs: Outputs) -> ImageBatch {
        let plane = [self.statistics.len(), height, width];
        let [count, height, width] = plane;
        let channels = self.channels(plane, [count, height, width, 3], outputs);
        ImageBatch {
            radiance: channels.radiance,
            opacity: channels.opacity,
            depth: channels.depth,
            normals: channels.normals,
            albedo: channels.albedo,
            object_ids: channels.object_ids,
            statistics: self.statistics,
            diagnostics: self.diagnostics,
        }
    }

    /// Splits the channels of the only view.
    pub fn image(mut self, [width, height]: [usize; 2], outputs: Outputs) -> Image {
        let channels = self.channels([height, width], [height, width, 3], outputs);
        Image {
            radiance: channels.radiance,
            opacity: channels.opacity,
            depth: channels.depth,
            normals: channels.normals,
            albedo: channels.albedo,
            object_ids: channels.object_ids,
            statistics: self.statistics.swap_remove(0),
            diagnostics: self.diagnostics.pop(),
        }
    }

    /// Splits the channels into tensors of the shapes of one and of three channels.
    fn channels<const P: usize, const C: usize>(
        &self,
        plane: [usize; P],
        color: [usize; C],
        outputs: Outputs,
    ) -> Channels<P, C> {
        let all = self.mean.dims()[1];
        let mut next = 0;
        let mut take = |channels: usize| {
            next += channels;
            match channels {
                // No copy is needed for all channels.
                _ if channels == all => self.mean.clone(),
                _ => self.mean.clone().narrow(1, next - channels, channels),
            }
        };
        let plane_of = |t: Tensor<2>| t.reshape(plane);
        let color_of = |t: Tensor<2>| t.reshape(color);
        let radiance = color_of(take(3));
        let opacity = outputs.need_opacity().then(|| plane_of(take(1)));
        let depth = outputs.depth.then(|| plane_of(take(1)));
        let normals = outputs.normals.then(|| color_of(take(3)));
        let albedo = outputs.albedo.then(|| detached(&color_of(take(3))));
        let object_ids = outputs.object_ids.then(|| {
            let index = take(self.objects + 1).inner().argmax(1);
            let background = index.clone().equal_elem(self.objects as i64);
            index.mask_fill(background, -1).reshape(plane)
        });
        Channels {
            radiance,
            opacity,
            depth,
            normals,
            albedo,
            object_ids,
        }
    }
}

/// The channels of images, of P axes each, or C with colors.
struct Channels<const P: usize, const C: usize> {
    radiance: Tensor<C>,
    opacity: Option<Tensor<P>>,
    depth: Option<Tensor<P>>,
    normals: Option<Tensor<C>>,
    albedo: Option<Tensor<C>>,
    object_ids: Option<Tensor<P, Int>>,
}
