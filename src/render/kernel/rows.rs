//! Converts between the rows of an image and the kernels' pixel values.

use std::ops::Range;

use glam::DVec3;

use crate::render::outputs::Outputs;
use softray_kernels::kernel::Seen;

/// The channels of an image: radiance, opacity, depth, normal, albedo, weights of the objects and the background, rays
/// of a path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows {
    outputs: Outputs,
    /// The number of objects, if their weights are requested.
    pub objects: Option<usize>,
    /// Whether rays are counted.
    pub rays: bool,
}

impl Rows {
    pub fn new(outputs: Outputs, objects: usize) -> Self {
        Self {
            outputs,
            objects: outputs.object_ids.then_some(objects),
            rays: false,
        }
    }

    /// Only radiance and the number of rays.
    pub fn with_rays() -> Self {
        Self {
            rays: true,
            ..Self::new(Outputs::default(), 0)
        }
    }

    /// The outputs in the format of the GPU kernels.
    #[cfg(feature = "gpu")]
    pub fn for_gpu(&self) -> crate::gpu::Outputs {
        let o = self.outputs;
        crate::gpu::Outputs {
            opacity: o.need_opacity(),
            depth: o.depth,
            normals: o.normals,
            albedo: o.albedo,
            objects: self.objects.map_or(0, |n| n + 1),
            rays: self.rays,
        }
    }

    /// The number of channels.
    pub fn count(&self) -> usize {
        let of_pixel = self.of(&Seen::default(), 1.0).count();
        of_pixel + self.after_albedo() + 3 * usize::from(self.outputs.albedo)
    }

    /// The number of channels after the albedo.
    fn after_albedo(&self) -> usize {
        self.objects.map_or(0, |n| n + 1) + usize::from(self.rays)
    }

    /// The channels of the albedo, if it is an output.
    pub fn albedo(&self) -> Option<Range<usize>> {
        let past = self.count() - self.after_albedo();
        self.outputs.albedo.then(|| past - 3..past)
    }

    /// Returns the channels of a pixel before the albedo. `unit` is the kernels' length unit in
    /// scene units.
    pub fn of(&self, p: &Seen, unit: f64) -> impl Iterator<Item = f64> {
        let o = self.outputs;
        let opacity = o.need_opacity().then_some(f64::from(p.opacity));
        let depth = o.depth.then_some(f64::from(p.depth) * unit);
        let normal = o.normals.then_some(p.normal.as_dvec3().to_array());
        let radiance = p.radiance.as_dvec3().to_array().into_iter();
        let rows = radiance.chain(opacity).chain(depth);
        rows.chain(normal.into_iter().flatten())
    }

    /// The number of channels that have derivatives.
    pub fn derived(&self) -> usize {
        let o = self.outputs;
        3 + usize::from(o.need_opacity()) + usize::from(o.depth) + 3 * usize::from(o.normals)
    }

    /// Converts the derivatives with respect to the channels into derivatives with respect to the pixel's values. The
    /// albedo and the channels after it have none.
    pub fn upstream(&self, row: impl Fn(usize) -> f64, unit: f64) -> Seen {
        let mut next = 0;
        let mut take = |wanted: bool| {
            if !wanted {
                return 0.0;
            }
            next += 1;
            row(next - 1)
        };
        let Outputs { depth, normals, .. } = self.outputs;
        // In the order of the channels.
        Seen {
            radiance: DVec3::new(take(true), take(true), take(true)).into(),
            opacity: take(self.outputs.need_opacity()) as f32,
            depth: (take(depth) * unit) as f32,
            normal: DVec3::new(take(normals), take(normals), take(normals)).into(),
        }
    }
}
