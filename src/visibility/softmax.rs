use burn::tensor::Tensor;

use super::{Coverage, Rays};
use crate::error::{Error, Result};
use crate::geometry::{Context, plain};

/// The paper's softmax over depth (Eq. 3, corrected): W over log p_k + z_k/γ and ε/γ for the
/// background, with z_k = (far − t_k)/(far − near).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Softmax {
    /// Blur in depth, in units of the scene's depth.
    pub gamma: f64,
    /// Score of the background.
    pub epsilon: f64,
}

/// near and far of each ray (Eq. 3): where it may meet the bounds of the scene, as seen from its
/// origin.
#[derive(Clone, Debug)]
pub struct DepthRange {
    near: Tensor<2>,
    far: Tensor<2>,
    /// A row that is 0 and has the derivative of `far`.
    change: Option<Tensor<2>>,
}

impl DepthRange {
    /// For bounds of a radius about the point that origins are relative to. The gradient flows to
    /// the origins, not to the bounds.
    pub fn new(rays: &Rays, radius: f64) -> Self {
        let origin = rays.origin.plain();
        let distance = origin.dot(&origin).sqrt();
        let change = rays.origin.is_tracked().then(|| {
            let away = origin.map(|x| x / distance.clone().clamp_min(1e-6 * radius));
            rays.origin.sub(&origin).dot(&away)
        });
        Self {
            near: (distance.clone() - radius).clamp_min(0.0),
            far: distance + radius,
            change,
        }
    }

    /// The same without gradient.
    pub fn detached(self) -> Self {
        Self {
            change: None,
            ..self
        }
    }
}

/// Derivatives of the scores.
#[derive(Clone, Debug)]
struct Slopes {
    /// By the logits `[T, N]`.
    logit: Tensor<2>,
    /// By the distances `[1, N]`.
    distance: Tensor<2>,
    /// By far `[T, N]`, with its change `[1, N]`.
    far: Option<(Tensor<2>, Tensor<2>)>,
}

/// How the surfaces of each ray and the background share its weight.
#[derive(Clone, Debug)]
pub struct Weights {
    /// W_k `[T, N]`, without tape.
    pub surfaces: Tensor<2>,
    /// W of the background `[1, N]`, without tape.
    pub background: Tensor<2>,
    coverage: Coverage,
    /// If a gradient can flow.
    slopes: Option<Slopes>,
}

impl Softmax {
    /// Weights of all surfaces of each ray.
    pub fn weights(&self, coverage: Coverage, range: DepthRange) -> Weights {
        let DepthRange { near, far, change } = range;
        let per_depth = (far.clone() - near.clone()).recip() / self.gamma;
        let score = (far.clone() - coverage.t.clone()) * per_depth.clone();
        let discounted = coverage.counted.clone().bool_not();
        // log p = min(logit, 0) − log(1 + exp(−|logit|)): the exponent is shifted by its largest
        // piecewise linear part, so that nothing overflows and no logarithm is needed.
        let mut exponent = score + coverage.logit.clone().clamp_max(0.0);
        if let Some(softened) = &coverage.softened {
            // max(0, 2p − 1) = tanh(logit/2) = (1 − e)/(1 + e) with e = exp(−logit).
            let soft = (coverage.decay.clone().neg() + 1.0)
                .mask_fill(discounted.clone(), 1.0)
                .log();
            exponent = exponent
                .clone()
                .mask_where(softened.clone(), exponent + soft);
        }
        let exponent = exponent.mask_fill(discounted.clone(), -1e30);
        let background = self.epsilon / self.gamma;
        let largest = exponent.clone().max_dim(0).clamp_min(background);
        let one_plus = coverage.decay.clone() + 1.0;
        let weight = (exponent - largest.clone()).exp() / one_plus.clone();
        let weight = weight.mask_fill(discounted.clone(), 0.0);
        let rest = (largest.neg() + background).exp();
        let total = weight.clone().sum_dim(0) + rest.clone();
        let slopes = coverage.attached.is_some().then(|| {
            let mut slope = coverage
                .decay
                .clone()
                .mask_fill(coverage.inside().bool_not(), 1.0)
                / one_plus;
            if let Some(softened) = &coverage.softened {
                // d log tanh(x/2)/dx = 2e/(1 − e²)
                let e = coverage.decay.clone();
                let soft = e.clone() * 2.0 / (e.clone() * e).neg().add_scalar(1.0).clamp_min(1e-6);
                slope = slope.mask_where(softened.clone(), soft);
            }
            // Outside of the bounds only (far − t) depends on far; inside its divisor does too.
            let far = change.map(|change| {
                let inside = near.lower_equal_elem(0.0);
                let kept = coverage.t.clone() / far;
                let ones = kept.ones_like();
                let kept = ones.mask_where(inside.expand(kept.dims()), kept);
                let kept = kept.mask_fill(discounted.clone(), 0.0);
                (kept * per_depth.clone(), change)
            });
            Slopes {
                logit: slope.mask_fill(discounted, 0.0),
                distance: per_depth.neg(),
                far,
            }
        });
        Weights {
            surfaces: weight / total.clone(),
            background: rest / total,
            coverage,
            slopes,
        }
    }
}

