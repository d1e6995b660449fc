//! Figures like a paper's: rows of images with captions, then rows of plots, as one PNG.

use std::error::Error;
use std::path::Path;

use softray::prelude::*;

mod axis;
mod canvas;
#[path = "font.rs"]
pub mod font;
mod plot;

use canvas::{Anchor, Canvas, srgb, text_width, wrapped};
use plot::Row;
#[allow(unused_imports)] // a bench takes the colours, plots can be made without their builder
pub use plot::{COLOURS, Curve, Plot};

/// Sizes of letters.
const TITLE: f64 = 21.0;
const CAPTION: f64 = 15.0;
/// Heights of lines of the title and of captions.
const TITLE_LINE: usize = 28;
const CAPTION_LINE: usize = 19;
/// Below the title.
const TITLE_ROOM: usize = 8;
/// Around the figure, between images or plots, and between rows.
const MARGIN: usize = 16;
const GAP: usize = 12;
const ROW_GAP: usize = 16;
/// Captions of smaller images are this wide.
const NARROWEST: f64 = 140.0;
const PLOTS_IN_A_ROW: usize = 3;

/// Rows of images with captions, then rows of plots.
pub struct Figure {
    title: String,
    height: usize,
    rows: Vec<Vec<Shown>>,
    plots: Vec<Plot>,
}

struct Shown {
    caption: String,
    image: HostImage,
    factor: usize,
}

impl Figure {
    /// An empty title takes no room.
    pub fn new(title: &str) -> Self {
        Self {
            title: title.to_owned(),
            height: 256,
            rows: Vec::new(),
            plots: Vec::new(),
        }
    }

    /// About how many pixels high the images of the rows that follow are shown; 256 at first.
    pub fn height(self, height: usize) -> Self {
        Self { height, ..self }
    }

    /// A row of images of linear radiance, each over its caption. Images are clipped to [0, 1],
    /// and scaled up by whole factors with sharp pixels. Captions break where they are wider than
    /// their image.
    pub fn images(mut self, row: &[(&str, &HostImage)]) -> Self {
        let shown = |&(caption, image): &(&str, &HostImage)| {
            let factor = self.height as f64 / image.height.max(1) as f64;
            Shown {
                caption: caption.to_owned(),
                image: image.clone(),
                factor: (factor.round() as usize).max(1),
            }
        };
        let row = row.iter().map(shown).collect();
        self.rows.push(row);
        self
    }

    /// Plots stand below all images, up to three in a row.
    pub fn plot(mut self, plot: Plot) -> Self {
        self.plots.push(plot);
        self
    }

    /// As a `.png`, which appears under its name only when it is complete.
    ///
    /// # Errors
    /// When an image has no pixels or not as many values as it needs, or the file can't be
    /// written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<(), Box<dyn Error>> {
        font::register();
        let images = self.rows.iter().filter(|row| !row.is_empty());
        let images = images.map(|row| row.iter().map(Cell::new).collect());
        let images: Vec<Vec<Cell>> = images.collect::<Result<_, Box<dyn Error>>>()?;
        let plots = self.plot_rows()?;

        let widths = images.iter().map(|row| row_width(row));
        let width = widths.chain(plots.iter().map(plots_width)).max();
        let inner = width.unwrap_or(0).max(NARROWEST as usize);
        let title = wrapped(&self.title, TITLE, inner as f64)?;
        let title_height = TITLE_LINE * title.len() + if title.is_empty() { 0 } else { TITLE_ROOM };
        let heights = images
            .iter()
            .map(|row| image_height(row) + caption_height(row));
        let heights: usize = heights
            .chain(plots.iter().map(|row| row.size().1))
            .map(|h| h + ROW_GAP)
            .sum();
        let height = 2 * MARGIN + title_height + heights.saturating_sub(ROW_GAP);

        let mut canvas = Canvas::new(inner + 2 * MARGIN, height);
        canvas.draw((MARGIN, MARGIN), (inner, title_height), |pen| {
            for (i, line) in title.iter().enumerate() {
                let at = (0.5 * inner as f64, (i * TITLE_LINE) as f64 + 18.0);
                pen.text(line, TITLE, at, Anchor::Middle)?;
            }
            Ok(())
        })?;
        let mut top = MARGIN + title_height;
        for row in &images {
            let bottom = top + image_height(row);
            let mut left = MARGIN + (inner - row_width(row)) / 2;
            for cell in row {
                cell.draw((left, bottom), &mut canvas)?;
                left += cell.width + GAP;
            }
            top = bottom + caption_height(row) + ROW_GAP;
        }
        for row in &plots {
            let (width, height) = row.size();
            let mut left = MARGIN + (inner - plots_width(row)) / 2;
            for i in 0..row.len() {
                canvas.draw((left, top), (width, height), |pen| row.draw(i, pen))?;
                left += width + GAP;
            }
            top += height + ROW_GAP;
        }
        Ok(canvas.into_image().write(path)?)
    }

    /// As few rows as do, filled alike.
    fn plot_rows(&self) -> Result<Vec<Row<'_>>, Box<dyn Error>> {
        let rows = self.plots.len().div_ceil(PLOTS_IN_A_ROW).max(1);
        let length = self.plots.len().div_ceil(rows).max(1);
        self.plots.chunks(length).map(Row::new).collect()
    }
}

