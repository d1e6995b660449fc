//! Exposure of images for pictures of 8 bits, which hold little of what light has.

use super::HostImage;

/// The luminance that half of the lit pixels of a well-exposed picture exceed: that of a grey card.
const GREY: f64 = 0.18;

/// Stops by which a picture may miss that before it counts as too bright or too dark: a white surface in white
/// light is 2.5 brighter.
const TOLERANCE: f64 = 3.0;

impl HostImage {
    /// The image with all values times 2 to the power of these stops.
    pub fn exposed(&self, stops: f64) -> Self {
        let factor = stops.exp2() as f32;
        Self {
            pixels: self.pixels.iter().map(|v| v * factor).collect(),
            ..*self
        }
    }

    /// The stops for [`HostImage::exposed`] with which a picture of 8 bits shows what is in the image: 0 where it
    /// shows it as it is, and otherwise those that bring the median luminance of its lit pixels to that of a grey
    /// card, 0.18, to a tenth. It is otherwise where lamps are given in candela or watts, for instance: the picture
    /// would be white.
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
        let stops = (GREY / *median).log2();
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
    fn the_median_of_what_is_lit_becomes_grey() {
        // The black background and what is far brighter do not count.
        let candela = image(&[0.0, 0.0, 0.0, 90.0, 100.0, 1e6]);
        let stops = candela.automatic_exposure();
        let shown = candela.exposed(stops);
        assert!((shown.pixels[12] - 0.18).abs() < 0.01, "{stops}");
        let dark = image(&[0.001, 0.002, 0.003]);
        let shown = dark.exposed(dark.automatic_exposure());
        assert!((shown.pixels[3] - 0.18).abs() < 0.01);
    }
}
