//! `Debug` for images and batches. It prints shapes, never pixels.

use std::fmt::{Debug, Formatter, Result};

use super::batch::Batch;
use super::film::{Image, ImageBatch};
use crate::debug::{Text, shape, tensor};

/// Implements `Debug` for images and batches of images. The closure returns the number of rays of all views.
macro_rules! images {
    ($($images:ident: |$image:ident| $rays:expr;)*) => {$(
        impl Debug for $images {
            fn fmt(&self, f: &mut Formatter<'_>) -> Result {
                let ($image, mut all) = (self, f.debug_struct(stringify!($images)));
                all.field("radiance", &tensor(&$image.radiance));
                for (name, plane) in [("opacity", &$image.opacity), ("depth", &$image.depth)] {
                    if let Some(plane) = plane {
                        all.field(name, &tensor(plane));
                    }
                }
                for (name, colors) in [("normals", &$image.normals), ("albedo", &$image.albedo)] {
                    if let Some(colors) = colors {
                        all.field(name, &tensor(colors));
                    }
                }
                if let Some(ids) = &$image.object_ids {
                    all.field("object_ids", &shape(ids));
                }
                all.field("rays", &$rays).finish_non_exhaustive()
            }
        }
    )*};
}

images! {
    Image: |image| image.statistics.rays;
    ImageBatch: |images| images.statistics.iter().map(|s| s.rays).sum::<u64>();
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
            let shown =
                |(name, values): &(String, _)| Text(format!("{name:?}: {:?}", tensor(values)));
            let vertices: Vec<Text> = self.vertices.iter().map(shown).collect();
            all.field("vertices", &vertices);
        }
        all.finish()
    }
}
