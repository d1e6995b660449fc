//! Rays from a surface point to lights: `kernel/direct` in a kernel of a GPU.

use burn::cubecl::{self, prelude::*};

use super::Features;
use super::layout::{CONE, NONE};
use super::light::{Emitter, density_of_direction, sky};
use super::surface::Point;
use crate::model::bsdf::Known;
use crate::model::cone::{bend, lifted, up_to_plane};
use crate::model::emitter::{LightPoint, power_heuristic};
use crate::model::{Pair, V3, splat, v2};

/// A ray to a light, and the light that it brings if nothing is in between. Its limit is less than 0 if there
/// is none.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
pub(super) struct ShadowRay {
    pub start: V3,
    pub direction: V3,
    pub limit: f32,
    pub light: V3,
}

/// A surface point of a path, and its random numbers there.
#[derive(CubeType, CubeTypeMut, Clone, Copy, Debug)]
#[expand(derive(Clone, Copy))]
pub(super) struct Receiver {
    pub point: Point,
    pub cone_u: f32,
    pub cone_v: f32,
    /// What the probabilities of emitters there are divided by.
    pub sum: f32,
}

/// A ray to a point of an emitter. `by_scattering` says by which of two strategies the point was found, if
/// `combined`.
#[cube]
pub(super) fn towards_emitter(
    floats: &[f32],
    from: &Receiver,
    e: Emitter,
    b: f32,
    c: f32,
    chance: f32,
    combined: bool,
    by_scattering: bool,
) -> ShadowRay {
    let light = e.a * (1.0 - b - c) + e.b * b + e.c * c;
    let seen = LightPoint::new(light - from.point.position, e.normal);
    let direction = seen.direction;
    let reflected = from.point.shading.evaluate(direction);
    let outer = from.point.shading.outer(direction);
    let start = lifted(from.point.position, outer);
    let mut ray = ShadowRay {
        start,
        direction,
        limit: (-1.0f32).runtime(),
        light: splat(0.0),
    };
    if seen.facing > 0.0 && !reflected.is_zero() {
        let bent = bend(direction, outer, floats[CONE], from.cone_u, from.cone_v);
        ray.direction = bent.direction;
        ray.limit = up_to_plane(start, bent.direction, e.normal, light);
        let angle = seen.solid_angle(e.area);
        let mut density = chance;
        if combined {
            let other = from.point.shading.density(direction) * angle;
            density = power_heuristic(chance, other, by_scattering);
        }
        ray.light = reflected.times(e.emission) * (angle / density);
    }
    ray
}

/// A ray to the map along a direction, which was found by one of two strategies.
#[cube]
pub(super) fn towards_map(
    floats: &[f32],
    words: &[u32],
    from: &Receiver,
    direction: V3,
    by_scattering: bool,
    #[comptime] features: Features,
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
        let bent = bend(direction, outer, floats[CONE], from.cone_u, from.cone_v);
        let chance = density_of_direction(floats, words, direction);
        let density = power_heuristic(chance, shading.density(direction), by_scattering);
        ray.direction = bent.direction;
        ray.limit = f32::MAX.runtime();
        ray.light = reflected.times(sky(floats, words, direction, features)) * (1.0 / density);
    }
    ray
}

/// A surface point that is not there yet.
#[cube]
pub(super) fn no_point(#[comptime] features: Features) -> Point {
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
            facets: comptime!(Known(features.facets)),
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
