//! The options of a render.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use burn::config::Config;
use serde::{Deserialize, Serialize};

use super::adaptive::MAX_SAMPLES_RATIO;
use super::cache::HierarchyCache;
use super::outputs::Outputs;
use crate::scene::Normalization;
use crate::tensors::{Sampling, Visibility};
use softray_kernels::sampling::Sampler;

/// The program that computes a render. For cones and the same seed, all give the same image, up to rounding.
///
/// [`Statistics`](super::Statistics) has an example.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Engine {
    /// Kernels for [`Visibility::Cone`], tensor operations for [`Visibility::Softmax`]. The default.
    #[default]
    Auto,
    /// Kernels with hand-written derivatives. They run on a GPU if the scene's tensors are f32 and on one, and on the
    /// host otherwise. They support cones only: the softmax is an error.
    Kernels,
    /// Tensor operations on the scene's device, with burn's autodiff. This engine is the specification of the kernels,
    /// and much slower. For cones, the host intersects rays with triangles, and the kernels add the boundary terms of
    /// gradients.
    Tensors,
}

/// The options of a render.
///
/// burn's [`Config`] saves and loads them as files. A file does not contain the cache and the progress callback. Fields
/// that a file omits have their defaults.
///
/// ```
/// use burn::config::Config;
/// use softray::prelude::*;
/// let options = RenderOptions::new(64, 48).with_samples(4).with_depth();
/// let path = std::env::temp_dir().join(format!("softray-{}.json", std::process::id()));
/// options.save(&path).expect("a file");
/// let loaded = RenderOptions::load(&path).expect("options");
/// # std::fs::remove_file(&path).expect("a file");
/// assert_eq!(format!("{loaded:?}"), format!("{options:?}"));
/// assert!(loaded.outputs.depth && !loaded.outputs.normals);
/// let few: RenderOptions = serde_json::from_str(r#"{"width": 64, "height": 48, "samples": 4}"#)
///     .expect("options");
/// assert_eq!((few.samples, few.bounces), (4, 3));
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default = "RenderOptions::without_size", deny_unknown_fields)]
#[non_exhaustive]
pub struct RenderOptions {
    /// The width of images in pixels.
    pub width: usize,
    /// The height of images in pixels.
    pub height: usize,
    /// See [`RenderOptions::with_samples`].
    pub samples: u32,
    /// See [`RenderOptions::with_bounces`].
    pub bounces: u32,
    /// See [`RenderOptions::with_visibility`].
    pub visibility: Visibility,
    /// See [`RenderOptions::with_engine`].
    pub engine: Engine,
    /// The half-angle of all cones, including those of camera rays, in degrees ([`RenderOptions::with_blur`]). It replaces
    /// the angle of `visibility`.
    pub blur: Option<f64>,
    /// See [`RenderOptions::with_sampling`].
    pub sampling: Sampling,
    /// See [`RenderOptions::with_seed`].
    pub seed: u64,
    /// The bounce after which paths may end at random ([`RenderOptions::with_russian_roulette`]).
    pub roulette_after: Option<u32>,
    /// The limit of indirect light ([`RenderOptions::with_indirect_clamp`]).
    pub indirect_clamp: Option<f64>,
    /// The least roughness after the first surface ([`RenderOptions::with_path_regularization`]).
    pub path_regularization: Option<f64>,
    /// See [`RenderOptions::with_rays_per_tile`].
    pub rays_per_tile: Option<usize>,
    /// See [`RenderOptions::with_adaptive`].
    pub adaptive: bool,
    /// See [`RenderOptions::with_adaptive_edges`].
    pub adaptive_edges: bool,
    /// The index of a pass and the number of passes ([`RenderOptions::with_pass`]).
    pub pass: Option<(u32, u32)>,
    /// The normalization of the softmax to use if it has no bounds.
    #[serde(skip)]
    normalization: Option<Normalization>,
    /// The outputs in addition to radiance.
    pub outputs: Outputs,
    /// See [`RenderOptions::with_diagnostics`].
    pub diagnostics: bool,
    /// See [`RenderOptions::with_statistics`].
    pub statistics: bool,
    #[serde(skip)]
    pub(super) cache: Option<HierarchyCache>,
    #[serde(skip)]
    pub(super) progress: Progress,
    /// Whether likely mistakes cause no warnings.
    #[serde(skip)]
    pub(super) quiet: bool,
    /// See [`RenderOptions::with_memory_limit`].
    pub memory_limit: u64,
}

