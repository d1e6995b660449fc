//! Lights without extent: the light that they bring to points of paths, and its derivatives.

use std::sync::Once;

use glam::DVec3;

use super::direct::Shaded;
use super::gradient::Sums;
use super::surface::PointGradient;
use super::view::View;
use super::walk::{DeltaSample, Sample, Vertex, Work};
use crate::model::V3;
use crate::model::connection::{ConeKernel, Connection};

impl View {
    /// Light from one light without extent, chosen with a probability.
    #[inline(never)]
    pub(super) fn connect_delta(
        &self,
        from: &Shaded,
        (light, chance): (usize, f32),
        cone: ConeKernel,
        work: &mut Work,
    ) {
        let delta = &self.scene.emitters.lights()[light];
        let seen = delta.seen_from(from.point.position);
        let sample = |found: &Connection| {
            Sample::Delta(DeltaSample {
                light: light as u32,
                seen,
                reflected: found.reflected,
                chance,
            })
        };
        let radiance = || delta.strength;
        let drawn = (chance, false);
        from.connect(&delta.target(&seen), drawn, cone, radiance, sample, work);
    }

    /// Back over light from a light without extent.
    #[inline(never)]
    pub(super) fn delta_backward(
        &self,
        vertex: &Vertex,
        sample: &DeltaSample,
        g: V3,
        by: &mut PointGradient,
        sums: &mut Sums,
    ) -> V3 {
        let (light, seen) = (sample.light as usize, &sample.seen);
        let delta = &self.scene.emitters.lights()[light];
        let shading = &vertex.point.shading;
        let found = delta.target(seen).backward(
            shading,
            sample.reflected,
            sample.chance,
            g,
            vertex.throughput,
            &mut by.shading,
        );
        let by_light = delta.backward(seen, found.angle, found.direction);
        by.position -= by_light.position;
        if self.wanted.lights[light] {
            let to = &mut sums.lights[light];
            to.strength += DVec3::from(found.radiance);
            to.add(&by_light);
        }
        found.throughput
    }

    /// Tells that shadows of lights without extent have hard edges, whose derivative is left out.
    pub fn warn_of_hard_shadows(&self) {
        static ONCE: Once = Once::new();
        let turns = self.wanted.turns() && self.settings.bounces > 0;
        let seen = !self.scene.emitters.lights().is_empty() && (self.wanted.shifts() || turns);
        if self.cone == 0.0 && seen {
            ONCE.call_once(|| {
                log::warn!(
                    "the shadows of point, spot and directional lights have hard edges without cones, and \
                     gradients leave out that these move: render with an angle (RenderOptions::visibility, \
                     Visibility::cone)"
                );
            });
        }
    }
}
