//! The options of a render.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use burn::config::Config;
use serde::{Deserialize, Serialize};

use super::adaptive::MOST;
use super::cache::HierarchyCache;
use crate::error::{Error, Result};
use crate::sampling::{Sampler, Sampling};
use crate::scene::{Bounds, Normalization};
use crate::tensors::Visibility;

/// Bounces of a path, at most.
const MOST_BOUNCES: u32 = 10_000;

/// Samples of a pixel with adaptive sampling, at most.
const MOST_ADAPTIVE: u32 = 1 << 24;

/// The program that computes a render. Both give the same image, up to rounding, for the same seed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Engine {
    /// Kernels for cones, tensors for the softmax.
    #[default]
    Auto,
    /// Kernels with derivatives by hand, on a GPU if the tensors lie on one and are f32, else on the host. They
    /// know cones, not the softmax.
    Kernels,
    /// A program of tensor operations on the scene's device, with burn's derivatives: much slower, the
    /// specification of what the kernels do. Which triangle a ray of a cone hits is asked of the host, and
    /// how visibility changes the gradient is added by the kernels.
    Tensors,
}

/// The options of a render. Files have them by burn's [`Config`]; the cache of boxes and what is called after
/// tiles are not part of a file, and what a file leaves out has its default.
///
/// ```
/// use burn::config::Config;
/// use softray::prelude::*;
/// let options = RenderOptions::new(64, 48).samples(4).with_depth();
/// let path = std::env::temp_dir().join(format!("softray-{}.json", std::process::id()));
/// options.save(&path).expect("a file");
/// let loaded = RenderOptions::load(&path).expect("options");
/// # std::fs::remove_file(&path).expect("a file");
/// assert_eq!(format!("{loaded:?}"), format!("{options:?}"));
/// let few: RenderOptions = serde_json::from_str(r#"{"width": 64, "height": 48, "samples": 4}"#)
///     .expect("options");
/// # let _ = few;
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default = "RenderOptions::without_size", deny_unknown_fields)]
pub struct RenderOptions {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) samples: u32,
    pub(super) bounces: u32,
    pub(super) visibility: Visibility,
    pub(super) engine: Engine,
    /// The half-angle of all cones, the camera's too.
    pub(super) blur: Option<f64>,
    pub(super) sampling: Sampling,
    pub(crate) seed: u64,
    pub(super) roulette_after: Option<u32>,
    pub(super) rays_per_tile: Option<usize>,
    pub(super) adaptive: bool,
    pub(super) adaptive_edges: bool,
    bounds: Option<Bounds>,
    /// The normalization where no bounds are set.
    #[serde(skip)]
    normalization: Option<Normalization>,
    pub(super) outputs: Outputs,
    pub(super) diagnostics: bool,
    pub(super) statistics: bool,
    pub(super) brute_force: bool,
    #[serde(skip)]
    pub(super) cache: Option<HierarchyCache>,
    pub(super) cutoff: f64,
    #[serde(skip)]
    pub(super) progress: Progress,
    memory_limit: u64,
}

impl Config for RenderOptions {}

/// The outputs beside radiance.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Outputs {
    pub opacity: bool,
    pub depth: bool,
    pub normals: bool,
    pub object_ids: bool,
}

impl Outputs {
    /// Whether opacity is rendered: depth and normals are per opacity.
    pub fn need_opacity(self) -> bool {
        self.opacity || self.depth || self.normals
    }
}

/// What is called after each tile.
#[derive(Clone, Default)]
pub(super) struct Progress(Option<Arc<dyn Fn(usize, usize) + Send + Sync>>);

