//! Pictures of a step's images beside their targets.

use std::path::PathBuf;

use super::{Evaluation, Report, Row};
use crate::error::{Error, Result};
use crate::figure::{Diverging, Figure, Panel};
use crate::io::HostImage;

/// The folder and the interval of the pictures of a fit.
pub(super) struct Pictures {
    pub folder: PathBuf,
    pub every: usize,
}

impl Pictures {
    /// Writes the picture of a step. At the first step an image is required.
    pub fn write(&self, evaluation: &Evaluation, row: &Row, first: bool) -> Result<()> {
        if evaluation.images.is_empty() {
            let expected = "one for the pictures: Evaluation::with_image";
            return Error::unless(!first, "fit", "evaluation", "without an image", expected);
        }
        let path = self.folder.join(format!("step-{:06}.png", row.step));
        figure(evaluation, row)?.write(path)
    }
}

impl<M> Report<'_, M> {
    /// Reads back the images of the step's evaluation, with their names.
    ///
    /// # Errors
    /// If an image cannot be read back from its device.
    pub fn images(&self) -> Result<Vec<(String, HostImage)>> {
        let images = self.evaluation.images.iter();
        images
            .map(|(n, i)| Ok((n.clone(), HostImage::from_tensor(i)?)))
            .collect()
    }

    /// Draws the images beside their targets and differences, like the pictures of
    /// [`Fit::with_pictures`](super::Fit::with_pictures).
    ///
    /// # Errors
    /// If an image cannot be read back from its device, or does not have three channels.
    pub fn figure(&self) -> Result<Figure> {
        match self.history.rows.last() {
            Some(row) => figure(self.evaluation, row),
            None => Ok(Figure::new("")),
        }
    }
}

/// Draws a row for each image: the image and, if it has a target, the target and their difference.
fn figure(evaluation: &Evaluation, row: &Row) -> Result<Figure> {
    let blur = row.blur;
    let blur = blur.map_or(String::new(), |b| format!(", blur {b:.1e}"));
    let title = format!("step {}, loss {:.2e}{blur}", row.step, row.loss);
    let mut figure = Figure::new(title);
    for (name, image) in &evaluation.images {
        let image = HostImage::from_tensor(image)?;
        let mut panels = vec![Panel::new(name.as_str(), &image)];
        if let Some((_, target)) = evaluation.targets.iter().find(|t| &t.0 == name) {
            let target = HostImage::from_tensor(target)?;
            let difference = Panel::difference(format!("{name} − target"), &image, &target)?;
            panels.push(Panel::new("target", &target));
            panels.push(difference.with_colors(scale(&target)));
        }
        figure = figure.with_row(panels);
    }
    Ok(figure)
}

/// Returns the color scale of differences from a target. It is the same at every step. Pixels that the picture
/// clips do not count, so that visible lights do not make the rest pale.
fn scale(target: &HostImage) -> Diverging {
    let pixels = target.pixels.chunks_exact(3);
    let means = pixels.map(|p| p.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0);
    Diverging::of(&means.filter(|&v| v <= 1.0).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_in_view_do_not_set_the_scale() {
        let pixels = (0..300).map(|i| if i < 30 { 50.0 } else { 0.4 }).collect();
        let target = HostImage::new(10, 10, pixels).expect("an image");
        assert!((scale(&target).scale() - 0.4).abs() < 1e-6);
    }
}
