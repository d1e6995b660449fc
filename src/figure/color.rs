//! Maps signed numbers to colors.

use super::canvas::Rgb;
use crate::error::{Error, Result};
use crate::io::{HostImage, srgb_to_linear};

/// ColorBrewer's RdBu colors at magnitudes 0, ½ and 1.
const WHITE: [f64; 3] = [255.0, 255.0, 255.0];
const RED: [[f64; 3]; 3] = [WHITE, [244.0, 165.0, 130.0], [178.0, 24.0, 43.0]];
const BLUE: [[f64; 3]; 3] = [WHITE, [146.0, 197.0, 222.0], [33.0, 102.0, 172.0]];
const GRAY: [f64; 3] = [128.0, 128.0, 128.0];

/// A diverging color map of signed numbers: white at 0, blue below, red above, darkest from ±scale on. Numbers that are
/// not finite are gray.
///
/// ```
/// use softray::figure::{Diverging, Panel};
/// // Two panels with the same scale.
/// let colors = Diverging::new(0.5)?;
/// let before = Panel::signed("before", 2, 1, vec![-0.4, 0.2]).with_colors(colors);
/// let after = Panel::signed("after", 2, 1, vec![-0.1, 0.0]).with_colors(colors);
/// # let _ = (before, after);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diverging {
    scale: f64,
}

impl Diverging {
    /// Makes a map with its darkest colors at −`scale` and `scale`.
    ///
    /// # Errors
    /// If the scale is not finite and above 0.
    pub fn new(scale: f64) -> Result<Self> {
        Error::unless_positive("figure", "color scale", scale)?;
        Ok(Self { scale })
    }

    /// Makes a map for the given numbers. The scale is the 99th percentile of the magnitudes of numbers that are finite
    /// and not 0, so that a few outliers don't make the rest pale. Without such numbers it is 1.
    pub fn of(values: &[f64]) -> Self {
        let magnitudes = values.iter().map(|v| v.abs());
        let mut magnitudes: Vec<f64> = magnitudes.filter(|&v| v.is_finite() && v > 0.0).collect();
        magnitudes.sort_by(f64::total_cmp);
        let last = (0.99 * magnitudes.len() as f64).ceil() as usize;
        let scale = magnitudes.get(last.saturating_sub(1)).copied();
        Self {
            scale: scale.unwrap_or(1.0),
        }
    }

    /// The magnitude from which on colors are darkest.
    pub(crate) fn scale(&self) -> f64 {
        self.scale
    }

    /// The sRGB-encoded color of a number.
    pub(super) fn encoded(&self, value: f64) -> Rgb {
        if !value.is_finite() {
            return GRAY.map(|c| c as u8);
        }
        let stops = if value < 0.0 { BLUE } else { RED };
        let place = 2.0 * (value.abs() / self.scale).min(1.0);
        let from = if place < 1.0 { 0 } else { 1 };
        let share = place - from as f64;
        let channel = |c| stops[from][c] + share * (stops[from + 1][c] - stops[from][c]);
        std::array::from_fn(|c| channel(c).round() as u8)
    }

    /// The linear RGB color of a number.
    pub(super) fn color(&self, value: f64) -> [f32; 3] {
        let linear = |byte| srgb_to_linear(f32::from(byte) / 255.0);
        self.encoded(value).map(linear)
    }

    /// Colors an image of height · width numbers, row by row from the top.
    pub(super) fn image(&self, width: usize, height: usize, values: &[f64]) -> Result<HostImage> {
        let whole = width.checked_mul(height) == Some(values.len());
        let found = format!("of {} numbers", values.len());
        let expected = format!("one for each of {width} × {height} pixels");
        Error::unless(whole, "figure", "signed image", found, &expected)?;
        let pixels = values.iter().flat_map(|&v| self.color(v));
        HostImage::new(width, height, pixels.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_have_colors_and_magnitudes_have_depths() {
        let map = Diverging::new(2.0).expect("a map");
        assert_eq!(map.encoded(0.0), [255; 3]);
        assert_eq!(map.encoded(2.0), [178, 24, 43]);
        assert_eq!(map.encoded(1e9), map.encoded(2.0));
        assert_eq!(map.encoded(-1.0), [146, 197, 222]);
        assert_eq!(map.encoded(-2.0), [33, 102, 172]);
        assert_eq!(map.encoded(f64::NAN), [128; 3]);
        let mut last = [256, 256];
        for k in 0..=20 {
            let [red, _, blue] = map.encoded(0.1 * f64::from(k)).map(i32::from);
            assert!(red > blue || k == 0);
            assert!(blue < last[0] || blue <= 43, "{k}");
            last = [blue, red];
        }
        let image = map.image(2, 1, &[2.0, -2.0]).expect("an image");
        assert!(image.pixels[0] > image.pixels[2] && image.pixels[3] < image.pixels[5]);
    }

    #[test]
    fn scales_pass_over_outliers() {
        let mut values: Vec<f64> = (0..1000).map(|k| f64::from(k % 10) / 10.0 - 0.5).collect();
        values[17] = 1e6;
        values[18] = f64::NAN;
        assert_eq!(Diverging::of(&values).scale(), 0.5);
        assert_eq!(Diverging::of(&[0.0, -3.0]).scale(), 3.0);
        assert_eq!(Diverging::of(&[0.0]).scale(), 1.0);
    }

    #[test]
    fn mistakes_are_named() {
        for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = Diverging::new(scale).expect_err("no scale").to_string();
            assert!(error.contains("color scale"), "{error}");
        }
        let map = Diverging::new(1.0).expect("a map");
        let error = map.image(2, 2, &[0.0; 3]).expect_err("too few").to_string();
        assert!(error.contains("of 3 numbers"), "{error}");
    }
}
