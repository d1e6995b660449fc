//! An image of a figure with its caption and color scale.

use super::Diverging;
use super::axis::Axis;
use super::canvas::{Anchor, Canvas};
use super::text::Font;
use crate::error::{Error, Result};
use crate::io::HostImage;

/// The font sizes of captions and ticks, and the height of a caption's lines.
const CAPTION: f64 = 15.0;
const TICK: f64 = 12.0;
const CAPTION_LINE: usize = 19;
/// The gap between an image and its caption.
const CAPTION_GAP: usize = 6;
/// The width of captions of narrower images.
const NARROWEST: f64 = 140.0;
/// The gap between an image and its color scale, the width of the scale, and the gap before its numbers.
const SCALE: (usize, usize, usize) = (8, 14, 5);

/// An image of a [`Figure`](super::Figure) above its caption.
///
/// Images of radiance are clipped to [0, 1]. Signed images have a diverging color map with a scale beside them. Both
/// are scaled up by an integer factor with sharp pixels.
///
/// [`Figure`](super::Figure) has an example.
#[derive(Clone, Debug)]
pub struct Panel {
    caption: String,
    content: Content,
}

#[derive(Clone, Debug)]
enum Content {
    Radiance(HostImage),
    /// Width and height, one value per pixel, and the color map.
    Signed([usize; 2], Vec<f64>, Diverging),
}

impl Panel {
    /// Makes a panel of an image of linear radiance.
    pub fn new(caption: impl Into<String>, image: &HostImage) -> Self {
        Self {
            caption: caption.into(),
            content: Content::Radiance(image.clone()),
        }
    }

    /// Makes a panel of height · width signed numbers, row by row from the top, such as a derivative or a difference.
    /// Its color map is [`Diverging::of`] the numbers unless [`Panel::with_colors`] sets another.
    pub fn signed(
        caption: impl Into<String>,
        width: usize,
        height: usize,
        values: impl Into<Vec<f64>>,
    ) -> Self {
        let values = values.into();
        let colors = Diverging::of(&values);
        Self {
            caption: caption.into(),
            content: Content::Signed([width, height], values, colors),
        }
    }

    /// Makes a signed image of `a` − `b`, averaged over the channels in each pixel.
    ///
    /// # Errors
    /// If the images have no pixels, if their sizes differ, or if their numbers of values do not match their sizes.
    pub fn difference(caption: impl Into<String>, a: &HostImage, b: &HostImage) -> Result<Self> {
        let caption = caption.into();
        let size = |image: &HostImage| format!("{} × {}", image.width, image.height);
        Error::unless(
            (a.width, a.height) == (b.width, b.height),
            "figure",
            &format!("size of the images of {caption:?}"),
            format!("{} and {}", size(a), size(b)),
            "the same size",
        )?;
        check(&caption, a)?;
        check(&caption, b)?;
        let sum = |p: &[f32]| p.iter().map(|&v| f64::from(v)).sum::<f64>();
        let pairs = a.pixels.chunks_exact(3).zip(b.pixels.chunks_exact(3));
        let values: Vec<f64> = pairs.map(|(a, b)| (sum(a) - sum(b)) / 3.0).collect();
        Ok(Self::signed(caption, a.width, a.height, values))
    }

    /// Sets the color map of a signed image, so that several images can share a scale. An image of radiance does not
    /// change.
    pub fn with_colors(mut self, map: Diverging) -> Self {
        if let Content::Signed(.., colors) = &mut self.content {
            *colors = map;
        }
        self
    }

    /// The color map of a signed image.
    fn map(&self) -> Option<Diverging> {
        match self.content {
            Content::Signed(.., colors) => Some(colors),
            Content::Radiance(_) => None,
        }
    }

    fn image(&self) -> Result<HostImage> {
        let image = match &self.content {
            Content::Signed([width, height], values, map) => map.image(*width, *height, values)?,
            Content::Radiance(image) => image.clone(),
        };
        check(&self.caption, &image)?;
        Ok(image)
    }
}

impl From<(&str, &HostImage)> for Panel {
    fn from((caption, image): (&str, &HostImage)) -> Self {
        Self::new(caption, image)
    }
}

