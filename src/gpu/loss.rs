//! The upstream gradient of a backward pass.

use softray_kernels::cube::*;

use super::job::Outputs;
use super::sums::{Adding, typical};
use softray_kernels::model::jumps::counts_of;
use softray_kernels::model::{V3, v3};
use softray_kernels::trace::{Scene, Seen, Sums, UNIT};

/// The derivatives of the loss with respect to the rows of an image, and the scales of sums.
#[apply(argument!)]
pub(super) struct Loss {
    /// The derivatives. In forward mode all are 1, and these are the tangents instead.
    numbers: &'static [f32],
    pub scales: &'static [f32],
    /// The number of parts of the sums.
    parts: u32,
    /// The factor of the derivatives.
    scale: f32,
    #[cube(comptime)]
    pub outputs: Outputs,
    #[cube(comptime)]
    pub forward: bool,
}

/// Returns a number for the channel of a column, and 0 for others.
#[cube]
fn if_in(number: f32, column: u32, channel: u32) -> f32 {
    select(column == channel, number, 0.0f32)
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
            g.opacity = self.number(own + 3);
        }
        let depth = comptime!(3 + usize::from(outputs.opacity));
        if comptime!(outputs.depth) {
            g.depth = self.number(own + depth) * scene.settings[UNIT];
        }
        if comptime!(outputs.normals) {
            g.normal = self.vector(own + comptime!(depth + usize::from(outputs.depth)));
        }
        g
    }

    /// Returns the sums of a thread. In forward mode they are those of the first channel of a pixel.
    pub fn sums<'a>(
        &self,
        scene: &Scene<'a>,
        adding: &Adding,
        thread: u32,
        pixel: u32,
    ) -> Sums<'a> {
        let (scales, tangents) = (self.scales, self.numbers);
        adding.of_thread(scene, scales, tangents, thread, pixel, self.forward)
    }

    /// Returns the size of the derivative that a point of a path carries, relative to a typical camera ray.
    pub fn counts_of(&self, view: u32, carried: V3) -> f32 {
        let typical = self.scales[(typical(self.parts) + view) as usize] * self.scale;
        counts_of(carried, typical.max(1e-37))
    }

    /// Returns the part of a pixel's derivatives that belongs to a channel.
    pub fn of_channel(&self, g: &Seen, channel: u32) -> Seen {
        let mut own = Seen {
            radiance: g.radiance,
            opacity: g.opacity,
            depth: g.depth,
            normal: g.normal,
        };
        if comptime!(self.forward) {
            let outputs = comptime!(self.outputs);
            let depth = comptime!(3 + u32::from(outputs.opacity));
            let normal = comptime!(depth + u32::from(outputs.depth));
            own.radiance = self.radiance_of(g.radiance, channel);
            own.opacity = if_in(g.opacity, 3u32, channel);
            own.depth = if_in(g.depth, depth, channel);
            own.normal = v3(
                if_in(g.normal.x, normal, channel),
                if_in(g.normal.y, normal + 1, channel),
                if_in(g.normal.z, normal + 2, channel),
            );
        }
        own
    }

    /// The same for derivatives with respect to radiance.
    pub fn radiance_of(&self, g: V3, channel: u32) -> V3 {
        let mut own = g;
        if comptime!(self.forward) {
            own = v3(
                if_in(g.x, 0u32, channel),
                if_in(g.y, 1u32, channel),
                if_in(g.z, 2u32, channel),
            );
        }
        own
    }

    fn vector(&self, at: usize) -> V3 {
        v3(self.number(at), self.number(at + 1), self.number(at + 2))
    }

    fn number(&self, at: usize) -> f32 {
        let mut number = self.scale;
        if comptime!(!self.forward) {
            number *= self.numbers[at];
        }
        number
    }
}
