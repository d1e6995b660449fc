//! Connections of surface points to lights: shadow rays, the light they carry, and the backward pass.

use super::bsdf::{Shading, ShadingGradient};
use super::cone::{bend, lifted, up_to_plane};
use super::emitter::{LightPoint, power_heuristic};
use super::{V3, splat};
use crate::cube::*;

/// The end of a connection: a point of an emitter, a delta light, or a direction of an environment map.
#[apply(record!)]
pub struct Target {
    /// The unit vector to the target.
    pub direction: V3,
    /// A point of the target, and the normal of the plane in which rays to it end.
    pub place: V3,
    pub normal: V3,
    /// Whether the target is infinitely far away.
    pub distant: bool,
    /// Radiance, or the strength of a delta light.
    pub radiance: V3,
    /// The factor of radiance if all of it arrives: a solid angle, the scale of a delta light, or 1. It is 0 where
    /// nothing arrives.
    pub angle: f32,
    /// Whether BSDF sampling reaches the target too, so that MIS applies.
    pub combined: bool,
}

/// Blur of a ray by its cone: the tangent of the half-angle, and random numbers.
#[apply(zeroed!)]
pub struct ConeKernel {
    pub tangent: f32,
    pub u: f32,
    pub v: f32,
}

/// A shadow ray to a light, which contributes `reflected` times `scale` times the light's radiance if no occluder is
/// in between. `limit` is not positive if there is no connection.
#[apply(record!)]
pub struct Connection {
    pub start: V3,
    pub direction: V3,
    pub limit: f32,
    /// f·cos θ at the surface, and the divisor of the sample.
    pub reflected: V3,
    pub density: f32,
    /// The target's angle over the divisor.
    pub scale: f32,
}

/// Light that arrived: f·cos θ at the surface, and the divisor of the sample.
#[apply(zeroed!)]
pub struct Arrived {
    pub reflected: V3,
    pub density: f32,
}

/// Returns the absence of a connection, for a surface point.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn no_connection(position: V3) -> Connection {
    Connection {
        start: position,
        direction: position,
        limit: (-1.0f32).runtime(),
        reflected: splat(0.0),
        density: 1.0f32.runtime(),
        scale: 0.0f32.runtime(),
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Target {
    /// Returns a target from which nothing arrives.
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

    /// Returns a direction of an environment map as a target, without its radiance.
    #[inline(always)]
    pub fn of_map(direction: V3) -> Target {
        let mut target = Target::none();
        target.direction = direction;
        target.angle = 1.0f32.runtime();
        target.combined = true.runtime();
        target
    }

    /// Returns a point of an emitter as a target, without its radiance. All points of the emitter are taken as seen
    /// alike.
    #[inline(always)]
    pub fn of_emitter(seen: &LightPoint, place: V3, normal: V3, area: f32) -> Target {
        Target {
            direction: seen.direction,
            place,
            normal,
            distant: false.runtime(),
            radiance: splat(0.0),
            angle: max(seen.solid_angle(area), 0.0),
            combined: false.runtime(),
        }
    }

    /// Returns the cosine between the direction from the target and its normal, if it has one.
    #[inline(always)]
    pub fn facing(&self) -> f32 {
        -self.normal.dot(self.direction)
    }

    /// Returns the distance at which a ray about the direction to the target ends.
    #[inline(always)]
    pub fn limit(&self, start: V3, direction: V3) -> f32 {
        let mut limit = f32::MAX.runtime();
        if !self.distant {
            limit = up_to_plane(start, direction, self.normal, self.place);
        }
        limit
    }

    /// Returns the divisor of a sample that was drawn with density `chance`, or found by BSDF sampling.
    #[inline(always)]
    pub fn divisor(&self, shading: &Shading, chance: f32, by_scattering: bool) -> f32 {
        let mut density = chance;
        if self.combined {
            let other = shading.density(self.direction) * self.angle;
            density = power_heuristic(chance, other, by_scattering);
        }
        density
    }

    /// Returns the connection of a surface point to the target, which was sampled with density `chance` or found by
    /// BSDF sampling.
    #[inline(always)]
    pub fn connect(
        &self,
        shading: &Shading,
        position: V3,
        chance: f32,
        by_scattering: bool,
        cone: ConeKernel,
    ) -> Connection {
        let mut reflected = splat(0.0);
        if self.angle > 0.0 {
            reflected = shading.evaluate(self.direction);
        }
        let mut found = no_connection(position);
        if !reflected.is_zero() {
            found = self.connection(shading, position, reflected, chance, by_scattering, cone);
        }
        found
    }

    /// Returns the connection of a surface point to the target if there is one, as [`connect`](Self::connect) does.
    /// `reflected` is f·cos θ at the surface. It has no branches unless the target is combined.
    #[inline(always)]
    pub fn connection(
        &self,
        shading: &Shading,
        position: V3,
        reflected: V3,
        chance: f32,
        by_scattering: bool,
        cone: ConeKernel,
    ) -> Connection {
        let outer = shading.outer(self.direction);
        let bent = bend(self.direction, outer, cone.tangent, cone.u, cone.v);
        let start = lifted(position, outer);
        let density = self.divisor(shading, chance, by_scattering);
        Connection {
            start,
            direction: bent.direction,
            limit: self.limit(start, bent.direction),
            reflected,
            density,
            scale: self.angle / density,
        }
    }

    /// Backward pass of arrived light times g: adds the derivatives with respect to the shading, and returns the
    /// others.
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

/// Derivatives with respect to the path's throughput, the direction to the target, and the target's angle and
/// radiance.
#[apply(record!)]
pub struct TargetGradient {
    pub throughput: V3,
    pub direction: V3,
    pub angle: f32,
    pub radiance: V3,
}
