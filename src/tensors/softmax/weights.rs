//! The paper's softmax over depth (Eq. 2 and 3, corrected): the shares of surfaces in their rays.

use burn::tensor::Tensor;

use super::coverage::Coverage;
use crate::error::{Error, Result};
use crate::geometry::{Context, Vec3, detached, gather_row, host_values};

/// The parameters of the paper's form, with its order by depth. The score of a surface is z/γ with z = (far − t)/(far −
/// near), and the score of the background is ε/γ.
#[derive(Clone, Copy, Debug)]
pub struct Softmax {
    /// Blur of edges σ, a squared length.
    pub sigma: f64,
    /// Blur in depth γ, in units of the scene's depth.
    pub gamma: f64,
    /// ε, which sets the score ε/γ of the background.
    pub epsilon: f64,
}

impl Softmax {
    /// Returns the least and the largest distance along a ray over which a weight decreases by a factor of e, and the
    /// distance at which a surface has the background's score. Surfaces far behind it cannot matter.
    pub(super) fn falloff(&self, near: f64, far: f64) -> [f64; 3] {
        let depth = far - near;
        let falloff = self.gamma * depth;
        [falloff, falloff, far - self.epsilon * depth]
    }
}

/// The shares of the surfaces of each ray, and of the background, tracked with rays and triangles.
#[derive(Clone, Debug)]
pub struct Weights {
    /// W_k `[K, N]`.
    pub surfaces: Tensor<2>,
    /// W of the background `[1, N]`.
    pub background: Tensor<2>,
}

/// Returns the weights of all surfaces of each ray: a softmax over log p_k + z_k/γ, and ε/γ for the background. Between
/// near and far, a ray may meet the bounds, a sphere of `radius` about the point that `origin` is relative to. Near and
/// far are tracked with `origin`.
pub fn weights(coverage: &Coverage, origin: &Vec3, radius: f64, form: Softmax) -> Weights {
    // Not 0, since the derivative of the square root is infinite there.
    let square = origin.dot(origin).clamp_min(1e-12 * radius * radius);
    let distance = square.sqrt();
    let (near, far) = (
        (distance.clone() - radius).clamp_min(0.0),
        distance + radius,
    );
    let per_depth = (far.clone() - near).recip() / form.gamma;
    let score = (far - coverage.t.clone()) * per_depth;
    let exponent = coverage.log_probability() + score;
    let exponent = exponent.mask_fill(coverage.discounted.clone(), -1e30);
    // The exponents are shifted by the largest one, so that none overflows.
    let background = form.epsilon / form.gamma;
    let largest = detached(&exponent).max_dim(0).clamp_min(background);
    let weight = (exponent - largest.clone()).exp();
    let rest = (largest.neg() + background).exp();
    let total = weight.clone().sum_dim(0) + rest.clone();
    Weights {
        surfaces: weight / total.clone(),
        background: rest / total,
    }
}

impl Weights {
    /// Returns the weights of N rays that each have one surface, which still covers the ray after small changes, or
    /// none.
    pub fn certain(context: &Context, rays: usize, surface: bool) -> Self {
        let of = |is: bool| {
            let zeros = Tensor::zeros([1, rays], (&context.device, context.dtype));
            if is { zeros + 1.0 } else { zeros }
        };
        Self {
            surfaces: of(surface),
            background: of(!surface),
        }
    }

    /// Draws surfaces of each ray with lists of random numbers in [0, 1). Returns rows and weights. The number of rows
    /// stands for the background. A surface of weight 0 is never drawn.
    pub fn draw(&self, context: &Context, random: &[Vec<f64>]) -> Result<Vec<Vec<(u32, f64)>>> {
        let (surfaces, background) = (detached(&self.surfaces), detached(&self.background));
        let cumulative = surfaces.clone().cumsum(0);
        let rows = cumulative.dims()[0];
        let total = cumulative.clone().slice([rows - 1..rows]) + background.clone();
        let all = Tensor::cat(vec![surfaces, background], 0);
        let one = |random: &Vec<f64>| {
            // Numbers in f64 may round to 1.
            let most = 1.0 - context.epsilon();
            let random: Vec<f64> = random.iter().map(|u| u.min(most)).collect();
            let threshold = total.clone() * context.row(&random);
            let row = cumulative.clone().lower_equal(threshold).int().sum_dim(0);
            let weights = host_values(&all.clone().gather(0, row.clone()))?;
            let rows = row.try_into_data().map_err(Error::read)?;
            Ok(rows.iter::<i64>().map(|k| k as u32).zip(weights).collect())
        };
        random.iter().map(one).collect()
    }

    /// Returns W / detach(W) of drawn pairs (row, ray) as a row: 1, with the derivative of log W.
    pub fn ratio(&self, context: &Context, drawn: &[(usize, usize)]) -> Tensor<2> {
        let all = Tensor::cat(vec![self.surfaces.clone(), self.background.clone()], 0);
        let rays = all.dims()[1];
        let index: Vec<u32> = drawn
            .iter()
            .map(|(row, ray)| (row * rays + ray) as u32)
            .collect();
        let weight = gather_row(all, &context.index_row(&index));
        weight.clone() / detached(&weight).clamp_min(1e-37)
    }

    /// Returns the mean Σ W_k·v_k + W_background·v as a row `[1, N]`. v is `[K, N]` or `[K, 1]` for surfaces, and `[1,
    /// N]` or `[1, 1]` for the background.
    pub fn mean(&self, surfaces: Tensor<2>, background: Option<Tensor<2>>) -> Tensor<2> {
        let mean = (self.surfaces.clone() * surfaces).sum_dim(0);
        match background {
            Some(background) => mean + self.background.clone() * background,
            None => mean,
        }
    }
}
