use burn::config::Config;
use burn::module::Module;
use burn::tensor::Tensor;

use crate::error::{Error, Result};
use crate::optim::loss::{
    check_levels, check_pair, dssim, l1, mse, multi_scale, multi_scale_unbiased, silhouette_iou,
};
use crate::scene::Range;

const OBJECT: &str = "render loss";

/// The configuration of a [`RenderLoss`]: the weight of each term. Weights are at least 0, and at least one is
/// positive.
///
/// [`RenderLoss`] has an example.
#[derive(Config, Debug, PartialEq)]
pub struct RenderLossConfig {
    /// The weight of the mean squared difference; 1 by default.
    #[config(default = 1.0)]
    pub mse: f64,
    /// The weight of the mean absolute difference; 0 by default.
    #[config(default = 0.0)]
    pub l1: f64,
    /// The weight of structural dissimilarity, which ranges from 0 to 1; 0 by default.
    #[config(default = 0.0)]
    pub dssim: f64,
    /// The range of values for structural dissimilarity ([`ssim`](crate::loss::ssim)); 1 by default.
    #[config(default = 1.0)]
    pub range: f64,
    /// The number of pyramid levels over which image losses are averaged; 1, the default, is the image alone.
    #[config(default = 1)]
    pub levels: usize,
    /// The weight of [`RenderLoss::silhouette`]; 0 by default.
    #[config(default = 0.0)]
    pub silhouette: f64,
}

impl RenderLossConfig {
    /// Creates the loss.
    ///
    /// # Errors
    /// If a weight is not a finite number ≥ 0, all weights are 0, the range is not a finite number > 0, or
    /// `levels` is 0.
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
        let weighted = weights.iter().any(|&(_, weight)| weight > 0.0);
        Error::unless(weighted, OBJECT, "weights", "all 0", "one that is more")?;
        check_levels(OBJECT, self.levels)?;
        Ok(RenderLoss {
            config: self.clone(),
        })
    }
}

/// A weighted sum of losses of [`loss`](crate::loss) between renders and targets.
///
/// It is a module without parameters, like burn's own losses. Images are `[H, W, C]` or batches `[B, H, W, C]`;
/// the loss of a batch is the mean over its images. A target may be on a device without autodiff.
///
/// ```
/// use softray::modules::RenderLossConfig;
/// use softray::prelude::*;
/// let loss = RenderLossConfig::new().with_l1(0.5).with_levels(3).init()?;
/// let image = Tensor::<4>::ones([2, 8, 8, 3], &Device::flex());
/// let target = image.zeros_like();
/// assert_eq!(loss.forward(image, target)?.into_scalar::<f32>(), 1.5);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module, Debug)]
pub struct RenderLoss {
    #[module(skip)]
    config: RenderLossConfig,
}

impl RenderLoss {
    /// Returns the loss `[1]` for one render of each image. The squared difference is too large by the variance
    /// of the noise; [`RenderLoss::forward_unbiased`] avoids this bias.
    ///
    /// # Errors
    /// If the shapes or the float types differ, or an axis has length 0.
    pub fn forward<const D: usize>(
        &self,
        image: Tensor<D>,
        target: Tensor<D>,
    ) -> Result<Tensor<1>> {
        check_pair(OBJECT, &image, &target)?;
        multi_scale(image, target, self.config.levels, |image, target| {
            self.weighted(self.config.mse, &image, &target)
        })
    }

    /// Returns the loss `[1]` for two renders of each image with independent seeds, for example from
    /// [`Renderer::forward_pair`](super::Renderer::forward_pair).
    ///
    /// Noise does not bias the squared difference ([`mse_unbiased`](crate::loss::mse_unbiased)), which may be
    /// negative. The other terms remain biased; they use the mean of both renders, whose variance is half.
    ///
    /// # Errors
    /// Like [`RenderLoss::forward`].
    pub fn forward_unbiased<const D: usize>(
        &self,
        a: Tensor<D>,
        b: Tensor<D>,
        target: Tensor<D>,
    ) -> Result<Tensor<1>> {
        check_pair(OBJECT, &a, &target)?;
        check_pair(OBJECT, &b, &target)?;
        let (mut terms, levels) = (Vec::new(), self.config.levels);
        if self.config.l1 > 0.0 || self.config.dssim > 0.0 {
            let both = (a.clone() + b.clone()) * 0.5;
            let weighted = |image, target| self.weighted(0.0, &image, &target);
            terms.push(multi_scale(both, target.clone(), levels, weighted)?);
        }
        if self.config.mse > 0.0 {
            let squares = multi_scale_unbiased(a.clone(), b, target, levels)?;
            terms.push(squares * self.config.mse);
        }
        Ok(sum(terms, &a))
    }

    /// Returns the weighted silhouette loss `[1]` ([`silhouette_iou`](crate::loss::silhouette_iou)) of
    /// opacities `[H, W]` or batches `[B, H, W]`. Add it to the loss of the images.
    ///
    /// # Errors
    /// Like [`RenderLoss::forward`].
    pub fn silhouette<const D: usize>(
        &self,
        opacity: Tensor<D>,
        target: Tensor<D>,
    ) -> Result<Tensor<1>> {
        check_pair(OBJECT, &opacity, &target)?;
        Ok(silhouette_iou(opacity, target)? * self.config.silhouette)
    }

    /// Returns the weighted losses at one level; `squares` is the weight of the squared
    /// difference.
    fn weighted<const D: usize>(
        &self,
        squares: f64,
        image: &Tensor<D>,
        target: &Tensor<D>,
    ) -> Result<Tensor<1>> {
        let mut terms = Vec::new();
        if squares > 0.0 {
            terms.push(mse(image.clone(), target.clone())? * squares);
        }
        if self.config.l1 > 0.0 {
            terms.push(l1(image.clone(), target.clone())? * self.config.l1);
        }
        if self.config.dssim > 0.0 {
            let apart = dssim(image.clone(), target.clone(), self.config.range)?;
            terms.push(apart * self.config.dssim);
        }
        Ok(sum(terms, image))
    }
}

/// Returns the sum of scalars, 0 if there are none.
fn sum<const D: usize>(terms: Vec<Tensor<1>>, image: &Tensor<D>) -> Tensor<1> {
    let sum = terms.into_iter().reduce(|a, b| a + b);
    sum.unwrap_or_else(|| Tensor::zeros([1], (&image.device().inner(), image.dtype())))
}
