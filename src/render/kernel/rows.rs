//! The rows of an image, to and from what kernels make of a pixel.

use crate::kernel::Seen;
use crate::render::options::RenderOptions;
use glam::DVec3;

/// The rows of an image: radiance, opacity, depth, normal, share of each object and the background.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows {
    opacity: bool,
    depth: bool,
    normals: bool,
    /// The number of objects, if their shares are asked for.
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

    /// The number of rows.
    pub fn count(&self) -> usize {
        let normals = if self.normals { 3 } else { 0 };
        let objects = self.objects.map_or(0, |n| n + 1);
        3 + usize::from(self.opacity) + usize::from(self.depth) + normals + objects
    }

    /// All but the shares of objects, in a scene whose distances are in so many scene units.
    pub fn of(&self, p: &Seen, unit: f64) -> impl Iterator<Item = f64> {
        let opacity = self.opacity.then_some(f64::from(p.opacity));
        let depth = self.depth.then_some(f64::from(p.depth) * unit);
        let normal = self.normals.then_some(p.normal.as_dvec3().to_array());
        let radiance = p.radiance.as_dvec3().to_array().into_iter();
        let rows = radiance.chain(opacity).chain(depth);
        rows.chain(normal.into_iter().flatten())
    }

    /// From rows of derivatives by the rows.
    pub fn upstream(&self, row: impl Fn(usize) -> f64, unit: f64) -> Seen {
        let mut next = 0;
        let mut take = |wanted: bool| {
            if !wanted {
                return 0.0;
            }
            next += 1;
            row(next - 1)
        };
        let radiance = DVec3::new(take(true), take(true), take(true)).as_vec3();
        let opacity = take(self.opacity) as f32;
        let depth = (take(self.depth) * unit) as f32;
        let normals = self.normals;
        Seen {
            radiance,
            opacity,
            depth,
            normal: DVec3::new(take(normals), take(normals), take(normals)).as_vec3(),
        }
    }
}