impl Weights {
    /// Draws one surface a ray with random numbers in [0, 1); the number of triangles stands for
    /// the background. A surface of weight 0 is never drawn.
    ///
    /// # Errors
    /// If the drawn indices can't be read back.
    pub fn draw(&self, context: &Context, random: &[f64]) -> Result<Vec<u32>> {
        let cumulative = self.surfaces.clone().cumsum(0);
        let triangles = cumulative.dims()[0];
        let total = cumulative.clone().slice([triangles - 1..triangles]) + self.background.clone();
        let threshold = total * context.row(random);
        let passed = cumulative.lower_equal(threshold);
        let index = passed.int().sum_dim(0);
        let data = index
            .try_into_data()
            .map_err(|e| Error::Read(format!("{e:?}")))?;
        Ok(data.iter::<i64>().map(|k| k as u32).collect())
    }

    /// W_k / stop_gradient(W_k) of the drawn surfaces `[1, N]`: 1, with the derivative of log W_k.
    /// None if no gradient can flow.
    pub fn ratio(&self, context: &Context, drawn: &[u32]) -> Option<Tensor<2>> {
        self.slopes.as_ref()?;
        let triangles = self.surfaces.dims()[0];
        let numbers: Vec<f64> = (0..triangles).map(|k| k as f64).collect();
        let row: Vec<f64> = drawn.iter().map(|&k| f64::from(k)).collect();
        let one_hot = context.column(&numbers).equal(context.row(&row));
        let share = one_hot.float().cast(context.dtype) - self.surfaces.clone();
        Some(self.change(share)? + 1.0)
    }

    /// A row `[1, N]` that is 0 and has the derivative of Σ share_k·score_k.
    fn change(&self, share: Tensor<2>) -> Option<Tensor<2>> {
        let slopes = self.slopes.clone()?;
        let change = self.coverage.linear(
            share.clone() * slopes.logit,
            Some(share.clone() * slopes.distance),
        )?;
        Some(match slopes.far {
            Some((slope, far)) => change + (share * slope).sum_dim(0) * far,
            None => change,
        })
    }

    /// Σ W_k·v_k + W_background·v of a quantity of the surfaces `[T, N]` or `[T, 1]` and of the
    /// background `[1, N]` or `[1, 1]`: a row `[1, N]`, in the graph if a gradient can flow to the
    /// weights or to the quantity.
    pub fn mean(&self, surfaces: Tensor<2>, background: Option<Tensor<2>>) -> Tensor<2> {
        let mut mean = (self.surfaces.clone() * surfaces.clone()).sum_dim(0);
        if let Some(background) = background {
            mean = mean + self.background.clone() * background;
        }
        // ∂ mean/∂ score_k = W_k·(v_k − mean)
        if self.slopes.is_none() {
            return mean;
        }
        let share = (plain(&surfaces) - plain(&mean)) * self.surfaces.clone();
        match self.change(share) {
            Some(change) => mean + change,
            None => mean,
        }
    }

    /// W of the background `[1, N]`, in the graph if a gradient can flow.
    pub fn attached_background(&self) -> Tensor<2> {
        let [triangles, n] = self.surfaces.dims();
        let like = |shape| Tensor::zeros(shape, (&self.surfaces.device(), self.surfaces.dtype()));
        self.mean(like([triangles, 1]), Some(like([1, n]) + 1.0))
    }

    /// n·d of each pair `[T, N]`, without tape.
    pub fn cosine(&self) -> &Tensor<2> {
        &self.coverage.cosine
    }

    /// Distances to the triangles' planes `[T, N]`, in the graph if a gradient can flow; 0 where
    /// a pair does not count.
    pub fn attached_distances(&self) -> Tensor<2> {
        match &self.coverage.attached {
            Some((t, _)) => t.clone(),
            None => self
                .coverage
                .t
                .clone()
                .mask_fill(self.coverage.counted.clone().bool_not(), 0.0),
        }
    }
}
