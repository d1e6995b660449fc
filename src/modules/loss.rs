use burn::config::Config;
use burn::module::Module;
use burn::tensor::Tensor;

use crate::error::{Error, Result};
use crate::optim::loss::{
    dssim, l1, mean, mse, multi_scale, multi_scale_unbiased, silhouette_iou_batch,
};
use crate::scene::Range;

const OBJECT: &str = "render loss";

/// Makes a [`RenderLoss`]: the weight of each term. No weight is negative, and at least one is positive.
#[derive(Config, Debug, PartialEq)]
pub struct RenderLossConfig {
    /// The weight of the mean squared difference.
    #[config(default = 1.0)]
    pub mse: f64,
    /// The weight of the mean absolute difference.
    #[config(default = 0.0)]
    pub l1: f64,
    /// The weight of structural dissimilarity, which is from 0 to 1.
    #[config(default = 0.0)]
    pub dssim: f64,
    /// The range of values that structural dissimilarity tells apart.
    #[config(default = 1.0)]
    pub range: f64,
    /// Levels of the pyramids over which losses of images are averaged; 1 is the image alone.
    #[config(default = 1)]
    pub levels: usize,
    /// The weight of [`RenderLoss::silhouette`].
    #[config(default = 0.0)]
    pub silhouette: f64,
}

impl RenderLossConfig {
    /// The loss.
    ///
    /// # Errors
    /// If a weight is not a finite number ≥ 0, all are 0, the range is not a finite number > 0, or there
    /// are no levels.
    pub fn init(&self) -> Result<RenderLoss> {
        let weights = [
            ("mse", self.mse),
            ("l1", self.l1),
            ("dssim", self.dssim),
            ("silhouette", self.silhouette),
        ];
        for (field, weight) in weights {
            Range::NotNegative.check(OBJECT, field, &[weight])?;
        }
        Range::Positive.check(OBJECT, "range", &[self.range])?;
        let wrong =
            |field, found: &str, expected| Err(Error::invalid(OBJECT, field, found, expected));
        if weights.iter().all(|&(_, weight)| weight == 0.0) {
            return wrong("weights", "all 0", "one that is more");
        }
        if self.levels == 0 {
            return wrong("levels", "0", "at least 1");
        }
        Ok(RenderLoss {
            config: self.clone(),
        })
    }
}

/// A weighted sum of the losses of [`loss`](crate::loss) between renders and targets: a module without
/// parameters, like burn's own losses. Images are `[H, W, C]` or batches `[B, H, W, C]`, whose loss is
/// the mean over the batch. A target may be off autodiff.
///
/// ```
/// use softray::modules::RenderLossConfig;
/// use softray::prelude::*;
/// let loss = RenderLossConfig::new().with_l1(0.5).with_levels(3).init()?;
/// let image = Tensor::<4>::ones([2, 8, 8, 3], &Device::flex());
/// let target = image.zeros_like();
/// assert_eq!(loss.forward(image, target).into_scalar::<f32>(), 1.5);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module, Debug)]
pub struct RenderLoss {
    #[module(skip)]
    config: RenderLossConfig,
}

impl RenderLoss {
    /// The loss `[1]` of one render of each image. The squared difference is too large by the noise's
    /// variance: see [`RenderLoss::forward_unbiased`].
    ///
    /// # Panics
    /// If the shapes differ, are neither of an image nor of a batch, or there are no images.
    pub fn forward<const D: usize>(&self, image: Tensor<D>, target: Tensor<D>) -> Tensor<1> {
        same_shape(&image, &target);
        let pairs = self.images(image).into_iter().zip(self.images(target));
        mean(pairs.map(|(image, target)| {
            multi_scale(image, target, self.config.levels, |image, target| {
                self.weighted(self.config.mse, &image, &target)
            })
        }))
    }

