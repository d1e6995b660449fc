//! Sine and cosine that are exact to rounding on every device.

use burn::tensor::Tensor;

/// Sine and cosine to rounding on every device: Vulkan allows their instructions an absolute error
/// of 2⁻¹¹, which shows as a camera with another field of view.
pub(crate) fn sin_cos<const D: usize>(angle: Tensor<D>) -> (Tensor<D>, Tensor<D>) {
    use std::f64::consts::TAU;
    /// The Taylor series serves angles up to π/2^HALVINGS.
    const HALVINGS: i32 = 3;
    // 2π in two parts, the first of few bits, so that whole turns are taken off exactly.
    const HIGH: f64 = 6.28125;
    let turns = (super::context::detached(&angle) / TAU).round();
    let small = angle - turns.clone() * HIGH - turns * (TAU - HIGH);
    let x = small * 0.5f64.powi(HALVINGS);
    let square = x.clone() * x.clone();
    // sin x = x·(1 − x²/(2·3)·(1 − x²/(4·5)·(…))); 1 − cos x = x²/2·(1 − x²/(3·4)·(…)).
    let series = |first: usize| {
        let mut sum = square.ones_like();
        for n in (first..first + 16).step_by(2).rev() {
            sum = (sum * square.clone() * ((n * (n + 1)) as f64).recip()).neg() + 1.0;
        }
        sum
    };
    let mut sin = x * series(2);
    let mut versine = square.clone() * series(3) * 0.5;
    for _ in 0..HALVINGS {
        let cos = versine.clone().neg() + 1.0;
        versine = sin.clone() * sin.clone() * 2.0;
        sin = sin * cos * 2.0;
    }
    (sin, versine.neg() + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{DType, Device, TensorData};

    #[test]
    fn values_and_derivatives_to_rounding() {
        for (dtype, tolerance) in [(DType::F64, 1e-14), (DType::F32, 5e-7)] {
            let device = Device::flex();
            for angle in [-40.0, -3.15, -1.3, -1e-9, 0.0, 1e-3, 0.6, 1.58, 3.0, 25.0] {
                let leaf = || {
                    Tensor::<1>::from_data(TensorData::new(vec![angle], [1]), (&device, dtype))
                        .autodiff()
                        .require_grad()
                };
                let slope = |second: bool| {
                    let x = leaf();
                    let (sin, cos) = sin_cos(x.clone());
                    let gradients = if second { cos } else { sin }.backward();
                    let slope = x.grad(&gradients).map(|g| g.into_scalar::<f64>());
                    slope.unwrap_or(f64::NAN)
                };
                let x = leaf();
                let (sin, cos) = sin_cos(x.clone());
                let value = |y: &Tensor<1>| y.clone().inner().into_scalar::<f64>();
                let rounded = x.clone().inner().into_scalar::<f64>();
                // Rounding of the angle itself, relative to its size.
                let tolerance = tolerance * rounded.abs().max(1.0);
                assert!(
                    (value(&sin) - rounded.sin()).abs() < tolerance,
                    "sin {angle}"
                );
                assert!(
                    (value(&cos) - rounded.cos()).abs() < tolerance,
                    "cos {angle}"
                );
                assert!(
                    (slope(false) - rounded.cos()).abs() < tolerance,
                    "sin' {angle}"
                );
                assert!(
                    (slope(true) + rounded.sin()).abs() < tolerance,
                    "cos' {angle}"
                );
            }
        }
    }
}
