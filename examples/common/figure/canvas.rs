//! What figures are drawn on: pixels for images, a pen for lines and letters. All lengths are
//! pixels of the finished figure.

use std::error::Error;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use softray::prelude::*;

/// Lines and letters are drawn larger and averaged: they are smooth so.
const OVERSAMPLING: usize = 3;
const FONT: &str = "sans-serif";

/// A page, white at first, of linear radiance.
pub struct Canvas {
    page: HostImage,
}

impl Canvas {
    pub fn new(width: usize, height: usize) -> Self {
        let pixels = vec![1.0; width * height * 3];
        Self {
            page: HostImage {
                width,
                height,
                pixels,
            },
        }
    }

    pub fn into_image(self) -> HostImage {
        self.page
    }

    fn pixel(&mut self, x: usize, y: usize, radiance: [f32; 3]) {
        if x < self.page.width && y < self.page.height {
            let start = 3 * (y * self.page.width + x);
            self.page.pixels[start..start + 3].copy_from_slice(&radiance);
        }
    }

    /// An image, each pixel of which is `factor` pixels wide and high, in a thin grey frame that
    /// lies around it.
    pub fn image(&mut self, image: &HostImage, factor: usize, (left, top): (usize, usize)) {
        let (width, height) = (factor * image.width, factor * image.height);
        let grey = [srgb(190.0); 3];
        for y in 0..height + 2 {
            for x in 0..width + 2 {
                let inside = (1..=width).contains(&x) && (1..=height).contains(&y);
                let radiance = if inside {
                    let source = (y - 1) / factor * image.width + (x - 1) / factor;
                    std::array::from_fn(|c| image.pixels[3 * source + c])
                } else {
                    grey
                };
                self.pixel(
                    (left + x).wrapping_sub(1),
                    (top + y).wrapping_sub(1),
                    radiance,
                );
            }
        }
    }

    /// Gives a white part of the page to a pen, whose coordinates start at the part's corner.
    pub fn draw(
        &mut self,
        (left, top): (usize, usize),
        (width, height): (usize, usize),
        with: impl FnOnce(&Pen) -> Result<(), Box<dyn Error>>,
    ) -> Result<(), Box<dyn Error>> {
        const N: usize = OVERSAMPLING;
        let mut bytes = vec![255; N * width * N * height * 3];
        let size = (u32::try_from(N * width)?, u32::try_from(N * height)?);
        {
            let area = BitMapBackend::with_buffer(&mut bytes, size).into_drawing_area();
            with(&Pen { area: &area })?;
            area.present()?;
        }
        for y in 0..height {
            for x in 0..width {
                let radiance = std::array::from_fn(|c| {
                    let byte = |i: usize| {
                        let at = (N * y + i / N) * N * width + N * x + i % N;
                        u32::from(bytes[3 * at + c])
                    };
                    let sum: u32 = (0..N * N).map(byte).sum();
                    srgb(f64::from(sum) / (N * N) as f64)
                });
                self.pixel(left + x, top + y, radiance);
            }
        }
        Ok(())
    }
}

/// The radiance that is encoded as a value from 0 to 255.
pub fn srgb(byte: f64) -> f32 {
    let v = byte / 255.0;
    let linear = if v <= 0.04045 {
        v / 12.92
    } else {
        ((v + 0.055) / 1.055).powf(2.4)
    };
    linear as f32
}

/// Which point of a line of text is placed; `Up` is the middle of text that is read upwards.
#[derive(Clone, Copy)]
pub enum Anchor {
    Left,
    Middle,
    Right,
    Up,
}

/// A line's look.
#[derive(Clone, Copy)]
pub struct Stroke {
    pub colour: RGBColor,
    pub width: f64,
    /// Lengths of dashes and of gaps between them.
    pub dashes: Option<(f64, f64)>,
}

/// Draws lines and letters in a part of a page.
pub struct Pen<'a, 'b> {
    area: &'a DrawingArea<BitMapBackend<'b>, Shift>,
}

impl Pen<'_, '_> {
    fn scaled((x, y): (f64, f64)) -> (i32, i32) {
        let scaled = |v: f64| (v * OVERSAMPLING as f64).round() as i32;
        (scaled(x), scaled(y))
    }

    /// A filled rectangle between two corners.
    pub fn rectangle(
        &self,
        from: (f64, f64),
        to: (f64, f64),
        colour: RGBColor,
    ) -> Result<(), Box<dyn Error>> {
        let (x, y) = Self::scaled(to);
        let corners = [Self::scaled(from), (x - 1, y - 1)];
        Ok(self.area.draw(&Rectangle::new(corners, colour.filled()))?)
    }

