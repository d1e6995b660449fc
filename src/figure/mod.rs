//! Figures: rows of images with captions above rows of plots, drawn as one image.

mod axis;
mod canvas;
mod color;
mod panel;
mod plot;
mod relighting;
mod text;

use std::path::Path;

use crate::error::Result;
use crate::io::HostImage;
use canvas::{Anchor, Canvas};
pub use color::Diverging;
use panel::Cell;
pub use panel::Panel;
pub use plot::Plot;
use plot::PlotRow;
pub use relighting::Relighting;
use text::Font;

/// The font size of the title, the height of its lines, and the space below it, in pixels.
const TITLE: f64 = 20.0;
const TITLE_LINE: usize = 27;
const TITLE_ROOM: usize = 8;
/// The space around the figure, between images or plots, and between rows.
const MARGIN: usize = 16;
const GAP: usize = 14;
const ROW_GAP: usize = 16;
/// The minimum width between the margins.
const NARROWEST: usize = 140;
const PLOTS_IN_A_ROW: usize = 3;

/// A figure: rows of images with captions, then rows of plots.
///
/// ```
/// use softray::figure::{Figure, Panel, Plot};
/// use softray::prelude::*;
///
/// let dark = HostImage::new(2, 2, vec![0.2; 12])?;
/// let bright = HostImage::new(2, 2, vec![0.7; 12])?;
/// let figure = Figure::new("A figure")
///     .with_height(128)
///     .with_row([("dark", &dark), ("bright", &bright)])
///     .with_row([Panel::difference("dark − bright", &dark, &bright)?])
///     .with_plot(Plot::new("decay", "step", "").with_log_scale().with_curve("", (0..9).map(|k| (k as f64, 0.5f64.powi(k)))));
/// let image: HostImage = figure.image()?;
/// assert!(image.width > 256);
/// let path = std::env::temp_dir().join(format!("softray-figure-{}.png", std::process::id()));
/// figure.write(&path)?;
/// # std::fs::remove_file(&path).expect("a file");
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Figure {
    title: String,
    height: usize,
    rows: Vec<(usize, Vec<Panel>)>,
    plots: Vec<Plot>,
}

impl Figure {
    /// Makes an empty figure. An empty title takes no space.
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            height: 256,
            rows: Vec::new(),
            plots: Vec::new(),
        }
    }

    /// Sets the approximate height, in pixels, of the images in later rows; 256 by default.
    pub fn with_height(mut self, height: usize) -> Self {
        self.height = height;
        self
    }

    /// Adds a row of panels, or of pairs of a caption and an image.
    pub fn with_row<P: Into<Panel>>(mut self, panels: impl IntoIterator<Item = P>) -> Self {
        let panels = panels.into_iter().map(Into::into).collect();
        self.rows.push((self.height, panels));
        self
    }

    /// Adds a plot. Plots are below all images, up to three per row.
    pub fn with_plot(mut self, plot: Plot) -> Self {
        self.plots.push(plot);
        self
    }

    /// Writes the figure to a `.png` or `.exr` file. The file appears under its name only when it is complete.
    ///
    /// # Errors
    /// Like [`Figure::image`], or if the file can't be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        HostImage::check_path(&path)?;
        self.image()?.write(path)
    }

    /// Draws the figure and returns it as linear radiance.
    ///
    /// # Errors
    /// If an image has no pixels, if its number of values does not match its size, or if the figure would have more
    /// than 2²⁷ pixels.
    pub fn image(&self) -> Result<HostImage> {
        let font = Font::new()?;
        let rows = self.rows.iter().filter(|row| !row.1.is_empty());
        let rows = rows.map(|(height, panels)| ImageRow::new(panels, *height, &font));
        let rows: Vec<ImageRow> = rows.collect::<Result<_>>()?;
        let plots = self.plot_rows(&font);

        let widths = rows.iter().map(|row| row.width);
        let width = widths.chain(plots.iter().map(plots_width)).max();
        let inner = width.unwrap_or(0).max(NARROWEST);
        let title = font.wrapped(&self.title, TITLE, inner as f64);
        let title_height = TITLE_LINE * title.len() + if title.is_empty() { 0 } else { TITLE_ROOM };
        let heights = rows.iter().map(ImageRow::height);
        let heights = heights.chain(plots.iter().map(|row| row.size().1));
        let heights = heights.fold(0usize, |sum, h| {
            sum.saturating_add(h).saturating_add(ROW_GAP)
        });
        let height = (2 * MARGIN + title_height).saturating_add(heights.saturating_sub(ROW_GAP));

        let mut canvas = Canvas::new(inner.saturating_add(2 * MARGIN), height, font)?;
        canvas.place((MARGIN, MARGIN));
        for (i, line) in title.iter().enumerate() {
            let at = (0.5 * inner as f64, (i * TITLE_LINE) as f64 + 18.0);
            canvas.text(line, TITLE, at, Anchor::Middle);
        }
        let mut top = MARGIN + title_height;
        for row in &rows {
            row.draw((MARGIN + (inner - row.width) / 2, top), &mut canvas);
            top += row.height() + ROW_GAP;
        }
        for row in &plots {
            let (width, height) = row.size();
            let mut left = MARGIN + (inner - plots_width(row)) / 2;
            for i in 0..row.len() {
                canvas.place((left, top));
                row.draw(i, &mut canvas);
                left += width + GAP;
            }
            top += height + ROW_GAP;
        }
        Ok(canvas.into_image())
    }

    /// Distributes the plots evenly over as few rows as possible.
    fn plot_rows(&self, font: &Font) -> Vec<PlotRow<'_>> {
        let rows = self.plots.len().div_ceil(PLOTS_IN_A_ROW).max(1);
        let length = self.plots.len().div_ceil(rows).max(1);
        let rows = self.plots.chunks(length);
        rows.map(|plots| PlotRow::new(plots, font)).collect()
    }
}

fn plots_width(row: &PlotRow) -> usize {
    row.len() * (row.size().0 + GAP) - GAP
}

/// Images side by side with aligned lower ends.
struct ImageRow {
    cells: Vec<Cell>,
    width: usize,
    images: usize,
    captions: usize,
}

impl ImageRow {
    fn new(panels: &[Panel], height: usize, font: &Font) -> Result<Self> {
        let cells = panels.iter().map(|panel| Cell::new(panel, height, font));
        let cells: Vec<Cell> = cells.collect::<Result<_>>()?;
        let width = |sum: usize, cell: &Cell| sum.saturating_add(cell.width).saturating_add(GAP);
        Ok(Self {
            width: cells.iter().fold(0, width).saturating_sub(GAP),
            images: cells.iter().map(Cell::image_height).max().unwrap_or(0),
            captions: cells.iter().map(Cell::caption_height).max().unwrap_or(0),
            cells,
        })
    }

    fn height(&self) -> usize {
        self.images.saturating_add(self.captions)
    }

    fn draw(&self, (mut left, top): (usize, usize), canvas: &mut Canvas) {
        for cell in &self.cells {
            cell.draw((left, top + self.images), canvas);
            left += cell.width + GAP;
        }
    }
}

#[cfg(test)]
mod tests;
