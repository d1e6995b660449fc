//! A page with images, lines and text. All lengths are in pixels.

use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Rect, StrokeDash,
    Transform,
};

use super::text::Font;
use crate::error::{Error, Result};
use crate::io::{HostImage, srgb_byte, srgb_to_linear};

/// An sRGB-encoded color.
pub(super) type Rgb = [u8; 3];

/// The color of images' frames.
const FRAME: Rgb = [190; 3];
const BLACK: Rgb = [0; 3];
/// The maximum number of pixels of a page.
const MAX_PIXELS: u64 = 1 << 27;

/// A white page. Positions are relative to a movable corner.
pub(super) struct Canvas {
    page: Pixmap,
    pub font: Font,
    corner: (f64, f64),
}

/// The point of a line of text, on its baseline, that lies at a given position. `Up` is the middle of text that runs
/// upward.
#[derive(Clone, Copy)]
pub(super) enum Anchor {
    Left,
    Middle,
    Right,
    Up,
}

/// The style of a line.
#[derive(Clone, Copy)]
pub(super) struct Stroke {
    pub color: Rgb,
    pub width: f64,
    /// The lengths of dashes and of the gaps between them.
    pub dashes: Option<(f64, f64)>,
}

impl Canvas {
    /// # Errors
    /// If the page would have no pixels, or too many.
    pub fn new(width: usize, height: usize, font: Font) -> Result<Self> {
        let sides = u32::try_from(width).ok().zip(u32::try_from(height).ok());
        let page = sides.filter(|&(w, h)| u64::from(w) * u64::from(h) <= MAX_PIXELS);
        let page = page.and_then(|(w, h)| Pixmap::new(w, h));
        let Some(mut page) = page else {
            return Err(Error::invalid(
                "figure",
                "size",
                format!("{width} × {height}"),
                format!("at least one pixel and at most {MAX_PIXELS}"),
            ));
        };
        page.fill(Color::WHITE);
        Ok(Self {
            page,
            font,
            corner: (0.0, 0.0),
        })
    }

    /// Sets the corner to which later positions are relative.
    pub fn place(&mut self, (left, top): (usize, usize)) {
        self.corner = (left as f64, top as f64);
    }

    /// Converts the page to linear radiance.
    pub fn into_image(self) -> HostImage {
        let linear = |byte: &u8| srgb_to_linear(f32::from(*byte) / 255.0);
        let pixels = self.page.data().chunks_exact(4);
        HostImage {
            width: self.page.width() as usize,
            height: self.page.height() as usize,
            pixels: pixels.flat_map(|p| p[..3].iter().map(linear)).collect(),
        }
    }

    /// Draws an image with a frame of one pixel around it. Each image pixel is `factor` pixels wide and high. The given
    /// corner is the frame's.
    pub fn image(&mut self, image: &HostImage, factor: usize, (left, top): (usize, usize)) {
        let (left, top) = (left + self.corner.0 as usize, top + self.corner.1 as usize);
        let (width, height) = (factor * image.width, factor * image.height);
        let (columns, rows) = (self.page.width() as usize, self.page.height() as usize);
        let bytes = self.page.data_mut();
        for y in (0..height + 2).take_while(|y| top + y < rows) {
            for x in (0..width + 2).take_while(|x| left + x < columns) {
                let inside = (1..=width).contains(&x) && (1..=height).contains(&y);
                let color = if inside {
                    let source = (y - 1) / factor * image.width + (x - 1) / factor;
                    std::array::from_fn(|c| srgb_byte(image.pixels[3 * source + c]))
                } else {
                    FRAME
                };
                let start = 4 * ((top + y) * columns + left + x);
                bytes[start..start + 3].copy_from_slice(&color);
            }
        }
    }

    fn transform(&self) -> Transform {
        Transform::from_translate(self.corner.0 as f32, self.corner.1 as f32)
    }

    /// Draws a filled rectangle from its upper left to its lower right corner.
    pub fn rectangle(&mut self, from: (f64, f64), to: (f64, f64), color: Rgb) {
        let [left, top, right, bottom] = [from.0, from.1, to.0, to.1].map(|v| v as f32);
        if let Some(rectangle) = Rect::from_ltrb(left, top, right, bottom) {
            let transform = self.transform();
            self.page
                .fill_rect(rectangle, &paint(color), transform, None);
        }
    }

