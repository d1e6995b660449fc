//! Lights without extent: the light that they bring to points of paths, and its derivatives.

use std::sync::Once;

use glam::DVec3;

use super::direct::Shaded;
use super::gradient::Sums;
use super::surface::PointGradient;
use super::view::View;
use super::walk::{DeltaSample, Sample, Vertex, Work};
use crate::model::V3;
use crate::model::cone::{lifted, up_to_plane};
use crate::model::delta_light::{DeltaArrival, DeltaLight};

/// The distance after which a ray that was bent about the direction to a light is past it: it comes to the plane across
/// that direction.
#[inline(always)]
pub(super) fn up_to_light(
    light: &DeltaLight,
    seen: &DeltaArrival,
    start: V3,
    direction: V3,
) -> f32 {
    if light.directional {
        f32::INFINITY
    } else {
        up_to_plane(start, direction, -seen.direction, light.position)
    }
}

impl View {
    /// Light from one light without extent, chosen with a probability.
    #[inline(never)]
    pub(super) fn connect_delta(
        &self,
        from: &Shaded,
        (light, chance): (usize, f32),
        [cone_u, cone_v]: [f32; 2],
        work: &mut Work,
    ) {
        let shading = &from.point.shading;
        let delta = &self.scene.emitters.lights()[light];
        let seen = delta.seen_from(from.point.position);
        let reflected = shading.evaluate(seen.direction);
        if seen.scale <= 0.0 || reflected == V3::ZERO {
            return;
        }
        let outer = shading.outer(seen.direction);
        let start = lifted(from.point.position, outer);
        let bend = self.bend(seen.direction, outer, cone_u, cone_v);
        let limit = up_to_light(delta, &seen, start, bend.direction);
        let arrives = reflected * delta.strength * (seen.scale / chance);
        let sample = Sample::Delta(DeltaSample {
            light: light as u32,
            seen,
            reflected,
            chance,
        });
        from.propose((start, bend.direction), limit, arrives, sample, work);
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
        let scale = seen.scale / sample.chance;
        let carried = g * vertex.throughput;
        let by_reflected = carried * delta.strength * scale;
        let shading = &vertex.point.shading;
        let by_direction = shading.evaluate_backward(seen.direction, by_reflected, &mut by.shading);
        let reflected = carried * sample.reflected;
        let by_scale = reflected.dot(delta.strength) / sample.chance;
        let found = delta.backward(seen, by_scale, by_direction);
        by.position -= found.position;
        if self.wanted.lights[light] {
            let to = &mut sums.lights[light];
            to.strength += DVec3::from(reflected * scale);
            to.add(&found);
        }
        g * sample.reflected * delta.strength * scale
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
