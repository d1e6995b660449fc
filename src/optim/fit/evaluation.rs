//! The result of evaluating a module at a step of a fit.

use burn::tensor::Tensor;

use crate::error::{Error, Result};

/// The result of a step: a loss in the graph of the module's parameters, with numbers and images to record.
#[derive(Clone)]
pub struct Evaluation {
    pub(super) loss: Tensor<1>,
    pub(super) values: Vec<(String, f64)>,
    pub(super) images: Vec<(String, Tensor<3>)>,
    pub(super) targets: Vec<(String, Tensor<3>)>,
}

impl Evaluation {
    /// An evaluation from a scalar loss `[1]`.
    pub fn new(loss: Tensor<1>) -> Self {
        Self {
            loss,
            values: Vec::new(),
            images: Vec::new(),
            targets: Vec::new(),
        }
    }

    /// Adds a number for the history: a parameter, an error, a part of the loss. Every step must name
    /// the same numbers in the same order.
    pub fn value(mut self, name: impl Into<String>, value: f64) -> Self {
        self.values.push((name.into(), value));
        self
    }

    /// Adds an image `[H, W, 3]` of linear radiance for [`Fit::pictures`](super::Fit::pictures) and the
    /// callback of [`Fit::on_step`](super::Fit::on_step). A name must mean the same view at every
    /// step.
    pub fn image(mut self, name: impl Into<String>, image: Tensor<3>) -> Self {
        self.images.push((name.into(), image));
        self
    }

    /// Adds the target `[H, W, 3]` of the image of a name, which is shown beside it.
    pub fn target(mut self, name: impl Into<String>, target: Tensor<3>) -> Self {
        self.targets.push((name.into(), target));
        self
    }

    /// Checks that names are unique, and that each target has the name and the size of an image.
    pub(super) fn check(&self) -> Result<()> {
        for all in [&self.images, &self.targets] {
            for (i, (name, _)) in all.iter().enumerate() {
                if all[..i].iter().any(|other| other.0 == *name) {
                    let field = format!("image or target {name:?}");
                    return Err(Error::invalid(
                        "fit",
                        field,
                        "named twice",
                        "one of each name",
                    ));
                }
            }
        }
        for (name, target) in &self.targets {
            let Some((_, image)) = self.images.iter().find(|i| i.0 == *name) else {
                let names: Vec<&String> = self.images.iter().map(|i| &i.0).collect();
                let expected = format!("the name of an image, of which there are {names:?}");
                return Err(Error::invalid(
                    "fit",
                    "name of a target",
                    format!("{name:?}"),
                    expected,
                ));
            };
            let (found, expected) = (target.dims(), image.dims());
            if found != expected {
                return Err(Error::invalid(
                    "fit",
                    format!("shape of the target {name:?}"),
                    format!("{found:?}"),
                    format!("{expected:?} like its image"),
                ));
            }
        }
        Ok(())
    }
}
