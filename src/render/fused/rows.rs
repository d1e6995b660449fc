//! What an image has of a pixel, in rows.

use glam::DVec3;

use crate::render::RenderOptions;
use crate::transport::Pixel;

/// The rows of an image, in the order of [`Renderer::outputs`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows {
    opacity: bool,
    depth: bool,
    normals: bool,
    /// How many objects, if their weights are asked for.
    pub objects: Option<usize>,
}

impl Rows {
    pub fn new(options: &RenderOptions, objects: usize) -> Self {
        let outputs = options.outputs;
        Self {
            opacity: outputs.opacity || outputs.depth || outputs.normals,
            depth: outputs.depth,
            normals: outputs.normals,
            objects: outputs.object_ids.then_some(objects),
        }
    }

    pub fn count(&self) -> usize {
        let normals = if self.normals { 3 } else { 0 };
        let objects = self.objects.map_or(0, |n| n + 1);
        3 + usize::from(self.opacity) + usize::from(self.depth) + normals + objects
    }

    /// All but the weights of objects, in a scene whose depths are in so many scene units.
    pub fn of(&self, p: &Pixel, unit: f64) -> impl Iterator<Item = f64> {
        let opacity = self.opacity.then_some(p.opacity);
        let depth = self.depth.then_some(p.depth * unit);
        let normal = self.normals.then_some(p.normal.to_array());
        let radiance = p.radiance.to_array().into_iter();
        let rows = radiance.chain(opacity).chain(depth);
        rows.chain(normal.into_iter().flatten())
    }

    /// From rows of derivatives by the rows.
    pub fn pixel(&self, row: impl Fn(usize) -> f64, unit: f64) -> Pixel {
        let mut next = 3;
        let mut take = |wanted: bool| {
            if !wanted {
                return 0.0;
            }
            next += 1;
            row(next - 1)
        };
        Pixel {
            radiance: DVec3::new(row(0), row(1), row(2)),
            opacity: take(self.opacity),
            depth: take(self.depth) * unit,
            normal: DVec3::new(take(self.normals), take(self.normals), take(self.normals)),
        }
    }
}
