//! Jumps of the light that arrives at a point of a path, and those of the light of emitters: edges of shadows.

use super::edge_point::{EdgePoint, Observer};
use crate::accel::{HitRay, NOTHING};
use crate::kernel::gradient::Sums;
use crate::kernel::surface::PointGradient;
use crate::kernel::view::View;
use crate::kernel::walk::{Path, Vertex, Work};
use crate::model::V3;
use crate::model::cone::up_to_plane;
use crate::model::edge::{DirectionJump, direction_jump};
use crate::model::jumps::{OF_SHADOWS, probability, towards_group};
use crate::sampling::{Dimensions, EmitterHit};

impl View {
    /// Adds the derivatives by jumps at edges seen from a point of a path, times `g`, whose channels add up
    /// to `typical` on average.
    #[allow(clippy::too_many_arguments)] // one place, called once
    pub(in crate::kernel) fn edges_backward(
        &self,
        path: &Path,
        vertex: &Vertex,
        bounce: u32,
        moves: bool,
        (g, typical): (V3, f32),
        work: &mut Work,
        by: &mut PointGradient,
        sums: &mut Sums,
    ) {
        let Some(sets) = &self.edge_sets else {
            return;
        };
        let carried = g * vertex.throughput;
        let counts = carried.abs().element_sum() / typical;
        if counts.is_nan() || counts <= 0.0 {
            return;
        }
        let observer = Observer {
            path,
            vertex,
            bounce,
            moves,
            carried,
            counts,
            numbers: self.edges.numbers(path.numbers.path()),
            sets,
        };
        self.light_edges(&observer, work, by, sums);
        self.reflected_edges(&observer, work, by, sums);
    }
}

/// A point of a shadow's edge, seen along the axis of a shadow ray.
struct ShadowEdge<'a> {
    point: &'a EdgePoint,
    jump: DirectionJump,
    axis: V3,
    /// The direction of a ray that passes the edge.
    past: V3,
    /// The derivative of the loss by the light that arrives, and 1 where it arrives on the − side, else −1.
    carried: V3,
    sign: f32,
}

impl View {
    /// Adds the derivatives by jumps of the light of a group of emitters.
    pub(super) fn light_edges(
        &self,
        o: &Observer,
        work: &mut Work,
        by: &mut PointGradient,
        sums: &mut Sums,
    ) {
        let emitters = &self.scene.emitters;
        if emitters.is_empty() {
            return;
        }
        let drawn = o.numbers.draw(Dimensions::of_set(3 * o.bounce));
        let (choice, u, v, cone_u) = (drawn.x, drawn.y, drawn.z, drawn.w);
        let more = o.numbers.draw(Dimensions::of_set(3 * o.bounce + 1));
        let (cone_v, pick) = (more.x, more.y);
        let rate = probability(OF_SHADOWS, o.counts);
        if pick >= rate {
            return;
        }
        let point = &o.vertex.point;
        let at = point.receiver(o.path.time);
        let (group, chance) = emitters.choose_group(&at, choice, &mut work.chances);
        if let Some(light) = emitters.light_of_group(group) {
            let carried = o.carried * (1.0 / rate) * (1.0 / chance);
            self.delta_edges(o, (light, carried), [u, v], by, sums);
            return;
        }
        let light_moves = emitters.members(group).any(|k| {
            let k = emitters.get(k).triangle as usize;
            self.wanted.objects[self.scene.triangles[k].object as usize]
        });
        let tree = o.sets.seen_by(o.moves || light_moves);
        if tree.is_empty() {
            return;
        }
        let carried = o.carried * (1.0 / rate) * (1.0 / chance);
        let (x, time, seen) = (point.position, o.path.time, &emitters.groups[group]);
        let to = seen.centre + seen.velocity * time - x;
        let query = towards_group(&point.shading, x, time, to, seen.radius, self.cone);
        let Some(p) = self.edge_point(o, &tree, &query, [u, v]) else {
            return;
        };
        let view = p.to.normalize();
        let bend = self.bend(view, point.shading.outer(view), cone_u, cone_v);
        let reflected = point.shading.evaluate(bend.direction);
        if reflected == V3::ZERO {
            return;
        }
        let jump = direction_jump(p.to, p.edge.along, &bend, point.shading.geometric);
        let sides = self.sides(&p, view, jump.side, o.path.time);
        // Light passes on one side or on none.
        let sign = match (sides.minus == NOTHING, sides.plus == NOTHING) {
            (true, false) => 1.0,
            (false, true) => -1.0,
            _ => return,
        };
        let edge = ShadowEdge {
            point: &p,
            jump,
            axis: bend.direction,
            past: sides.past,
            carried: carried * reflected,
            sign,
        };
        emitters.each_hit(emitters.members(group), &at, edge.axis, |hit| {
            self.shadow_edge_backward(o, &edge, hit, by, sums);
        });
    }

    /// Adds the derivatives by the jump of one emitter's light, if nothing else hides it at the edge.
    fn shadow_edge_backward(
        &self,
        o: &Observer,
        edge: &ShadowEdge,
        hit: EmitterHit,
        by: &mut PointGradient,
        sums: &mut Sums,
    ) {
        let (p, axis, time) = (edge.point, edge.axis, o.path.time);
        let e = self.scene.emitters.get(hit.emitter);
        let [b, c] = hit.weights;
        let weights = [1.0 - b - c, b, c];
        if p.edge.faces.contains(&e.triangle) || self.scene.is_open(e.triangle, weights) {
            return;
        }
        let point = &o.vertex.point;
        let start = point.start(axis);
        let light = point.position + axis * hit.distance;
        let limit = up_to_plane(start, edge.past, e.normal, light);
        if p.to.length() >= limit {
            return;
        }
        let ray = HitRay {
            unseen: p.edge.faces,
            ..HitRay::new(start, edge.past, time, limit)
        };
        if self.hit_seen::<true>(&ray).triangle != NOTHING {
            return;
        }
        let tri = &self.scene.triangles[e.triangle as usize];
        let emission = self.scene.emission(e.triangle as usize, weights);
        let emission = emission.towards(-e.normal.dot(axis));
        let scale = edge.carried.dot(emission) * edge.sign * p.per_density;
        let by_axis = edge.jump.edge.by_axis * scale;
        self.edge_point_backward(p, &edge.jump, (point, time), scale, by, sums);
        // The axis points to a point of the light, which stays where it is on it.
        let by_to = by_axis.reject_from_normalized(axis) * (1.0 / hit.distance);
        by.position -= by_to;
        if self.wanted.objects[tri.object as usize] {
            let k = e.triangle as usize;
            self.add_to_corners(k, weights, by_to, time, sums);
        }
    }
}
