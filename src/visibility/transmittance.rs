//! The light that passes the triangles along a ray.

use burn::tensor::Tensor;

use super::edge::Coverage;

/// The share of light that passes all counted triangles, ∏(1 − p_k) = exp Σ log(1 − p_k), as a row
/// `[1, N]`; in the graph if a gradient can flow.
///
/// The paper writes 1 − ∏(1 − p_k) for it, which is the opacity.
pub fn transmittance(coverage: &Coverage) -> Tensor<2> {
    let inside = coverage.inside();
    let one_plus = coverage.decay.clone() + 1.0;
    // 1 − p = sigmoid(−logit); a softened pair, which counts only inside,
    // passes 2e/(1 + e).
    let mut passed = coverage
        .decay
        .clone()
        .mask_fill(inside.clone().bool_not(), 1.0)
        / one_plus.clone();
    let slope = coverage.decay.clone().mask_fill(inside, 1.0) / one_plus;
    let discounted = coverage.counted.clone().bool_not();
    if let Some(softened) = &coverage.softened {
        passed = passed.clone().mask_where(softened.clone(), passed * 2.0);
    }
    if let Some((share, _)) = &coverage.begun {
        // 1 − p·share
        let passed = passed.mask_fill(discounted, 1.0);
        let passed = passed.clone() * share.clone() + share.clone().neg() + 1.0;
        let value = passed.clone().log().sum_dim(0).exp();
        let inverse = passed.clamp_min(1e-30).recip().neg();
        return match coverage.by_probability(inverse) {
            Some(change) => value * (change + 1.0),
            None => value,
        };
    }
    let value = passed
        .mask_fill(discounted.clone(), 1.0)
        .log()
        .sum_dim(0)
        .exp();
    // d log(1 − p)/d logit = −p, for softened pairs too.
    match coverage.linear(slope.mask_fill(discounted, 0.0).neg(), None) {
        Some(change) => value * (change + 1.0),
        None => value,
    }
}
