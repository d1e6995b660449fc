//! Powers of delta lights, and running sums.

use crate::model::delta_light::DeltaLight;

/// Returns the sums of the numbers up to and including each.
pub(super) fn running_sums(numbers: impl Iterator<Item = f32>) -> Vec<f32> {
    let sums = numbers.scan(0.0, |sum, p| {
        *sum += p;
        Some(*sum)
    });
    sums.collect()
}

/// Returns the powers of delta lights over π; for a triangle this is area times radiance. Each is at least 0.1 % of the
/// largest, so that black lights count a little.
pub(super) fn powers_of_lights(lights: &[DeltaLight], size: f64) -> impl Iterator<Item = f64> {
    let power = move |l: &DeltaLight| l.power(size);
    let largest = lights.iter().map(power).fold(0.0, f64::max);
    let least = if largest > 0.0 { 1e-3 * largest } else { 1.0 };
    lights.iter().map(move |l| power(l).max(least))
}
