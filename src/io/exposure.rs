//! Exposure of images for 8-bit pictures, whose range of brightness is small.

use super::HostImage;

/// The median luminance of the lit pixels of a well-exposed picture: the luminance of a gray card.
const GRAY: f64 = 0.18;

/// The deviation from [`GRAY`], in stops, above which a picture counts as too bright or too dark. A white surface in
/// white light is 2.5 stops brighter.
const TOLERANCE: f64 = 3.0;

impl HostImage {
    /// Returns the image with all values multiplied by 2 to the power of `stops`.
    pub fn exposed(&self, stops: f64) -> Self {
        let factor = stops.exp2() as f32;
        Self {
            pixels: self.pixels.iter().map(|v| v * factor).collect(),
            ..*self
        }
    }

    /// Returns the stops for [`HostImage::exposed`] that make the image visible in an 8-bit picture.
    ///
    /// The result is 0 if the median luminance of the lit pixels is within 3 stops of a gray card's, 0.18. Otherwise
    /// it brings the median to 0.18, rounded to a tenth of a stop. For instance, lamps in candela or watts make a
    /// picture white without it.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let picture = |value: f32| HostImage::new(2, 1, vec![value; 6]);
    /// assert_eq!(picture(0.9)?.automatic_exposure(), 0.0);
    /// assert_eq!(picture(0.18 * 1024.0)?.automatic_exposure(), -10.0);
    /// # Ok::<(), softray::Error>(())
    /// ```
    pub fn automatic_exposure(&self) -> f64 {
        let luminance = |p: &[f32]| {
            let [r, g, b] = [0, 1, 2].map(|c| f64::from(p[c]));
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        let pixels = self.pixels.chunks_exact(3).map(luminance);
        let mut lit: Vec<f64> = pixels.filter(|l| l.is_finite() && *l > 0.0).collect();
        if lit.is_empty() {
            return 0.0;
        }
        let middle = lit.len() / 2;
        let (_, median, _) = lit.select_nth_unstable_by(middle, f64::total_cmp);
        let stops = (GRAY / *median).log2();
        match stops.abs() > TOLERANCE {
            true => (10.0 * stops).round() / 10.0,
            false => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(values: &[f32]) -> HostImage {
        let pixels: Vec<f32> = values.iter().flat_map(|&v| [v; 3]).collect();
        HostImage::new(values.len(), 1, pixels).expect("an image")
    }

    #[test]
    fn pictures_that_show_something_stay() {
        assert_eq!(image(&[0.03, 0.2, 1.0]).automatic_exposure(), 0.0);
        assert_eq!(image(&[0.0; 3]).automatic_exposure(), 0.0);
        assert_eq!(image(&[f32::NAN]).automatic_exposure(), 0.0);
    }

    #[test]
    fn the_median_of_what_is_lit_becomes_gray() {
        // Neither the black background nor the far brighter pixel changes the median.
        let candela = image(&[0.0, 0.0, 0.0, 90.0, 100.0, 1e6]);
        let stops = candela.automatic_exposure();
        let shown = candela.exposed(stops);
        assert!((shown.pixels[12] - 0.18).abs() < 0.01, "{stops}");
        let dark = image(&[0.001, 0.002, 0.003]);
        let shown = dark.exposed(dark.automatic_exposure());
        assert!((shown.pixels[3] - 0.18).abs() < 0.01);
    }
}
