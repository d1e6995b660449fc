//! Images of a step beside their targets.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use burn::tensor::Tensor;

use super::{Evaluation, Row};
use crate::error::{Error, Result};
use crate::figure::{Diverging, Figure, Panel};
use crate::io::HostImage;

/// The colour scales of the differences, by the name of the image, from the first picture.
pub(super) type Colours = RefCell<BTreeMap<String, Diverging>>;

/// The folder and the interval of the pictures of a fit.
pub(super) struct Pictures {
    pub folder: PathBuf,
    pub every: usize,
}

impl Pictures {
    pub fn new(folder: &Path, every: usize) -> Self {
        Self {
            folder: folder.into(),
            every,
        }
    }

    /// Makes the folder.
    pub fn open(&self) -> Result<()> {
        std::fs::create_dir_all(&self.folder).map_err(|source| Error::Io {
            path: self.folder.clone(),
            source,
        })
    }

    pub fn wants(&self, step: usize, steps: usize) -> bool {
        step.is_multiple_of(self.every) || step + 1 == steps
    }

    /// Writes the picture of a step; at the first one there has to be an image.
    pub fn write(&self, images: &Images, row: &Row, first: bool) -> Result<()> {
        if images.evaluation.images.is_empty() {
            if !first {
                return Ok(());
            }
            return Err(Error::invalid(
                "fit",
                "evaluation",
                "without an image",
                "one for the pictures: Evaluation::image",
            ));
        }
        let path = self.folder.join(format!("step-{:06}.png", row.step));
        images.figure(row)?.write(path)
    }
}

/// The images and targets of an evaluation.
pub(super) struct Images<'a> {
    pub evaluation: &'a Evaluation,
    pub colours: &'a Colours,
}

impl Images<'_> {
    /// A row for each image: the image, and if it has a target, that and their difference.
    pub fn figure(&self, row: &Row) -> Result<Figure> {
        let blur = row
            .blur
            .map_or(String::new(), |b| format!(", blur {b:.1e}"));
        let title = format!("step {}, loss {:.2e}{blur}", row.step, row.loss);
        let mut figure = Figure::new(title);
        for (name, image) in &self.evaluation.images {
            let image = read(image)?;
            let mut panels = vec![Panel::new(name.as_str(), &image)];
            let target = self.evaluation.targets.iter().find(|t| &t.0 == name);
            if let Some((_, target)) = target {
                let target = read(target)?;
                let difference = Panel::difference(format!("{name} − target"), &image, &target)?;
                let mut all = self.colours.borrow_mut();
                let colours = match (all.get(name), difference.map()) {
                    (Some(&colours), _) => colours,
                    (None, found) => {
                        let found = found.unwrap_or(Diverging::of(&[]));
                        all.insert(name.clone(), found);
                        found
                    }
                };
                panels.push(Panel::new("target", &target));
                panels.push(difference.colours(colours));
            }
            figure = figure.row(panels);
        }
        Ok(figure)
    }
}

pub(super) fn read(image: &Tensor<3>) -> Result<HostImage> {
    HostImage::take(image.clone().inner())
}
