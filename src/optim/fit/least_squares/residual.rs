//! A view whose image a fit compares with a target.

use burn::tensor::Tensor;

use super::equations::Linear;
use crate::error::{Error, Result};
use crate::geometry::{detached, host_values};
use crate::optim::loss::halves;
use crate::render::{RenderOptions, Tangent, render, render_derivative};
use crate::scene::{Camera, Scene};

/// The samples of residuals, relative to those of derivatives: near the target, their noise is most of the noise of a step.
const RESIDUAL: u32 = 4;

/// A view whose image should become a target: a scene, a camera, the options of its renders and the target image.
///
/// [`LeastSquares`](super::LeastSquares) has an example.
#[derive(Clone, Debug)]
pub struct Residual {
    pub(super) scene: Scene,
    pub(super) camera: Camera,
    options: RenderOptions,
    pub(super) target: Tensor<3>,
    pub(super) name: String,
    levels: usize,
    pub(super) values: Vec<(String, f64)>,
}

impl Residual {
    /// Creates the residual of a view. `target` is an image `[H, W, 3]` of the size of the options. The seed of the options
    /// has no effect, since each render of a fit has its own; [`Step::options`](crate::optim::Step::options) sets the blur of the step.
    pub fn new(scene: Scene, camera: Camera, options: RenderOptions, target: Tensor<3>) -> Self {
        Self {
            scene,
            camera,
            options,
            target,
            name: "render".into(),
            levels: 1,
            values: Vec::new(),
        }
    }

    /// Sets the name of the view in pictures; `"render"` by default. Names of a fit's views are unique.
    pub fn with_name(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// Compares image and target on this many levels of their [`pyramid`](crate::loss::pyramid), as
    /// [`multi_scale_unbiased`](crate::loss::multi_scale_unbiased) does; 1 by default. With more levels, a fit may start
    /// further away.
    pub fn with_levels(mut self, levels: usize) -> Self {
        self.levels = levels;
        self
    }

    /// Adds a value for the history; see [`Evaluation::with_value`](crate::optim::Evaluation::with_value).
    pub fn with_value(mut self, name: impl Into<String>, value: f64) -> Self {
        self.values.push((name.into(), value));
        self
    }

    pub(super) fn check(&self) -> Result<()> {
        let object = format!("residual {:?}", self.name);
        let (found, expected) = (
            self.target.dims(),
            [self.options.height, self.options.width, 3],
        );
        let same = found == expected;
        let (found, expected) = (format!("{found:?}"), format!("{expected:?} like the image"));
        Error::unless(same, &object, "shape of the target", found, &expected)?;
        Error::unless(
            self.levels > 0,
            &object,
            "levels",
            self.levels,
            "at least 1",
        )
    }

    /// Returns the values of the pyramids of images `[B, H, W, 3]`, for each image one list. They are scaled so that the sum
    /// of their squares is the mean over levels of the mean square.
    fn flattened(&self, images: Tensor<4>) -> Result<Vec<Vec<f64>>> {
        let count = images.dims()[0];
        let levels = halves(detached(&images), self.levels);
        let mut all = vec![Vec::new(); count];
        for level in &levels {
            let values = host_values(level)?;
            let each = values.len() / count;
            let scale = ((levels.len() * each) as f64).sqrt().recip();
            for (to, own) in all.iter_mut().zip(values.chunks_exact(each)) {
                to.extend(own.iter().map(|v| v * scale));
            }
        }
        Ok(all)
    }

    /// Renders an image and returns it with its residuals. There are `times` as many samples as for derivatives.
    fn residuals(&self, seed: u64, times: u32) -> Result<(Tensor<3>, Vec<f64>)> {
        let samples = self.options.samples.saturating_mul(times);
        let options = self.options.clone().with_samples(samples).with_seed(seed);
        let image = detached(&render(&self.scene, &self.camera, &options)?.radiance);
        let target = detached(&self.target).cast(image.dtype());
        let difference = image.clone() - target.to_device(&image.device());
        let mut all = self.flattened(difference.unsqueeze())?;
        Ok((image, all.swap_remove(0)))
    }

    /// Returns an image, its residuals and their derivatives.
    pub(super) fn linear(
        &self,
        tangents: &[Tangent],
        [seed, other]: [u64; 2],
    ) -> Result<(Tensor<3>, Linear)> {
        let (image, residuals) = self.residuals(other, RESIDUAL)?;
        let options = self.options.clone().with_seed(seed);
        let all = render_derivative(&self.scene, &self.camera, &options, tangents)?;
        let by_number = self.flattened(all.tangents.radiance)?;
        Ok((
            image,
            Linear {
                residuals,
                by_number,
            },
        ))
    }

    /// Returns the loss from two renders.
    pub(super) fn loss(&self, seeds: [u64; 2]) -> Result<f64> {
        let [a, b] = seeds.map(|seed| self.residuals(seed, 1));
        Ok(a?.1.iter().zip(&b?.1).map(|(a, b)| a * b).sum())
    }
}
