//! Boundary terms of the light that arrives at a point of a path: the jump at an edge seen from there, the rays
//! traced for it, and its derivatives.

use crate::cube::*;

use super::edge_points::{EdgePoint, OF_EDGE, add_to_edge, sides};
use super::edge_search::{Observer, Search};
use super::edge_sides::{Approach, LightBeside};
use super::following::Origin;
use super::lights::{emission_at, emitters_of, of_corners, radiance_of, target_of};
use super::scene::{CONE, NONE, Scene};
use super::sums::{Sums, add_to_light};
use super::surface::PointGradient;
use super::texture::sky;
use crate::model::cone::{Bend, bend, cone_density, lifted, up_to_plane};
use crate::model::edge::{DirectionJump, direction_jump, mirrored};
use crate::model::jumps::Sides;
use crate::model::numbers::is_nonzero;
use crate::model::{V3, select_vector, splat, v2};
use crate::sampling::{EmitterHit, no_emitter_hit};

/// A point of an edge as seen from a point of a path.
#[apply(record!)]
pub struct EdgeView {
    pub point: EdgePoint,
    /// The direction to it, and the axis about which rays are bent there.
    pub view: V3,
    pub axis: V3,
    around: Bend,
    /// The normal on the side on which rays leave, and the start of rays.
    outer: V3,
    pub start: V3,
    /// The derivative of the loss with respect to the arriving light.
    pub carried: V3,
    /// The occluded light: a range of emitters. For a delta light: rays that reach the edge directly, and mirrored.
    pub first: u32,
    pub past: u32,
}

/// Returns the view of an edge's point for a search.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn edge_view(scene: &Scene, o: &Observer, s: &Search, p: EdgePoint) -> EdgeView {
    let shading = o.point.shading;
    let view = p.to.normalize();
    let mut outer = shading.outer(view);
    let around = bend(view, outer, scene.settings[CONE], s.cone_u, s.cone_v);
    let mut axis = around.direction;
    let mut first = s.first;
    let mut past = s.past;
    if s.is_light {
        axis = s.query.axis;
        outer = shading.outer(axis);
        first = 0u32;
        past = 2u32;
    }
    let mut reflected = splat(0.0);
    if p.per_density > 0.0 {
        reflected = shading.evaluate(axis);
        if !s.of_light && shading.glossy {
            reflected = reflected * shading.share_of_lobe(axis, s.of_gloss);
            reflected = select_vector(s.lobe.holds(axis), reflected, splat(0.0));
        }
    }
    // Other searches draw the edges that move.
    let others = s.of_resting && scene.edge_moves(p.edge / OF_EDGE as u32);
    past = select(reflected.is_zero() || others, first, past);
    EdgeView {
        point: p,
        view,
        axis,
        around,
        outer,
        start: lifted(o.point.position, outer),
        carried: o.carried.times(reflected) * (s.scale * p.per_density),
        first,
        past,
    }
}

