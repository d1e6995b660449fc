//! Rays from a surface point to lights: `kernel/direct` in a kernel of a GPU.

use crate::cube::*;

use super::holes::is_open;
use super::layout::{CONE, NONE};
use super::light::Site;
use super::light::{delta_light, emitter, is_light, map_of, sky};
use super::reading::Scene;
use super::surface::{Point, emission_at};
use crate::model::cone::{bend, lifted, up_to_plane};
use crate::model::emitter::{LightPoint, power_heuristic};
use crate::model::{Pair, V2, V3, splat, v2, v3};

/// A ray to a light, and the light that it brings if nothing is in between. Its limit is less than 0 if there
/// is none.
#[apply(record!)]
pub(super) struct ShadowRay {
    pub start: V3,
    pub direction: V3,
    pub limit: f32,
    pub light: V3,
}

/// A surface point of a path, and its random numbers there.
#[apply(record!)]
pub(super) struct Receiver {
    pub point: Point,
    pub cone_u: f32,
    pub cone_v: f32,
    /// [`Site::sum`].
    pub sum: f32,
}

#[cube]
impl Receiver {
    /// As a point that emitters are chosen for.
    pub fn site(&self, time: f32) -> Site {
        Site {
            position: self.point.position,
            normal: self.point.shading.geometric,
            time,
            sum: self.sum,
        }
    }
}

/// What of an emitter a point is connected to.
#[apply(record!)]
pub(super) struct Target {
    /// The unit vector to it.
    pub direction: V3,
    /// A place of it, and the normal of the plane in which rays to it end.
    pub place: V3,
    pub normal: V3,
    /// Whether it is far away from everything.
    pub distant: bool,
    /// Radiance, or the strength of a light without extent.
    pub radiance: V3,
    /// What radiance is multiplied by where all of it arrives: a solid angle, or the scale of a light without extent; 0
    /// where nothing arrives.
    pub angle: f32,
    pub is_light: bool,
}

/// The point of an emitter with these weights of its corners b and c, or a light without extent.
#[cube]
pub(super) fn target_of(scene: &Scene, k: u32, weights: V2, x: V3, time: f32) -> Target {
    let zero = splat(0.0);
    let mut target = Target {
        direction: zero,
        place: zero,
        normal: zero,
        distant: false.runtime(),
        radiance: zero,
        angle: 0.0f32.runtime(),
        is_light: is_light(scene, k),
    };
    if target.is_light {
        if comptime!(scene.features.lights) {
            let light = delta_light(scene, k);
            let seen = light.seen_from(x);
            target.direction = seen.direction;
            target.place = light.position;
            target.normal = -seen.direction;
            target.distant = light.directional;
            target.radiance = light.strength;
            target.angle = seen.scale;
        }
    } else {
        let e = emitter(scene, k, time);
        let corners = v3(1.0 - weights.x - weights.y, weights.x, weights.y);
        let place = e.a * corners.x + e.b * corners.y + e.c * corners.z;
        let seen = LightPoint::new(place - x, e.normal);
        let mut open = false;
        if comptime!(scene.features.holes) {
            open = is_open(scene, e.triangle, corners);
        }
        target.direction = seen.direction;
        target.place = place;
        target.normal = e.normal;
        target.radiance = emission_at(scene, e.triangle, e.material, corners);
        if seen.facing > 0.0 && !open {
            target.angle = seen.solid_angle(e.area);
        }
    }
    target
}

/// The distance at which a ray about the direction to a target ends.
#[cube]
pub(super) fn up_to_target(target: &Target, start: V3, direction: V3) -> f32 {
    let mut limit = f32::MAX.runtime();
    if !target.distant {
        limit = up_to_plane(start, direction, target.normal, target.place);
    }
    limit
}

/// A ray to a target. `by_scattering` says by which of two strategies it was found, if `combined`.
#[cube]
pub(super) fn towards_target(
    scene: &Scene,
    from: &Receiver,
    target: &Target,
    chance: f32,
    combined: bool,
    by_scattering: bool,
) -> ShadowRay {
    let direction = target.direction;
    let reflected = from.point.shading.evaluate(direction);
    let outer = from.point.shading.outer(direction);
    let start = lifted(from.point.position, outer);
    let mut ray = ShadowRay {
        start,
        direction,
        limit: (-1.0f32).runtime(),
        light: splat(0.0),
    };
    if target.angle > 0.0 && !reflected.is_zero() {
        let bent = bend(
            direction,
            outer,
            scene.settings[CONE],
            from.cone_u,
            from.cone_v,
        );
        ray.direction = bent.direction;
        ray.limit = up_to_target(target, start, bent.direction);
        let mut density = chance;
        if combined && !target.is_light {
            let other = from.point.shading.density(direction) * target.angle;
            density = power_heuristic(chance, other, by_scattering);
        }
        ray.light = reflected.times(target.radiance) * (target.angle / density);
    }
    ray
}

/// A ray to the map along a direction, which was found by one of two strategies.
#[cube]
pub(super) fn towards_map(
    scene: &Scene,
    from: &Receiver,
    direction: V3,
    by_scattering: bool,
) -> ShadowRay {
    let shading = from.point.shading;
    let reflected = shading.evaluate(direction);
    let outer = shading.outer(direction);
    let mut ray = ShadowRay {
        start: lifted(from.point.position, outer),
        direction,
        limit: (-1.0f32).runtime(),
        light: splat(0.0),
    };
    if !reflected.is_zero() {
        let bent = bend(
            direction,
            outer,
            scene.settings[CONE],
            from.cone_u,
            from.cone_v,
        );
        let chance = map_of(scene).density(scene.floats, direction);
        let density = power_heuristic(chance, shading.density(direction), by_scattering);
        ray.direction = bent.direction;
        ray.limit = f32::MAX.runtime();
        ray.light = reflected.times(sky(scene, direction)) * (1.0 / density);
    }
    ray
}

/// A surface point that is not there yet.
#[cube]
pub(super) fn no_point(scene: &Scene) -> Point {
    let zero = splat(0.0f32.runtime());
    Point {
        position: zero,
        shading: crate::model::bsdf::Shading {
            geometric: zero,
            normal: zero,
            incoming: zero,
            diffuse: zero,
            specular: zero,
            exponent: 0.0f32.runtime(),
            glossy: false.runtime(),
            smooth: false.runtime(),
            model: 0u32.runtime(),
            compensated: false.runtime(),
            inside: false.runtime(),
            models: comptime!(scene.features.models),
            pair: Pair {
                first: zero,
                second: zero,
            },
            paired: false.runtime(),
        },
        emission: zero,
        reflects: false.runtime(),
        triangle: NONE.runtime(),
        material: 0u32.runtime(),
        object: 0u32.runtime(),
        side: 1.0f32.runtime(),
        weights: zero,
        uv: v2(0.0, 0.0),
    }
}
