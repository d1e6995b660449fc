//! What is seen right beside a point of an edge, on both sides.

use crate::cube::*;

use super::edge_points::EdgePoint;
use super::scene::{NONE, Scene};
use crate::model::V3;
use crate::model::edge::TOUCHING;
use crate::model::jumps::{Sides, half_beside, inside};

/// The light on the − side of an edge less that on the + side.
#[apply(zeroed!)]
pub(crate) struct SideLight {
    pub radiance: V3,
    /// The same of the environment, where it is 1.
    pub sky: f32,
    /// The same of the distance of the surface that is seen and of its normal.
    pub depth: f32,
    pub normal: V3,
}

impl SideLight {
    pub const NONE: Self = Self {
        radiance: V3::ZERO,
        sky: 0.0,
        depth: 0.0,
        normal: V3::ZERO,
    };
}

/// Whether what a ray hit at a distance hides an edge's point, and does not touch it.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn hides(scene: &Scene, triangle: u32, distance: f32, p: &EdgePoint, time: f32) -> bool {
    let mut hidden = false;
    if triangle != NONE && distance < p.to.length() {
        let at_rest = p.position - scene.shift(triangle, time);
        let off = scene.triangle(triangle).above(at_rest);
        hidden = off.abs() > TOUCHING * (0.1 + p.position.abs().max_element());
    }
    hidden
}

/// A surface point beside an edge, by a place about there, seen along a direction from a distance; or the environment.
#[apply(record!)]
pub(crate) struct Beside {
    /// [`NONE`] where the environment is seen.
    pub triangle: u32,
    pub near: V3,
    pub direction: V3,
    pub distance: f32,
}

/// What is seen beside an edge's point from a ray's origin, if a ray past the edge hits a triangle at a distance, or
/// [`NONE`]. The line of a crossing divides the face: of its halves the one on that side is seen.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn beside(
    scene: &Scene,
    p: &EdgePoint,
    sides: &Sides,
    origin: V3,
    behind: &Behind,
    on_plus: bool,
    time: f32,
) -> Beside {
    let mut face = sides.minus;
    let mut across = -sides.across;
    if on_plus {
        face = sides.plus;
        across = sides.across;
    }
    let mut found = Beside {
        triangle: behind.triangle,
        near: origin + sides.past * behind.distance,
        direction: sides.past,
        distance: behind.distance,
    };
    if face != NONE {
        let on = scene.triangle(face);
        let mut inward = half_beside(on.normal, p.along, across);
        if !p.crossing {
            let middle = (on.a + on.b + on.c) * (1.0f32 / 3.0f32);
            inward = middle + scene.shift(face, time) - p.position;
        }
        found.triangle = face;
        found.near = inside(p.position, inward);
        found.direction = p.to.normalize();
        found.distance = p.to.length();
    }
    found
}

/// What a ray past an edge hits: a triangle or [`NONE`], and its distance.
#[apply(record!)]
pub(crate) struct Behind {
    pub triangle: u32,
    pub distance: f32,
}

/// Whether the faces on both sides are of one material: then paths there go the same ways.
#[cfg_attr(feature = "wgpu", cube)]
#[inline(always)]
pub(crate) fn is_crease(scene: &Scene, sides: &Sides) -> bool {
    let mut crease = false;
    if sides.minus != NONE && sides.plus != NONE {
        crease = scene.material_of(sides.minus) == scene.material_of(sides.plus);
    }
    crease
}
