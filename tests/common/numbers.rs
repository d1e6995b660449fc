//! Means, errors and differences of numbers, and numbers at random.

/// The mean.
pub fn mean(v: &[f64]) -> f64 {
    v.iter().sum::<f64>() / v.len() as f64
}

/// The mean of independent numbers, and its standard error.
pub fn mean_and_error(v: &[f64]) -> (f64, f64) {
    let (n, mean) = (v.len() as f64, mean(v));
    let squares: f64 = v.iter().map(|x| (x - mean).powi(2)).sum();
    (mean, (squares / (n - 1.0) / n).sqrt())
}

/// The Euclidean length.
pub fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// ‖a − b‖/‖b‖.
#[track_caller]
pub fn apart(a: &[f64], b: &[f64]) -> f64 {
    let difference: Vec<f64> = pairs(a, b).map(|(x, y)| x - y).collect();
    norm(&difference) / norm(b)
}

/// The root of the mean squared difference.
pub fn rmse(a: &[f64], b: &[f64]) -> f64 {
    let squares: f64 = pairs(a, b).map(|(x, y)| (x - y).powi(2)).sum();
    (squares / a.len() as f64).sqrt()
}

/// The largest absolute value; NaN if any is, which `f64::max` passes over.
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    let larger = |m: f64, v: f64| if v.abs() <= m { m } else { v.abs() };
    values
        .into_iter()
        .fold(0.0, |m, v| if m.is_nan() { m } else { larger(m, v) })
}

/// Pairs of two lists, which are of one length and not empty: `zip` passes over what only one of them has.
#[track_caller]
pub fn pairs<'a>(a: &'a [f64], b: &'a [f64]) -> impl Iterator<Item = (f64, f64)> + 'a {
    assert_eq!(a.len(), b.len());
    assert!(!a.is_empty());
    a.iter().copied().zip(b.iter().copied())
}

/// The largest difference of two lists.
#[track_caller]
pub fn furthest(a: &[f64], b: &[f64]) -> f64 {
    largest(pairs(a, b).map(|(a, b)| a - b))
}

/// Numbers in [−1, 1), the same for the same seed.
pub fn noise(n: usize, seed: u64) -> Vec<f64> {
    let mut state = seed;
    let draw = |_| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    (0..n).map(draw).collect()
}