fn check(caption: &str, image: &HostImage) -> Result<()> {
    let (width, height, found) = (image.width, image.height, image.pixels.len());
    let pixels = width.checked_mul(height);
    let values = pixels.and_then(|n| n.checked_mul(3));
    Error::unless(
        pixels != Some(0) && values == Some(found),
        "figure",
        &format!("image {caption:?}"),
        format!("of {found} values for {width} × {height} pixels"),
        "at least one pixel, and three values a pixel",
    )
}

/// The layout of a panel.
pub(super) struct Cell {
    image: HostImage,
    factor: usize,
    caption: Vec<String>,
    scale: Option<Scale>,
    /// The widths of the image with its frame, of the scale beside it, and of the cell.
    frame: usize,
    beside: usize,
    pub width: usize,
}

/// The color scale of an image.
struct Scale {
    map: Diverging,
    axis: Axis,
}

impl Cell {
    /// Lays a panel out with an image about `height` pixels high.
    pub fn new(panel: &Panel, height: usize, font: &Font) -> Result<Self> {
        let image = panel.image()?;
        let factor = (height as f64 / image.height as f64).round().max(1.0) as usize;
        let shown = factor.saturating_mul(image.height);
        let scale = panel.map().map(|map| Scale::new(map, shown));
        let frame = factor.saturating_mul(image.width).saturating_add(2);
        let numbers = |scale: &Scale| scale.axis.widest(font, TICK).ceil() as usize;
        let beside = scale.as_ref();
        let beside = beside.map_or(0, |s| SCALE.0 + SCALE.1 + SCALE.2 + numbers(s));
        let caption = font.wrapped(&panel.caption, CAPTION, NARROWEST.max(frame as f64));
        let widths = caption.iter().map(|line| font.width(line, CAPTION));
        let widest = widths.fold(0.0, f64::max).ceil() as usize;
        Ok(Self {
            image,
            factor,
            caption,
            scale,
            frame,
            beside,
            width: frame.saturating_add(beside).max(widest),
        })
    }

    /// The height of the image with its frame.
    pub fn image_height(&self) -> usize {
        self.factor
            .saturating_mul(self.image.height)
            .saturating_add(2)
    }

    /// The height of the caption with the gap above it.
    pub fn caption_height(&self) -> usize {
        match self.caption.len() {
            0 => 0,
            lines => CAPTION_GAP + CAPTION_LINE * lines,
        }
    }

    /// Draws the cell, with the image above `bottom` and the caption below.
    pub fn draw(&self, (left, bottom): (usize, usize), canvas: &mut Canvas) {
        let inset = (self.width - self.frame - self.beside) / 2;
        canvas.place((left + inset, bottom - self.image_height()));
        canvas.image(&self.image, self.factor, (0, 0));
        if let Some(scale) = &self.scale {
            canvas.place((
                left + inset + self.frame + SCALE.0,
                bottom - self.image_height(),
            ));
            scale.draw(self.image_height(), canvas);
        }
        canvas.place((left, bottom));
        let widths = self.caption.iter().map(|l| canvas.font.width(l, CAPTION));
        let half = 0.5 * widths.fold(0.0, f64::max);
        // Centered below the image if the caption then fits into the cell.
        let middle = inset as f64 + 0.5 * self.frame as f64;
        let middle = middle.min(self.width as f64 - half).max(half);
        for (i, line) in self.caption.iter().enumerate() {
            let at = (middle, (i * CAPTION_LINE) as f64 + 20.0);
            canvas.text(line, CAPTION, at, Anchor::Middle);
        }
    }
}

impl Scale {
    /// Makes a color scale `height` pixels high. It has numbers on both sides of 0 if there is space.
    fn new(map: Diverging, height: usize) -> Self {
        let ends = [-map.scale(), map.scale()].into_iter();
        let mut axis = Axis::around(ends, false, 0.0).divide(5);
        let apart = |axis: &Axis| match axis.ticks[..] {
            [ref a, ref b, ..] => (axis.share(b.0) - axis.share(a.0)) * height as f64,
            _ => f64::INFINITY,
        };
        if apart(&axis) < TICK {
            let last = axis.ticks.len() - 1;
            axis.ticks.drain(1..last);
        }
        if apart(&axis) < TICK {
            axis.ticks.remove(0);
        }
        Self { map, axis }
    }

