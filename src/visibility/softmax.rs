//! The paper's softmax over depth (Eq. 3, corrected).

use super::depth::DepthRange;
use super::edge::Coverage;
use super::weights::{Slopes, Weights};

/// The parameters of the paper's form.
#[derive(Clone, Copy, Debug)]
pub struct Softmax {
    /// Blur of edges σ, a length squared.
    pub sigma: f64,
    /// Blur in depth γ, in units of the scene's depth.
    pub gamma: f64,
    /// ε, the score of the background.
    pub epsilon: f64,
}

/// Weights of all surfaces of each ray: softmax over log p_k + z_k/γ and ε/γ for the background.
pub fn weights(coverage: Coverage, range: DepthRange, form: Softmax) -> Weights {
    let Softmax { gamma, epsilon, .. } = form;
    let DepthRange { near, far, change } = range;
    let per_depth = (far.clone() - near.clone()).recip() / gamma;
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
    let background = epsilon / gamma;
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
            logit: slope.mask_fill(discounted.clone(), 0.0),
            distance: match &coverage.begun {
                Some((share, slope)) => {
                    let share = share.clone().mask_fill(discounted.clone(), 1.0);
                    (slope.clone() / share - per_depth.clone()).mask_fill(discounted, 0.0)
                }
                None => per_depth.clone().neg(),
            },
            far,
        }
    });
    Weights {
        surfaces: weight / total.clone(),
        background: rest / total,
        coverage,
        slopes: slopes.map(Box::new),
    }
}