fn plots_width(row: &Row) -> usize {
    row.len() * (row.size().0 + GAP) - GAP
}

fn row_width(row: &[Cell]) -> usize {
    row.iter().map(|cell| cell.width + GAP).sum::<usize>() - GAP
}

fn image_height(row: &[Cell]) -> usize {
    row.iter().map(Cell::image_height).max().unwrap_or(0)
}

/// With the room between images and captions.
fn caption_height(row: &[Cell]) -> usize {
    let lines = row.iter().map(|cell| cell.caption.len()).max().unwrap_or(0);
    CAPTION_LINE * lines + if lines > 0 { 6 } else { 0 }
}

/// An image and its caption in lines.
struct Cell<'a> {
    shown: &'a Shown,
    caption: Vec<String>,
    width: usize,
}

impl<'a> Cell<'a> {
    fn new(shown: &'a Shown) -> Result<Self, Box<dyn Error>> {
        let image = &shown.image;
        let values = 3 * image.width * image.height;
        if values == 0 || image.pixels.len() != values {
            return Err(format!(
                "image {:?}: {} values for {} × {} pixels, expected {values}, and more than 0",
                shown.caption,
                image.pixels.len(),
                image.width,
                image.height,
            )
            .into());
        }
        let width = shown.factor * image.width + 2;
        let caption = wrapped(&shown.caption, CAPTION, NARROWEST.max(width as f64))?;
        let widest = caption.iter().try_fold(0f64, |widest, line| {
            Ok::<_, Box<dyn Error>>(widest.max(text_width(line, CAPTION)?))
        })?;
        Ok(Self {
            shown,
            caption,
            width: width.max(widest.ceil() as usize + 2),
        })
    }

    /// With its frame.
    fn image_height(&self) -> usize {
        self.shown.factor * self.shown.image.height + 2
    }

    /// The image ends above `bottom`, the caption starts below.
    fn draw(
        &self,
        (left, bottom): (usize, usize),
        canvas: &mut Canvas,
    ) -> Result<(), Box<dyn Error>> {
        let Shown { image, factor, .. } = self.shown;
        let inset = (self.width - factor * image.width) / 2;
        let corner = (left + inset, bottom + 1 - self.image_height());
        canvas.image(image, *factor, corner);
        let size = (self.width, caption_height(std::slice::from_ref(self)));
        canvas.draw((left, bottom), size, |pen| {
            for (i, line) in self.caption.iter().enumerate() {
                let at = (0.5 * self.width as f64, (i * CAPTION_LINE) as f64 + 20.0);
                pen.text(line, CAPTION, at, Anchor::Middle)?;
            }
            Ok(())
        })
    }
}

/// A signed image as colours: blue below zero, white at zero, red above. `scale` is the absolute
/// value of the darkest colours, by default the largest there is; values that are not finite are
/// grey. The colours are those of the image's sRGB encoding.
///
/// # Panics
/// When there are not width · height values.
pub fn diverging(width: usize, height: usize, values: &[f64], scale: Option<f64>) -> HostImage {
    // ColorBrewer's RdBu at 0, ½ and 1.
    const WHITE: [f64; 3] = [255.0, 255.0, 255.0];
    const RED: [[f64; 3]; 3] = [WHITE, [244.0, 165.0, 130.0], [178.0, 24.0, 43.0]];
    const BLUE: [[f64; 3]; 3] = [WHITE, [146.0, 197.0, 222.0], [33.0, 102.0, 172.0]];
    const GREY: [f64; 3] = [128.0, 128.0, 128.0];
    assert_eq!(values.len(), width * height, "one value a pixel");
    let finite = values.iter().filter(|v| v.is_finite());
    let largest = finite.fold(0f64, |m, v| m.max(v.abs()));
    let scale = scale.unwrap_or(largest).max(f64::MIN_POSITIVE);
    let colour = |&v: &f64| {
        if !v.is_finite() {
            return GREY;
        }
        let stops = if v < 0.0 { BLUE } else { RED };
        let place = 2.0 * (v.abs() / scale).min(1.0);
        let [from, to] = if place < 1.0 {
            [stops[0], stops[1]]
        } else {
            [stops[1], stops[2]]
        };
        let share = if place < 1.0 { place } else { place - 1.0 };
        std::array::from_fn(|c| from[c] + share * (to[c] - from[c]))
    };
    HostImage {
        width,
        height,
        pixels: values.iter().flat_map(|v| colour(v).map(srgb)).collect(),
    }
}
