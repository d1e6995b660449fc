//! The surfaces seen directly beside a point of an edge, on both sides.

use crate::cube::*;

use super::edge_points::EdgePoint;
use super::following::{Left, Origin};
use super::pixel::Seen;
use super::scene::{NONE, Scene};
use crate::accel::Hit;
use crate::model::edge::TOUCHING;
use crate::model::jumps::{Sides, half_beside, inside};
use crate::model::{V3, select_vector};

/// A ray to an edge's point, and the faces seen beside it.
#[apply(record!)]
pub struct Approach {
    pub point: EdgePoint,
    pub origin: V3,
    pub view: V3,
    pub sides: Sides,
    /// Whether the ray follows the material in part.
    pub follows: bool,
    pub from: Origin,
}

/// The light on both sides of an edge.
#[apply(zeroed!)]
pub struct LightBeside {
    /// The light on the − side minus the light on the + side, without that part of which the material moves with the edge.
    pub jump: Seen,
    /// The difference of the parts of the light whose rays do not follow material.
    pub turns: V3,
    pub minus: Followed,
    pub plus: Followed,
}

/// The light on one side of an edge that belongs to rays which follow other material than that of the edge. The light of
/// the + side is negative.
#[apply(zeroed!)]
pub struct Followed {
    pub light: Seen,
    pub triangle: u32,
    pub near: V3,
    pub distance: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl LightBeside {
    /// Adds the light of a side, times a factor.
    #[inline(always)]
    pub fn add(
        &mut self,
        scene: &Scene,
        a: &Approach,
        at: &Beside,
        on_plus: bool,
        light: &Seen,
        factor: f32,
        time: f32,
    ) {
        let sign = select(on_plus, -factor, factor);
        self.jump.add(light, sign);
        self.turns += light.radiance * sign;
        let follows = a.follows && at.triangle != NONE;
        if comptime!(scene.features.glossy) && follows {
            let t = scene.triangle(at.triangle);
            let weights = t.weights(at.near - scene.shift(at.triangle, time));
            let direction = at.direction;
            let normal = select_vector(t.normal.dot(direction) < 0.0, t.normal, -t.normal);
            let (triangle, distance) = (at.triangle, at.distance);
            let left: Left = scene.left_at(triangle, weights, normal, distance, direction, a.from);
            let share = (1.0 - left.part) * sign;
            self.turns -= light.radiance * share;
            let mut followed = Seen::default();
            let expected = scene.expected(scene.material_of(at.triangle));
            followed.radiance = (light.radiance - expected) * share;
            if a.from.on_film {
                followed.opacity = light.opacity * share;
                followed.depth = light.depth * share;
                followed.normal = light.normal * share;
            }
            let p = a.point;
            if p.faces.contains(at.triangle) && !p.crossing {
                self.jump.add(&followed, -1.0);
            } else {
                let mut before = self.minus.light;
                if on_plus {
                    before = self.plus.light;
                }
                followed.add(&before, 1.0);
                let side = Followed {
                    light: followed,
                    triangle: at.triangle,
                    near: at.near,
                    distance: at.distance,
                };
                if on_plus {
                    self.plus = side;
                } else {
                    self.minus = side;
                }
            }
        }
    }
}

/// Returns whether the triangle that a ray hit occludes an edge's point and does not touch it.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn hides(scene: &Scene, hit: &Hit, p: &EdgePoint, time: f32) -> bool {
    let mut hidden = false;
    if hit.triangle != NONE && hit.t < p.to.length() {
        let at_rest = p.position - scene.shift(hit.triangle, time);
        let off = scene.triangle(hit.triangle).above(at_rest);
        hidden = off.abs() > TOUCHING * (0.1 + p.position.abs().max_element());
    }
    hidden
}

/// A surface point beside an edge, given by a nearby position, seen along a direction from a distance; or the
/// environment.
#[apply(zeroed!)]
pub struct Beside {
    /// [`NONE`] if the environment is seen.
    pub triangle: u32,
    pub near: V3,
    pub direction: V3,
    pub distance: f32,
}

/// Returns the surface seen on one side of an edge's point; `behind` is the hit of a ray past the edge. The line of a
/// crossing divides a face, of which the half on that side is seen.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn beside(scene: &Scene, a: &Approach, behind: &Hit, on_plus: bool, time: f32) -> Beside {
    let p = a.point;
    let sides = a.sides;
    let face = select(on_plus, sides.plus, sides.minus);
    let across = select_vector(on_plus, sides.across, -sides.across);
    let mut found = Beside {
        triangle: behind.triangle,
        near: a.origin + sides.past * behind.t,
        direction: sides.past,
        distance: behind.t,
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

/// Returns whether there are faces of one material on both sides, so that paths on both sides can go the same ways.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn is_crease(scene: &Scene, sides: &Sides) -> bool {
    let mut crease = false;
    if sides.minus != NONE && sides.plus != NONE {
        crease = scene.material_of(sides.minus) == scene.material_of(sides.plus);
    }
    crease
}