impl EdgeView {
    /// Returns this view for a channel of the sums.
    #[inline(always)]
    pub fn of_channel(&self, sums: &Sums, channel: usize) -> Self {
        self.with_carried(sums.radiance_of(self.carried, channel))
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl EdgeView {
    /// Returns this view for another derivative of the loss with respect to the arriving light.
    #[inline(always)]
    pub fn with_carried(self, carried: V3) -> EdgeView {
        let mut view = self;
        view.carried = carried;
        view
    }

    /// Returns the ray to the edge's point, and the faces beside it.
    #[inline(always)]
    pub fn approach(&self, o: &Observer, s: &Search, sides: Sides) -> Approach {
        Approach {
            point: self.point,
            origin: self.start,
            view: self.view,
            sides,
            follows: s.follows,
            from: Origin {
                on_film: false.runtime(),
                evenly: o.point.shading.scatters_evenly(),
            },
        }
    }

    /// Returns the point of an emitter that the axis hits behind the edge's point.
    #[inline(always)]
    fn light_behind(&self, scene: &Scene, s: &Search, hit: &EmitterHit, past: V3) -> LightBehind {
        let k = hit.emitter;
        let mut found = LightBehind::default();
        found.triangle = scene.emitters[k as usize];
        found.distance = hit.distance;
        found.weights = of_corners(hit.weights);
        let normal = emitters_of(scene).triangle(k, s.query.time).normal;
        let place = s.query.x + self.axis * hit.distance;
        found.limit = up_to_plane(self.start, past, normal, place);
        let dark = self.point.faces.contains(found.triangle);
        let near = self.point.to.length() >= found.limit;
        if dark || near || scene.is_open(found.triangle, found.weights) {
            found.limit = -1.0f32;
        }
        let cosine = -normal.dot(self.axis);
        found.emission = emission_at(scene, found.triangle, found.weights, cosine);
        found
    }

    /// Returns a delta light behind the edge's point that is reached by rays bent about the direction to the point.
    /// Its direction is fixed, so the integral over directions reduces to the density of the cone about the edge's
    /// direction, evaluated at the light's direction.
    #[inline(always)]
    fn delta_behind(&self, scene: &Scene, s: &Search, bent: &Bend, past: V3) -> LightBehind {
        let to = self.point.to;
        let target = target_of(scene, s.first, v2(0.0, 0.0), s.query.x, s.query.time, false);
        let mut image = to;
        if bent.mirrored {
            image = mirrored(to, self.outer);
        }
        let density = cone_density(bent.direction, image, scene.settings[CONE]);
        let mut found = LightBehind::default();
        let radiance = radiance_of(scene, s.first, v2(0.0, 0.0), target.facing());
        found.emission = radiance * (target.angle * density);
        found.limit = target.limit(self.start, past);
        if found.emission.is_zero() || to.dot(self.outer) <= 0.0 || to.length() >= found.limit {
            found.limit = -1.0f32;
        }
        found
    }

    /// Adds the derivatives with respect to the edge's point and the point that sees it. Returns the largest component
    /// of the derivative with respect to the edge's point.
    #[inline(always)]
    fn backward(
        &self,
        scene: &Scene,
        sums: &Sums,
        o: &Observer,
        jump: &Jump,
        scale: f32,
        time: f32,
        by: &mut PointGradient,
    ) -> f32 {
        let mut largest = 0.0f32;
        if is_nonzero(scale) {
            let normal = o.point.shading.geometric;
            let p = self.point;
            let by_to = jump.motion.by_point(p.to, normal, scale, &mut by.geometric);
            by.position -= by_to;
            add_to_edge(scene, sums, &p, by_to, time);
            largest = by_to.abs().max_element();
        }
        largest
    }
}

/// A light that lies along an axis behind an edge's point.
#[apply(zeroed!)]
pub struct LightBehind {
    /// The limit of a ray to it past the edge; negative if there is no light.
    limit: f32,
    distance: f32,
    weights: V3,
    emission: V3,
    triangle: u32,
}

/// A jump at an edge, and the ray that determines what is behind the edge: it starts at the view's start along
/// `sides.past`.
#[apply(record!)]
pub struct Jump {
    motion: DirectionJump,
    pub sides: Sides,
    /// Length of the ray; not positive if there is no jump.
    pub limit: f32,
    /// 1 if light passes on the − side, otherwise −1.
    sign: f32,
    light: LightBehind,
}

/// Returns the jump of the light of the k-th emitter, or of reflected light.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn jump_at(scene: &Scene, o: &Observer, s: &Search, e: &EdgeView, k: u32) -> Jump {
    let p = e.point;
    let time = s.query.time;
    let mut bent = e.around;
    let mut normal = o.point.shading.geometric;
    let mut there = true;
    let mut hit: EmitterHit = no_emitter_hit();
    if s.is_light {
        normal = e.outer;
        bent.offset = splat(0.0);
        bent.mirrored = k == 1;
        bent.direction = e.axis;
    } else if s.of_light {
        if comptime!(scene.features.emitters) {
            hit = emitters_of(scene).hit(k, s.query.x, e.axis, time);
            there = hit.emitter != NONE;
        }
    }
    let motion = direction_jump(p.to, p.along, &bent, normal);
    let mut light = LightBehind::default();
    // For reflected light the ray has no end.
    light.limit = f32::MAX;
    let mut jump = Jump {
        motion,
        sides: Sides::new(p.along, e.view, motion.side),
        limit: (-1.0f32).runtime(),
        sign: 1.0f32.runtime(),
        light,
    };
    if there {
        jump.sides = sides(scene, &p, e.view, motion.side, time);
        let on_minus = jump.sides.minus != NONE;
        let on_plus = jump.sides.plus != NONE;
        jump.sign = select(on_minus, -1.0f32, jump.sign);
        if comptime!(scene.features.emitters) {
            if s.is_light {
                if comptime!(scene.features.of_emitters.lights) {
                    jump.light = e.delta_behind(scene, s, &bent, jump.sides.past);
                }
            } else if s.of_light {
                jump.light = e.light_behind(scene, s, &hit, jump.sides.past);
            }
        }
        jump.limit = jump.light.limit;
        // Light passes on one side or none; at the end of a path only the environment is visible.
        let dark = s.of_light || o.bounce >= scene.bounces;
        jump.limit = select(
            (dark && on_minus && on_plus) || (s.of_light && !on_minus && !on_plus),
            -1.0f32,
            jump.limit,
        );
    }
    jump
}

/// Adds the derivatives due to the jump of an emitter's light, after the ray found no occluder. Returns the largest
/// length of the derivative with respect to the edge's point.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn shadow_backward(
    scene: &Scene,
    sums: &Sums,
    o: &Observer,
    s: &Search,
    e: &EdgeView,
    jump: &Jump,
    time: f32,
    by: &mut PointGradient,
) -> f32 {
    let light = jump.light;
    let scale = e.carried.dot(light.emission) * jump.sign;
    let by_axis = jump.motion.edge.by_axis * scale;
    if s.is_light {
        if comptime!(scene.features.of_emitters.lights) {
            let delta = emitters_of(scene).light(s.first);
            let seen = delta.seen_from(o.point.position);
            let found = delta.backward(&seen, 0.0f32, by_axis);
            by.position -= found.position;
            add_to_light(scene, sums, s.first, &found, splat(0.0));
        }
    } else {
        // The axis points to a point of the light, which is fixed on it.
        let by_to = by_axis.reject_from_normalized(e.axis) * (1.0 / light.distance);
        by.position -= by_to;
        if scene.is_wanted(scene.object_of(light.triangle)) {
            scene.add_to_corners(sums, light.triangle, light.weights, by_to, time);
        }
    }
    e.backward(scene, sums, o, jump, scale, time, by)
}

