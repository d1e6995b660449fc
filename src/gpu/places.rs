//! Where a path of a thread begins, where it is, and what it brings back.

use crate::cube::*;

use crate::model::bsdf::Shading;
use crate::model::connection::ConeKernel;
use crate::model::{Pair, V3, splat, v2};
use crate::trace::{NONE, Point, Scene};

/// The surface that a camera ray sees, and the light that its path brings back.
#[apply(record!)]
pub(super) struct PathLight {
    pub radiance: V3,
    /// 1 where there is a surface.
    pub opacity: f32,
    pub depth: f32,
    pub normal: V3,
    /// The object that is seen, or [`NONE`].
    pub object: u32,
    pub rays: u32,
    /// How often it looked for its next surface.
    pub looked: u32,
    /// Points of surfaces that it came to.
    pub points: u32,
}

/// A surface point of a path, and its random numbers there.
#[apply(record!)]
pub(super) struct Place {
    pub point: Point,
    pub cone: ConeKernel,
    /// The probability of directional lights among many emitters.
    pub share: f32,
}

/// A surface point that is not there yet.
#[cube]
pub(super) fn no_point(scene: &Scene) -> Point {
    let zero = splat(0.0f32.runtime());
    Point {
        triangle: NONE.runtime(),
        material: 0u32.runtime(),
        object: 0u32.runtime(),
        distance: 0.0f32.runtime(),
        position: zero,
        weights: zero,
        side: 1.0f32.runtime(),
        uv: v2(0.0, 0.0),
        shading: Shading {
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
        reflects: false.runtime(),
    }
}

/// A surface point that a path starts from in place of the camera.
#[apply(record!)]
pub(super) struct Start {
    pub triangle: u32,
    /// A place about there, and the direction in which it is seen.
    pub near: V3,
    pub direction: V3,
    pub distance: f32,
    pub bounce: u32,
    /// Normals about which directions are drawn, if it is paired ([`Shading`](crate::model::bsdf::Shading)).
    pub pair: Pair,
    pub paired: bool,
    /// Whether what it emits counts.
    pub emits: bool,
}

/// The camera.
#[cube]
pub(super) fn from_camera() -> Start {
    let zero = splat(0.0f32.runtime());
    Start {
        triangle: NONE,
        near: zero,
        direction: zero,
        distance: 0.0f32,
        bounce: 0u32,
        pair: Pair {
            first: zero,
            second: zero,
        },
        paired: false,
        emits: true,
    }
}