    /// The loss `[1]` of two renders with independent seeds of each image, see
    /// [`Renderer::pair`](super::Renderer::pair): the squared difference is not biased by noise
    /// ([`mse_unbiased`](crate::loss::mse_unbiased)) and may be negative. The other parts, which can't be
    /// mended so, are of the mean of both, whose variance is half.
    ///
    /// # Panics
    /// Like [`RenderLoss::forward`].
    pub fn forward_unbiased<const D: usize>(
        &self,
        a: Tensor<D>,
        b: Tensor<D>,
        target: Tensor<D>,
    ) -> Tensor<1> {
        same_shape(&a, &target);
        same_shape(&b, &target);
        let noisy = self.config.l1 > 0.0 || self.config.dssim > 0.0;
        let pairs = self.images(a).into_iter().zip(self.images(b));
        mean(pairs.zip(self.images(target)).map(|((a, b), target)| {
            let mut terms = Vec::new();
            if noisy {
                let both = (a.clone() + b.clone()) * 0.5;
                let weighted = |image, target| self.weighted(0.0, &image, &target);
                terms.push(multi_scale(
                    both,
                    target.clone(),
                    self.config.levels,
                    weighted,
                ));
            }
            if self.config.mse > 0.0 {
                let squares = multi_scale_unbiased(a.clone(), b, target, self.config.levels);
                terms.push(squares * self.config.mse);
            }
            sum(terms, &a)
        }))
    }

    /// The weighted loss `[1]` of silhouettes ([`silhouette_iou`](crate::loss::silhouette_iou)) of
    /// opacities `[H, W]` or batches `[B, H, W]`, to be added to that of the images.
    ///
    /// # Panics
    /// If the shapes differ, are neither of a silhouette nor of a batch, or there are none.
    pub fn silhouette<const D: usize>(&self, opacity: Tensor<D>, target: Tensor<D>) -> Tensor<1> {
        same_shape(&opacity, &target);
        silhouette_iou_batch(silhouettes(opacity), silhouettes(target)) * self.config.silhouette
    }

    /// The images `[H, W, C]` of a batch, or the one that there is: all as one tall image where no
    /// pixel of any level then is a mean over two of them.
    fn images<const D: usize>(&self, batch: Tensor<D>) -> Vec<Tensor<3>> {
        let dims = batch.dims();
        let (count, [height, width, channels]) = match dims[..] {
            [h, w, c] => (1, [h, w, c]),
            [b, h, w, c] => (b, [h, w, c]),
            _ => panic!("render loss: shape {dims:?}, expected [H, W, C] or [B, H, W, C]"),
        };
        assert!(count > 0, "render loss: the batch is empty");
        let rows = batch.reshape([count * height, width, channels]);
        let even = self.config.levels <= 32 && height.is_multiple_of(1 << (self.config.levels - 1));
        if even && self.config.dssim == 0.0 {
            return vec![rows];
        }
        let image = |i: usize| rows.clone().narrow(0, i * height, height);
        (0..count).map(image).collect()
    }

    /// The weighted losses of one image at one level, with a weight of the squares.
    fn weighted(&self, squares: f64, image: &Tensor<3>, target: &Tensor<3>) -> Tensor<1> {
        let mut terms = Vec::new();
        if squares > 0.0 {
            terms.push(mse(image.clone(), target.clone()) * squares);
        }
        if self.config.l1 > 0.0 {
            terms.push(l1(image.clone(), target.clone()) * self.config.l1);
        }
        if self.config.dssim > 0.0 {
            terms.push(dssim(image.clone(), target.clone(), self.config.range) * self.config.dssim);
        }
        sum(terms, image)
    }
}

/// Burn would broadcast an axis of length 1.
fn same_shape<const D: usize>(image: &Tensor<D>, target: &Tensor<D>) {
    let (found, expected) = (image.dims(), target.dims());
    assert!(
        found == expected,
        "render loss: image and target differ in shape: {found:?}, expected {expected:?}"
    );
}

/// Silhouettes as a batch `[B, H, W]`, of one if there is no batch.
fn silhouettes<const D: usize>(batch: Tensor<D>) -> Tensor<3> {
    let dims = batch.dims();
    let shape = match dims[..] {
        [h, w] => [1, h, w],
        [b, h, w] if b > 0 => [b, h, w],
        [0, _, _] => panic!("render loss: the batch is empty"),
        _ => panic!("render loss: shape {dims:?}, expected [H, W] or [B, H, W]"),
    };
    batch.reshape(shape)
}

/// The sum of scalars, 0 where there are none.
fn sum(terms: Vec<Tensor<1>>, image: &Tensor<3>) -> Tensor<1> {
    let sum = terms.into_iter().reduce(|a, b| a + b);
    sum.unwrap_or_else(|| Tensor::zeros([1], (&image.device().inner(), image.dtype())))
}
