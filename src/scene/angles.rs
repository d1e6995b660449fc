//! Angles in degrees that look like radians.

use super::Parameter;
use softray_kernels::warnings::warn_once;

/// Warns if a constant angle in degrees is an integer number of degrees in radians, as `30f64.to_radians()` is.
pub(crate) fn warn_of_radians(of: &'static str, angle: &Parameter<1>) {
    let Parameter::Constant([angle]) = *angle else {
        return;
    };
    if let Some(meant) = meant_by(angle) {
        let text =
            format_args!("{of} is {angle}°, which is {meant}° in radians: angles are in degrees");
        warn_once(of, text);
    }
}

/// Warns if a field of view in degrees is so narrow that it may be one in radians.
pub(crate) fn warn_of_narrow_view(of: &'static str, degrees: f64) {
    warn_of_radians(of, &Parameter::Constant([degrees]));
    if let Some(meant) = narrow_in_radians(degrees) {
        let text = format_args!(
            "{of} is {degrees}°: it is in degrees, and {degrees} radians are {meant:.1}° (if it is meant to be narrow, \
             ignore this)"
        );
        warn_once(of, text);
    }
}

/// Returns the degrees that a field of view would have in radians, if these are common. The result is `None` for angles
/// that [`warn_of_radians`] warns of.
pub(crate) fn narrow_in_radians(angle: f64) -> Option<f64> {
    let degrees = angle.to_degrees();
    let is = (10.0..=125.0).contains(&degrees) && meant_by(angle).is_none();
    is.then_some(degrees)
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

    #[test]
    fn narrow_fields_of_view_may_be_in_radians() {
        for angle in [0.7, 1.0, 2.0f64] {
            assert_eq!(narrow_in_radians(angle), Some(angle.to_degrees()));
        }
        // Too narrow or too wide in radians, and one that has the other warning.
        for angle in [0.1, 2.5, 40.0, 40f64.to_radians()] {
            assert_eq!(narrow_in_radians(angle), None, "{angle}");
        }
    }
}
