//! The upstream gradient of a backward pass.

use crate::cube::*;

use super::job::Outputs;
use super::sums::TYPICAL;
use crate::model::jumps::counts_of;
use crate::model::{V3, v3};
use crate::trace::{Scene, Seen, UNIT};

/// The derivatives of the loss with respect to the rows of an image, and the scales of sums.
#[apply(argument!)]
pub(super) struct Loss {
    upstream: &'static [f32],
    pub scales: &'static [f32],
    /// The factor of the derivatives.
    scale: f32,
    #[cube(comptime)]
    outputs: Outputs,
}

#[cube]
impl Loss {
    /// Returns the derivatives of the loss with respect to the rows of a pixel.
    pub fn of_row(&self, scene: &Scene, row: u32) -> Seen {
        let outputs = comptime!(self.outputs);
        let own = row as usize * comptime!(outputs.rows());
        let mut g = Seen::default();
        g.radiance = self.vector(own);
        if comptime!(outputs.opacity) {
            g.opacity = self.upstream[own + 3] * self.scale;
        }
        let depth = comptime!(3 + usize::from(outputs.opacity));
        if comptime!(outputs.depth) {
            g.depth = self.upstream[own + depth] * self.scale * scene.settings[UNIT];
        }
        if comptime!(outputs.normals) {
            g.normal = self.vector(own + comptime!(depth + usize::from(outputs.depth)));
        }
        g
    }

    /// Returns the size of the derivative that a point of a path carries, relative to a typical camera ray.
    pub fn counts_of(&self, view: u32, carried: V3) -> f32 {
        let typical = self.scales[TYPICAL + view as usize] * self.scale;
        counts_of(carried, typical.max(1e-37))
    }

    fn vector(&self, at: usize) -> V3 {
        let g = self.upstream;
        v3(g[at], g[at + 1], g[at + 2]) * self.scale
    }
}