/// Adds the derivatives due to the jump of reflected light or of the environment's light. Returns the largest component
/// of the derivative with respect to the edge's point.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn reflected_backward(
    scene: &Scene,
    sums: &Sums,
    o: &Observer,
    s: &Search,
    e: &EdgeView,
    jump: &Jump,
    light: &LightBeside,
    time: f32,
    by: &mut PointGradient,
) -> f32 {
    let shading = o.point.shading;
    let mut scale = e.carried.dot(light.jump.radiance);
    let mut turns = e.carried.dot(light.turns);
    if comptime!(scene.features.gathers_map) && light.jump.opacity != 0.0 {
        let of_map = e.carried.dot(sky(scene, e.axis)) * light.jump.opacity;
        scale -= of_map;
        if comptime!(scene.features.turns_to_map) {
            // Other directions to a map are fixed.
            turns -= select(scene.turns_to_map(&shading), of_map, 0.0);
        }
    }
    let by_axis = jump.motion.edge.by_axis;
    if comptime!(scene.features.glossy) && s.follows {
        // Directions on a side follow its material in part.
        let mut side = 0u32;
        while side < 2 {
            let mut on = light.minus;
            if side == 1 {
                on = light.plus;
            }
            let follows = e.carried.dot(on.light.radiance);
            if is_nonzero(follows) {
                let by_point = by_axis.reject_from_normalized(e.axis) * (follows / on.distance);
                by.position -= by_point;
                scene.add_to_point(sums, on.triangle, on.near, by_point, time);
            }
            side += 1;
        }
    }
    if is_nonzero(turns) {
        // Directions turn with the frame of the lobe.
        let drawn = shading.as_drawn(e.axis, s.of_gloss);
        let part = scene.turning(&shading, e.axis, s.of_gloss).part;
        shading.direction_backward(&drawn, by_axis * (turns * part), &mut by.shading);
    }
    e.backward(scene, sums, o, jump, scale, time, by)
}
