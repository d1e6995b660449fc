//! What `{:?}` shows of images and batches: shapes, never pixels.

use std::fmt::{Debug, Formatter, Result};

use super::batch::BatchVertices;
use super::{Batch, Image, ImageBatch};
use crate::debug::{shape, tensor};

impl Debug for Image {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let mut all = f.debug_struct("Image");
        all.field("radiance", &tensor(&self.radiance));
        for (name, plane) in [("opacity", &self.opacity), ("depth", &self.depth)] {
            if let Some(plane) = plane {
                all.field(name, &tensor(plane));
            }
        }
        if let Some(normals) = &self.normals {
            all.field("normals", &tensor(normals));
        }
        if let Some(ids) = &self.object_ids {
            all.field("object_ids", &shape(ids));
        }
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
        all.field("radiance", &tensor(&self.radiance));
        for (name, plane) in [("opacity", &self.opacity), ("depth", &self.depth)] {
            if let Some(plane) = plane {
                all.field(name, &tensor(plane));
            }
        }
        if let Some(normals) = &self.normals {
            all.field("normals", &tensor(normals));
        }
        if let Some(ids) = &self.object_ids {
            all.field("object_ids", &shape(ids));
        }
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
