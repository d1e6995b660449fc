use burn::config::Config;
use burn::module::Module;

use crate::error::Result;
use crate::render::{Batch, Image, ImageBatch, RenderOptions, Sampling, render, render_batch};
use crate::scene::{Camera, Scene};
use crate::visibility::Visibility;

/// The configuration of a [`Renderer`], which can be written to a file. [`RenderOptions`] describes each field.
///
/// ```
/// use burn::config::Config;
/// use softray::modules::RendererConfig;
/// use softray::prelude::*;
/// let config = RendererConfig::new(64, 48).with_samples(4).with_visibility(Visibility::cone(1e-2));
/// let path = std::env::temp_dir().join(format!("softray-{}.json", std::process::id()));
/// config.save(&path).expect("a file");
/// let renderer = RendererConfig::load(&path).expect("a configuration").init()?;
/// # std::fs::remove_file(&path).expect("a file");
/// # let _ = renderer;
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Config, Debug, PartialEq)]
pub struct RendererConfig {
    /// Pixels in a row.
    pub width: usize,
    /// Pixels in a column.
    pub height: usize,
    /// Paths a pixel.
    #[config(default = 16)]
    pub samples: u32,
    /// Bounces after the surface that the camera sees.
    #[config(default = 3)]
    pub bounces: u32,
    /// The form of visibility, with its blur.
    #[config(default = "Visibility::default()")]
    pub visibility: Visibility,
    /// How random numbers, surfaces and emitters are chosen.
    #[config(default = "Sampling::default()")]
    pub sampling: Sampling,
    /// The seed of the renderer: renderers with different ones have different random numbers for the same seed of a render.
    #[config(default = 0)]
    pub seed: u64,
    /// Triangles that cover less of a ray are left out.
    #[config(default = 1e-4)]
    pub cutoff: f64,
    /// Ends paths at random after this bounce and every later one.
    pub russian_roulette: Option<u32>,
    /// The most rays processed at once.
    pub rays_per_tile: Option<usize>,
    /// Whether images have an opacity.
    #[config(default = false)]
    pub opacity: bool,
    /// Whether images have a depth.
    #[config(default = false)]
    pub depth: bool,
    /// Whether images have normals.
    #[config(default = false)]
    pub normals: bool,
}

impl RendererConfig {
    /// The options of the renderer, with the seed of its render 0.
    ///
    /// # Errors
    /// If a value is out of its range.
    pub fn options(&self) -> Result<RenderOptions> {
        let mut options = RenderOptions::new(self.width, self.height)
            .samples(self.samples)
            .bounces(self.bounces)
            .visibility(self.visibility)
            .sampling(self.sampling)
            .seed(keyed(self.seed, 0))
            .cutoff(self.cutoff);
        if let Some(after) = self.russian_roulette {
            options = options.russian_roulette(after);
        }
        if let Some(rays) = self.rays_per_tile {
            options = options.rays_per_tile(rays);
        }
        if self.opacity {
            options = options.with_opacity();
        }
        if self.depth {
            options = options.with_depth();
        }
        if self.normals {
            options = options.with_normals();
        }
        options.check()?;
        Ok(options)
    }

    /// The renderer.
    ///
    /// # Errors
    /// If a value is out of its range.
    pub fn init(&self) -> Result<Renderer> {
        let options = self.options()?;
        let seed = self.seed;
        Ok(Renderer { options, seed })
    }
}

/// [`render()`] with options that were checked; a module without parameters, so that it can be a field
/// of one.
#[derive(Module, Debug)]
pub struct Renderer {
    #[module(skip)]
    options: RenderOptions,
    seed: u64,
}

impl Renderer {
    /// A renderer with these options. The seed is replaced in every render.
    ///
    /// # Errors
    /// If an option is out of its range.
    pub fn new(options: RenderOptions) -> Result<Self> {
        options.check()?;
        Ok(Self { options, seed: 0 })
    }

    /// The options.
    pub fn options(&self) -> &RenderOptions {
        &self.options
    }

    /// Sets the blur ([`RenderOptions::blur`]), for one that falls over the steps of a fit.
    ///
    /// # Errors
    /// If it is out of its range.
    pub fn with_blur(mut self, blur: f64) -> Result<Self> {
        self.options = self.options.blur(blur);
        self.options.check()?;
        Ok(self)
    }

    /// Renders an image in the graph of the tensors of scene and camera. The same seed gives the same image;
    /// use another one in every step of a training.
    ///
    /// # Errors
    /// Like [`render()`].
    pub fn render(&self, scene: &Scene, camera: &Camera, seed: u64) -> Result<Image> {
        let options = self.options.clone().seed(keyed(self.seed, seed));
        render(scene, camera, &options)
    }

    /// The images of a batch, `[B, H, W, 3]`; see [`render_batch`].
    ///
    /// # Errors
    /// Like [`render_batch`].
    pub fn render_batch(&self, batch: &Batch, seed: u64) -> Result<ImageBatch> {
        let options = self.options.clone().seed(keyed(self.seed, seed));
        render_batch(batch, &options)
    }

    /// Two renders of a batch with independent seeds, as [`Renderer::pair`].
    ///
    /// # Errors
    /// Like [`render_batch`].
    pub fn pair_batch(&self, batch: &Batch, seed: u64) -> Result<[ImageBatch; 2]> {
        let first = seed.wrapping_mul(2);
        Ok([
            self.render_batch(batch, first)?,
            self.render_batch(batch, first.wrapping_add(1))?,
        ])
    }

    /// Two images with independent seeds, 2·seed and 2·seed + 1: a loss that multiplies them is not
    /// biased by noise ([`mse_unbiased`](crate::loss::mse_unbiased)).
    ///
    /// # Errors
    /// Like [`render()`].
    pub fn pair(&self, scene: &Scene, camera: &Camera, seed: u64) -> Result<[Image; 2]> {
        let first = seed.wrapping_mul(2);
        Ok([
            self.render(scene, camera, first)?,
            self.render(scene, camera, first.wrapping_add(1))?,
        ])
    }
}

/// Combines the seeds of a renderer and of a render; it is the render's own if the renderer's is 0.
fn keyed(renderer: u64, render: u64) -> u64 {
    renderer.rotate_left(32) ^ render
}
