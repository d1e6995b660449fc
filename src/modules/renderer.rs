use burn::module::Module;

use crate::error::Result;
use crate::render::{Batch, Image, ImageBatch, RenderOptions, render, render_batch};
use crate::scene::{Camera, Scene};

/// [`render()`] with checked options, as a module without parameters, so that it can be a field of another
/// module.
///
/// [`modules`](crate::modules) has an example.
#[derive(Module, Debug)]
pub struct Renderer {
    #[module(skip)]
    options: RenderOptions,
}

impl Renderer {
    /// Creates a renderer with these options.
    ///
    /// The options' seed is combined with the seed of each render. Renderers with different seeds therefore use
    /// different random numbers for the same seed of a render.
    ///
    /// # Errors
    /// If an option is out of its range.
    pub fn new(options: RenderOptions) -> Result<Self> {
        options.check_values()?;
        Ok(Self { options })
    }

    /// Returns the options.
    pub fn options(&self) -> &RenderOptions {
        &self.options
    }

    /// Sets the blur ([`RenderOptions::with_blur`]), for example in a fit whose blur falls over the steps.
    ///
    /// # Errors
    /// If the blur is out of its range.
    pub fn with_blur(mut self, blur: f64) -> Result<Self> {
        self.options = self.options.with_blur(blur);
        self.options.check_values()?;
        Ok(self)
    }

    /// Renders an image in the graph of the scene's and the camera's tensors. The same seed gives the same
    /// image; use a different seed at every training step.
    ///
    /// # Errors
    /// Like [`render()`].
    pub fn forward(&self, scene: &Scene, camera: &Camera, seed: u64) -> Result<Image> {
        render(scene, camera, &self.seeded(seed))
    }

    /// Renders the images of a batch, `[B, H, W, 3]`; see [`render_batch`].
    ///
    /// # Errors
    /// Like [`render_batch`].
    pub fn forward_batch(&self, batch: &Batch, seed: u64) -> Result<ImageBatch> {
        render_batch(batch, &self.seeded(seed))
    }

    /// Renders a batch twice with independent seeds, like [`Renderer::forward_pair`].
    ///
    /// # Errors
    /// Like [`render_batch`].
    pub fn forward_pair_batch(&self, batch: &Batch, seed: u64) -> Result<[ImageBatch; 2]> {
        let first = seed.wrapping_mul(2);
        Ok([
            self.forward_batch(batch, first)?,
            self.forward_batch(batch, first.wrapping_add(1))?,
        ])
    }

    /// Renders two images with independent seeds, 2·seed and 2·seed + 1. Noise does not bias a loss that
    /// multiplies them ([`mse_unbiased`](crate::loss::mse_unbiased)).
    ///
    /// # Errors
    /// Like [`render()`].
    pub fn forward_pair(&self, scene: &Scene, camera: &Camera, seed: u64) -> Result<[Image; 2]> {
        let first = seed.wrapping_mul(2);
        Ok([
            self.forward(scene, camera, first)?,
            self.forward(scene, camera, first.wrapping_add(1))?,
        ])
    }

    /// Returns the options of a render. If the renderer's seed is 0, the seed is `render`.
    fn seeded(&self, render: u64) -> RenderOptions {
        let options = self.options.clone();
        let seed = options.seed.rotate_left(32) ^ render;
        options.with_seed(seed)
    }
}
