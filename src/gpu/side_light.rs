//! The light beside an edge's point, on both of its sides: paths that start from the faces there, or from the
//! surface behind.

use crate::cube::*;

use super::camera::Beginning;
use super::edge_point::{EdgePoint, shift_of};
use super::hit::Hit;
use super::layout::{NONE, OF_TRIANGLE, OF_TRIANGLES, SURFACE_STRIDE, SURFACES};
use super::light::sky;
use super::path::{Start, path_light};
use super::reading::Scene;
use super::records::Room;
use super::surface::point_at;
use crate::model::jumps::{Sides, half_beside, inside};
use crate::model::{Pair, V3, splat};

/// What is seen beside an edge's point from a ray's origin: faces on its sides, or [`NONE`], and the hit behind.
#[apply(record!)]
pub(super) struct Behind {
    pub hit: Hit,
    pub start: V3,
    /// The direction to the edge's point.
    pub view: V3,
    pub sides: Sides,
}

/// The light on the − side of an edge less that on the + side.
#[apply(record!)]
pub(super) struct SideLight {
    pub radiance: V3,
    /// The same of the environment, where it is 1.
    pub sky: f32,
    /// The same of the distance of the surface that is seen and of its normal.
    pub depth: f32,
    pub normal: V3,
}

/// The point that is seen on a side. The line of a crossing divides the face: of its halves the one on that side is seen.
#[cube]
fn start_beside(scene: &Scene, p: &EdgePoint, behind: &Behind, on_plus: bool, time: f32) -> Start {
    let mut face = behind.sides.minus;
    if on_plus {
        face = behind.sides.plus;
    }
    let hit = behind.hit;
    let mut start = Start {
        triangle: hit.triangle,
        near: behind.start + behind.sides.past * hit.t,
        direction: behind.sides.past,
        distance: hit.t,
        bounce: 0u32,
        pair: Pair {
            first: behind.sides.past,
            second: behind.sides.past,
        },
        paired: false,
        emits: false,
    };
    if face != NONE {
        let at = scene.header[SURFACES] + SURFACE_STRIDE as u32 * face;
        let mut across = behind.sides.across;
        if !on_plus {
            across = -across;
        }
        let mut inward = half_beside(scene.vector(at + 9), p.along, across);
        if !p.crossing {
            let sum = scene.vector(at) + scene.vector(at + 3) + scene.vector(at + 6);
            let shift = shift_of(scene, face, time);
            inward = sum * (1.0f32 / 3.0f32) + shift - p.position;
        }
        start.triangle = face;
        start.near = inside(p.position, inward);
        start.direction = behind.view;
        start.distance = p.to.length();
    }
    start
}

/// The normals on both sides, if these are of one material: paths on both sides of a crease go the same ways.
#[cube]
fn normals_beside(scene: &Scene, p: &EdgePoint, behind: &Behind, time: f32) -> Pair {
    let mut pair = Pair {
        first: splat(0.0f32.runtime()),
        second: splat(0.0f32.runtime()),
    };
    let mut side = 0u32;
    while side < 2 {
        let on_plus = side == 1;
        let s = start_beside(scene, p, behind, on_plus, time);
        let point = point_at(scene, s.triangle, s.near, s.direction, time);
        if on_plus {
            pair.second = point.shading.normal;
        } else {
            pair.first = point.shading.normal;
        }
        side += 1;
    }
    pair
}

#[cube]
fn material_of(scene: &Scene, triangle: u32) -> u32 {
    scene.words[(scene.header[OF_TRIANGLES] + OF_TRIANGLE as u32 * triangle) as usize]
}

/// The light that arrives beside an edge's point, of paths that begin there at a bounce, if they go on; with `film`
/// what the camera sees of it.
#[cube]
pub(super) fn light_beside(
    scene: &Scene,
    stack: &mut [u32],
    beginning: Beginning,
    bounce: u32,
    goes_on: bool,
    p: &EdgePoint,
    behind: &Behind,
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
        first: behind.view,
        second: behind.view,
    };
    let mut paired = false;
    if goes_on && behind.sides.minus != NONE && behind.sides.plus != NONE {
        if material_of(scene, behind.sides.minus) == material_of(scene, behind.sides.plus) {
            pair = normals_beside(scene, p, behind, time);
            paired = true;
        }
    }
    let mut sign = 1.0f32;
    while sign > -2.0f32 {
        let on_plus = sign < 0.0;
        let mut start = start_beside(scene, p, behind, on_plus, time);
        if start.triangle == NONE {
            light.sky += sign;
            if comptime!(film || scene.features.sees_sky) {
                light.radiance += sky(scene, behind.view) * sign;
            }
        } else if goes_on {
            start.bounce = bounce;
            start.pair = pair;
            start.paired = paired;
            start.emits = film.runtime();
            // Nothing is kept.
            let mut records = Array::<u32>::new(1usize);
            let none = records.as_mut_slice();
            let room = Room {
                thread: 0u32,
                threads: 1u32,
            };
            let seen = path_light(scene, stack, none, room, beginning, start, true, false);
            light.radiance += seen.radiance * sign;
            light.depth += seen.depth * sign;
            light.normal += seen.normal * sign;
        }
        sign -= 2.0f32;
    }
    light
}
