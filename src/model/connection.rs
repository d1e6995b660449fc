//! Connections of surface points to lights: rays to them, the light that these bring, and the way back.

use super::bsdf::{Shading, ShadingGradient};
use super::cone::{bend, lifted, up_to_plane};
use super::emitter::{LightPoint, power_heuristic};
use super::{V3, splat};
use crate::cube::*;

/// What a point is connected to: a point of an emitter, a delta light, or a direction of a map.
#[apply(record!)]
pub(crate) struct Target {
    /// The unit vector to it.
    pub direction: V3,
    /// A place of it, and the normal of the plane in which rays to it end.
    pub place: V3,
    pub normal: V3,
    /// Whether it is far away from everything.
    pub distant: bool,
    /// Radiance, or the strength of a delta light.
    pub radiance: V3,
    /// What radiance is multiplied by where all of it arrives: a solid angle, the scale of a delta light, or 1;
    /// 0 where nothing arrives.
    pub angle: f32,
    /// Whether directions that the surface scatters find it too.
    pub combined: bool,
}

/// The kernel of a ray's cone: the tangent of its half-angle, and random numbers.
#[apply(zeroed!)]
pub(crate) struct ConeKernel {
    pub tangent: f32,
    pub u: f32,
    pub v: f32,
}

/// A ray to a light, which brings `reflected` times `scale` of its radiance if nothing is in between. Its limit is not
/// positive if there is none.
#[apply(record!)]
pub(crate) struct Connection {
    pub start: V3,
    pub direction: V3,
    pub limit: f32,
    /// f·cos θ at the surface, and the divisor of the sample.
    pub reflected: V3,
    pub density: f32,
    /// The angle over that.
    pub scale: f32,
}

/// Light that was seen: f·cos θ at the surface, and the divisor of the sample.
#[apply(zeroed!)]
pub(crate) struct Arrived {
    pub reflected: V3,
    pub density: f32,
}

/// None, of a point.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn no_connection(position: V3) -> Connection {
    Connection {
        start: position,
        direction: position,
        limit: (-1.0f32).runtime(),
        reflected: splat(0.0),
        density: 1.0f32.runtime(),
        scale: 0.0f32.runtime(),
    }
}

#[cfg_attr(feature = "wgpu", cube)]
impl Target {
    /// Nothing.
    #[inline(always)]
    pub fn none() -> Target {
        let zero = splat(0.0f32.runtime());
        Target {
            direction: zero,
            place: zero,
            normal: zero,
            distant: true.runtime(),
            radiance: zero,
            angle: 0.0f32.runtime(),
            combined: false.runtime(),
        }
    }

    /// A direction of a map; without its radiance.
    #[inline(always)]
    pub fn of_map(direction: V3) -> Target {
        let mut target = Target::none();
        target.direction = direction;
        target.angle = 1.0f32.runtime();
        target.combined = true.runtime();
        target
    }

    /// A point of an emitter, of which all points are seen alike; without its radiance.
    #[inline(always)]
    pub fn of_emitter(seen: &LightPoint, place: V3, normal: V3, area: f32) -> Target {
        Target {
            direction: seen.direction,
            place,
            normal,
            distant: false.runtime(),
            radiance: splat(0.0),
            angle: seen.solid_angle(area).max(0.0),
            combined: false.runtime(),
        }
    }

    /// The cosine of the direction to it to its normal, where it has one.
    #[inline(always)]
    pub fn facing(&self) -> f32 {
        -self.normal.dot(self.direction)
    }

    /// The distance at which a ray about the direction to it ends.
    #[inline(always)]
    pub fn limit(&self, start: V3, direction: V3) -> f32 {
        let mut limit = f32::MAX.runtime();
        if !self.distant {
            limit = up_to_plane(start, direction, self.normal, self.place);
        }
        limit
    }

    /// The divisor of a sample that was drawn with a density, or found by scattering.
    #[inline(always)]
    pub fn divisor(&self, shading: &Shading, chance: f32, by_scattering: bool) -> f32 {
        let mut density = chance;
        if self.combined {
            let other = shading.density(self.direction) * self.angle;
            density = power_heuristic(chance, other, by_scattering);
        }
        density
    }

    /// The connection of a surface point to it, which was drawn with a density, or found by scattering.
    #[inline(always)]
    pub fn connect(
        &self,
        shading: &Shading,
        position: V3,
        chance: f32,
        by_scattering: bool,
        cone: ConeKernel,
    ) -> Connection {
        let mut found = no_connection(position);
        if self.angle > 0.0 {
            found.reflected = shading.evaluate(self.direction);
        }
        if !found.reflected.is_zero() {
            let outer = shading.outer(self.direction);
            let bent = bend(self.direction, outer, cone.tangent, cone.u, cone.v);
            found.start = lifted(position, outer);
            found.direction = bent.direction;
            found.limit = self.limit(found.start, bent.direction);
            found.density = self.divisor(shading, chance, by_scattering);
            found.scale = self.angle / found.density;
        }
        found
    }

    /// Back over light that arrived, times g: adds the derivatives by the shading.
    #[inline(always)]
    pub fn backward(
        &self,
        shading: &Shading,
        arrived: Arrived,
        g: V3,
        throughput: V3,
        by: &mut ShadingGradient,
    ) -> TargetGradient {
        let reflected = arrived.reflected;
        let scale = self.angle / arrived.density;
        let carried = g.times(throughput);
        let by_reflected = carried.times(self.radiance) * scale;
        TargetGradient {
            throughput: g.times(reflected).times(self.radiance) * scale,
            direction: shading.evaluate_backward(self.direction, by_reflected, by),
            angle: carried.times(reflected).dot(self.radiance) / arrived.density,
            radiance: carried.times(reflected) * scale,
        }
    }
}

/// Derivatives by a connection: by the throughput of the path, by the direction to the target, and by its angle and
/// radiance.
#[apply(record!)]
pub(crate) struct TargetGradient {
    pub throughput: V3,
    pub direction: V3,
    pub angle: f32,
    pub radiance: V3,
}
