//! The paper's softmax over depth (Eq. 3, corrected): the shares of surfaces in their rays, and the derivatives
//! of these.

use burn::tensor::Tensor;

use super::coverage::Coverage;
use crate::error::{Error, Result};
use crate::geometry::{Context, detached, host_values};
use crate::tensors::rays::DepthRange;

/// The shares of the surfaces of each ray, and of the background.
#[derive(Clone, Debug)]
pub struct Weights {
    /// W_k `[K, N]`, without tape.
    pub surfaces: Tensor<2>,
    /// W of the background `[1, N]`, without tape.
    pub background: Tensor<2>,
    /// Derivatives of the scores, where a gradient can flow.
    slopes: Option<Box<Slopes>>,
}

/// Derivatives of the scores.
#[derive(Clone, Debug)]
struct Slopes {
    coverage: Coverage,
    /// By the logits `[K, N]`.
    logit: Tensor<2>,
    /// By the distances `[1, N]` or `[K, N]`.
    distance: Tensor<2>,
    /// By far `[K, N]`, with its change `[1, N]`.
    far: Option<(Tensor<2>, Tensor<2>)>,
}

impl Weights {
    /// Of N rays that have one surface each, which fills them whatever changes a little.
    pub fn whole(context: &Context, rays: usize) -> Self {
        let background = Tensor::zeros([1, rays], (&context.device, context.dtype));
        Self {
            surfaces: background.ones_like(),
            background,
            slopes: None,
        }
    }

    /// Whether a gradient can flow to them.
    pub fn is_tracked(&self) -> bool {
        self.slopes.is_some()
    }

    /// Draws surfaces of each ray with lists of random numbers in [0, 1): their rows and weights; the number of rows
    /// stands for the background. A surface of weight 0 is never drawn.
    pub fn draw(&self, context: &Context, random: &[Vec<f64>]) -> Result<Vec<Vec<(u32, f64)>>> {
        let cumulative = self.surfaces.clone().cumsum(0);
        let rows = cumulative.dims()[0];
        let total = cumulative.clone().slice([rows - 1..rows]) + self.background.clone();
        let all = Tensor::cat(vec![self.surfaces.clone(), self.background.clone()], 0);
        let one = |random: &Vec<f64>| {
            let threshold = total.clone() * context.row(random);
            let row = cumulative.clone().lower_equal(threshold).int().sum_dim(0);
            let weights = host_values(&all.clone().gather(0, row.clone()))?;
            let rows = row.try_into_data().map_err(Error::read)?;
            Ok(rows.iter::<i64>().map(|k| k as u32).zip(weights).collect())
        };
        random.iter().map(one).collect()
    }

    /// W_k / detach(W_k) of the drawn surfaces `[1, N]`: 1, with the derivative of log W_k.
    /// None if no gradient can flow.
    pub fn ratio(&self, context: &Context, drawn: &[u32]) -> Option<Tensor<2>> {
        let slopes = self.slopes.as_ref()?;
        let share = one_hot(context, drawn, self.surfaces.dims()[0]) - self.surfaces.clone();
        Some(slopes.change(share)? + 1.0)
    }

    /// Σ W_k·v_k + W_background·v of a quantity of the surfaces `[K, N]` or `[K, 1]` and of the
    /// background `[1, N]` or `[1, 1]`: a row `[1, N]`, in the graph if a gradient can flow to the
    /// weights or to the quantity.
    pub fn mean(&self, surfaces: Tensor<2>, background: Option<Tensor<2>>) -> Tensor<2> {
        let mut mean = (self.surfaces.clone() * surfaces.clone()).sum_dim(0);
        if let Some(background) = &background {
            mean = mean + self.background.clone() * background.clone();
        }
        let values = detached(&surfaces).expand(self.surfaces.dims());
        let change = self.slopes.as_ref().and_then(|slopes| {
            // ∂ mean/∂ score_k = W_k·(v_k − mean)
            let share = (values - detached(&mean)) * self.surfaces.clone();
            slopes.change(share)
        });
        match change {
            Some(change) => mean + change,
            None => mean,
        }
    }

