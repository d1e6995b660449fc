//! Lights that surface points are connected to.

use crate::cube::*;

use super::holes::is_open;
use super::layout::NONE;
use super::light::Site;
use super::light::{delta_light, emitter, is_light};
use super::reading::Scene;
use super::surface::{Point, emission_at};
use crate::model::connection::{ConeKernel, Target};
use crate::model::emitter::LightPoint;
use crate::model::{Pair, V2, V3, splat, v2, v3};

/// A surface point of a path, and its random numbers there.
#[apply(record!)]
pub(super) struct Receiver {
    pub point: Point,
    pub cone: ConeKernel,
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

/// The point of an emitter with these weights of its corners b and c, or a light without extent.
#[cube]
pub(super) fn target_of(
    scene: &Scene,
    k: u32,
    weights: V2,
    x: V3,
    time: f32,
    combined: bool,
) -> Target {
    let is_light = is_light(scene, k);
    let mut target = Target::none();
    if is_light {
        if comptime!(scene.features.lights) {
            let light = delta_light(scene, k);
            target = light.target(&light.seen_from(x));
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
        target = Target::of_emitter(&seen, place, e.normal, e.area);
        target.radiance = emission_at(scene, e.triangle, e.material, corners);
        target.combined = combined;
        if open {
            target.angle = 0.0f32;
        }
    }
    target
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
