//! Jumps of the light that arrives at a point of a path: `kernel/boundary` in a kernel of a GPU.
//!
//! Calls are inlined in a kernel, so shadows of emitters and reflected light take turns in one loop.

use crate::cube::*;

use super::camera::{Beginning, sampler};
use super::edge_layout::{COUNT, EDGE_TREES, OF_TREE, SEED_OF_EDGES, SEED_OF_SIDES};
use super::edge_point::{EdgePoint, add_to_edge, edge_point, shift_of, sides};
use super::edge_search::{Observer, search};
use super::finite::is_nonzero;
use super::hit::{Hit, Ray, trace};
use super::holes::is_open;
use super::layout::{BOUNCES, CONE, NONE, SURFACE_STRIDE, SURFACES};
use super::light::{EmitterHit, delta_light, emitter, hits_emitter, sky};
use super::light_backward::add_to_light;
use super::reading::Scene;
use super::shadow_rays::target_of;
use super::side_light::{Behind, light_beside};
use super::sums::Totals;
use super::surface::emission_at;
use super::surface_backward::{PointGradient, add_to_corners, is_wanted};
use crate::model::cone::{Bend, bend, cone_density, lifted, up_to_plane};
use crate::model::edge::TOUCHING;
use crate::model::edge::{direction_jump, mirrored};
use crate::model::jumps::Sides;
use crate::model::{V3, splat, v2, v3};
use crate::sampling::Dimensions;

/// An emitter that lies along an axis behind an edge's point.
#[apply(record!)]
struct LightBehind {
    /// The limit of a ray to it that passes the edge; less than 0 if there is none.
    limit: f32,
    distance: f32,
    weights: V3,
    emission: V3,
    triangle: u32,
    object: u32,
}

/// Where no light is looked for: a ray has no end.
#[cube]
fn no_light() -> LightBehind {
    LightBehind {
        limit: f32::MAX.runtime(),
        distance: 1.0f32,
        weights: splat(0.0),
        emission: splat(0.0),
        triangle: 0u32,
        object: 0u32,
    }
}

#[cube]
fn light_behind(
    scene: &Scene,
    k: u32,
    p: &EdgePoint,
    past: V3,
    x: V3,
    start: V3,
    axis: V3,
    time: f32,
) -> LightBehind {
    let mut found = no_light();
    found.limit = -1.0f32;
    let hit: EmitterHit = hits_emitter(scene, k, x, axis, time);
    if hit.emitter != NONE {
        let e = emitter(scene, k, time);
        let w = v3(
            1.0 - hit.weights.x - hit.weights.y,
            hit.weights.x,
            hit.weights.y,
        );
        let mut dark = p.faces.contains(e.triangle);
        if comptime!(scene.features.holes) {
            if is_open(scene, e.triangle, w) {
                dark = true;
            }
        }
        let limit = up_to_plane(start, past, e.normal, x + axis * hit.distance);
        if !dark && p.to.length() < limit {
            found.limit = limit;
        }
        found.distance = hit.distance;
        found.weights = w;
        found.emission = emission_at(scene, e.triangle, e.material, w);
        found.triangle = e.triangle;
        found.object = e.object;
    }
    found
}

/// A light without extent behind an edge's point that rays bent about the direction to it come to. That direction is
/// where it is, so that what is left of the integral over those of an emitter is the density with which it would be
/// drawn about the edge's (`kernel/boundary/delta`).
#[cube]
fn delta_behind(
    scene: &Scene,
    k: u32,
    p: &EdgePoint,
    bent: &Bend,
    outer: V3,
    past: V3,
    x: V3,
    start: V3,
    time: f32,
) -> LightBehind {
    let target = target_of(scene, k, v2(0.0, 0.0), x, time, false);
    let mut image = p.to;
    if bent.mirrored {
        image = mirrored(p.to, outer);
    }
    let density = cone_density(bent.direction, image, scene.settings[CONE]);
    let mut found = no_light();
    found.emission = target.radiance * (target.angle * density);
    found.limit = target.limit(start, past);
    if found.emission.is_zero() || p.to.dot(outer) <= 0.0 || p.to.length() >= found.limit {
        found.limit = -1.0f32;
    }
    found
}

/// Whether what a ray hit hides an edge's point, and does not touch it.
#[cube]
pub(super) fn hides(scene: &Scene, hit: Hit, p: &EdgePoint, time: f32) -> bool {
    let mut hidden = false;
    if hit.triangle != NONE && hit.t < p.to.length() {
        let at = scene.header[SURFACES] + SURFACE_STRIDE as u32 * hit.triangle;
        let at_rest = p.position - shift_of(scene, hit.triangle, time);
        let off = scene.vector(at + 9).dot(at_rest) - scene.floats[at as usize + 12];
        hidden = off.abs() > TOUCHING * (0.1 + p.position.abs().max_element());
    }
    hidden
}

