//! Plots: curves in a frame with axes and a legend.

use super::axis::Axis;
use super::canvas::{Anchor, Canvas, Rgb, Stroke};
use super::text::Font;

/// A plot's width, and its height if title and legend take up to [`LINES`] lines together.
const SIZE: (f64, f64) = (420.0, 300.0);
const TITLE: f64 = 16.0;
const LABEL: f64 = 14.0;
const TICK: f64 = 13.0;
/// The height of a line of the title or the legend.
const LINE: f64 = 19.0;
/// The length of a line's sample in the legend, and the spaces after it and after the text.
const SAMPLE: f64 = 24.0;
const SPACE: (f64, f64) = (6.0, 16.0);
/// The number of lines above a frame that fit into the default height.
const LINES: usize = 3;

const INK: Rgb = [60; 3];
const GRID: Rgb = [228; 3];
const FAINT_GRID: Rgb = [243; 3];
/// Colors that are dark enough on white, and distinct for color-blind readers (Okabe and Ito).
const COLORS: [Rgb; 7] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [230, 159, 0],
    [86, 180, 233],
    [110, 110, 110],
];

/// A plot of curves over x for a [`Figure`](super::Figure), with horizontal dashed lines and a legend.
///
/// [`Figure`](super::Figure) has an example.
#[derive(Clone, Debug, Default)]
pub struct Plot {
    title: String,
    /// The labels of the axes.
    x: String,
    y: String,
    log: bool,
    /// The names and points of the curves.
    curves: Vec<(String, Vec<(f64, f64)>)>,
    /// The names and values of the dashed lines.
    lines: Vec<(String, f64)>,
}

impl Plot {
    /// Makes a plot without curves from a title and the labels of the axes. Empty texts take no space.
    pub fn new(title: impl Into<String>, x: impl Into<String>, y: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            x: x.into(),
            y: y.into(),
            ..Self::default()
        }
    }

    /// Makes the y axis logarithmic. Values that are not positive are omitted.
    pub fn with_log_scale(mut self) -> Self {
        self.log = true;
        self
    }

    /// Adds a curve through points (x, y). Points that are not finite are omitted, and a single point is a dot. A curve
    /// with an empty name is not in the legend.
    pub fn with_curve(
        mut self,
        name: impl Into<String>,
        points: impl IntoIterator<Item = (f64, f64)>,
    ) -> Self {
        let points = points.into_iter().collect();
        self.curves.push((name.into(), points));
        self
    }

    /// Adds a horizontal dashed line, such as a goal or a limit.
    pub fn with_line(mut self, name: impl Into<String>, y: f64) -> Self {
        self.lines.push((name.into(), y));
        self
    }

    fn names(&self) -> impl Iterator<Item = (&str, Stroke)> {
        let curves = self.curves.iter().enumerate();
        let curves = curves.map(|(i, c)| (c.0.as_str(), curve_stroke(i)));
        let lines = self.lines.iter().enumerate();
        curves.chain(lines.map(|(i, l)| (l.0.as_str(), line_stroke(i))))
    }

    /// Returns the points with finite x and y, and positive y on a logarithmic axis.
    fn shown(&self, points: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let shown = |p: &&(f64, f64)| p.0.is_finite() && self.shows(p.1);
        points.iter().filter(shown).copied().collect()
    }

    fn shows(&self, y: f64) -> bool {
        y.is_finite() && (!self.log || y > 0.0)
    }
}

fn curve_stroke(i: usize) -> Stroke {
    let dashes = [None, Some((7.0, 3.0)), Some((2.0, 2.0))];
    Stroke {
        color: COLORS[i % COLORS.len()],
        width: 1.7,
        dashes: dashes[i / COLORS.len() % dashes.len()],
    }
}

fn line_stroke(i: usize) -> Stroke {
    let dashes = [(6.0, 4.0), (2.0, 2.5), (11.0, 3.0)];
    Stroke {
        color: INK,
        width: 1.3,
        dashes: Some(dashes[i % dashes.len()]),
    }
}