    /// Draws the scale at the canvas's corner.
    fn draw(&self, height: usize, canvas: &mut Canvas) {
        // The frame is one pixel wide on each side.
        let inside = height - 2;
        let value =
            |row: usize| self.map.scale() * (1.0 - 2.0 * (row as f64 + 0.5) / inside as f64);
        let values: Vec<f64> = (0..inside)
            .flat_map(|row| [value(row)].repeat(SCALE.1 - 2))
            .collect();
        if let Ok(image) = self.map.image(SCALE.1 - 2, inside, &values) {
            canvas.image(&image, 1, (0, 0));
        }
        for (place, label) in &self.axis.ticks {
            let y = 1.0 + (1.0 - self.axis.share(*place)) * inside as f64;
            let right = SCALE.1 as f64;
            let tick = (y - 0.5).round();
            canvas.rectangle((right, tick), (right + 3.0, tick + 1.0), [60; 3]);
            let baseline = (y + 4.0).clamp(9.0, height as f64);
            let at = (right + SCALE.2 as f64, baseline);
            canvas.text(label, TICK, at, Anchor::Left);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn captions_stay_in_their_cells() {
        let font = Font::new().expect("a font");
        let image = HostImage::new(8, 8, vec![0.5; 192]).expect("an image");
        let long = "anextremelylongwordthatnothingbreaks and others";
        let signed = Panel::signed(long, 8, 8, vec![1e-7; 64]);
        for panel in [Panel::new(long, &image), signed] {
            for height in [8, 64, 256] {
                let cell = Cell::new(&panel, height, &font).expect("a cell");
                let widths = cell.caption.iter().map(|l| font.width(l, CAPTION));
                assert!(widths.fold(0.0, f64::max) <= cell.width as f64);
                assert_eq!(cell.image_height(), height + 2);
            }
        }
    }

    /// A pixel that is darker is blue, and one that is lighter is red.
    #[test]
    fn differences_are_signed() {
        let image =
            |a: f32, b: f32| HostImage::new(2, 1, vec![a, a, a, b, b, b]).expect("an image");
        let panel = Panel::difference("d", &image(0.1, 0.5), &image(0.4, 0.2)).expect("a panel");
        let scale = panel.map().expect("a map").scale();
        assert!((scale - 0.3).abs() < 1e-6, "{scale}");
        let colors = panel.image().expect("an image").pixels;
        assert!(colors[0] < colors[2] && colors[3] > colors[5]);
        let wide = panel.with_colors(Diverging::new(3.0).expect("a map"));
        assert_eq!(wide.map().expect("a map").scale(), 3.0);
        assert!(wide.image().expect("an image").pixels[0] > colors[0]);
    }

    #[test]
    fn color_scales_have_numbers_on_both_sides() {
        for k in 0..500 {
            let map = Diverging::new(1e-7 * 1.1f64.powi(k)).expect("a map");
            for height in [64, 256, 1000] {
                let axis = Scale::new(map, height).axis;
                let shares: Vec<f64> = axis.ticks.iter().map(|t| axis.share(t.0)).collect();
                assert!(
                    shares[0] < 0.3 && shares[shares.len() - 1] > 0.7,
                    "{shares:?}"
                );
                let apart = |w: &[f64]| (w[1] - w[0]) * height as f64 >= TICK;
                assert!(
                    shares.windows(2).all(apart) && shares.len() <= 5,
                    "{shares:?}"
                );
            }
        }
        let low = Scale::new(Diverging::new(1.0).expect("a map"), 4);
        assert_eq!(low.axis.ticks.len(), 1);
    }

    #[test]
    fn mistakes_are_named() {
        let image = |side: usize| HostImage {
            width: side,
            height: side,
            pixels: vec![0.0; 12],
        };
        let error = Panel::difference("apart", &image(2), &image(1)).expect_err("sizes differ");
        assert!(error.to_string().contains("2 × 2 and 1 × 1"), "{error}");
        let font = Font::new().expect("a font");
        for panel in [
            Panel::new("few", &image(3)),
            Panel::new("none", &image(0)),
            Panel::signed("few", 2, 2, [0.0; 3]),
            Panel::signed("none", 0, 0, []),
        ] {
            let Err(error) = Cell::new(&panel, 64, &font) else {
                panic!("no error for {panel:?}");
            };
            assert!(error.to_string().starts_with("figure: "), "{error}");
        }
    }
}
