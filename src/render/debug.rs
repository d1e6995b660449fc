//! `{:?}` of images and batches: shapes, never pixels.

use std::fmt::{Debug, DebugStruct, Formatter, Result};

use burn::tensor::{Int, Tensor};

use super::batch::{Batch, BatchVertices};
use super::film::{Image, ImageBatch};
use crate::debug::{shape, tensor};

/// The outputs of an image or a batch: planes with P axes and colours with C.
fn outputs<const P: usize, const C: usize>(
    all: &mut DebugStruct,
    radiance: &Tensor<C>,
    planes: [&Option<Tensor<P>>; 2],
    normals: &Option<Tensor<C>>,
    ids: &Option<Tensor<P, Int>>,
) {
    all.field("radiance", &tensor(radiance));
    for (name, plane) in ["opacity", "depth"].into_iter().zip(planes) {
        if let Some(plane) = plane {
            all.field(name, &tensor(plane));
        }
    }
    if let Some(normals) = normals {
        all.field("normals", &tensor(normals));
    }
    if let Some(ids) = ids {
        all.field("object_ids", &shape(ids));
    }
}

impl Debug for Image {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let mut all = f.debug_struct("Image");
        let planes = [&self.opacity, &self.depth];
        outputs(
            &mut all,
            &self.radiance,
            planes,
            &self.normals,
            &self.object_ids,
        );
        all.field("rays", &self.statistics.rays);
        if let Some(diagnostics) = &self.diagnostics {
            all.field("diagnostics", diagnostics);
        }
        all.finish_non_exhaustive()
    }
}

impl Debug for ImageBatch {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let mut all = f.debug_struct("ImageBatch");
        let planes = [&self.opacity, &self.depth];
        outputs(
            &mut all,
            &self.radiance,
            planes,
            &self.normals,
            &self.object_ids,
        );
        let rays: u64 = self.statistics.iter().map(|s| s.rays).sum();
        all.field("rays", &rays).finish_non_exhaustive()
    }
}

impl Debug for BatchVertices {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        write!(f, "{:?}: {:?}", self.name, tensor(&self.values))
    }
}

impl Debug for Batch {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let mut all = f.debug_struct("Batch");
        all.field("scenes", &self.scenes.len())
            .field("views", &self.views.len());
        if let Some(first) = self.scenes.first() {
            all.field("first_scene", first);
        }
        if !self.vertices.is_empty() {
            all.field("vertices", &self.vertices);
        }
        all.finish()
    }
}
