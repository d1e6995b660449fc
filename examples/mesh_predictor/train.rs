//! The loss of a step: how far renders of what the network says are from the images.

use softray::optim::{Evaluation, MeshRegulariser, Step};
use softray::prelude::*;

use super::dataset::Dataset;
use super::evaluate::predict_and_measure;
use super::network::{Bodies, Decoder, Network};
use super::numbers::Numbers;
use super::render::{options, render_items};
use super::settings::Settings;

/// Weights of the parts of the loss; silhouettes count 1.
const IMAGE: f64 = 10.0;
const NORMALS: f64 = 0.02;

/// What training needs beside the network.
pub struct Trainer<'a> {
    pub settings: &'a Settings,
    pub data: &'a Dataset,
    pub validation: &'a Dataset,
    pub decoder: &'a Decoder,
    pub regular: MeshRegulariser,
    /// Without autodiff.
    pub device: Device,
}

/// The objects of a step: (item, eye) of what the network sees, and of all that is compared.
pub struct Batch {
    inputs: Vec<(usize, usize)>,
    compared: Vec<(usize, usize)>,
}

/// The parts of the loss.
pub struct Parts {
    pub image: Tensor<1>,
    pub silhouette: Tensor<1>,
    pub normals: Tensor<1>,
}

impl Parts {
    pub fn sum(&self) -> Tensor<1> {
        self.image.clone() * IMAGE + self.silhouette.clone() + self.normals.clone() * NORMALS
    }
}

impl Trainer<'_> {
    /// Objects and views by the seed of the step.
    pub fn batch(&self, step: &Step) -> Batch {
        let n = &mut Numbers::new(step.seed(0), 1);
        let items = self.data.items.len();
        let inputs: Vec<_> = (0..self.settings.batch)
            .map(|_| (n.index(items), 0))
            .collect();
        let pair = |&(item, eye): &(usize, usize)| {
            let other = 1 + n.index(self.settings.views - 1);
            [(item, eye), (item, other)]
        };
        let compared = inputs.iter().flat_map(pair).collect();
        Batch { inputs, compared }
    }

    /// What the network says of a batch.
    pub fn predict(&self, network: &Network, batch: &Batch) -> Bodies {
        let device = self.device.clone().autodiff();
        let images = self.data.images(&batch.inputs, &device).radiance;
        self.decoder.bodies(network.forward(images))
    }

    /// What is lost by bodies, from two renders of each view with noise of their own, so that the
    /// noise of one does not meet itself.
    pub fn compare(&self, bodies: &Bodies, batch: &Batch, step: &Step) -> softray::Result<Parts> {
        let item = |(k, &(item, eye)): (usize, &(usize, usize))| {
            let known = &self.data.items[item];
            let scene = self.decoder.scene(bodies, k / 2, &known.light);
            (scene, known.eyes[eye].camera())
        };
        let items: Vec<_> = batch.compared.iter().enumerate().map(item).collect();
        let options = step.options(&options(self.settings.samples), 0);
        let a = render_items(&items, &options, step.seed(0))?;
        let b = render_items(&items, &options, step.seed(512))?;
        let target = self.data.images(&batch.compared, &self.device);
        let image = (a.radiance - target.radiance.clone()) * (b.radiance - target.radiance);
        Ok(Parts {
            image: image.mean(),
            silhouette: apart((a.opacity + b.opacity) * 0.5, target.opacity),
            normals: self.regular.normal_consistency(bodies.vertices.clone()),
        })
    }

    /// The loss of a step, and now and then how the network does on the validation set.
    pub fn evaluate(&self, network: &Network, step: &Step) -> softray::Result<Evaluation> {
        let batch = self.batch(step);
        let parts = self.compare(&self.predict(network, &batch), &batch, step)?;
        let every = self.settings.steps.div_ceil(self.settings.evaluations);
        let validated = if step.index.is_multiple_of(every.max(1)) {
            predict_and_measure(self.validation, network, self.decoder, &self.device)?
        } else {
            [f64::NAN; 2]
        };
        let value = |t: &Tensor<1>| t.clone().into_scalar::<f32>().into();
        Ok(Evaluation::new(parts.sum())
            .value("image", value(&parts.image))
            .value("silhouette", value(&parts.silhouette))
            .value("normals", value(&parts.normals))
            .value("IoU input", validated[0])
            .value("IoU other", validated[1]))
    }
}

/// The mean over N renders of how far opacities `[N, H, W]` are from overlapping: 1 − Σab / Σ(a + b −
/// ab), as [`softray::loss::silhouette_iou`] of each.
fn apart(opacity: Tensor<3>, target: Tensor<3>) -> Tensor<1> {
    let sums = |t: Tensor<3>| t.flatten::<2>(1, 2).sum_dim(1);
    let both = sums(opacity.clone() * target.clone());
    let union = sums(opacity + target) - both.clone();
    // Targets are never empty.
    (both / union).mean().neg() + 1.0
}