/// Adds the derivatives by jumps at edges seen from a point of a path.
#[cube]
pub(super) fn jumps_seen_from(
    scene: &Scene,
    stack: &mut [u32],
    edge_room: &mut [u32],
    sums: &Totals,
    path: &Beginning,
    o: &Observer,
    by: &mut PointGradient,
) {
    let edges = sampler(scene, SEED_OF_EDGES);
    let numbers = edges.stream(path.numbers.pixel, path.numbers.sample);
    let time = path.time;
    let x = o.point.position;
    let shading = o.point.shading;
    let geometric = shading.geometric;
    let last = o.bounce >= scene.header[BOUNCES];
    let mut turn = 1u32;
    if comptime!(scene.features.emitters) {
        turn = 0u32;
    }
    while turn < 2 {
        let of_light = turn == 0;
        turn += 1;
        let s = search(scene, &numbers, o, of_light, time, sums.of);
        let mut tree = EDGE_TREES.runtime();
        if !s.moves {
            tree = EDGE_TREES + OF_TREE;
        }
        if s.asked && scene.header[tree + COUNT] > 0 {
            let p = edge_point(
                scene, edge_room, tree, &s.query, &shading, s.u, s.v, sums.of,
            );
            let view = p.to.normalize();
            let mut outer = shading.outer(view);
            let around = bend(view, outer, scene.settings[CONE], s.cone_u, s.cone_v);
            let mut axis = around.direction;
            let mut k = s.first;
            let mut past = s.past;
            if s.is_light {
                // A ray comes to the edge's point straight, or mirrored at the surface.
                axis = s.query.axis;
                outer = shading.outer(axis);
                k = 0u32;
                past = 2u32;
            }
            let start = lifted(x, outer);
            let mut reflected = splat(0.0);
            if p.per_density > 0.0 {
                reflected = shading.evaluate(axis);
                if !of_light && shading.glossy {
                    reflected = reflected * shading.share_of_lobe(axis, s.of_gloss);
                    if comptime!(scene.features.models.facets()) {
                        if !s.lobe.holds(axis) {
                            reflected = splat(0.0);
                        }
                    }
                }
            }
            if reflected.is_zero() {
                past = k;
            }
            let carried = o.carried.times(reflected) * (s.scale * p.per_density);
            while k < past {
                let mut bent = around;
                let mut normal = geometric;
                if s.is_light {
                    normal = outer;
                    bent.offset = splat(0.0);
                    bent.mirrored = k == 1;
                    bent.direction = axis;
                }
                let jump = direction_jump(p.to, p.along, &bent, normal);
                let beside: Sides = sides(scene, &p, view, jump.side, time);
                let on_minus = beside.minus != NONE;
                let on_plus = beside.plus != NONE;
                let mut sign = 1.0f32;
                if on_minus {
                    sign = -1.0f32;
                }
                let mut light = no_light();
                if comptime!(scene.features.emitters) {
                    if s.is_light {
                        if comptime!(scene.features.lights) {
                            light = delta_behind(
                                scene,
                                s.first,
                                &p,
                                &bent,
                                outer,
                                beside.past,
                                x,
                                start,
                                time,
                            );
                        }
                    } else if of_light {
                        light = light_behind(scene, k, &p, beside.past, x, start, axis, time);
                    }
                }
                // Light passes on one side or on none; at the end of a path only the environment is seen.
                if of_light && ((on_minus && on_plus) || (!on_minus && !on_plus)) {
                    light.limit = -1.0f32;
                }
                if !of_light && last && on_minus && on_plus {
                    light.limit = -1.0f32;
                }
                let mut hit = Hit {
                    t: 0.0f32,
                    triangle: 0u32,
                };
                if light.limit > 0.0 {
                    let ray = Ray {
                        origin: start,
                        direction: beside.past,
                        time,
                        from: 0.0f32,
                        limit: light.limit,
                    };
                    hit = trace(scene, stack, ray, p.faces, of_light, true);
                }
                let mut scale = 0.0f32;
                if of_light {
                    if light.limit > 0.0 && hit.triangle == NONE {
                        scale = carried.dot(light.emission) * sign;
                        let by_axis = jump.edge.by_axis * scale;
                        if s.is_light {
                            if comptime!(scene.features.lights) {
                                let delta = delta_light(scene, s.first);
                                let seen = delta.seen_from(x);
                                let found = delta.backward(&seen, 0.0f32, by_axis);
                                by.position -= found.position;
                                if comptime!(sums.of.lights) {
                                    let none = splat(0.0);
                                    add_to_light(scene, sums, s.first, &found, none);
                                }
                            }
                        } else {
                            // The axis points to a point of the light, which stays where it is on it.
                            let by_to =
                                by_axis.reject_from_normalized(axis) * (1.0 / light.distance);
                            by.position -= by_to;
                            if is_wanted(scene, light.object) {
                                add_to_corners(
                                    scene,
                                    sums,
                                    light.triangle,
                                    light.object,
                                    light.weights,
                                    by_to,
                                    time,
                                );
                            }
                        }
                    }
                } else if light.limit > 0.0 && !hides(scene, hit, &p, time) {
                    let behind = Behind {
                        hit,
                        start,
                        view,
                        sides: beside,
                    };
                    let sides = sampler(scene, SEED_OF_SIDES);
                    let numbers = sides.stream(path.numbers.pixel, path.numbers.sample);
                    let beginning = Beginning {
                        numbers,
                        cones: path.cones,
                        film: numbers.draw(scene.points, Dimensions::direction(o.bounce)),
                        time,
                        ray: path.ray,
                    };
                    let next = o.bounce + 1;
                    let light =
                        light_beside(scene, stack, beginning, next, !last, &p, &behind, false);
                    scale = carried.dot(light.radiance);
                    // Directions turn with the frame of the lobe.
                    let drawn = shading.as_drawn(axis, s.of_gloss);
                    shading.direction_backward(&drawn, jump.edge.by_axis * scale, &mut by.shading);
                    if comptime!(scene.features.gathers_map) {
                        // Directions to a map stay where they are.
                        let radiance = sky(scene, axis);
                        scale += carried.dot(radiance) * light.sky;
                    }
                }
                if is_nonzero(scale) {
                    let by_to = jump.by_point(p.to, geometric, scale, &mut by.geometric);
                    by.position -= by_to;
                    add_to_edge(scene, sums, &p, by_to, time);
                }
                k += 1;
            }
        }
    }
}
