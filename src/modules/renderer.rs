use burn::module::Module;

use crate::error::Result;
use crate::render::{Batch, Image, ImageBatch, RenderOptions, render, render_batch};
use crate::scene::{Camera, Scene};

/// [`render()`] with options that were checked; a module without parameters, so that it can be a field
/// of one.
#[derive(Module, Debug)]
pub struct Renderer {
    #[module(skip)]
    options: RenderOptions,
}

impl Renderer {
    /// A renderer with these options. Their seed is the renderer's: it is combined with that of each render, so
    /// that renderers with different ones have different random numbers for the same seed of a render.
    ///
    /// # Errors
    /// If an option is out of its range.
    pub fn new(options: RenderOptions) -> Result<Self> {
        options.check()?;
        Ok(Self { options })
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
        render(scene, camera, &self.seeded(seed))
    }

    /// The images of a batch, `[B, H, W, 3]`; see [`render_batch`].
    ///
    /// # Errors
    /// Like [`render_batch`].
    pub fn render_batch(&self, batch: &Batch, seed: u64) -> Result<ImageBatch> {
        render_batch(batch, &self.seeded(seed))
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

    /// The options of a render, whose seed is its own if the renderer's is 0.
    fn seeded(&self, render: u64) -> RenderOptions {
        let options = self.options.clone();
        let seed = options.seed.rotate_left(32) ^ render;
        options.seed(seed)
    }
}
