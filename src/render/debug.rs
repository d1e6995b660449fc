//! `{:?}` of images and batches: shapes, never pixels.

use std::fmt::{Debug, Formatter, Result};

use super::batch::{Batch, BatchVertices};
use super::film::{Image, ImageBatch};
use crate::debug::{shape, tensor};

/// Adds the outputs that an image and a batch of images have in common.
macro_rules! outputs {
    ($all:ident, $image:ident) => {
        $all.field("radiance", &tensor(&$image.radiance));
        for (name, plane) in [("opacity", &$image.opacity), ("depth", &$image.depth)] {
            if let Some(plane) = plane {
                $all.field(name, &tensor(plane));
            }
        }
        if let Some(normals) = &$image.normals {
            $all.field("normals", &tensor(normals));
        }
        if let Some(ids) = &$image.object_ids {
            $all.field("object_ids", &shape(ids));
        }
    };
}

impl Debug for Image {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let mut all = f.debug_struct("Image");
        outputs!(all, self);
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
        outputs!(all, self);
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
