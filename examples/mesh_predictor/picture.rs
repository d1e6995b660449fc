//! The final figure: inputs, predictions, and both from other views.

use std::path::Path;

use softray::figure::{Figure, Panel};
use softray::optim::History;
use softray::prelude::*;

use super::dataset::Dataset;
use super::network::Bodies;
use super::render::{options, see};
use super::shape::KINDS;

const SAMPLES: u32 = 256;

/// Writes a row for the first object of each kind, and curves of the training.
pub fn write(
    path: &Path,
    data: &Dataset,
    bodies: &Bodies,
    history: &History,
    device: &Device,
) -> Result<(), Box<dyn std::error::Error>> {
    let title = "Bodies from one image each: objects that the training has not seen";
    let mut figure = Figure::new(title).with_height(128);
    let clean = options(data.size, SAMPLES);
    let captions = [
        ["input", "prediction"],
        ["another view", "prediction"],
        ["a third view", "prediction"],
    ];
    let first = |kind| data.items.iter().position(|item| item.shape.kind == kind);
    let shown: Vec<usize> = (0..KINDS.len()).filter_map(first).collect();
    for &i in &shown {
        let item = &data.items[i];
        let cameras = item.eyes[..data.views].iter();
        let cameras = cameras.map(|eye| eye.camera()).collect();
        let batch = Batch::new(vec![bodies.scene(i, &item.light)], cameras)?;
        let target = item.see(data.views, &clean, device)?.radiance;
        let found = see(&batch, &clean)?.radiance;
        let mut row = Vec::new();
        for (eye, captions) in captions.iter().enumerate().take(batch.len()) {
            for (caption, images) in captions.iter().zip([&target, &found]) {
                let image = images.clone().slice([eye..eye + 1]).squeeze_dim::<3>(0);
                row.push((*caption, HostImage::from_tensor(&image)?));
            }
        }
        let last = shown.last() == Some(&i);
        let caption = |caption| if last { caption } else { "" };
        let panels = row.iter().map(|(c, image)| Panel::new(caption(*c), image));
        figure = figure.with_row(panels);
    }
    let parts = ["image", "silhouette"];
    figure
        .with_plot(history.plot("validation IoU", &["IoU input", "IoU other"])?)
        .with_plot(history.plot("parts of the loss", &parts)?.with_log_scale())
        .write(path)?;
    Ok(())
}
