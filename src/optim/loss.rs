//! Losses between images, in the graph; all return a scalar `[1]`.

use burn::tensor::Tensor;

/// Mean squared difference. Of one noisy render its expectation is too large by the variance of
/// the noise, and its gradient is off by the gradient of that variance: see [`mse_unbiased`].
pub fn mse(image: Tensor<3>, target: Tensor<3>) -> Tensor<1> {
    let difference = image - target;
    (difference.clone() * difference).mean()
}

/// Mean of (a − target)·(b − target) of two renders with independent seeds. Its expectation is the
/// squared difference of the *converged* image, and its gradient that of it: the noise of one
/// does not meet itself. It may be negative.
pub fn mse_unbiased(a: Tensor<3>, b: Tensor<3>, target: Tensor<3>) -> Tensor<1> {
    ((a - target.clone()) * (b - target)).mean()
}
