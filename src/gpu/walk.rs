//! The state of a path in a thread: its start, its current ray and point, and its result.

use crate::cube::*;

use crate::model::bsdf::Scatter;
use crate::model::connection::ConeKernel;
use crate::model::{Pair, V2, V3};
use crate::trace::{Beside, Point, Scene, Seen, albedo_of};

/// The purposes of a path's rays. The camera ray comes first. At each point, shadow rays follow: to a sampled
/// emitter, to all emitters along the sampled BSDF direction, to a sampled direction of the environment map, and to
/// the map along the BSDF direction. Then the bounce ray continues the path.
pub(super) const OF_CAMERA: u32 = 0;
pub(super) const TO_EMITTER: u32 = 1;
pub(super) const TO_EMITTERS_ALONG: u32 = 2;
pub(super) const TO_MAP: u32 = 3;
pub(super) const TO_MAP_ALONG: u32 = 4;
pub(super) const ONWARDS: u32 = 5;
pub(super) const ENDED: u32 = 6;

/// The result of a path.
#[apply(zeroed!)]
pub(super) struct PathLight {
    /// The surface that the first ray hits, and the light of the path.
    pub seen: Seen,
    /// The albedo of that surface, if it is an output.
    pub albedo: V3,
    /// The object that the first ray hits, or [`NONE`].
    pub object: u32,
    pub rays: u32,
    /// The number of rays that were traced to the next surface, including misses.
    pub looked: u32,
    /// The number of surface points on the path.
    pub points: u32,
}

#[cube]
impl PathLight {
    /// Records the surface point that the first ray hit.
    pub fn see(&mut self, scene: &Scene, point: &Point, distance: f32) {
        self.seen.opacity = 1.0;
        self.seen.depth = distance;
        self.seen.normal = point.shading.geometric;
        self.object = point.object;
        if comptime!(scene.features.albedo) {
            self.albedo = albedo_of(scene, point);
        }
    }
}

/// A surface point at which a path starts, instead of the camera.
#[apply(zeroed!)]
pub(super) struct Start {
    pub at: Beside,
    pub bounce: u32,
    /// The normals about which directions are sampled, if `paired` ([`Shading`](crate::model::bsdf::Shading)).
    pub pair: Pair,
    pub paired: bool,
    pub mirrored: bool,
    /// Whether the emission of the point counts.
    pub emits: bool,
}

/// The state of a path.
#[apply(zeroed!)]
pub(super) struct Walk {
    /// The purpose of the current ray, and the ray. If the limit is not positive, no ray is traced.
    pub purpose: u32,
    pub origin: V3,
    pub direction: V3,
    pub limit: f32,
    /// The light of the shadow ray if no occluder is in between.
    pub light: V3,
    /// Whether the bounce ray also tests the visibility of the map along the BSDF direction, and the light that is
    /// then added if the ray escapes.
    pub waits: bool,
    pub waiting: V3,
    pub bounce: u32,
    pub throughput: V3,
    /// The current point, the sampled BSDF direction, and random numbers for the cones of shadow rays.
    pub point: Point,
    pub scatter: Scatter,
    pub cone: ConeKernel,
    /// The probability of directional lights among many emitters.
    pub share: f32,
    /// Random numbers for the emitter to which this point is connected, and for the emitter of the next point.
    pub emitter: V2,
    pub next_emitter: V2,
    /// The first emitter of the list that is not yet tested along the BSDF direction.
    pub next: u32,
    /// The record's bits of lights visible from the point, and the bit of the next emitter along the BSDF direction.
    pub bits: u32,
    pub bit: u32,
}

#[cube]
impl Walk {
    /// Returns whether the ray leads to a surface point: a camera ray or a bounce ray.
    pub fn arrives(&self) -> bool {
        self.purpose == OF_CAMERA || self.purpose == ONWARDS
    }

    /// Returns whether the ray can only reach the environment.
    pub fn is_last(&self, scene: &Scene) -> bool {
        self.purpose == ONWARDS && self.bounce >= scene.bounces
    }

    /// Returns whether the path certainly continues from its point, in exactly the sampled direction.
    pub fn goes_straight_on(&self, scene: &Scene) -> bool {
        let mut goes_on = self.bounce < scene.bounces && !self.scatter.weight.is_zero();
        if comptime!(scene.features.roulette) {
            goes_on = goes_on && self.bounce < scene.roulette_after;
        }
        goes_on && comptime!(!scene.features.cones)
    }

    /// Returns whether lights along the sampled BSDF direction also count at the point.
    pub fn looks_along(&self, scene: &Scene) -> bool {
        comptime!(scene.features.combined) && self.point.shading.glossy
    }
}
