//! Where a path of a thread begins, where it is, and what it brings back.

use crate::cube::*;

use crate::model::bsdf::Scatter;
use crate::model::connection::ConeKernel;
use crate::model::{Pair, V2, V3};
use crate::trace::{Beside, Point, Scene, Seen};

/// What the next ray of a path is for. The camera's comes first; at each point follow those to an emitter, to all
/// emitters along the way on, to a direction of the map, and to the map along the way on; then the path goes on.
pub(super) const OF_CAMERA: u32 = 0;
pub(super) const TO_EMITTER: u32 = 1;
pub(super) const TO_EMITTERS_ALONG: u32 = 2;
pub(super) const TO_MAP: u32 = 3;
pub(super) const TO_MAP_ALONG: u32 = 4;
pub(super) const ONWARDS: u32 = 5;
pub(super) const ENDED: u32 = 6;

/// What a path brings back.
#[apply(zeroed!)]
pub(super) struct PathLight {
    /// The surface that its first ray sees, and the light.
    pub seen: Seen,
    /// The object that is seen, or [`NONE`].
    pub object: u32,
    pub rays: u32,
    /// How often it looked for its next surface.
    pub looked: u32,
    /// Points of surfaces that it came to.
    pub points: u32,
}

/// A surface point that a path starts from in place of the camera.
#[apply(zeroed!)]
pub(super) struct Start {
    pub at: Beside,
    pub bounce: u32,
    /// Normals about which directions are drawn, if it is paired ([`Shading`](crate::model::bsdf::Shading)).
    pub pair: Pair,
    pub paired: bool,
    pub mirrored: bool,
    /// Whether what it emits counts.
    pub emits: bool,
}

/// A path on its way.
#[apply(zeroed!)]
pub(super) struct Walk {
    /// What its ray is for, and the ray; there is none if its limit is not positive.
    pub purpose: u32,
    pub origin: V3,
    pub direction: V3,
    pub limit: f32,
    /// What a ray to a light brings if nothing is in between.
    pub light: V3,
    /// Light of the map along the way on, if the ray on tells whether it is seen.
    pub waits: bool,
    pub waiting: V3,
    pub bounce: u32,
    pub throughput: V3,
    /// The point that it came to, the way on from there, and random numbers for the cones of shadow rays.
    pub point: Point,
    pub scatter: Scatter,
    pub cone: ConeKernel,
    /// The probability of directional lights among many emitters.
    pub share: f32,
    /// Random numbers for the emitter that the point is connected to, and for that of the next point.
    pub emitter: V2,
    pub next_emitter: V2,
    /// Where the list of emitters along the way on goes on.
    pub next: u32,
    /// What was seen from the point, and the bit of the next emitter along the way on.
    pub bits: u32,
    pub bit: u32,
}

#[cube]
impl Walk {
    /// Whether its ray leads to a point.
    pub fn arrives(&self) -> bool {
        self.purpose == OF_CAMERA || self.purpose == ONWARDS
    }

    /// Whether its ray can see the environment alone.
    pub fn is_last(&self, scene: &Scene) -> bool {
        self.purpose == ONWARDS && self.bounce >= scene.bounces
    }

    /// Whether the path goes on from its point for sure, in the very direction that was drawn.
    pub fn goes_straight_on(&self, scene: &Scene) -> bool {
        let mut goes_on = self.bounce < scene.bounces && !self.scatter.weight.is_zero();
        if comptime!(scene.features.roulette) {
            goes_on = goes_on && self.bounce < scene.roulette_after;
        }
        goes_on && comptime!(!scene.features.cones)
    }

    /// Whether directions that the point scatters are looked along for lights.
    pub fn looks_along(&self, scene: &Scene) -> bool {
        comptime!(scene.features.combined) && self.point.shading.glossy
    }
}
