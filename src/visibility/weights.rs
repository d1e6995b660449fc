//! The shares of surfaces in their rays, and the derivatives of these.

use burn::tensor::Tensor;

use super::edge::Coverage;
use crate::error::{Error, Result};
use crate::geometry::{Context, detached};

/// The shares of the surfaces of each ray, and of the background.
#[derive(Clone, Debug)]
pub struct Weights {
    /// W_k `[T, N]`, without tape.
    pub surfaces: Tensor<2>,
    /// W of the background `[1, N]`, without tape.
    pub background: Tensor<2>,
    pub(super) coverage: Coverage,
    /// Derivatives of the scores, where a gradient can flow.
    pub(super) slopes: Option<Box<Slopes>>,
}

/// Derivatives of the scores.
#[derive(Clone, Debug)]
pub(super) struct Slopes {
    /// By the logits `[T, N]`.
    pub logit: Tensor<2>,
    /// By the distances `[1, N]` or `[T, N]`.
    pub distance: Tensor<2>,
    /// By far `[T, N]`, with its change `[1, N]`.
    pub far: Option<(Tensor<2>, Tensor<2>)>,
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
        let data = index.try_into_data().map_err(Error::read)?;
        Ok(data.iter::<i64>().map(|k| k as u32).collect())
    }

    /// W of one surface of each ray, or of the background, on the host.
    ///
    /// # Errors
    /// If they can't be read back.
    pub fn of(&self, context: &Context, drawn: &[u32]) -> Result<Vec<f64>> {
        let all = Tensor::cat(vec![self.surfaces.clone(), self.background.clone()], 0);
        crate::geometry::host_values(&all.gather(0, context.index_row(drawn)))
    }

    /// W_k / detach(W_k) of the drawn surfaces `[1, N]`: 1, with the derivative of log W_k.
    /// None if no gradient can flow.
    pub fn ratio(&self, context: &Context, drawn: &[u32]) -> Option<Tensor<2>> {
        let slopes = self.slopes.as_ref()?;
        let share = one_hot(context, drawn, self.surfaces.dims()[0]) - self.surfaces.clone();
        Some(slopes.change(&self.coverage, share)? + 1.0)
    }

    /// Σ W_k·v_k + W_background·v of a quantity of the surfaces `[T, N]` or `[T, 1]` and of the
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
            slopes.change(&self.coverage, share)
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

impl Slopes {
    /// A row `[1, N]` that is 0 and has the derivative of Σ share_k·score_k.
    pub fn change(&self, coverage: &Coverage, share: Tensor<2>) -> Option<Tensor<2>> {
        let change = coverage.linear(
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