    /// Segments with round joints: plotters' own joints of thick lines stick out where segments
    /// are short.
    pub fn line(&self, points: &[(f64, f64)], stroke: Stroke) -> Result<(), Box<dyn Error>> {
        let pieces = match stroke.dashes {
            Some((dash, gap)) => dashed(points, dash, gap),
            None => vec![points.to_vec()],
        };
        let width = (stroke.width * OVERSAMPLING as f64).round();
        let radius = (0.5 * width).floor() as i32;
        let style = stroke.colour.filled();
        for piece in pieces {
            let mut piece: Vec<_> = piece.into_iter().map(Self::scaled).collect();
            piece.dedup();
            for ends in piece.windows(2) {
                let style = style.stroke_width(width as u32);
                self.area.draw(&PathElement::new(ends, style))?;
            }
            if stroke.dashes.is_none() {
                for &point in &piece {
                    self.area.draw(&Circle::new(point, radius, style))?;
                }
            }
        }
        Ok(())
    }

    pub fn dot(&self, centre: (f64, f64), colour: RGBColor) -> Result<(), Box<dyn Error>> {
        let radius = 3 * OVERSAMPLING as i32;
        let dot = Circle::new(Self::scaled(centre), radius, colour.filled());
        Ok(self.area.draw(&dot)?)
    }

    /// A line of text, placed by its baseline.
    pub fn text(
        &self,
        text: &str,
        size: f64,
        (x, y): (f64, f64),
        anchor: Anchor,
    ) -> Result<(), Box<dyn Error>> {
        // plotters puts the baseline of ab_glyph's letters half a size below the text's top.
        let (at, turn, horizontal) = match anchor {
            Anchor::Left => ((x, y - 0.5 * size), FontTransform::None, HPos::Left),
            Anchor::Middle => ((x, y - 0.5 * size), FontTransform::None, HPos::Center),
            Anchor::Right => ((x, y - 0.5 * size), FontTransform::None, HPos::Right),
            Anchor::Up => ((x - 0.5 * size, y), FontTransform::Rotate270, HPos::Center),
        };
        let font = (FONT, OVERSAMPLING as f64 * size).into_font();
        let style = TextStyle::from(font.transform(turn)).pos(Pos::new(horizontal, VPos::Top));
        let (x, y) = Self::scaled(at);
        Ok(self.area.draw_text(text, &style, (x, y))?)
    }
}

/// The pieces of a line that are drawn when it is dashed.
fn dashed(points: &[(f64, f64)], dash: f64, gap: f64) -> Vec<Vec<(f64, f64)>> {
    let mut pieces = Vec::new();
    let mut piece: Vec<_> = points.first().copied().into_iter().collect();
    let (mut on, mut left) = (true, dash);
    for ends in points.windows(2) {
        let [(ax, ay), (bx, by)] = [ends[0], ends[1]];
        let length = (bx - ax).hypot(by - ay);
        let mut done = 0.0;
        while length - done > left {
            done += left;
            let share = done / length;
            let at = (ax + share * (bx - ax), ay + share * (by - ay));
            piece.push(at);
            if on {
                pieces.push(std::mem::take(&mut piece));
            } else {
                piece = vec![at];
            }
            on = !on;
            left = if on { dash } else { gap };
        }
        left -= length - done;
        piece.push((bx, by));
    }
    if on {
        pieces.push(piece);
    }
    pieces
}

/// The width of a line of text.
pub fn text_width(text: &str, size: f64) -> Result<f64, Box<dyn Error>> {
    let font = (FONT, OVERSAMPLING as f64 * size).into_font();
    let (width, _) = font.box_size(text)?;
    Ok(f64::from(width) / OVERSAMPLING as f64)
}

/// The given size, or a smaller one in which the text is no wider than asked.
pub fn fitting(text: &str, size: f64, width: f64) -> Result<f64, Box<dyn Error>> {
    let whole = text_width(text, size)?;
    Ok(size * (width / whole.max(1.0)).min(1.0))
}

/// Breaks text at spaces into lines no wider than asked, where words allow it; its own line
/// breaks stay.
pub fn wrapped(text: &str, size: f64, width: f64) -> Result<Vec<String>, Box<dyn Error>> {
    let mut lines = Vec::new();
    for paragraph in text.lines() {
        let mut line = String::new();
        for word in paragraph.split(' ').filter(|w| !w.is_empty()) {
            let longer = if line.is_empty() {
                word.to_owned()
            } else {
                format!("{line} {word}")
            };
            if line.is_empty() || text_width(&longer, size)? <= width {
                line = longer;
            } else {
                lines.push(std::mem::replace(&mut line, word.to_owned()));
            }
        }
        lines.push(line);
    }
    Ok(lines)
}