    /// W of the background `[1, N]`, in the graph if a gradient can flow.
    pub fn attached_background(&self) -> Tensor<2> {
        let zero = self.background.zeros_like().expand(self.surfaces.dims());
        self.mean(zero, Some(self.background.ones_like()))
    }
}

impl Slopes {
    /// A row `[1, N]` that is 0 and has the derivative of Σ share_k·score_k.
    fn change(&self, share: Tensor<2>) -> Option<Tensor<2>> {
        let change = self.coverage.linear(
            share.clone() * self.logit.clone(),
            Some(share.clone() * self.distance.clone()),
        )?;
        Some(match self.far.clone() {
            Some((slope, far)) => change + (share * slope).sum_dim(0) * far,
            None => change,
        })
    }
}

/// 1 at the drawn row of each column, else 0.
fn one_hot(context: &Context, drawn: &[u32], rows: usize) -> Tensor<2> {
    let numbers: Vec<f64> = (0..rows).map(|k| k as f64).collect();
    let row: Vec<f64> = drawn.iter().map(|&k| f64::from(k)).collect();
    let hit = context.column(&numbers).equal(context.row(&row));
    hit.float().cast(context.dtype)
}

/// The parameters of the paper's form, with its order by depth: the score of a surface is z/γ, z = (far −
/// t)/(far − near), and that of the background ε/γ.
#[derive(Clone, Copy, Debug)]
pub struct Softmax {
    /// Blur of edges σ, a length squared.
    pub sigma: f64,
    /// Blur in depth γ, in units of the scene's depth.
    pub gamma: f64,
    /// ε, the score of the background.
    pub epsilon: f64,
}

impl Softmax {
    /// The score of the background.
    pub fn background(&self) -> f64 {
        self.epsilon / self.gamma
    }

    /// The distance along a ray that divides a weight by e, and the one at which a surface has the score of the
    /// background: what lies far behind it can't matter.
    pub(super) fn falloff(&self, near: f64, far: f64) -> [f64; 2] {
        let depth = far - near;
        [self.gamma * depth, far - self.epsilon * depth]
    }
}

/// Weights of all surfaces of each ray: softmax over log p_k + z_k/γ and ε/γ for the background.
pub fn weights(coverage: Coverage, range: DepthRange, form: Softmax) -> Weights {
    let DepthRange { near, far, change } = range;
    let per_depth = (far.clone() - near.clone()).recip() / form.gamma;
    let score = (far.clone() - coverage.t.clone()) * per_depth.clone();
    let mut discounted = coverage.counted.clone().bool_not();
    if let Some((share, _)) = &coverage.begun {
        discounted = discounted.bool_or(share.clone().lower_elem(1e-30));
    }
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
    if let Some((share, _)) = &coverage.begun {
        exponent = exponent + share.clone().mask_fill(discounted.clone(), 1.0).log();
    }
    let exponent = exponent.mask_fill(discounted.clone(), -1e30);
    let background = form.background();
    let largest = exponent.clone().max_dim(0).clamp_min(background);
    let one_plus = coverage.decay.clone() + 1.0;
    let weight = (exponent - largest.clone()).exp() / one_plus.clone();
    let weight = weight.mask_fill(discounted.clone(), 0.0);
    let rest = (largest.neg() + background).exp();
    let total = weight.clone().sum_dim(0) + rest.clone();
    let weights = Weights {
        surfaces: weight / total.clone(),
        background: rest / total,
        slopes: None,
    };
    if coverage.attached.is_none() {
        return weights;
    }
    let slopes = {
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
            logit: slope.mask_fill(discounted.clone(), 0.0),
            distance: match &coverage.begun {
                Some((share, slope)) => {
                    let share = share.clone().mask_fill(discounted.clone(), 1.0);
                    (slope.clone() / share - per_depth.clone()).mask_fill(discounted, 0.0)
                }
                None => per_depth.clone().neg(),
            },
            far,
            coverage,
        }
    };
    Weights {
        slopes: Some(Box::new(slopes)),
        ..weights
    }
}