/// Plots side by side with aligned upper ends of their frames.
pub(super) struct PlotRow<'a> {
    plots: Vec<(&'a Plot, Heading<'a>)>,
    /// The maximum numbers of lines of a title and of a legend.
    titles: usize,
    legends: usize,
}

/// A title broken into lines, and the legend's lines with the width of each entry.
struct Heading<'a> {
    title: Vec<String>,
    legend: Vec<Vec<(&'a str, Stroke, f64)>>,
}

impl<'a> Heading<'a> {
    fn new(plot: &'a Plot, font: &Font) -> Self {
        let room = SIZE.0 - 16.0;
        let mut legend: Vec<Vec<_>> = Vec::new();
        let mut used = f64::INFINITY;
        for (name, stroke) in plot.names().filter(|(name, _)| !name.is_empty()) {
            let width = SAMPLE + SPACE.0 + font.width(name, TICK);
            let width = width.min(room);
            if used + SPACE.1 + width > room {
                legend.push(Vec::new());
                used = -SPACE.1;
            }
            used += SPACE.1 + width;
            if let Some(line) = legend.last_mut() {
                line.push((name, stroke, width));
            }
        }
        Self {
            title: font.wrapped(&plot.title, TITLE, room),
            legend,
        }
    }
}

impl<'a> PlotRow<'a> {
    pub fn new(plots: &'a [Plot], font: &Font) -> Self {
        let plots: Vec<_> = plots.iter().map(|p| (p, Heading::new(p, font))).collect();
        let most = |lines: fn(&Heading) -> usize| plots.iter().map(|p| lines(&p.1)).max();
        Self {
            titles: most(|h| h.title.len()).unwrap_or(0),
            legends: most(|h| h.legend.len()).unwrap_or(0),
            plots,
        }
    }

    pub fn len(&self) -> usize {
        self.plots.len()
    }

    /// The size of one plot in pixels.
    pub fn size(&self) -> (usize, usize) {
        let more = (self.titles + self.legends).saturating_sub(LINES);
        (SIZE.0 as usize, (SIZE.1 + LINE * more as f64) as usize)
    }

    /// Draws one plot at the canvas's corner.
    pub fn draw(&self, index: usize, pen: &mut Canvas) {
        let (plot, heading) = &self.plots[index];
        let head = 6.0 + LINE * (self.titles + self.legends) as f64;
        let middle = draw_frame(plot, head + 8.0, self.size().1 as f64, pen);
        // Centered above the frame if the line is narrow enough.
        let start = |width: f64| (middle - 0.5 * width).min(SIZE.0 - 4.0 - width).max(4.0);
        for (i, line) in heading.title.iter().enumerate() {
            let at = (start(pen.font.width(line, TITLE)), TITLE + LINE * i as f64);
            pen.text(line, TITLE, at, Anchor::Left);
        }
        // Legends with fewer lines than the row's longest one are next to the frame.
        let mut y = head - LINE * (heading.legend.len() as f64 - 0.5);
        for line in &heading.legend {
            let widths: f64 = line.iter().map(|entry| entry.2 + SPACE.1).sum();
            let mut x = start(widths - SPACE.1);
            for &(name, stroke, width) in line {
                pen.line(&[(x, y), (x + SAMPLE, y)], stroke);
                let text = SAMPLE + SPACE.0;
                let size = pen.font.fitting(name, TICK, width - text);
                pen.text(name, size, (x + text, y + 4.5), Anchor::Left);
                x += width + SPACE.1;
            }
            y += LINE;
        }
    }
}

