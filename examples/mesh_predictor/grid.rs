//! The final figure: inputs, predictions, and both from other views.

use std::path::Path;

use softray::figure::{Figure, Panel, Plot};
use softray::optim::History;
use softray::prelude::*;

use super::dataset::Dataset;
use super::evaluate::Baselines;
use super::network::{Bodies, Decoder};
use super::render::{options, see};

/// The number of objects in the figure.
const ROWS: usize = 8;
const SAMPLES: u32 = 64;

pub fn write(
    path: &Path,
    data: &Dataset,
    (decoder, bodies): (&Decoder, &Bodies),
    (history, baselines): (&History, &Baselines),
    device: &Device,
) -> Result<(), Box<dyn std::error::Error>> {
    let title = "Bodies from one image each: validation set";
    let mut figure = Figure::new(title).with_height(128);
    for (i, item) in data.items.iter().enumerate().take(ROWS) {
        let scene = decoder.scene(bodies, i, &item.light);
        let eyes = item.eyes.iter().take(3);
        let batch = Batch::new(vec![scene], eyes.map(|eye| eye.camera()).collect())?;
        let which: Vec<_> = (0..batch.len()).map(|eye| (i, eye)).collect();
        let target = data.images(&which, device).radiance;
        let found = see(&batch, &options(SAMPLES))?.radiance;
        let captions = [
            ["input", "prediction"],
            ["another view", "prediction"],
            ["a third view", "prediction"],
        ];
        let mut row = Vec::new();
        for (eye, captions) in captions.iter().enumerate().take(batch.len()) {
            for (caption, images) in captions.iter().zip([&target, &found]) {
                let image = images.clone().slice([eye..eye + 1]).squeeze_dim::<3>(0);
                row.push((*caption, HostImage::from_tensor(&image)?));
            }
        }
        let last = i + 1 == data.items.len().min(ROWS);
        let caption = |caption| if last { caption } else { "" };
        let panels = row.iter().map(|(c, image)| Panel::new(caption(*c), image));
        figure = figure.with_row(panels);
    }
    let mut overlaps = Plot::new("validation IoU", "step", "");
    for (name, kind) in [("IoU input", 0), ("IoU other", 1)] {
        let points = history.curve(name).into_iter();
        overlaps = overlaps.with_curve(
            ["input view", "other views"][kind],
            points.filter(|p| p.1.is_finite()),
        );
    }
    let overlaps = overlaps
        .with_line("mean shape, input", baselines.mean[0])
        .with_line("mean shape, other", baselines.mean[1]);
    figure
        .with_plot(overlaps)
        .with_plot(
            history
                .plot("parts of the loss", &["image", "silhouette"])?
                .with_log_scale(),
        )
        .with_plot(history.plot("blur, °", &["blur"])?.with_log_scale())
        .write(path)?;
    Ok(())
}