impl Config for RenderOptions {}

/// The callback that runs after each tile.
#[derive(Clone, Default)]
pub(super) struct Progress(Option<Arc<dyn Fn(usize, usize) + Send + Sync>>);

impl Progress {
    /// Counts one more finished tile of `all` and runs the callback.
    pub fn tile(&self, done: &AtomicUsize, all: usize) {
        let n = done.fetch_add(1, Ordering::Relaxed) + 1;
        if let Some(call) = &self.0 {
            call(n, all);
        }
    }
}

impl fmt::Debug for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "called" } else { "none" })
    }
}

/// Defines methods that set one field each: `name(argument) field = value`.
macro_rules! setters {
    ($($(#[$doc:meta])* $name:ident($($argument:ident: $type:ty),*) $($field:ident).+ = $value:expr;)*) => {$(
        $(#[$doc])*
        pub fn $name(mut self $(, $argument: $type)*) -> Self {
            self.$($field).+ = $value;
            self
        }
    )*};
}

impl RenderOptions {
    /// Options for an image of `width` × `height` pixels, with 16 samples, 3 bounces, cones of angle 0 and seed 0.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            samples: 16,
            bounces: 3,
            visibility: Visibility::default(),
            engine: Engine::default(),
            blur: None,
            sampling: Sampling::default(),
            seed: 0,
            roulette_after: None,
            indirect_clamp: None,
            path_regularization: None,
            rays_per_tile: None,
            adaptive: false,
            adaptive_edges: true,
            pass: None,
            normalization: None,
            outputs: Outputs::default(),
            diagnostics: false,
            statistics: false,
            cache: None,
            progress: Progress::default(),
            quiet: false,
            memory_limit: 4 << 30,
        }
    }

    /// The defaults of a file. [`Self::check`] returns an error if the file omits the size.
    fn without_size() -> Self {
        Self::new(0, 0)
    }

    setters! {
        /// Sets the number of samples (paths) per pixel; 16 by default, at least 1.
        with_samples(samples: u32) samples = samples;
        /// Sets the number of bounces after the first visible surface; 3 by default, at most 10,000. 0 is direct light
        /// only.
        with_bounces(bounces: u32) bounces = bounces;
        /// Sets the program that computes the render; [`Engine::Auto`] by default.
        with_engine(engine: Engine) engine = engine;
        /// Sets how random numbers, surfaces and emitters are sampled.
        with_sampling(sampling: Sampling) sampling = sampling;
        /// Sets the seed of the random numbers; 0 by default. The same seed gives the same image.
        with_seed(seed: u64) seed = seed;
        /// Enables Russian roulette after the given bounce and every later one (0: after the first visible surface).
        /// A path continues with a probability of its largest throughput component, clamped to [0.05, 1]. Off by
        /// default.
        with_russian_roulette(after: u32) roulette_after = Some(after);
        /// Limits indirect light against fireflies: single bright pixels, in which a rare path found a small bright lamp.
        /// The light that reaches the camera from one lamp or the environment by one point of a path is scaled down
        /// until its largest component is at most `radiance`. The hue stays. The first visible surface and its direct
        /// light are not limited. Off by default.
        ///
        /// The image becomes darker where light is limited: mostly caustics, and lamps seen through glass or by two
        /// mirrors, become darker. A limit of several times the brightness of the image costs little light. Gradients and
        /// the softmax return an error.
        with_indirect_clamp(radiance: f64) indirect_clamp = Some(radiance);
        /// Sets the least roughness, in (0, 1], of the surfaces that light meets before the last one on its way to the camera
        /// (path-space regularization: Kaplanyan and Dachsbacher 2013). It removes fireflies of caustics from images and
        /// gradients alike: light that a polished surface throws on others. The gradient is that of the regularized image.
        /// Off by default.
        ///
        /// The first surface that a camera ray meets has its own roughness, and so has the inside of glass behind it: what is
        /// seen directly and through one body of glass stays sharp. Caustics and reflections of reflections become
        /// blurred. Phong's exponent n counts as a roughness of (2/(n + 2))^¼.
        ///
        /// For fits of scenes with polished surfaces, a value of 0.3 is recommended
        /// ([`Fit`](crate::optim::Fit)).
        with_path_regularization(roughness: f64) path_regularization = Some(roughness);
        /// Enables adaptive sampling: each pixel has between ¼ and 16 times [`samples`](Self::samples) paths. Off by
        /// default.
        ///
        /// Pixels have more paths where the image is noisier and where paths have fewer rays. A render takes about as
        /// long as without. Two pilot images, each with 1/64 of the samples, measure the noise. They are
        /// not part of the result, so each pixel's mean is unbiased. If they show that little would be gained, all
        /// pixels have `samples` paths. Adaptive sampling pays off if few pixels hold most of the noise, such as
        /// penumbras and the outlines of lamps.
        ///
        /// Gradients, lists of pixels ([`render_pixels`](super::render_pixels)) and renders with fewer than 32 samples
        /// use `samples` paths for each pixel. With the softmax, [`Engine::Tensors`] or more than 2²⁴ samples, a render
        /// returns an error.
        with_adaptive() adaptive = true;
        /// Enables or disables adaptive numbers of edge samples in gradients (enabled by default).
        ///
        /// There are three kinds of edges: of shadows, of reflected light, and on the film. An eighth of the pixels
        /// measures the variance and the cost of each kind. In the other pixels each kind has ⅛ to 8 times its usual
        /// number of samples. Gradients stay reproducible, and unbiased up to the dependence of pixels
        /// that share a low-discrepancy sequence. GPUs use the usual numbers, and so does a view
        /// in which the loss depends on fewer than 8,192 paths.
        with_adaptive_edges(adaptive: bool) adaptive_edges = adaptive;
        /// Renders one of several passes over the image for progressive rendering: pass `index` of `passes` has its own
        /// samples, `samples / passes` of each pixel, and the mean of the radiance (and opacity) of all passes is that with
        /// all samples, up to rounding. Depths and normals are means over what each pass hit. A program can thus show
        /// an image while it refines, or stop and resume.
        ///
        /// `samples` must be a multiple of `passes`. Gradients, adaptive sampling, the softmax and [`Engine::Tensors`]
        /// return an error.
        ///
        /// ```
        /// use softray::prelude::*;
        /// let (room, camera) = cornell_box(&Device::flex());
        /// let options = RenderOptions::new(16, 16).with_samples(64);
        /// let whole = render(&room, &camera, &options)?.radiance;
        /// let mut sum = Tensor::<3>::zeros([16, 16, 3], &Device::flex());
        /// for pass in 0..4 {
        ///     sum = sum + render(&room, &camera, &options.clone().with_pass(pass, 4))?.radiance;
        ///     let _preview = sum.clone() / f64::from(pass + 1);
        /// }
        /// assert!((sum / 4.0 - whole).abs().max().into_scalar::<f32>() < 1e-5);
        /// # Ok::<(), softray::Error>(())
        /// ```
        with_pass(index: u32, passes: u32) pass = Some((index, passes));
        /// Sets the maximum number of camera rays per tile, at least 1. It bounds the memory of a render without
        /// gradient: each host thread processes one tile at a time. By default host kernels use 8,192, and tensors
        /// choose it from the number of triangles that they pair with a ray. Kernels on a GPU ignore it.
        with_rays_per_tile(rays: usize) rays_per_tile = Some(rays);
        /// Sets the maximum size in bytes of the images of a call; 4 GiB by default. Larger images are an error before
        /// anything is rendered. The size counts radiance, opacity, depth, normals and albedo, at 4 bytes per number.
        with_memory_limit(bytes: u64) memory_limit = bytes;
        /// Also returns the opacity `[H, W]`: the fraction of a pixel that surfaces cover, 0 to 1.
        with_opacity() outputs.opacity = true;
        /// Also returns the depth `[H, W]`: the mean over the primary rays of the distance along them to the surface that
        /// they hit, in scene units, and of 0 for rays that hit nothing. The opacity is returned, too:
        /// [`unpremultiply`](super::unpremultiply) converts the depth to the mean over the rays that hit a surface.
        /// PyTorch3D's `zbuf` differs: it is measured along the view axis.
        /// [`Camera::axial_depth`](crate::scene::Camera::axial_depth) converts the depth to it.
        with_depth() outputs.depth = true;
        /// Also returns normals `[H, W, 3]`: the mean over the primary rays of the geometric normal of the surface that
        /// they hit, on the side that faces the camera, in scene axes, and of 0 for rays that hit nothing. The opacity is
        /// returned, too, for [`unpremultiply`](super::unpremultiply).
        with_normals() outputs.normals = true;
        /// Also returns the albedo `[H, W, 3]`, an input of denoisers in the form that Open Image Denoise takes: the mean
        /// color, in [0, 1], of the surfaces that primary rays hit, whatever light falls on them. It is the albedo of
        /// both lobes for Phong, the base color for metallic–roughness, the reflectance along the normal for a
        /// conductor and the tint for a dielectric (1 for clear glass). Emitters add their emission before the limit
        /// of 1. The background counts as 0. The albedo has no gradient.
        with_albedo() outputs.albedo = true;
        /// Also returns object ids `[H, W]`: the index, in the scene's order, of the object that covers most of a
        /// pixel, or −1 for the background. Ids have no gradient.
        with_object_ids() outputs.object_ids = true;
        /// Also counts degenerate cases ([`Diagnostics`](super::Diagnostics)). This slows down the softmax.
        with_diagnostics() diagnostics = true;
        /// Also counts the rays of images that GPU kernels render ([`Statistics`](super::Statistics)). This traces
        /// their paths once more and waits for the result. Renders on the host always count rays.
        with_statistics() statistics = true;
    }

    /// Sets the half-angle of all cones in degrees, in [0, 68), for fits that reduce the blur step by step. It also
    /// applies to camera rays if it is wider than the pixel filter. With the softmax, a render returns an error; set
    /// [`SoftmaxOptions::sigma`](super::SoftmaxOptions::sigma) instead.
    pub fn with_blur(mut self, degrees: f64) -> Self {
        self.blur = Some(degrees);
        self
    }

    /// Sets the form of visibility: hard surfaces with cones of rays ([`Visibility::cone`]), or the paper's softmax
    /// ([`Visibility::softmax`], [`SoftmaxOptions`](super::SoftmaxOptions)). A blur ([`RenderOptions::with_blur`]) stays,
    /// in whichever order both are set: it replaces the angle of the cones, and with the softmax a render returns an
    /// error.
    pub fn with_visibility(mut self, visibility: impl Into<Visibility>) -> Self {
        self.visibility = visibility.into();
        self
    }

    /// The options with which [`render_batch`](super::render_batch) renders the view at `index`. Only the seed differs,
    /// so that each view has its own random numbers. View 0 keeps the seed.
    pub fn of_view(&self, index: usize) -> Self {
        let seed = self.seed;
        self.clone()
            .with_seed(seed.wrapping_add((index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03)))
    }

    /// Leaves out warnings of likely mistakes: for renders that the user did not ask for.
    pub(crate) fn quietly(mut self) -> Self {
        self.quiet = true;
        self
    }

    /// Sets the normalization to use if no bounds are set.
    pub(crate) fn normalization_or(mut self, normalization: Normalization) -> Self {
        self.normalization = Some(normalization);
        self
    }

    /// The scale of depths and tolerances; `None` if the scene sets it.
    pub(super) fn normalization(&self) -> Option<Normalization> {
        let softmax = self.visibility.softmax_options();
        let bounds = softmax.and_then(|softmax| softmax.bounds);
        bounds.map(Normalization::from).or(self.normalization)
    }

    /// Sets the cache that keeps prepared data for the next render ([`HierarchyCache`]).
    pub fn with_cache(mut self, cache: &HierarchyCache) -> Self {
        self.cache = Some(cache.clone());
        self
    }

    /// Sets a callback that runs after each tile of a forward pass with two arguments: the number of finished tiles and
    /// the number of all tiles. Kernels on a GPU do not call it.
    pub fn with_progress(mut self, call: impl Fn(usize, usize) + Send + Sync + 'static) -> Self {
        self.progress = Progress(Some(Arc::new(call)));
        self
    }

    /// The form of visibility with the blur.
    pub(super) fn form(&self) -> Visibility {
        match (self.visibility, self.blur) {
            (Visibility::Cone { pixels, .. }, Some(angle)) => Visibility::Cone { angle, pixels },
            (form, _) => form,
        }
    }

    /// The tangent of the blur's angle; 0 without a blur.
    pub(super) fn blur_slope(&self) -> f64 {
        self.blur.unwrap_or(0.0).to_radians().tan()
    }

    /// The samples of a pixel that are rendered.
    pub(super) fn sample_range(&self) -> Range<u32> {
        let (index, passes) = self.pass.unwrap_or((0, 1));
        let each = self.samples / passes;
        each * index..each * (index + 1)
    }
}

/// The sampler of a render's random numbers.
pub(super) fn sampler(o: &RenderOptions) -> Sampler {
    let most = if o.adaptive {
        o.samples * MAX_SAMPLES_RATIO
    } else {
        o.samples
    };
    Sampler::new(o.seed, o.sampling.sequence, o.width, most)
}
