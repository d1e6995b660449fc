//! Two sampling strategies combined.

/// The divisor of a sample where two strategies with densities a and b are combined: w₁ = p₁²/(p₁² + p₂²)
/// makes it (p₁² + p₂²)/p₁ (the power heuristic, Veach and Guibas 1995).
#[inline(always)]
pub(crate) fn power_heuristic(a: f32, b: f32, is_b: bool) -> f32 {
    let own = if is_b { b } else { a };
    (a * a + b * b) / own.max(1e-20)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The weights of both strategies, density over divisor, add up to 1.
    #[test]
    fn weights_of_both_strategies() {
        for (a, b) in [(0.3, 0.7), (2.0, 0.0), (1e-3, 5.0)] {
            let sum = a / power_heuristic(a, b, false) + b / power_heuristic(a, b, true);
            assert!((sum - 1.0).abs() < 1e-6, "{a} {b}: {sum}");
        }
    }
}