impl Progress {
    /// One more tile of so many is done.
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

/// Methods of options that set one field each: `name(argument) field = value`.
macro_rules! setters {
    ($($(#[$doc:meta])* $name:ident($($argument:ident: $type:ty)?) $($field:ident).+ = $value:expr;)*) => {$(
        $(#[$doc])*
        pub fn $name(mut self $(, $argument: $type)?) -> Self {
            self.$($field).+ = $value;
            self
        }
    )*};
}

impl RenderOptions {
    /// An image of width × height pixels: 16 samples, 3 bounces, cones without an angle,
    /// seed 0.
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
            rays_per_tile: None,
            adaptive: false,
            adaptive_edges: true,
            bounds: None,
            normalization: None,
            outputs: Outputs::default(),
            diagnostics: false,
            statistics: false,
            brute_force: false,
            cache: None,
            cutoff: 1e-4,
            progress: Progress::default(),
            memory_limit: 4 << 30,
        }
    }

    /// The defaults of a file, which [`Self::check`] refuses where it gives no size.
    fn without_size() -> Self {
        Self::new(0, 0)
    }

    setters! {
        /// Paths a pixel.
        samples(samples: u32) samples = samples;
        /// Bounces after the surface that the camera sees; 0 is direct light only.
        bounces(bounces: u32) bounces = bounces;
        /// The program that computes the render.
        engine(engine: Engine) engine = engine;
        /// The choice of random numbers, surfaces and emitters.
        sampling(sampling: Sampling) sampling = sampling;
        /// Same seed, same image.
        seed(seed: u64) seed = seed;
        /// Ends paths at random, in proportion to their throughput, after the given bounce and every
        /// later one (0: after the surface that the camera sees).
        russian_roulette(after: u32) roulette_after = Some(after);
        /// Adaptive sampling: each pixel has between ¼ and 16 times [`samples`](Self::samples) paths, the more the
        /// noisier the image is about it and the fewer rays its paths have, so that all take about as long as without.
        /// How noisy it is comes from two images of a 64th as many samples, which are not part of the result, so each
        /// pixel's mean stays unbiased. Where they show that little would be gained, all pixels have `samples`. It
        /// pays off where noise sits in few pixels, such as in penumbras and at the outlines of lamps. Gradients have `samples` paths of each pixel, and so have lists of pixels
        /// ([`render_pixels`](super::render_pixels)) and renders of less than 32 samples. The softmax and
        /// [`Engine::Tensors`] don't know it.
        adaptive() adaptive = true;
        /// Whether a gradient measures how to divide its time between edges of shadows, of reflected light and on the
        /// film (on by default): of an eighth of the pixels it adds up how much the edges of each kind vary and cost, and
        /// gives each kind in the others ⅛ to 8 times the usual number of samples. Gradients stay unbiased and repeat.
        /// Renders of less than 8,192 paths, and GPUs, take the usual numbers.
        adaptive_edges(adaptive: bool) adaptive_edges = adaptive;
        /// The most rays processed at once. Bounds the memory of a render without gradient; by
        /// default chosen from the number of triangles.
        rays_per_tile(rays: usize) rays_per_tile = Some(rays);
        /// For the softmax: sets the scale of depths and tolerances by the sphere about the center of a box
        /// through its corners, in place of one around the scene's vertices. Finite differences need the same
        /// bounds on both sides; see [`Scene::bounds`](crate::scene::Scene::bounds).
        bounds(bounds: Bounds) bounds = Some(bounds);
        /// For the softmax: triangles that cover less of a ray than this, and what lies behind more than 1 − this, are
        /// left out (1e-4 by default).
        cutoff(cutoff: f64) cutoff = cutoff;
        /// The most bytes that the images of a call may take, 4 GiB unless set: larger ones are an error
        /// before anything is rendered.
        memory_limit(bytes: u64) memory_limit = bytes;
        /// Also returns the opacity `[H, W]`: the share of a pixel that surfaces cover, 0 to 1.
        with_opacity() outputs.opacity = true;
        /// Also returns the depth `[H, W]`: the mean distance along the camera rays to the surfaces that they
        /// hit, in scene units; 0 where they hit none. It is not PyTorch3D's `zbuf`, which is measured along
        /// the view axis: [`Camera::axial_depth`](crate::scene::Camera::axial_depth) converts it.
        with_depth() outputs.depth = true;
        /// Also returns normals `[H, W, 3]`: the mean geometric normal of the surfaces that camera rays hit, on
        /// the side that faces the camera, in scene axes; 0 where they hit none.
        with_normals() outputs.normals = true;
        /// Also returns object ids `[H, W]`: the number of the object, in the scene's order, that covers most of a
        /// pixel; −1 for the background. Ids have no gradient.
        with_object_ids() outputs.object_ids = true;
        /// Also counts what is degenerate ([`Diagnostics`](super::Diagnostics)); for the softmax that takes time.
        with_diagnostics() diagnostics = true;
        /// Also counts the rays of images that a GPU renders ([`Statistics`](super::Statistics)): that traces their
        /// paths once more and waits for them. On the host they are always counted.
        with_statistics() statistics = true;
        /// For the softmax: tests every triangle for every ray, in tensors, as it does on GPUs. Slow; it is the
        /// specification of what is done by a hierarchy of boxes.
        brute_force() brute_force = true;
    }

    /// One number for the blur of all rays, for a fit whose blur falls: the half-angle of cones in
    /// radians, of camera rays too where that is wider than the pixel filter; or σ of the softmax in
    /// scene units squared. [`RenderOptions::visibility`] sets each on its own.
    pub fn blur(mut self, blur: f64) -> Self {
        self.visibility.set_blur(blur);
        self.blur = (!self.visibility.is_softmax()).then_some(blur);
        self
    }

    /// The form of visibility: hard surfaces by rays of cones, or the paper's softmax, each with its blur.
    pub fn visibility(mut self, visibility: Visibility) -> Self {
        self.visibility = visibility;
        self.blur = None;
        self
    }

    /// The options that [`render_batch`](super::render_batch) renders the view of that index with: the
    /// same but for the seed, so that views have random numbers of their own. View 0 has the seed that
    /// is set.
    pub fn of_view(&self, index: usize) -> Self {
        let seed = self.seed;
        self.clone()
            .seed(seed.wrapping_add((index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03)))
    }

    /// This where no bounds are set.
    pub(crate) fn normalization_or(mut self, normalization: Normalization) -> Self {
        self.normalization = Some(normalization);
        self
    }

    /// The scale of depths and tolerances, if the scene does not set it.
    pub(super) fn normalization(&self) -> Option<Normalization> {
        self.bounds.map(Normalization::from).or(self.normalization)
    }

    /// Keeps what a render prepares for the next ([`HierarchyCache`]).
    pub fn cache(mut self, cache: &HierarchyCache) -> Self {
        self.cache = Some(cache.clone());
        self
    }

    /// Calls a function after each tile with the number of tiles done and of all tiles.
    pub fn progress(mut self, call: impl Fn(usize, usize) + Send + Sync + 'static) -> Self {
        self.progress = Progress(Some(Arc::new(call)));
        self
    }

    /// That images of so many pixels in all may be rendered.
    pub(super) fn check_memory(&self, pixels: u128) -> Result<()> {
        let o = self.outputs;
        let channels = [(true, 3), (o.opacity, 1), (o.depth, 1), (o.normals, 3)];
        let channels: u128 = channels.iter().filter(|c| c.0).map(|c| c.1).sum();
        let bytes = 4 * channels * pixels;
        if bytes <= u128::from(self.memory_limit) {
            return Ok(());
        }
        let expected = format!(
            "images within {:.1} GB (RenderOptions::memory_limit); they take {:.1} GB",
            self.memory_limit as f64 / 1e9,
            bytes as f64 / 1e9
        );
        Err(self.size_error(expected))
    }

    pub(super) fn size_error(&self, expected: impl Into<String>) -> Error {
        let size = format!("{} × {}", self.width, self.height);
        Error::invalid("options", "width × height", size, expected)
    }

    /// That all values are in their ranges.
    pub(crate) fn check(&self) -> Result<()> {
        let wrong = |field, value: &dyn ToString, expected: &str| {
            Err(Error::invalid(
                "options",
                field,
                value.to_string(),
                expected,
            ))
        };
        for (field, value) in [
            ("width", self.width),
            ("height", self.height),
            ("samples", self.samples as usize),
            ("rays_per_tile", self.rays_per_tile.unwrap_or(1)),
        ] {
            if value == 0 {
                return wrong(field, &value, "at least 1");
            }
        }
        if self.width.saturating_mul(self.height) > u32::MAX as usize {
            return Err(self.size_error("at most 2³² − 1 pixels"));
        }
        if self.bounces > MOST_BOUNCES {
            let surfaces = u64::from(self.bounces) + 1;
            let most =
                format!("at most {MOST_BOUNCES}; a path would go on for up to {surfaces} surfaces");
            return wrong("bounces", &self.bounces, &most);
        }
        if !(self.cutoff > 0.0 && self.cutoff < 0.5) {
            return wrong("cutoff", &self.cutoff, "a number in (0, 0.5)");
        }
        self.visibility.check()?;
        if self.engine == Engine::Kernels && self.visibility.is_softmax() {
            return wrong("engine", &"Kernels", "Auto or Tensors for the softmax");
        }
        if self.adaptive && (self.visibility.is_softmax() || self.engine == Engine::Tensors) {
            let expected = "false for the softmax and Engine::Tensors";
            return wrong("adaptive", &true, expected);
        }
        if self.adaptive && self.samples > MOST_ADAPTIVE {
            let expected = "at most 2²⁴ with adaptive sampling";
            return wrong("samples", &self.samples, expected);
        }
        if let Some(b) = self.bounds {
            let is_box = b.size().iter().all(|&s| s >= 0.0) && b.radius().is_finite();
            if !(is_box && b.radius() > 0.0 && b.center().iter().all(|c| c.is_finite())) {
                let expected = "a finite box, min <= max, that is more than a point";
                return wrong("bounds", &format!("{b:?}"), expected);
            }
        }
        Ok(())
    }
}

/// The random numbers of a render.
pub(super) fn sampler(o: &RenderOptions) -> Sampler {
    let most = if o.adaptive {
        o.samples * MOST
    } else {
        o.samples
    };
    Sampler::new(o.seed, o.sampling.sequence, o.width, most)
}
