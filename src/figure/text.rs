//! The text of figures: widths, line breaks and outlines of letters.

use ab_glyph::{Font as _, FontRef, OutlineCurve, Point};
use epaint_default_fonts::HACK_REGULAR;
use tiny_skia::{Path, PathBuilder};

use crate::error::{Error, Result};

/// The font of all text. Sizes are line heights without leading, in pixels. Characters that the font lacks are drawn as
/// boxes.
pub(super) struct Font {
    face: FontRef<'static>,
}

impl Font {
    pub fn new() -> Result<Self> {
        let face = FontRef::try_from_slice(HACK_REGULAR).map_err(|error| {
            Error::invalid("figure", "font", format!("damaged ({error})"), "a font")
        })?;
        Ok(Self { face })
    }

    /// Pixels per unit of the font.
    fn factor(&self, size: f64) -> f64 {
        size / f64::from(self.face.height_unscaled())
    }

    /// The width of a line of text.
    pub fn width(&self, text: &str, size: f64) -> f64 {
        let advance = |c| f64::from(self.face.h_advance_unscaled(self.face.glyph_id(c)));
        self.factor(size) * text.chars().map(advance).sum::<f64>()
    }

    /// Returns the given size, or a smaller one in which the text is at most `width` wide.
    pub fn fitting(&self, text: &str, size: f64, width: f64) -> f64 {
        size * (width / self.width(text, size).max(1.0)).min(1.0)
    }

    /// Breaks text into lines at most `width` wide, at spaces and inside words that are wider than a line. Existing
    /// line breaks stay.
    pub fn wrapped(&self, text: &str, size: f64, width: f64) -> Vec<String> {
        let mut lines = Vec::new();
        for paragraph in text.lines() {
            let mut line = String::new();
            for word in paragraph.split(' ').filter(|w| !w.is_empty()) {
                let room = width - self.width(&line, size) - self.width(" ", size);
                if !line.is_empty() && self.width(word, size) <= room {
                    line.push(' ');
                } else if !line.is_empty() {
                    lines.push(std::mem::take(&mut line));
                }
                for letter in word.chars() {
                    line.push(letter);
                    if line.chars().nth(1).is_some() && self.width(&line, size) > width {
                        line.pop();
                        lines.push(std::mem::replace(&mut line, letter.into()));
                    }
                }
            }
            lines.push(line);
        }
        lines
    }

    /// Returns the outlines of a line of text whose baseline starts at (0, 0), with y down; `None` if nothing is
    /// visible.
    pub fn outlines(&self, text: &str, size: f64) -> Option<Path> {
        let factor = self.factor(size) as f32;
        let mut path = PathBuilder::new();
        let mut left = 0.0;
        for letter in text.chars() {
            let glyph = self.face.glyph_id(letter);
            let curves = self.face.outline(glyph).map_or(Vec::new(), |o| o.curves);
            let at = |p: Point| (left + factor * p.x, -factor * p.y);
            let mut pen = None;
            for curve in curves {
                let (from, to) = match curve {
                    OutlineCurve::Line(a, b)
                    | OutlineCurve::Quad(a, _, b)
                    | OutlineCurve::Cubic(a, _, _, b) => (at(a), at(b)),
                };
                if pen != Some(from) {
                    path.close();
                    path.move_to(from.0, from.1);
                }
                match curve {
                    OutlineCurve::Line(..) => path.line_to(to.0, to.1),
                    OutlineCurve::Quad(_, c, _) => {
                        let c = at(c);
                        path.quad_to(c.0, c.1, to.0, to.1);
                    }
                    OutlineCurve::Cubic(_, c, d, _) => {
                        let (c, d) = (at(c), at(d));
                        path.cubic_to(c.0, c.1, d.0, d.1, to.0, to.1);
                    }
                }
                pen = Some(to);
            }
            path.close();
            left += factor * self.face.h_advance_unscaled(glyph);
        }
        path.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_no_wider_than_the_limit() {
        let font = Font::new().expect("a font");
        let text =
            "difference of the render and its target, averagedoverallthreechannelsofcolor\nend";
        for width in [40.0, 90.0, 200.0, 1000.0] {
            let lines = font.wrapped(text, 15.0, width);
            assert!(
                lines.iter().all(|l| font.width(l, 15.0) <= width),
                "{lines:?}"
            );
            let letters = |text: &str| text.replace([' ', '\n'], "");
            assert_eq!(letters(&lines.concat()), letters(text));
            assert_eq!(lines.last().map(String::as_str), Some("end"));
        }
        assert_eq!(font.wrapped("a b", 15.0, 1.0), ["a", "b"]);
        assert!(font.wrapped("", 15.0, 100.0).is_empty());
        let size = font.fitting(text, 15.0, 100.0);
        assert!(font.width(text, size) <= 100.0 + 1e-9);
        assert_eq!(font.fitting("a", 15.0, 100.0), 15.0);
    }

    #[test]
    fn outlines_lie_in_their_line() {
        let font = Font::new().expect("a font");
        for text in ["Ångström |y|", "∂/∂x σ² ≤ 2·10⁻³ − 20°", "√time ÷ Wº"] {
            let bounds = font.outlines(text, 20.0).expect("letters").bounds();
            let width = font.width(text, 20.0) as f32;
            assert!(
                bounds.left() >= -2.0 && bounds.right() <= width + 2.0,
                "{text}: {bounds:?}"
            );
            assert!(
                bounds.top() > -20.0 && bounds.bottom() < 6.0,
                "{text}: {bounds:?}"
            );
        }
        assert!(font.outlines(" ", 20.0).is_none());
    }

    #[test]
    fn signs_of_figures_are_in_the_font() {
        let font = Font::new().expect("a font");
        for sign in "−·⁰¹²³⁴⁵⁶⁷⁸⁹⁻∂σ→×°√|≤αβγΔθλπ".chars() {
            assert_ne!(font.face.glyph_id(sign).0, 0, "{sign}");
        }
    }
}