/// Draws the frame, the axes, the curves and the lines, from `top` to the plot's lower end. Returns the x position of
/// the frame's middle.
fn draw_frame(plot: &Plot, top: f64, height: f64, pen: &mut Canvas) -> f64 {
    let curves: Vec<_> = plot.curves.iter().map(|c| plot.shown(&c.1)).collect();
    let points = || curves.iter().flatten();
    let lines = plot.lines.iter().map(|l| l.1).filter(|&y| plot.shows(y));
    let y = Axis::around(points().map(|p| p.1).chain(lines), plot.log, 0.06).divide(8);

    let has = |label: &str| if label.is_empty() { 0.0 } else { 1.0 };
    let left = (6.0 + 22.0 * has(&plot.y) + y.widest(&pen.font, TICK) + 9.0).round();
    let bottom = height - 26.0 - 22.0 * has(&plot.x);

    // The last label of x may extend beyond the frame.
    let room = SIZE.0 - left;
    let mut x = Axis::around(points().map(|p| p.0), false, 0.0).divide(9);
    for count in (2..9).rev() {
        if (x.widest(&pen.font, TICK) + 14.0) * x.ticks.len() as f64 > room {
            x = Axis::around(points().map(|p| p.0), false, 0.0).divide(count);
        }
    }
    let right = (SIZE.0 - 10f64.max(0.5 * x.widest(&pen.font, TICK) + 2.0)).round();

    let across = |share: f64| left + share * (right - left);
    let up = |share: f64| bottom - share * (bottom - top);
    // Lines one pixel thick, aligned with the pixels.
    let row = |pen: &mut Canvas, y: f64, color| {
        let y = (y - 0.5).round();
        pen.rectangle((left, y), (right, y + 1.0), color)
    };
    let column = |pen: &mut Canvas, x: f64, color| {
        let x = (x - 0.5).round();
        pen.rectangle((x, top), (x + 1.0, bottom), color)
    };
    for &place in &y.minor {
        row(pen, up(y.share(place)), FAINT_GRID);
    }
    for (place, label) in &y.ticks {
        let at = up(y.share(*place));
        row(pen, at, GRID);
        pen.text(label, TICK, (left - 7.0, at + 4.5), Anchor::Right);
    }
    for (place, label) in &x.ticks {
        let at = across(x.share(*place));
        column(pen, at, GRID);
        pen.text(label, TICK, (at, bottom + 18.0), Anchor::Middle);
    }
    for edge in [top, bottom] {
        row(pen, edge, INK);
    }
    for edge in [left, right] {
        column(pen, edge, INK);
    }
    draw_labels(plot, (left, right), (top, bottom), height, pen);
    let place = |p: (f64, f64)| Some((across(x.share_of(p.0)?), up(y.share_of(p.1)?)));
    for (i, (_, at)) in plot.lines.iter().enumerate() {
        if let Some(share) = y.share_of(*at) {
            let ends = [(left, up(share)), (right, up(share))];
            pen.line(&ends, line_stroke(i));
        }
    }
    for (i, points) in curves.iter().enumerate() {
        let places: Vec<_> = points.iter().filter_map(|&p| place(p)).collect();
        match places[..] {
            [only] => pen.dot(only, curve_stroke(i).color),
            _ => pen.line(&places, curve_stroke(i)),
        }
    }
    0.5 * (left + right)
}

/// Draws the labels of both axes of a frame.
fn draw_labels(
    plot: &Plot,
    (left, right): (f64, f64),
    (top, bottom): (f64, f64),
    height: f64,
    pen: &mut Canvas,
) {
    let size = pen.font.fitting(&plot.x, LABEL, right - left);
    let at = (0.5 * (left + right), height - 9.0);
    pen.text(&plot.x, size, at, Anchor::Middle);
    let size = pen.font.fitting(&plot.y, LABEL, bottom - 4.0);
    let reach = 0.5 * pen.font.width(&plot.y, size);
    let middle = (0.5 * (top + bottom)).min(height - reach).max(reach);
    pen.text(&plot.y, size, (18.0, middle), Anchor::Up);
}
