//! The state of a path in a thread: its start, its ray and its point, and its result.

use softray_kernels::cube::*;

use super::hit::Ray;
use super::records::{MAX_BIT_ALONG, SAW_EMITTER, SAW_MAP, SAW_MAP_ALONG};
use softray_kernels::model::bsdf::Scatter;
use softray_kernels::model::{Four, Pair, V2, V3};
use softray_kernels::trace::{Beside, Features, Point, Scene, Seen, albedo_of};

/// The lights to which a point is connected, one after another: a sampled emitter, all emitters along the sampled BSDF
/// direction, a sampled direction of the environment map, and the map along the BSDF direction.
pub(super) const TO_EMITTER: u32 = 0;
pub(super) const TO_EMITTERS_ALONG: u32 = 1;
pub(super) const TO_MAP: u32 = 2;
pub(super) const TO_MAP_ALONG: u32 = 3;
pub(super) const DONE: u32 = 4;

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
    /// The normals about which directions are sampled, if `paired` ([`Shading`](softray_kernels::model::bsdf::Shading)).
    pub pair: Pair,
    pub paired: bool,
    pub mirrored: bool,
    /// Whether the emission of the point counts.
    pub emits: bool,
}

/// The state of a path between two points.
#[apply(zeroed!)]
pub(super) struct Walk {
    /// The ray to the next point.
    pub origin: V3,
    pub direction: V3,
    /// Whether the ray also tests the visibility of the map along the BSDF direction, and the light that is then added
    /// if the ray escapes.
    pub waits: bool,
    pub waiting: V3,
    pub bounce: u32,
    pub throughput: V3,
    /// Random numbers for the emitter to which the next point is connected.
    pub next_emitter: V2,
}

#[cube]
impl Walk {
    /// Returns the ray to the next point.
    pub fn ray(&self, time: f32) -> Ray {
        Ray {
            origin: self.origin,
            direction: self.direction,
            time,
            limit: f32::MAX,
        }
    }
}

/// Returns whether light may be gathered in the sampled BSDF direction.
pub(super) fn may_look_along(features: &Features) -> bool {
    has_emitters_along(features) || features.gathers_map
}

/// Returns whether points may be connected to emitters in the sampled BSDF direction.
pub(super) fn has_emitters_along(features: &Features) -> bool {
    features.combined && features.glossy
}

/// A point of a path, and its connections to lights.
#[apply(zeroed!)]
pub(super) struct PathVertex {
    pub point: Point,
    /// Whether the point reflects light, and the scene has any.
    pub reflects: bool,
    /// The sampled BSDF direction, and two pairs of random numbers: for the cones of the bounce ray and of shadow rays.
    pub scatter: Scatter,
    pub cones: Four,
    /// The probability of directional lights among many emitters.
    pub share: f32,
    /// Random numbers for the emitter to which the point is connected.
    pub emitter: V2,
    /// The next light ([`TO_EMITTER`] and others).
    pub next_light: u32,
    /// The first emitter of the list that is not yet tested along the BSDF direction.
    pub next: u32,
    /// The record's bits of visible lights, and the bit of the next emitter along the BSDF direction.
    pub bits: u32,
    pub bit: u32,
    /// The probability with which the path went on.
    pub survival: f32,
}

#[cube]
impl PathVertex {
    /// Returns whether lights along the sampled BSDF direction also count.
    pub fn looks_along(&self, scene: &Scene) -> bool {
        comptime!(has_emitters_along(&scene.features)) && self.point.shading.glossy
    }

    /// Returns whether the path certainly continues in exactly the sampled direction.
    pub fn goes_straight_on(&self, scene: &Scene, bounce: u32) -> bool {
        let mut goes_on = bounce < scene.bounces && !self.scatter.weight.is_zero();
        if comptime!(scene.features.roulette) {
            goes_on = goes_on && bounce < scene.roulette_after;
        }
        goes_on && comptime!(!scene.features.cones)
    }

    /// Returns the record's bit of the next light.
    pub fn bit_of_light(&self) -> u32 {
        let mut bit = SAW_EMITTER.runtime();
        if self.next_light == TO_EMITTERS_ALONG {
            bit = self.bit;
        } else if self.next_light == TO_MAP {
            bit = SAW_MAP.runtime();
        } else if self.next_light == TO_MAP_ALONG {
            bit = SAW_MAP_ALONG.runtime();
        }
        bit
    }

    /// Goes on to the next light.
    pub fn finish_light(&mut self, scene: &Scene) {
        if self.next_light == TO_EMITTERS_ALONG {
            // The last bit stands for all further emitters; no light hides behind so many others.
            if self.bit < (1u32 << MAX_BIT_ALONG) {
                self.bit *= 2;
            }
        } else {
            self.next_light += 1;
        }
        let is_lost = self.scatter.weight.is_zero();
        if self.next_light == TO_EMITTERS_ALONG && (is_lost || !self.looks_along(scene)) {
            self.next_light = TO_MAP;
        }
        if self.next_light == TO_MAP_ALONG && is_lost {
            self.next_light = DONE;
        }
        if comptime!(!scene.features.gathers_map) {
            if self.next_light >= TO_MAP {
                self.next_light = DONE;
            }
        }
    }
}

/// A shadow ray, and the light that it brings if it hits nothing.
#[apply(record!)]
pub(super) struct ShadowRay {
    pub ray: Ray,
    pub light: V3,
}