    /// Draws a polyline through points.
    pub fn line(&mut self, points: &[(f64, f64)], stroke: Stroke) {
        let mut path = PathBuilder::new();
        for (i, &(x, y)) in points.iter().enumerate() {
            let (x, y) = (x as f32, y as f32);
            if i == 0 {
                path.move_to(x, y);
            } else {
                path.line_to(x, y);
            }
        }
        let dashes = stroke.dashes.map(|(on, off)| vec![on as f32, off as f32]);
        let style = tiny_skia::Stroke {
            width: stroke.width as f32,
            line_cap: match dashes {
                Some(_) => LineCap::Butt,
                None => LineCap::Round,
            },
            line_join: LineJoin::Round,
            dash: dashes.and_then(|d| StrokeDash::new(d, 0.0)),
            ..Default::default()
        };
        if let Some(path) = path.finish() {
            let transform = self.transform();
            self.page
                .stroke_path(&path, &paint(stroke.color), &style, transform, None);
        }
    }

    pub fn dot(&mut self, (x, y): (f64, f64), color: Rgb) {
        if let Some(circle) = PathBuilder::from_circle(x as f32, y as f32, 3.0) {
            self.fill(&circle, color, self.transform());
        }
    }

    /// Draws a line of text.
    pub fn text(&mut self, text: &str, size: f64, (x, y): (f64, f64), anchor: Anchor) {
        let width = self.font.width(text, size);
        let shift = match anchor {
            Anchor::Left => 0.0,
            Anchor::Middle | Anchor::Up => -0.5 * width,
            Anchor::Right => -width,
        };
        let turn = match anchor {
            Anchor::Up => -90.0,
            _ => 0.0,
        };
        if let Some(letters) = self.font.outlines(text, size) {
            let transform = self.transform().pre_translate(x as f32, y as f32);
            let transform = transform.pre_concat(Transform::from_rotate(turn));
            self.fill(&letters, BLACK, transform.pre_translate(shift as f32, 0.0));
        }
    }

    fn fill(&mut self, path: &Path, color: Rgb, transform: Transform) {
        let paint = paint(color);
        self.page
            .fill_path(path, &paint, FillRule::Winding, transform, None);
    }
}

fn paint([r, g, b]: Rgb) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(r, g, b, 255);
    paint
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The ranges of columns and rows that are not white.
    fn inked(image: &HostImage) -> [std::ops::RangeInclusive<usize>; 2] {
        let dark = |i: &usize| image.pixels[3 * i] < 0.9;
        let dark: Vec<usize> = (0..image.width * image.height).filter(dark).collect();
        let range = |of: &dyn Fn(usize) -> usize| {
            let places = dark.iter().map(|&i| of(i));
            places.clone().min().expect("ink")..=places.max().expect("ink")
        };
        [range(&|i| i % image.width), range(&|i| i / image.width)]
    }

    fn canvas() -> Canvas {
        Canvas::new(200, 100, Font::new().expect("a font")).expect("a page")
    }

    #[test]
    fn text_is_where_its_anchor_says() {
        for (anchor, expected) in [
            (Anchor::Left, 100.0),
            (Anchor::Middle, 70.0),
            (Anchor::Right, 40.0),
        ] {
            let mut canvas = canvas();
            let size = canvas.font.fitting("HHHHH", 100.0, 60.0);
            canvas.text("HHHHH", size, (100.0, 50.0), anchor);
            let [columns, rows] = inked(&canvas.into_image());
            let (left, right) = (*columns.start() as f64, *columns.end() as f64);
            assert!((left - expected).abs() < 3.0, "{columns:?}");
            assert!((right - expected - 60.0).abs() < 3.0, "{columns:?}");
            assert_eq!(*rows.end(), 49);
        }
        let mut canvas = canvas();
        let size = canvas.font.fitting("HHHHH", 100.0, 60.0);
        canvas.text("HHHHH", size, (100.0, 50.0), Anchor::Up);
        let [columns, rows] = inked(&canvas.into_image());
        assert_eq!(*columns.end(), 99);
        assert!(rows.start().abs_diff(20) < 3 && rows.end().abs_diff(79) < 3);
    }

    #[test]
    fn images_keep_their_pixels() {
        let mut canvas = canvas();
        let image = HostImage::new(2, 1, vec![0.2, 0.0, 0.0, 0.8, 0.0, 0.0]).expect("an image");
        canvas.place((10, 20));
        canvas.image(&image, 3, (0, 0));
        let page = canvas.into_image();
        let red = |x: usize, y: usize| page.pixels[3 * (y * 200 + x)];
        assert!((red(11, 21) - 0.2).abs() < 0.01 && (red(13, 23) - 0.2).abs() < 0.01);
        assert!((red(14, 21) - 0.8).abs() < 0.01 && (red(16, 23) - 0.8).abs() < 0.01);
        assert!((red(10, 20) - red(17, 24)).abs() < 1e-6 && red(18, 20) == 1.0);
        assert!(Canvas::new(1 << 20, 1 << 10, Font::new().expect("a font")).is_err());
    }
}
