//! The light beside an edge's point, on both of its sides: paths that start from the faces there, or from the
//! surface behind.

use crate::cube::*;

use super::camera::Beginning;
use super::path::path_light;
use super::places::Start;
use super::records::Room;
use crate::model::jumps::Sides;
use crate::model::{Pair, V3, splat};
use crate::trace::{Behind, EdgePoint, NONE, Scene, SideLight, beside, is_crease, point_at, sky};

/// A ray that comes to an edge's point, and what is seen beside that.
#[apply(record!)]
pub(super) struct Approach {
    pub point: EdgePoint,
    pub origin: V3,
    pub view: V3,
    pub sides: Sides,
    pub behind: Behind,
}

/// The normals on both sides.
#[cube]
fn normals_beside(scene: &Scene, a: &Approach, time: f32) -> Pair {
    let mut pair = Pair {
        first: splat(0.0f32.runtime()),
        second: splat(0.0f32.runtime()),
    };
    let mut side = 0u32;
    while side < 2 {
        let on_plus = side == 1;
        let at = beside(
            scene, &a.point, &a.sides, a.origin, &a.behind, on_plus, time,
        );
        let point = point_at(scene, at.triangle, at.near, at.distance, at.direction, time);
        if on_plus {
            pair.second = point.shading.normal;
        } else {
            pair.first = point.shading.normal;
        }
        side += 1;
    }
    pair
}

/// The light that arrives beside an edge's point, of paths that begin there at a bounce, if they go on; with `film`
/// what the camera sees of it. `choice` is room for the choice of an emitter.
#[cube]
pub(super) fn light_beside(
    scene: &Scene,
    stack: &mut [u32],
    choice: &mut [u32],
    beginning: Beginning,
    bounce: u32,
    goes_on: bool,
    a: &Approach,
    #[comptime] film: bool,
) -> SideLight {
    let time = beginning.time;
    let mut light = SideLight {
        radiance: splat(0.0),
        sky: 0.0f32,
        depth: 0.0f32,
        normal: splat(0.0),
    };
    let mut pair = Pair {
        first: a.view,
        second: a.view,
    };
    let paired = goes_on && is_crease(scene, &a.sides);
    if paired {
        pair = normals_beside(scene, a, time);
    }
    let mut sign = 1.0f32;
    while sign > -2.0f32 {
        let at = beside(
            scene,
            &a.point,
            &a.sides,
            a.origin,
            &a.behind,
            sign < 0.0,
            time,
        );
        if at.triangle == NONE {
            light.sky += sign;
            if comptime!(film || scene.features.sees_sky) {
                light.radiance += sky(scene, a.view) * sign;
            }
        } else if goes_on {
            let start = Start {
                triangle: at.triangle,
                near: at.near,
                direction: at.direction,
                distance: at.distance,
                bounce,
                pair,
                paired,
                emits: film.runtime(),
            };
            // Nothing is kept.
            let mut records = Array::<u32>::new(1usize);
            let none = records.as_mut_slice();
            let room = Room {
                thread: 0u32,
                threads: 1u32,
            };
            let seen = path_light(
                scene, stack, choice, none, room, beginning, start, true, false,
            );
            light.radiance += seen.radiance * sign;
            light.depth += seen.depth * sign;
            light.normal += seen.normal * sign;
        }
        sign -= 2.0f32;
    }
    light
}
