//! Angles in degrees that look like radians.

use super::Parameter;
use crate::warnings::warning;

/// Warns if a constant angle in degrees is an integer number of degrees in radians, as `30f64.to_radians()` is.
pub(crate) fn warn_of_radians(of: &str, angle: &Parameter<1>) {
    let Parameter::Constant([angle]) = *angle else {
        return;
    };
    if let Some(meant) = meant_by(angle) {
        warning!("{of} is {angle}°, which is {meant}° in radians: angles are in degrees");
    }
}

/// Returns the integer number of degrees, at most a turn, whose radians an angle is to the precision of f32. Angles that
/// somebody writes as degrees are not among them.
fn meant_by(angle: f64) -> Option<f64> {
    let degrees = angle.to_degrees();
    let meant = degrees.round();
    let is = (1.0..=360.0).contains(&meant.abs()) && (degrees - meant).abs() <= 2e-7 * meant.abs();
    is.then_some(meant)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radians_are_distinguished_from_degrees() {
        for degrees in [1.0, -30.0, 45.0, 90.0, 360.0f64] {
            assert_eq!(meant_by(degrees.to_radians()), Some(degrees));
            let single = (degrees as f32).to_radians();
            assert_eq!(meant_by(f64::from(single)), Some(degrees));
        }
        for angle in (0..=36_000).map(|i| f64::from(i) / 100.0) {
            assert_eq!(meant_by(angle), None, "{angle}");
        }
    }
}
