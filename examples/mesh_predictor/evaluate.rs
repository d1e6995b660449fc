//! Measures how well silhouettes match, for the network and for baselines without an image.

use softray::optim::loss;
use softray::prelude::*;

use super::dataset::Dataset;
use super::network::{Bodies, Decoder, Network};
use super::render::{options, see};

/// Paths per pixel of the silhouettes that are compared.
const SAMPLES: u32 = 4;
/// Images per batch of the network.
const AT_ONCE: usize = 16;
/// Objects for the choice of the mean shape's scale.
const CHOSEN_WITH: usize = 48;

/// Returns the network's predictions for the input images of a data set, as untracked tensors.
pub fn predict(data: &Dataset, network: &Network, decoder: &Decoder, device: &Device) -> Bodies {
    let all: Vec<usize> = (0..data.items.len()).collect();
    let chunk = |items: &[usize]| {
        let which: Vec<_> = items.iter().map(|&i| (i, 0)).collect();
        let images = data.images(&which, &device.clone().autodiff()).radiance;
        let bodies = decoder.bodies(network.forward(images));
        (bodies.vertices.inner(), bodies.color.inner())
    };
    let (vertices, color) = all.chunks(AT_ONCE).map(chunk).unzip();
    Bodies {
        vertices: Tensor::cat(vertices, 0),
        color: Tensor::cat(color, 0),
    }
}

/// Returns the mean intersection over union of silhouettes, for the input views and for the other views. It uses the
/// first `items` items with the first `eyes` views each. `scene` returns the scene to compare with an item. The
/// result is NaN if there is no view.
pub fn overlap(
    data: &Dataset,
    (items, eyes): (usize, usize),
    device: &Device,
    scene: impl Fn(usize) -> Scene,
) -> softray::Result<[f64; 2]> {
    let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
    for (i, item) in data.items.iter().enumerate().take(items) {
        let scene = scene(i);
        let eyes = item.eyes.iter().take(eyes);
        let batch = Batch::new(vec![scene], eyes.map(|eye| eye.camera()).collect())?;
        let which: Vec<_> = (0..batch.len()).map(|eye| (i, eye)).collect();
        let seen = see(&batch, &options(SAMPLES))?.opacity;
        let target = data.images(&which, device).opacity;
        for eye in 0..batch.len() {
            let one = |t: &Tensor<3>| t.clone().slice([eye..eye + 1]).squeeze_dim::<2>(0);
            let kind = eye.min(1);
            sums[kind] += loss::iou(&one(&seen), &one(&target), 0.5)?;
            counts[kind] += 1.0;
        }
    }
    Ok([0, 1].map(|kind| sums[kind] / counts[kind]))
}

/// Returns the overlap of the network's predictions.
pub fn predict_and_measure(
    data: &Dataset,
    network: &Network,
    decoder: &Decoder,
    device: &Device,
) -> softray::Result<[f64; 2]> {
    let bodies = predict(data, network, decoder, device);
    overlap(data, data.counts(), device, |i| {
        decoder.scene(&bodies, i, &data.items[i].light)
    })
}

/// Returns the mean body of a data set. In each direction, its radius is `scale` times the mean radius of the rotated
/// objects. Its position and color are the means of theirs.
pub fn mean_body(data: &Dataset, decoder: &Decoder, scale: f64, device: &Device) -> Bodies {
    let count = data.items.len() as f64;
    let place = data
        .items
        .iter()
        .map(|i| i.translation)
        .sum::<glam::DVec3>()
        / count;
    let vertex = |&direction: &glam::DVec3| {
        let radius =
            |item: &super::dataset::Item| item.shape.radius(item.rotation.inverse() * direction);
        let mean = data.items.iter().map(radius).sum::<f64>() / count;
        (place + direction * (scale * mean)).to_array()
    };
    let vertices: Vec<[f64; 3]> = decoder.directions.iter().map(vertex).collect();
    let vertices = Mesh::from_host(&vertices, Vec::new(), device).vertices;
    let colors = data.items.iter().map(|i| glam::DVec3::from(i.color));
    let color = (colors.sum::<glam::DVec3>() / count).as_vec3().to_array();
    Bodies {
        vertices: vertices.unsqueeze(),
        color: Tensor::<1>::from_floats(color, device).unsqueeze(),
    }
}

/// Results without the image: overlaps of the input views and of the other views.
#[derive(Clone, Copy, Debug)]
pub struct Baselines {
    /// For the mean body of the training set.
    pub mean: [f64; 2],
    /// The scale of this mean with the largest overlap over a part of the training set, and its overlaps.
    pub scale: f64,
    pub scaled: [f64; 2],
    /// For the scaled mean body at the true position of each object.
    pub placed: [f64; 2],
}

impl Baselines {
    pub fn new(
        train: &Dataset,
        validation: &Dataset,
        decoder: &Decoder,
        device: &Device,
    ) -> softray::Result<Self> {
        let measure = |data: &Dataset, which: (usize, usize), scale: f64, placed: bool| {
            let mean = mean_body(train, decoder, scale, device);
            overlap(data, which, device, |i| {
                let item = &data.items[i];
                let mut body = mean.clone();
                if placed {
                    let to = item.translation.as_vec3().to_array();
                    let to = Tensor::<1>::from_floats(to, device).reshape([1, 1, 3]);
                    body.vertices = body.vertices.clone() - body.vertices.mean_dim(1) + to;
                }
                decoder.scene(&body, 0, &item.light)
            })
        };
        let (mut scale, mut best) = (1.0, 0.0);
        for tried in (0..10).map(|k| 0.8 + 0.05 * f64::from(k)) {
            let [input, _] = measure(train, (CHOSEN_WITH, 1), tried, false)?;
            if input > best {
                (scale, best) = (tried, input);
            }
        }
        let counts = validation.counts();
        Ok(Self {
            mean: measure(validation, counts, 1.0, false)?,
            scale,
            scaled: measure(validation, counts, scale, false)?,
            placed: measure(validation, counts, scale, true)?,
        })
    }
}
